"""Every choice of a run as one frozen record; the TOML file has the same names."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from math import isfinite
from typing import Any

from pbrdf_bayes.effects_table import EFFECTS, FRESNEL_AT, LINE_SHAPES, alternatives_in
from pbrdf_bayes.errors import ConfigError

NOISES = ("correlated", "iid")
DISCREPANCIES = ("matern-3/2", "matern-1/2")
TAILS = ("normal", "student-t")
AUTO = ("auto",)
"""``effects`` of a run that leaves the choice to the data."""
_ELSEWHERE = {
    **{shape: f'a line shape: give line_shape = "{shape}" in the configuration'
       for shape in LINE_SHAPES},
    **{at: f'a place of the Fresnel factor: give fresnel_at = "{at}" in the configuration'
       for at in FRESNEL_AT},
    "depolarisation": "a key of a scene (predict --scene) and an argument of pb.mueller",
    "reciprocal": "a normalisation of predict: give --normalisation reciprocal with --params",
}  # fmt: skip
"""Words that are no effects, and what they are."""
PRIOR_PRESETS = ("paint", "dielectric", "metal")
BRDF_SCALES = ("absolute", "relative")
HOLDOUTS = ("none", "recipe", "all")
_LONGEST_SHOWN = 60
_NO_BREAK = dict.fromkeys((0xA0, 0x2007, 0x202F), "\u00a0")
_SPACES = dict.fromkeys((0x1680, *range(0x2000, 0x200B), 0x205F, 0x3000), " ") | _NO_BREAK


@dataclass(frozen=True)
class Accuracy:
    """What a level of ``--accuracy`` buys: quadrature tolerance and sampling effort."""

    rtol: float
    method: str
    ess_target: int


ACCURACIES: Mapping[str, Accuracy] = {
    "draft": Accuracy(rtol=1e-5, method="psis", ess_target=400),
    "standard": Accuracy(rtol=1e-6, method="emcee", ess_target=1000),
    "reference": Accuracy(rtol=1e-10, method="emcee", ess_target=10_000),
}


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """Choices of a run; every field is a top-level key of the TOML file.

    Attributes
    ----------
    noise : {"correlated", "iid"}
        Likelihood of the BRDF rows: with a discrepancy of the model that is correlated along
        theta_r, or with independent readings.
    discrepancy : {"matern-3/2", "matern-1/2"}
        Law of that discrepancy: paths with a slope, or rough ones.
    tails : {"normal", "student-t"}
        Law of the noise of a BRDF reading; Student's t lets outliers stand.
    student_dof : float
        Degrees of freedom of Student's t, 1 to 30; s_rel is then its scale.
    effects : tuple of str
        Effects added to the four-parameter model; empty is exactly the model of the 2011 paper,
        ``("auto",)`` those that predict readings left out better.
    line_shape : str
        Profile of the lobes over the direction cosine, of `pbrdf_bayes.effects_table.LINE_SHAPES`;
        ``lorentzian`` is that of the 2011 paper.
    fresnel_at : {"mean-sine", "geometric-mean", "mean-angle"}
        Where the reflectance of a lobe is taken: at the mean direction sine as in the 2011 paper,
        as sqrt(F(theta_i) F(theta_r)), or at the mean angle.
    accuracy : {"draft", "standard", "reference"}
        Quadrature tolerance and sampling effort, see `ACCURACIES`.
    prior : {"paint", "dielectric", "metal"}
        Preset of priors for the physical parameters.
    priors : mapping of str to mapping
        Replacements by parameter name, e.g. ``{"n": {"kind": "normal", "mean": 1.5, "sd": 0.05}}``.
    brdf_floor : float
        Noise-equivalent BRDF of the instrument [sr^-1]; readings at or below it are censored.
    angle_tolerance_deg : float
        Incidences and azimuths of scans that differ by no more are one geometry [deg].
    brdf_scale : {"absolute", "relative"}
        ``relative`` leaves the scale of each scan free: where the laboratory normalised its scans
        with its DHR readings, an absolute scale would use them twice.
    u_brdf_cal : float
        Relative standard uncertainty of the calibration factor of a scan [1].
    u_dhr_cal : float
        Relative standard uncertainty of the gain of the DHR readings of a polarisation [1].
    predict_theta_i_deg : tuple of float
        Incidence angles not measured at which the report shows predicted curves [deg]; empty
        chooses them between the measured ones.
    holdout : bool or {"none", "recipe", "all"}
        What is left out and predicted: ``recipe`` repeats that of the paper (DHR and one scan
        fitted, the other scans predicted); ``all`` also leaves out each angle of incidence, and
        predicts p from s and s from p. ``False`` is ``none``; ``True`` is ``recipe`` at draft
        accuracy and ``all`` otherwise.
    n_ensembles, n_walkers : int
        Independent ensembles and the walkers of each; at least three a parameter are taken.
    max_steps : int
        Budget of steps of each ensemble; beyond it the run ends as not converged.
    threads : int
        Ensembles that run at the same time; draws do not depend on it.

    Raises
    ------
    ConfigError
        When a value is not allowed; the message names the key, the value and what is allowed.

    Examples
    --------
    >>> RunConfig(accuracy="draft").rtol
    1e-05
    """

    noise: str = "correlated"
    discrepancy: str = "matern-3/2"
    tails: str = "normal"
    student_dof: float = 4.0
    effects: tuple[str, ...] = ()
    line_shape: str = "lorentzian"
    fresnel_at: str = "mean-sine"
    accuracy: str = "standard"
    prior: str = "paint"
    priors: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    brdf_floor: float = 0.0
    angle_tolerance_deg: float = 0.05
    brdf_scale: str = "absolute"
    u_brdf_cal: float = 0.0
    u_dhr_cal: float = 0.01
    predict_theta_i_deg: tuple[float, ...] = ()
    holdout: bool | str = True
    n_ensembles: int = 4
    n_walkers: int = 32
    max_steps: int = 20_000
    threads: int = 2

    def __post_init__(self) -> None:
        _one_of("noise", self.noise, NOISES)
        _one_of("discrepancy", self.discrepancy, DISCREPANCIES)
        _one_of("tails", self.tails, TAILS)
        _in_range("student_dof", self.student_dof, 1.0, 30.0)
        _one_of("line_shape", self.line_shape, LINE_SHAPES)
        _one_of("fresnel_at", self.fresnel_at, FRESNEL_AT)
        _one_of("accuracy", self.accuracy, ACCURACIES)
        _one_of("prior", self.prior, PRIOR_PRESETS)
        _one_of("brdf_scale", self.brdf_scale, BRDF_SCALES)
        _holdout(self.holdout)
        _tuple("effects", self.effects)
        _tuple("predict_theta_i_deg", self.predict_theta_i_deg)
        _effects(self.effects)
        _in_range("brdf_floor", self.brdf_floor, 0.0, 1e3)
        _in_range("angle_tolerance_deg", self.angle_tolerance_deg, 0.0, 1.0)
        _in_range("u_brdf_cal", self.u_brdf_cal, 0.0, 1.0)
        _in_range("u_dhr_cal", self.u_dhr_cal, 0.0, 1.0)
        for angle in self.predict_theta_i_deg:
            _in_range("predict_theta_i_deg", angle, 0.0, 89.95)
        _in_range("n_ensembles", self.n_ensembles, 4, 64)
        _in_range("n_walkers", self.n_walkers, 16, 4096)
        _in_range("max_steps", self.max_steps, 100, 10_000_000)
        _in_range("threads", self.threads, 1, 1024)

    @property
    def additions(self) -> tuple[str, ...]:
        """What goes beyond the model of the 2011 paper, in words; empty where nothing does."""
        words = list(self.effects)
        if self.line_shape != "lorentzian":
            words.append(f"{self.line_shape} line shape")
        if self.fresnel_at != "mean-sine":
            words.append(f"reflectance at the {self.fresnel_at.replace('-', ' ')}")
        return tuple(words)

    @property
    def model_name(self) -> str:
        """The model in words."""
        added = f" with {', '.join(self.additions)}" if self.additions else ""
        return f"four-parameter model{added}"

    @property
    def rtol(self) -> float:
        """Relative tolerance of the normalisation integral."""
        return ACCURACIES[self.accuracy].rtol

    @property
    def holdouts(self) -> str:
        """What is left out and predicted, one of `HOLDOUTS`."""
        if isinstance(self.holdout, str):
            return self.holdout
        thorough = "recipe" if self.accuracy == "draft" else "all"
        return thorough if self.holdout else "none"

    @property
    def ess_target(self) -> int:
        """Effective sample size asked of every parameter, bulk and tail."""
        return ACCURACIES[self.accuracy].ess_target


def check_keys(given: Iterable[str], *, where: str) -> None:
    """Refuse keys that `RunConfig` does not have, with the nearest one it has.

    Raises
    ------
    ConfigError
    """
    known = [f.name for f in fields(RunConfig)]
    for key in given:
        if key not in known:
            msg = (
                f"{where}: unknown key {key!r}.{did_you_mean(key, known)} Known: {', '.join(known)}"
            )
            raise ConfigError(msg)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`` Did you mean ...?`` with the nearest known word whatever its case, or nothing."""
    by_lower = {name.lower(): name for name in known}
    near = difflib.get_close_matches(word.lower(), by_lower, n=1)
    return f" Did you mean {by_lower[near[0]]!r}?" if near else ""


def show_value(value: Any) -> str:
    """A value for a message, shortened where it is long.

    Examples
    --------
    >>> show_value([20, "a"]), len(show_value("x" * 1000))
    ("[20, 'a']", 60)
    """
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # of thousands of digits, or lists in lists without end
        return "(too long to show)"
    return text if len(text) <= _LONGEST_SHOWN else f"{text[: _LONGEST_SHOWN - 3]}..."


def is_finite(value: Any) -> bool:
    """A number, true and false being none, that is finite as a float.

    Examples
    --------
    >>> is_finite(20), is_finite(10**400), is_finite("20"), is_finite(True)
    (True, False, False, False)
    """
    try:
        return isinstance(value, (int, float)) and not isinstance(value, bool) and isfinite(value)
    except OverflowError:
        return False


def plain_spaces(text: str) -> str:
    r"""Text with every Unicode space (category Zs) as a plain one or, where it is one, no-break.

    Examples
    --------
    >>> plain_spaces("23\u202f°C,\u2003dry")
    '23\xa0°C, dry'
    """
    return text.translate(_SPACES)


def _effects(names: tuple[str, ...]) -> None:
    """Known ones, each once, and no two that say the same; or ``auto`` alone."""
    if names == AUTO:
        return
    if names == ("none",):
        msg = "effects = ['none'] is not allowed: in a configuration none is an empty list. Give []"
        raise ConfigError(msg)
    for name in ("auto", "none"):
        if name in names:
            msg = f"effects: {name!r} stands alone. Give it without others, or name the effects"
            raise ConfigError(msg)
    for name in names:
        _known_effect(name)
        if names.count(name) > 1:
            msg = f"effects: {name!r} is given twice. Give it once"
            raise ConfigError(msg)
    both = alternatives_in(names)
    if both is not None:
        one, other = both
        msg = f"effects: {one!r} is an alternative to {other!r}, not an addition. Give one of them"
        raise ConfigError(msg)


def _known_effect(name: Any) -> None:
    """Refuse what is no effect, and say what it is where it has its place elsewhere."""
    if isinstance(name, str) and name in EFFECTS:
        return
    elsewhere = _ELSEWHERE.get(name, "") if isinstance(name, str) else ""
    hint = f" It is {elsewhere}." if elsewhere else did_you_mean(str(name), EFFECTS)
    msg = (
        f"effects = {show_value(name)} is not known.{hint} Allowed: none (effects = [] in a "
        f"configuration), 'auto' alone, or any of {', '.join(map(repr, EFFECTS))}"
    )
    raise ConfigError(msg)


def _one_of(key: str, value: Any, allowed: Iterable[str]) -> None:
    names = list(allowed)
    if value not in names:
        listed = ", ".join(map(repr, names)) or "none in this version"
        hint = did_you_mean(str(value), names)
        msg = f"{key} = {show_value(value)} is not known.{hint} Allowed: {listed}"
        raise ConfigError(msg)


def _holdout(value: Any) -> None:
    if not isinstance(value, bool) and not (isinstance(value, str) and value in HOLDOUTS):
        words = ", ".join(map(repr, HOLDOUTS))
        msg = f"holdout = {show_value(value)} is not allowed: give true or false, or one of {words}"
        raise ConfigError(msg)


def _tuple(key: str, value: Any) -> None:
    if not isinstance(value, tuple):
        msg = f"{key} = {show_value(value)} is not allowed: give a list (in Python a tuple)"
        raise ConfigError(msg)


def _in_range(key: str, value: Any, low: float, high: float) -> None:
    if not is_finite(value) or not low <= value <= high:
        msg = f"{key} = {show_value(value)} is not allowed: give a number in [{low:g}, {high:g}]"
        raise ConfigError(msg)

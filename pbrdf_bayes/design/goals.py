"""What a measurement sharpens: parameters, and predictions that are wanted, at the draws."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.design.beliefs import Beliefs
from pbrdf_bayes.design.candidates import Candidate
from pbrdf_bayes.design.evaluate import Stage
from pbrdf_bayes.design.hemispherical import hemispherical_values, of_sample
from pbrdf_bayes.design.scans import scan_geometry
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.model.four_parameter import MAX_THETA_I_DEG
from pbrdf_bayes.quantities import S_AND_P

Array = NDArray[np.float64]

GOAL_HELP = "dhr:Q:THETA_I, brdf:Q:THETA_I:THETA_R, scan:Q:THETA_I or ratio:THETA_I:THETA_R"
_FORMS = (
    re.compile(r"(?P<kind>dhr|scan):(?P<q>[spu]):(?P<i>[^:]+)$"),
    re.compile(r"(?P<kind>brdf):(?P<q>[spu]):(?P<i>[^:]+):(?P<r>[^:]+)$"),
    re.compile(r"(?P<kind>ratio):(?P<i>[^:]+):(?P<r>[^:]+)$"),
)


@dataclass(frozen=True)
class Goal:
    """A prediction that matters.

    Attributes
    ----------
    kind : {"dhr", "brdf", "scan", "ratio"}
        DHR at an angle; BRDF at a pair of angles; a whole scan; BRDF of s over that of p.
    polarization : str
        Empty for a ratio.
    theta_i_deg, theta_r_deg : float
        NaN where there is none [deg].
    """

    kind: str
    polarization: str
    theta_i_deg: float
    theta_r_deg: float = float("nan")

    @property
    def label(self) -> str:
        """E.g. ``DHR_s(70°)``, ``f_p(60°, -30°)``, ``scan f_s(60°)``, ``f_s/f_p(60°, 40°)``."""
        i, r = f"{self.theta_i_deg:g}°", f"{self.theta_r_deg:g}°"
        return {
            "dhr": f"DHR_{self.polarization}({i})",
            "brdf": f"f_{self.polarization}({i}, {r})",
            "scan": f"scan f_{self.polarization}({i})",
            "ratio": f"f_s/f_p({i}, {r})",
        }[self.kind]


def parse_goal(text: str) -> Goal:
    """A goal from its name on the command line.

    Raises
    ------
    ConfigError

    Examples
    --------
    >>> parse_goal("dhr:s:70").label, parse_goal("ratio:60:40").label
    ('DHR_s(70°)', 'f_s/f_p(60°, 40°)')
    """
    match = next((m for form in _FORMS if (m := form.match(text.strip()))), None)
    if match is None:
        msg = f"goal {text[:60]!r} is not known: give {GOAL_HELP}"
        raise ConfigError(msg)
    found = match.groupdict()
    theta_i = _angle(text, found["i"], 0.0, MAX_THETA_I_DEG)
    theta_r = _angle(text, found["r"], -90.0, 90.0) if found.get("r") else float("nan")
    return Goal(found["kind"], found.get("q") or "", theta_i, theta_r)


SCAN_DEG = tuple(float(a) for a in range(-80, 81, 8))
"""theta_r of a scan that is a goal, whatever the candidates are [deg]."""


def goal_values(posterior: Posterior, goal: Goal, x: Array) -> Array:
    """The prediction at parameter sets, shape (n_sets, n_values).

    DHR as it is, BRDF and ratios as natural logarithms; a scan has a value for each of `SCAN_DEG`.
    Of the sample, without the effects of the instrument.
    """
    x = of_sample(posterior, x)
    if goal.kind == "dhr":
        there = Candidate("dhr", goal.polarization, goal.theta_i_deg, 1.0)
        return hemispherical_values(posterior, there, x)[:, None]
    angles = np.array(SCAN_DEG if goal.kind == "scan" else [goal.theta_r_deg])
    words = S_AND_P if goal.kind == "ratio" else (goal.polarization,)
    logs = [
        np.log(np.maximum(
            posterior.predict(x, scan_geometry(goal.theta_i_deg, angles, q))[0], 1e-280
        ))
        for q in words
    ]  # fmt: skip
    return np.asarray(logs[0] - logs[1] if goal.kind == "ratio" else logs[0])


def values_of(beliefs: Beliefs, goals: Sequence[Goal], x: Array) -> tuple[Array, tuple[str, ...]]:
    """What the information is about and the goals at parameter sets, and the name of each column.

    A scan has a column for each angle; it counts by its mean variance.
    """
    p = beliefs.posterior
    found = [x[:, [p.parameter_names.index(name) for name in beliefs.about]]]
    names = [*beliefs.about]
    for goal in goals:
        found.append(goal_values(p, goal, x))
        names += [goal.label] * found[-1].shape[1]
    return np.concatenate(found, axis=1), tuple(names)


@dataclass(frozen=True, eq=False)
class Quantities:
    """Parameters and goals at the draws of a stage; a scan has several columns, together one name.

    Attributes
    ----------
    names : tuple of str
        Parameters that the information is about, then goals.
    own, inner : ndarray, shapes (n_outer, n_columns) and (n_inner, n_columns)
    slopes : ndarray, shape (n_paints, n_columns, n_model)
        At the paints of the linear law.
    variance : ndarray, shape (n_columns,)
        Before the measurement.
    groups : tuple of ndarray of int
        Columns of each name.
    """

    names: tuple[str, ...]
    own: Array
    inner: Array
    slopes: Array
    variance: Array
    groups: tuple[NDArray[np.int64], ...]

    @property
    def sd(self) -> Array:
        """Standard deviation of each name before the measurement."""
        return np.array([np.sqrt(self.variance[at].mean()) for at in self.groups])


def quantities_of(stage: Stage, goals: Sequence[Goal]) -> Quantities:
    """Parameters that the information is about, then goals, at the draws of a stage."""
    (own, columns), (inner, _), (moved, _) = (
        values_of(stage.beliefs, goals, x)
        for x in (stage.outer.x, stage.inner.x, stage.paints.moved)
    )
    names = tuple(dict.fromkeys(columns))
    return Quantities(
        names, own, inner, stage.paints.slopes(moved),
        np.concatenate([own, inner]).var(axis=0, ddof=1),
        tuple(np.flatnonzero(np.array(columns) == name) for name in names),
    )  # fmt: skip


def _angle(text: str, word: str, low: float, high: float) -> float:
    try:
        value = float(word)
    except ValueError:
        value = float("nan")
    if not low <= value <= high:
        msg = f"goal {text[:60]!r}: {word!r} is no angle in [{low:g}, {high:g}] degrees"
        raise ConfigError(msg)
    return value

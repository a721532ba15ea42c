"""Everything that may be added to the four-parameter model, declared once.

A parameter is a field of `EffectFields`; an effect is an entry of `EFFECTS`, a line shape one of
`LINE_SHAPES`. Names, ranges, null values, priors, candidates of ``auto``, energy checks, refusals
and documentation derive from here. The kernels have one place each:

- a line shape: `pbrdf_bayes.physics.lobes.line_shapes`;
- a diffuse term: a module of its own in `pbrdf_bayes.physics.effects`, called from ``diffuse.py``;
- an instrument error: `pbrdf_bayes.physics.instrument`.

Tests over these tables name a piece that is missing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from math import log
from typing import NamedTuple

FRESNEL_AT = ("mean-sine", "geometric-mean", "mean-angle")
"""Places of the Fresnel factor of a lobe; the first is that of the 2011 paper."""


class DefaultPrior(NamedTuple):
    """A prior on the domain of its parameter, see `pbrdf_bayes.inference.parameters`."""

    kind: str
    mean: float = 0.0
    sd: float = 1.0


UNIFORM, LOGUNIFORM = DefaultPrior("uniform"), DefaultPrior("loguniform")


@dataclass(frozen=True, kw_only=True)
class EffectParameter:
    """One parameter of an effect or of a line shape.

    Attributes
    ----------
    name, symbol, unit, meaning : str
    null : float
        Value at which it does nothing, or at which it is fixed beside a strength of zero.
    domain : tuple of float
        Lowest and highest value.
    prior : DefaultPrior
    log_coordinate : bool
        Optimiser and sampler move in its logarithm.
    typical : float
        A value of paints and instruments, for benchmarks.
    """

    name: str
    symbol: str
    unit: str
    meaning: str
    null: float
    domain: tuple[float, float]
    prior: DefaultPrior
    log_coordinate: bool
    typical: float


def _parameter(
    null: float, symbol: str, meaning: str, *, domain: tuple[float, float], typical: float,
    prior: DefaultPrior = UNIFORM, unit: str = "1", log_coordinate: bool = False,
) -> float:  # fmt: skip
    """A field with its null value as default; what else is known of it is its metadata."""
    known = {
        "null": null, "symbol": symbol, "unit": unit, "meaning": meaning, "domain": domain,
        "prior": prior, "log_coordinate": log_coordinate, "typical": typical,
    }  # fmt: skip
    declared: float = field(default=null, metadata=known)
    return declared


@dataclass(frozen=True, kw_only=True)
class EffectFields:
    """The value of every parameter; as made, nothing is added."""

    nu: float = _parameter(
        1.0, "ν", "exponent of the lobes (generalised Cauchy); 1 is the Lorentzian",
        domain=(0.6, 6.0), prior=DefaultPrior("lognormal", 0.0, log(1.6)), log_coordinate=True,
        typical=1.2,
    )  # fmt: skip
    eta: float = _parameter(
        1.0, "η", "Lorentzian share of the half width of the lobes (Voigt)", domain=(0.0, 1.0),
        typical=0.7,
    )  # fmt: skip
    narrowing: float = _parameter(
        1.0, "g", "exponent of the narrowing of the lobes with reflectance (Eq. 5)",
        domain=(0.0, 2.0), typical=1.1,
    )  # fmt: skip
    lambert: float = _parameter(
        0.0, "D", "albedo of ideal diffuse scatter beside the surface", domain=(0.0, 1.0),
        typical=0.01,
    )  # fmt: skip
    bulk: float = _parameter(
        0.0, "D_b", "bulk scatter that leaves through the surface", domain=(0.0, 1.0), typical=0.01
    )
    volume: float = _parameter(
        0.0, "h_b", "single scattering below the surface", domain=(0.0, 1.0), typical=0.01
    )
    asymmetry: float = _parameter(
        0.45, "b", "asymmetry of its phase function, backwards", domain=(0.0, 0.95),
        prior=DefaultPrior("fixed", 0.45), typical=0.45,
    )  # fmt: skip
    backscatter: float = _parameter(
        0.0, "a", "height of the peak back to the source", domain=(0.0, 1.0), typical=0.01
    )
    backscatter_width: float = _parameter(
        0.05, "w", "half width (HWHM) of that peak, in tan(g/2)", domain=(0.005, 0.3),
        prior=LOGUNIFORM, log_coordinate=True, typical=0.05,
    )  # fmt: skip
    dhr_offset: float = _parameter(
        0.0, "D_0", "offset of the DHR readings", domain=(-0.1, 0.1),
        prior=DefaultPrior("normal", 0.0, 0.005), typical=1e-3,
    )  # fmt: skip
    scale_p: float = _parameter(
        1.0, "g_p", "scale of p-polarised BRDF readings over that of s", domain=(0.5, 2.0),
        prior=DefaultPrior("lognormal", 0.0, 0.02), log_coordinate=True, typical=1.01,
    )  # fmt: skip
    leakage: float = _parameter(
        0.0, "l", "share of the other polarisation that the polariser lets through",
        domain=(0.0, 0.1), prior=DefaultPrior("normal", 0.0, 0.005), typical=1e-3,
    )  # fmt: skip
    offset_theta_i_deg: float = _parameter(
        0.0, "δ_i", "zero offset of the angle of incidence", domain=(-1.0, 1.0), unit="deg",
        prior=DefaultPrior("normal", 0.0, 0.1), typical=0.1,
    )  # fmt: skip
    offset_theta_r_deg: float = _parameter(
        0.0, "δ_r", "zero offset of the scattering angle", domain=(-1.0, 1.0), unit="deg",
        prior=DefaultPrior("normal", 0.0, 0.1), typical=0.1,
    )  # fmt: skip
    aperture_deg: float = _parameter(
        0.0, "a_d", "half of the angle that the detector sees along the scan", domain=(0.0, 3.0),
        unit="deg", prior=DefaultPrior("normal", 0.0, 0.5), typical=0.5,
    )  # fmt: skip


EFFECT_PARAMETERS: Mapping[str, EffectParameter] = {
    f.name: EffectParameter(name=f.name, **f.metadata) for f in fields(EffectFields)
}
"""Every parameter by its name."""


@dataclass(frozen=True)
class LineShape:
    """A profile of the lobes.

    Attributes
    ----------
    name : str
    parameter : str
        Its parameter, empty for none.
    after : str
        ``auto`` tries it once that other shape has gained; empty: it is tried straight away.
    """

    name: str
    parameter: str = ""
    after: str = ""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Its parameters, one or none."""
        return (self.parameter,) if self.parameter else ()


LINE_SHAPES: Mapping[str, LineShape] = {
    shape.name: shape
    for shape in (
        LineShape("lorentzian"),
        LineShape("gaussian", after="cauchy"),
        LineShape("voigt", "eta", after="cauchy"),
        LineShape("cauchy", "nu"),
    )
}
"""By name, in the order of the codes of the kernels; the first is that of the 2011 paper."""


@dataclass(frozen=True)
class Effect:
    """An addition to the model of the sample, or an error of the instrument.

    Attributes
    ----------
    name : str
        By which it is asked for.
    parameters : tuple of str
        Where there are several the first is the strength: at zero the others do nothing.
    kind : {"sample", "instrument"}
        ``auto`` tries those of the sample.
    diffuse : bool
        It adds to the BRDF and to the DHR of the surface.
    instead_of : str
        Another effect to which it is an alternative.
    needs : tuple of str
        Readings without which it is what its prior says, of `READINGS_NEEDED`.
    """

    name: str
    parameters: tuple[str, ...]
    kind: str = "sample"
    diffuse: bool = False
    instead_of: str = ""
    needs: tuple[str, ...] = ()


S_SCANS, P_SCANS, BRDF_SCANS, DHR_READINGS = READINGS_NEEDED = (
    "s scans", "p scans", "BRDF scans", "DHR readings",
)  # fmt: skip
EFFECTS: Mapping[str, Effect] = {
    effect.name: effect
    for effect in (
        Effect("lambert", ("lambert",), diffuse=True),
        Effect("bulk", ("bulk",), diffuse=True, instead_of="lambert"),
        Effect("volume", ("volume", "asymmetry"), diffuse=True),
        Effect("narrowing", ("narrowing",)),
        Effect("backscatter", ("backscatter", "backscatter_width"), diffuse=True),
        Effect("dhr_offset", ("dhr_offset",), "instrument", needs=(DHR_READINGS,)),
        Effect("scale_p", ("scale_p",), "instrument", needs=(S_SCANS, P_SCANS)),
        Effect("leakage", ("leakage",), "instrument", needs=(S_SCANS, P_SCANS)),
        Effect("offset_theta_i", ("offset_theta_i_deg",), "instrument", needs=(BRDF_SCANS,)),
        Effect("offset_theta_r", ("offset_theta_r_deg",), "instrument", needs=(BRDF_SCANS,)),
        Effect("aperture", ("aperture_deg",), "instrument", needs=(BRDF_SCANS,)),
    )
}
"""By name, those of the sample first."""

SAMPLE_EFFECTS = tuple(e.name for e in EFFECTS.values() if e.kind == "sample")
INSTRUMENT_EFFECTS = tuple(e.name for e in EFFECTS.values() if e.kind == "instrument")
DIFFUSE = tuple(e.name for e in EFFECTS.values() if e.diffuse)
"""Effects, and the parameters that are their strengths, which add to the DHR of the surface."""
DIFFUSE_PARAMETERS = tuple(p for name in DIFFUSE for p in EFFECTS[name].parameters)
INSTRUMENT_PARAMETERS = tuple(p for name in INSTRUMENT_EFFECTS for p in EFFECTS[name].parameters)
"""What the instrument does, and not the sample."""
ALTERNATIVES = {e.name: e.instead_of for e in EFFECTS.values() if e.instead_of}
"""Effects that are alternatives, and to what."""
IDLE_WITHOUT: Mapping[str, str] = {
    parameter: e.parameters[0] for e in EFFECTS.values() for parameter in e.parameters[1:]
}
"""Parameters that do nothing while a strength is zero, and that strength."""


def alternatives_in(names: tuple[str, ...]) -> tuple[str, str] | None:
    """An effect among ``names`` and the one there to which it is an alternative, or None.

    Examples
    --------
    >>> alternatives_in(("lambert", "bulk")), alternatives_in(("bulk", "volume"))
    (('bulk', 'lambert'), None)
    """
    both = ((one, other) for one, other in ALTERNATIVES.items() if {one, other} <= set(names))
    return next(both, None)


def _check_tables() -> None:
    """Every parameter belongs to one entry, and every name that an entry refers to exists."""
    entries: tuple[LineShape | Effect, ...] = (*LINE_SHAPES.values(), *EFFECTS.values())
    used = [parameter for entry in entries for parameter in entry.parameters]
    if sorted(used) != sorted(EFFECT_PARAMETERS):
        odd = set(used) ^ set(EFFECT_PARAMETERS) or {p for p in used if used.count(p) > 1}
        msg = f"each parameter belongs to one line shape or effect: {', '.join(sorted(odd))}"
        raise TypeError(msg)
    for effect in EFFECTS.values():
        if effect.diffuse and effect.parameters[0] != effect.name:
            msg = f"the strength of the diffuse term {effect.name} has another name than its own"
            raise TypeError(msg)
        if not set(effect.needs) <= set(READINGS_NEEDED):
            msg = f"the effect {effect.name} needs readings that are not known: {effect.needs}"
            raise TypeError(msg)
    others = {s.after for s in LINE_SHAPES.values()} - {"", *LINE_SHAPES}
    if others or not set(ALTERNATIVES.values()) <= set(EFFECTS):
        msg = f"not in the tables: {', '.join(sorted(others | set(ALTERNATIVES.values())))}"
        raise TypeError(msg)


_check_tables()

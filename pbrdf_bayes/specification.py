"""What a paint sample has to conform with, and by which decision rule: frozen records.

Words and rules are those of JCGM 106:2012 (ISO/IEC Guide 98-4), "The role of measurement
uncertainty in conformity assessment".
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from math import inf, isfinite
from typing import Any

from pbrdf_bayes.config import did_you_mean, is_finite, show_value
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.quantities import LIMITED, POLARIZATIONS, QUANTITIES

RULES = ("simple", "guard", "risk")
MOST_POINTS = 5000
"""Points of all limits together: each takes thousands of draws."""
LONGEST_NAME = 80
RULE_OF = {
    "guard_factor": "guard",
    "guard": "guard",
    "max_consumer_risk": "risk",
    "max_producer_risk": "risk",
}
"""The rule that each reservation belongs to; under another one it would say nothing."""


@dataclass(frozen=True, kw_only=True)
class Limit:
    """A tolerance interval for one measurand, or for all points of a band of angles together.

    Attributes
    ----------
    name : str
    quantity : {"parameter", "brdf", "dhr", "brdf_ratio"}
        ``brdf_ratio`` is the BRDF for s over that for p light.
    parameter : str
        Which one: of the sample or of the instrument, not of the noise.
    polarization : {"s", "p", "u"}
        Of the incident light, for BRDF and DHR.
    theta_i_deg, theta_r_deg : tuple of float
        Angles [deg], measured or not; the band is every incidence with every scattering angle.
    phi_r_deg : float
        Azimuth of the scattering directions [deg].
    lower, upper : float
        Tolerance limits in the unit of the quantity; infinite where there is none. For a
        difference minus and plus its tolerance.
    guard : float or None
        Length of the guard band in the unit of the quantity, instead of a multiple of u.
    difference : bool
        The measurand is the difference to a reference sample: sample - reference for a parameter,
        log10(sample / reference) [dex] for a curve.

    Raises
    ------
    ConfigError
    """

    name: str
    quantity: str
    parameter: str = ""
    polarization: str = ""
    theta_i_deg: tuple[float, ...] = ()
    theta_r_deg: tuple[float, ...] = ()
    phi_r_deg: float = 0.0
    lower: float = -inf
    upper: float = inf
    guard: float | None = None
    difference: bool = False

    def __post_init__(self) -> None:
        one_of("quantity", self.quantity, ("parameter", *LIMITED))
        self._refuse_wrong_limits()
        if self.quantity == "parameter":
            if not self.parameter:
                msg = "parameter is missing: give its name, e.g. n, k, sigma_n0 or rho0"
                raise ConfigError(msg)
            self._refuse("polarization", "theta_i_deg", "theta_r_deg", "phi_r_deg")
            return
        self._refuse("parameter")
        what = QUANTITIES[self.quantity]
        if what.polarized:
            one_of("polarization", self.polarization, POLARIZATIONS)
        else:
            self._refuse("polarization")
        if what.hemispherical:
            self._refuse("theta_r_deg", "phi_r_deg")
            self._refuse_no_share()
        elif not self.difference:
            self._refuse_not_positive()
        self._check_angles()

    @property
    def n_points(self) -> int:
        """Points of the band; 1 for a parameter."""
        return max(len(self.theta_i_deg), 1) * max(len(self.theta_r_deg), 1)

    @property
    def unit(self) -> str:
        """Of the limits."""
        if self.difference and self.quantity != "parameter":
            return "dex"
        return "" if self.quantity == "parameter" else QUANTITIES[self.quantity].shown_unit

    def _refuse_wrong_limits(self) -> None:
        if not (isfinite(self.lower) or isfinite(self.upper)):
            msg = "lower and upper are missing: give at least one of them"
            raise ConfigError(msg)
        if self.lower >= self.upper:
            msg = f"lower = {self.lower:g} is not below upper = {self.upper:g}"
            raise ConfigError(msg)
        if self.guard is not None and not 0.0 <= self.guard < inf:
            msg = f"guard = {self.guard!r} is not allowed: give a length of 0 or more"
            raise ConfigError(msg)

    def _refuse_no_share(self) -> None:
        """A share of the light beyond 0 or 1 would never bind, or always."""
        for key in ("lower", "upper"):
            value = getattr(self, key)
            if isfinite(value) and not 0.0 <= value <= 1.0 and not self.difference:
                percent = f": {value:g} % is {value / 100.0:g}" * (1.0 < value <= 100.0)
                what = QUANTITIES[self.quantity].one
                msg = f"{key} = {value:g} is not allowed: {what} is a share in [0, 1]{percent}"
                raise ConfigError(msg)

    def _refuse_not_positive(self) -> None:
        """A limit on a BRDF or a ratio of two below 0 would never bind, or always."""
        for key in ("lower", "upper"):
            value = getattr(self, key)
            if isfinite(value) and (value < 0.0 or value == self.upper == 0.0):
                what = QUANTITIES[self.quantity].one
                msg = f"{key} = {value:g} is not allowed: {what} is above 0"
                raise ConfigError(msg)

    def _refuse(self, *keys: str) -> None:
        for key in keys:
            if getattr(self, key):
                msg = f"{key} does not go with quantity = {self.quantity!r}. Leave it out"
                raise ConfigError(msg)

    def _check_angles(self) -> None:
        for key in QUANTITIES[self.quantity].angles:
            if not getattr(self, key):
                msg = f'{key} is missing: give an angle, a list, or "LO:HI:STEP" [deg]'
                raise ConfigError(msg)
            for angle in getattr(self, key):
                if not is_finite(angle):
                    msg = f"{key}: {show_value(angle)} is not a finite number: give degrees"
                    raise ConfigError(msg)


@dataclass(frozen=True, kw_only=True)
class DecisionRule:
    """How a verdict follows from a posterior; see `pbrdf_bayes.conform.conformity`.

    Attributes
    ----------
    rule : {"simple", "guard", "risk"}
    guard_factor : float
        Length of the guard band over the standard uncertainty; 1.645 leaves a normal law 5 %.
    max_consumer_risk, max_producer_risk : float
        Largest probability that what is accepted does not conform, and that what is rejected does.

    Raises
    ------
    ConfigError
    """

    rule: str = "risk"
    guard_factor: float = 1.645
    max_consumer_risk: float = 0.05
    max_producer_risk: float = 0.05

    def __post_init__(self) -> None:
        one_of("rule", self.rule, RULES)
        _in_range("guard_factor", self.guard_factor, 0.0, 10.0)
        _in_range("max_consumer_risk", self.max_consumer_risk, 1e-4, 0.5)
        _in_range("max_producer_risk", self.max_producer_risk, 1e-4, 0.5)
        for key, default in _RESERVATIONS.items():
            if getattr(self, key) != default:
                refuse_other_rule(key, self.rule)


_RESERVATIONS = {f.name: f.default for f in fields(DecisionRule) if f.name in RULE_OF}


@dataclass(frozen=True, kw_only=True)
class Specification:
    """Limits that hold together, their decision rule, and what they are called.

    Raises
    ------
    ConfigError
        No limit, a name given twice, too many points, or a guard band under another rule.
    """

    limits: tuple[Limit, ...]
    decision: DecisionRule = field(default_factory=DecisionRule)
    title: str = ""
    source: str = ""
    """The file they come from."""

    def __post_init__(self) -> None:
        if not self.limits:
            msg = "no [[limit]] and no [[difference]]: give at least one"
            raise ConfigError(msg)
        names = [limit.name for limit in self.limits]
        for name, count in Counter(names).items():
            if count > 1:
                msg = f"name = {name!r} is given twice. Give each limit a name of its own"
                raise ConfigError(msg)
        for limit in self.limits:
            if limit.guard is not None:
                refuse_other_rule("guard", self.decision.rule, of=limit.name)
        n = self.n_points
        if n > MOST_POINTS:
            msg = f"the limits make {n} points; allowed are {MOST_POINTS}. Take wider steps"
            raise ConfigError(msg)

    @property
    def n_points(self) -> int:
        """Points of all limits."""
        return sum(limit.n_points for limit in self.limits)

    @property
    def needs_reference(self) -> bool:
        """Some limit is on a difference to a reference sample."""
        return any(limit.difference for limit in self.limits)


def one_of(key: str, value: Any, allowed: Iterable[str]) -> None:
    """Refuse a word that is not allowed, with the nearest one that is.

    Raises
    ------
    ConfigError
    """
    names = list(allowed)
    listed = ", ".join(map(repr, names))
    if value == "":
        msg = f"{key} is missing. Allowed: {listed}"
        raise ConfigError(msg)
    if value not in names:
        hint = did_you_mean(str(value), names)
        msg = f"{key} = {show_value(value)} is not known.{hint} Allowed: {listed}"
        raise ConfigError(msg)


def refuse_other_rule(key: str, rule: str, *, of: str = "") -> None:
    """Refuse a reservation under a decision rule that would not use it.

    Raises
    ------
    ConfigError
    """
    if RULE_OF[key] != rule:
        where = f"{key} of limit {of!r}" if of else key
        msg = (
            f'{where} belongs to rule = "{RULE_OF[key]}" and does nothing under rule = "{rule}", '
            f'the rule here. Take it out, or give rule = "{RULE_OF[key]}"'
        )
        raise ConfigError(msg)


def _in_range(key: str, value: float, low: float, high: float) -> None:
    if not is_finite(value) or not low <= value <= high:
        msg = f"{key} = {show_value(value)} is not allowed: give a number in [{low:g}, {high:g}]"
        raise ConfigError(msg)

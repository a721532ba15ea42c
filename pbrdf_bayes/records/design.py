"""The records of ``design.json``: what to measure next.

A field with a default may be absent: files of earlier versions lack it. Fields may be added in
later versions; those listed keep their meaning within a ``schema_version``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import UNSET, Meta, Struct, UnsetType

from pbrdf_bayes.records.values import Judged, Number, Polarization, Positive, Probable, Whole

if TYPE_CHECKING:
    Quantity = str
    Estimator = str
    SpreadEstimator = str
    Status = str
    Noise = str
    Scale = str
    AtLeastOne = int
    Incidence = float
    NotNegative = float
else:
    Quantity = Literal["brdf", "dhr", "ddr"]
    Estimator = Literal["nested", "refined", "local"]
    SpreadEstimator = Literal["nested", "local"]
    Status = Literal["done", "not_converged"]
    Noise = Literal["correlated", "iid"]
    Scale = Literal["absolute", "relative"]
    AtLeastOne = Annotated[int, Meta(ge=1)]
    Incidence = Annotated[float, Meta(ge=0, le=90)]
    NotNegative = Annotated[float, Meta(ge=0)]


class DesignRun(Struct, frozen=True, kw_only=True):
    """The run that the beliefs come from."""

    sample: str
    wavelength_um: Positive
    created_utc: str
    status: Status = "done"
    verdict: Judged
    seed: int
    applicability: str | None


class Geometry(Struct, frozen=True, kw_only=True):
    """A candidate measurement.

    Attributes
    ----------
    theta_r_step_deg : float or None
        None for DHR, DDR, a single reading and uneven steps.
    """

    label: str
    quantity: Quantity
    polarization: Polarization
    theta_i_deg: Incidence
    theta_r_lo_deg: float | None
    theta_r_hi_deg: float | None
    theta_r_step_deg: float | None
    port_deg: float | None
    n_readings: AtLeastOne
    minutes: Positive


class Ratio(Struct, frozen=True):
    """Expected standard deviation after over before, and its standard error."""

    ratio: Number
    se: Number


class CandidateGain(Geometry, frozen=True, kw_only=True):
    """A candidate and its gain; None where the linear estimate alone screened it.

    Attributes
    ----------
    eig_nats : float
        Expected information gain, middle of eig_low and eig_high, or the local normal
        approximation (eig_method).
    eig_se : float
        Monte Carlo standard error, from the simulated readings and the draws that they are compared
        with.
    eig_method : {"nested", "refined", "local"}
        Nested Monte Carlo; with draws made for each simulated reading; local normal approximation,
        within the bracket.
    local_nats : float
        By the local normal approximation, computed where the bracket of nested Monte Carlo is wide.
    p_best : float
        Chance to be the best, from p_best_readings simulated readings; shared evenly among those
        not told apart where brackets of more than 0.3 nat overlap.
    sd_method : {"nested", "local"}
        The second where fewer than 10 effective draws are left.
    sd_ratio : mapping of str to Ratio
        By parameter or goal.
    """

    eig_nats: float | None = None
    eig_se: float | None = None
    eig_low: float | None = None
    eig_high: float | None = None
    eig_method: Estimator | None = None
    local_nats: float | None = None
    ess: float | None = None
    eig_per_minute: float | None = None
    eig_per_minute_se: float | None = None
    linear_nats: float
    linear_se: float
    p_best: float | None = None
    p_best_per_minute: float | None = None
    tied: bool | None = None
    tied_per_minute: bool | None = None
    pareto: bool | None = None
    repeat: bool | None = None
    sd_method: SpreadEstimator | None = None
    sd_ratio: Mapping[str, Ratio] | None = None


class Member(Geometry, frozen=True, kw_only=True):
    """A measurement of a plan, with what it adds to those before it."""

    cumulative_minutes: float
    cumulative_nats: float
    cumulative_se: float
    added_nats: float
    added_se: float
    method: Estimator = "nested"


class Plan(Struct, frozen=True, kw_only=True):
    """Measurements one after the other, and what they give together."""

    members: tuple[Member, ...]
    eig_nats: float
    eig_se: float
    eig_low: float
    eig_high: float
    minutes: float
    method: Estimator = "nested"


class BatchPlan(Plan, frozen=True, kw_only=True):
    """The plan within a budget of minutes."""

    budget_minutes: float | None


class Pairs(Struct, frozen=True, kw_only=True):
    """The best pair, and the two that are best one after the other."""

    best: Plan
    greedy: Plan
    gap_nats: float
    gap_se: float
    n_compared: int
    method: SpreadEstimator = "nested"


class GoalCandidate(Struct, frozen=True, kw_only=True):
    """What a candidate does for one prediction.

    Attributes
    ----------
    reduction : float
        Expected share of the variance that the measurement takes away.
    sd_ratio : float
        Expected standard deviation after over before.
    """

    label: str
    quantity: Quantity
    minutes: Positive
    reduction: float
    reduction_se: float
    reduction_per_minute: float
    reduction_per_minute_se: float
    sd_ratio: float
    sd_ratio_se: float
    p_best: Probable
    p_best_per_minute: Probable
    tied: bool
    tied_per_minute: bool
    pareto: bool
    method: SpreadEstimator = "nested"
    theta_i_deg: float | UnsetType = UNSET
    polarization: Polarization | UnsetType = UNSET
    port_deg: float | UnsetType | None = UNSET


class GoalRanking(Struct, frozen=True, kw_only=True):
    """A goal with all candidates, the one that sharpens it most first."""

    name: str
    sd_before: float
    p_best_readings: int | UnsetType = UNSET
    candidates: Annotated[tuple[GoalCandidate, ...], Meta(min_length=1)]


class Choices(Struct, frozen=True, kw_only=True):
    """How much was computed."""

    n_outer: int
    n_inner: int
    n_nuisance: int
    batch: int
    minutes: float | None


class Instrument(Struct, frozen=True, kw_only=True):
    """What is assumed of the instrument.

    Attributes
    ----------
    scans_of_prior : bool
        Noise and discrepancy of scans have their priors.
    """

    noise: Noise
    brdf_scale: Scale
    u_brdf_cal: NotNegative
    u_dhr_cal: NotNegative
    scans_of_prior: bool


class Design(Struct, frozen=True, kw_only=True):
    """``design.json`` of pbrdf_bayes.

    Attributes
    ----------
    run : DesignRun or None
        The run that the beliefs come from; None: the priors.
    sd_before : mapping of str to float
        By parameter or goal; of the natural logarithm for a BRDF or a ratio.
    candidates : tuple of CandidateGain
        Largest gain first, then those that were only screened.
    p_best_readings : int
        Simulated readings that p_best rests on: the fewest that any two candidates share.
    """

    schema_version: Literal[1] = 1
    version: str
    run: DesignRun | None
    about: Annotated[tuple[str, ...], Meta(min_length=1)]
    sd_before: Mapping[str, Number]
    n_candidates: AtLeastOne
    n_evaluated: AtLeastOne
    candidates: Annotated[tuple[CandidateGain, ...], Meta(min_length=1)]
    batch: BatchPlan
    pairs: Pairs | None
    goals: tuple[GoalRanking, ...] = ()
    choices: Choices
    p_best_readings: int | UnsetType = UNSET
    instrument: Instrument | UnsetType = UNSET
    seed: Whole
    recommendation: str

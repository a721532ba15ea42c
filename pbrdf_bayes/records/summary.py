"""The records of ``summary.json``.

A field with a default may be absent: runs of earlier versions lack it. Fields may be added in later
versions; those listed keep their meaning within a ``schema_version``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import nan
from typing import TYPE_CHECKING, Annotated, Any, Literal

from msgspec import UNSET, Meta, Struct, UnsetType, field

from pbrdf_bayes.records.checks import Check, Finding, Judgement
from pbrdf_bayes.records.values import (
    CheckJudged,
    Correlation,
    Factor,
    Judged,
    MaybeSha256,
    Number,
    Polarization,
    Positive,
    Probable,
    Sha256,
    Share,
    Whole,
)

if TYPE_CHECKING:
    Kind = str
    Status = str
    Method = str
    Applies = str
    LeftOut = str
    Decision = str
    Quantity = str
    DocumentItem = str
else:
    Kind = Literal["physical", "instrument", "nuisance", "fixed"]
    Status = Literal["done", "not_converged"]
    Method = Literal["emcee", "psis"]
    Applies = Literal["applies", "descriptive only", "does not apply"]
    LeftOut = Literal["recipe", "angle", "polarization"]
    Decision = Literal["ACCEPT", "REJECT", "UNDECIDED"]
    Quantity = Literal["parameter", "brdf", "dhr", "brdf_ratio"]
    DocumentItem = Annotated[str, Meta(max_length=2000)]

SCHEMA_VERSION = 1
PHYSICAL = ("n", "k", "sigma_n0", "rho0")
"""Parameters that every run has."""


class Applicability(Struct, frozen=True):
    """Whether the parameters may be read as properties of the material.

    Attributes
    ----------
    verdict : {"applies", "descriptive only", "does not apply"}
    reasons : tuple of str
        What speaks against it, with the numbers; empty where nothing does.
    statement, advice : str
    limit_dex : float
        Rms beyond which the model is descriptive only [dex].
    repeatability_dex : float
        How well a reading repeats [dex]; NaN where that is not known.
    repeatability : str
        Where that is known from.
    held_out : str
        How angles that were left out are predicted, or why none was.
    caveats : tuple of str
        What the verdict does not cover: what was not tested, which of n, k, sigma_n0 and rho0 was
        assumed, whether k is bounded from above only.
    """

    verdict: Applies
    reasons: tuple[str, ...]
    statement: str
    advice: str
    limit_dex: Number
    repeatability_dex: Number = nan
    repeatability: str = ""
    held_out: str = ""
    caveats: tuple[str, ...] = ()


class ScanSummary(Struct, frozen=True, kw_only=True):
    """One BRDF scan that was used [deg, sr^-1, dex].

    Attributes
    ----------
    scale, u_scale : float
        Posterior mean of the calibration factor and its standard uncertainty; 1 and 0 where the
        scale is taken as exact.
    """

    label: str
    polarization: Polarization
    theta_i_deg: float
    phi_r_deg: float
    n: Whole
    theta_r_min_deg: Number
    theta_r_max_deg: Number
    value_min: Number
    value_max: Number
    rms_dex: Number
    bias_dex: Number
    lag1: Number
    scale: Number
    u_scale: Number


class Input(Struct, frozen=True, kw_only=True):
    """The measurement: its file, its checks and its scans.

    Attributes
    ----------
    excluded : mapping of str to int
        Rows left out, by their flag.
    """

    file: str
    sha256: MaybeSha256
    n_brdf: Whole
    n_dhr: Whole
    excluded: Mapping[str, Whole]
    warnings: tuple[str, ...]
    checks: tuple[Check, ...]
    scans: tuple[ScanSummary, ...]


class Scored(Struct, frozen=True, kw_only=True):
    """A candidate of the choice of effects, and how it predicts.

    Attributes
    ----------
    name : str
        Effects and line shape in words.
    effects : tuple of str
    line_shape : str
    n_free : int
        Parameters of the model that are not fixed.
    rms_dex, held_out_dex : float
        Of the readings fitted, and of those left out, root mean square over the cases.
    mean_held_out_dex : float
        Mean over the cases of the rms of the readings left out.
    score, difference, u_difference : float
        Mean ln rms of what was left out; that of the best candidate subtracted, with the standard
        error of the paired difference.
    at_bound : tuple of str
        Parameters on a bound that is not their null value.
    microseconds : float
        Of one likelihood evaluation.
    chosen : bool
    """

    name: str
    effects: tuple[str, ...]
    line_shape: str
    n_free: int
    rms_dex: Number
    held_out_dex: Number
    mean_held_out_dex: Number = nan
    score: Number
    difference: Number
    u_difference: Number
    at_bound: tuple[str, ...]
    microseconds: Number
    chosen: bool


class EffectsChoice(Struct, frozen=True):
    """Effects tried, the smallest candidate first, and how they predict readings left out.

    Attributes
    ----------
    candidates : tuple of Scored
    cases : tuple of str
        What was left out in each.
    statement, caution : str
        The second where too few cases could be left out.
    held_out : mapping of str to float
        Rms of what the chosen one predicts of readings left out, by kind [dex].
    symbols : mapping of str to str
        Of the parameters that candidates have on their bounds.
    """

    candidates: tuple[Scored, ...]
    cases: tuple[str, ...]
    statement: str
    caution: str = ""
    held_out: Mapping[str, float] = field(default_factory=dict)
    symbols: Mapping[str, str] = field(default_factory=dict)


class Parameter(Struct, frozen=True, kw_only=True):
    """Posterior of one parameter; q025 to q975 is the equal-tailed 95 % credible interval.

    Attributes
    ----------
    contraction : float
        1 - var(posterior)/var(prior); NaN for one held fixed.
    identified : bool
        Whether the readings determine the parameter; false for one held fixed.
    contraction_effective : float
        The same with the likelihood weakened to the effective number of readings.
    prior_sensitivity, likelihood_sensitivity : float
        Change of the marginal (cumulative Jensen-Shannon distance) for a doubling of the power of
        the prior of the physical parameters, and of the likelihood. Above 0.05 the prior matters;
        below 0.05 the readings hardly do.
    """

    symbol: str
    unit: str | None
    description: str
    kind: Kind
    mean: Number
    sd: Number
    median: Number
    q05: Number
    q95: Number
    q025: Number
    q975: Number
    map: Number
    ess_bulk: Number
    ess_tail: Number
    rhat: Number
    mcse_mean: Number
    prior: str
    prior_sd: Number
    contraction: Number
    identified: bool
    contraction_effective: Number | UnsetType = UNSET
    prior_sensitivity: Number | UnsetType = UNSET
    likelihood_sensitivity: Number | UnsetType = UNSET


class CorrelationMatrix(Struct, frozen=True):
    """Of the parameters that are not fixed."""

    names: tuple[str, ...]
    matrix: Sequence[Sequence[Correlation]]


class OverScans(Struct, frozen=True):
    """A figure of all readings together and of each scan."""

    overall: Number
    scans: Mapping[str, Number]


class Best(Struct, frozen=True):
    """The least-squares optimum of the same model."""

    overall: Number
    parameters: Mapping[str, Number]


class Fit(Struct, frozen=True):
    """Residuals log10(measured/model) of the BRDF rows.

    Attributes
    ----------
    rms_dex : OverScans
        At the MAP.
    rms_dex_best : Best
    lag1 : OverScans
        Lag-1 autocorrelation along theta_r.
    """

    rms_dex: OverScans
    rms_dex_best: Best
    lag1: OverScans


class DiscrepancySize(Struct, frozen=True):
    """What a correlated misfit came to, and what independent readings would have claimed.

    Attributes
    ----------
    tau, ell_deg : float
        Posterior medians of amplitude [1, in ln BRDF] and length [deg].
    span_deg : float
        Longest scan [deg].
    white_noise : float
        Posterior median of the relative white noise, the largest of the polarisations [1].
    size_dex, size_percent : float
        The amplitude once more, in log10 BRDF and in per cent of the BRDF.
    sd, sd_if_independent : mapping of str to float
        Standard deviation of each physical parameter, and what the likelihood of independent
        readings would have claimed (at its optimum, by Laplace's method).
    """

    tau: Number
    ell_deg: Number
    span_deg: Number
    white_noise: Number
    size_dex: Number
    size_percent: Number
    sd: Mapping[str, Number]
    sd_if_independent: Mapping[str, Number]


class OptimumSummary(Struct, frozen=True):
    """A distinct optimum of the posterior density; ``delta`` is to the best one."""

    log_posterior: Number
    delta: Number
    n_starts: Whole
    parameters: Mapping[str, Number]


class Map(Struct, frozen=True):
    """The search for the posterior's optima."""

    n_starts: Whole
    optima: tuple[OptimumSummary, ...]


class Sampling(Struct, frozen=True, kw_only=True):
    """How the draws were made."""

    method: Method
    n_ensembles: Number
    n_walkers: Number
    n_steps: Number
    n_burn: Number
    thin: Number
    n_draws: Whole
    acceptance: Number
    autocorrelation_time: Number
    k_hat: Number | UnsetType = UNSET
    moves: str | None
    n_evaluations: Number


class RejectedPoints(Struct, frozen=True):
    """Points inside the prior at which the model gave no finite density."""

    n: Whole
    examples: tuple[Mapping[str, Number], ...]


class Accuracy(Struct, frozen=True):
    """Of the normalisation, and what an evaluation costs."""

    level: str
    rtol: Number
    normalisation_error: Number
    microseconds_per_evaluation: Number


class HeldOutScan(Struct, frozen=True):
    """How a scan that was left out is predicted, see `Prediction`."""

    label: str
    rms_dex: Number
    coverage_90: Share
    width_dex: Number


class RecipeHoldout(Struct, frozen=True, kw_only=True):
    """Scans that were left out, predicted from ``fitted``."""

    fitted: str
    rms_dex: Number
    coverage_90: Share
    width_dex: Number
    statement: str
    scans: tuple[HeldOutScan, ...]


class Prediction(Struct, frozen=True, kw_only=True):
    """A prediction of scans left out.

    Attributes
    ----------
    kind : {"recipe", "angle", "polarization"}
    name : str
        What was left out; for the recipe, the scan that was fitted.
    fitted : str
    n : int
        Readings predicted.
    rms_dex : float
        Of log10(measured / predicted median).
    rms_expected_dex : float
        95 % quantile of that rms for readings that follow the prediction.
    coverage_90 : float
    width_dex : float
        Mean width of the 90 % predictive band.
    statement : str
    verdict : {"PASS", "WARN", "FAIL", "SKIP"}
    """

    kind: LeftOut
    name: str
    fitted: str
    n: Whole
    rms_dex: Number
    rms_expected_dex: Number
    coverage_90: Share
    width_dex: Number
    statement: str
    verdict: CheckJudged


class Influential(Struct, frozen=True):
    """One reading among those that sway the posterior most, or are farthest from the others.

    Attributes
    ----------
    label : str
        Scan, or DHR and its polarisation.
    angle_deg : float
        theta_r; theta_i of a DHR reading.
    row : int
        Line in the file; 0 where there is none.
    k_hat : float
    z : float
        Distance from what all others predict, in standard deviations.
    """

    label: str
    angle_deg: float
    row: Whole
    k_hat: Number
    z: Number


class ScanPit(Struct, frozen=True):
    """Probability integral transform of one scan.

    Attributes
    ----------
    label : str
    n : int
    distance, p_value : float
        Kolmogorov distance from uniform and its p-value.
    mean, sd : float
        Of the places as normal quantiles: 0 where there is no bias, 1 where the predicted width is
        right.
    """

    label: str
    n: Whole
    distance: Share
    p_value: Share
    mean: Number
    sd: Number


class LeaveOneOutSummary(Struct, frozen=True, kw_only=True):
    """Each reading predicted from all others by Pareto-smoothed importance sampling.

    Attributes
    ----------
    elpd, u_elpd : float
        Sum of the log predictive densities of ln BRDF and of DHR, and its standard error.
    p_loo : float
        Effective number of parameters.
    k_hat : float
        Largest Pareto k-hat, after readings above the limit were scored by samples of their own.
    n_influential : int
        Readings above the limit with draws of the whole posterior.
    """

    elpd: Number
    u_elpd: Number
    p_loo: Number
    n: Whole
    n_draws: Whole
    k_hat: Number
    k_hat_limit: Number
    n_influential: Whole
    most_influential: tuple[Influential, ...]
    farthest: tuple[Influential, ...]
    pit: tuple[ScanPit, ...]


class ScanWidth(Struct, frozen=True):
    """The lobe width that one scan asks for, everything but its scale at the MAP.

    Attributes
    ----------
    label, polarization : str
    theta_i_deg : float
        [deg].
    rho0, u_rho0 : float
        Own width at normal incidence and its standard error, correlated residuals allowed for, in
        direction cosine [1]; NaN where the scan has too few readings or no width inside the
        model's domain fits it best.
    rho, u_rho : float
        The same at the specular direction [1]; of an unpolarised scan the mean of s and p.
    rho_model : float
        Eq. (5) there with the parameters of the MAP [1].
    scale : float
        Own scale over that of the model [1].
    lag1 : float
        Correlation of neighbouring residuals of this fit [1].
    n : int
        Readings that took part.
    """

    label: str
    polarization: Polarization
    theta_i_deg: float
    rho0: Number
    u_rho0: Number
    rho: Number
    u_rho: Number
    rho_model: Number
    scale: Number
    lag1: Number
    n: Whole


class LargestDefect(Struct, frozen=True):
    """The pair of measured angles with the largest reciprocity defect.

    Attributes
    ----------
    polarization : {"s", "p", "u"}
    theta_a_deg, theta_b_deg : float
        b is negative where it lies on the side of a [deg].
    factor : float
        Posterior median of f(a -> b) / f(b -> a), above 1.
    q05, q95 : float
    """

    polarization: Polarization
    theta_a_deg: float
    theta_b_deg: float
    factor: Factor
    q05: Number = nan
    q95: Number = nan


class ReciprocitySize(Struct, frozen=True, kw_only=True):
    """f(a -> b) / f(b -> a) in plane over the posterior; 1 is reciprocal.

    Attributes
    ----------
    theta_deg : tuple of float
        Angles of the table, forward side [deg].
    factors, q05, q95 : mapping of str to list of list of float
        Median and 90 % interval [1], a in rows, b in columns: for s and p, or for u alone where
        every scan is unpolarised. ``factors`` of older runs is at the MAP.
    n_draws : int
        Posterior draws used.
    largest : LargestDefect or None
        Over the pairs of angles that were measured in plane, of the polarisations measured; None
        without any.
    """

    theta_deg: tuple[float, ...]
    factors: Mapping[Polarization, list[list[Number]]]
    q05: Mapping[Polarization, list[list[Number]]] = field(default_factory=dict)
    q95: Mapping[Polarization, list[list[Number]]] = field(default_factory=dict)
    n_draws: Whole = 0
    largest: LargestDefect | None


class Probability(Struct, frozen=True):
    """A probability counted on draws.

    Attributes
    ----------
    value : float
    u : float
        Monte Carlo standard error; 0 where no draw or every draw counts, and then `low` or `high`
        is what is known.
    low, high : float
        95 % Clopper-Pearson limits at the effective number of draws.
    ess : float
        Effective number of draws.
    """

    value: Probable
    u: float
    low: float
    high: float
    ess: float


class LimitVerdict(Struct, frozen=True, kw_only=True):
    """Verdict on one limit of a specification, with the curve that it is on.

    Attributes
    ----------
    reason, remark : str
        Why it is undecided; the risk of a decision that is more likely wrong than right.
    judged : bool
        No reservation speaks against a verdict.
    probability_exceeds : Probability or None
        That a difference exceeds its tolerance, at any point; None for other limits.
    worst : int
        Index of the point least probably inside.
    """

    name: str
    quantity: Quantity
    parameter: str | UnsetType = UNSET
    polarization: str | UnsetType = UNSET
    phi_r_deg: float | UnsetType = UNSET
    difference: bool | UnsetType = UNSET
    unit: str
    lower: Number
    upper: Number
    verdict: Decision
    reason: str
    remark: str | UnsetType = UNSET
    judged: bool
    probability: Probability
    probability_exceeds: Probability | None = None
    consumer_risk: Number
    producer_risk: Number
    worst: Whole
    theta_i_deg: list[Number]
    theta_r_deg: list[Number]
    mean: list[Number]
    u: list[Number]
    q025: list[Number]
    q975: list[Number]
    inside: list[Number]
    guard: list[Number]


class Rule(Struct, frozen=True):
    """The decision rule, see `pbrdf_bayes.specification.DecisionRule`."""

    rule: str
    guard_factor: Number
    max_consumer_risk: Number
    max_producer_risk: Number


class RunIdentity(Struct, frozen=True, kw_only=True):
    """The run that differences are to."""

    sample: str
    verdict: str
    created_utc: str
    sha256: str = ""


class Conformity(Struct, frozen=True, kw_only=True):
    """Verdicts on the limits of a specification.

    Attributes
    ----------
    discrepancy : bool
        Predictions hold the discrepancy of the model along a scan.
    specification_sha256 : str
        Of its limits and decision rule; absent where one run alone was judged.
    """

    specification: str
    decision_rule: Rule
    verdict: Decision
    reason: str
    remark: str | UnsetType = UNSET
    probability: Probability
    consumer_risk: Number
    producer_risk: Number
    n_draws: int
    discrepancy: bool
    reference: RunIdentity | None
    limits: Annotated[tuple[LimitVerdict, ...], Meta(min_length=1)]
    specification_sha256: str | UnsetType = UNSET


class Checksum(Struct, frozen=True, kw_only=True):
    """Of one file of a run."""

    sha256: Sha256


class Summary(Struct, frozen=True, kw_only=True):
    """``summary.json`` of a run of pbrdf_bayes.

    Attributes
    ----------
    config : mapping
        The resolved configuration, key by key.
    versions : mapping of str to str
        Version of each package that took part.
    model : str
        Name of the model: the four-parameter model and what goes beyond it.
    effects : tuple of str
        Effects added to the four-parameter model; none is the model of the 2011 paper.
    effects_choice : EffectsChoice or None
        None where the effects were given.
    findings : tuple of Finding
        Mistakes of the bench or of the file that the readings show.
    discrepancy : DiscrepancySize or None
        None where readings are taken as independent.
    holdouts : tuple of Prediction
        The recipe, each angle of incidence, one polarisation from the other.
    reciprocity : ReciprocitySize or None
        None where the model is not defined at all angles.
    timings : mapping of str to float
        Stage to seconds.
    conformity : Conformity or None
        Where limits were given.
    document : mapping of str to str
        Items of the report that the laboratory gave.
    files : mapping of str to Checksum
        Files of the run by name, as they were written.
    """

    schema_version: Literal[1] = 1
    sample: str
    wavelength_um: Positive
    created_utc: str
    status: Status
    verdict: Judged
    headline: str
    applicability: Applicability
    input: Input
    config: Mapping[str, Any]
    versions: Mapping[str, str]
    platform: str
    seed: Whole
    model: str
    effects: tuple[str, ...]
    line_shape: str
    effects_choice: EffectsChoice | None
    parameters: Mapping[str, Parameter]
    correlation: CorrelationMatrix
    diagnostics: Mapping[str, Judgement]
    findings: tuple[Finding, ...] = ()
    fit: Fit
    discrepancy: DiscrepancySize | None = None
    map: Map
    sampling: Sampling
    rejected: RejectedPoints | UnsetType = UNSET
    accuracy: Accuracy
    holdout: RecipeHoldout | None
    holdouts: tuple[Prediction, ...] = ()
    leave_one_out: LeaveOneOutSummary | UnsetType = UNSET
    scan_widths: tuple[ScanWidth, ...] = ()
    reciprocity: ReciprocitySize | None = None
    timings: Mapping[str, Number]
    conformity: Conformity | UnsetType | None = UNSET
    document: Mapping[str, DocumentItem] | UnsetType | None = UNSET
    files: Mapping[str, Checksum] | UnsetType = UNSET

    def __post_init__(self) -> None:
        missing = [name for name in PHYSICAL if name not in self.parameters]
        if missing:
            msg = f"`parameters` lack {', '.join(missing)}"
            raise ValueError(msg)

"""The verdict on the limits of a specification, as a record of the summary.

Draws of the sample and of a reference are independent, and so are then errors of calibration that
the two have in common: they would cancel in a difference, which is so stated too uncertain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.analysis import Analysis
from pbrdf_bayes.conform.conformity import (
    Judged,
    Measurand,
    Overall,
    judge_limits,
    probability_of_not,
)
from pbrdf_bayes.conform.measurands import Sample, draw_measurands, sample_of
from pbrdf_bayes.effects_table import EFFECT_PARAMETERS
from pbrdf_bayes.errors import ConfigError, DomainError
from pbrdf_bayes.model.four_parameter import DOMAIN, MAX_THETA_I_DEG, checked_angles
from pbrdf_bayes.quantities import QUANTITIES
from pbrdf_bayes.records.summary import Conformity, LimitVerdict, Rule, RunIdentity
from pbrdf_bayes.records.values import plain
from pbrdf_bayes.specification import Limit, Specification, one_of
from pbrdf_bayes.verdicts.applicability import APPLIES, DOES_NOT_APPLY
from pbrdf_bayes.words import say

Array = NDArray[np.float64]

_MOST_OF_PRIOR = 0.1
"""Share of the prior in a prediction beyond which a verdict on it would be the prior's."""
_PRIOR_DRAWS = 2000
_TINY = 1e-300
PARAMETERS = (*DOMAIN, *EFFECT_PARAMETERS)
"""What a limit on a parameter may name."""


def check_specification(specification: Specification) -> None:
    """Refuse limits on what the model does not have, or at angles where it is not defined.

    Raises
    ------
    ConfigError
        Names file, limit, key, value and what is allowed.
    """
    for limit in specification.limits:
        try:
            if limit.quantity == "parameter":
                one_of("parameter", limit.parameter, PARAMETERS)
            checked_angles("theta_i_deg", limit.theta_i_deg, 0.0, MAX_THETA_I_DEG)
            checked_angles("theta_r_deg", limit.theta_r_deg, -90.0, 90.0)
            checked_angles("phi_r_deg", [limit.phi_r_deg], -360.0, 360.0)
        except (ConfigError, DomainError) as error:
            where = f"{specification.source}: " if specification.source else ""
            msg = f"{where}limit {limit.name!r}: {error}"
            raise ConfigError(msg) from None


def assess_conformity(
    analysis: Analysis, specification: Specification, reference: Analysis | None = None
) -> dict[str, Any]:
    """Verdicts on the limits of a specification, for ``summary["conformity"]``.

    Parameters
    ----------
    analysis : Analysis
        The sample.
    specification : Specification
    reference : Analysis, optional
        The sample that differences are to.

    Returns
    -------
    dict
        Plain values of `pbrdf_bayes.records.summary.Conformity`.

    Raises
    ------
    ConfigError
        See `check_specification`; differences without a reference, a reference without
        differences, or the same run twice.
    """
    check_specification(specification)
    _check_reference(analysis, specification, reference)
    sample = sample_of(analysis, n_points=specification.n_points)
    values = draw_measurands(sample, specification.limits)
    ess, finest = sample.ess_least, sample.ess_finest(specification.n_points)
    of_reference: dict[str, Array] = {}
    other = None
    if reference is not None:
        other = sample_of(reference, n_points=specification.n_points)
        ess = min(ess, other.ess_least)
        finest = min(finest, other.ess_finest(specification.n_points))
        of_reference = _shuffled(other, specification, len(sample.x))
    measurands = []
    own = _reservations(specification.limits, sample)
    of_other = _reservations(specification.limits, other) if other is not None else {}
    for limit in specification.limits:
        found, reserved = values[limit.name], own[limit.name]
        if limit.difference and other is not None:
            found = _difference(limit, found, of_reference[limit.name])
            reserved = reserved or _of_reference(of_other[limit.name])
        cube = found.reshape(*sample.shape, -1)
        measurands.append(Measurand(cube, limit.lower, limit.upper, limit.guard, reserved))
    judged, overall = judge_limits(
        measurands, specification.decision, ess_least=ess, ess_finest=finest
    )
    record = _record(sample, specification, judged, overall, reference)
    content: dict[str, Any] = plain(record)
    return content


def check_reference_wanted(specification: Specification | None, *, given: bool) -> None:
    """Refuse differences without a reference, and a reference without differences.

    Raises
    ------
    ConfigError
    """
    needed = specification is not None and specification.needs_reference
    if needed and not given:
        msg = "the limits have a [[difference]]: give the run folder of the other with --reference"
        raise ConfigError(msg)
    if given and not needed:
        msg = (
            "--reference without any [[difference]] in the limits: add one, e.g. "
            '[[difference]] name = "n", parameter = "n", tolerance = 0.02'
        )
        raise ConfigError(msg)


def check_wavelength(wavelength_um: float, of_reference_um: float) -> None:
    """Refuse a reference of another wavelength [um].

    Raises
    ------
    ConfigError
    """
    if wavelength_um != of_reference_um:
        msg = (
            f"--reference was measured at {of_reference_um:g} um, the sample at "
            f"{wavelength_um:g} um. Give a reference of the same wavelength"
        )
        raise ConfigError(msg)


def _check_reference(
    analysis: Analysis, specification: Specification, reference: Analysis | None
) -> None:
    check_reference_wanted(specification, given=reference is not None)
    if reference is not None:
        same = all(
            analysis.summary[key] == reference.summary[key]
            for key in ("input", "seed", "created_utc")
        )
        if same:
            msg = "--reference is the run itself; its draws are not independent. Give another run"
            raise ConfigError(msg)
        check_wavelength(*(a.summary["wavelength_um"] for a in (analysis, reference)))


def _shuffled(other: Sample, specification: Specification, n: int) -> dict[str, Array]:
    """Measurands of the reference, its draws in random order beside those of the sample."""
    wanted = [limit for limit in specification.limits if limit.difference]
    values = draw_measurands(other, wanted)
    rng = np.random.default_rng([int(other.analysis.summary["seed"]), 9])
    order = np.concatenate([rng.permutation(len(other.x)) for _ in range(-(-n // len(other.x)))])
    return {name: found[order[:n]] for name, found in values.items()}


def _difference(limit: Limit, sample: Array, reference: Array) -> Array:
    if limit.quantity == "parameter":
        return sample - reference
    return np.asarray(np.log10(sample) - np.log10(reference))


def _reservations(limits: Sequence[Limit], sample: Sample) -> dict[str, str]:
    """Why no verdict may be given on each limit; empty where one may."""
    unclear = [
        name for name, row in sample.analysis.summary["parameters"].items()
        if row["kind"] == "physical" and not row["identified"]
    ]  # fmt: skip
    predicted = [limit for limit in limits if limit.quantity != "parameter"]
    shares = prior_shares(sample, predicted) if unclear and predicted else {}
    words = say("conform.not_identified", name=", ".join(unclear))
    return {
        limit.name: _reservation(limit, sample)
        or (words if shares.get(limit.name, 0.0) > _MOST_OF_PRIOR else "")
        for limit in limits
    }


def prior_shares(sample: Sample, limits: Sequence[Limit]) -> dict[str, float]:
    """Share that the prior has in what is known of each prediction, at its worst point.

    var(ln Y | readings) / var(ln Y) for Y of the model alone: for normal laws the precision of the
    prior over that of the posterior, hence the weight of the prior's mean in the posterior's.

    Parameters
    ----------
    sample : Sample
    limits : sequence of Limit
        None of them on a parameter.
    """
    rng = np.random.default_rng([int(sample.analysis.summary["seed"]), 10])
    before = replace(sample, x=sample.posterior.sample_prior(rng, _PRIOR_DRAWS))
    found = [draw_measurands(s, limits, with_paths=False) for s in (sample, before)]
    after, ahead = ({name: _log_variance(y) for name, y in values.items()} for values in found)
    return {name: float(np.max(v / np.maximum(ahead[name], _TINY))) for name, v in after.items()}


def _log_variance(values: Array) -> Array:
    return np.asarray(np.var(np.log(np.maximum(values, _TINY)), axis=0))


def _reservation(limit: Limit, sample: Sample) -> str:
    """The same from what the summary of the run says."""
    summary = sample.analysis.summary
    applicability = summary["applicability"]["verdict"]
    if summary["status"] != "done":
        return say("conform.not_converged")
    if applicability == DOES_NOT_APPLY:
        return say("conform.does_not_apply")
    if limit.quantity == "parameter":
        row = summary["parameters"].get(limit.parameter)
        if row is None:
            return say("conform.no_parameter", name=limit.parameter)
        if row["kind"] == "fixed":
            return say("conform.fixed", name=limit.parameter)
        if not row["identified"]:
            return say("conform.not_identified", name=limit.parameter)
    if applicability != APPLIES:
        if limit.quantity == "parameter":
            return say("conform.no_properties")
        if QUANTITIES[limit.quantity].hemispherical or sample.posterior.discrepancy is None:
            return say("conform.misfit_unknown")
    return "" if summary["verdict"] != "FAIL" else say("conform.failed")


def _of_reference(reason: str) -> str:
    return say("conform.reference", reason=reason) if reason else ""


def _record(
    sample: Sample, specification: Specification, judged: tuple[Judged, ...], overall: Overall,
    reference: Analysis | None,
) -> Conformity:  # fmt: skip
    rows = zip(specification.limits, judged, strict=True)
    with_paths = "tau" in sample.posterior.parameter_names
    return Conformity(
        specification=specification.title,
        decision_rule=Rule(**asdict(specification.decision)),
        verdict=overall.verdict,
        reason=overall.reason,
        remark=overall.remark,
        probability=overall.probability,
        consumer_risk=overall.consumer_risk,
        producer_risk=overall.producer_risk,
        n_draws=len(sample.x),
        discrepancy=with_paths,
        reference=None if reference is None else _identify(reference.summary),
        limits=tuple(_limit_record(limit, found) for limit, found in rows),
    )  # fmt: skip


def _identify(summary: Mapping[str, Any]) -> RunIdentity:
    keys = ("sample", "verdict", "created_utc")
    return RunIdentity(sha256=summary["input"]["sha256"], **{key: summary[key] for key in keys})


def _limit_record(limit: Limit, found: Judged) -> LimitVerdict:
    exceeds = probability_of_not(found.probability)
    theta_i = np.repeat(limit.theta_i_deg, max(len(limit.theta_r_deg), 1)).tolist()
    theta_r = np.tile(limit.theta_r_deg, max(len(limit.theta_i_deg), 1)).tolist()
    return LimitVerdict(
        name=limit.name,
        quantity=limit.quantity,
        parameter=limit.parameter,
        polarization=limit.polarization,
        phi_r_deg=limit.phi_r_deg,
        difference=limit.difference,
        unit=limit.unit,
        lower=limit.lower,
        upper=limit.upper,
        verdict=found.verdict,
        reason=found.reason,
        remark=found.remark,
        judged=found.judged,
        probability=found.probability,
        probability_exceeds=exceeds if limit.difference else None,
        consumer_risk=found.consumer_risk,
        producer_risk=found.producer_risk,
        worst=found.worst,
        theta_i_deg=theta_i,
        theta_r_deg=theta_r if limit.theta_r_deg else [],
        mean=found.mean.tolist(),
        u=found.sd.tolist(),
        q025=found.low.tolist(),
        q975=found.high.tolist(),
        inside=found.inside.tolist(),
        guard=found.guard.tolist(),
    )

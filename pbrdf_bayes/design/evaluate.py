"""Every candidate put to the same draws: its expected information gain and what it sharpens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.design.beliefs import Beliefs, DrawnSets, Nuisance, draw_nuisance, draw_sets
from pbrdf_bayes.design.candidates import Candidate
from pbrdf_bayes.design.fisher import (
    Told,
    hemispherical_told,
    linear_gain,
    moved_sets,
    scan_precisions,
)
from pbrdf_bayes.design.hemispherical import (
    GainLaw,
    draw_hemispherical,
    gain_law,
    hemispherical_log_likelihoods,
    hemispherical_values,
)
from pbrdf_bayes.design.nested import (
    Gain,
    PairTable,
    Spread,
    expected_gain,
    expected_spread,
)
from pbrdf_bayes.design.scans import (
    PlannedScan,
    RowLaw,
    draw_scans,
    law_of_rows,
    plan_scan,
    scan_geometry,
    scan_log_likelihoods,
)
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.quantities import POLARIZATIONS
from pbrdf_bayes.readings.observation import reading_law

Array = NDArray[np.float64]

N_LINEAR, FEWEST_LINEAR = 48, 12
"""Draws of tier 0 and of the local normal law, and of these where there are many candidates."""
_NUISANCE_OF_PRIOR = 64
"""Noises that only have a prior span decades: some draws must be like the one that was true."""
_STREAMS = {"outer": 30, "nuisance": 31, "hemispherical": 32}


@dataclass(frozen=True, eq=False)
class Stage:
    """The draws that all candidates are put to.

    Attributes
    ----------
    beliefs : Beliefs
    outer, inner : DrawnSets
        Sets that readings are simulated from, and others that they are compared with.
    inner_weights : ndarray, shape (n_inner,), or None
        How often the inner sets were drawn, normalised; None where none was drawn twice.
    nuisance : Nuisance or None
        Other nuisance for every outer set; None where nothing is nuisance.
    linear : DrawnSets
        Some of the sets, for tier 0.
    moved : ndarray
        `moved_sets` of these.
    steps : ndarray, shape (n_model,)
    seed : int
    """

    beliefs: Beliefs
    outer: DrawnSets
    inner: DrawnSets
    inner_weights: Array | None
    nuisance: Nuisance | None
    linear: DrawnSets
    moved: Array
    steps: Array
    seed: int

    @cached_property
    def gains(self) -> dict[str, tuple[GainLaw, GainLaw, GainLaw | None]]:
        """What is known of the DHR gain of a polarisation: outer, inner and nuisance sets."""
        nuisance = self.nuisance
        return {
            q: (
                gain_law(self.beliefs, q, self.outer), gain_law(self.beliefs, q, self.inner),
                None if nuisance is None else gain_law(self.beliefs, q, nuisance.sets),
            )
            for q in POLARIZATIONS
        }  # fmt: skip

    @property
    def mean_needs_nuisance(self) -> bool:
        """Whether the model depends on a parameter that is nuisance here."""
        names = {self.beliefs.free_names[i] for i in self.beliefs.posterior.of_model}
        return not names <= set(self.beliefs.about)


def set_stage(
    beliefs: Beliefs, *, n_outer: int, n_inner: int, n_nuisance: int, seed: int,
    n_linear: int = N_LINEAR,
) -> Stage:  # fmt: skip
    """Draw the sets that all candidates are put to.

    Importance sampling and rejected steps give the same draw several times. A draw compared with
    itself would look like knowledge: the outer and the inner sets have none in common, and the
    inner ones carry the number of times they were drawn as their weights.

    Raises
    ------
    ConfigError
        When there are fewer than a quarter of n_outer + n_inner distinct draws.
    """
    distinct, counts = np.unique(beliefs.x, axis=0, return_counts=True)
    wanted, there = n_outer + n_inner, len(distinct)
    if 4 * there < wanted:
        msg = (
            f"the run has {there} distinct draws, and the design asks for {wanted}: fit again with "
            "a higher --accuracy"
        )
        raise ConfigError(msg)
    n_pool = min(n_outer, there * n_outer // wanted)
    rng = np.random.default_rng([seed, _STREAMS["outer"]])
    order = rng.permutation(there)[: min(wanted, there)]
    pool, other = order[:n_pool], order[n_pool:]
    if (counts[pool] > 1).any() or n_pool < n_outer:
        pool = rng.choice(pool, n_outer, p=counts[pool] / counts[pool].sum())
    inner_weights = None
    if (counts[other] > 1).any():
        inner_weights = counts[other] / counts[other].sum()
    rng = np.random.default_rng([seed, _STREAMS["nuisance"]])
    outer = draw_sets(beliefs, np.ascontiguousarray(distinct[pool]), rng)
    inner = draw_sets(beliefs, np.ascontiguousarray(distinct[other]), rng)
    linear = outer.take(slice(0, n_linear))
    moved, steps = moved_sets(beliefs, linear.x)
    n = max(n_nuisance, _NUISANCE_OF_PRIOR) if beliefs.scans_of_prior else n_nuisance
    nuisance = draw_nuisance(beliefs, outer.x, n, rng)
    return Stage(beliefs, outer, inner, inner_weights, nuisance, linear, moved, steps, seed)


@dataclass(frozen=True, eq=False)
class Hemispherical:
    """A simulated DHR or DDR reading, and the model there under all sets."""

    polarization: str
    y: Array
    own: Array
    inner: Array
    nuisance: Array | None


@dataclass(frozen=True, eq=False)
class Evaluated:
    """A candidate and what is expected of it.

    Attributes
    ----------
    candidate : Candidate
    gain : Gain
        Tier 1: nested Monte Carlo; tier 2 or the local normal law where that fails.
    spread : Spread
        Variance after over before, of parameters and goals.
    table : PairTable or None
        Kept for batches.
    reading : Hemispherical or None
        Of a DHR or DDR, kept for batches.
    told : Told or None
        For the local normal law.
    local_nats : float or None
        Gain by the local normal law, where that was computed [nat].
    local_spread : bool
        Whether ``spread`` is of that law.
    """

    candidate: Candidate
    gain: Gain
    spread: Spread
    table: PairTable | None = None
    reading: Hemispherical | None = None
    told: Told | None = None
    local_nats: float | None = None
    local_spread: bool = False


def bright_readings(stage: Stage, candidate: Candidate) -> NDArray[np.bool_]:
    """Readings of a scan expected above the instrument's floor."""
    angles = np.array(candidate.theta_r_deg)
    floor = stage.beliefs.posterior.config.brdf_floor
    if floor == 0.0:
        return np.ones(angles.size, dtype=bool)
    there = scan_geometry(candidate.theta_i_deg, angles, candidate.polarization)
    brdf = stage.beliefs.posterior.predict(stage.linear.x, there)[0]
    return np.asarray(reading_law(np.median(brdf, axis=0), floor).share > 0.5)


def told_by(stage: Stage, candidate: Candidate) -> Told:
    """What a candidate tells at each of the draws of tier 0."""
    b = stage.beliefs
    if candidate.quantity != "brdf":
        return hemispherical_told(b, candidate, stage.linear, stage.moved, stage.steps)
    bright = bright_readings(stage, candidate)
    if not bright.any():
        return Told(np.zeros((len(stage.linear), stage.steps.size, stage.steps.size)))
    planned = plan_scan(b, candidate, bright)
    predict = b.posterior.predict
    return Told(scan_precisions(
        b, planned, stage.linear, predict(stage.linear.x, planned.geometry)[0],
        predict(stage.moved, planned.geometry)[0], stage.steps,
    ))  # fmt: skip


def linear_gains(stage: Stage, told: Told) -> Array:
    """Tier 0 of a candidate at each of the draws, shape (n_linear,) [nat]."""
    p = stage.beliefs.posterior
    precision = np.zeros((len(told.precision), len(p.free), len(p.free)))
    precision[:, p.of_model[:, None], p.of_model] = told.precision
    return linear_gain(stage.beliefs.covariance, precision, stage.beliefs.columns_about)


def evaluate(
    stage: Stage, candidate: Candidate, own: Array, inner: Array, *, keep: bool
) -> Evaluated:
    """Tier 1 of a candidate.

    Parameters
    ----------
    stage : Stage
    candidate : Candidate
    own, inner : ndarray, shapes (n_outer, n_quantities) and (n_inner, n_quantities)
        Parameters and goals at the draws.
    keep : bool
        Keep the tables, for batches.

    Returns
    -------
    Evaluated
    """
    reading = None
    if candidate.quantity == "brdf":
        table = _scan_table(stage, candidate)
    else:
        reading = read_hemispherical(stage, candidate)
        table = hemispherical_table(stage, [reading])
    gain = expected_gain(table, keep_weights=True)
    assert gain.weights is not None
    spread = expected_spread(gain.weights, own, inner, stage.inner_weights)
    kept = replace(table, inner=table.inner.astype(np.float32)) if keep else None
    gain = replace(gain, weights=None)
    return Evaluated(candidate, gain, spread, kept, reading if keep else None)


def _scan_table(stage: Stage, candidate: Candidate) -> PairTable:
    b = stage.beliefs
    bright = bright_readings(stage, candidate)
    if not bright.any():
        return _empty_table(stage)
    planned = plan_scan(b, candidate, bright)
    own = _law(stage, planned, stage.outer)
    y = draw_scans(b, planned, own, seed=stage.seed)
    nuisance = None
    if stage.nuisance is not None:
        law = _nuisance_law(stage, planned, own)
        nuisance = scan_log_likelihoods(b, planned, y, law, matched=True)
    return PairTable(
        own=scan_log_likelihoods(b, planned, y, own, matched=True)[:, 0],
        inner=scan_log_likelihoods(b, planned, y, _law(stage, planned, stage.inner), matched=False),
        nuisance=nuisance,
        log_weights=None if stage.nuisance is None else stage.nuisance.log_weights,
        inner_weights=stage.inner_weights,
    )


def _law(stage: Stage, planned: PlannedScan, sets: DrawnSets) -> RowLaw:
    brdf, _ = stage.beliefs.posterior.predict(sets.x, planned.geometry)
    return law_of_rows(stage.beliefs, planned, sets, brdf)


def _nuisance_law(stage: Stage, planned: PlannedScan, own: RowLaw) -> RowLaw:
    """Law under the sets with other nuisance; the model is computed anew only where it must be."""
    assert stage.nuisance is not None
    sets = stage.nuisance.sets
    if stage.mean_needs_nuisance:
        return _law(stage, planned, sets)
    return own.with_noise_of(sets, planned.polarization)


def read_hemispherical(stage: Stage, candidate: Candidate, *, again: int = 0) -> Hemispherical:
    """Simulate a DHR or DDR reading for every outer set; one taken again has noise of its own."""
    b, q = stage.beliefs, candidate.polarization
    own = hemispherical_values(b.posterior, candidate, stage.outer.x)
    seed = (stage.seed, _STREAMS["hemispherical"], POLARIZATIONS.index(q))
    nuisance = None
    if stage.nuisance is not None:
        sets = stage.nuisance.sets
        nuisance = np.repeat(own, len(sets) // len(own))
        if stage.mean_needs_nuisance:
            nuisance = hemispherical_values(b.posterior, candidate, sets.x)
    return Hemispherical(
        polarization=q,
        y=draw_hemispherical(
            own,
            stage.gains[q][0],
            stage.outer,
            seed=seed,
            key=(*candidate.geometry, *([again] if again else [])),
        ),
        own=own,
        inner=hemispherical_values(b.posterior, candidate, stage.inner.x),
        nuisance=nuisance,
    )


def hemispherical_table(stage: Stage, readings: Sequence[Hemispherical]) -> PairTable:
    """Log-densities of readings of one polarisation together: they share a gain."""
    outer, inner, beside = stage.gains[readings[0].polarization]
    y = [r.y for r in readings]
    nuisance, log_weights = None, None
    if stage.nuisance is not None and beside is not None:
        values = [r.nuisance for r in readings if r.nuisance is not None]
        nuisance = hemispherical_log_likelihoods(
            y, values, beside, stage.nuisance.sets, matched=True
        )
        log_weights = stage.nuisance.log_weights
    own = hemispherical_log_likelihoods(
        y, [r.own for r in readings], outer, stage.outer, matched=True
    )
    others = hemispherical_log_likelihoods(
        y, [r.inner for r in readings], inner, stage.inner, matched=False
    )
    return PairTable(own[:, 0], others, nuisance, log_weights, stage.inner_weights)


def _empty_table(stage: Stage) -> PairTable:
    """Of a measurement without a reading that counts."""
    n, m = len(stage.outer), len(stage.inner)
    if stage.nuisance is None:
        return PairTable(np.zeros(n), np.zeros((n, m)))
    log_weights = stage.nuisance.log_weights
    return PairTable(np.zeros(n), np.zeros((n, m)), np.zeros(log_weights.shape), log_weights)

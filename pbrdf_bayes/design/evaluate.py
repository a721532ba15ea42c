"""The refining estimate: every candidate put to the same draws, its gain and what it sharpens."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.design.beliefs import Beliefs, DrawnSets, Nuisance, draw_nuisance, draw_sets
from pbrdf_bayes.design.candidates import Candidate
from pbrdf_bayes.design.hemispherical import (
    GainLaw,
    draw_hemispherical,
    gain_law,
    hemispherical_log_likelihoods,
    hemispherical_values,
)
from pbrdf_bayes.design.linear import (
    Paints,
    Told,
    bright_readings,
    paints_of,
    told_by_hemisphere,
    told_by_scan,
)
from pbrdf_bayes.design.nested import Gain, PairTable, Spread, expected_gain, expected_spread
from pbrdf_bayes.design.scans import (
    PlannedScan,
    RowLaw,
    draw_scans,
    law_of_rows,
    plan_scan,
    scan_log_likelihoods,
)
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.quantities import POLARIZATIONS

Array = NDArray[np.float64]

N_LINEAR, FEWEST_LINEAR = 48, 12
"""Draws of the linear law, and of it where there are many candidates."""
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
    paints : Paints
        The first outer sets, for the linear law.
    seed : int
    """

    beliefs: Beliefs
    outer: DrawnSets
    inner: DrawnSets
    inner_weights: Array | None
    nuisance: Nuisance | None
    paints: Paints
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
    n = max(n_nuisance, _NUISANCE_OF_PRIOR) if beliefs.scans_of_prior else n_nuisance
    return Stage(
        beliefs, outer, inner, inner_weights, draw_nuisance(beliefs, outer.x, n, rng),
        paints_of(beliefs, outer.take(slice(0, n_linear))), seed,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Evaluated:
    """A candidate and what is expected of it.

    Attributes
    ----------
    candidate : Candidate
    gain : Gain
        By nested Monte Carlo; by the linear law where next to no draws are left.
    spread : Spread
        Variance after over before, of parameters and goals.
    told : Told
        For the linear law.
    local_nats : float or None
        Gain by the linear law, where the bracket of the nested estimate is wide [nat].
    local_spread : bool
        Whether ``spread`` is of that law.
    """

    candidate: Candidate
    gain: Gain
    spread: Spread
    told: Told
    local_nats: float | None = None
    local_spread: bool = False


def nested_estimate(
    stage: Stage, candidate: Candidate, own: Array, inner: Array
) -> tuple[Gain, Spread]:
    """Gain of a candidate by nested Monte Carlo, and what it leaves of the variances.

    Parameters
    ----------
    stage : Stage
    candidate : Candidate
    own, inner : ndarray, shapes (n_outer, n_quantities) and (n_inner, n_quantities)
        Parameters and goals at the draws.

    Returns
    -------
    tuple of Gain and Spread
    """
    gain, weights = expected_gain(LAWS[candidate.quantity].table(stage, candidate))
    return gain, expected_spread(weights, own, inner, stage.inner_weights)


def _scan_table(stage: Stage, candidate: Candidate) -> PairTable:
    b = stage.beliefs
    bright = bright_readings(stage.paints, candidate)
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


def draw_reading(stage: Stage, candidate: Candidate, own: Array) -> Array:
    """A simulated DHR or DDR reading for every outer set, of which the model gives ``own``."""
    q = candidate.polarization
    seed = (stage.seed, _STREAMS["hemispherical"], POLARIZATIONS.index(q))
    return draw_hemispherical(
        own, stage.gains[q][0], stage.outer, seed=seed, key=candidate.geometry
    )


def _hemispherical_table(stage: Stage, candidate: Candidate) -> PairTable:
    p = stage.beliefs.posterior
    outer, inner, beside = stage.gains[candidate.polarization]
    own = hemispherical_values(p, candidate, stage.outer.x)
    y = draw_reading(stage, candidate, own)
    nuisance, log_weights = None, None
    if stage.nuisance is not None and beside is not None:
        sets, log_weights = stage.nuisance.sets, stage.nuisance.log_weights
        value = np.repeat(own, len(sets) // len(own))
        if stage.mean_needs_nuisance:
            value = hemispherical_values(p, candidate, sets.x)
        nuisance = hemispherical_log_likelihoods([y], [value], beside, sets, matched=True)
    there = hemispherical_values(p, candidate, stage.inner.x)
    return PairTable(
        own=hemispherical_log_likelihoods([y], [own], outer, stage.outer, matched=True)[:, 0],
        inner=hemispherical_log_likelihoods([y], [there], inner, stage.inner, matched=False),
        nuisance=nuisance, log_weights=log_weights, inner_weights=stage.inner_weights,
    )  # fmt: skip


def _empty_table(stage: Stage) -> PairTable:
    """Of a measurement without a reading that counts."""
    n, m = len(stage.outer), len(stage.inner)
    if stage.nuisance is None:
        return PairTable(np.zeros(n), np.zeros((n, m)))
    log_weights = stage.nuisance.log_weights
    return PairTable(np.zeros(n), np.zeros((n, m)), np.zeros(log_weights.shape), log_weights)


@dataclass(frozen=True)
class KindLaw:
    """How both estimates see the candidates of one quantity.

    Attributes
    ----------
    told : callable
        What one tells at each of the paints, linearised.
    table : callable
        Log-densities of its simulated readings.
    """

    told: Callable[[Paints, Candidate], Told]
    table: Callable[[Stage, Candidate], PairTable]


LAWS = {
    "brdf": KindLaw(told_by_scan, _scan_table),
    "dhr": KindLaw(told_by_hemisphere, _hemispherical_table),
    "ddr": KindLaw(told_by_hemisphere, _hemispherical_table),
}
"""By the quantity of a candidate: the planned ones of `pbrdf_bayes.quantities`."""


def told_by(stage: Stage, candidate: Candidate) -> Told:
    """What a candidate tells at each of the paints."""
    return LAWS[candidate.quantity].told(stage.paints, candidate)

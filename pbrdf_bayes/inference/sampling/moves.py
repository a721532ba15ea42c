"""Moves of the walkers: those that explore, and those of the walk that is kept."""

from __future__ import annotations

import emcee
import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.sampling.ensembles import Moves
from pbrdf_bayes.inference.sampling.importance import ImportanceDraws
from pbrdf_bayes.inference.sampling.mixture import Mixture

Array = NDArray[np.float64]

_INDEPENDENCE_K_HAT = 1.0
_INDEPENDENCE_ESS = 0.1


def independence_move(mixture: Mixture) -> object:
    """Metropolis-Hastings with proposals from a fixed mixture, whatever the walkers do."""

    def propose(z: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        rng = np.random.default_rng(random.randint(0, 2**31 - 1, size=4))
        new = mixture.sample(rng, len(z))
        return new, mixture.log_density(z) - mixture.log_density(new)

    return emcee.moves.MHMove(propose)


def choose_moves(mixture: Mixture, quick: ImportanceDraws) -> tuple[Moves, str]:
    """Moves and their shares: more of the mixture the better it covers the posterior."""
    # not emcee's snooker: its acceptance does not leave the target invariant
    if covers(quick):
        return (
            [(independence_move(mixture), 0.7), (emcee.moves.DEMove(), 0.3)],
            "0.70 independence from an adapted t mixture, 0.30 differential evolution",
        )
    return (
        [(independence_move(mixture), 0.5), (emcee.moves.DEMove(), 0.5)],
        "0.50 independence from an adapted t mixture, 0.50 differential evolution",
    )


def covers(quick: ImportanceDraws) -> bool:
    """The mixture is a good proposal: light tails of the weights and many effective draws."""
    return quick.k_hat < _INDEPENDENCE_K_HAT and quick.ess > _INDEPENDENCE_ESS * quick.n_evaluations

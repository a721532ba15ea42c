"""Where a measurement tells much: the local normal law at each simulated paint.

There next to none of the draws explains a simulated reading, and sums over draws say nothing of
what is left. But what is left is narrow, and within it the model is as good as linear:

    C_o = ( P_o + J_o' R_o^-1 J_o )^-1,

P_o what the prior and the readings so far tell at the paint o, J_o the slopes of the candidate's
readings there and R_o their covariance with noise, discrepancy and gain. For normal readings what
they tell of the mean and of the noise is independent: the block of interest of C_o has the nuisance
marginalised. The expected information is

    E_o [ -ln p(theta_o) - 1/2 ln det 2 pi e C_tt,o ],

with the density p before the measurement, which need not be normal; of two candidates, or of a
batch and one member more, only the determinants differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.design.beliefs import log_marginal
from pbrdf_bayes.design.evaluate import Stage
from pbrdf_bayes.design.fisher import Told, precision_so_far, slopes_of, told_together
from pbrdf_bayes.design.goals import Goal, values_of
from pbrdf_bayes.design.nested import LOCAL, Gain, Spread
from pbrdf_bayes.design.refine import log_norm

Array = NDArray[np.float64]

_N_NUISANCE = 64
_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class LocalLaw:
    """What is known at each of some simulated paints, as a normal law there.

    Attributes
    ----------
    before : ndarray, shape (n_paints, n_model, n_model)
        Precision of the coordinates of the model.
    about : ndarray of int
        Columns of these that the information is about.
    rest : float
        Entropy of what else it is about and no mean tells: noises, as known as before [nat].
    """

    before: Array
    about: NDArray[np.int64]
    rest: float = 0.0

    def covariance(self, told: Sequence[Told]) -> Array:
        """After measurements taken together, shape (n_paints, n_model, n_model)."""
        return np.asarray(np.linalg.inv(self.before + told_together(told)))

    def entropy(self, told: Sequence[Told]) -> Array:
        """Of what the information is about, after them, shape (n_paints,) [nat]."""
        inside = self.covariance(told)[:, self.about[:, None], self.about]
        return np.asarray(self.rest + _entropy(inside))


def local_law(stage: Stage) -> LocalLaw:
    """The law at the draws of tier 0, before the measurement."""
    b, p = stage.beliefs, stage.beliefs.posterior
    before = precision_so_far(b, stage.linear, stage.moved, stage.steps)
    of_model = p.of_model.tolist()
    inside = [of_model.index(c) for c in b.columns_about.tolist() if c in of_model]
    beside = np.setdiff1d(b.columns_about, p.of_model)
    rest = _entropy(b.covariance[np.ix_(beside, beside)]) if beside.size else 0.0
    return LocalLaw(before, np.array(inside, dtype=np.int64), float(rest))


def _entropy(covariance: Array) -> Array:
    n = covariance.shape[-1]
    return np.asarray(0.5 * (np.linalg.slogdet(covariance)[1] + n * np.log(2.0 * np.pi * np.e)))


def surprise(stage: Stage) -> Array:
    """-ln p(theta_o) of each paint before the measurement, shape (n_paints,) [nat]."""
    b = stage.beliefs
    rng = np.random.default_rng([stage.seed, 70])
    z = b.posterior.to_coordinates(stage.inner.x)
    level = 0.0
    if b.measured:

        def density(z: Array) -> Array:
            return b.log_density(b.posterior.from_coordinates(z))

        level = float(np.mean([log_norm(density, z, rng) for _ in range(_ROUNDS)]))
    return np.asarray(level - log_marginal(b, stage.linear.x, _N_NUISANCE, rng))


def local_gain(terms: Array, within: Gain, *, alone: float = 0.0) -> Gain:
    """Gain by the local normal law, `surprise` less entropy, within the bracket of simulations.

    ``alone`` is the standard error of a correction that the terms carry.
    """
    eig = float(np.clip(terms.mean(), within.low, max(within.low, within.high)))
    return Gain(
        eig=eig, se=float(np.hypot(terms.std(ddof=1) / np.sqrt(terms.size), alone)),
        low=within.low, high=within.high, ess=within.ess, terms=terms - terms.mean() + eig,
        method=LOCAL, alone=alone,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Slopes:
    """How quantities change with the coordinates of the model at each paint.

    Attributes
    ----------
    slopes : ndarray, shape (n_paints, n_quantities, n_model)
    variance : ndarray, shape (n_quantities,)
        Of the draws, before the measurement.
    """

    slopes: Array
    variance: Array


def slopes_of_quantities(stage: Stage, goals: Sequence[Goal], variance: Array) -> Slopes:
    """Parameters and goals, see `pbrdf_bayes.design.goals.values_of`."""
    values, _ = values_of(stage.beliefs, goals, stage.moved)
    return Slopes(slopes_of(values, stage.steps), variance)


def local_spread(law: LocalLaw, told: Told, slopes: Slopes, n_inner: int) -> Spread:
    """Variance of quantities after the measurement over that before it.

    What no mean tells, such as a noise, stays as it is. Where a slope would have more variance than
    the draws, as that of ln f at a Brewster null, what is left is that of the draws.
    """
    g = slopes.slopes
    after = np.einsum("npi,nij,npj->np", g, law.covariance([told]), g)
    known = slopes.variance > 0.0
    terms = np.minimum(after / np.where(known, slopes.variance, 1.0), 1.0)
    terms[:, ~known | ~np.any(g != 0.0, axis=(0, 2))] = 1.0
    return Spread(terms, np.zeros((n_inner, terms.shape[1])))

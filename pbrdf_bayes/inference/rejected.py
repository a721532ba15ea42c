"""Points at which the model gave no finite density: rejected, counted, some of them kept."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.inference.posterior import Posterior

Array = NDArray[np.float64]

MOST_EXAMPLES = 5


@dataclass(frozen=True, eq=False)
class Rejected:
    """Points inside the support of the prior without a finite posterior density.

    Attributes
    ----------
    n : int
    examples : ndarray, shape (n_examples, n_par)
        The first of them, at most `MOST_EXAMPLES`, in physical units.
    """

    n: int = 0
    examples: Array = field(default_factory=lambda: np.empty((0, 0)))


def rejected_among(posterior: Posterior, x: Array, log_prob: Array) -> Rejected:
    """Those of the points ``x``, shape (n_sets, n_par), that the model and not the prior rejects.

    Parameters
    ----------
    posterior : Posterior
    x : ndarray, shape (n_sets, n_par)
        Parameters in physical units.
    log_prob : ndarray, shape (n_sets,)
        Log-density there, as `Posterior.log_prob` gives it: -inf for what is rejected.
    """
    suspect = x[~np.isfinite(log_prob)]
    if not len(suspect):
        return Rejected()
    found = suspect[np.isfinite(posterior.log_prior(suspect))]
    return Rejected(len(found), found[:MOST_EXAMPLES])


def together(*parts: Rejected) -> Rejected:
    """The counts added, the earliest examples kept.

    Examples
    --------
    >>> one = Rejected(7, np.array([[1.5, 0.2]]))
    >>> both = together(Rejected(), one, one)
    >>> both.n, both.examples.shape
    (14, (2, 2))
    """
    examples = [part.examples for part in parts if part.n]
    if not examples:
        return Rejected()
    return Rejected(sum(part.n for part in parts), np.concatenate(examples)[:MOST_EXAMPLES])

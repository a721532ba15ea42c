"""Choices that cannot lead to a fit are refused before anything is computed or written.

Priors that contradict each other, and effects of the instrument that no reading could tell.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.effects_table import (
    BRDF_SCANS,
    DHR_READINGS,
    DIFFUSE,
    EFFECTS,
    P_SCANS,
    S_SCANS,
)
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.inference.posterior import Posterior

Array = NDArray[np.float64]

_SIZES = (256, 16_384)
"""Samples of the prior that are looked at: more only where the first are all impossible."""


def possible_samples(posterior: Posterior) -> Array:
    """Samples of the prior that reflect no more than they receive.

    Parameters
    ----------
    posterior : Posterior

    Returns
    -------
    ndarray, shape (n_sets, n_par)
        Always the same ones; none where the priors leave next to nothing.
    """
    rng = np.random.default_rng(0)
    found = np.empty((0, posterior.n_par))
    for size in _SIZES:
        x = posterior.prior_quantile(rng.random((size, posterior.n_par)))
        found = x[np.isfinite(posterior.log_prior(x))]
        if len(found):
            break
    return found


def refuse_impossible_priors(posterior: Posterior) -> None:
    """Refuse priors under which there is no sample, or none that reflects anything.

    Parameters
    ----------
    posterior : Posterior

    Raises
    ------
    ConfigError
        Naming the priors that contradict each other, and what to do.
    """
    fixed = {s.name: s.prior.mean for s in posterior.specs if s.is_fixed}
    if fixed.get("n") == 1.0 and fixed.get("k") == 0.0:
        msg = (
            f"{_words(posterior, ('n', 'k'))}: that is no surface, nothing is reflected. "
            "Leave one of them free, or fix n above 1 or k above 0"
        )
        raise ConfigError(msg)
    strengths = tuple(name for name in DIFFUSE if fixed.get(name, 1.0) > 0.0)
    if fixed.get("sigma_n0") == 0.0 and not set(strengths) & set(posterior.parameter_names):
        msg = (
            f"{_words(posterior, ('sigma_n0',))}: such a sample reflects nothing. "
            "Leave it free, fix it above 0, or add diffuse scatter (effects)"
        )
        raise ConfigError(msg)
    if posterior.scene is not None and not len(possible_samples(posterior)):
        msg = (
            f"{_words(posterior, ('sigma_n0', *DIFFUSE))}: of {_SIZES[-1]} samples of these priors "
            "each would reflect more than it receives. Lower one of them, or leave it free"
        )
        raise ConfigError(msg)


def refuse_untold_instrument(posterior: Posterior) -> None:
    """Refuse free effects of the instrument that these readings say nothing about.

    Parameters
    ----------
    posterior : Posterior
        Of all readings.

    Raises
    ------
    ConfigError
        Naming the effect and the readings that are missing.
    """
    measurement = posterior.measurement
    present = {f"{scan.polarization} scans" for scan in measurement.scans}
    present |= {BRDF_SCANS} if measurement.scans else set()
    present |= {DHR_READINGS} if len(measurement.dhr) else set()
    free = {posterior.specs[i].name for i in posterior.free}
    for effect in EFFECTS.values():
        missing = [readings for readings in effect.needs if readings not in present]
        if missing and free & set(effect.parameters):
            both = effect.needs == (S_SCANS, P_SCANS)
            needs = "s and p scans beside each other" if both else " and ".join(effect.needs)
            msg = (
                f"effects: {effect.name!r} needs {needs}, and there are no "
                f"{' and '.join(missing)}: nothing could tell it. Leave {effect.name!r} out"
            )
            raise ConfigError(msg)


def _words(posterior: Posterior, names: tuple[str, ...]) -> str:
    said = [f"{s.name} {s.prior.describe()}" for s in posterior.specs if s.name in names]
    return f"priors: {', '.join(said)}"

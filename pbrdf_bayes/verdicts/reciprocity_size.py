"""How far the fitted model is from reciprocity, and where the readings would notice."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.effects_table import INSTRUMENT_PARAMETERS
from pbrdf_bayes.errors import DomainError
from pbrdf_bayes.inference.parameters.table import PHYSICAL
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.model.four_parameter import Parameters
from pbrdf_bayes.physics.geometry import prepare_geometry
from pbrdf_bayes.physics.scene import NULL
from pbrdf_bayes.records.summary import LargestDefect, ReciprocitySize

Array = NDArray[np.float64]

THETA_DEG = tuple(10.0 * i for i in range(9))
"""Angles of the table [deg]."""
N_DRAWS = 50
"""Posterior draws that it is evaluated at."""
_QUANTILES = (0.05, 0.5, 0.95)
_TO_HALF_DEG = 2.0
_LAST_DEG = 89.5
_DECIMALS = 4
"""Of ln factor: of pairs that differ by less the first is taken, on the forward side."""


def measure_reciprocity(posterior: Posterior, draws: Array) -> ReciprocitySize | None:
    """Reciprocity defect of the sample's BRDF, whatever its line shape and effects.

    Effects of the instrument are left out: they are none of the sample. An optimum alone would
    mislead: with k at 0 the BRDF of p all but vanishes at Brewster's angle.

    Parameters
    ----------
    posterior : Posterior
    draws : ndarray, shape (n_draws, n_par)
        Physical units, in random order; the first fifty are taken.

    Returns
    -------
    ReciprocitySize or None
        None where the sample reflects totally beyond some angle (n < 1 with hardly any k) in one of
        these draws.
    """
    x = of_sample_alone(posterior, draws[:N_DRAWS])
    if not all(map(_is_surface, x[:, :4].tolist())):
        return None
    shown = _polarizations(posterior.measurement)
    grid = np.array(THETA_DEG)
    a, b = (angles.ravel() for angles in np.meshgrid(grid, grid, indexing="ij"))
    low, middle, high = (
        {
            q: np.exp(one).reshape(grid.size, grid.size).tolist()
            for q, one in zip(shown, level, strict=True)
        }
        for level in np.quantile(_log_defects(posterior, x, a, b, shown), _QUANTILES, axis=1)
    )
    return ReciprocitySize(
        theta_deg=THETA_DEG, factors=middle, q05=low, q95=high, n_draws=len(x),
        largest=_largest(posterior, x),
    )  # fmt: skip


def of_sample_alone(posterior: Posterior, draws: Array) -> Array:
    """Draws, shape (n_draws, n_par), with the effects of the instrument at their null values."""
    x = draws.copy()
    for column, name in enumerate(posterior.parameter_names):
        if name in INSTRUMENT_PARAMETERS:
            x[:, column] = getattr(NULL, name)
    return x


def _is_surface(four: list[float]) -> bool:
    try:
        Parameters(**dict(zip(PHYSICAL, four, strict=True)))
    except DomainError:
        return False
    return True


def _polarizations(measurement: Measurement) -> str:
    """Those of which factors are shown."""
    return "u" if {scan.polarization for scan in measurement.scans} == {"u"} else "sp"


def _log_defects(posterior: Posterior, x: Array, a: Array, b: Array, shown: str) -> Array:
    """Ln of f(a -> b) / f(b -> a) in plane, shape (n_polarizations, n_draws, n_pairs).

    ``a`` and the signed ``b`` [deg] have the shape (n_pairs,). NaN where nothing is reflected.
    """
    n = a.size
    theta_i = np.tile(np.concatenate([a, np.abs(b)]), len(shown))
    theta_r = np.tile(np.concatenate([b, np.copysign(a, b)]), len(shown))
    none = np.zeros(0)
    geometry = prepare_geometry(
        theta_i=np.deg2rad(theta_i), theta_r=np.deg2rad(theta_r), phi_r=np.zeros(theta_i.size),
        polarization=np.repeat(list(shown), 2 * n), dhr_theta_i=none,
        dhr_polarization=np.zeros(0, np.str_),
    )  # fmt: skip
    f = posterior.predict(x, geometry)[0].reshape(len(x), len(shown), 2, n)
    log_f = np.log(f, out=np.full(f.shape, np.nan), where=f > 0.0)
    return np.asarray(np.moveaxis(log_f[:, :, 0] - log_f[:, :, 1], 1, 0))


def _largest(posterior: Posterior, x: Array) -> LargestDefect | None:
    """Over the measured pairs, to half a degree of theta_r; the larger way of each."""
    a, b = measured_pairs(posterior.measurement)
    measured = {scan.polarization for scan in posterior.measurement.scans}
    shown = "".join(q for q in _polarizations(posterior.measurement) if measured & {q, "u"})
    if not a.size or not shown:
        return None
    defects = _log_defects(posterior, x, a, b, shown)
    middle = np.median(defects, axis=1)
    size = np.where(np.isfinite(middle), np.abs(middle).round(_DECIMALS), -1.0)
    i, j = divmod(int(np.argmax(size)), a.size)
    if size[i, j] < 0.0:
        return None
    pair, sign = (float(a[j]), float(b[j])), 1.0
    if middle[i, j] < 0.0:
        pair, sign = (abs(pair[1]), float(np.copysign(pair[0], pair[1]))), -1.0
    q05, factor, q95 = np.exp(np.quantile(sign * defects[i, :, j], _QUANTILES)).tolist()
    return LargestDefect(shown[i], *pair, factor, q05, q95)


def measured_pairs(measurement: Measurement) -> tuple[Array, Array]:
    """Pairs of angles measured in plane, theta_r to half a degree and within 89.5 [deg].

    Parameters
    ----------
    measurement : Measurement

    Returns
    -------
    tuple of ndarray, each of shape (n_pairs,)
        theta_i and signed theta_r, each pair once.
    """
    brdf = measurement.brdf
    flat = brdf.phi_r_deg == 0.0
    theta_r = np.round(_TO_HALF_DEG * brdf.theta_r_deg[flat]) / _TO_HALF_DEG
    pairs = np.stack([brdf.theta_i_deg[flat], np.clip(theta_r, -_LAST_DEG, _LAST_DEG)], axis=1)
    a, b = np.unique(pairs, axis=0).reshape(-1, 2)[::-1].T
    return a, b

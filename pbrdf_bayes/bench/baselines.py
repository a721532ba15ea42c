"""What a likelihood is compared with: its floor in arithmetic, and plain NumPy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.bench.normalisation import node_counts, surface_of
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.model.four_parameter import Parameters
from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.elementary import log
from pbrdf_bayes.physics.equations import FourParameters, dhr, lobe_across, lobe_along
from pbrdf_bayes.physics.fresnel import lobes, surface
from pbrdf_bayes.physics.normalisation.plain import Incidence, workspace
from pbrdf_bayes.quantities import S_AND_P

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@compiled(nogil=True)
def _floor(
    parameters: Array, x: Array, c: Array, offset: Array, h: Array, n_nodes: Index,
    s: Array, p: Array, log_s: Array, log_p: Array,
) -> None:  # fmt: skip
    """Lobes at data and nodes, logarithms at data; one loop each, nothing else."""
    n_data = log_s.size
    for j in range(parameters.shape[0]):
        row = parameters[j]
        surf = surface(row[0], row[1], row[2], row[3])
        for i in range(n_data + n_nodes[j]):
            s[i], p[i] = lobes(x[i], c[i], offset[i], h[i], surf)
        for i in range(n_data):
            log_s[i] = log(s[i])
            log_p[i] = log(p[i])


class Floor:
    """The Fresnel evaluations and logarithms that a posterior's rows and nodes need, no more.

    Parameters
    ----------
    posterior : Posterior
        In plane, with s and p at every direction.
    parameters : ndarray, shape (n_sets, n_par)
    """

    def __init__(self, posterior: Posterior, parameters: Array) -> None:
        self.parameters = parameters
        scratch = workspace()
        counts = []
        for row in parameters:
            surf = surface_of(Parameters(**dict(zip(_NAMES, row[:4].tolist(), strict=True))))
            total = 0
            for angle in posterior.geometry.incidences:
                m, n = node_counts(Incidence(*angle.tolist()), surf, posterior.digits, scratch)
                total += n
            counts.append(total + m)
        self.n_nodes = np.array(counts, dtype=np.int64)
        data = posterior.geometry.directions[:4]
        self.n_data = data.shape[1]
        size = self.n_data + int(self.n_nodes.max())
        # nodes cost what data cost: the rows of the data are repeated
        self.rows = np.ascontiguousarray(np.resize(data, (4, size)))
        for target, source in zip(self.rows, data, strict=True):
            target[:] = np.resize(source, size)
        self.out = np.empty((2, size))
        self.logs = np.empty((2, self.n_data))

    def __call__(self) -> Array:
        """Run the loops over all parameter sets; returns the last logarithms."""
        x, c, offset, h = self.rows
        (s, p), (log_s, log_p) = self.out, self.logs
        _floor(self.parameters, x, c, offset, h, self.n_nodes, s, p, log_s, log_p)
        return self.logs


_NAMES = ("n", "k", "sigma_n0", "rho0")


class PlainLikelihood:
    """The same likelihood in plain NumPy, each scan normalised by a tensor Gauss rule.

    Parameters
    ----------
    posterior : Posterior
        In plane, without floor, stated uncertainties or gains of scans.
    n_grid : int
        Nodes along either axis of the unit disk.
    """

    def __init__(self, posterior: Posterior, n_grid: int = 100) -> None:
        nodes, weights = np.polynomial.legendre.leggauss(n_grid)
        rim = np.sqrt(1.0 - nodes**2)
        self.alpha = nodes[:, None]
        self.beta = rim[:, None] * nodes
        self.weight = (weights * rim)[:, None] * weights
        self.posterior = posterior

    def __call__(self, x: Array) -> float:
        """Log-likelihood of one parameter set, shape (n_par,)."""
        rows, measurement = self.posterior.rows, self.posterior.measurement
        paint = FourParameters(*x[:4].tolist())
        total = 0.0
        for j, scan in enumerate(measurement.scans):
            q = S_AND_P.index(scan.polarization)
            alpha_i = float(np.sin(np.deg2rad(scan.theta_i_deg)))
            alpha = np.sin(np.deg2rad(measurement.brdf.theta_r_deg[scan.rows]))
            across = lobe_across(1 - q, self.beta, paint)
            norm = np.sum(self.weight * lobe_along(q, self.alpha, alpha_i, paint) * across)
            lobe = lobe_along(q, alpha, alpha_i, paint) * lobe_across(1 - q, 0.0, paint)
            residual = rows.y[scan.rows] - np.log(dhr(q, alpha_i, paint) / norm * lobe)
            v = x[rows.noise_column[j]] ** 2
            total -= 0.5 * np.sum(residual**2 / v + np.log(2.0 * np.pi * v))
        return float(total + self._dhr(x, paint))

    def _dhr(self, x: Array, paint: FourParameters) -> float:
        rows, readings = self.posterior.rows, self.posterior.measurement.dhr
        sine = np.sin(np.deg2rad(readings.theta_i_deg))
        total = 0.0
        for q in (0, 1):
            mine = rows.dhr_group == q
            model, v = dhr(q, sine[mine], paint), x[rows.dhr_noise_column] ** 2
            residual = readings.value[mine] - model
            weights = model @ model / v
            shrunk = rows.dhr_cal2 / (1.0 + rows.dhr_cal2 * weights)
            cross = residual @ model / v
            total -= 0.5 * (residual @ residual / v - cross * cross * shrunk)
            total -= 0.5 * np.log1p(rows.dhr_cal2 * weights)
            total -= 0.5 * residual.size * np.log(2.0 * np.pi * v)
        return float(total)

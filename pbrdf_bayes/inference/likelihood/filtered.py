"""The likelihood where readings are censored beside a discrepancy, or their noise is Student's t.

The law is that of `readings.observation`, but for

    Student-t noise: e_a ~ sqrt(v_a) t_nu,  v_a = s_q^2 + u_a^2 + b^2/(f^2 + b^2)
    a reading at or below the floor: the probability of falling there.

Groups that hold such a row are filtered, `inference.likelihood.assumed_density`; the others keep
their exact likelihood. Without a discrepancy every scan is a group, and tau is 0. DHR readings are
normal: `inference.likelihood.dhr`.

Systematic errors are marginalised beside the sites of `inference.likelihood.assumed_density`, which
are right near the errors that they were found at. The filter therefore runs once more with the
errors at what the first pass expects of them.

nu is not inferred: single scans hold too few outliers to tell it. Four degrees of freedom are those
that Lange, Little and Taylor advise, J. Am. Stat. Assoc. 84, 881 (1989),
doi:10.1080/01621459.1989.10478852.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.inference.likelihood.assumed_density import sweep_log_likelihood, sweep_state
from pbrdf_bayes.inference.likelihood.assumed_density_slopes import sweep_gradient
from pbrdf_bayes.inference.likelihood.correlated import (
    Discrepancy,
    prepare_discrepancy,
)
from pbrdf_bayes.inference.likelihood.dhr import add_dhr_slopes, dhr_readings
from pbrdf_bayes.inference.likelihood.groups import (
    Groups,
    Work,
    prepare_groups,
    set_errors,
    set_variances,
    workspace,
)
from pbrdf_bayes.inference.likelihood.kalman import group_gradient, group_log_likelihood
from pbrdf_bayes.inference.likelihood.row_evidence import Mixture, normal_mixture, student_mixture
from pbrdf_bayes.inference.likelihood.rows import Rows
from pbrdf_bayes.inference.likelihood.scaled_rows import (
    ScaledRows,
    add_row_slopes,
    compare_rows,
    scaled_rows,
)
from pbrdf_bayes.inference.likelihood.sweeps import Sweep, make_tape, prepare_sweep
from pbrdf_bayes.inference.likelihood.systematic import marginalise_about
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.physics.brdf import buffers, fill_dhr, log_brdf
from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.fresnel import surface
from pbrdf_bayes.physics.geometry import Geometry
from pbrdf_bayes.physics.given import Given, fill_model
from pbrdf_bayes.physics.normalisation.plain import SLOPES, VALUES
from pbrdf_bayes.physics.normalisation.plain import workspace as quadrature_workspace

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_PASSES = 2
"""Of the filter beside systematic errors: at z = 0 and at E(z|y) of the first."""


class Filtered(NamedTuple):
    """Which groups are filtered, and the rows ``exact_row`` of those that need not be."""

    law: Discrepancy
    sweep: Sweep
    exact: Groups
    exact_row: Index
    exact_noise_column: Index


def noise_mixture(config: RunConfig) -> Mixture:
    """Law of the noise of a BRDF reading, a mixture of normal laws."""
    return student_mixture(config.student_dof) if config.tails == "student-t" else normal_mixture()


def prepare_filtered(
    measurement: Measurement,
    rows: Rows,
    config: RunConfig,
    discrepancy: Discrepancy | None,
    *,
    errors: bool = False,
    everything: bool = False,
) -> Filtered | None:
    """Choose the groups that need the filter.

    Parameters
    ----------
    measurement : Measurement
    rows : Rows
    config : RunConfig
    discrepancy : Discrepancy or None
        None where the rows are independent.
    errors : bool
        There are systematic errors: censored readings of independent rows are filtered too.
    everything : bool
        Filter all groups.

    Returns
    -------
    Filtered or None
        None where no group needs it: censored readings of independent rows have their own exact
        likelihood.
    """
    exact = discrepancy is None and not errors
    hidden = np.zeros(rows.y.size, dtype=bool) if exact else rows.censored
    heavy = config.tails == "student-t"
    if not rows.y.size or not (everything or heavy or hidden.any()):
        return None
    law = discrepancy or prepare_discrepancy(measurement, rows)
    scan = np.repeat(np.arange(rows.noise_column.size), np.diff(rows.scan_start))
    group = law.group_of_scan[scan]
    wanted = np.arange(law.noise_column.size)
    if not (everything or heavy):
        wanted = np.unique(group[hidden])
    rest = np.flatnonzero(~np.isin(group, wanted))
    others, number = np.unique(group[rest], return_inverse=True)
    theta_r = measurement.brdf.theta_r_deg
    return Filtered(
        law=law,
        sweep=prepare_sweep(
            theta_r, group, scan, rows.y, rows.censored, noise_mixture(config), groups=wanted,
            rough=law.groups.rough,
        ),
        exact=prepare_groups(
            theta_r[rest], number.ravel(), scan[rest], rough=law.groups.rough
        ) if rest.size else law.groups,
        exact_row=rest,
        exact_noise_column=law.noise_column[others],
    )  # fmt: skip


@compiled()
def _column(x: Array, column: int, otherwise: float) -> float:
    """A parameter, or what stands for it where there is none."""
    return x[column] if column >= 0 else otherwise


@compiled()
def _fill_variance(rows: Rows, row: ScaledRows, x: Array, out: Array) -> None:
    """Variance of the noise of every row, over h^2."""
    for scan in range(rows.noise_column.size):
        for i in range(rows.scan_start[scan], rows.scan_start[scan + 1]):
            out[i] = x[rows.noise_column[scan]] ** 2 + row.extra[i]


@compiled()
def _gather_exact(
    filtered: Filtered, row: ScaledRows, x: Array, work: Work, gathered: Array,
    group_variance: Array,
) -> None:  # fmt: skip
    """Residuals and variances of the rows that are not filtered."""
    for i in range(filtered.exact_row.size):
        gathered[0, i] = row.residual[filtered.exact_row[i]]
        gathered[1, i] = row.extra[filtered.exact_row[i]]
    if filtered.law.varied:
        set_variances(filtered.exact, work, gathered[1])
    for group in range(group_variance.size):
        group_variance[group] = x[filtered.exact_noise_column[group]] ** 2


@compiled(nogil=True)
def filtered_log_likelihood(
    geometry: Geometry, rows: Rows, filtered: Filtered, parameters: Array, digits: float,
    given: Given, sensitivities: Array,
) -> Array:  # fmt: skip
    """Log-likelihood of every parameter set.

    Parameters
    ----------
    geometry : Geometry
    rows : Rows
    filtered : Filtered
    parameters : ndarray, shape (n_sets, n_par)
        Physical units; the first four columns are n, k, sigma_n0, rho0.
    digits : float
        Correct decimal digits of the normalisation.
    given : Given
        The model's values where they are not those of the four parameters.
    sensitivities : ndarray, shape (n_sets or 1, n_errors, n_rows)
        S of `readings.observation`.

    Returns
    -------
    ndarray, shape (n_sets,)
    """
    n_sets, law = parameters.shape[0], filtered.law
    result = np.empty(n_sets)
    found = buffers(geometry.directions.shape[1], geometry.incidences.shape[0], VALUES)
    row = scaled_rows(rows)
    m, s = sensitivities.shape[1], sensitivities[0]
    z = np.empty(m)
    variance, tape = np.empty(rows.y.size), make_tape(filtered.sweep, False, m)
    work, gathered = workspace(filtered.exact, False, m), np.empty((2, filtered.exact_row.size))
    group_variance = np.empty(filtered.exact_noise_column.size)
    dhr, dhr_work = np.empty(rows.dhr.size), np.empty(rows.dhr.size)
    ws = quadrature_workspace()
    for j in range(n_sets):
        x = parameters[j]
        tau, ell = _column(x, law.tau_column, 0.0), _column(x, law.ell_column, 1.0)
        fill_model(geometry, given, j, x, digits, ws, found, dhr)
        total, _ = dhr_readings(rows, dhr, x[rows.dhr_noise_column], dhr_work)
        total += compare_rows(geometry, rows, found, x, row)
        _fill_variance(rows, row, x, variance)
        if m > 0 and j < sensitivities.shape[0]:
            s = sensitivities[j]
            tape.sensitivities[:] = s[:, : tape.sensitivities.shape[1]]
            if group_variance.size:
                set_errors(filtered.exact, work, s[:, filtered.exact_row])
        z[:] = 0.0
        value = 0.0
        for _ in range(_PASSES if m > 0 else 1):
            value = sweep_log_likelihood(
                filtered.sweep, tape, row.residual, variance, rows.censored, rows.u_cal2, tau, ell
            )
            if group_variance.size:
                _gather_exact(filtered, row, x, work, gathered, group_variance)
                value += group_log_likelihood(
                    filtered.exact, work, gathered[0], group_variance, rows.u_cal2, tau, ell
                )
                tape.v[:] += work.v
                tape.g[:] += work.g
            value += marginalise_about(tape.v, tape.g, z)
            for i in range(m):
                for k in range(rows.y.size):
                    row.residual[k] -= tape.v[i] * s[i, k]
        result[j] = total + value
    return result


@compiled(nogil=True)
def filtered_gradient(
    geometry: Geometry, rows: Rows, filtered: Filtered, parameters: Array, digits: float
) -> tuple[Array, Array]:
    """Log-likelihood and its derivatives by all parameters, from one pass there and back.

    Parameters
    ----------
    geometry, rows, filtered, parameters, digits
        As for `filtered_log_likelihood`.

    Returns
    -------
    tuple of ndarray, shapes (n_sets,) and (n_sets, n_par)
    """
    n_sets, law = parameters.shape[0], filtered.law
    result, slopes = np.empty(n_sets), np.zeros(parameters.shape)
    found = buffers(geometry.directions.shape[1], geometry.incidences.shape[0], SLOPES)
    row = scaled_rows(rows)
    variance, tape = np.empty(rows.y.size), make_tape(filtered.sweep, True)
    by_row, by_exact = np.empty((2, rows.y.size)), np.empty((4, filtered.exact_row.size))
    work, gathered = workspace(filtered.exact, True), np.empty((2, filtered.exact_row.size))
    group_variance = np.empty(filtered.exact_noise_column.size)
    dhr, dhr_work = np.empty(rows.dhr.size), np.empty(rows.dhr.size)
    ws = quadrature_workspace()
    for j in range(n_sets):
        x, out = parameters[j], slopes[j]
        tau, ell = _column(x, law.tau_column, 0.0), _column(x, law.ell_column, 1.0)
        surf = surface(x[0], x[1], x[2], x[3])
        log_brdf(geometry, surf, digits, SLOPES, ws, found)
        fill_dhr(geometry, surf, dhr)
        result[j] = add_dhr_slopes(geometry, rows, surf, x, dhr, dhr_work, out)
        result[j] += compare_rows(geometry, rows, found, x, row)
        _fill_variance(rows, row, x, variance)
        value, by_tau, by_ell = sweep_gradient(
            filtered.sweep, tape, row.residual, variance, rows.censored, rows.u_cal2, tau, ell,
            by_row,
        )  # fmt: skip
        result[j] += value
        if group_variance.size:
            _gather_exact(filtered, row, x, work, gathered, group_variance)
            value, tau_slope, ell_slope = group_gradient(
                filtered.exact, work, gathered[0], group_variance, rows.u_cal2, tau, ell, by_exact
            )
            result[j] += value
            by_tau += tau_slope
            by_ell += ell_slope
            for i in range(filtered.exact_row.size):
                by_row[0, filtered.exact_row[i]] = by_exact[0, i]
                by_row[1, filtered.exact_row[i]] = by_exact[1, i]
        if law.tau_column >= 0:
            out[law.tau_column] += by_tau
            out[law.ell_column] += by_ell
        add_row_slopes(geometry, rows, found, surf, x, row, by_row, out)
    return result, slopes


class FilterState(NamedTuple):
    """What the filter found at one parameter set; see `filter_state`."""

    innovation: Array
    """Each reading, or its limit, minus its predicted mean, shape (n_brdf,)."""
    predicted: Array
    """Variance of that prediction without the noise of the reading."""
    variance: Array
    """v of the noise of each reading."""
    gain: Array
    """Mean of the logarithm of each scan's gain given the readings of its group, (n_scans,)."""
    gain_cov: Array


@compiled(nogil=True)
def filter_state(
    geometry: Geometry, rows: Rows, filtered: Filtered, x: Array, digits: float, given: Given
) -> FilterState:
    """Predictions of the readings that are filtered, and the gains of their scans.

    Parameters
    ----------
    geometry, rows, filtered, digits, given
        As for `filtered_log_likelihood`.
    x : ndarray, shape (n_par,)
        Physical units.

    Returns
    -------
    FilterState
    """
    law, n_scans = filtered.law, rows.noise_column.size
    found = buffers(geometry.directions.shape[1], geometry.incidences.shape[0], VALUES)
    row = scaled_rows(rows)
    dhr = np.empty(rows.dhr.size)
    fill_model(geometry, given, 0, x, digits, quadrature_workspace(), found, dhr)
    compare_rows(geometry, rows, found, x, row)
    variance, moments = np.empty(rows.y.size), np.zeros((2, rows.y.size))
    _fill_variance(rows, row, x, variance)
    gain, gain_cov = np.zeros(n_scans), np.zeros((n_scans, n_scans))
    sweep_state(
        filtered.sweep, make_tape(filtered.sweep, False), row.residual, variance, rows.censored,
        rows.u_cal2, _column(x, law.tau_column, 0.0), _column(x, law.ell_column, 1.0), moments,
        gain, gain_cov,
    )  # fmt: skip
    return FilterState(moments[0], moments[1], variance, gain, gain_cov)

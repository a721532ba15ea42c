"""The four-parameter polarised BRDF and the DHR, Eqs. (2)-(6), on prepared geometries.

    f_q(alpha_i; alpha, beta) = DHR_q(alpha_i) / I_q(alpha_i) * A_q(alpha; alpha_i) * B_q'(beta)
    DHR_q(alpha_i)            = sigma_N0 F_q(alpha_i)

Source: Renhorn, Hallberg, Bergstrom, Boreman, Opt. Express 19, 1027 (2011),
doi:10.1364/OE.19.001027. The limits of the integrals printed there in (2) and (4) mean the unit
disk. The paper calls the model reciprocal; with (4) the norm depends on the angle of incidence and
f(a -> b) differs from f(b -> a): see `pbrdf_bayes.model.reciprocity_ratio`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pbrdf_bayes.physics.directions import prepare_directions
from pbrdf_bayes.physics.fresnel import Surface, lobes, reflectances, surface
from pbrdf_bayes.physics.normalisation import (
    Incidence,
    Workspace,
    expand_cumulative,
    expansion_order,
    integrate_lobes,
    place_nodes,
    workspace,
)

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Geometry(NamedTuple):
    """Where the BRDF and the DHR are wanted; everything that the parameters do not enter.

    Distinct directions are grouped by angle of incidence (``start`` delimits the groups) and serve
    s and p alike; a row of the data points at its direction and mixes s and p by its weights.
    """

    incidences: Array
    """(n_incidence, 4): sine, cosine, theta_i, pi/2 - theta_i."""
    start: Index
    directions: Array
    """(8, n_directions): the fields of `Directions`."""
    in_plane: NDArray[np.bool_]
    """Per angle of incidence: all its directions have beta = 0."""
    row_direction: Index
    row_weight_s: Array
    row_weight_p: Array
    dhr_sine: Array
    dhr_cosine: Array
    dhr_weight_s: Array
    dhr_weight_p: Array


def weights_of(polarization: NDArray[np.str_]) -> tuple[Array, Array]:
    """Weights of the s and the p value for polarisations s, p and u (their mean, Eq. 6)."""
    table = {"s": (1.0, 0.0), "p": (0.0, 1.0), "u": (0.5, 0.5)}
    pairs = np.array([table[p] for p in polarization.tolist()], dtype=np.float64).reshape(-1, 2)
    return np.ascontiguousarray(pairs[:, 0]), np.ascontiguousarray(pairs[:, 1])


def prepare_geometry(
    *,
    theta_i: Array,
    theta_r: Array,
    phi_r: Array,
    polarization: NDArray[np.str_],
    dhr_theta_i: Array,
    dhr_polarization: NDArray[np.str_],
) -> Geometry:
    """Precompute the geometry of BRDF rows and DHR rows.

    Parameters
    ----------
    theta_i, theta_r, phi_r : ndarray, shape (n_brdf,)
        Angles [rad].
    polarization : ndarray of str, shape (n_brdf,)
        ``s``, ``p`` or ``u``.
    dhr_theta_i : ndarray, shape (n_dhr,)
        Angles of incidence [rad].
    dhr_polarization : ndarray of str, shape (n_dhr,)

    Returns
    -------
    Geometry
    """
    keys = np.stack([theta_i, theta_r, phi_r], axis=1).reshape(-1, 3)
    distinct, row_direction = np.unique(keys, axis=0, return_inverse=True)
    angles, first = np.unique(distinct[:, 0], return_index=True)
    directions = prepare_directions(*distinct.T)
    start = np.append(first, len(distinct)).astype(np.int64)
    flat = directions.beta_offset == 0.0
    weight_s, weight_p = weights_of(polarization)
    dhr_s, dhr_p = weights_of(dhr_polarization)
    return Geometry(
        incidences=np.stack(
            [np.sin(angles), np.cos(angles), angles, 0.5 * np.pi - angles], axis=1
        ),
        start=start,
        directions=np.stack(directions),
        in_plane=np.array([flat[a:b].all() for a, b in zip(start[:-1], start[1:], strict=True)]),
        row_direction=row_direction.ravel().astype(np.int64),
        row_weight_s=weight_s,
        row_weight_p=weight_p,
        dhr_sine=np.sin(dhr_theta_i),
        dhr_cosine=np.cos(dhr_theta_i),
        dhr_weight_s=dhr_s,
        dhr_weight_p=dhr_p,
    )


@njit(cache=True, error_model="numpy")
def _scale(inc: Incidence, surf: Surface, digits: float, m: int, ws: Workspace) -> tuple[float, float]:
    """DHR_q / I_q for s and p."""
    norm_s, norm_p = integrate_lobes(place_nodes(inc, surf, digits, ws), m, ws)
    f_s, f_p = reflectances(inc.sine, inc.cosine, surf)
    return surf.sigma_n0 * f_s / norm_s, surf.sigma_n0 * f_p / norm_p


@njit(cache=True, error_model="numpy")
def _fill_in_plane(
    directions: Array, a: int, b: int, scale_s: float, scale_p: float, surf: Surface, out: Array
) -> None:
    """f_s and f_p at the directions a..b, whose beta is 0; the scales include B(0)."""
    for i in range(a, b):
        lobe_s, lobe_p = lobes(
            directions[0, i], directions[1, i], directions[2, i], directions[3, i], surf
        )
        out[0, i] = scale_s * lobe_s
        out[1, i] = scale_p * lobe_p


@njit(cache=True, error_model="numpy")
def _fill_any(
    directions: Array, a: int, b: int, scale_s: float, scale_p: float, surf: Surface, out: Array
) -> None:
    """f_s and f_p at the directions a..b, in or out of plane."""
    for i in range(a, b):
        lobe_s, lobe_p = lobes(
            directions[0, i], directions[1, i], directions[2, i], directions[3, i], surf
        )
        across_s, across_p = lobes(
            directions[4, i], directions[5, i], directions[6, i], directions[7, i], surf
        )
        out[0, i] = scale_s * lobe_s * across_p
        out[1, i] = scale_p * lobe_p * across_s


@njit(cache=True, error_model="numpy")
def brdf_s_p(geometry: Geometry, surf: Surface, digits: float, ws: Workspace, out: Array) -> None:
    """f_s and f_p [sr^-1] at every distinct direction, into ``out`` (2, n_directions)."""
    n_incidence = geometry.incidences.shape[0]
    if n_incidence == 0:
        return
    m = expansion_order(np.arcsinh(0.5 * np.pi / surf.rho0), digits)
    expand_cumulative(surf, m, ws)
    peak_s, peak_p = lobes(0.0, 1.0, 0.0, 1.0, surf)
    for j in range(n_incidence):
        row = geometry.incidences[j]
        scale_s, scale_p = _scale(
            Incidence(row[0], row[1], row[2], row[3]), surf, digits, m, ws
        )
        a, b = geometry.start[j], geometry.start[j + 1]
        if geometry.in_plane[j]:
            _fill_in_plane(
                geometry.directions, a, b, scale_s * peak_p, scale_p * peak_s, surf, out
            )
        else:
            _fill_any(geometry.directions, a, b, scale_s, scale_p, surf, out)


@njit(cache=True, error_model="numpy")
def mix_rows(geometry: Geometry, s_p: Array, out: Array) -> None:
    """BRDF of each row from f_s and f_p of its direction, into ``out`` (n_brdf,)."""
    for i in range(out.size):
        j = geometry.row_direction[i]
        out[i] = geometry.row_weight_s[i] * s_p[0, j] + geometry.row_weight_p[i] * s_p[1, j]


@njit(cache=True, error_model="numpy")
def fill_dhr(geometry: Geometry, surf: Surface, out: Array) -> None:
    """DHR of each row, into ``out`` (n_dhr,)."""
    for i in range(out.size):
        f_s, f_p = reflectances(geometry.dhr_sine[i], geometry.dhr_cosine[i], surf)
        out[i] = surf.sigma_n0 * (geometry.dhr_weight_s[i] * f_s + geometry.dhr_weight_p[i] * f_p)


@njit(cache=True, nogil=True, error_model="numpy")
def evaluate(geometry: Geometry, parameters: Array, digits: float) -> tuple[Array, Array]:
    """BRDF and DHR of every row for every parameter set.

    Parameters
    ----------
    geometry : Geometry
    parameters : ndarray, shape (n_sets, >= 4)
        Columns n, k, sigma_n0, rho0; further columns are ignored.
    digits : float
        Correct decimal digits of the normalisation.

    Returns
    -------
    tuple of ndarray, shapes (n_sets, n_brdf) and (n_sets, n_dhr)
        BRDF [sr^-1] and DHR [1].
    """
    n_sets = parameters.shape[0]
    brdf = np.empty((n_sets, geometry.row_direction.size))
    dhr = np.empty((n_sets, geometry.dhr_sine.size))
    s_p = np.empty((2, geometry.directions.shape[1]))
    ws = workspace()
    for i in range(n_sets):
        surf = surface(parameters[i, 0], parameters[i, 1], parameters[i, 2], parameters[i, 3])
        brdf_s_p(geometry, surf, digits, ws, s_p)
        mix_rows(geometry, s_p, brdf[i])
        fill_dhr(geometry, surf, dhr[i])
    return brdf, dhr

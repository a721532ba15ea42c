"""Stokes vectors of a sample that scatters at its surface and below, for one illumination.

    S = M(f_s, f_p) S_in + d_q (1, 0, 0) + b_q (0, P, 0),     P = (T_s - T_p) / (T_s + T_p)

The surface has the Mueller matrix of its facets, Eqs. (7)-(12). What comes from below (d_q, all
diffuse terms for the illumination q) has lost its polarisation there. The one of these terms that
holds the way out through the surface is bulk scatter (b_q, a part of d_q): the transmittances T_s
and T_p at theta_r, in the meridian plane, polarise it on leaving. Lambertian and volume scatter and
the backscatter peak say nothing on the way out and are unpolarised.

Source: L. B. Wolff, "Diffuse-reflectance model for smooth dielectric surfaces", J. Opt. Soc. Am. A
11, 2956 (1994), doi:10.1364/JOSAA.11.002956, for bulk scatter; `pbrdf_bayes.physics.stokes` for the
surface.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.effects.bulk import bulk_brdf
from pbrdf_bayes.physics.fresnel import Surface, transmittances
from pbrdf_bayes.physics.stokes import Frames, phase_cosine, polarised_column, unpolarised_column
from pbrdf_bayes.quantities import STATES

Array = NDArray[np.float64]


def of_surface(
    f_s: Array, f_p: Array, frames: Frames, n: float, k: float, *, incident: str, phase: str
) -> Array:
    """Stokes vectors [sr^-1] of what facets scatter, shape (3, n_directions).

    Only the columns of the Mueller matrix that the light meets; unpolarised light needs no phase.
    """
    found = np.stack(unpolarised_column(f_s, f_p, frames))
    if incident == "u":
        return found
    cosine = phase_cosine(frames, n, k) if phase == "fresnel" else np.ones(f_s.shape)
    added = np.stack(polarised_column(f_s, f_p, cosine, frames))
    return found + added if incident == "s" else found - added


def bulk_s1(
    theta_i: float, theta_r: Array, strength: float, surf: Surface, *, incident: str
) -> Array:
    """S1 [sr^-1] of bulk scatter that leaves through the surface, shape (n_directions,).

    Parameters
    ----------
    theta_i : float
        [rad].
    theta_r : ndarray, shape (n_directions,)
        [rad].
    strength : float
        D_b [1].
    surf : Surface
    incident : {"s", "p", "u"}
    """
    angles, which = np.unique(np.abs(theta_r), return_inverse=True)
    sine_i, cosine_i = float(np.sin(theta_i)), float(np.cos(theta_i))
    share_s, share_p = STATES[incident].weights
    found = np.zeros(angles.size)
    for i, angle in enumerate(angles.tolist()):
        sine, cosine = float(np.sin(angle)), max(float(np.cos(angle)), 0.0)
        t_s, t_p = transmittances(sine, cosine, surf)
        if t_s + t_p > 0.0:
            s, p = bulk_brdf(sine_i, cosine_i, sine, cosine, strength, surf)
            found[i] = (share_s * s + share_p * p) * (t_s - t_p) / (t_s + t_p)
    return np.asarray(found[which.ravel()])

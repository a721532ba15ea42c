"""Stokes vectors and the Mueller matrix of the BRDF out of plane, Eqs. (7)-(12), from the vectors.

With z the normal and x/z the plane of incidence, S_r = sin(theta_r) and c_r = cos(theta_r),

    k_i = (alpha_i, 0, -c_i)        k_r = (alpha, beta, c_r) = (S_r cos(phi_r), S_r sin(phi_r), c_r)
    s_i = (0, 1, 0)                 s_r = (-sin(phi_r), cos(phi_r), 0)             p = k x s

the facet that mirrors k_i to k_r has the plane of incidence with the normal

    t = -k_i x k_r / N = (-c_i beta, G, -alpha_i beta) / N,    N^2 = G^2 + beta^2
    G = alpha c_i + alpha_i c_r

and, along the frames of the light that comes and of the light that goes,

    t = cos(a) s_i - sin(a) p_i = cos(b) s_r - sin(b) p_r
    cos(a) = G / N         sin(a) = beta / N
    cos(b) = H / (S_r N)   sin(b) = alpha_i beta / (S_r N)
    H = (alpha^2 + beta^2) c_i + alpha alpha_i c_r

The facet reflects its own s with the amplitude of f_s and its own p with that of f_p, Eq. (8), with
the phases of Fresnel's coefficients at the local angle delta, cos(2 delta) = -k_i . k_r. For
p = k x s on both sides

    Re(r_s conj(r_p)) / |r_s r_p| = (x^4 - c^2 |m^2 - x^2|) / |m^2 c^2 - x^2|,
    x = sin(delta), c = cos(delta), m = n - ik:

it is -1 at normal incidence, where E keeps its line, and +1 at grazing.

Stokes vectors are S0 = <|E_s|^2 + |E_p|^2>, S1 = <|E_s|^2 - |E_p|^2>, S2 = 2 Re<E_s conj(E_p)>:
S2 > 0 is a field along s + p, 45 degrees from s counterclockwise for who looks into the beam.

Source: Renhorn, Hallberg, Bergstrom, Boreman, Opt. Express 19, 1027 (2011),
doi:10.1364/OE.19.001027, where G and H stand as roots of their squares g and h.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ROUNDING_OF_PI = 5e-16


class Frames(NamedTuple):
    """Where the facet's plane lies, one array element for each direction.

    ``cos_in`` and ``sin_in`` belong to 2a, ``cos_out`` and ``sin_out`` to 2b; ``sin2`` and
    ``cos2`` are the squared sine and cosine of the local angle delta.
    """

    cos_in: Array
    sin_in: Array
    cos_out: Array
    sin_out: Array
    sin2: Array
    cos2: Array


def prepare_frames(theta_i: Array, theta_r: Array, phi_r: Array) -> Frames:
    """Angles between the facet's plane and the two frames, without cancellation.

    Parameters
    ----------
    theta_i, theta_r, phi_r : ndarray
        Angles of one shape [rad]; ``theta_r`` is signed.

    Returns
    -------
    Frames
        At theta_r = 0 the outgoing frame is the limit along the meridian phi_r. Back along the
        incoming ray N = 0, and the facet's plane is the limit along the meridian, too.
    """
    sin_phi = np.sin(phi_r)
    sin_phi = np.where(np.abs(sin_phi) < _ROUNDING_OF_PI, 0.0, sin_phi)
    near, far = np.cos(0.5 * phi_r) ** 2, np.sin(0.5 * phi_r) ** 2
    total, gap = theta_i + theta_r, theta_i - theta_r
    g = near * np.sin(total) + far * np.sin(gap)
    h = near * np.sin(total) - far * np.sin(gap)  # over S_r
    beta = np.sin(theta_r) * sin_phi
    across = np.sin(theta_i) * sin_phi
    back = (g == 0.0) & (beta == 0.0)
    cos_in, sin_in = _double(np.where(back, np.cos(phi_r), g), np.where(back, sin_phi, beta))
    cos_out, sin_out = _double(np.where(back, 1.0, h), np.where(back, 0.0, across))
    return Frames(
        cos_in,
        sin_in,
        cos_out,
        sin_out,
        sin2=near * np.sin(0.5 * total) ** 2 + far * np.sin(0.5 * gap) ** 2,
        cos2=near * np.cos(0.5 * total) ** 2 + far * np.cos(0.5 * gap) ** 2,
    )


def _double(x: Array, y: Array) -> tuple[Array, Array]:
    """Cosine and sine of twice the angle of the vector (x, y), of any length."""
    largest = np.maximum(np.abs(x), np.abs(y))
    x, y = x / largest, y / largest
    norm = x * x + y * y
    return (x - y) * (x + y) / norm, 2.0 * x * y / norm


def phase_cosine(frames: Frames, n: float, k: float) -> Array:
    """Re(r_s conj(r_p)) / |r_s r_p| at the local angle; 0 at a Brewster zero, between -1 and 1."""
    m2 = complex(n, -k) ** 2
    x2, c2 = frames.sin2, frames.cos2
    above = x2 * x2 - c2 * np.abs(m2 - x2)
    below = np.abs(m2 * c2 - x2)
    return np.asarray(np.clip(above / np.where(below > 0.0, below, np.inf), -1.0, 1.0))


def mueller_matrix(f_s: Array, f_p: Array, phase: Array, frames: Frames) -> Array:
    """Mueller matrix of the linear components between the frames of incidence and scattering.

    Eq. (8) for the facet, turned by a before and by b after. The circular component of the light
    that comes is left out, that of the light that goes is not told.

    Parameters
    ----------
    f_s, f_p : ndarray
        BRDF of Eq. (3) for s and p [sr^-1].
    phase : ndarray
        Cosine of the phase between s and p, [-1, 1] [1].
    frames : Frames
        Arrays of the same shape.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        [sr^-1].
    """
    ca, sa = frames.cos_in, frames.sin_in
    cross = phase * np.sqrt(f_s) * np.sqrt(f_p)
    columns = (
        unpolarised_column(f_s, f_p, frames),
        polarised_column(f_s, f_p, phase, frames),
        _turned(-0.5 * (f_s - f_p) * sa, -0.5 * (f_s + f_p) * sa, cross * ca, frames),
    )
    return np.stack([np.stack(column, axis=-1) for column in columns], axis=-1)


def unpolarised_column(f_s: Array, f_p: Array, frames: Frames) -> tuple[Array, Array, Array]:
    """First column of `mueller_matrix`: S0, S1, S2 of unpolarised light, which needs no phase."""
    return _turned(0.5 * (f_s + f_p), 0.5 * (f_s - f_p), 0.0, frames)


def polarised_column(
    f_s: Array, f_p: Array, phase: Array, frames: Frames
) -> tuple[Array, Array, Array]:
    """Second column of `mueller_matrix`: what the excess of s over p adds to S0, S1, S2."""
    ca, sa = frames.cos_in, frames.sin_in
    cross = phase * np.sqrt(f_s) * np.sqrt(f_p)
    return _turned(0.5 * (f_s - f_p) * ca, 0.5 * (f_s + f_p) * ca, cross * sa, frames)


def _turned(s0: Array, s1: Array, s2: Array | float, frames: Frames) -> tuple[Array, Array, Array]:
    """A Stokes vector in the frame of the facet as it is in that of the meridian plane."""
    cb, sb = frames.cos_out, frames.sin_out
    return s0, cb * s1 + sb * s2, cb * s2 - sb * s1


def depolarise(matrix: Array, share: float) -> Array:
    """The matrix with a share of the outgoing light depolarised: S1 and S2 times 1 - share.

    ``matrix`` has shape (..., 3, 3). A share of 0 changes no bit, 1 leaves S0 alone.
    """
    kept = 1.0 - share
    return np.asarray(matrix * np.array([1.0, kept, kept])[:, None])

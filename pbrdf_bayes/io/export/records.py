"""What is written: values on the grid of a format, and where they come from.

Angles are in degrees and in the convention of the package: phi_r is 0 on the specular side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """A parameter of the model: its value and, from a posterior, its standard uncertainty."""

    name: str
    description: str
    value: float
    unit: str
    u: float | None = None


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Where values come from.

    Attributes
    ----------
    sample : str
    program : str
        Version of this package.
    statement : str
        Which values these are, in one sentence.
    measured : bool
        They come from a fit of readings.
    timestamp : str
        When they were computed, RFC 3339 (UTC).
    wavelengths_um : tuple of float
    fitted : tuple of tuple of Fitted
        The model of each wavelength.
    """

    sample: str
    program: str
    statement: str
    measured: bool
    timestamp: str
    wavelengths_um: tuple[float, ...]
    fitted: tuple[tuple[Fitted, ...], ...]

    def lines(self) -> list[str]:
        """The same as lines of text for the head of a file."""
        found = [
            f"sample: {' '.join(self.sample.split())}",
            f"{self.statement} (pbrdf-bayes {self.program}, {self.timestamp})",
        ]
        for wavelength, model in zip(self.wavelengths_um, self.fitted, strict=True):
            values = ", ".join(f"{x.name} = {x.value:.6g}" for x in model)
            found.append(f"{wavelength:.10g} um: {values}")
        return found


@dataclass(frozen=True, eq=False, kw_only=True)
class Rows:
    """BRDF and DHR in rows.

    Attributes
    ----------
    polarization : ndarray of str, shape (n_rows,)
        ``s``, ``p`` or ``u``.
    wavelength_um, theta_i_deg, theta_r_deg, phi_r_deg : ndarray, shape (n_rows,)
        ``theta_r_deg`` is signed with phi_r 0, or at least 0 with phi_r in [0, 180]; NaN in rows
        of DHR.
    value : ndarray, shape (n_rows,)
        BRDF [sr^-1] or DHR [1].
    u_value : ndarray, shape (n_rows,), or None
        Standard uncertainty of ``value``.
    """

    polarization: NDArray[np.str_]
    wavelength_um: Array
    theta_i_deg: Array
    theta_r_deg: Array
    phi_r_deg: Array
    value: Array
    u_value: Array | None

    def polar(self) -> tuple[Array, Array]:
        """theta_r in [0, 90] and phi_r in [0, 180] of the same directions [deg]."""
        back = self.theta_r_deg < 0.0
        return np.abs(self.theta_r_deg), np.where(back, 180.0 - self.phi_r_deg, self.phi_r_deg)


@dataclass(frozen=True, eq=False, kw_only=True)
class SpecularGrid:
    """BRDF about the specular direction, one polarisation and wavelength.

    Attributes
    ----------
    theta_i_deg : ndarray, shape (n,)
    azimuth_deg : ndarray, shape (m,)
        0 is towards the normal, up to 180.
    radial_deg : ndarray, shape (l,)
        Angle from the specular direction.
    value : ndarray, shape (n, m, l)
        BRDF [sr^-1], 0 below the horizon.
    dhr : ndarray, shape (n,)
        [1].
    """

    theta_i_deg: Array
    azimuth_deg: Array
    radial_deg: Array
    value: Array
    dhr: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class HalfAngleGrid:
    """Mueller matrices over the half and the difference angle.

    Attributes
    ----------
    theta_h, theta_d, phi_d : ndarray, shapes (n_h,), (n_d,), (n_phi,)
        [rad]; phi_d from -pi to pi.
    wavelength_nm : ndarray of int, shape (5,)
    mueller : ndarray, shape (n_phi, n_d, n_h, 5, 4, 4)
        [sr^-1]; both Stokes frames lie across the plane of light and viewer.
    """

    theta_h: Array
    theta_d: Array
    phi_d: Array
    wavelength_nm: NDArray[np.int64]
    mueller: NDArray[np.float32]

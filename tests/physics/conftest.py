"""The model from the equations as they are printed, for comparison."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pbrdf_bayes.physics import equations

Array = NDArray[np.float64]
REFERENCE = Path(__file__).parents[1] / "reference"


@pytest.fixture(scope="session")
def reference_points() -> list[dict[str, Any]]:
    """Points of the committed extended-precision integration."""
    text = (REFERENCE / "normalisation_values.json").read_text(encoding="utf-8")
    points: list[dict[str, Any]] = json.loads(text)["points"]
    return points


class Textbook:
    """Equations (2)-(6) as they are printed, with the disk integral by a plain 2-D rule.

    Accurate to rounding where nothing cancels, that is for n - 1 not small and angles not grazing;
    the integral by a product of Gauss rules in polar coordinates, for lobes that are not narrow.
    """

    def __init__(self, n: float, k: float, sigma_n0: float, rho0: float) -> None:
        self.sigma_n0, self.rho0 = sigma_n0, rho0
        self.paint = equations.FourParameters(n, k, sigma_n0, rho0)

    def reflectances(self, x: Array | float) -> tuple[Array, Array]:
        """F_s and F_p."""
        return equations.fresnel(0, x, self.paint), equations.fresnel(1, x, self.paint)

    def widths(self, x: Array | float) -> tuple[Array, Array]:
        """rho_s and rho_p, Eq. (5)."""
        return equations.half_width(0, x, self.paint), equations.half_width(1, x, self.paint)

    def shape(self, alpha_i: float, alpha: Array, beta: Array) -> tuple[Array, Array]:
        """A_q(alpha) B_q'(beta) of Eq. (3) for q = s, p."""
        s, p = (
            equations.lobe_along(q, alpha, alpha_i, self.paint)
            * equations.lobe_across(1 - q, beta, self.paint)
            for q in (0, 1)
        )
        return s, p

    def norms(self, alpha_i: float, panels: int = 12, order: int = 12) -> tuple[float, float]:
        """Integral of `shape` over the unit disk, in polar coordinates."""
        theta, w_theta = composite_gauss(np.linspace(0.0, 0.5 * np.pi, panels + 1), order)
        phi, w_phi = composite_gauss(np.linspace(0.0, np.pi, 2 * panels + 1), order)
        sine = np.sin(theta)[:, None]
        weight = 2.0 * (w_theta * np.sin(theta) * np.cos(theta))[:, None] * w_phi
        s, p = self.shape(alpha_i, sine * np.cos(phi), sine * np.sin(phi))
        return float(np.sum(weight * s)), float(np.sum(weight * p))

    def brdf(self, theta_i_deg: float, theta_r_deg: Any, phi_r_deg: Any = 0.0) -> Array:
        """f_s and f_p [sr^-1], stacked along the first axis."""
        alpha_i = math.sin(math.radians(theta_i_deg))
        sine = np.sin(np.radians(theta_r_deg))
        shapes = self.shape(
            alpha_i, sine * np.cos(np.radians(phi_r_deg)), sine * np.sin(np.radians(phi_r_deg))
        )
        reflectances, norms = self.reflectances(alpha_i), self.norms(alpha_i)
        return np.array(
            [
                self.sigma_n0 * f / norm * shape
                for f, norm, shape in zip(reflectances, norms, shapes, strict=True)
            ]
        )


def composite_gauss(breaks: Array, order: int) -> tuple[Array, Array]:
    """Nodes and weights of a Gauss-Legendre rule repeated on every panel."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    half = 0.5 * np.diff(breaks)[:, None]
    middle = 0.5 * (breaks[1:] + breaks[:-1])[:, None]
    return (middle + half * nodes).ravel(), (half * weights).ravel()


@pytest.fixture(scope="session")
def textbook() -> type[Textbook]:
    """The class `Textbook`."""
    return Textbook


@pytest.fixture(scope="session")
def gauss_rule() -> Callable[[Array, int], tuple[Array, Array]]:
    """Nodes and weights of a composite Gauss-Legendre rule."""
    return composite_gauss

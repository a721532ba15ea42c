"""The model written again from the textbook formulas, for comparison."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

Array = NDArray[np.float64]
REFERENCE = Path(__file__).parents[1] / "reference"


@pytest.fixture(scope="session")
def reference_points() -> list[dict[str, Any]]:
    """Points of the committed extended-precision integration."""
    text = (REFERENCE / "normalisation_values.json").read_text(encoding="utf-8")
    points: list[dict[str, Any]] = json.loads(text)["points"]
    return points


class Textbook:
    """Equations (2)-(6) in complex arithmetic, with the disk integral by a plain 2-D rule.

    Accurate to rounding where nothing cancels, that is for n - 1 not small and angles not grazing;
    the integral by a product of Gauss rules in polar coordinates, for lobes that are not narrow.
    """

    def __init__(self, n: float, k: float, sigma_n0: float, rho0: float) -> None:
        self.m2 = complex(n, -k) ** 2
        self.sigma_n0, self.rho0 = sigma_n0, rho0

    def reflectances(self, x: Array | float) -> tuple[Array, Array]:
        """F_s and F_p from the amplitudes (c - c_t) / (c + c_t), (m^2 c - c_t) / (m^2 c + c_t)."""
        x = np.asarray(x, dtype=float)
        c = np.sqrt(1.0 - x * x)
        c_t = np.sqrt(self.m2 - x * x)
        r_s = (c - c_t) / (c + c_t)
        r_p = (self.m2 * c - c_t) / (self.m2 * c + c_t)
        return np.abs(r_s) ** 2, np.abs(r_p) ** 2

    def widths(self, x: Array | float) -> tuple[Array, Array]:
        """rho_s and rho_p, Eq. (5)."""
        normal = self.reflectances(0.0)[0]
        f_s, f_p = self.reflectances(x)
        return self.rho0 * (1 - f_s) / (1 - normal), self.rho0 * (1 - f_p) / (1 - normal)

    def shape(self, alpha_i: float, alpha: Array, beta: Array) -> tuple[Array, Array]:
        """A_q(alpha) B_q'(beta) of Eq. (3) for q = s, p."""
        middle = 0.5 * (alpha + alpha_i)
        height_a = 0.25 * (math.sqrt(1 - alpha_i**2) + np.sqrt(1 - alpha**2)) ** 2
        height_b = 0.25 * (1 + np.sqrt(1 - beta**2)) ** 2
        a = [
            f / ((alpha - alpha_i) ** 2 + height_a * rho**2)
            for f, rho in zip(self.reflectances(middle), self.widths(middle), strict=True)
        ]
        b = [
            f / (beta**2 + height_b * rho**2)
            for f, rho in zip(self.reflectances(0.5 * beta), self.widths(0.5 * beta), strict=True)
        ]
        return a[0] * b[1], a[1] * b[0]

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

"""Work and precision of the normalisation integral: ours, scipy's, tensor grids, closed forms."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import degrees, pi, sqrt
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import IntegrationWarning, dblquad

from pbrdf_bayes.bench.closed_form import closed_form, few_terms
from pbrdf_bayes.bench.timing import time_in_turns
from pbrdf_bayes.model.four_parameter import Parameters
from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.fresnel import Surface, lobes, surface
from pbrdf_bayes.physics.normalisation.plain import (
    Incidence,
    Workspace,
    incidence,
    normalisation_integrals,
    place_nodes,
    workspace,
)
from pbrdf_bayes.physics.normalisation.quadrature import expansion_order

Array = NDArray[np.float64]

REFERENCE_DIGITS = 30.0
RTOLS = tuple(10.0**-i for i in range(2, 13))
GRIDS = (50, 100, 200, 400)


@dataclass(frozen=True)
class Case:
    """A normalisation to be computed."""

    name: str
    parameters: Parameters
    theta_i: float
    """Angle of incidence [rad]."""


def paint(rho0: float) -> Parameters:
    """The published green paint with another roughness."""
    return Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=rho0)


CASES = (
    Case("published paint (ρ_0 = 0.47), θ_i = 60°", paint(0.47), pi / 3.0),
    Case("ρ_0 = 0.05, θ_i = 60°", paint(0.05), pi / 3.0),
    Case("ρ_0 = 0.005, θ_i = 60°", paint(0.005), pi / 3.0),
)


def surface_of(parameters: Parameters) -> Surface:
    """Hoisted constants of a parameter set."""
    made: Surface = surface(*parameters.as_array())
    return made


@compiled()
def node_counts(inc: Incidence, surf: Surface, digits: float, ws: Workspace) -> tuple[int, int]:
    """Lobe evaluations of one integral: those of C, and those of A."""
    m = expansion_order(np.arcsinh(0.5 * pi / surf.rho0), digits)
    return m, place_nodes(inc, surf, digits, ws)


@compiled()
def _repeat(inc: Incidence, surf: Surface, digits: float, times: int, ws: Workspace) -> float:
    total = 0.0
    for _ in range(times):
        s, p = normalisation_integrals(inc, surf, digits, ws)
        total += s + p
    return total


@compiled()
def integrand(alpha: float, beta: float, inc: Incidence, surf: Surface) -> tuple[float, float]:
    """A_q(alpha) B_q'(beta), Eq. (3), for s and p at one point of the disk."""
    x = 0.5 * (alpha + inc.sine)
    c_alpha = sqrt(max((1.0 - alpha) * (1.0 + alpha), 0.0))
    h = 0.25 * (inc.cosine + c_alpha) ** 2
    a_s, a_p = lobes(x, sqrt(max((1.0 - x) * (1.0 + x), 0.0)), alpha - inc.sine, h, surf)
    y = 0.5 * beta
    h_beta = 0.25 * (1.0 + sqrt(max((1.0 - beta) * (1.0 + beta), 0.0))) ** 2
    b_s, b_p = lobes(y, sqrt((1.0 - y) * (1.0 + y)), beta, h_beta, surf)
    return a_s * b_p, a_p * b_s


@compiled()
def tensor_grid(inc: Incidence, surf: Surface, nodes: Array, weights: Array) -> tuple[float, float]:
    """I_s and I_p by a product of Gauss rules on alpha = x, beta = y sqrt(1 - x^2)."""
    total_s, total_p = 0.0, 0.0
    for i in range(nodes.size):
        alpha = nodes[i]
        rim = sqrt((1.0 - alpha) * (1.0 + alpha))
        for j in range(nodes.size):
            w = weights[i] * weights[j] * rim
            s, p = integrand(alpha, rim * nodes[j], inc, surf)
            total_s += w * s
            total_p += w * p
    return total_s, total_p


def adaptive(inc: Incidence, surf: Surface, rtol: float) -> tuple[float, float, int]:
    """I_s, I_p and the number of evaluations by ``scipy.integrate.dblquad`` on the disk."""
    count = 0

    def counted(beta: float, alpha: float, q: int) -> float:
        nonlocal count
        count += 1
        value: float = integrand(alpha, beta, inc, surf)[q]
        return value

    def rim(alpha: float) -> float:
        return sqrt(max((1.0 - alpha) * (1.0 + alpha), 0.0))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IntegrationWarning)
        s, p = (
            dblquad(counted, -1.0, 1.0, lambda a: -rim(a), rim, args=(q,), epsabs=0.0, epsrel=rtol)[
                0
            ]
            for q in (0, 1)
        )
    return s, p, count


def work_precision(*, quick: bool) -> list[dict[str, Any]]:
    """Error, time and evaluations of every method for every case.

    Returns
    -------
    list of dict
        One for each case: name, theta_i_deg, rho0, points; a point has method, setting, error
        (relative, larger of s and p), microseconds (both polarisations) and evaluations.
    """
    return [_measure(case, quick=quick) for case in CASES]


def _measure(case: Case, *, quick: bool) -> dict[str, Any]:
    inc, surf, ws = incidence(case.theta_i), surface_of(case.parameters), workspace()
    exact = np.array(normalisation_integrals(inc, surf, REFERENCE_DIGITS, ws))

    def error(values: Sequence[float]) -> float:
        return float(np.max(np.abs(np.asarray(values) / exact - 1.0)))

    points: list[dict[str, Any]] = []
    times = time_in_turns(
        {f"{r:.0e}": _batch(inc, surf, -np.log10(r), ws) for r in RTOLS}, rounds=8 if quick else 20
    )
    for rtol in RTOLS:
        digits = -float(np.log10(rtol))
        points.append(
            {
                "method": "ours",
                "setting": f"{rtol:.0e}",
                "error": error(normalisation_integrals(inc, surf, digits, ws)),
                "microseconds": times[f"{rtol:.0e}"] / _BATCH * 1e6,
                "evaluations": sum(node_counts(inc, surf, digits, ws)),
            }
        )
    points += _grids(inc, surf, error, quick=quick)
    points += _adaptives(inc, surf, error, case.parameters.rho0, quick=quick)
    points += _closed(inc, surf, error)
    return {
        "name": case.name,
        "theta_i_deg": round(degrees(case.theta_i), 6),
        "rho0": case.parameters.rho0,
        "points": points,
    }


_BATCH = 32


def _batch(inc: Incidence, surf: Surface, digits: float, ws: Workspace) -> Callable[[], object]:
    return lambda: _repeat(inc, surf, float(digits), _BATCH, ws)


def _grids(
    inc: Incidence, surf: Surface, error: Callable[[Sequence[float]], float], *, quick: bool
) -> list[dict[str, Any]]:
    points = []
    for n in GRIDS:
        nodes, weights = np.polynomial.legendre.leggauss(n)
        values = tensor_grid(inc, surf, nodes, weights)
        seconds = _once(lambda: tensor_grid(inc, surf, nodes, weights), rounds=2 if quick else 4)  # noqa: B023
        points.append(_point("tensor grid", f"{n} x {n}", error(values), seconds, n * n))
    return points


def _adaptives(
    inc: Incidence, surf: Surface, error: Callable[[Sequence[float]], float], rho0: float,
    *, quick: bool,
) -> list[dict[str, Any]]:  # fmt: skip
    rtols = [1e-2, 1e-4, 1e-6, 1e-8] if rho0 > 0.1 else [1e-2, 1e-4, 1e-6]
    if quick:
        rtols = rtols[:3] if rho0 > 0.1 else rtols[:1] if rho0 > 0.01 else []
    points = []
    for rtol in rtols:
        started = perf_counter()
        s, p, count = adaptive(inc, surf, rtol)
        seconds = perf_counter() - started
        points.append(_point("scipy dblquad", f"{rtol:.0e}", error((s, p)), seconds, count))
    return points


@compiled()
def _repeat_closed(inc: Incidence, surf: Surface, times: int) -> float:
    total = 0.0
    for i in range(times):
        part = 1.0 - 1e-12 * i  # another angle each time, or the compiler computes it once
        moved = Incidence(part * inc.sine, part * inc.cosine, inc.theta, inc.grazing)
        s, p = closed_form(moved, surf)
        total += s + p
    return total


@compiled()
def _repeat_few(inc: Incidence, surf: Surface, times: int) -> float:
    total = 0.0
    for i in range(times):
        moved = Incidence(inc.sine, inc.cosine, inc.theta + 1e-12 * i, inc.grazing)
        s, p = few_terms(moved, surf)
        total += s + p
    return total


def _closed(
    inc: Incidence, surf: Surface, error: Callable[[Sequence[float]], float]
) -> list[dict[str, Any]]:
    times = time_in_turns(
        {
            "closed": lambda: _repeat_closed(inc, surf, 1000),
            "few": lambda: _repeat_few(inc, surf, 1000),
        },
        rounds=5,
    )
    return [
        _point("closed form", "one term", error(closed_form(inc, surf)), times["closed"] / 1e3, 1),
        _point("few terms", "8 terms", error(few_terms(inc, surf)), times["few"] / 1e3, 8),
    ]


def _point(
    method: str, setting: str, error: float, seconds: float, evaluations: int
) -> dict[str, Any]:
    return {
        "method": method,
        "setting": setting,
        "error": error,
        "microseconds": seconds * 1e6,
        "evaluations": int(evaluations),
    }


def _once(function: Callable[[], object], *, rounds: int) -> float:
    return time_in_turns({"": function}, rounds=rounds, shortest=0.0)[""]


def error_map(*, n_angles: int = 40, n_widths: int = 40) -> dict[str, Any]:
    """Relative errors of the closed forms over theta_i and rho0 for the published n and k.

    Returns
    -------
    dict
        theta_i_deg (n_angles,), rho0 (n_widths,), closed_form and few_terms (n_widths, n_angles),
        the larger error of s and p.
    """
    angles = np.linspace(0.0, 85.0, n_angles)
    widths = np.geomspace(1e-3, 4.0, n_widths)
    ws = workspace()
    maps = np.empty((2, n_widths, n_angles))
    for i, rho0 in enumerate(widths.tolist()):
        surf = surface_of(paint(rho0))
        for j, theta_i in enumerate(np.deg2rad(angles).tolist()):
            inc = incidence(theta_i)
            exact = np.array(normalisation_integrals(inc, surf, 12.0, ws))
            for k, form in enumerate((closed_form, few_terms)):
                maps[k, i, j] = np.max(np.abs(np.array(form(inc, surf)) / exact - 1.0))
    return {
        "theta_i_deg": angles.tolist(),
        "rho0": [float(f"{w:.4g}") for w in widths],
        "closed_form": _rounded(maps[0]),
        "few_terms": _rounded(maps[1]),
    }


def _rounded(values: Array) -> list[list[float]]:
    return [[float(f"{v:.3g}") for v in row] for row in values]

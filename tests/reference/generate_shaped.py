"""Reference values of the general lobes: line shape, narrowing, place of the Fresnel factor.

The triangle rule and its refinement are those of ``generate.py``; what is integrated is written
down again, from textbook formulas: complex Fresnel amplitudes, angles by ``asin``, the Voigt shape
as a convolution of a Lorentzian of half width ``eta s`` and a Gaussian of half width ``(1 - eta) s``
with ``s`` found by bisection. With the geometric mean the triangle is cut at the Brewster angle
too, where sqrt(F_p) has a branch point or, for k = 0, a kink.

Usage::

    python generate_shaped.py values --out shaped_values.json
    python generate_shaped.py verify
"""

from __future__ import annotations

import argparse
import itertools
import random
from pathlib import Path
from typing import Any

from generate import (
    Incidence,
    Pair,
    Panel,
    Point,
    composite,
    gauss_legendre,
    graded,
    grid,
    header,
    incidence,
    integrate,
    log_uniform,
    mp,
    produce,
    rounded,
    say,
)
from mpmath import mpf

mp.dps = 30
TOLERANCE = 1e-14
STEP, TAIL = 16, 44
SHAPES = (
    ("lorentzian", 1.0),
    ("gaussian", 1.0),
    ("voigt", 0.03),
    ("voigt", 0.3),
    ("voigt", 0.7),
    ("voigt", 0.97),
    ("cauchy", 0.6),
    ("cauchy", 0.8),
    ("cauchy", 1.3),
    ("cauchy", 2.0),
    ("cauchy", 6.0),
)
NARROWINGS = (1.0, 0.0, 0.5, 2.0)
PLACES = ("mean-sine", "geometric-mean", "mean-angle")
SIZE = 80
BETA = (0.0, 0.003, 0.4, 0.9999)


class Shape:
    """A line shape as a function of the distance in half widths."""

    def __init__(self, name: str, parameter: float) -> None:
        self.name, self.parameter = name, mp.mpf(parameter)
        if name == "voigt":
            self.scale = self.voigt_scale()
            self.peak = self.voigt(mp.mpf(0), self.scale)

    def voigt(self, u: mpf, scale: mpf) -> mpf:
        """Convolution of a Gaussian and a Lorentzian of these half widths, up to a factor."""
        sigma = (1 - self.parameter) * scale / mp.sqrt(2 * mp.log(2))
        z = mp.mpc(u, self.parameter * scale) / (sigma * mp.sqrt(2))
        return (mp.exp(-z * z) * mp.erfc(-1j * z)).real if abs(z) < 30 else continued(z).real

    def voigt_scale(self) -> mpf:
        """The scale of both half widths with which the half width of the shape is 1."""

        def excess(scale: mpf) -> mpf:
            return 2 * self.voigt(mp.mpf(1), scale) / self.voigt(mp.mpf(0), scale) - 1

        return mp.findroot(excess, (mp.mpf(1) / 2, mp.mpf(2)), solver="anderson")

    def __call__(self, u: mpf) -> mpf:
        """The shape, 1 at u = 0 and 1/2 at u = 1."""
        if self.name == "gaussian":
            return mp.power(2, -u * u)
        if self.name == "voigt":
            return self.voigt(u, self.scale) / self.peak
        nu = self.parameter if self.name == "cauchy" else mp.mpf(1)
        return (1 + (mp.power(2, 1 / nu) - 1) * u * u) ** (-nu)


def continued(z: Any) -> Any:
    """Laplace's continued fraction of w(z), for large z."""
    below = z
    for j in range(60, 0, -1):
        below = z - mp.mpf(j) / 2 / below
    return 1j / mp.sqrt(mp.pi) / below


class ShapedSurface:
    """Parameters except sigma_N0, line shape, narrowing and place of the Fresnel factor."""

    def __init__(self, point: Point) -> None:
        self.m2 = mp.mpc(point["n"], -point["k"]) ** 2
        self.rho0 = mp.mpf(point["rho0"])
        self.shape = Shape(point["shape"], point["shape_parameter"])
        self.narrowing = mp.mpf(point["narrowing"])
        self.place = point["fresnel_at"]
        self.normal = self.fresnel(mp.mpf(0), mp.mpf(1))[0]

    def fresnel(self, x: mpf, c: mpf) -> Pair:
        """Power reflectances (F_s, F_p) at an angle of this sine and cosine."""
        c_t = mp.sqrt(self.m2 - x * x)
        r_s, r_p = (c - c_t) / (c + c_t), (self.m2 * c - c_t) / (self.m2 * c + c_t)
        return abs(r_s) ** 2, abs(r_p) ** 2

    def width(self, f: mpf) -> mpf:
        """rho_q where the reflectance is ``f``."""
        return self.rho0 * ((1 - f) / (1 - self.normal)) ** self.narrowing

    def factors(self, sine: mpf, cosine: mpf, sine_i: mpf, cosine_i: mpf) -> Pair:
        """The factors F_s, F_p in front of the lobe."""
        if self.place == "geometric-mean":
            here, there = self.fresnel(sine, cosine), self.fresnel(sine_i, cosine_i)
            return mp.sqrt(here[0] * there[0]), mp.sqrt(here[1] * there[1])
        angle = (mp.atan2(sine, cosine) + mp.atan2(sine_i, cosine_i)) / 2
        return self.fresnel(mp.sin(angle), mp.cos(angle))

    def lobe(self, sine: mpf, cosine: mpf, sine_i: mpf, cosine_i: mpf) -> Pair:
        """The lobe A_q for s and p; with ``sine_i, cosine_i = 0, 1`` the lobe B_q."""
        mean = (sine + sine_i) / 2
        at_mean = self.fresnel(mean, mp.sqrt(1 - mean**2))
        front = at_mean
        if self.place != "mean-sine":
            front = self.factors(sine, cosine, sine_i, cosine_i)
        root = (cosine_i + cosine) / 2
        widths = [root * self.width(f) for f in at_mean]
        offset = abs(sine - sine_i)
        lobe_s, lobe_p = (
            f / w**2 * self.shape(offset / w) for f, w in zip(front, widths, strict=True)
        )
        return lobe_s, lobe_p

    def transverse(self, sine: mpf, cosine: mpf) -> Pair:
        """The lobe B_q for s and p."""
        return self.lobe(sine, cosine, mp.mpf(0), mp.mpf(1))


def breaks(surface: ShapedSurface, inc: Incidence) -> set[mpf]:
    """Break points that shrink towards the peak, grazing and the branch points."""
    half_pi = mp.pi / 2
    edge = min(surface.rho0, inc.cosine, mp.mpf(0.05))
    at_peak = surface.fresnel(inc.sine, inc.cosine)
    narrow = min(surface.width(f) for f in at_peak)
    found = graded(inc.angle, narrow, mp.mpf(0), half_pi) | graded(
        half_pi, edge, mp.mpf(0), half_pi
    )
    if surface.place == "geometric-mean":
        brewster = mp.atan(mp.sqrt(surface.m2))
        distance = abs(mp.im(brewster))
        for place in (mp.re(brewster), half_pi - mp.re(brewster)):
            found |= graded(place, distance, mp.mpf(0), half_pi) if distance > 1e-12 else {place}
    return found


def normalisation(surface: ShapedSurface, inc: Incidence) -> tuple[Pair, mpf]:
    """Integral of A_q B_q' over the unit disk for s and p, and how far the double step is off."""
    rule = grid(STEP, TAIL, 30)
    edges = sorted(breaks(surface, inc))
    return integrate(edges, lambda low, high: Panel(surface, inc, rule, low, high))


def record(point: Point) -> tuple[Point, float]:
    """Point with its integrals and the logarithms of its lobes, and the step difference."""
    surface, inc = ShapedSurface(point), incidence(point["theta_i_deg"])
    integrals, difference = normalisation(surface, inc)
    found = dict(point)
    along = []
    for theta_r_deg in point["theta_r_deg"]:
        turn = mp.mpf(theta_r_deg) / 180
        along.append(surface.lobe(mp.sinpi(turn), mp.cospi(turn), inc.sine, inc.cosine))
    across = [surface.transverse(mp.mpf(b), mp.sqrt(1 - mp.mpf(b) ** 2)) for b in point["beta"]]
    for i, q in enumerate("sp"):
        found[f"normalisation_integral_{q}"] = float(integrals[i])
        found[f"log_a_{q}"] = [float(mp.log(lobe[i])) for lobe in along]
        found[f"log_b_{q}"] = [float(mp.log(lobe[i])) for lobe in across]
    return found, float(difference)


def random_point(rng: random.Random, shape: tuple[str, float], narrowing: float, at: str) -> Point:
    """Seeded surface and angle for this kind of lobe."""
    k = 0.0 if rng.random() < 0.3 else log_uniform(rng, 1e-3, 4.0)
    choice = rng.random()
    theta_i_deg = 0.0 if choice < 0.15 else rng.uniform(0.0, 89.0)
    if choice > 0.75:
        theta_i_deg = 90.0 - log_uniform(rng, 0.1, 10.0)
    specular = rounded(theta_i_deg)
    return {
        "shape": shape[0],
        "shape_parameter": shape[1],
        "narrowing": narrowing,
        "fresnel_at": at,
        "n": rounded(rng.uniform(1.05, 4.0) if rng.random() < 0.7 else rng.uniform(1.05, 1.6)),
        "k": rounded(k),
        "rho0": rounded(log_uniform(rng, 1e-3, 4.0)),
        "theta_i_deg": specular,
        "theta_r_deg": [specular, 0.0, 90.0, -90.0, rounded(rng.uniform(-89.0, 89.0))],
        "beta": list(BETA),
    }


def points(seed: int) -> list[Point]:
    """Combinations of shape, narrowing and place of the factor in random order and surfaces."""
    rng = random.Random(f"shaped {seed}")
    kinds = list(itertools.product(SHAPES, NARROWINGS, PLACES))
    rng.shuffle(kinds)
    return [random_point(rng, *kind) for kind in kinds[:SIZE]]


def cartesian(surface: ShapedSurface, inc: Incidence) -> Pair:
    """The same integral, every node of the disk evaluated, on Gauss panels."""
    rule = gauss_legendre(16)
    total = [mp.mpf(0), mp.mpf(0)]
    half_pi = mp.pi / 2
    edges = breaks(surface, inc)
    both = sorted(edges | {-x for x in edges} | graded(inc.angle, mp.mpf(0.05), -half_pi, half_pi))
    for t, weight_t in composite(rule, both):
        sine, cosine = mp.sin(t), mp.cos(t)
        lobe = surface.lobe(sine, cosine, inc.sine, inc.cosine)
        rim = half_pi - abs(t)
        cuts = {x for x in edges | {half_pi - x for x in edges} if 0 < x < rim} | {mp.mpf(0), rim}
        inner = [mp.mpf(0), mp.mpf(0)]
        for s, weight_s in composite(rule, cuts):
            across = surface.transverse(mp.sin(s), mp.cos(s))
            inner = [a + weight_s * mp.cos(s) * b for a, b in zip(inner, across, strict=True)]
        for q in (0, 1):
            total[q] += 2 * weight_t * cosine * lobe[q] * inner[1 - q]
    return total[0], total[1]


def verify(args: argparse.Namespace) -> None:
    """Print the largest difference from the two-dimensional integration on every tenth point."""
    worst = 0.0
    for point in points(args.seed)[::10]:
        if point["rho0"] < 0.1 or point["theta_i_deg"] > 80.0:
            continue
        surface, inc = ShapedSurface(point), incidence(point["theta_i_deg"])
        ours, other = normalisation(surface, inc)[0], cartesian(surface, inc)
        change = max(float(abs(a / b - 1)) for a, b in zip(ours, other, strict=True))
        worst = max(worst, change)
        say(f"{change:.1e} {point['shape']} {point['narrowing']} {point['fresnel_at']}")
    say(f"largest {worst:.1e}")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Reference values of the general lobes.")
    parser.add_argument("command", choices=("values", "verify"))
    parser.add_argument("--seed", type=int, default=1027)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("shaped_values.json"))
    args = parser.parse_args()
    if args.command == "verify":
        verify(args)
        return
    made = header(args, "largest relative change of an integral when the step is doubled")
    made["generator"] = "tests/reference/generate_shaped.py"
    made["tanh_sinh_step"] = f"1/{STEP}"
    produce(points(args.seed), record, args, made)


if __name__ == "__main__":
    main()

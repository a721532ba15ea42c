"""Reference values of the four-parameter polarised BRDF model in extended precision.

The formulas are the textbook ones at 40 digits: Born and Wolf's real form of the Fresnel equations,
``1 - F`` by subtraction.  The disk integral of ``A_q(alpha) B_q'(beta)``, folded onto one quadrant
with ``alpha = +-sin t`` and ``beta = +-cos t'``, is

    4-fold sum of  integral over 0 <= t <= t' <= pi/2,

a triangle.  It is cut into panels that shrink geometrically towards the peak and the grazing end.
Off-diagonal blocks are products of tanh-sinh (double exponential) sums; the triangles on the
diagonal use the sinc indefinite integral of the same samples.  A panel is halved until the sums
with the full step and with twice the step agree.  ``verify`` compares the result with two
integrations that do not know that the integrand separates.

Usage::

    python generate.py normalisation --out normalisation_values.json
    python generate.py gradient --out gradient_values.json
    python generate.py verify
    python generate.py compare rows.json
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import multiprocessing
import random
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from operator import mul
from pathlib import Path
from typing import Any, NamedTuple

from mpmath import MPContext, mpf

mp = MPContext()
mp.dps = 40

FIXED_POINT_BITS = 132
POLARISATIONS = ("s", "p")
PARAMETERS = ("n", "k", "sigma_n0", "rho0")
STEP = 24  # the tanh-sinh step is 1 / STEP
TAIL = 58  # tanh-sinh nodes run until exp(-TAIL) from the ends of a panel
RATIO = 4  # of the lengths of successive panels
TOLERANCE = 1e-17  # on the relative difference between step and double step

Pair = tuple[mpf, mpf]
Point = dict[str, Any]


class Surface:
    """Parameters of the model except sigma_N0, with what depends on them alone."""

    def __init__(self, n: Any, k: Any, rho0: Any) -> None:
        self.n, self.k, self.rho0 = mp.mpf(n), mp.mpf(k), mp.mpf(rho0)
        self.permittivity = (self.n**2 - self.k**2, 2 * self.n * self.k)
        at_normal = self.fresnel(mp.mpf(0))
        self.width_scale = tuple(self.rho0 / (1 - f) for f in at_normal)

    def fresnel(self, x: mpf) -> Pair:
        """Power reflectances (F_s, F_p) at direction sine `x`, Born and Wolf eq. 14.2 (15)-(17)."""
        real, imag = self.permittivity
        c = mp.sqrt(1 - x * x)
        d = real - x * x
        u = mp.sqrt((mp.sqrt(d * d + imag * imag) + d) / 2)
        v = imag / (2 * u)
        f_s = ((c - u) ** 2 + v**2) / ((c + u) ** 2 + v**2)
        ec, kc = real * c, imag * c
        f_p = ((ec - u) ** 2 + (kc - v) ** 2) / ((ec + u) ** 2 + (kc + v) ** 2)
        return f_s, f_p

    def lobe(self, sine: mpf, cosine: mpf, sine_i: mpf, cosine_i: mpf) -> Pair:
        """Factor A_q of eq. (3) for s and p; with ``sine_i, cosine_i = 0, 1`` the factor B_q."""
        distance = (sine - sine_i) ** 2
        height = ((cosine_i + cosine) / 2) ** 2
        f_s, f_p = self.fresnel((sine + sine_i) / 2)
        scale_s, scale_p = self.width_scale
        return (
            f_s / (distance + height * (scale_s * (1 - f_s)) ** 2),
            f_p / (distance + height * (scale_p * (1 - f_p)) ** 2),
        )

    def transverse(self, sine: mpf, cosine: mpf) -> Pair:
        """Factor B_q of eq. (3) for s and p."""
        return self.lobe(sine, cosine, mp.mpf(0), mp.mpf(1))


class Incidence(NamedTuple):
    """Angle of incidence, radians, with its sine and cosine."""

    angle: mpf
    sine: mpf
    cosine: mpf


def incidence(theta_i_deg: float) -> Incidence:
    """Incidence of a double precision angle in degrees, taken as exact."""
    turn = mp.mpf(theta_i_deg) / 180
    return Incidence(mp.pi * turn, mp.sinpi(turn), mp.cospi(turn))


class Grid:
    """Tanh-sinh nodes and weights on (0, 1) and the sinc table of the indefinite integral."""

    def __init__(self, step: mpf, tail: int) -> None:
        half = int(mp.asinh(tail / mp.pi) / step) // 2 * 2
        u = [step * j for j in range(-half, half + 1)]
        self.nodes = [1 / (1 + mp.exp(-mp.pi * mp.sinh(x))) for x in u]
        self.weights = [
            step * mp.pi * mp.cosh(x) * y * (1 - y) for x, y in zip(u, self.nodes, strict=True)
        ]
        size = len(u)
        si = [mp.si(mp.pi * j) / mp.pi for j in range(size)]
        table = [0.5 - x for x in si[:0:-1]] + [0.5 + x for x in si]
        self.fine = [int(mp.ldexp(x, FIXED_POINT_BITS)) for x in table]
        coarse = (size + 1) // 2
        self.coarse = self.fine[size - coarse : size + coarse - 1]


@lru_cache(maxsize=4)
def grid(step: int = STEP, tail: int = TAIL, dps: int = 40) -> Grid:
    """Cached grid of step ``1 / step`` at `dps` digits."""
    with mp.workdps(dps):
        return Grid(mp.mpf(1) / step, tail)


def fixed_point(values: list[mpf]) -> tuple[list[int], int]:
    """Integers and the binary exponent that scales them back."""
    exponent = max(int(mp.frexp(x)[1]) for x in values)
    return [int(mp.ldexp(x, FIXED_POINT_BITS - exponent)) for x in values], exponent


def ordered_sum(first: list[mpf], second: list[mpf], table: list[int]) -> mpf:
    """Double integral over ``t < t'`` of weighted samples, by the sinc indefinite integral."""
    a, exponent_a = fixed_point(first)
    b, exponent_b = fixed_point(second)
    size = len(a)
    total = sum(
        x * sum(map(mul, b, table[size - 1 - i : 2 * size - 1 - i])) for i, x in enumerate(a)
    )
    return mp.ldexp(mp.mpf(total), exponent_a + exponent_b - 3 * FIXED_POINT_BITS)


class Panel:
    """Integrals over one panel of t with the full step (`a`, `b`, `t`) and the double step (`_2`).

    `a` belongs to A_q, `b` to B_q', `t` to the triangle; each is a pair for q = s and q = p.
    """

    def __init__(self, surface: Surface, inc: Incidence, rule: Grid, low: mpf, high: mpf) -> None:
        self.low, self.high = low, high
        length = high - low
        along: list[list[mpf]] = [[], []]
        across: list[list[mpf]] = [[], []]
        for y, w in zip(rule.nodes, rule.weights, strict=True):
            c, s = mp.cos_sin(low + length * y)
            forward = surface.lobe(s, c, inc.sine, inc.cosine)
            backward = surface.lobe(-s, c, inc.sine, inc.cosine)
            transverse = surface.transverse(c, s)
            for q in (0, 1):
                along[q].append((forward[q] + backward[q]) * (length * w * c))
                across[q].append(transverse[1 - q] * (length * w * s))
        self.a, self.b = ([mp.fsum(x) for x in side] for side in (along, across))
        self.a_2, self.b_2 = ([2 * mp.fsum(x[::2]) for x in side] for side in (along, across))
        pairs = list(zip(along, across, strict=True))
        self.t = [ordered_sum(a, b, rule.fine) for a, b in pairs]
        self.t_2 = [4 * ordered_sum(a[::2], b[::2], rule.coarse) for a, b in pairs]


def graded(centre: mpf, width: mpf, low: mpf, high: mpf, ratio: int = RATIO) -> set[mpf]:
    """Break points in ``[low, high]`` at geometrically growing distances from `centre`."""
    points = {low, high, centre}
    while width < high - low:
        points |= {x for x in (centre - width, centre + width) if low < x < high}
        width *= ratio
    return points


def peak_width(surface: Surface, inc: Incidence) -> mpf:
    """Half width of the narrower of the two peaks in t."""
    reflectances = surface.fresnel(inc.sine)
    return min(w * (1 - f) for w, f in zip(surface.width_scale, reflectances, strict=True))


def assemble(panels: list[Panel]) -> tuple[Pair, list[mpf]]:
    """Both disk integrals, and per panel the relative difference between the two steps."""
    differences = [mp.mpf(0)] * len(panels)
    integrals = []
    for q in (0, 1):
        tails = [mp.mpf(0)]
        for panel in reversed(panels):
            tails.append(tails[-1] + panel.b[q])
        above = tails[-2::-1]
        total = mp.fsum(x.t[q] + x.a[q] * later for x, later in zip(panels, above, strict=True))
        below = mp.mpf(0)
        for i, (x, later) in enumerate(zip(panels, above, strict=True)):
            change = abs(x.t[q] - x.t_2[q]) + abs(x.a[q] - x.a_2[q]) * later
            change += abs(x.b[q] - x.b_2[q]) * below
            differences[i] = max(differences[i], change / total)
            below += x.a[q]
        integrals.append(2 * total)
    return (integrals[0], integrals[1]), differences


def normalisation(
    surface: Surface, inc: Incidence, rule: Grid, ratio: int = RATIO
) -> tuple[Pair, mpf]:
    """Integral of A_q B_q' over the unit disk for s and p, and how far the double step is off."""
    half_pi = mp.pi / 2
    edge = min(surface.rho0, inc.cosine, mp.mpf(0.05))
    breaks = graded(inc.angle, peak_width(surface, inc), mp.mpf(0), half_pi, ratio)
    breaks |= graded(half_pi, edge, mp.mpf(0), half_pi, ratio)
    return integrate(sorted(breaks), lambda low, high: Panel(surface, inc, rule, low, high))


def integrate(edges: list[mpf], between: Callable[[mpf, mpf], Panel]) -> tuple[Pair, mpf]:
    """Sums over panels, halved until the double step changes nothing, and how far it is off."""
    panels = [between(*ends) for ends in itertools.pairwise(edges)]
    while True:
        integrals, differences = assemble(panels)
        if max(differences) < TOLERANCE:
            return integrals, max(differences)
        halved = []
        for panel, difference in zip(panels, differences, strict=True):
            if difference < TOLERANCE:
                halved.append(panel)
            else:
                middle = (panel.low + panel.high) / 2
                halved += [between(panel.low, middle), between(middle, panel.high)]
        panels = halved


def direction(theta_r_deg: float, phi_r_deg: float) -> Pair:
    """Direction cosines (alpha, beta) of angles in degrees, taken as exact."""
    polar, azimuth = mp.mpf(theta_r_deg) / 180, mp.mpf(phi_r_deg) / 180
    sine = mp.sinpi(polar)
    return sine * mp.cospi(azimuth), sine * mp.sinpi(azimuth)


def shape(surface: Surface, inc: Incidence, alpha: mpf, beta: mpf) -> Pair:
    """Product A_q B_q' of eq. (3) for s and p."""
    along = surface.lobe(alpha, mp.sqrt(1 - alpha**2), inc.sine, inc.cosine)
    across = surface.transverse(beta, mp.sqrt(1 - beta**2))
    return along[0] * across[1], along[1] * across[0]


def scattering(
    surface: Surface, inc: Incidence, sigma_n0: mpf, directions: Iterable[Pair], integrals: Pair
) -> tuple[Pair, list[Pair]]:
    """DHR pair of eq. (2) and BRDF pair of eq. (3) per direction."""
    f_s, f_p = surface.fresnel(inc.sine)
    dhr = (sigma_n0 * f_s, sigma_n0 * f_p)
    factor = (dhr[0] / integrals[0], dhr[1] / integrals[1])
    shapes = (shape(surface, inc, *cosines) for cosines in directions)
    return dhr, [(factor[0] * s, factor[1] * p) for s, p in shapes]


# ------------------------------------------------------------------------------------- points


def log_uniform(rng: random.Random, low: float, high: float) -> float:
    """Draw from a log-uniform distribution."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def rounded(value: float, digits: int = 6) -> float:
    """Double nearest to `value` written with `digits` significant digits."""
    return float(f"{value:.{digits}g}")


def random_surface(rng: random.Random) -> tuple[float, float, float]:
    """Seeded (n, k, rho0): three quarters dielectric or absorbing, one quarter metal."""
    if rng.random() < 0.25:
        n, k = rng.uniform(0.1, 1.0), log_uniform(rng, 1.0, 8.0)
    else:
        even = rng.random() < 0.5
        n = rng.uniform(1.0005, 6.0) if even else 1 + log_uniform(rng, 5e-4, 5.0)
        k = 0.0 if rng.random() < 0.3 else log_uniform(rng, 1e-6, 10.0)
    return rounded(n, 8), rounded(k), rounded(log_uniform(rng, 1e-3, 4.0))


def random_theta_i_deg(rng: random.Random) -> float:
    """Seeded angle of incidence: a fifth at zero, a few nearly zero, a fifth near grazing."""
    choice = rng.random()
    if choice < 0.2:
        return 0.0
    if choice < 0.24:
        return rounded(log_uniform(rng, 1e-6, 1.0))
    if choice < 0.44:
        return rounded(90 - log_uniform(rng, 0.05, 10.0))
    return rounded(rng.uniform(0.0, 89.95))


def random_directions(rng: random.Random, theta_i_deg: float) -> list[tuple[float, float]]:
    """Return six different directions in plane, one out of plane and one at the rim, in degrees."""
    polar = list(dict.fromkeys((theta_i_deg, 0.0 - theta_i_deg, 0.0, 90.0, -90.0)))
    while len(polar) < 6:
        polar.append(round(rng.uniform(-90.0, 90.0), 4))
    out_of_plane = (round(rng.uniform(0.0, 90.0), 4), round(rng.uniform(-180.0, 180.0), 4))
    rim = (90.0, round(rng.uniform(-180.0, 180.0), 4))
    return [*((theta, 0.0) for theta in polar), out_of_plane, rim]


def corners() -> Iterator[tuple[float, float, float, float]]:
    """Corners (n, k, rho0, theta_i_deg) of the domain, its metal box, and Brewster angles."""
    ends = ((1e-3, 4.0), (0.0, 89.95))
    for box in (((1.0005, 6.0), (0.0, 1e-6, 10.0)), ((0.1, 1.0), (1.0, 8.0))):
        yield from itertools.product(*box, *ends)
    for n, rho0 in itertools.product((1.0005, 1.5, 6.0), ends[0]):
        yield n, 0.0, rho0, math.degrees(math.atan(n))


def normalisation_points(seed: int, size: int) -> list[Point]:
    """Inputs of the corners and of `size` random points."""
    rng = random.Random(seed)
    kinds = [("corner", corner) for corner in dict.fromkeys(corners())]
    kinds += [("random", (*random_surface(rng), random_theta_i_deg(rng))) for _ in range(size)]
    points = []
    for kind, (n, k, rho0, theta_i_deg) in kinds:
        theta_r_deg, phi_r_deg = zip(*random_directions(rng, theta_i_deg), strict=True)
        points.append(
            {
                "kind": kind,
                "n": n,
                "k": k,
                "rho0": rho0,
                "sigma_n0": 0.8,
                "theta_i_deg": theta_i_deg,
                "theta_r_deg": theta_r_deg,
                "phi_r_deg": phi_r_deg,
            }
        )
    return points


def gradient_points(seed: int, size: int) -> list[Point]:
    """Inputs of `size` random points with two directions in plane and one out of plane."""
    rng = random.Random(f"gradient {seed}")
    points = []
    for _ in range(size):
        n, k, rho0 = random_surface(rng)
        theta_i_deg = random_theta_i_deg(rng)
        directions = random_directions(rng, theta_i_deg)
        theta_r_deg, phi_r_deg = zip(directions[0], *directions[5:7], strict=True)
        points.append(
            {
                "n": n,
                "k": k,
                "rho0": rho0,
                "sigma_n0": rounded(rng.uniform(0.05, 1.0)),
                "theta_i_deg": theta_i_deg,
                "theta_r_deg": theta_r_deg,
                "phi_r_deg": phi_r_deg,
            }
        )
    return points


def point_geometry(point: Point) -> tuple[Incidence, list[Pair]]:
    """Incidence and direction cosines of a point."""
    pairs = zip(point["theta_r_deg"], point["phi_r_deg"], strict=True)
    return incidence(point["theta_i_deg"]), [direction(*pair) for pair in pairs]


# ------------------------------------------------------------------------------------- values


def normalisation_record(point: Point) -> tuple[Point, float]:
    """Point with its values, and the step difference of its integral."""
    surface = Surface(point["n"], point["k"], point["rho0"])
    inc, directions = point_geometry(point)
    integrals, difference = normalisation(surface, inc, grid())
    dhr, brdf = scattering(surface, inc, mp.mpf(point["sigma_n0"]), directions, integrals)
    fresnel = surface.fresnel(inc.sine)
    record = dict(point)
    for i, q in enumerate(POLARISATIONS):
        record[f"normalisation_integral_{q}"] = float(integrals[i])
        record[f"fresnel_{q}"] = float(fresnel[i])
        record[f"dhr_{q}"] = float(dhr[i])
        record[f"brdf_{q}"] = [float(f[i]) for f in brdf]
    return record, float(difference)


def observables(point: Point, name: str, shift: mpf) -> list[mpf]:
    """ln f_s, ln f_p per direction, then DHR_s, DHR_p, with one parameter shifted."""
    values = {key: mp.mpf(point[key]) for key in PARAMETERS}
    values[name] += shift
    surface = Surface(values["n"], values["k"], values["rho0"])
    inc, directions = point_geometry(point)
    integrals, _ = normalisation(surface, inc, grid())
    dhr, brdf = scattering(surface, inc, values["sigma_n0"], directions, integrals)
    return [mp.log(f[q]) for q in (0, 1) for f in brdf] + list(dhr)


def derivative(point: Point, name: str, relative_step: float) -> tuple[list[mpf], list[mpf]]:
    """Central differences extrapolated from h and 2h, and the plain ones from h."""
    contrast = abs(mp.mpf(point["n"]) - 1) + point["k"]
    scale = {"n": min(contrast, mp.mpf(point["n"])), "k": contrast}.get(name, mp.mpf(point[name]))
    h = relative_step * scale
    plain = []
    for step in (h, 2 * h):
        up, down = observables(point, name, step), observables(point, name, -step)
        plain.append([(x - y) / (2 * step) for x, y in zip(up, down, strict=True)])
    return [(4 * x - y) / 3 for x, y in zip(*plain, strict=True)], plain[0]


def gradient_columns(point: Point, relative_step: float) -> tuple[list[list[mpf]], mpf]:
    """Derivatives by n, k, sigma_N0, rho0, and the largest relative change by extrapolation."""
    n_directions = len(point["theta_r_deg"])
    sigma = mp.mpf(point["sigma_n0"])
    inc, _ = point_geometry(point)
    fresnel = Surface(point["n"], point["k"], point["rho0"]).fresnel(inc.sine)
    columns = []
    worst = mp.mpf(0)
    for name in PARAMETERS:
        if name == "sigma_n0":
            columns.append([1 / sigma] * (2 * n_directions) + list(fresnel))
            continue
        column, plain = derivative(point, name, relative_step)
        if name == "rho0":
            column[-2:] = plain[-2:] = [mp.mpf(0), mp.mpf(0)]
        columns.append(column)
        changes = (abs(x - y) / abs(x) for x, y in zip(column, plain, strict=True) if x)
        worst = max(worst, *changes, mp.mpf(0))
    return columns, worst


def gradient_record(point: Point) -> tuple[Point, float]:
    """Point with its derivatives, and the largest relative change by the extrapolation."""
    columns, worst = gradient_columns(point, 1e-6)
    size = len(point["theta_r_deg"])
    record = dict(point)
    for i, q in enumerate(POLARISATIONS):
        rows = range(i * size, (i + 1) * size)
        record[f"d_ln_brdf_{q}"] = [[float(column[row]) for column in columns] for row in rows]
        record[f"d_dhr_{q}"] = [float(column[2 * size + i]) for column in columns]
    return record, float(worst)


# --------------------------------------------------------------------------------------- files


def as_json(value: Any) -> str:
    """Compact JSON whose floats have 17 significant digits."""
    if isinstance(value, dict):
        return "{" + ", ".join(f'"{key}": {as_json(item)}' for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(as_json(item) for item in value) + "]"
    if isinstance(value, float):
        short = repr(value)
        return short if len(short) < 12 else f"{value:.17g}"
    return json.dumps(value)


def write(path: Path, header: Point, records: list[Point]) -> None:
    """Write the header and one record a line."""
    lines = ",\n".join(as_json(record) for record in records)
    fields = "".join(f'"{key}": {as_json(value)},\n' for key, value in header.items())
    path.write_text("{\n" + fields + '"points": [\n' + lines + "\n]\n}\n", encoding="utf-8")


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def produce(
    points: list[Point],
    compute: Callable[[Point], tuple[Point, float]],
    args: argparse.Namespace,
    header: Point,
) -> None:
    """Compute all records, saving what there is every 40 points."""
    records: list[Point] = []
    worst = 0.0
    start = time.monotonic()
    with multiprocessing.Pool(args.processes) as pool:
        for record, difference in pool.imap(compute, points):
            records.append(record)
            worst = max(worst, difference)
            if len(records) % 40 == 0 or len(records) == len(points):
                write(args.out, {**header, "largest_difference": worst}, records)
                say(f"{len(records)}/{len(points)} {worst:.1e} {time.monotonic() - start:.0f} s")


def header(args: argparse.Namespace, difference: str) -> Point:
    """Provenance of a file."""
    return {
        "generator": "tests/reference/generate.py",
        "seed": args.seed,
        "digits": int(mp.dps),
        "tanh_sinh_step": f"1/{STEP}",
        "difference": difference,
    }


# ------------------------------------------------------------------------------------- checks


@lru_cache
def gauss_legendre(size: int) -> list[Pair]:
    """Nodes and weights on (0, 1), by Newton iteration on the three-term recurrence."""
    pairs = []
    for i in range(size):
        x = mp.cos(mp.pi * (i + 0.75) / (size + 0.5))
        for _ in range(8):
            below, here = mp.mpf(1), x
            for j in range(2, size + 1):
                below, here = here, ((2 * j - 1) * x * here - (j - 1) * below) / j
            slope = size * (x * here - below) / (x * x - 1)
            x -= here / slope
        pairs.append(((1 + x) / 2, 1 / ((1 - x * x) * slope**2)))
    return pairs


def composite(rule: list[Pair], breaks: Iterable[mpf]) -> Iterator[Pair]:
    """Nodes and weights of a rule repeated on every panel."""
    for low, high in itertools.pairwise(sorted(breaks)):
        for y, w in rule:
            yield low + (high - low) * y, (high - low) * w


def polar_integral(surface: Surface, inc: Incidence) -> Pair:
    """Disk integral over (theta_r, phi_r), tanh-sinh nodes in both, without separation."""
    coarse = grid(10, 46)
    rule = list(zip(coarse.nodes, coarse.weights, strict=True))
    half_pi = mp.pi / 2
    width = peak_width(surface, inc)
    totals = [mp.mpf(0), mp.mpf(0)]
    for theta, w_theta in composite(rule, graded(inc.angle, width, mp.mpf(0), half_pi, 12)):
        c, s = mp.cos_sin(theta)
        azimuths = {mp.mpf(0), half_pi, mp.pi}
        for ridge in (mp.mpf(0), mp.acos(min(1, inc.sine / s)), mp.pi):
            azimuths |= graded(ridge, width / s, mp.mpf(0), mp.pi, 12)
        for phi, w_phi in composite(rule, azimuths):
            c_phi, s_phi = mp.cos_sin(phi)
            values = shape(surface, inc, s * c_phi, s * s_phi)
            for q in (0, 1):
                totals[q] += 2 * w_theta * w_phi * s * c * values[q]
    return totals[0], totals[1]


def cartesian_integral(surface: Surface, inc: Incidence, size: int = 20) -> Pair:
    """Disk integral over the angles of alpha and beta, Gauss nodes, without separation."""
    rule = gauss_legendre(size)
    half_pi = mp.pi / 2
    edge = min(surface.rho0, inc.cosine, mp.mpf(0.05))
    outer = graded(inc.angle, peak_width(surface, inc), -half_pi, half_pi) | {mp.mpf(0)}
    outer |= graded(half_pi, edge, -half_pi, half_pi) | graded(-half_pi, edge, -half_pi, half_pi)
    totals = [mp.mpf(0), mp.mpf(0)]
    for t, w_t in composite(rule, outer):
        c_t, s_t = mp.cos_sin(t)
        for r, w_r in composite(rule, graded(mp.mpf(0), surface.rho0, mp.mpf(0), half_pi - abs(t))):
            c_r, s_r = mp.cos_sin(r)
            values = shape(surface, inc, s_t, s_r)
            for q in (0, 1):
                totals[q] += 2 * w_t * w_r * c_t * c_r * values[q]
    return totals[0], totals[1]


def relative(found: Iterable[mpf], expected: Iterable[mpf]) -> float:
    """Largest relative difference."""
    return max(float(abs(x - y) / abs(y)) for x, y in zip(found, expected, strict=True))


def prepared(point: Point) -> tuple[Surface, Incidence]:
    """Surface and incidence of a point."""
    return Surface(point["n"], point["k"], point["rho0"]), incidence(point["theta_i_deg"])


def check_polar(point: Point) -> float:
    """Relative difference from the integration in polar coordinates."""
    surface, inc = prepared(point)
    return relative(polar_integral(surface, inc), normalisation(surface, inc, grid())[0])


def check_cartesian(point: Point) -> float:
    """Relative difference from the two-dimensional Gauss integration."""
    surface, inc = prepared(point)
    return relative(cartesian_integral(surface, inc), normalisation(surface, inc, grid())[0])


def check_precision(point: Point) -> float:
    """Relative difference from 60 digits, step 1/36, other panels and a longer tail."""
    found, _ = normalisation(*prepared(point), grid())
    with mp.workdps(60):
        expected, _ = normalisation(*prepared(point), grid(36, 80, 60), ratio=7)
        return relative(found, expected)


def check_symmetry(point: Point) -> float:
    """Relative difference of the s and p integrals at normal incidence."""
    found, _ = normalisation(*prepared({**point, "theta_i_deg": 0.0}), grid())
    return relative(found[:1], found[1:])


def check_fresnel(point: Point) -> float:
    """Relative difference from the complex amplitudes ``(c - c_t) / (c + c_t)`` and so on."""
    surface, inc = prepared(point)
    m2 = mp.mpc(surface.n, -surface.k) ** 2
    c_t = mp.sqrt(m2 - inc.sine**2)
    r_s = (inc.cosine - c_t) / (inc.cosine + c_t)
    r_p = (m2 * inc.cosine - c_t) / (m2 * inc.cosine + c_t)
    return relative(surface.fresnel(inc.sine), (abs(r_s) ** 2, abs(r_p) ** 2))


def check_gradient(point: Point) -> float:
    """Relative difference of the derivatives from those with an eight times longer step."""
    found, expected = (gradient_columns(point, step)[0] for step in (1e-6, 8e-6))
    pairs = itertools.chain.from_iterable(
        zip(x, y, strict=True) for x, y in zip(found, expected, strict=True)
    )
    return max(float(abs(x - y) / abs(y)) for x, y in pairs if y)


def verify(args: argparse.Namespace) -> None:
    """Print the largest relative difference of every check."""
    points = normalisation_points(args.seed, args.size)
    extreme = [x for x in points if x["kind"] == "corner"]
    drawn = [x for x in points if x["kind"] == "random"]
    mild = [x for x in drawn if x["rho0"] > 0.3 and x["theta_i_deg"] < 75]
    hard = [x for x in drawn if x["rho0"] < 0.02 or x["theta_i_deg"] > 85]
    slopes = gradient_points(args.seed, 40)
    plan: list[tuple[str, Callable[[Point], float], list[Point]]] = [
        ("complex Fresnel amplitudes", check_fresnel, points),
        ("60 digits, other step and panels", check_precision, [*extreme[::4], *drawn[::20]]),
        ("s = p at normal incidence", check_symmetry, drawn[:20]),
        ("2-D, polar, tanh-sinh", check_polar, mild[:8]),
        ("2-D, Cartesian, Gauss", check_cartesian, [*extreme[::4], *mild[:6], *hard[:10]]),
        ("gradient, step times eight", check_gradient, slopes[::4]),
    ]
    with multiprocessing.Pool(args.processes) as pool:
        for name, check, chosen in plan:
            start = time.monotonic()
            differences = pool.map(check, chosen, chunksize=1)
            elapsed = time.monotonic() - start
            say(f"{name:34s} {len(chosen):4d} points {max(differences):.1e}  {elapsed:.0f} s")


def compare(args: argparse.Namespace) -> None:
    """Print the largest relative differences from rows of another origin.

    Each row has polarization, theta_i_deg, theta_r_deg, beta, n, k, sigma_n0, rho0,
    normalisation_integral, brdf and dhr, where ``alpha = sin(theta_r)``.
    """
    worst = dict.fromkeys(("normalisation_integral", "brdf", "dhr"), 0.0)
    integral = lru_cache(maxsize=None)(
        lambda n, k, rho0, theta: normalisation(Surface(n, k, rho0), incidence(theta), grid())[0]
    )
    for row in json.loads(args.rows.read_text(encoding="utf-8")):
        q = POLARISATIONS.index(row["polarization"])
        surface, inc = prepared(row)
        total = integral(row["n"], row["k"], row["rho0"], row["theta_i_deg"])[q]
        alpha, _ = direction(row["theta_r_deg"], 0.0)
        dhr = row["sigma_n0"] * surface.fresnel(inc.sine)[q]
        brdf = dhr * shape(surface, inc, alpha, mp.mpf(row["beta"]))[q] / total
        for key, value in zip(worst, (total, brdf, dhr), strict=True):
            worst[key] = max(worst[key], float(abs(value - row[key]) / abs(value)))
    say("  ".join(f"{key} {value:.1e}" for key, value in worst.items()))


def main() -> None:
    """Run one of the four commands."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("command", choices=("normalisation", "gradient", "verify", "compare"))
    parser.add_argument("rows", type=Path, nargs="?", help="file of rows, for compare")
    parser.add_argument("--seed", type=int, default=1027)
    parser.add_argument("--size", type=int, default=340, help="random normalisation points")
    parser.add_argument("--out", type=Path, help="default: <command>_values.json beside this file")
    parser.add_argument("--processes", type=int, default=2)
    args = parser.parse_args()
    args.out = args.out or Path(__file__).with_name(f"{args.command}_values.json")
    if args.command == "normalisation":
        points = normalisation_points(args.seed, args.size)
        about = "largest relative change of an integral when the step is doubled"
        produce(points, normalisation_record, args, header(args, about))
    elif args.command == "gradient":
        points = gradient_points(args.seed, 40)
        about = "largest relative change of a central difference by extrapolation from h and 2h"
        produce(points, gradient_record, args, {**header(args, about), "parameters": PARAMETERS})
    elif args.command == "verify":
        verify(args)
    elif args.rows is None:
        parser.error("compare needs a file of rows")
    else:
        compare(args)


if __name__ == "__main__":
    main()

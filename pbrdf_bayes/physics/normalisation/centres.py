"""Where the integrands of general lobes vary fast, and how far away their singularities are.

Centres. The places near which an integrand varies fast, each with a width: theta_i, where A has its
peak, and t = +-pi/2, where C has that of B; with the geometric mean also the Brewster angle a = Re
atan(m) at t = +-a for A and at t = +-(pi/2 - a) for C: sqrt(F_p) has branch points at the
distance b = |Im atan(m)|, for k = 0 a kink, and the root of Fresnel's equations at sin t = m, at
the distance |acos(m)| from t = +-pi/2 for A and from t = 0 for C, which is short near n = 1.
Halfway between neighbouring centres, and at the kink of |t| at t = 0, the interval is split; each
part is stretched by t = centre + width sinh v around its own centre. No width is more than the
distance of another centre and its width together.

Widths. Around theta_i and +-pi/2 they are `stretch` times the half widths of the peak: the
poles of a Cauchy peak, at 1/sqrt(2^(1/nu) - 1) half widths, are then at v = +-i pi/2 for any nu,
as those of the Lorentzian. Gaussian and Voigt peaks are entire but grow doubly exponentially off
the real axis.

Orders follow from the distance of the nearest pole in v as in `normalisation`. `pole_distance` was
calibrated on random surfaces of the whole domain against 15 digits, and checked with the values of
``tests/reference`` (``tests/physics/test_shaped_lobes.py``). It is 0.9 for Lorentzian peaks, and
0.94 - 0.04 g for a narrowing g > 1; 0.76 - 0.1 g for the Gaussian, which grows beyond Im v = pi/4,
or closer where its width changes with the angle; in between by the share of the Gaussian,
min(1, 1.5/(1 + y)) for Voigt and 0.65 (1 - 1/nu) for Cauchy with nu > 1.
"""

from __future__ import annotations

from cmath import acos
from math import atan2, log1p

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.fresnel import Surface
from pbrdf_bayes.physics.lobes.line_shapes import gaussian_share
from pbrdf_bayes.physics.lobes.shaped import Lobe

Array = NDArray[np.float64]

POLE_DISTANCE = 0.9
STEEP_POLE = 0.04
GAUSSIAN_POLE = 0.76
NARROWING_POLE = 0.1


@compiled()
def pole_distance(shaped: Lobe) -> float:
    """Distance in v of the nearest pole that the orders of all rules are made for."""
    gaussian = GAUSSIAN_POLE - NARROWING_POLE * shaped.narrowing
    lorentzian = POLE_DISTANCE - STEEP_POLE * max(shaped.narrowing - 1.0, 0.0)
    return lorentzian + gaussian_share(shaped.shape) * (gaussian - lorentzian)


@compiled()
def brewster(surf: Surface) -> tuple[float, float]:
    """Re and |Im| of atan(m), the angle [rad] at which r_p vanishes."""
    n, k = surf.n, surf.k
    below = n * n + (1.0 - k) * (1.0 - k)
    return 0.5 * atan2(2.0 * n, 1.0 - n * n - k * k), 0.25 * log1p(4.0 * k / max(below, 1e-300))


@compiled()
def grazing_branch(surf: Surface) -> float:
    """Distance [rad] from grazing of the angle whose sine is m."""
    return abs(acos(complex(surf.n, -surf.k)))


@compiled()
def add_centre(place: float, width: float, n: int, centres: Array) -> int:
    """Insert a centre into ``centres`` (3, n) so that places ascend; returns their number."""
    i = n
    while i > 0 and centres[0, i - 1] > place:
        centres[0, i] = centres[0, i - 1]
        centres[1, i] = centres[1, i - 1]
        i -= 1
    centres[0, i] = place
    centres[1, i] = width
    return n + 1


@compiled()
def compare_widths(n: int, centres: Array) -> None:
    """Widths, none more than the distance of another centre and its width together."""
    place, width = centres[0], centres[1]
    for i in range(n):
        smallest = width[i]
        for j in range(n):
            smallest = min(smallest, abs(place[i] - place[j]) + width[j])
        centres[2, i] = smallest


@compiled()
def branch_width(width: float, peak: float, digits: float) -> float:
    """The distance of a branch point; what is so close that it is a kink needs no stretching."""
    return width if width > peak * 10.0 ** (-0.5 * digits - 1.0) else 1.0

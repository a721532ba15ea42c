"""Where the mean over a detector's aperture is taken, to the accuracy of the normalisation.

    f seen = 1/(2 a) integral of f(theta) d theta over [theta_r - a, theta_r + a]

in the plane of constant phi_r; nothing comes from beyond the horizon. The range is broken at the
real part of every singularity of f within it and halved until each is `_CLEAR` half panels from the
middle of its panel; the Gauss rule is that of `quadrature.panel_split` for singularities somewhat
closer, at `_RULE`: where they are is known to the first order only.

Singularities. The lobe over alpha has its poles at the specular direction, at the half width of
the narrower of s and p there (Eq. 5), that over beta at theta = 0. The square roots end at the
horizon, the closer the more grazing the incidence; Fresnel's have a branch point at sin theta = m.
With the geometric mean F_p has one at Brewster's angle. Volume scatter and a backscatter peak are
singular about the direction back to the source.
"""

from __future__ import annotations

from cmath import asin
from math import acosh, atan2, cos, inf, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.effects.diffuse import back_cosines
from pbrdf_bayes.physics.fresnel import Surface
from pbrdf_bayes.physics.lobes.line_shapes import stretch
from pbrdf_bayes.physics.lobes.shaped import GEOMETRIC_MEAN, Lobe
from pbrdf_bayes.physics.normalisation.centres import branch_width, brewster
from pbrdf_bayes.physics.normalisation.plain import Incidence, incidence
from pbrdf_bayes.physics.normalisation.quadrature import lay_panels
from pbrdf_bayes.physics.normalisation.shaped import peak_width
from pbrdf_bayes.physics.scene import EffectValues

Array = NDArray[np.float64]

MOST_SEEN = 8192
"""Nodes that there is room for."""
_CLEAR, _RULE = 2.5, 2.0
MOST_SINGULARITIES = 24
_MOST_PANELS = 256
_MOST_IN_PANEL = 16
_NARROWEST = 1e-7
"""Half panel [rad] that is not halved any more: a kink at a break needs none."""


@compiled()
def aperture_nodes(
    theta_r: float, half: float, n: int, places: Array, digits: float, at: int, theta: Array,
    weight: Array,
) -> int:  # fmt: skip
    """Fill theta_r [rad] of the nodes and their weights from index ``at`` on; returns their end.

    The weights add up to the share of the aperture [theta_r - half, theta_r + half] that is above
    the horizon. ``places`` are the ``n`` `singularities` of the scan.
    """
    low, high = max(theta_r - half, -0.5 * pi), min(theta_r + half, 0.5 * pi)
    panels = np.empty((2, _MOST_PANELS))
    n_panels = _break_at(low, high, n, places, panels)
    while n_panels > 0:
        n_panels -= 1
        a, b = panels[0, n_panels], panels[1, n_panels]
        room = min(_MOST_PANELS, (MOST_SEEN - at) // _MOST_IN_PANEL)
        if n_panels + 2 <= room and _too_long(a, b, n, places):
            middle = 0.5 * (a + b)
            panels[1, n_panels] = middle
            panels[0, n_panels + 1], panels[1, n_panels + 1] = middle, b
            n_panels += 2
            continue
        last = lay_panels(0.0, 1.0, digits, 0.5 * _RULE, at, theta, weight)
        for i in range(at, last):
            theta[i] = a + (b - a) * theta[i]
            weight[i] *= (b - a) / (2.0 * half)
        at = last
    return at


@compiled()
def _too_long(a: float, b: float, n: int, places: Array) -> bool:
    """Whether a singularity is too close to a panel for its rule."""
    half, middle = 0.5 * (b - a), 0.5 * (a + b)
    if half < _NARROWEST:
        return False
    reach = _CLEAR * half
    for i in range(n):
        along, across = places[0, i] - middle, places[1, i]
        if along * along + across * across < reach * reach:
            return True
    return False


@compiled()
def _break_at(low: float, high: float, n: int, places: Array, panels: Array) -> int:
    """Cut [low, high] at the singularities within; returns the number of pieces."""
    n_panels, start = 0, low
    for i in range(n):
        place = places[0, i]
        if start < place < high:
            panels[0, n_panels], panels[1, n_panels] = start, place
            n_panels += 1
            start = place
    panels[0, n_panels], panels[1, n_panels] = start, high
    return n_panels + 1


@compiled()
def _add(place: float, distance: float, n: int, places: Array) -> int:
    places[0, n], places[1, n] = place, abs(distance)
    return n + 1


@compiled()
def singularities(
    theta_i: float, phi_r: float, effects: EffectValues, surf: Surface, shaped: Lobe,
    digits: float, places: Array,
) -> int:  # fmt: skip
    """Real part of each singularity in theta_r, increasing, and its distance from the real axis.

    Those of a scan: one angle of incidence and one azimuth. Returns how many there are.
    """
    n = _all_singularities(theta_i, phi_r, effects, surf, shaped, digits, places)
    order = np.argsort(places[0, :n])
    places[:, :n] = places[:, :n][:, order]
    return n


@compiled()
def _all_singularities(
    theta_i: float, phi_r: float, effects: EffectValues, surf: Surface, shaped: Lobe,
    digits: float, places: Array,
) -> int:  # fmt: skip
    inc = incidence(theta_i)
    rho = stretch(shaped.shape) * peak_width(inc, surf, shaped.narrowing)
    across = stretch(shaped.shape) * surf.rho0
    sin_phi, cos_phi = abs(sin(phi_r)), cos(phi_r)
    if sin_phi < 1e-12:
        n = _add(theta_i if cos_phi > 0.0 else -theta_i, min(rho, inc.grazing), 0, places)
    else:
        at = asin(complex(inc.sine, rho * inc.cosine) / cos_phi)
        n = _add(at.real, at.imag, 0, places)
        n = _add(0.0, across / sin_phi, n, places)
        for share in (abs(cos_phi), sin_phi):
            off = asin(complex(1.0 / max(share, 1e-12), 0.0)).imag
            n = _add(0.5 * pi, off, n, places)
            n = _add(-0.5 * pi, off, n, places)
    branch = asin(complex(surf.n, -surf.k))
    for sign in (-1.0, 1.0):
        n = _add(sign * 0.5 * pi, inc.grazing, n, places)
        n = _add(sign * branch.real, branch.imag, n, places)
    if shaped.fresnel_at == GEOMETRIC_MEAN:
        n = _of_brewster(inc, sin_phi, cos_phi, surf, digits, n, places)
    return _of_backscatter(inc, cos_phi, effects, n, places)


@compiled()
def _of_brewster(
    inc: Incidence, sin_phi: float, cos_phi: float, surf: Surface, digits: float, n: int,
    places: Array,
) -> int:  # fmt: skip
    """Branch points of sqrt(F_p) at alpha and at beta, on either side."""
    angle, distance = brewster(surf)
    distance = branch_width(distance, inc.grazing, digits)
    for share in (abs(cos_phi), sin_phi):
        if sin(angle) < share:
            at = np.arcsin(sin(angle) / share)
            off = distance * cos(angle) / (share * cos(at))
            n = _add(at, off, n, places)
            n = _add(-at, off, n, places)
    return n


@compiled()
def _of_backscatter(
    inc: Incidence, cos_phi: float, effects: EffectValues, n: int, places: Array
) -> int:
    """Where cos g, a cosine of theta_r times ``most``, makes a denominator vanish."""
    along = inc.sine * cos_phi
    most = sqrt(inc.cosine * inc.cosine + along * along)
    back = atan2(-along, inc.cosine)
    for cosine in back_cosines(effects):
        if cosine < inf:
            n = _add(back, acosh(max(cosine / most, 1.0)), n, places)
    return n

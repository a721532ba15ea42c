"""Line shapes: even functions of the distance in half widths, 1 at the centre and 1/2 at 1.

With the squared distance u^2, HWHM = 1:

    Lorentzian   1 / (1 + u^2)
    Gaussian     2^(-u^2)
    Cauchy       [1 + (2^(1/nu) - 1) u^2]^-nu             nu = 1 is the Lorentzian
    Voigt        Re w(a u + iy) / Re w(iy)                 eta = 1 the Lorentzian, 0 the Gaussian

The Voigt shape is a Gaussian and a Lorentzian convolved, whose half widths are as 1 - eta to eta:
y = eta sqrt(ln 2) / (1 - eta), and a, the place where Re w has fallen by half, is found once.

A line shape has an entry in `pbrdf_bayes.effects_table`, its code here, and a case in `line_shape`
(what depends on its parameter only) and in `log_line_shape`. The quadrature normalises any of them.
Where it has poles nearer or farther than the Lorentzian, `stretch` and `gaussian_share` say so.
"""

from __future__ import annotations

from math import expm1, sqrt
from typing import NamedTuple

import numpy as np

from pbrdf_bayes.effects_table import LINE_SHAPES
from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.elementary import log
from pbrdf_bayes.physics.lobes.faddeeva import log_real_w

LORENTZIAN, GAUSSIAN, VOIGT, CAUCHY = range(len(LINE_SHAPES))
"""Codes, in the order of the table."""

_LN2 = 0.6931471805599453
_LORENTZIAN_FROM = 1.0 - 1e-8
"""Share eta from which the Voigt shape is the Lorentzian to rounding: they differ by 1/y^2."""
_TAIL = 1e20
"""Squared distance from which a Voigt shape is 1/u^2 to rounding."""
_N_SECANT = 8


class LineShape(NamedTuple):
    """A line shape ready for use; made by `line_shape` once per parameter set."""

    code: int
    exponent: float
    """Cauchy: nu."""
    curvature: float
    """What multiplies u^2: 2^(1/nu) - 1, ln 2 or a^2."""
    damping: float
    """Voigt: y."""
    log_peak: float
    """Voigt: ln Re w(iy)."""


@compiled()
def line_shape(code: int, parameter: float) -> LineShape:
    """The line shape of this code; ``parameter`` is nu of Cauchy, eta of Voigt, else not used.

    Both ends of eta become the shapes that they are.
    """
    if code == CAUCHY:
        return LineShape(CAUCHY, float(parameter), expm1(_LN2 / parameter), 0.0, 0.0)
    if code == GAUSSIAN or (code == VOIGT and parameter <= 0.0):
        return LineShape(GAUSSIAN, 1.0, _LN2, 0.0, 0.0)
    if code == VOIGT and parameter < _LORENTZIAN_FROM:
        y = parameter * sqrt(_LN2) / (1.0 - parameter)
        log_peak = log_real_w(0.0, y)
        a = _voigt_half_width(y, log_peak)
        return LineShape(VOIGT, 1.0, a * a, y, log_peak)
    return LineShape(LORENTZIAN, 1.0, 1.0, 0.0, 0.0)


@compiled()
def _voigt_half_width(y: float, log_peak: float) -> float:
    """Where Re w(x + iy) is half of Re w(iy), by secants from the estimate of Olivero, Longbothum.

    Olivero, Longbothum, J. Quant. Spectrosc. Radiat. Transfer 17, 233 (1977),
    doi:10.1016/0022-4073(77)90161-3, is good to 0.02 %.
    """
    old = 0.5346 * y + sqrt(0.2166 * y * y + _LN2)
    new = old * (1.0 + 1e-4)
    f_old = log_real_w(old, y) - log_peak + _LN2
    for _ in range(_N_SECANT):
        f_new = log_real_w(new, y) - log_peak + _LN2
        if f_new == f_old or f_new == 0.0:
            break
        step = f_new * (new - old) / (f_new - f_old)
        old, f_old = new, f_new
        new -= step
    return new


@compiled()
def log_line_shape(u2: float, shape: LineShape) -> float:
    """Ln of the shape at the squared distance ``u2`` in half widths, from 0 to 1e300.

    The error is below 1e-12 of the shape or of its logarithm.
    """
    if shape.code == GAUSSIAN:
        return -_LN2 * u2
    if shape.code == CAUCHY:
        return -shape.exponent * log(1.0 + shape.curvature * u2)
    if shape.code == VOIGT:
        return _log_voigt(u2, shape)
    return -log(1.0 + u2)


@compiled()
def _log_voigt(u2: float, shape: LineShape) -> float:
    near = min(u2, _TAIL)
    found = log_real_w(np.sqrt(shape.curvature * near), shape.damping) - shape.log_peak
    return found - log(u2 / near) if u2 > near else found


# What the quadrature has to know, see `pbrdf_bayes.physics.normalisation.centres`.

WIDEST_STRETCH = 2.0
GAUSSIAN_STRETCH = 1.25
VOIGT_SHARE = 1.5
CAUCHY_SHARE = 0.65


@compiled()
def stretch(shape: LineShape) -> float:
    """Width of the stretching in half widths of the peak: the distance of its poles."""
    if shape.code == CAUCHY:
        return min(1.0 / sqrt(shape.curvature), WIDEST_STRETCH)
    return GAUSSIAN_STRETCH if shape.code == GAUSSIAN else 1.0


@compiled()
def gaussian_share(shape: LineShape) -> float:
    """How much it is like the Gaussian, which takes the highest orders; 0 is the Lorentzian."""
    if shape.code == LORENTZIAN:
        return 0.0
    if shape.code == VOIGT:
        return min(1.0, VOIGT_SHARE / (1.0 + shape.damping))
    if shape.code == CAUCHY:
        return CAUCHY_SHARE * max(1.0 - 1.0 / shape.exponent, 0.0)
    return 1.0

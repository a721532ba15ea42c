"""What the instrument makes of the light: angles, polariser, scale of p, offset of the DHR.

    measured_q = (1 - l) f_q + l f_q'           BRDF, times g_p for p
    measured_q = (1 - l) DHR_q + l DHR_q' + D_0

l is the leakage of the polariser, g_p the scale of p over s. The angles of the goniometer may be
off by an offset each. An offset moves a direction to the horizon at most. The mean over the
aperture of a detector is in `pbrdf_bayes.physics.aperture`.
"""

from __future__ import annotations

from math import pi

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.physics.compiled import compiled
from pbrdf_bayes.physics.elementary import log
from pbrdf_bayes.physics.hemispherical import LARGEST_THETA_I_DEG
from pbrdf_bayes.physics.scene import EffectValues

Array = NDArray[np.float64]

DEGREE = pi / 180.0
_TINIEST = 1e-280
_LARGEST_THETA_I = LARGEST_THETA_I_DEG * DEGREE


@compiled()
def is_moved(effects: EffectValues) -> bool:
    """The detector saw other directions than it stated, or a range of them."""
    offset = effects.offset_theta_i_deg != 0.0 or effects.offset_theta_r_deg != 0.0
    return offset or effects.aperture_deg > 0.0


@compiled()
def move(angles: Array, effects: EffectValues, out: Array) -> None:
    """True angles from the angles read: theta_i, theta_r, phi_r, shape (3, n) [rad]."""
    theta_i, theta_r, phi_r = out[0], out[1], out[2]
    for i in range(theta_i.size):
        incident = angles[0, i] + effects.offset_theta_i_deg * DEGREE
        scattered = angles[1, i] + effects.offset_theta_r_deg * DEGREE
        mirrored = incident < 0.0  # the same plane seen from its other side
        theta_i[i] = min(abs(incident), _LARGEST_THETA_I)
        theta_r[i] = min(max(-scattered if mirrored else scattered, -0.5 * pi), 0.5 * pi)
        phi_r[i] = angles[2, i]


@compiled()
def fill_log_readings(effects: EffectValues, f: Array, unpolarised: bool, out: Array) -> None:
    """Logarithms of s, p and, where asked for, their mean, from the BRDF (2, n) of the sample.

    The scale is that of scans through the polariser at p; an unpolarised scan is not made of one.
    """
    leak, scale = effects.leakage, effects.scale_p
    f_s, f_p = f[0], f[1]
    log_s, log_p, log_u = out[0], out[1], out[2]
    if leak > 0.0:
        for i in range(f_s.size):
            s, p = f_s[i], f_p[i]
            f_s[i] = (1.0 - leak) * s + leak * p
            f_p[i] = (1.0 - leak) * p + leak * s
    for i in range(f_s.size):
        log_s[i] = log(max(f_s[i], _TINIEST))
    for i in range(f_s.size):
        log_p[i] = log(max(scale * f_p[i], _TINIEST))
    if unpolarised:
        for i in range(f_s.size):
            log_u[i] = log(max(0.5 * (f_s[i] + f_p[i]), _TINIEST))


@compiled()
def dhr_reading(effects: EffectValues, q: int, s: float, p: float) -> float:
    """DHR [1] of polarisation ``q`` (0 s, 1 p, 2 u) as it is read, from that of the sample."""
    share = 1.0 - effects.leakage if q == 0 else effects.leakage if q == 1 else 0.5
    return share * s + (1.0 - share) * p + effects.dhr_offset

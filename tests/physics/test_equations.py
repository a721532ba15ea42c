"""The kernels held to the equations as they are printed, at many points."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from pbrdf_bayes.model.four_parameter import Parameters, brdf, dhr
from pbrdf_bayes.physics import equations
from pbrdf_bayes.physics.directions import fill_directions
from pbrdf_bayes.physics.equations import FourParameters
from pbrdf_bayes.physics.fresnel import (
    lobe_fractions,
    lobe_slopes,
    reflectances,
    surface,
    transmittances,
)
from pbrdf_bayes.physics.lobes.shaped import MEAN_SINE, lobe, shaped_log_lobes

PAINTS = [
    FourParameters(*values)
    for values in product((1.2, 1.526, 3.0), (0.0, 0.193, 2.0), (0.4528,), (0.02, 0.47, 2.0))
]
INCIDENCES = np.deg2rad([0.0, 20.0, 40.0, 60.0, 80.0])
RNG_POINTS = np.random.default_rng(5).uniform((0.0, -np.pi), (1.4, np.pi), (20, 2))
each_paint = pytest.mark.parametrize("paint", PAINTS, ids=str)


def close(found: object, wanted: object) -> None:
    """To 1e-13, or to what is left of it beside a Brewster zero."""
    np.testing.assert_allclose(found, wanted, rtol=1e-13, atol=1e-30)


@each_paint
def test_fresnel_and_the_width_of_eq_5(paint: FourParameters) -> None:
    surf = surface(*paint)
    for x in np.sin(INCIDENCES):
        c = np.sqrt(1.0 - x * x)
        close(reflectances(x, c, surf), [equations.fresnel(q, x, paint) for q in (0, 1)])
        widths = 0.25 * surf.width * np.array(transmittances(x, c, surf))
        close(widths, [equations.half_width(q, x, paint) for q in (0, 1)])


@each_paint
def test_the_lobes_of_eq_3a_and_3b(paint: FourParameters) -> None:
    """All kernels that have them: fractions, slopes, and the general lobe with a Lorentzian."""
    surf, shaped = surface(*paint), lobe(0, 1.0, 1.0, MEAN_SINE)
    theta_r, phi_r = RNG_POINTS.T
    there = np.empty((8, theta_r.size))
    for theta_i in INCIDENCES:
        fill_directions(np.full(theta_r.size, theta_i), theta_r, phi_r, there)
        alpha, beta = np.sin(theta_r) * np.cos(phi_r), np.sin(theta_r) * np.sin(phi_r)
        a = [equations.lobe_along(q, alpha, np.sin(theta_i), paint) for q in (0, 1)]
        b = [equations.lobe_across(q, beta, paint) for q in (0, 1)]
        for wanted, first in ((a, 0), (b, 4)):
            rows = there[first : first + 4].T
            found = [lobe_fractions(*row, surf, False) for row in rows]
            close(
                [[t.above_s / t.below_s, t.above_p / t.below_p] for t in found],
                np.transpose(wanted),
            )
            close([lobe_slopes(*row, surf)[:2] for row in rows], np.transpose(wanted))
            close(
                np.exp([shaped_log_lobes(*row, surf, shaped) for row in rows]), np.transpose(wanted)
            )


@pytest.mark.parametrize("paint", [p for p in PAINTS if p.rho0 > 0.1], ids=str)
def test_the_brdf_of_eq_3_to_6_and_the_dhr_of_eq_2(paint: FourParameters) -> None:
    """The integral of Eq. (4) by another rule; lobes that this rule resolves."""
    parameters = Parameters(**paint._asdict())
    theta_r, phi_r = RNG_POINTS.T
    alpha, beta = np.sin(theta_r) * np.cos(phi_r), np.sin(theta_r) * np.sin(phi_r)
    for theta_i in INCIDENCES[:4]:
        angles, alpha_i = np.rad2deg([theta_r, phi_r]), float(np.sin(theta_i))
        for q, word in enumerate("sp"):
            found = brdf(
                parameters, np.rad2deg(theta_i), angles[0], word, phi_r_deg=angles[1], rtol=1e-11
            )
            wanted = equations.brdf(q, alpha_i, alpha, beta, paint)
            np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-30)
            close(dhr(parameters, np.rad2deg(theta_i), word), equations.dhr(q, alpha_i, paint))
        found = brdf(
            parameters, np.rad2deg(theta_i), angles[0], "u", phi_r_deg=angles[1], rtol=1e-11
        )
        wanted = equations.unpolarised_brdf(alpha_i, alpha, beta, paint)
        np.testing.assert_allclose(found, wanted, rtol=1e-9)

"""Light in a port and goals are of the sample: the goniometer's effects do not count in them."""

from __future__ import annotations

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.design.candidates import Candidate
from pbrdf_bayes.design.goals import SCAN_DEG, goal_values, parse_goal
from pbrdf_bayes.design.hemispherical import hemispherical_values
from pbrdf_bayes.inference.posterior import Posterior, build_posterior
from pbrdf_bayes.model.simulate import GREEN_PAINT, simulate_measurement

OFFSET, LEAKAGE = 0.004, 0.03
READ = {
    "scale_p": 1.2, "leakage": LEAKAGE, "offset_theta_i_deg": 0.4, "offset_theta_r_deg": -0.3,
    "aperture_deg": 1.0, "dhr_offset": OFFSET,
}  # fmt: skip


@pytest.fixture(scope="module")
def posterior() -> Posterior:
    m = simulate_measurement(
        GREEN_PAINT, seed=1, theta_i_deg=(20.0,), theta_r_deg=np.arange(-60.0, 61.0, 10.0),
        dhr_theta_i_deg=(10.0,),
    )  # fmt: skip
    effects = ("scale_p", "leakage", "offset_theta_i", "offset_theta_r", "aperture", "dhr_offset")
    return build_posterior(m, pb.RunConfig(effects=effects, accuracy="reference"))


@pytest.fixture(scope="module")
def x(posterior: Posterior) -> np.ndarray:
    known = READ | dict(zip(("n", "k", "sigma_n0", "rho0"), GREEN_PAINT.as_array(), strict=True))
    return np.array([[known.get(name, 0.02) for name in posterior.parameter_names]])


def leaked(values: dict[str, float], q: str) -> float:
    other = {"s": "p", "p": "s", "u": "u"}[q]
    return (1.0 - LEAKAGE) * values[q] + LEAKAGE * values[other]


@pytest.mark.parametrize("q", ["s", "p", "u"])
def test_a_ddr_is_the_dhr_as_read_less_the_light_of_the_sample(
    posterior: Posterior, x: np.ndarray, q: str
) -> None:
    candidate = Candidate("ddr", q, 60.0, 3.0, port_deg=20.0)
    bare = {w: float(pb.ddr(GREEN_PAINT, 60.0, w, port_deg=20.0)) for w in "spu"}
    wanted = leaked(bare, q) + OFFSET
    assert hemispherical_values(posterior, candidate, x) == pytest.approx(wanted, rel=1e-5)


def test_a_dhr_keeps_offset_and_leakage(posterior: Posterior, x: np.ndarray) -> None:
    wanted = leaked({w: float(pb.dhr(GREEN_PAINT, 60.0, w)) for w in "sp"}, "p") + OFFSET
    found = hemispherical_values(posterior, Candidate("dhr", "p", 60.0, 3.0), x)
    assert found == pytest.approx(wanted, rel=1e-6)


def test_goals_are_of_the_sample(posterior: Posterior, x: np.ndarray) -> None:
    angles = np.array(SCAN_DEG)
    before = x.copy()

    def f(q: str, theta_r: object) -> np.ndarray:
        return np.log(pb.brdf(GREEN_PAINT, 60.0, theta_r, q))

    for name, wanted in (
        ("brdf:p:60:30", f("p", [30.0])),
        ("scan:p:60", f("p", angles)),
        ("ratio:60:30", f("s", [30.0]) - f("p", [30.0])),
        ("dhr:p:70", pb.dhr(GREEN_PAINT, [70.0], "p")),
    ):
        found = goal_values(posterior, parse_goal(name), x)[0]
        np.testing.assert_allclose(found, wanted, rtol=1e-5)
    np.testing.assert_array_equal(x, before)

"""The model with effects: null values, energy, limits, instrument."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pbrdf_bayes import GREEN_PAINT, DomainError, Effects, Parameters, brdf, dhr
from pbrdf_bayes.effects_table import DIFFUSE, EFFECT_PARAMETERS, FRESNEL_AT, LINE_SHAPES
from pbrdf_bayes.model.effects import effects_of_fit, scene_and_columns
from pbrdf_bayes.physics.geometry import prepare_geometry
from pbrdf_bayes.physics.hemispherical import conserves_energy
from pbrdf_bayes.physics.scattering import evaluate_with_effects

GRID = np.linspace(-90.0, 90.0, 37)


def general(effects, theta_i_deg, theta_r_deg, q, phi_r_deg=0.0, parameters=GREEN_PAINT):
    """BRDF by the general kernel, also where nothing is added."""
    theta_r = np.asarray(theta_r_deg, dtype=float)
    geometry = prepare_geometry(
        theta_i=np.full(theta_r.size, np.deg2rad(theta_i_deg)),
        theta_r=np.deg2rad(theta_r),
        phi_r=np.full(theta_r.size, np.deg2rad(phi_r_deg)),
        polarization=np.full(theta_r.size, q),
        dhr_theta_i=np.zeros(0),
        dhr_polarization=np.zeros(0, np.str_),
    )
    scene, x = scene_and_columns(effects, parameters.as_array())
    return evaluate_with_effects(geometry, scene, x, 10.0)[0][0]


@pytest.mark.parametrize("q", ["s", "p", "u"])
@pytest.mark.parametrize("phi", [0.0, 40.0])
@pytest.mark.parametrize("theta_i", [0.0, 60.0, 85.0])
@pytest.mark.parametrize("line_shape", ["lorentzian", "cauchy"])
def test_with_all_values_null_the_model_is_that_of_four_parameters(q, phi, theta_i, line_shape):
    """The strict lobes in the general kernel, and the general lobes at nu = 1."""
    found = general(Effects(line_shape=line_shape), theta_i, GRID, q, phi)
    expected = brdf(GREEN_PAINT, theta_i, GRID, q, phi_r_deg=phi, rtol=1e-10)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize(
    "effects",
    [Effects(line_shape="cauchy"), Effects(line_shape="voigt"), Effects(aperture_deg=0.0)],
)
def test_line_shapes_at_their_null_value_are_the_lorentzian(effects):
    found = general(effects, 40.0, GRID, "p")
    np.testing.assert_allclose(found, brdf(GREEN_PAINT, 40.0, GRID, "p", rtol=1e-10), rtol=1e-9)


def disk_integral(effects, theta_i_deg, q, n=120):
    """Integral of f over the unit disk by Gauss rules in the two angles, stretched at the peak."""
    x, w = np.polynomial.legendre.leggauss(n)
    theta, total = np.deg2rad(theta_i_deg), 0.0
    edges = np.array([0.0, 0.5 * theta, theta, 0.5 * (theta + 0.5 * np.pi), 0.5 * np.pi])
    phi = 90.0 * (1.0 + x)
    for a, b in pairwise(edges):
        if b <= a:
            continue
        t = 0.5 * (a + b) + 0.5 * (b - a) * x
        grid_t, grid_p = (g.ravel() for g in np.meshgrid(np.rad2deg(t), phi, indexing="ij"))
        f = brdf(GREEN_PAINT, theta_i_deg, grid_t, q, phi_r_deg=grid_p, effects=effects)
        inner = f.reshape(n, n) @ w * 0.5 * np.pi  # half of the circle
        total += 2.0 * np.sum(0.5 * (b - a) * w * np.sin(t) * np.cos(t) * inner)
    return total


@pytest.mark.parametrize("q", ["s", "p"])
@pytest.mark.parametrize(
    "effects",
    [
        Effects(lambert=0.1, volume=0.05),
        Effects(bulk=0.2, volume=0.05, asymmetry=0.7),
        Effects(backscatter=0.1, backscatter_width=0.2),
        Effects(line_shape="gaussian"),
        Effects(line_shape="cauchy", nu=0.7),
        Effects(line_shape="voigt", eta=0.4, narrowing=1.5),
        Effects(fresnel_at="geometric-mean", narrowing=0.3),
        Effects(fresnel_at="mean-angle", lambert=0.05),
    ],
)
def test_what_is_scattered_into_the_hemisphere_is_the_dhr(effects, q):
    expected = float(dhr(GREEN_PAINT, 35.0, q, effects=effects))
    assert disk_integral(effects, 35.0, q) == pytest.approx(expected, rel=2e-6)


def test_diffuse_terms_add_to_the_surface():
    alone = brdf(GREEN_PAINT, 30.0, GRID, "s")
    found = brdf(GREEN_PAINT, 30.0, GRID, "s", effects=Effects(lambert=0.3))
    np.testing.assert_allclose(found - alone, 0.3 / np.pi, rtol=1e-9)


def test_an_offset_moves_the_curve():
    moved = brdf(GREEN_PAINT, 30.0, GRID[1:-1], "s", effects=Effects(offset_theta_r_deg=0.5))
    np.testing.assert_allclose(moved, brdf(GREEN_PAINT, 30.0, GRID[1:-1] + 0.5, "s"), rtol=1e-8)
    tilted = brdf(GREEN_PAINT, 30.0, GRID, "p", effects=Effects(offset_theta_i_deg=-0.5))
    np.testing.assert_allclose(tilted, brdf(GREEN_PAINT, 29.5, GRID, "p"), rtol=1e-8)


def test_at_normal_incidence_an_offset_to_the_other_side_mirrors_the_scan():
    found = brdf(GREEN_PAINT, 0.0, GRID, "s", effects=Effects(offset_theta_i_deg=-0.5))
    np.testing.assert_allclose(found, brdf(GREEN_PAINT, 0.5, -GRID, "s"), rtol=1e-8)


def test_an_aperture_takes_scans_of_any_length():
    """Thousands of readings of one incidence, in two planes: each as it is by itself."""
    paint, effects = GREEN_PAINT, Effects(aperture_deg=1.0)
    theta_r = np.linspace(-85.0, 85.0, 1500)
    for phi_r in (0.0, 40.0):
        whole = brdf(paint, 30.0, theta_r, "p", phi_r_deg=phi_r, effects=effects)
        alone = [brdf(paint, 30.0, t, "p", phi_r_deg=phi_r, effects=effects) for t in theta_r[::50]]
        np.testing.assert_allclose(whole[::50], np.array(alone), rtol=1e-13)


@pytest.mark.parametrize("rho0", [0.3, 0.05, 0.01, 0.003, 0.001])
@pytest.mark.parametrize(("theta_i", "theta_r"), [(30.0, 29.7), (30.0, 34.0), (75.0, 74.0)])
def test_an_aperture_is_the_mean_over_what_the_detector_sees(rho0, theta_i, theta_r):
    """Lobes much narrower than the aperture too; against four thousand panels of ten points."""
    paint = Parameters(n=1.5, k=0.1, sigma_n0=0.4, rho0=rho0)
    x, w = np.polynomial.legendre.leggauss(10)
    nodes = ((np.arange(-2000, 2000)[:, None] + 0.5 + 0.5 * x) / 2000.0).ravel()
    weights = np.tile(w / 8000.0, 4000)
    for half in (0.5, 3.0):
        for q in "sp":
            found = brdf(paint, theta_i, theta_r, q, effects=Effects(aperture_deg=half))
            expected = weights @ brdf(paint, theta_i, theta_r + half * nodes, q)
            assert found == pytest.approx(expected, rel=1e-5)


def seen(paint, theta_i, theta_r, half, q, phi_r, **others):
    """Mean over the aperture by Gauss rules on panels that halve towards where f varies fast."""
    low, high = max(theta_r - half, -90.0), min(theta_r + half, 90.0)
    back = -theta_i
    brewster = np.rad2deg(np.arctan(paint.n))
    within = [a for a in (theta_i, back, 0.0, brewster, -brewster) if low < a < high]
    x, w = np.polynomial.legendre.leggauss(20)
    total, effects = 0.0, Effects(**others)
    for a, b in pairwise(sorted({low, high, *within})):
        steps = (b - a) * 0.5 ** np.arange(1.0, 18.0)
        for u, v in pairwise(np.unique([a, b, *(a + steps), *(b - steps)])):
            nodes = 0.5 * (u + v) + 0.5 * (v - u) * x
            f = brdf(paint, theta_i, nodes, q, phi_r_deg=phi_r, effects=effects, rtol=1e-12)
            total += 0.5 * (v - u) * w @ f
    return total / (2.0 * half)


SEEN = [
    ((3.0, 3.0, 0.005), 80.0, 80.0, 0.5, 0.0, {}),
    ((3.0, 3.0, 0.005), 87.0, 86.0, 3.0, 0.0, {}),
    ((1.5, 0.1, 0.05), 60.0, 88.0, 3.0, 0.0, {}),
    ((1.5, 0.1, 0.3), 87.0, 90.0, 3.0, 0.0, {}),
    ((1.5, 0.1, 0.02), 60.0, 60.0, 3.0, 20.0, {}),
    ((1.5, 0.1, 0.02), 60.0, 1.0, 3.0, 90.0, {}),
    ((1.5, 0.1, 0.01), 86.0, 87.0, 3.0, 0.0, {"narrowing": 2.0}),
    ((1.5, 0.1, 0.01), 40.0, 41.0, 3.0, 0.0, {"line_shape": "gaussian"}),
    ((1.5, 0.1, 0.01), 40.0, 41.0, 3.0, 0.0, {"line_shape": "cauchy", "nu": 6.0}),
    ((1.5, 0.0, 0.02), 50.0, 56.0, 3.0, 0.0, {"fresnel_at": "geometric-mean"}),
    ((1.5, 0.1, 0.02), 60.0, -60.0, 3.0, 0.0, {
        "volume": 0.3, "asymmetry": 0.95, "backscatter": 0.1, "backscatter_width": 0.005,
    }),
]  # fmt: skip


@pytest.mark.parametrize(("paint", "theta_i", "theta_r", "half", "phi_r", "others"), SEEN)
@pytest.mark.parametrize("q", ["s", "p"])
def test_an_aperture_reaches_the_tolerance(paint, theta_i, theta_r, half, phi_r, others, q):
    """Where Eq. (5) narrows the lobe, at grazing, at the horizon, out of plane, with other lobes.

    Beyond the horizon there is nothing.
    """
    n, k, rho0 = paint
    sample = Parameters(n=n, k=k, sigma_n0=0.3, rho0=rho0)
    expected = seen(sample, theta_i, theta_r, half, q, phi_r, **others)
    effects = Effects(aperture_deg=half, **others)
    for rtol in (1e-5, 1e-6, 1e-10):
        found = brdf(sample, theta_i, theta_r, q, phi_r_deg=phi_r, effects=effects, rtol=rtol)
        assert found == pytest.approx(expected, rel=rtol)


def test_leakage_and_scale():
    s, p = (brdf(GREEN_PAINT, 50.0, GRID, q) for q in "sp")
    effects = Effects(leakage=0.02, scale_p=1.1)
    found_s, found_p = (brdf(GREEN_PAINT, 50.0, GRID, q, effects=effects) for q in "sp")
    np.testing.assert_allclose(found_s, 0.98 * s + 0.02 * p, rtol=1e-8)
    np.testing.assert_allclose(found_p, 1.1 * (0.98 * p + 0.02 * s), rtol=1e-8)
    found_u = brdf(GREEN_PAINT, 50.0, GRID, "u", effects=effects)
    np.testing.assert_allclose(found_u, 0.5 * (s + p), rtol=1e-8)  # no polariser, no p scan
    dhr_p = dhr(GREEN_PAINT, 70.0, "p", effects=Effects(leakage=0.02, dhr_offset=0.001))
    expected = 0.98 * dhr(GREEN_PAINT, 70.0, "p") + 0.02 * dhr(GREEN_PAINT, 70.0, "s") + 0.001
    assert dhr_p == pytest.approx(expected)


def test_a_set_with_an_offset_leaves_the_next_one_where_it_was():
    theta_r = np.deg2rad(GRID)
    geometry = prepare_geometry(
        theta_i=np.full(theta_r.size, 0.5), theta_r=theta_r, phi_r=np.zeros(theta_r.size),
        polarization=np.full(theta_r.size, "s"), dhr_theta_i=np.zeros(0),
        dhr_polarization=np.zeros(0, np.str_),
    )  # fmt: skip
    both = []
    for offset in (0.5, 0.0):
        effects = Effects(line_shape="cauchy", nu=1.2, volume=0.1, offset_theta_r_deg=offset)
        scene, x = scene_and_columns(effects, GREEN_PAINT.as_array())
        both.append(x[0])
    together, _ = evaluate_with_effects(geometry, scene, np.array(both), 8.0)
    for x, found in zip(both, together, strict=True):
        alone, _ = evaluate_with_effects(geometry, scene, x[None, :], 8.0)
        np.testing.assert_array_equal(found, alone[0])


def test_dhr_rows_at_the_same_angle_are_those_of_their_own_polarisation():
    effects, theta = Effects(bulk=0.2, volume=0.1), [20.0, 70.0, 20.0]
    geometry = prepare_geometry(
        theta_i=np.zeros(0), theta_r=np.zeros(0), phi_r=np.zeros(0),
        polarization=np.zeros(0, np.str_), dhr_theta_i=np.deg2rad(theta),
        dhr_polarization=np.array(["s", "p", "p"]),
    )  # fmt: skip
    scene, x = scene_and_columns(effects, GREEN_PAINT.as_array())
    _, found = evaluate_with_effects(geometry, scene, x, 8.0)
    expected = [
        float(dhr(GREEN_PAINT, angle, q, effects=effects))
        for angle, q in zip(theta, "spp", strict=True)
    ]
    np.testing.assert_allclose(found[0], expected, rtol=1e-14)


ranges = {name: st.floats(*p.domain) for name, p in EFFECT_PARAMETERS.items()}


@given(
    values=st.fixed_dictionaries(ranges),
    shape=st.sampled_from(list(LINE_SHAPES)),
    mean=st.sampled_from(FRESNEL_AT),
    lambert=st.booleans(),
    theta_i=st.floats(0.0, 85.0),
)
@settings(max_examples=60, deadline=None)
def test_finite_and_not_negative_everywhere(values, shape, mean, lambert, theta_i):
    values["bulk" if lambert else "lambert"] = 0.0
    weak = {name: 0.1 * values[name] for name in DIFFUSE}
    effects = effects_of_fit({**values, **weak, "line_shape": shape, "fresnel_at": mean})
    for q in "spu":
        found = brdf(GREEN_PAINT, theta_i, GRID, q, effects=effects)
        assert np.all(np.isfinite(found))
        assert np.all(found >= 0.0)


@given(st.fixed_dictionaries(ranges))
@settings(max_examples=200, deadline=None)
def test_what_passes_as_conserving_energy_does(values):
    values["bulk"] = 0.0 if values["lambert"] > 0.5 else values["bulk"]
    values["lambert"] = values["lambert"] if values["bulk"] == 0.0 else 0.0
    values["dhr_offset"] = 0.0
    effects = effects_of_fit(values)
    theta = np.linspace(0.0, 89.95, 1800)
    geometry = prepare_geometry(
        theta_i=np.zeros(0), theta_r=np.zeros(0), phi_r=np.zeros(0),
        polarization=np.zeros(0, np.str_), dhr_theta_i=np.deg2rad([*theta, *theta]),
        dhr_polarization=np.repeat(["s", "p"], theta.size),
    )  # fmt: skip
    scene, x = scene_and_columns(effects, GREEN_PAINT.as_array())
    largest = evaluate_with_effects(geometry, scene, x, 8.0)[1].max()
    passes = bool(conserves_energy(scene, x)[0])
    assert passes == (largest <= 1.0)
    if passes:
        np.testing.assert_array_less(dhr(GREEN_PAINT, theta, "s", effects=effects), 1.0 + 1e-12)
    else:
        with pytest.raises(DomainError, match="reflect"):
            dhr(GREEN_PAINT, theta, "s", effects=effects)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"lambert": 1.1}, r"lambert = 1\.1 is outside its range \[0, 1\]"),
        ({"nu": float("nan")}, "nu = nan is outside"),
        ({"line_shape": "gausian"}, "Did you mean 'gaussian'"),
        ({"lambert": 0.1, "bulk": 0.1}, "alternative"),
        ({"volume": True}, "volume = True"),
    ],
)
def test_values_out_of_range_are_refused(values, words):
    with pytest.raises(DomainError, match=words):
        Effects(**values)


def test_effects_that_are_no_record_are_refused():
    with pytest.raises(DomainError, match=r"is no pb\.Effects\. Give e\.g\. pb\.Effects"):
        brdf(GREEN_PAINT, 20.0, 20.0, "s", effects={"lambert": 0.1})

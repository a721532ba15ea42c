"""What a scene gives: the public model, its sums over the hemisphere, and nothing not asked for."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pbrdf_bayes as pb
from pbrdf_bayes.analysis import load_analysis
from pbrdf_bayes.inference.prediction.bands import Targets
from pbrdf_bayes.model.effects import Effects
from pbrdf_bayes.scene import prediction as scene_prediction
from pbrdf_bayes.scene.axial import axial_quantiles, mirrored
from pbrdf_bayes.scenes import Scene
from pbrdf_bayes.workflow.prediction import predict_from_analysis

GREEN = pb.GREEN_PAINT
PLANE = tuple(np.linspace(-85.0, 85.0, 35).tolist())
THETA = tuple(np.linspace(0.0, 85.0, 18).tolist())
HALF = tuple(np.linspace(0.0, 180.0, 13).tolist())
CIRCLE = tuple(np.linspace(0.0, 345.0, 24).tolist())
ALL = ("s", "p", "u")
MIXED = Effects(line_shape="cauchy", nu=1.4, narrowing=0.6, lambert=0.03, volume=0.02)


def scene(**changes: Any) -> Scene:
    given = {"theta_i_deg": (20.0, 60.0), "theta_r_deg": PLANE, "polarizations": ALL}
    return Scene(**(given | changes))


def values(wanted: Scene, effects: Effects | None = None, parameters=GREEN) -> Any:
    return pb.predict_scene(parameters, wanted, effects=effects, rtol=1e-9)


# ------------------------------------------------------------------------------------- the numbers


@pytest.mark.parametrize(
    "effects", [None, MIXED, Effects(bulk=0.05)], ids=["none", "mixed", "bulk"]
)
@pytest.mark.parametrize("phi", [(0.0,), CIRCLE, (-170.0, -30.0, 0.0, 45.0, 270.0)])
def test_the_brdf_is_that_of_the_public_model(effects: Effects | None, phi: tuple[float, ...]):
    found = values(scene(phi_r_deg=phi), effects).brdf
    theta_r, phi_r = np.meshgrid(PLANE, phi, indexing="ij")
    for j, q in enumerate(ALL):
        for i, theta_i in enumerate((20.0, 60.0)):
            expected = pb.brdf(
                GREEN, theta_i, theta_r, q, phi_r_deg=phi_r, effects=effects, rtol=1e-9
            )
            np.testing.assert_allclose(found[j, i, :, :, 0], expected, rtol=1e-11)


def test_unpolarised_is_the_mean_of_s_and_p():
    found = values(scene(phi_r_deg=HALF, dhr_theta_i_deg=(0.0, 50.0, 89.0)), MIXED)
    for array in (found.brdf, found.dhr):
        np.testing.assert_allclose(array[2], 0.5 * (array[0] + array[1]), rtol=1e-12)


@pytest.mark.parametrize("effects", [None, MIXED], ids=["none", "mixed"])
def test_the_dhr_is_that_of_the_public_model(effects: Effects | None):
    angles = (0.0, 35.0, 80.0)
    found = values(Scene(dhr_theta_i_deg=angles, polarizations=("p", "u")), effects)
    assert found.brdf is None
    assert found.stokes is None
    for q, row in zip(("p", "u"), found.dhr[..., 0], strict=True):
        np.testing.assert_allclose(row, pb.dhr(GREEN, angles, q, effects=effects), rtol=1e-12)


def gauss(*edges: float, n: int = 40) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    x, w = np.polynomial.legendre.leggauss(n)
    pairs = list(pairwise(edges))
    nodes = [0.5 * (b + a) + 0.5 * (b - a) * x for a, b in pairs]
    return np.concatenate(nodes), np.concatenate([0.5 * (b - a) * w for a, b in pairs])


@pytest.mark.parametrize(
    "effects", [None, Effects(volume=0.05), Effects(bulk=0.1), Effects(lambert=0.05)]
)
@pytest.mark.parametrize("q", ["s", "p", "u"])
def test_over_the_hemisphere_the_brdf_integrates_to_the_dhr(effects: Effects | None, q: str):
    theta, w_theta = gauss(0.0, 40.0, 90.0)
    phi, w_phi = gauss(0.0, 30.0, 180.0)
    wanted = Scene(
        theta_i_deg=(40.0,), theta_r_deg=tuple(theta.tolist()), phi_r_deg=tuple(phi.tolist()),
        polarizations=(q,), dhr_theta_i_deg=(40.0,), stokes_incident="u",
    )  # fmt: skip
    found = values(wanted, effects)
    turn = np.deg2rad(1.0)
    weight = 2.0 * turn**2 * np.outer(w_theta * np.sin(turn * theta) * np.cos(turn * theta), w_phi)
    total = float(np.sum(weight * found.brdf[0, 0, :, :, 0]))
    assert total == pytest.approx(found.dhr[0, 0, 0], rel=1e-5)


# ------------------------------------------------------------------------------------------ Stokes


@pytest.mark.parametrize("phase", ["fresnel", "paper"])
@pytest.mark.parametrize("incident", ALL)
def test_stokes_vectors_are_those_of_the_public_function(incident: str, phase: str):
    wanted = scene(phi_r_deg=CIRCLE, stokes_incident=incident, phase=phase)
    found = values(wanted).stokes
    theta_r, phi_r = np.meshgrid(PLANE, CIRCLE, indexing="ij")
    for i, theta_i in enumerate((20.0, 60.0)):
        expected = pb.stokes(
            GREEN, theta_i, theta_r, incident, phi_r_deg=phi_r, phase=phase, rtol=1e-9
        )
        for c in range(3):
            scale = np.abs(expected[..., 0])
            error = np.abs(found[c, i, :, :, 0] - expected[..., c]) / scale
            assert error.max() < 1e-10


@pytest.mark.parametrize("effects", [None, MIXED, Effects(bulk=0.05, backscatter=0.1)])
def test_s0_of_unpolarised_light_is_the_brdf(effects: Effects | None):
    found = values(scene(phi_r_deg=HALF, stokes_incident="u"), effects)
    np.testing.assert_allclose(found.stokes[0], found.brdf[2], rtol=1e-10)
    expected = pb.degree_of_linear_polarization(np.moveaxis(found.stokes, 0, -1))
    np.testing.assert_allclose(found.dolp, expected, rtol=1e-12)


@pytest.mark.parametrize("incident", ALL)
@pytest.mark.parametrize("effects", [None, MIXED])
def test_the_angle_of_polarisation_is_that_of_the_stokes_components(incident, effects):
    """All around, the mirror images included; none where the light is unpolarised."""
    found = values(scene(phi_r_deg=CIRCLE, stokes_incident=incident), effects)
    vectors = np.moveaxis(found.stokes, 0, -1)
    expected = pb.angle_of_linear_polarization_deg(vectors)
    defined = found.dolp > 1e-12
    assert defined.any()
    np.testing.assert_array_equal(np.isnan(found.aolp_deg), ~defined)
    apart = (found.aolp_deg - expected)[defined]
    np.testing.assert_allclose(np.mod(apart + 90.0, 180.0) - 90.0, 0.0, atol=1e-6)
    assert found.aolp_deg[defined].max() <= 90.0
    assert found.aolp_deg[defined].min() > -90.0


def test_depolarised_light_has_no_angle():
    found = values(scene(phi_r_deg=HALF, stokes_incident="s", depolarisation=1.0))
    assert np.isnan(found.aolp_deg).all()
    assert (found.dolp == 0.0).all()


@pytest.mark.parametrize("centre", [0.0, 44.0, 89.0, -90.0])
def test_a_band_of_angles_does_not_see_where_they_are_cut(centre: float):
    """The band of draws about any axis is that about 0, turned."""
    draws = 12.0 * np.random.default_rng(2).standard_normal((400, 7))
    plain = np.moveaxis(np.quantile(draws, scene_prediction.QUANTILES, axis=0), 0, -1)
    turned = np.mod(draws + centre + 90.0, 180.0) - 90.0
    found = axial_quantiles(turned, scene_prediction.QUANTILES)
    np.testing.assert_allclose(np.diff(found), np.diff(plain), atol=1e-9)
    apart = found - plain - centre
    np.testing.assert_allclose(apart, 180.0 * np.round(apart / 180.0), atol=1e-9)
    assert ((found[:, 1] > -90.0) & (found[:, 1] <= 90.0)).all()
    back = mirrored(mirrored(found, 1), 1)
    np.testing.assert_allclose(back, found, atol=1e-9)


@pytest.mark.parametrize("incident", ALL)
def test_lambertian_light_is_added_unpolarised(incident: str):
    """And the surface is as it is without it."""
    wanted = scene(phi_r_deg=HALF, stokes_incident=incident)
    bare, found = values(wanted).stokes, values(wanted, Effects(lambert=0.2)).stokes
    np.testing.assert_allclose(found[0] - bare[0], 0.2 / np.pi, rtol=1e-9)
    np.testing.assert_allclose(found[1:], bare[1:], rtol=1e-7, atol=1e-12)


def transmittances(theta_deg: Any, n: complex) -> tuple[Any, Any]:
    """1 - R of Fresnel's formulas, in complex numbers."""
    c = np.cos(np.deg2rad(theta_deg))
    root = np.sqrt(n**2 - 1.0 + c**2 + 0j)
    r_s, r_p = (c - root) / (c + root), (n**2 * c - root) / (n**2 * c + root)
    return 1.0 - np.abs(r_s) ** 2, 1.0 - np.abs(r_p) ** 2


@pytest.mark.parametrize("incident", ALL)
def test_bulk_light_is_polarised_by_the_surface_that_it_leaves_through(incident: str):
    """A sample without surface reflection, against Fresnel's formulas."""
    dull = pb.Parameters(n=1.6, k=0.05, sigma_n0=0.0, rho0=0.3)
    found = values(
        scene(phi_r_deg=HALF, theta_r_deg=THETA, stokes_incident=incident), Effects(bulk=0.4), dull
    ).stokes[..., 0]
    out_s, out_p = transmittances(THETA, 1.6 - 0.05j)
    for i, theta_i in enumerate((20.0, 60.0)):
        t_s, t_p = transmittances(theta_i, 1.6 - 0.05j)
        entered = {"s": t_s, "p": t_p, "u": 0.5 * (t_s + t_p)}[incident]
        common = 0.4 / np.pi * entered / transmittances(0.0, 1.6 - 0.05j)[0] ** 2
        expected_s0 = common * 0.5 * (out_s + out_p)
        expected_s1 = common * 0.5 * (out_s - out_p)
        for column in range(len(HALF)):
            np.testing.assert_allclose(found[0, i, :, column], expected_s0, rtol=1e-9)
            np.testing.assert_allclose(found[1, i, :, column], expected_s1, rtol=1e-9, atol=1e-15)
        assert np.abs(found[2, i]).max() < 1e-15


@pytest.mark.parametrize("effects", [MIXED, Effects(bulk=0.3, volume=0.1)])
def test_no_more_light_is_polarised_than_there_is(effects: Effects):
    for incident in ALL:
        found = values(scene(phi_r_deg=CIRCLE, stokes_incident=incident), effects)
        assert found.dolp.max() <= 1.0 + 1e-12
        assert found.stokes[0].min() > 0.0


def test_depolarisation_takes_its_share_and_nothing_at_null():
    wanted = {"phi_r_deg": HALF, "stokes_incident": "p"}
    full = values(scene(**wanted)).stokes
    assert np.array_equal(full, values(scene(**wanted, depolarisation=0.0)).stokes)
    less = values(scene(**wanted, depolarisation=0.25)).stokes
    np.testing.assert_array_equal(less[0], full[0])
    np.testing.assert_allclose(less[1:], 0.75 * full[1:], rtol=1e-14)


def test_the_other_half_is_the_mirror_image():
    found = values(scene(phi_r_deg=(-50.0, 50.0), theta_r_deg=THETA, stokes_incident="s"))
    np.testing.assert_array_equal(found.brdf[..., 0, :], found.brdf[..., 1, :])
    signs = np.array([1.0, 1.0, -1.0])[:, None, None, None]
    np.testing.assert_array_equal(found.stokes[..., 0, :], signs * found.stokes[..., 1, :])


# --------------------------------------------------------------------------------------- the bands


def test_bands_of_a_run_are_those_of_the_curves(finished_run):
    """The same draws as without a scene; median and 90 % band of the model."""
    analysis = load_analysis(finished_run)
    found = pb.predict_scene(
        analysis, scene(polarizations=("s", "u"), dhr_theta_i_deg=(10.0, 70.0), stokes_incident="u")
    )
    for j, q in enumerate(("s", "u")):
        n = len(PLANE)
        targets = Targets(np.full(n, q), np.full(n, 60.0), np.array(PLANE), np.zeros(n))
        bands = predict_from_analysis(analysis, targets)
        np.testing.assert_allclose(found.brdf[j, 1, :, 0], bands.model[:, [0, 2, 4]], rtol=1e-9)
        dhr = predict_from_analysis(
            analysis,
            Targets(np.full(2, q), np.array([10.0, 70.0]), np.full(2, np.nan), np.zeros(2)),
        )
        np.testing.assert_allclose(found.dhr[j], dhr.model[:, [0, 2, 4]], rtol=1e-9)
    np.testing.assert_allclose(found.stokes[0], found.brdf[1], rtol=1e-9)
    for array in (found.brdf, found.dhr, found.stokes, found.dolp, found.aolp_deg):
        assert (np.diff(array, axis=-1) >= 0.0).all()


@pytest.mark.parametrize("n_draws", [2, 10, 41, 400])
def test_quantiles_are_those_of_numpy(n_draws: int):
    draws = np.random.default_rng(1).lognormal(size=(n_draws, 3, 5))
    draws[1, 0, 0] = np.nan
    expected = np.moveaxis(np.quantile(draws, scene_prediction.QUANTILES, axis=0), 0, -1)
    np.testing.assert_allclose(scene_prediction._quantiles(draws), expected, rtol=1e-13)


def test_blocks_change_nothing(finished_run, monkeypatch: pytest.MonkeyPatch):
    analysis = load_analysis(finished_run)
    wanted = scene(phi_r_deg=HALF, theta_r_deg=THETA, stokes_incident="s", n_draws=20)
    whole = pb.predict_scene(analysis, wanted)
    monkeypatch.setattr(scene_prediction, "_MOST_VALUES", 20 * 3 * 31)
    parts = pb.predict_scene(analysis, wanted)
    for name in ("brdf", "stokes", "dolp", "aolp_deg"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), rtol=1e-12)


# -------------------------------------------------------------------- what is not asked for is left


class Work:
    """What the kernels were asked for: lobes, norms, rows of BRDF and DHR, calls of each kernel."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.lobes = self.norms = self.rows = self.dhr_rows = 0
        self.calls = {
            "evaluate": 0,
            "evaluate_with_effects": 0,
            "phase_cosine": 0,
            "stokes": 0,
            "second": 0,
        }
        for name in ("evaluate", "evaluate_with_effects"):
            monkeypatch.setattr(scene_prediction, name, self._counted(name))
        from pbrdf_bayes.physics import scene_stokes

        for name, key in (
            ("phase_cosine", "phase_cosine"),
            ("unpolarised_column", "stokes"),
            ("polarised_column", "second"),
        ):
            monkeypatch.setattr(scene_stokes, name, self._called(getattr(scene_stokes, name), key))

    def _called(self, function: Any, key: str) -> Any:
        def counting(*arguments: Any) -> Any:
            self.calls[key] += 1
            return function(*arguments)

        return counting

    def _counted(self, name: str) -> Any:
        kernel = getattr(scene_prediction, name)

        def counting(geometry: Any, *rest: Any) -> Any:
            self.calls[name] += 1
            sizes = np.diff(geometry.start)
            self.lobes += int(np.sum(np.where(geometry.in_plane, 1, 2) * sizes))
            self.norms += sizes.size
            self.rows += geometry.row_direction.size
            self.dhr_rows += geometry.dhr_sine.size
            return kernel(geometry, *rest)

        return counting


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch):
    def of(wanted: Scene, effects: Effects | None = None) -> Work:
        with monkeypatch.context() as patch:
            counted = Work(patch)
            pb.predict_scene(GREEN, wanted, effects=effects)
        return counted

    return of


def test_one_polarisation_has_half_the_rows_of_two(work):
    one, two, three = (work(scene(polarizations=ALL[:n])) for n in (1, 2, 3))
    assert (one.rows, two.rows, three.rows) == (70, 140, 210)
    assert work(scene(polarizations=("u",))).rows == 70
    assert one.lobes == two.lobes == three.lobes == 70  # s and p share them


def test_in_plane_a_direction_takes_one_lobe_and_out_of_plane_two(work):
    assert work(scene()).lobes == 70
    assert work(scene(phi_r_deg=(40.0,))).lobes == 140
    assert work(scene(phi_r_deg=(0.0, 180.0))).lobes == 70  # the same plane, to and fro


def test_the_mirror_image_is_not_computed(work):
    half = work(scene(theta_r_deg=THETA, phi_r_deg=HALF))
    whole = work(scene(theta_r_deg=THETA, phi_r_deg=CIRCLE))
    assert (half.lobes, half.rows, half.norms) == (whole.lobes, whole.rows, whole.norms)
    assert half.norms == 2


def test_without_dhr_there_is_none_and_without_directions_no_norm(work):
    assert work(scene()).dhr_rows == 0
    assert work(scene(dhr_theta_i_deg=(10.0, 20.0))).dhr_rows == 6
    only = work(Scene(dhr_theta_i_deg=(10.0, 20.0), polarizations=("s",)))
    assert (only.dhr_rows, only.rows, only.lobes, only.norms) == (2, 0, 0, 0)


def test_stokes_components_cost_only_those_who_ask(work):
    without = work(scene(polarizations=("s", "p")))
    asked = work(scene(polarizations=("s", "p"), stokes_incident="u"))
    assert without.calls["stokes"] == 0
    assert (asked.lobes, asked.rows) == (without.lobes, without.rows)
    assert asked.calls["stokes"] == 2
    assert asked.calls["phase_cosine"] == asked.calls["second"] == 0
    assert work(scene(stokes_incident="s")).calls["phase_cosine"] == 2
    assert work(scene(stokes_incident="s", phase="paper")).calls["phase_cosine"] == 0


def test_effects_that_do_nothing_are_not_computed(work):
    """Null values and those of the instrument leave the kernel of the four parameters."""
    null = Effects(asymmetry=0.45, leakage=0.01, offset_theta_r_deg=0.1)
    assert work(scene(), null).calls["evaluate_with_effects"] == 0
    assert work(scene(instrument=True), null).calls["evaluate"] == 0
    assert work(scene(), Effects(lambert=0.01)).calls["evaluate"] == 0
    once, twice = (
        work(scene(stokes_incident="u"), e) for e in (Effects(narrowing=0.5), Effects(lambert=0.1))
    )
    assert twice.lobes == 2 * once.lobes  # diffuse terms: once with, once without them


# ------------------------------------------------------------------------------------- the request


def test_effects_of_the_scene_go_on_top():
    given = Effects(lambert=0.5, volume=0.02)
    wanted = scene(effects={"lambert": 0.03, "line_shape": "cauchy", "nu": 1.4, "narrowing": 0.6})
    np.testing.assert_array_equal(values(wanted, given).brdf, values(scene(), MIXED).brdf)


def test_the_instrument_is_there_when_asked_for():
    leaky = Effects(leakage=0.05, offset_theta_r_deg=0.5)
    with_it = values(scene(instrument=True), leaky).brdf[0, 0, :, 0, 0]
    np.testing.assert_allclose(
        with_it, pb.brdf(GREEN, 20.0, PLANE, "s", effects=leaky, rtol=1e-9), rtol=1e-11
    )
    np.testing.assert_array_equal(values(scene(), leaky).brdf, values(scene()).brdf)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"theta_i_deg": (20.0, 95.0)}, r"theta_i_deg = 95\.0 .* \[0, 89\.95\]"),
        (
            {"theta_r_deg": (float("nan"),)},
            r"theta_r_deg: nan is not a finite number: give degrees",
        ),
        ({"dhr_theta_i_deg": (-5.0,)}, r"dhr_theta_i_deg = -5\.0 .* \[0, 89\.95\]"),
        ({"effects": {"lambrt": 0.1}}, r"effects\.lambrt is not known\. Did you mean 'lambert'"),
        ({"effects": {"leakage": 0.01}}, r"effects\.leakage .* instrument = true"),
        ({"effects": {"lambert": 2.0}}, r"lambert = 2\.0 is outside its range \[0, 1\]"),
    ],
)
def test_what_a_scene_may_not_ask_for(changes: dict[str, Any], message: str):
    with pytest.raises((pb.ConfigError, pb.DomainError), match=message):
        values(scene(**changes))


def test_a_run_has_its_own_effects(finished_run):
    with pytest.raises(pb.ConfigError, match="a run has its own"):
        pb.predict_scene(load_analysis(finished_run), scene(effects={"lambert": 0.1}))

"""The plugin and the .pbsdf in Mitsuba itself, against the model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.mitsuba import register
from pbrdf_bayes.workflow import export_grids

GREEN = pb.GREEN_PAINT
PLUGIN = {"type": "pbrdf", "n": 1.526, "k": 0.193, "sigma_n0": 0.4528, "rho0": 0.47}
DIRECTIONS = [(30.0, 30.001, 0.0), (60.0, 30.0, 0.0), (20.0, 50.0, 180.0), (40.0, 50.0, 60.0),
              (60.0, 70.0, 15.0), (50.0, 20.0, -110.0)]  # fmt: skip


@pytest.fixture(scope="module")
def mi() -> Any:
    mitsuba = pytest.importorskip("mitsuba", reason="mitsuba is not installed")
    mitsuba.set_variant("scalar_spectral_polarized")
    register()
    return mitsuba


@pytest.fixture(scope="module")
def pbsdf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An eighth of the size that is allowed, to be quick."""
    path = tmp_path_factory.mktemp("pbsdf") / "green.pbsdf"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(export_grids, "MOST_BYTES", 8 * 2**20)
        return pb.export_brdf(GREEN, path, format="mitsuba").paths[0]


def direction(theta_deg, phi_deg):
    theta, phi = np.deg2rad([theta_deg, phi_deg])
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


def seen_at(mi, vector):
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*vector.tolist())
    si.wavelengths = [550.0] * 4
    return si


def in_frames_of_the_model(mi, bsdf, theta_i, theta_r, phi_r):
    """BRDF matrix (4, 4) between the planes of incidence and of reflection."""
    light, viewer = direction(theta_i, 180.0), direction(theta_r, phi_r)
    wo, wi = mi.Vector3f(*light.tolist()), mi.Vector3f(*viewer.tolist())
    value = bsdf.eval(mi.BSDFContext(), seen_at(mi, viewer), wo)
    s_i = mi.Vector3f(0, 1, 0)
    phi = np.deg2rad(phi_r)
    s_r = mi.Vector3f(float(-np.sin(phi)), float(np.cos(phi)), 0)
    turned = mi.mueller.rotate_mueller_basis(
        value, -wo, mi.mueller.stokes_basis(-wo), s_i, wi, mi.mueller.stokes_basis(wi), s_r
    )
    return np.array(turned)[:, :, 0] / light[2]


@pytest.mark.parametrize(("theta_i", "theta_r", "phi_r"), DIRECTIONS)
def test_the_plugin_is_the_model(mi, theta_i, theta_r, phi_r):
    found = in_frames_of_the_model(mi, mi.load_dict(PLUGIN), theta_i, theta_r, phi_r)
    wanted = pb.mueller(GREEN, theta_i, theta_r, phi_r_deg=phi_r)
    np.testing.assert_allclose(found[:3, :3], wanted, atol=3e-5 * wanted[0, 0])


@pytest.mark.parametrize(("theta_i", "theta_r", "phi_r"), DIRECTIONS)
def test_the_pbsdf_is_the_model_to_interpolation(mi, pbsdf, theta_i, theta_r, phi_r):
    loaded = mi.load_dict(
        {"type": "measured_polarized", "filename": str(pbsdf), "alpha_sample": 0.3}
    )
    found = in_frames_of_the_model(mi, loaded, theta_i, theta_r, phi_r)
    wanted = pb.mueller(GREEN, theta_i, theta_r, phi_r_deg=phi_r)
    np.testing.assert_allclose(found[:3, :3], wanted, atol=0.03 * wanted[0, 0])


def furnace(mi, bsdf, theta_i, *, importance, n=1500):
    """Mean and its standard error of the weights of `sample`: reflected share of a white sky."""
    mode = mi.TransportMode.Importance if importance else mi.TransportMode.Radiance
    si, context = seen_at(mi, direction(theta_i, 0.0)), mi.BSDFContext(mode)
    uniform = np.random.default_rng(1).random((n, 3)).tolist()
    weights = [
        np.ravel(np.array(bsdf.sample(context, si, a, mi.Point2f(b, c))[1]))[0]
        for a, b, c in uniform
    ]
    return float(np.mean(weights)), float(np.std(weights) / n**0.5)


@pytest.mark.parametrize("theta_i", [10.0, 60.0])
def test_light_of_one_direction_leaves_with_the_dhr(mi, theta_i):
    mean, u = furnace(mi, mi.load_dict(PLUGIN), theta_i, importance=True)
    assert mean == pytest.approx(float(pb.dhr(GREEN, theta_i, "u")), abs=4.0 * u)
    assert u < 0.05 * mean


def test_the_density_is_that_of_the_samples(mi):
    """Its integral is the share of samples above the horizon, in ten parts of the hemisphere."""
    bsdf = mi.load_dict(PLUGIN | {"rho0": 0.3})
    si, context = seen_at(mi, direction(40.0, 0.0)), mi.BSDFContext()
    rng = np.random.default_rng(2)
    n = 2000
    drawn = [
        bsdf.sample(context, si, a, mi.Point2f(b, c))[0] for a, b, c in rng.random((n, 3)).tolist()
    ]
    kept = [sample for sample in drawn if sample.pdf > 0.0]
    assert all(
        sample.pdf == pytest.approx(bsdf.pdf(context, si, sample.wo), rel=1e-4) for sample in kept
    )
    z, phi = np.meshgrid((np.arange(40) + 0.5) / 40, (np.arange(40) + 0.5) * np.pi / 20)
    density = [
        bsdf.pdf(context, si, mi.Vector3f(*v))
        for v in np.stack(
            [np.sqrt(1 - z**2) * np.cos(phi), np.sqrt(1 - z**2) * np.sin(phi), z], -1
        ).reshape(-1, 3).tolist()
    ]  # fmt: skip
    share = np.array(density) * 2.0 * np.pi / len(density)
    side = np.array([[v.wo.x > 0, v.wo.z] for v in kept])
    part = np.minimum((side[:, 1] * 5).astype(int), 4) + 5 * side[:, 0].astype(int)
    of_grid = np.minimum((z.ravel() * 5).astype(int), 4) + 5 * (np.cos(phi.ravel()) > 0)
    counts = np.bincount(part, minlength=10)
    expected = n * np.bincount(of_grid, share, minlength=10)
    chi2 = np.sum((counts - expected) ** 2 / expected)
    assert chi2 < 35.0  # 1e-4 of ten degrees of freedom


def test_an_integrator_in_a_white_sky(mi):
    """Radiance towards the camera is that of the model under light from everywhere."""
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct", "emitter_samples": 0, "bsdf_samples": 1},
            "plate": {"type": "rectangle", "bsdf": PLUGIN},
            "sky": {"type": "constant", "radiance": {"type": "uniform", "value": 1.0}},
            "sensor": {
                "type": "distant", "direction": [-0.5, 0.0, -np.cos(np.pi / 6)],
                "target": [0.0, 0.0, 0.0],
                "film": {"type": "hdrfilm", "width": 1, "height": 1, "pixel_format": "luminance",
                         "rfilter": {"type": "box"}},
                "sampler": {"type": "independent", "sample_count": 2000},
            },
        }
    )  # fmt: skip
    found = float(np.ravel(np.array(mi.render(scene)))[0])
    x, weights = np.polynomial.legendre.leggauss(64)
    theta = np.minimum((x + 1) * np.pi / 4, np.deg2rad(89.9))
    phi = (np.arange(64) + 0.5) * 180.0 / 64
    of_light = pb.brdf(GREEN, np.rad2deg(theta)[:, None], 30.0, "u", phi_r_deg=phi)
    sky = np.sum(
        weights * np.pi / 4 * np.sin(theta) * np.cos(theta) * of_light.mean(axis=1) * 2.0 * np.pi
    )
    assert found == pytest.approx(sky, rel=0.06)


def test_variants_without_polarisation(mi):
    mi.set_variant("scalar_rgb")
    try:
        register()
        bsdf = mi.load_dict(PLUGIN)
        light, viewer = direction(60.0, 180.0), direction(40.0, 20.0)
        si = mi.SurfaceInteraction3f()
        si.wi = mi.Vector3f(*viewer.tolist())
        value = np.array(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(*light.tolist())))
        wanted = pb.brdf(GREEN, 60.0, 40.0, "u", phi_r_deg=20.0) * 0.5
        np.testing.assert_allclose(value, wanted, rtol=1e-5)
        mi.set_variant("llvm_ad_rgb")
    except ImportError:  # this variant needs LLVM
        return
    else:
        with pytest.raises(pb.ConfigError, match="llvm_ad_rgb"):
            register()
    finally:
        mi.set_variant("scalar_spectral_polarized")


def test_effects_and_missing_parameters(mi):
    bsdf = mi.load_dict(PLUGIN | {"lambert": 0.02})
    found = in_frames_of_the_model(mi, bsdf, 40.0, 20.0, 60.0)
    wanted = pb.mueller(GREEN, 40.0, 20.0, phi_r_deg=60.0, effects=pb.Effects(lambert=0.02))
    np.testing.assert_allclose(found[:3, :3], wanted, atol=3e-5 * wanted[0, 0])
    with pytest.raises((pb.ConfigError, RuntimeError), match="rho0"):
        mi.load_dict({name: value for name, value in PLUGIN.items() if name != "rho0"})

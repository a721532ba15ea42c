"""Mueller matrix and Stokes vectors of a sample that scatters below its surface as well."""

from __future__ import annotations

import numpy as np
import pytest

import pbrdf_bayes as pb

GREEN = pb.GREEN_PAINT
THETA = np.linspace(-80.0, 80.0, 9)
PHI = np.array([0.0, 25.0, 90.0, 135.0])
GRID = np.meshgrid(THETA, PHI, indexing="ij")
EFFECTS = {
    "shape": pb.Effects(line_shape="cauchy", nu=1.4, narrowing=0.6),
    "lambert": pb.Effects(lambert=0.1),
    "bulk": pb.Effects(bulk=0.2),
    "mixed": pb.Effects(line_shape="voigt", eta=0.6, bulk=0.1, volume=0.03, asymmetry=0.3,
                        backscatter=0.05, backscatter_width=0.1),
}  # fmt: skip
named = pytest.mark.parametrize("effects", EFFECTS.values(), ids=EFFECTS)


@named
@pytest.mark.parametrize("incident", ["s", "p", "u"])
@pytest.mark.parametrize("phase", ["fresnel", "paper"])
def test_stokes_vectors_are_those_of_a_scene(effects, incident: str, phase: str) -> None:
    wanted = pb.Scene(
        theta_i_deg=(20.0, 60.0), theta_r_deg=tuple(THETA), phi_r_deg=tuple(PHI),
        stokes_incident=incident, phase=phase, depolarisation=0.2,
    )  # fmt: skip
    scene = pb.predict_scene(GREEN, wanted, effects=effects).stokes
    found = pb.stokes(
        GREEN, np.array([20.0, 60.0])[:, None, None], GRID[0], incident, phi_r_deg=GRID[1],
        phase=phase, depolarisation=0.2, effects=effects,
    )  # fmt: skip
    scale = found[..., 0].max()
    np.testing.assert_allclose(
        np.moveaxis(found, -1, 0), scene[..., 0], rtol=1e-10, atol=1e-13 * scale
    )


@named
def test_a_blind_detector_reads_the_brdf(effects) -> None:
    """S0 of unpolarised light everywhere; of s and p light in the plane of incidence."""
    for q, phi in (("u", GRID[1]), ("s", 0.0), ("p", 0.0)):
        at = {"phi_r_deg": phi, "effects": effects}
        found = pb.stokes(GREEN, 40.0, GRID[0], q, **at)[..., 0]
        np.testing.assert_allclose(found, pb.brdf(GREEN, 40.0, GRID[0], q, **at), rtol=1e-12)


@named
def test_no_light_comes_out_that_cannot_be(effects) -> None:
    """S0 >= |(S1, S2)| for linearly polarised light of every direction, and what is between."""
    matrix = pb.mueller(GREEN, 50.0, GRID[0], phi_r_deg=GRID[1], effects=effects)
    for share in (0.0, 0.5, 1.0):
        for angle in np.linspace(0.0, np.pi, 9):
            given = np.array([1.0, share * np.cos(2 * angle), share * np.sin(2 * angle)])
            s0, s1, s2 = np.moveaxis(matrix @ given, -1, 0)
            assert (np.hypot(s1, s2) <= s0 * (1.0 + 1e-12)).all()


def test_lambertian_light_has_no_polarisation_and_adds_its_albedo_over_pi() -> None:
    at = (40.0, GRID[0])
    added = pb.mueller(GREEN, *at, phi_r_deg=GRID[1], effects=pb.Effects(lambert=0.1))
    added -= pb.mueller(GREEN, *at, phi_r_deg=GRID[1])
    wanted = np.zeros((3, 3))
    wanted[0, 0] = 0.1 / np.pi
    np.testing.assert_allclose(added, np.broadcast_to(wanted, added.shape), atol=1e-14)


def test_bulk_light_leaves_polarised_by_the_transmittances() -> None:
    """DoLP (T_p - T_s)/(T_p + T_s) in the meridian plane, along p, by Fresnel's laws."""
    black = pb.Parameters(n=1.5, k=0.0, sigma_n0=1e-9, rho0=0.3)
    theta = np.array([0.0, 30.0, 60.0, 80.0])
    found = pb.stokes(black, 20.0, theta, "u", phi_r_deg=70.0, effects=pb.Effects(bulk=0.5))
    cosine = np.cos(np.deg2rad(theta))
    inside = np.sqrt(1.5**2 - np.sin(np.deg2rad(theta)) ** 2)
    t_s = 1.0 - ((cosine - inside) / (cosine + inside)) ** 2
    t_p = 1.0 - ((2.25 * cosine - inside) / (2.25 * cosine + inside)) ** 2
    np.testing.assert_allclose(found[:, 1] / found[:, 0], (t_s - t_p) / (t_s + t_p), atol=1e-6)
    np.testing.assert_allclose(found[:, 2] / found[:, 0], 0.0, atol=1e-6)


def test_a_single_direction_and_nothing_added() -> None:
    one = pb.mueller(GREEN, 40.0, 50.0, phi_r_deg=60.0, effects=pb.Effects(bulk=0.1))
    row = pb.mueller(GREEN, [40.0, 10.0], 50.0, phi_r_deg=60.0, effects=pb.Effects(bulk=0.1))
    assert one.shape == (3, 3)
    np.testing.assert_allclose(one, row[0], rtol=1e-12)
    np.testing.assert_array_equal(
        pb.mueller(GREEN, 40.0, 50.0, effects=pb.Effects()), pb.mueller(GREEN, 40.0, 50.0)
    )


def test_the_instrument_has_no_place_here() -> None:
    with pytest.raises(pb.DomainError, match=r"leakage = 0\.01 is an effect of the instrument"):
        pb.stokes(GREEN, 40.0, 50.0, effects=pb.Effects(leakage=0.01))
    with pytest.raises(pb.DomainError, match=r"reflect 1\.15\d* times what it receives"):
        pb.mueller(GREEN, 40.0, 50.0, effects=pb.Effects(lambert=0.7))

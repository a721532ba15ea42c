"""Mueller matrix and Stokes vectors against constructions from the vectors alone."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import pbrdf_bayes as pb

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
GREEN = pb.Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)
GLASS = pb.Parameters(n=1.5, k=0.0, sigma_n0=0.9, rho0=0.2)
METAL = pb.Parameters(n=0.2, k=3.0, sigma_n0=1.0, rho0=0.3)
EPS = 2.0**-52
PAULI = (  # S0, S1, S2, S3 = 2 Im(E_s conj(E_p)) of the field (E_s, E_p)
    np.eye(2),
    np.diag([1.0, -1.0]),
    np.array([[0.0, 1.0], [1.0, 0.0]]),
    np.array([[0.0, 1j], [-1j, 0.0]]),
)


def vectors(theta_i: float, theta_r: float, phi_r: float) -> tuple[Array, Array]:
    """k_i and k_r for angles in degrees."""
    i, r, phi = np.radians([theta_i, theta_r, phi_r])
    k_i = np.array([math.sin(i), 0.0, -math.cos(i)])
    k_r = np.array([math.sin(r) * math.cos(phi), math.sin(r) * math.sin(phi), math.cos(r)])
    return k_i, k_r


def unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))


def amplitudes(p: pb.Parameters, k_i: Array, k_r: Array) -> tuple[complex, complex]:
    """Fresnel's r_s and r_p (for p = k x s) at the angle between k_i and the facet's normal."""
    normal = unit(k_r - k_i)
    c = complex(-k_i @ normal)
    m2 = complex(p.n, -p.k) ** 2
    c_t = np.sqrt(m2 - (1.0 - c * c))
    return (c - c_t) / (c + c_t), (m2 * c - c_t) / (m2 * c + c_t)


def jones(p: pb.Parameters, theta_i: float, theta_r: float, phi_r: float, phase: str) -> Complex:
    """Field tensor of the facet, its moduli the roots of f_s and f_p, seen in the two frames."""
    k_i, k_r = vectors(theta_i, theta_r, phi_r)
    f_s, f_p = (float(pb.brdf(p, theta_i, theta_r, q, phi_r_deg=phi_r)) for q in "sp")
    r_s, r_p = amplitudes(p, k_i, k_r) if phase == "fresnel" else (1.0, 1.0)
    t = unit(np.cross(k_i, k_r))
    tensor = math.sqrt(f_s) * r_s / abs(r_s) * np.outer(t, t) + math.sqrt(f_p) * r_p / abs(
        r_p
    ) * np.outer(np.cross(k_r, t), np.cross(k_i, t))
    normal = np.array([0.0, 0.0, 1.0])
    # at normal incidence and towards the normal the frame is that of the meridian
    azimuth = math.radians(phi_r)
    s_r = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    s_i = unit(np.cross(normal, k_i)) if theta_i > 0.0 else np.array([0.0, 1.0, 0.0])
    before, after = np.stack([s_i, np.cross(k_i, s_i)]), np.stack([s_r, np.cross(k_r, s_r)])
    return np.asarray(after @ tensor @ before.T)


def mueller_of(field: Complex) -> Array:
    """Mueller matrix (4, 4) of a Jones matrix."""
    trace = [[np.trace(a @ field @ b @ field.conj().T) for b in PAULI] for a in PAULI]
    return np.asarray(0.5 * np.real(trace))


DIRECTIONS = [
    (20.0, 60.0, 150.0), (40.0, 50.0, 60.0), (60.0, 30.0, -75.0), (5.0, 80.0, 179.0), (75.0, 75.0, 10.0),
    (30.0, -50.0, 20.0), (0.0, 40.0, 25.0), (50.0, 0.0, 35.0), (50.0, 0.0, 0.0), (70.0, 10.0, 90.0),
    (45.0, 45.0, 0.0), (85.0, -85.0, 3.0), (30.0, 60.0, 360.0),
]  # fmt: skip


@pytest.mark.parametrize("phase", ["fresnel", "paper"])
@pytest.mark.parametrize("surface", [GREEN, GLASS, METAL], ids=["green", "glass", "metal"])
@pytest.mark.parametrize("angles", DIRECTIONS, ids=str)
def test_the_matrix_is_that_of_the_vectors(
    angles: tuple[float, float, float], surface: pb.Parameters, phase: str
) -> None:
    theta_i, theta_r, phi_r = angles
    wanted = mueller_of(jones(surface, *angles, phase))[:3, :3]
    found = pb.mueller(surface, theta_i, theta_r, phi_r_deg=phi_r, phase=phase)
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-12 * wanted[0, 0])


@pytest.mark.parametrize("angles", DIRECTIONS[:6], ids=str)
def test_it_is_the_facet_between_two_rotations(angles: tuple[float, float, float]) -> None:
    """R(b) M_facet R(a), with the angles read off the vectors by arctan2 in right-handed frames."""
    theta_i, theta_r, phi_r = angles
    k_i, k_r = vectors(*angles)
    t, phi = np.cross(k_i, k_r), math.radians(phi_r)
    s_i, s_r = np.array([0.0, 1.0, 0.0]), np.array([-math.sin(phi), math.cos(phi), 0.0])
    a = math.atan2(np.cross(k_i, s_i) @ t, s_i @ t)
    b = math.atan2(np.cross(k_r, s_r) @ t, s_r @ t)

    def turn(angle: float) -> Array:
        """Frame turned by ``angle`` from s towards p."""
        c, s = math.cos(2.0 * angle), math.sin(2.0 * angle)
        return np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])

    f_s, f_p = (float(pb.brdf(GREEN, theta_i, theta_r, q, phi_r_deg=phi_r)) for q in "sp")
    r_s, r_p = amplitudes(GREEN, k_i, k_r)
    cross = math.sqrt(f_s * f_p) * (r_s * r_p.conjugate()).real / abs(r_s * r_p)
    mean, half = 0.5 * (f_s + f_p), 0.5 * (f_s - f_p)
    facet = np.array([[mean, half, 0.0], [half, mean, 0.0], [0.0, 0.0, cross]])
    wanted = turn(-b) @ facet @ turn(a)
    found = pb.mueller(GREEN, theta_i, theta_r, phi_r_deg=phi_r)
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-12 * mean)


def ninth_equation(angles: tuple[float, float, float], *, signed: bool) -> Array:
    """Stokes vector of s light by Eq. (9) with no phase; roots of g and h with signs or without."""
    theta_i, theta_r, phi_r = angles
    k_i, k_r = vectors(*angles)
    (alpha_i, _, minus_c_i), (alpha, beta, c_r) = k_i, k_r
    c_i = -minus_c_i
    root_g = alpha * c_i + alpha_i * c_r
    root_h = (alpha**2 + beta**2) * c_i + alpha * alpha_i * c_r
    if not signed:
        root_g, root_h = abs(root_g), abs(root_h)
    g, h, cross = root_g**2, root_h**2, alpha_i**2 * beta**2
    f_s, f_p = (float(pb.brdf(GREEN, theta_i, theta_r, q, phi_r_deg=phi_r)) for q in "sp")
    root = math.sqrt(f_s * f_p)
    second = (h - cross) * (g * f_s - beta**2 * f_p)
    second += 4.0 * root_g * root_h * alpha_i * beta**2 * root
    third = root_h * alpha_i * beta * (g * f_s - beta**2 * f_p) - root_g * root * beta * (h - cross)
    below = (g + beta**2) * (h + cross)
    return np.array(
        [(g * f_s + beta**2 * f_p) / (g + beta**2), second / below, 2.0 * third / below]
    )


@pytest.mark.parametrize("angles", DIRECTIONS[:6], ids=str)
def test_equation_9_holds_with_signed_roots(angles: tuple[float, float, float]) -> None:
    """Its S2 counts the other way round."""
    found = pb.stokes(GREEN, angles[0], angles[1], "s", phi_r_deg=angles[2], phase="paper")
    wanted = ninth_equation(angles, signed=True) * [1.0, 1.0, -1.0]
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-12 * wanted[0])


def test_the_printed_roots_lose_a_sign_backwards() -> None:
    """At 20 deg -> 60 deg, phi_r = 150 deg, G < 0 < H: S1 and S2 with positive roots are others."""
    angles = DIRECTIONS[0]
    signed, printed = (ninth_equation(angles, signed=s) for s in (True, False))
    assert np.abs(signed - printed).max() > 0.1 * signed[0]
    forward = DIRECTIONS[1]
    np.testing.assert_array_equal(
        ninth_equation(forward, signed=True), ninth_equation(forward, signed=False)
    )


def test_the_printed_phase_is_wrong_below_brewster_and_right_above() -> None:
    """Element (3, 3) in plane, k = 0: minus below 56.3 deg of local angle, plus above."""
    for theta, sign in ((20.0, -1.0), (55.0, -1.0), (58.0, 1.0), (85.0, 1.0)):
        fresnel = pb.mueller(GLASS, theta, theta)[2, 2]
        printed = pb.mueller(GLASS, theta, theta, phase="paper")[2, 2]
        assert printed > 0.0
        assert fresnel == pytest.approx(sign * printed, rel=1e-12, abs=0.0)


@pytest.mark.parametrize("phi_r", [0.0, 30.0, 77.0, 140.0, -100.0])
@pytest.mark.parametrize("azimuth", [0.0, 20.0, 90.0, 135.0])
def test_near_the_normal_the_field_keeps_its_line(phi_r: float, azimuth: float) -> None:
    """A field at ``azimuth`` from x, projected on the frames, comes back along itself."""
    theta_i, theta_r, psi = 1e-4, 1e-4, math.radians(azimuth)
    k_i, k_r = vectors(theta_i, theta_r, phi_r)
    line = np.array([math.cos(psi), math.sin(psi), 0.0])

    def seen(k: Array, s: Array) -> Array:
        e_s, e_p = line @ s, line @ np.cross(k, s)
        return np.array([e_s**2 + e_p**2, e_s**2 - e_p**2, 2.0 * e_s * e_p])

    phi = math.radians(phi_r)
    incoming = seen(k_i, np.array([0.0, 1.0, 0.0]))
    outgoing = seen(k_r, np.array([-math.sin(phi), math.cos(phi), 0.0]))
    kept = pb.mueller(GREEN, theta_i, theta_r, phi_r_deg=phi_r) @ incoming
    np.testing.assert_allclose(kept / kept[0], outgoing, atol=1e-5)
    if phi_r in (30.0, 77.0) and azimuth == 20.0:
        printed = pb.mueller(GREEN, theta_i, theta_r, phi_r_deg=phi_r, phase="paper") @ incoming
        assert np.abs(printed / printed[0] - outgoing).max() > 0.2


def test_in_plane_the_matrix_is_that_of_f_s_and_f_p() -> None:
    theta_r = np.linspace(-85.0, 85.0, 35)
    matrix = pb.mueller(GREEN, 40.0, theta_r)
    f_s, f_p = (pb.brdf(GREEN, 40.0, theta_r, q) for q in "sp")
    np.testing.assert_array_equal(matrix[:, 0, 0], 0.5 * (f_s + f_p))
    np.testing.assert_array_equal(matrix[:, 0, 1], 0.5 * (f_s - f_p))
    np.testing.assert_array_equal(matrix[:, :2, :2], matrix[:, :2, :2].swapaxes(1, 2))
    assert np.all(matrix[:, :2, 2] == 0.0)
    assert np.all(matrix[:, 2, :2] == 0.0)
    for q, f, sign in (("s", f_s, 1.0), ("p", f_p, -1.0)):
        vector = pb.stokes(GREEN, 40.0, theta_r, q)
        np.testing.assert_allclose(vector[:, 0], f, rtol=2e-15 * 40.0)
        np.testing.assert_allclose(vector[:, 1], sign * f, rtol=2e-15 * 40.0)
        np.testing.assert_allclose(pb.degree_of_linear_polarization(vector), 1.0, rtol=1e-13)


def test_unpolarised_light_and_detection() -> None:
    """S0 of u light is the mean of f_s and f_p, and of the S0 of s and p light."""
    rng = np.random.default_rng(1)
    theta_i, theta_r = rng.uniform(0.0, 89.0, 50), rng.uniform(-90.0, 90.0, 50)
    phi_r = rng.uniform(-180.0, 180.0, 50)
    s, p, u = (pb.stokes(GREEN, theta_i, theta_r, q, phi_r_deg=phi_r) for q in "spu")
    f_s, f_p, f_u = (pb.brdf(GREEN, theta_i, theta_r, q, phi_r_deg=phi_r) for q in "spu")
    np.testing.assert_array_equal(u[:, 0], 0.5 * (f_s + f_p))
    np.testing.assert_allclose(u[:, 0], f_u, rtol=1e-13)
    np.testing.assert_allclose(u, 0.5 * (s + p), rtol=0.0, atol=1e-15)
    between = (s[:, 0] >= np.minimum(f_s, f_p) * (1 - 1e-13)) & (
        s[:, 0] <= np.maximum(f_s, f_p) * (1 + 1e-13)
    )
    assert between.all()


def test_what_equation_8_does_to_the_energy_of_s_and_p(textbook: Any, gauss_rule: Any) -> None:
    """Integrals of S0 of s and of p light over the hemisphere, over DHR_s and DHR_p.

    1 is what Eq. (2) asks for; from the textbook lobes and Eq. (9), none of the package's kernels.
    """
    model = textbook(1.526, 0.193, 0.4528, 0.47)
    t, w_t = gauss_rule(np.radians(np.linspace(0.0, 90.0, 5)), 24)
    phi, w_phi = gauss_rule(np.radians(np.linspace(0.0, 180.0, 7)), 24)
    weight = 2.0 * (w_t * np.sin(t) * np.cos(t))[:, None] * w_phi
    alpha, beta = np.sin(t)[:, None] * np.cos(phi), np.sin(t)[:, None] * np.sin(phi)
    for theta_i, stated in ((0.0, (1.07, 0.93)), (60.0, (0.89, 8.41))):
        alpha_i, c_i = math.sin(math.radians(theta_i)), math.cos(math.radians(theta_i))
        f = model.brdf(theta_i, np.degrees(t)[:, None], np.degrees(phi))
        g = (alpha * c_i + alpha_i * np.cos(t)[:, None]) ** 2
        share = g / (g + beta**2)
        for q in range(2):
            mixed = share * f[q] + (1.0 - share) * f[1 - q]
            ratio = np.sum(weight * mixed) / (0.4528 * model.reflectances(alpha_i)[q])
            assert float(ratio) == pytest.approx(stated[q], abs=0.006)
    s0 = pb.stokes(GREEN, 60.0, np.degrees(t)[:, None], "p", phi_r_deg=np.degrees(phi))[..., 0]
    np.testing.assert_allclose(s0, mixed, rtol=1e-7)


surfaces = st.builds(
    pb.Parameters,
    n=st.floats(1.05, 6.0), k=st.one_of(st.just(0.0), st.floats(0.0, 10.0)), sigma_n0=st.floats(0.01, 1.0),
    rho0=st.floats(0.01, 4.0),
)  # fmt: skip
polar, around = st.floats(0.0, 89.9), st.floats(-360.0, 360.0)


@settings(max_examples=60, deadline=None)
@given(surfaces, polar, st.floats(-90.0, 90.0), around, st.sampled_from(["fresnel", "paper"]),
       st.sampled_from([0.0, 0.3, 1.0]))  # fmt: skip
def test_no_light_comes_out_more_than_fully_polarised(
    surface: pb.Parameters, theta_i: float, theta_r: float, phi_r: float, phase: str, share: float
) -> None:
    matrix = pb.mueller(
        surface, theta_i, theta_r, phi_r_deg=phi_r, phase=phase, depolarisation=share, rtol=1e-4
    )
    assert np.all(np.isfinite(matrix))
    angle = np.radians(np.linspace(0.0, 360.0, 37))
    degree = np.array([0.0, 0.5, 1.0])[:, None]
    light = np.stack([np.ones((3, 37)), degree * np.cos(angle), degree * np.sin(angle)], axis=-1)
    out = light @ matrix.T
    scale = 1e-14 * matrix[0, 0]
    assert np.all(out[..., 0] >= -scale)
    assert np.all(np.hypot(out[..., 1], out[..., 2]) <= (1.0 - share) * out[..., 0] + 30.0 * scale)


@settings(max_examples=40, deadline=None)
@given(
    surfaces, st.floats(1.0, 85.0), st.floats(1.0, 85.0), st.floats(5.0, 175.0), st.floats(0.0, 1.0)
)
def test_the_coherency_matrix_has_no_negative_eigenvalue(
    surface: pb.Parameters, theta_i: float, theta_r: float, phi_r: float, share: float
) -> None:
    """Cloude's matrix of the 4 x 4 completion with the circular row and column of the facet."""
    angles = (theta_i, theta_r, phi_r)
    field = jones(surface, *angles, "fresnel")
    assume(np.all(np.isfinite(field)))
    full = mueller_of(field)
    linear = pb.mueller(surface, theta_i, theta_r, phi_r_deg=phi_r, depolarisation=share)
    full[1:] *= 1.0 - share
    full[:3, :3] = linear
    coherency = sum(
        full[i, j] * np.kron(PAULI[i], PAULI[j].conj()) for i in range(4) for j in range(4)
    )
    values = np.linalg.eigvalsh(0.25 * coherency)
    assert values.min() >= -1e-10 * full[0, 0]
    assert values.sum() == pytest.approx(full[0, 0], rel=1e-9)


def test_depolarisation_from_nothing_to_everything() -> None:
    theta_r, phi_r = np.linspace(-80.0, 80.0, 9), np.array([[0.0], [50.0], [130.0]])
    plain = pb.mueller(GREEN, 35.0, theta_r, phi_r_deg=phi_r)
    null = pb.mueller(GREEN, 35.0, theta_r, phi_r_deg=phi_r, depolarisation=0.0)
    assert plain.tobytes() == null.tobytes()
    half, full = (
        pb.mueller(GREEN, 35.0, theta_r, phi_r_deg=phi_r, depolarisation=d) for d in (0.5, 1.0)
    )
    np.testing.assert_array_equal(half[..., 1:, :], 0.5 * plain[..., 1:, :])
    for q in "spu":
        vector = pb.stokes(GREEN, 35.0, theta_r, q, phi_r_deg=phi_r, depolarisation=1.0)
        before = pb.stokes(GREEN, 35.0, theta_r, q, phi_r_deg=phi_r)
        np.testing.assert_array_equal(vector[..., 0], before[..., 0])
        np.testing.assert_array_equal(pb.degree_of_linear_polarization(vector), 0.0)
    np.testing.assert_array_equal(full[..., 0, :], plain[..., 0, :])


@pytest.mark.parametrize("theta_i", [0.0, 30.0, 75.0])
@pytest.mark.parametrize("phi_r", [0.0, 40.0, 180.0, 250.0])
def test_towards_the_normal_it_is_continuous_along_a_meridian(theta_i: float, phi_r: float) -> None:
    at, beside, other = (pb.mueller(GREEN, theta_i, x, phi_r_deg=phi_r) for x in (0.0, 1e-6, -1e-6))
    assert np.all(np.isfinite(at))
    np.testing.assert_allclose(beside, at, rtol=0.0, atol=1e-6 * at[0, 0])
    np.testing.assert_allclose(other, at, rtol=0.0, atol=1e-6 * at[0, 0])


def test_angles_too_small_to_be_squared_are_angles() -> None:
    at = pb.mueller(GREEN, 0.0, 0.0, phi_r_deg=25.0)
    for tiny in (1e-187, 5e-324, -1e-200):
        beside = pb.mueller(GREEN, 0.0, tiny, phi_r_deg=25.0)
        np.testing.assert_allclose(beside, at, rtol=0.0, atol=1e-15 * at[0, 0])


@pytest.mark.parametrize("theta_i", [0.0, 1e-3, 30.0, 75.0, 89.95])
def test_back_along_the_ray_it_is_continuous_in_plane(theta_i: float) -> None:
    at = pb.mueller(GREEN, theta_i, -theta_i)
    assert np.all(np.isfinite(at))
    assert at[2, 2] < 0.0
    for way in (-1e-7, 1e-7):
        beside = pb.mueller(GREEN, theta_i, max(-theta_i + way, -90.0))
        np.testing.assert_allclose(beside, at, rtol=0.0, atol=1e-4 * at[0, 0])
    turned = pb.mueller(GREEN, theta_i, theta_i, phi_r_deg=180.0)
    np.testing.assert_allclose(turned, at, rtol=0.0, atol=1e-10 * at[0, 0])


def test_back_along_the_ray_the_side_matters_as_stated() -> None:
    """From across the plane the facet's s is the p of the ray: f_s and f_p change places."""
    at = pb.mueller(GREEN, 30.0, -30.0)
    across = pb.mueller(GREEN, 30.0, 30.0, phi_r_deg=180.0 - 1e-5)
    assert at[0, 1] > 0.05 * at[0, 0]
    np.testing.assert_allclose(across[:2, :2], at[:2, :2] * [[1, -1], [-1, 1]], rtol=1e-4)


def test_a_scene_is_a_sum_over_its_sources() -> None:
    """Unpolarised light from two sides: DoLP and AoLP of the sum, from S1 and S2 by hand."""
    one = pb.stokes(GREEN, 60.0, 50.0, "u", phi_r_deg=20.0)
    two = 0.5 * pb.stokes(GREEN, 30.0, 50.0, "u", phi_r_deg=100.0)
    total = one + two
    degree = float(pb.degree_of_linear_polarization(total))
    angle = math.radians(float(pb.angle_of_linear_polarization_deg(total)))
    np.testing.assert_allclose(
        total,
        total[0] * np.array([1.0, degree * math.cos(2 * angle), degree * math.sin(2 * angle)]),
        rtol=0.0, atol=4.0 * EPS * total[0],
    )  # fmt: skip
    assert 0.0 < degree < 1.0
    # seen in plane from an unpolarised source, light of s is what is left near Brewster's angle
    glass = pb.stokes(GLASS, 56.0, 56.6, "u")
    assert float(pb.degree_of_linear_polarization(glass)) > 0.999
    assert abs(float(pb.angle_of_linear_polarization_deg(glass))) < 1e-9


def test_no_light_has_no_polarisation() -> None:
    black = pb.stokes(pb.Parameters(n=1.5, k=0.0, sigma_n0=0.0, rho0=0.3), 20.0, [10.0, 20.0])
    assert np.isnan(pb.degree_of_linear_polarization(black)).all()
    assert np.isnan(pb.angle_of_linear_polarization_deg(black)).all()
    assert float(pb.angle_of_linear_polarization_deg([1.0, -0.5, -0.0])) == 90.0


def test_shapes_follow_the_angles() -> None:
    assert pb.mueller(GREEN, 20.0, 10.0).shape == (3, 3)
    assert pb.mueller(GREEN, [[20.0], [30.0]], [1.0, 2.0, 3.0]).shape == (2, 3, 3, 3)
    assert pb.stokes(GREEN, 20.0, []).shape == (0, 3)
    assert pb.degree_of_linear_polarization(np.ones((4, 2, 3))).shape == (4, 2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"phase": "none"}, r"phase = 'none' is not known\. Allowed: 'fresnel', 'paper'"),
        (
            {"depolarisation": 1.1},
            r"depolarisation = 1\.1 is not allowed: give a share in \[0, 1\]",
        ),
        ({"depolarisation": math.nan}, r"depolarisation = nan is not allowed"),
        ({"phi_r_deg": 400.0}, r"phi_r_deg = 400\.0 is not allowed"),
        ({"rtol": 1.0}, r"rtol = 1\.0 is not allowed"),
    ],
)
def test_what_is_not_allowed_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(pb.DomainError, match=message):
        pb.mueller(GREEN, 20.0, 10.0, **options)
    with pytest.raises(pb.DomainError, match=message):
        pb.stokes(GREEN, 20.0, 10.0, "s", **options)


def test_words_and_shapes_that_are_not_allowed() -> None:
    with pytest.raises(pb.DomainError, match=r"polarization = 'S' is not known"):
        pb.stokes(GREEN, 20.0, 10.0, "S")
    for function in (pb.degree_of_linear_polarization, pb.angle_of_linear_polarization_deg):
        with pytest.raises(pb.DomainError, match=r"shape \(2,\): give S0, S1, S2"):
            function([1.0, 0.0])

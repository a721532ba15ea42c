from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pbrdf_bayes.io.tidy_csv import read_samples
from pbrdf_bayes.measurement import (
    Measurement,
    Readings,
    measurement_from_columns,
    select_scans,
)
from pbrdf_bayes.model.four_parameter import Parameters, brdf, dhr
from pbrdf_bayes.readings.checks import LIMITS, check_measurement, find_problems
from pbrdf_bayes.readings.scan_statistics import (
    find_spikes,
    hemisphere_bracket,
    mirror_asymmetry,
    neighbour_deviation,
    one_sided_deviation,
    point_noise,
    profile,
    zero_offset,
)
from pbrdf_bayes.records.checks import Check
from pbrdf_bayes.words import OF_READINGS, say

GREEN = Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)
THETA_R = np.arange(-80, 80.5, 2.0)
DHR_THETA_I = np.arange(10, 81, 10.0)


@cache
def exact(parameters: Parameters, polarizations: str, theta_i: tuple[float, ...], step: float):
    """Noise-free scans and DHR of a paint as columns, BRDF rows first."""
    theta_r = np.arange(-80, 80 + step / 2, step)
    columns = {name: [] for name in ("quantity", "polarization", "theta_i_deg", "theta_r_deg")}
    value = []
    for q in polarizations:
        for angle in theta_i:
            value.append(brdf(parameters, angle, theta_r, q, rtol=1e-5))
            for name, cell in (("quantity", "brdf"), ("polarization", q), ("theta_i_deg", angle)):
                columns[name] += [cell] * theta_r.size
            columns["theta_r_deg"] += theta_r.tolist()
    for q in polarizations:
        value.append(dhr(parameters, DHR_THETA_I, q))
        columns["quantity"] += ["dhr"] * DHR_THETA_I.size
        columns["polarization"] += [q] * DHR_THETA_I.size
        columns["theta_i_deg"] += DHR_THETA_I.tolist()
        columns["theta_r_deg"] += [np.nan] * DHR_THETA_I.size
    return {name: np.array(cells) for name, cells in columns.items()}, np.concatenate(value)


def paint(
    parameters: Parameters = GREEN,
    *,
    polarizations: str = "sp",
    theta_i: tuple[float, ...] = (0.0, 20.0, 60.0),
    step: float = 2.0,
    noise: float = 0.01,
    seed: int = 1,
) -> Measurement:
    columns, value = exact(parameters, polarizations, theta_i, step)
    value = value * np.exp(np.random.default_rng(seed).normal(0, noise, value.size))
    # Brewster's zero cannot be drawn on a log axis
    return measurement_from_columns(
        sample="paint",
        wavelength_um=3.39,
        value=np.maximum(value, 1e-12),
        row=np.arange(value.size) + 2,
        **columns,
    )


def change(m: Measurement, part: str = "brdf", **columns: np.ndarray) -> Measurement:
    readings = dataclasses.replace(getattr(m, part), **columns)
    return dataclasses.replace(m, **{part: readings})


def scale(m: Measurement, factor, where=True, part: str = "brdf") -> Measurement:
    value = getattr(m, part).value
    return change(m, part, value=value * np.where(where, factor, 1.0))


def named(m: Measurement, name: str) -> Check:
    return next(check for check in check_measurement(m) if check.name == name)


def test_good_measurement_passes():
    checks = check_measurement(paint())
    verdicts = {check.name: check.verdict for check in checks}
    assert verdicts.pop("repeatability") == "SKIP"
    assert set(verdicts.values()) == {"PASS"}
    assert [check.name for check in checks] == list(LIMITS) == list(OF_READINGS)


@pytest.mark.parametrize("check", check_measurement(paint()), ids=lambda check: check.name)
def test_record_is_complete(check):
    assert check.statement.endswith(".")
    assert np.isnan(check.value) == (check.verdict == "SKIP")
    assert check.advice == ""
    assert (check.title, check.unit) == OF_READINGS[check.name][:2]
    assert any(character.isdigit() for character in check.statement) or check.verdict == "SKIP"


def empty_readings() -> Readings:
    none = np.zeros(0)
    return Readings(
        np.zeros(0, "U1"), none, none, none, none, none, none.astype(bool), none.astype(int)
    )


@pytest.mark.parametrize(
    "m",
    [
        dataclasses.replace(paint(), brdf=empty_readings(), scans=(), dhr=empty_readings()),
        dataclasses.replace(paint(), brdf=empty_readings(), scans=()),
        scale(paint(), -1.0),
        scale(paint(), 0.0),
        scale(paint(), 0.0, part="dhr"),
        measurement_from_columns(
            sample="one", wavelength_um=1.0, quantity=["brdf"], polarization=["s"],
            theta_i_deg=[0.0], theta_r_deg=[0.0], value=[0.1],
        ),
        measurement_from_columns(
            sample="same", wavelength_um=1.0, quantity=["brdf"] * 9, polarization=["s"] * 9,
            theta_i_deg=[0.0] * 9, theta_r_deg=[5.0] * 9, value=[0.1] * 9,
        ),
    ],
    ids=["nothing", "no scan", "negative", "zero", "no DHR signal", "one point", "one angle"],
)  # fmt: skip
def test_nothing_to_check_is_skipped_without_a_warning(m):
    for check in check_measurement(m):
        assert (check.verdict == "SKIP") != np.isfinite(check.value)
        assert check.verdict in ("PASS", "SKIP") or check.name in ("coverage", "dhr_level")


# Each check fires


def with_second_scan(factor: float) -> Measurement:
    columns, value = exact(GREEN, "s", (20.0,), 2.0)
    is_brdf = columns["quantity"] == "brdf"
    columns = {name: np.tile(cells[is_brdf], 2) for name, cells in columns.items()}
    n = int(is_brdf.sum())
    noise = np.exp(np.random.default_rng(3).normal(0, 0.01, 2 * n))
    return measurement_from_columns(
        sample="paint",
        wavelength_um=3.39,
        value=np.concatenate([value[is_brdf], value[is_brdf] * factor]) * noise,
        scan=np.repeat(["a", "b"], n),
        **columns,
    )


@pytest.mark.parametrize(("factor", "verdict"), [(1.0, "PASS"), (1.3, "WARN"), (3.0, "FAIL")])
def test_repeatability(factor, verdict):
    check = named(with_second_scan(factor), "repeatability")
    assert check.verdict == verdict
    # Two scans a factor apart have the standard deviation log10(factor) / sqrt(2).
    assert check.value == pytest.approx(max(np.log10(factor) / 2**0.5, 0.0043), rel=0.3)
    assert check.scans == ("s 20 deg b",) or factor == 1.0
    assert bool(check.advice) == (verdict != "PASS")


def test_repeated_rows_in_one_scan_count_as_repeats():
    columns, value = exact(GREEN, "s", (20.0,), 2.0)
    m = measurement_from_columns(
        sample="paint",
        wavelength_um=3.39,
        value=np.concatenate([value, value * 2]),
        **{name: np.tile(cells, 2) for name, cells in columns.items()},
    )
    assert named(m, "repeatability").verdict == "FAIL"


@pytest.mark.parametrize("offset", [-0.8, 0.6, 1.2])
def test_symmetry_finds_an_angular_offset(offset):
    shifted = Parameters(n=1.5, k=0.2, sigma_n0=0.5, rho0=0.1)
    m = paint(shifted, theta_i=(0.0,), polarizations="s", step=1.0)
    level = np.interp(m.brdf.theta_r_deg - offset, m.brdf.theta_r_deg, np.log(m.brdf.value))
    check = named(change(m, value=np.exp(level)), "symmetry")
    assert check.verdict in ("WARN", "FAIL")
    assert f"theta_r = {offset:+.1f}" in check.statement
    assert f"theta_r_deg by {-offset:+.1f}" in check.advice


def test_symmetry_of_a_one_sided_error_is_no_offset():
    m = paint(theta_i=(0.0,))
    check = named(scale(m, 1.5, m.brdf.theta_r_deg > 0), "symmetry")
    assert check.verdict == "WARN"
    assert check.value == pytest.approx(np.log10(1.5), abs=0.01)
    assert check.advice == OF_READINGS["symmetry"].advice


def test_symmetry_allows_for_noise():
    check = named(paint(theta_i=(0.0,), noise=0.1), "symmetry")
    assert (check.verdict, check.value > LIMITS["symmetry"].warn) == ("PASS", True)
    assert check.threshold > check.value


@pytest.mark.parametrize(
    ("part", "factor", "verdict"),
    [
        ("dhr", 100.0, "FAIL"),
        ("dhr", 4.0, "WARN"),
        ("brdf", np.pi, "WARN"),
        ("brdf", 1000.0, "FAIL"),
        ("brdf", 0.01, "FAIL"),
        ("brdf", 1.2, "PASS"),
        ("brdf", 0.8, "PASS"),
    ],
)
def test_dhr_level(part, factor, verdict):
    check = named(scale(paint(), factor, part=part), "dhr_level")
    assert check.verdict == verdict
    assert bool(check.advice) == (verdict != "PASS")


def test_dhr_of_s_and_p_serves_an_unpolarised_scan():
    m = paint(polarizations="spu")
    keep = np.array([scan.polarization == "u" for scan in m.scans])
    only_u = select_scans(m, keep, dhr=False)
    no_u = dataclasses.replace(m.dhr, **{
        name: getattr(m.dhr, name)[m.dhr.polarization != "u"] for name in m.dhr.__dict__
    })  # fmt: skip
    check = named(dataclasses.replace(only_u, dhr=no_u), "dhr_level")
    assert (check.verdict, check.statement[:7]) == ("PASS", "3 scans")


@pytest.mark.parametrize(
    "m",
    [
        paint(polarizations="p", theta_i=(60.0,)),
        paint(polarizations="s", theta_i=(85.0,)),
        paint(Parameters(n=1.5, k=0, sigma_n0=1, rho0=0.003), polarizations="s", theta_i=(20.0,)),
    ],
    ids=["p near Brewster", "specular not reached", "lobe narrower than the step"],
)
def test_dhr_level_is_skipped_where_the_scan_says_little(m):
    assert named(m, "dhr_level").verdict == "SKIP"


@pytest.mark.parametrize("factor", [3.0, 0.2])
def test_spikes_are_named_by_line_and_angle(factor):
    m = paint()
    row = int(m.brdf.row[30])
    check = named(scale(m, factor, m.brdf.row == row), "spikes")
    assert (check.verdict, check.value) == ("WARN", 1.0)
    sign = "+" if factor > 1 else "-"
    expected = f"line {row}, s 0 deg, theta_r {m.brdf.theta_r_deg[30]:g} deg ({sign}0."
    assert expected in check.statement
    assert check.advice == OF_READINGS["spikes"].advice


def test_spikes_at_most_five_are_named():
    m = paint(noise=0.0)
    check = named(scale(m, 3.0, np.arange(len(m.brdf)) % 16 == 8), "spikes")
    assert check.value > 10
    assert check.statement.count("line ") == 5
    assert len(check.lines) == check.value


def test_a_step_is_no_spike():
    m = paint(theta_i=(0.0,))
    assert named(scale(m, 2.0, m.brdf.theta_r_deg > 30), "spikes").verdict == "PASS"


def take(m: Measurement, keep: np.ndarray) -> Measurement:
    """Measurement with only some of the BRDF rows."""
    rows = m.brdf
    return measurement_from_columns(
        sample="part",
        wavelength_um=1.0,
        quantity=["brdf"] * int(keep.sum()),
        polarization=rows.polarization[keep],
        theta_i_deg=rows.theta_i_deg[keep],
        theta_r_deg=rows.theta_r_deg[keep],
        phi_r_deg=rows.phi_r_deg[keep],
        value=rows.value[keep],
    )


def test_coverage_of_the_specular_direction():
    m = paint()
    check = named(take(m, np.abs(m.brdf.theta_r_deg - 60) > 5), "coverage")
    assert (check.verdict, check.value) == ("WARN", 2.0)
    assert check.scans == ("s 60 deg", "p 60 deg")
    assert say("coverage.missed", labels="s 60 deg, p 60 deg") in check.statement


def test_coverage_counts_short_scans():
    m = paint()
    short = (m.brdf.theta_i_deg != 20) | (np.abs(m.brdf.theta_r_deg - 20) < 4)
    check = named(take(m, short), "coverage")
    assert (check.verdict, check.value) == ("WARN", 2.0)
    assert say("coverage.few", least=5, labels="s 20 deg, p 20 deg") in check.statement


def test_coverage_asks_nothing_of_scans_out_of_plane():
    m = paint(theta_i=(20.0,))
    m = change(m, phi_r_deg=np.full(len(m.brdf), 90.0))
    assert named(take(m, m.brdf.theta_r_deg < 0), "coverage").verdict == "SKIP"


def in_plane_of(m: Measurement, phi_r_deg: float) -> Measurement:
    """The same readings at another azimuth."""
    m = change(m, phi_r_deg=np.full(len(m.brdf), phi_r_deg))
    return take(m, np.ones(len(m.brdf), bool))


def test_scans_out_of_plane_and_in_plane_are_judged_each_by_itself():
    """Half of the scans lies across the plane of incidence and never reaches 60 deg."""
    m = paint(theta_i=(60.0,))
    across = change(m, phi_r_deg=np.where(m.brdf.polarization == "p", 90.0, 0.0))
    check = named(take(across, m.brdf.theta_r_deg < 50), "coverage")
    assert (check.verdict, check.value) == ("WARN", 1.0)
    assert check.scans == ("s 60 deg",)


@pytest.mark.parametrize("phi_r_deg", [90.0, 45.0, -30.0])
def test_symmetry_at_normal_incidence_holds_in_every_plane(phi_r_deg):
    m = in_plane_of(paint(theta_i=(0.0,)), phi_r_deg)
    assert named(m, "symmetry").verdict == "PASS"
    assert named(scale(m, 1.5, m.brdf.theta_r_deg > 0), "symmetry").verdict == "WARN"


def test_s_equals_p_compares_scans_of_one_plane():
    m = paint(theta_i=(0.0,))
    assert named(in_plane_of(m, 90.0), "s_equals_p").verdict == "PASS"
    across = change(m, phi_r_deg=np.where(m.brdf.polarization == "p", 90.0, 0.0))
    check = named(take(across, np.ones(len(m.brdf), bool)), "s_equals_p")
    assert check.verdict == "SKIP"


def test_spikes_out_of_plane_are_not_spared_for_the_specular_direction():
    """At azimuth 90 deg nothing special is at theta_r = theta_i."""
    m = paint(theta_i=(40.0,), polarizations="s")
    bent = scale(m, 4.0, m.brdf.theta_r_deg == 40.0)
    assert named(take(bent, np.ones(len(m.brdf), bool)), "spikes").verdict == "PASS"
    assert named(in_plane_of(bent, 90.0), "spikes").verdict == "WARN"


@pytest.mark.parametrize("hidden_deg", [-1.0, 5.0])
@pytest.mark.parametrize(("factor", "verdict"), [(1.0, "PASS"), (1.15, "WARN"), (2.0, "FAIL")])
def test_s_equals_p(factor, verdict, hidden_deg):
    m = paint(step=1.0)
    m = scale(m, factor, m.brdf.polarization == "s")
    check = named(take(m, np.abs(m.brdf.theta_r_deg) > hidden_deg), "s_equals_p")
    assert check.verdict == verdict
    assert check.value == pytest.approx(abs(np.log10(factor)), abs=0.015)
    assert bool(check.advice) == (verdict != "PASS")


@pytest.mark.parametrize("noise", [0.002, 0.01, 0.05])
def test_noise_is_estimated_in_per_cent(noise):
    check = named(paint(noise=noise, step=1.0), "noise")
    assert check.verdict == "PASS"
    assert np.isnan(check.threshold)
    assert check.value == pytest.approx(100 * noise, rel=0.2)


# No false alarm on any paint of the model


@pytest.mark.parametrize("step", [1.0, 5.0])
@pytest.mark.parametrize("rho0", [0.05, 0.47, 2.0])
@pytest.mark.parametrize(("n", "k"), [(1.2, 0.0), (1.5, 0.0), (1.526, 0.193), (4.0, 0.0), (1.5, 3)])
def test_no_false_alarm(n, k, rho0, step):
    """The bounds of the hemispherical bracket hold for all of these, s, p and unpolarised."""
    paints = Parameters(n=n, k=k, sigma_n0=0.5, rho0=rho0)
    m = paint(paints, polarizations="spu", theta_i=(0.0, 20.0, 40.0, 60.0, 80.0), step=step)
    for check in check_measurement(m):
        assert check.verdict in ("PASS", "SKIP"), check.statement


# The numbers behind the checks


def test_hemisphere_of_a_lambertian_scan_is_its_reflectance():
    p = profile(m := paint(theta_i=(0.0, 60.0)), m.scans[-1])
    flat = dataclasses.replace(p, level=np.full(len(p), np.log10(0.25 / np.pi)))
    assert hemisphere_bracket(flat) == pytest.approx((0.25, 0.25), rel=1e-4)


def test_hemisphere_bracket_is_ordered():
    m = paint()
    for scan in m.scans:
        lower, upper = hemisphere_bracket(profile(m, scan))
        assert 0 < lower <= upper


def test_a_cubic_has_no_deviation():
    x = np.sort(np.random.default_rng(2).uniform(-80, 80, 30))
    m = paint()
    p = dataclasses.replace(
        profile(m, m.scans[0]), theta_r_deg=x, level=np.polyval([2e-6, 1e-4, 0.01, -2], x)
    )
    deviation, gain = neighbour_deviation(p)
    np.testing.assert_allclose(deviation, 0, atol=1e-9 * gain.max())
    assert deviation.shape == gain.shape == one_sided_deviation(p)[0].shape == (26,)
    assert (gain > 1).all()


def test_profile_averages_repeats_and_leaves_out_what_has_no_logarithm():
    m = measurement_from_columns(
        sample="a", wavelength_um=1.0, quantity=["brdf"] * 4, polarization=["s"] * 4,
        theta_i_deg=[0.0] * 4, theta_r_deg=[5.0, 5.0, 6.0, 7.0], value=[0.01, 1.0, -1.0, 0.5],
        row=[2, 3, 4, 5],
    )  # fmt: skip
    p = profile(m, m.scans[0])
    assert p.theta_r_deg.tolist() == [5.0, 7.0]
    assert p.level == pytest.approx([-1.0, np.log10(0.5)])
    assert p.row.tolist() == [2, 5]
    assert np.isnan(point_noise(p))
    assert np.isnan(mirror_asymmetry(p))
    assert zero_offset(p)[0] == 0.0
    assert find_spikes(p, at_least=0.1, significant=5.0)[0].size == 0


@settings(max_examples=50, deadline=None)
@given(
    rows=st.lists(
        st.tuples(
            st.sampled_from(["brdf", "dhr"]),
            st.sampled_from("spu"),
            st.sampled_from([0.0, 20.0, 89.95]),
            st.sampled_from([-90.0, -10.0, -5.0, 0.0, 5.0, 10.0, 20.0, 60.0, 90.0]),
            st.floats(-1.0, 1e6),
        ),
        min_size=1,
        max_size=60,
    )
)
def test_any_measurement_can_be_checked(rows):
    """Whatever was measured, seven finite verdicts and no warning come out."""
    quantity, polarization, theta_i, theta_r, value = zip(*rows, strict=True)
    m = measurement_from_columns(
        sample="any", wavelength_um=1.0, quantity=quantity, polarization=polarization,
        theta_i_deg=theta_i, theta_r_deg=theta_r, value=value,
    )  # fmt: skip
    checks = check_measurement(m)
    assert len(checks) == 7
    for check in checks:
        assert check.verdict in ("PASS", "WARN", "FAIL", "SKIP")
        assert (check.verdict == "SKIP") != np.isfinite(check.value)
        assert "nan" not in check.statement
        assert bool(check.advice) == (check.verdict in ("WARN", "FAIL"))


def test_measured_paints_give_no_alarm(shared):
    for file in sorted(shared.glob("ua_*.csv")):
        for m in read_samples(file).measurements.values():
            assert {check.verdict for check in check_measurement(m)} <= {"PASS", "SKIP"}


def test_findings_are_the_checks_that_did_not_pass():
    m = paint()
    assert find_problems(m) == ()
    spiked = scale(m, 3.0, np.arange(len(m.brdf)) == 20)
    (found,) = (f for f in find_problems(spiked) if f.code == "spikes")
    assert (found.code, found.sample, found.verdict, found.size) == (
        "spikes",
        m.sample,
        "WARN",
        1.0,
    )
    assert found.scans == (m.scans[0].label,)
    assert found.remedy == OF_READINGS["spikes"].advice

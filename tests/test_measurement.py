from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbrdf_bayes.errors import DataError
from pbrdf_bayes.measurement import (
    MOST_SCANS,
    measurement_from_columns,
    name_direction,
    name_half_plane,
    select_scans,
)
from pbrdf_bayes.model.four_parameter import brdf
from pbrdf_bayes.model.simulate import GREEN_PAINT

COLUMNS = ("quantity", "polarization", "theta_i_deg", "theta_r_deg", "value", "phi_r_deg", "scan")
ROWS = [
    ("dhr", "p", 30.0, np.nan, 0.30, 0.0, ""),
    ("brdf", "p", 20.0, 5.0, 0.05, 0.0, ""),
    ("brdf", "s", 20.0, 10.0, 0.02, 0.0, ""),
    ("brdf", "s", 20.0, -10.0, 0.01, 0.0, ""),
    ("dhr", "s", 40.0, np.nan, 0.40, 0.0, ""),
    ("dhr", "s", 10.0, np.nan, 0.10, 0.0, ""),
    ("brdf", "u", 0.0, 0.0, 0.06, 0.0, ""),
    ("brdf", "s", 20.0, 0.0, 0.03, 90.0, ""),
    ("brdf", "s", 20.0, 10.0, 0.04, 0.0, "b"),
    ("brdf", "s", 20.0, -10.0, 0.05, 0.0, "b"),
]


def build(rows=ROWS, **extra):
    columns = dict(zip(COLUMNS, zip(*rows, strict=True), strict=True))
    return measurement_from_columns(
        sample="a", wavelength_um=3.39, row=np.arange(len(rows)) + 2, **columns, **extra
    )


def test_scans_are_ordered_by_incidence_then_polarisation_azimuth_and_label():
    m = build()
    assert [(scan.label, scan.start, scan.stop) for scan in m.scans] == [
        ("u 0 deg", 0, 1),
        ("s 20 deg", 1, 3),
        ("s 20 deg b", 3, 5),
        ("s 20 deg phi 90 deg", 5, 6),
        ("p 20 deg", 6, 7),
    ]
    assert m.brdf.theta_r_deg.tolist() == [0, -10, 10, -10, 10, 0, 5]
    assert m.brdf.row.tolist() == [8, 5, 4, 11, 10, 9, 3]
    assert [len(scan) for scan in m.scans] == [1, 2, 2, 1, 1]


def scan_rows(theta_i, labels, theta_r=(-10.0, 0.0, 10.0, 20.0), phi=0.0):
    return [
        ("brdf", "s", float(a), float(t), 0.01 + 1e-4 * i, float(f), label)
        for i, (a, t, f, label) in enumerate(
            zip(*np.broadcast_arrays(theta_i, theta_r, phi), labels, strict=True)
        )
    ]


def test_encoder_jitter_within_the_tolerance_is_one_geometry():
    m = build(scan_rows([20.004, 19.997, 20.001, 20.0], [""] * 4))
    assert [s.label for s in m.scans] == ["s 20 deg"]
    assert m.brdf.theta_i_deg.tolist() == [20.0] * 4
    apart = build(scan_rows([20.0, 20.0, 20.06, 20.06], [""] * 4))
    assert [s.theta_i_deg for s in apart.scans] == [20.0, 20.06]
    kept = build(scan_rows([20.004, 19.997, 20.001, 20.0], [""] * 4), angle_tolerance_deg=0.0)
    assert len(kept.scans) == 4


def test_azimuths_on_both_sides_of_ninety_degrees_are_one_plane():
    m = build(scan_rows(20.0, [""] * 4, phi=[90.0, -89.99, 89.99, 90.0]))
    assert [(s.phi_r_deg, len(s)) for s in m.scans] == [(90.0, 4)]
    assert m.brdf.theta_r_deg.tolist() == [-10.0, 0.0, 10.0, 20.0]


def test_time_stamps_split_nothing_and_labels_split_repeats_only():
    stamps = [f"10:00:{i:02d}" for i in range(4)]
    assert [s.label for s in build(scan_rows(20.0, stamps)).scans] == ["s 20 deg"]
    halves = build(scan_rows(20.0, ["a", "a", "b", "b"]))
    assert [s.label for s in halves.scans] == ["s 20 deg"]
    twice = (-10.0, 10.0, -10.0, 10.0)
    assert [s.label for s in build(scan_rows(20.0, ["a", "a", "b", "b"], twice)).scans] == [
        "s 20 deg a", "s 20 deg b",
    ]  # fmt: skip
    assert len(build(scan_rows(20.0, stamps, twice)).scans) == 1
    assert [s.label for s in build(scan_rows(20.0, ["run 1"] * 4)).scans] == ["s 20 deg run 1"]


def test_dhr_rows_are_ordered_by_polarisation_and_angle():
    m = build()
    assert m.dhr.polarization.tolist() == ["s", "s", "p"]
    assert m.dhr.theta_i_deg.tolist() == [10, 40, 30]
    assert np.isnan(m.dhr.theta_r_deg).all()
    assert m.n_obs == len(m.brdf) + len(m.dhr) == len(ROWS)


@given(st.permutations(ROWS))
def test_order_of_the_rows_does_not_matter(rows):
    m, other = build(), build(rows)
    assert [scan.label for scan in m.scans] == [scan.label for scan in other.scans]
    np.testing.assert_array_equal(m.brdf.value, other.brdf.value)
    np.testing.assert_array_equal(m.dhr.value, other.dhr.value)


def test_repeated_geometries_keep_the_order_of_the_file():
    m = build([("brdf", "s", 0.0, 5.0, value, 0.0, "") for value in (3.0, 1.0, 2.0)])
    assert m.brdf.value.tolist() == [3, 1, 2]
    assert len(m.scans) == 1


def test_many_scan_labels():
    rows = [
        ("brdf", "s", 0.0, angle, 1.0, 0.0, f"{i:05d}")
        for i in range(MOST_SCANS)
        for angle in (5.0, 6.0)
    ]
    m = build(rows[::-1])
    assert [scan.label for scan in m.scans[:2]] == ["s 0 deg 00000", "s 0 deg 00001"]
    assert len(m.scans) == MOST_SCANS
    more = [("brdf", "s", 0.0, angle, 1.0, 0.0, "one more") for angle in (5.0, 6.0)]
    with pytest.raises(DataError, match=r"10001 scans in one sample \(allowed: up to 10000\)"):
        build([*rows, *more])


def test_uncertainty_of_repeats_is_that_of_their_mean():
    rows = [("brdf", "s", 0.0, float(i), 1.0, 0.0, "") for i in range(4)]
    m = build(rows, sigma=[0.4, 0.4, 0.4, np.nan], n_repeats=[np.nan, 1, 4, np.nan])
    np.testing.assert_array_equal(m.brdf.u_value, [0.4, 0.4, 0.2, np.nan])
    assert m.brdf.repeated.tolist() == [False, False, True, False]


def test_no_rows_are_refused():
    with pytest.raises(DataError, match=r"a\.csv: no usable rows for sample 'x'"):
        measurement_from_columns(
            sample="x", wavelength_um=1.0, quantity=[], polarization=[], theta_i_deg=[],
            theta_r_deg=[], value=[], source="a.csv",
        )  # fmt: skip


@pytest.mark.parametrize("dhr", [True, False])
def test_select_scans(dhr):
    m = build()
    keep = np.array([scan.polarization == "s" for scan in m.scans])
    part = select_scans(m, keep, dhr=dhr)
    assert [(scan.label, scan.start, scan.stop) for scan in part.scans] == [
        ("s 20 deg", 0, 2),
        ("s 20 deg b", 2, 4),
        ("s 20 deg phi 90 deg", 4, 5),
    ]
    assert part.brdf.row.tolist() == [5, 4, 11, 10, 9]
    assert len(part.dhr) == (3 if dhr else 0)
    for scan in part.scans:
        assert set(part.brdf.phi_r_deg[scan.rows]) == {scan.phi_r_deg}


def test_select_no_scan_at_all():
    m = build()
    part = select_scans(m, np.zeros(len(m.scans), dtype=bool), dhr=True)
    assert (len(part.brdf), part.scans, part.n_obs) == (0, (), 3)


@pytest.mark.parametrize(
    ("direction", "name"),
    [
        (("s", 20.0, 0.0), "s 20 deg"),
        (("p", 0.25, -90.0), "p 0.25 deg phi -90 deg"),
    ],
)
def test_name_direction(direction, name):
    assert name_direction(*direction) == name


@pytest.mark.parametrize("azimuth", [0.0, 30.0, -9.9, 90.0, 12.3456])
def test_both_halves_of_a_plane_are_one_scan(azimuth):
    """Written with a positive angle and the azimuth of either half."""
    theta = [10.0, 20.0, 30.0]
    for other in (azimuth + 180.0, azimuth - 180.0):
        m = build(
            [("brdf", "s", 20.0, t, 0.1 + t / 100, azimuth, "") for t in theta]
            + [("brdf", "s", 20.0, t, 0.5 + t / 100, other, "") for t in theta]
        )
        assert len(m.scans) == 1
        assert m.scans[0].phi_r_deg == azimuth
        assert m.brdf.theta_r_deg.tolist() == [-30.0, -20.0, -10.0, 10.0, 20.0, 30.0]
        np.testing.assert_allclose(m.brdf.value, [0.8, 0.7, 0.6, 0.2, 0.3, 0.4])


@given(st.floats(-90.0, 90.0), st.floats(-360.0, 360.0))
def test_the_other_name_of_a_direction_is_the_same_direction(theta_r, phi_r):
    (theta,), (phi,) = name_half_plane(np.array([theta_r]), np.array([phi_r]))
    assert -90.0 < phi <= 90.0
    if -90.0 < phi_r <= 90.0:
        assert (theta, phi) == (theta_r, phi_r)
    for axis in (np.cos, np.sin):
        old = np.sin(np.deg2rad(theta_r)) * axis(np.deg2rad(phi_r))
        assert np.sin(np.deg2rad(theta)) * axis(np.deg2rad(phi)) == pytest.approx(old, abs=1e-10)


@pytest.mark.parametrize("polarization", ["s", "p", "u"])
def test_the_model_is_the_same_for_either_name(polarization):
    theta_r, phi_r = np.array([-60.0, 5.0, 40.0, 70.0]), np.array([180.0, -180.0, 215.0, -90.0])
    theta, phi = name_half_plane(theta_r, phi_r)
    assert phi.tolist() == [0.0, 0.0, 35.0, 90.0]
    np.testing.assert_allclose(
        brdf(GREEN_PAINT, 40.0, theta, polarization, phi_r_deg=phi),
        brdf(GREEN_PAINT, 40.0, theta_r, polarization, phi_r_deg=phi_r),
        rtol=1e-12,
    )

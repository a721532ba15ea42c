"""Mistakes of the bench are named, and good readings have none."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.measurement import Measurement, Readings, measurement_from_columns
from pbrdf_bayes.readings.mistakes import find_mistakes

CASES = Path(__file__).parents[2] / ".." / "shared" / "cases"
PAINT = pb.Parameters(n=1.55, k=0.15, sigma_n0=0.5, rho0=0.35)
METAL = pb.Parameters(n=1.2, k=4.0, sigma_n0=0.7, rho0=0.15)


def simulated(paint: pb.Parameters = PAINT, seed: int = 1) -> Measurement:
    return pb.simulate_measurement(
        paint, seed=seed, theta_i_deg=(0.0, 20.0, 40.0, 60.0),
        theta_r_deg=np.arange(-80.0, 80.1, 2.5),
    )  # fmt: skip


def altered(m: Measurement, change: Callable[[Readings, np.ndarray], dict]) -> Measurement:
    """The BRDF columns changed; the second argument tells the rows of the s scan at 40 deg."""
    b, d = m.brdf, m.dhr
    one = np.zeros(len(b), dtype=bool)
    one[next(s.rows for s in m.scans if s.label == "s 40 deg")] = True
    columns = {
        "polarization": b.polarization, "theta_i_deg": b.theta_i_deg, "theta_r_deg": b.theta_r_deg,
        "value": b.value, "sigma": b.u_value,
    } | change(b, one)  # fmt: skip
    of_dhr = {
        "polarization": d.polarization, "theta_i_deg": d.theta_i_deg,
        "theta_r_deg": d.theta_r_deg, "value": d.value, "sigma": d.u_value,
    }  # fmt: skip
    joined = {k: np.concatenate([columns[k], of_dhr[k]]) for k in columns}
    return measurement_from_columns(
        sample="a", wavelength_um=1.0, quantity=["brdf"] * len(b) + ["dhr"] * len(d),
        row=np.arange(len(b) + len(d)) + 2, **joined,
    )  # fmt: skip


def exchanged(words: np.ndarray) -> np.ndarray:
    return np.where(words == "s", "p", "s")


def cosine(b: Readings) -> np.ndarray:
    return np.cos(np.deg2rad(b.theta_r_deg))


MISTAKES: dict[str, tuple[str, int, Callable[[Readings, np.ndarray], dict]]] = {
    "all signs": ("theta_r_sign", 6, lambda b, _: {"theta_r_deg": -b.theta_r_deg}),
    "one sign": ("theta_r_sign", 1, lambda b, one: {
        "theta_r_deg": np.where(one, -b.theta_r_deg, b.theta_r_deg)}),
    "no signs": ("sign_lost", 6, lambda b, _: {"theta_r_deg": np.abs(b.theta_r_deg)}),
    "all s and p": ("swapped_polarization", 4, lambda b, _: {
        "polarization": exchanged(b.polarization)}),
    "s and p at one incidence": ("swapped_polarization", 2, lambda b, _: {
        "polarization": np.where(
            b.theta_i_deg == 40.0, exchanged(b.polarization), b.polarization)}),
    "times cosine": ("cosine_factor", 10, lambda b, _: {"value": b.value * cosine(b)}),
    "over cosine": ("cosine_factor", 10, lambda b, _: {"value": b.value / cosine(b)}),
    "times pi": ("pi_factor", 6, lambda b, _: {"value": b.value * np.pi}),
    "times 10": ("scan_gain", 1, lambda b, one: {"value": b.value * np.where(one, 10.0, 1.0)}),
    "clipped": ("clipped", 1, lambda b, one: {
        "value": np.where(one, np.minimum(b.value, 0.5 * b.value[one].max()), b.value)}),
    "shadow": ("shadow", 8, lambda b, _: {
        "value": b.value * np.where(np.abs(b.theta_r_deg + b.theta_i_deg) <= 2.6, 0.2, 1.0)}),
    "shuffled": ("shuffled", 1, lambda b, one: {"value": _permute(b.value, one)}),
    "sigma too small": ("stated_sigma", 8, lambda b, _: {"sigma": 0.001 * b.value}),
    "sigma in per cent": ("stated_sigma", 8, lambda b, _: {"sigma": np.full(len(b), 2.0)}),
}  # fmt: skip


def _permute(value: np.ndarray, rows: np.ndarray) -> np.ndarray:
    mixed = value.copy()
    mixed[rows] = np.random.default_rng(4).permutation(value[rows])
    return mixed


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named_with_its_scans(name: str) -> None:
    code, n_scans, change = MISTAKES[name]
    found = find_mistakes(altered(simulated(), change))
    assert [(f.code, len(f.scans)) for f in found] == [(code, n_scans)]
    assert found[0].statement
    assert found[0].remedy


def test_sizes_and_lines() -> None:
    sizes = {
        name: find_mistakes(altered(simulated(), MISTAKES[name][2]))[0]
        for name in ("times 10", "times pi", "times cosine", "clipped")
    }
    assert sizes["times 10"].size == pytest.approx(10.0, rel=0.3)
    assert sizes["times pi"].size == pytest.approx(np.pi, rel=0.3)
    assert sizes["times cosine"].size == pytest.approx(1.0, abs=0.25)
    m = altered(simulated(), MISTAKES["clipped"][2])
    rows = m.brdf.row[m.brdf.value == sizes["clipped"].size]
    assert sorted(rows.tolist()) == list(sizes["clipped"].lines)


def test_a_zero_error_shows_at_normal_incidence() -> None:
    narrow = pb.Parameters(n=1.5, k=0.1, sigma_n0=0.5, rho0=0.05)
    fine = pb.simulate_measurement(narrow, seed=1, theta_i_deg=(0.0, 20.0, 40.0))
    shifted = altered(fine, lambda b, _: {"theta_r_deg": b.theta_r_deg + 0.6})
    found = find_mistakes(shifted)
    assert [f.code for f in found] == ["zero_theta_r"]
    assert found[0].size == pytest.approx(0.6, abs=0.1)


@pytest.mark.parametrize("kind", ["paint", "metal", "narrow", "diffuse"])
def test_readings_that_obey_the_model_are_seldom_accused(kind: str) -> None:
    """Over 1600 designs 3 of 400 metals are, and no paint."""
    rng = np.random.default_rng(7)
    accused = 0
    for i in range(25):
        metal = kind == "metal"
        paint = pb.Parameters(
            n=rng.uniform(0.3, 4.0) if metal else rng.uniform(1.35, 1.8),
            k=rng.uniform(1.0, 6.0) if metal else rng.uniform(0.0, 0.5),
            sigma_n0=rng.uniform(0.2, 0.8),
            rho0=float(np.exp(rng.uniform(*np.log([0.01, 0.1] if kind == "narrow" else [0.1, 1])))),
        )
        effects = pb.Effects(lambert=0.03, volume=0.03, backscatter=0.01)
        m = pb.simulate_measurement(
            paint, seed=i, theta_i_deg=[(20.0, 60.0), (0.0, 30.0, 60.0), (40.0,)][i % 3],
            theta_r_deg=np.arange(-80.0, 80.1, [1.0, 2.5, 5.0][i % 3]),
            polarizations=[("s", "p"), ("s",), ("u",)][(i // 3) % 3],
            relative_noise=[0.01, 0.03, 0.1][(i // 9) % 3],
            effects=effects if kind == "diffuse" else None,
        )  # fmt: skip
        accused += bool(find_mistakes(m))
    assert accused <= 1


@pytest.mark.parametrize(
    ("file", "code"),
    [
        ("00_base", None), ("sparse_good_31", None), ("01a_sign_all", "theta_r_sign"),
        ("01b_sign_one_s40", "theta_r_sign"), ("sign_lost", "sign_lost"),
        ("02a_swap_all_brdf", "swapped_polarization"),
        ("02c_swap_one_angle", "swapped_polarization"), ("03_ccbrdf", "cosine_factor"),
        ("06a_clip_s60_half", "clipped"), ("07a_gain10_s40", "scan_gain"),
        ("08a_obscured_small", "shadow"), ("11a_values_shuffled", "shuffled"),
        ("misfit_exact_angles", None),
    ],
)  # fmt: skip
def test_cases_from_outside(file: str, code: str | None) -> None:
    path = CASES / f"{file}.csv"
    if not path.is_file():
        pytest.skip(f"cases are not here: {path.resolve()}")
    found = {f.code for f in find_mistakes(pb.read_measurement(path))}
    assert found == ({code} if code else set())


def test_real_scans_are_not_accused(shared: Path) -> None:
    for path in sorted(shared.glob("*_mean3.csv")) + sorted(shared.glob("jsss_*.csv")):
        assert find_mistakes(pb.read_measurement(path)) == (), path.name

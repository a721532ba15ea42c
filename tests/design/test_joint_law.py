"""Measurements taken together: what they share, and what not, against dense algebra."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.design.batches import Pairs, best_pair, greedy_batch
from pbrdf_bayes.design.beliefs import Beliefs, beliefs_of_run
from pbrdf_bayes.design.candidates import Candidate, are_alike, distinct_labels
from pbrdf_bayes.design.evaluate import (
    Evaluated,
    Stage,
    draw_reading,
    nested_estimate,
    set_stage,
    told_by,
)
from pbrdf_bayes.design.hemispherical import hemispherical_values
from pbrdf_bayes.design.linear import LinearLaw, linear_law
from pbrdf_bayes.design.run import DesignChoices, design_measurements
from pbrdf_bayes.design.summary import summarise_design
from pbrdf_bayes.inference.parameters.table import PHYSICAL
from pbrdf_bayes.inference.posterior import build_posterior
from pbrdf_bayes.model.simulate import GREEN_PAINT, simulate_measurement

SCAN = tuple(float(a) for a in range(-60, 61, 10))
TAU, ELL, NOISE, U_CAL, U_DHR, U_DHR_CAL = 0.05, 25.0, 0.02, 0.03, 0.002, 0.02
FIXED = {
    "s_rel_s": NOISE, "s_rel_p": NOISE, "tau": TAU, "ell_deg": ELL, "u_dhr": U_DHR
}  # fmt: skip
SPREAD = 0.02


@pytest.fixture(scope="module")
def known() -> Beliefs:
    """Normal draws of the four parameters; the instrument is known."""
    m = simulate_measurement(
        GREEN_PAINT, seed=1, theta_i_deg=(20.0,), theta_r_deg=np.arange(-60.0, 61.0, 5.0),
        dhr_theta_i_deg=(10.0,),
    )  # fmt: skip
    priors = {name: {"kind": "fixed", "value": value} for name, value in FIXED.items()}
    config = pb.RunConfig(u_brdf_cal=U_CAL, u_dhr_cal=U_DHR_CAL, accuracy="draft", priors=priors)
    posterior = build_posterior(m, config)
    centre = np.array([{**vars_of(GREEN_PAINT), **FIXED}[n] for n in posterior.parameter_names])
    x = np.repeat(centre[None], 2700, axis=0)
    x[:, :4] *= 1.0 + SPREAD * np.random.default_rng(2).standard_normal((2700, 4))
    return replace(beliefs_of_run(posterior, x), measured=False)


def vars_of(paint: pb.Parameters) -> dict[str, float]:
    return dict(zip(PHYSICAL, paint.as_array().tolist(), strict=True))


def scan_of(q: str, theta_i: float, minutes: float = 10.0, scan=SCAN) -> Candidate:
    return Candidate("brdf", q, theta_i, minutes, theta_r_deg=scan)


def dhr_of(q: str, theta_i: float) -> Candidate:
    return Candidate("dhr", q, theta_i, 3.0)


@pytest.fixture(scope="module")
def stage(known: Beliefs) -> Stage:
    # nothing is nuisance, so that measured or not makes no difference but for the readings so far
    return set_stage(known, n_outer=1200, n_inner=1500, n_nuisance=2, seed=5)


def put_to(stage: Stage, candidate: Candidate) -> Evaluated:
    found = nested_estimate(stage, candidate, stage.outer.x[:, :4], stage.inner.x[:, :4])
    return Evaluated(candidate, *found, told_by(stage, candidate))


@pytest.fixture(scope="module")
def law(stage: Stage) -> LinearLaw:
    return linear_law(stage.paints)


def model(x: np.ndarray, candidate: Candidate) -> np.ndarray:
    paint = pb.Parameters(**dict(zip(PHYSICAL, x.tolist(), strict=True)))
    if candidate.quantity == "dhr":
        return pb.dhr(paint, [candidate.theta_i_deg], candidate.polarization)
    f = pb.brdf(paint, candidate.theta_i_deg, candidate.theta_r_deg, candidate.polarization)
    return np.log(f)


def information(members: list[Candidate]) -> float:
    """1/2 ln det(1 + S J' R^-1 J), the Jacobians of all readings stacked and R dense."""
    x0 = GREEN_PAINT.as_array()
    slopes, blocks = [], []
    for c in members:
        columns = []
        for i in range(4):
            step = np.zeros(4)
            step[i] = 1e-4 * x0[i]
            columns.append((model(x0 + step, c) - model(x0 - step, c)) / (2.0 * step[i]))
        slopes.append(np.stack(columns, axis=1))
        if c.quantity == "dhr":
            blocks.append(np.array([[U_DHR**2]]))
        else:
            t = np.array(c.theta_r_deg)
            a = np.sqrt(3.0) * np.abs(t[:, None] - t) / ELL
            k = TAU**2 * (1.0 + a) * np.exp(-a) + U_CAL**2
            blocks.append(k + NOISE**2 * np.eye(t.size))
    n = [len(b) for b in blocks]
    r = np.zeros((sum(n), sum(n)))
    for at, block in zip(np.cumsum([0, *n[:-1]]), blocks, strict=True):
        r[at : at + len(block), at : at + len(block)] = block
    for q in "sp":  # one gain for all DHR of a polarisation
        here = [
            float(model(x0, c)[0]) if c.quantity == "dhr" and c.polarization == q else 0.0
            for c in members for _ in range(len(c.theta_r_deg) or 1)
        ]  # fmt: skip
        r += U_DHR_CAL**2 * np.outer(here, here)
    j = np.concatenate(slopes) * (SPREAD * x0)
    return 0.5 * float(np.linalg.slogdet(np.eye(4) + j.T @ np.linalg.solve(r, j))[1])


@pytest.mark.parametrize(
    "candidate", [scan_of("p", 55.0), scan_of("s", 85.0), dhr_of("s", 70.0)], ids=lambda c: c.label
)
def test_the_nested_estimate_is_the_closed_form(stage: Stage, candidate: Candidate) -> None:
    """With the model itself, normal parameters, and the law of the readings in dense algebra."""
    gain = put_to(stage, candidate).gain
    wanted = information([candidate])
    assert abs(gain.eig - wanted) < 3.0 * gain.se + 0.02 * wanted


@pytest.mark.parametrize(
    "members",
    [
        [scan_of("p", 55.0)],
        [dhr_of("s", 70.0)],
        [scan_of("s", 85.0), scan_of("p", 85.0)],
        [scan_of("s", 60.0), scan_of("s", 40.0), scan_of("p", 60.0)],
        [dhr_of("s", 70.0), dhr_of("s", 75.0), scan_of("p", 55.0)],
        [dhr_of("s", 70.0), dhr_of("s", 70.0), dhr_of("s", 70.0), dhr_of("p", 70.0)],
    ],
    ids=lambda members: " + ".join(c.label for c in members),
)
def test_the_linear_law_is_the_closed_form(
    stage: Stage, law: LinearLaw, members: list[Candidate]
) -> None:
    """Normal parameters: determinants with the Jacobians stacked and R dense, repeats included."""
    terms = law.gain([told_by(stage, c) for c in members])
    se = terms.std(ddof=1) / np.sqrt(terms.size)
    assert abs(terms.mean() - information(members)) < 3.0 * se + 0.02 * information(members)


def test_a_dhr_may_be_taken_again(stage: Stage, law: LinearLaw) -> None:
    """With noise of its own and the gain of the first: as the dense law of both."""
    batch = greedy_batch(stage, law, [put_to(stage, dhr_of("s", 70.0))], minutes=6.0, most=4)
    assert [e.candidate.label for e in batch.members] == ["DHR_s at 70°", "DHR_s at 70°"]
    wanted = information([dhr_of("s", 70.0), dhr_of("s", 70.0)])
    assert abs(batch.eig - wanted) < 3.0 * batch.gains[-1].se + 0.02 * wanted


def test_noise_of_different_measurements_is_independent(known: Beliefs) -> None:
    """Of two scans, two DHR of a polarisation, and a DHR with itself at other minutes."""
    from pbrdf_bayes.design.scans import draw_scans, law_of_rows, plan_scan

    stage = set_stage(known, n_outer=1500, n_inner=200, n_nuisance=2, seed=6)
    white = []
    for angle in (50.0, 55.0):
        planned = plan_scan(known, scan_of("p", angle), np.ones(len(SCAN), dtype=bool))
        brdf, _ = known.posterior.predict(stage.outer.x, planned.geometry)
        law = law_of_rows(known, planned, stage.outer, brdf)
        y = draw_scans(known, planned, law, seed=7)
        white.append((y.T - law.mean).mean(axis=1))
    assert abs(np.corrcoef(white)[0, 1]) < 4.0 / np.sqrt(1500)
    gain_only = replace(stage, seed=8)
    residuals, own = [], []
    for angle in (30.0, 70.0):
        there = dhr_of("s", angle)
        value = hemispherical_values(known.posterior, there, stage.outer.x)
        residuals.append(draw_reading(gain_only, there, value) - value)
        own.append(value.mean())
    shared = U_DHR_CAL**2 * own[0] * own[1]
    size = [np.sqrt(U_DHR_CAL**2 * d**2 + U_DHR**2) for d in own]
    wanted = shared / (size[0] * size[1])
    assert np.corrcoef(residuals)[0, 1] == pytest.approx(wanted, abs=4.0 / np.sqrt(1500))


def test_gains_do_not_depend_on_the_order_of_candidates(known: Beliefs) -> None:
    small = DesignChoices(n_outer=60, n_inner=120, n_nuisance=2, batch=1, seed=3)
    options = [scan_of("p", 55.0), dhr_of("s", 70.0), scan_of("s", 40.0)]
    found = [
        {e.candidate: e.gain.eig for e in
         design_measurements(known, order, choices=small).evaluated}
        for order in (options, options[::-1])
    ]  # fmt: skip
    assert found[0] == found[1]


def test_a_geometry_is_taken_once(stage: Stage, law: LinearLaw) -> None:
    """Other minutes and another range of the scan are no new geometry."""
    same = [scan_of("p", 55.0), scan_of("p", 55.0, 12.0), scan_of("p", 55.0, 9.0, SCAN[:8])]
    options = [put_to(stage, c) for c in (*same, scan_of("s", 40.0))]
    batch = greedy_batch(stage, law, options, minutes=np.inf, most=4)
    labels = [e.candidate.label for e in batch.members]
    assert sorted(labels) == ["p scan at 55°", "s scan at 40°"]
    assert best_pair(stage, law, options[:3], minutes=np.inf) is None
    pairs = best_pair(stage, law, options, minutes=np.inf)
    assert isinstance(pairs, Pairs)
    assert pairs.n_compared == 3
    assert len({e.candidate.geometry for e in pairs.best.members}) == 2


def test_scans_close_to_one_another_are_taken_once(stage: Stage, law: LinearLaw) -> None:
    """A discrepancy of the model does not average out between 56 and 56.5 deg."""
    near = [scan_of("p", a) for a in (56.0, 56.001, 56.002, 56.5)]
    options = [put_to(stage, c) for c in (*near, scan_of("s", 56.0))]
    batch = greedy_batch(stage, law, options, minutes=np.inf, most=4)
    assert sorted(e.candidate.polarization for e in batch.members) == ["p", "s"]
    assert best_pair(stage, law, options[:4], minutes=np.inf) is None
    pairs = best_pair(stage, law, options, minutes=np.inf)
    assert isinstance(pairs, Pairs)
    assert pairs.n_compared == 4


def test_scans_about_a_measured_one_are_taken_once() -> None:
    """Both have the discrepancy of the scan between them, 1 deg apart from each other."""
    m = simulate_measurement(
        GREEN_PAINT, seed=1, theta_i_deg=(20.0,), theta_r_deg=SCAN, dhr_theta_i_deg=(10.0,)
    )
    assert are_alike(scan_of("p", 19.4), scan_of("p", 20.6), m)
    assert not are_alike(scan_of("p", 19.4), scan_of("p", 20.6), None)
    assert not are_alike(scan_of("p", 19.4), scan_of("s", 20.6), m)
    assert not are_alike(scan_of("p", 39.4), scan_of("p", 40.6), m)
    assert not are_alike(dhr_of("s", 20.0), dhr_of("s", 20.1), m)


def test_labels_that_would_be_equal_say_what_differs(known: Beliefs) -> None:
    options = [
        scan_of("p", 55.0), scan_of("p", 55.0, 20.0), scan_of("p", 55.0, 10.0, SCAN[6:]),
        scan_of("p", 50.0), dhr_of("s", 70.0),
    ]  # fmt: skip
    assert distinct_labels(options) == (
        "p scan at 55°, -60 to 60° in 13 readings, 10 min",
        "p scan at 55°, -60 to 60° in 13 readings, 20 min",
        "p scan at 55°, 0 to 60° in 7 readings, 10 min",
        "p scan at 50°",
        "DHR_s at 70°",
    )
    small = DesignChoices(n_outer=60, n_inner=120, n_nuisance=2, batch=2, seed=3)
    found = summarise_design(design_measurements(known, options, choices=small), None)
    assert {row["label"] for row in found["candidates"]} == set(distinct_labels(options))
    known_labels = {row["label"] for row in found["candidates"]}
    assert {row["label"] for row in found["batch"]["members"]} <= known_labels


def test_quoted_errors_are_the_spread_over_seeds(known: Beliefs) -> None:
    """Gain and standard deviation left, for 24 sets of draws."""
    found: dict[str, list[tuple[float, float]]] = {"gain": [], "sd": []}
    rng = np.random.default_rng(9)
    centre = known.x[0].copy()
    for seed in range(24):
        x = np.repeat(centre[None], 500, axis=0)
        x[:, :4] = GREEN_PAINT.as_array() * (1.0 + SPREAD * rng.standard_normal((500, 4)))
        here = set_stage(
            replace(known, x=x), n_outer=300, n_inner=200, n_nuisance=2, seed=seed
        )  # fmt: skip
        one = put_to(here, scan_of("p", 55.0))
        ratio, se = one.spread.sd_ratio()
        found["gain"].append((one.gain.eig, one.gain.se))
        found["sd"].append((float(ratio[1]), float(se[1])))
    for name, pairs in found.items():
        values, errors = np.array(pairs).T
        ratio = values.std(ddof=1) / np.sqrt(np.mean(errors**2))
        assert 0.6 < ratio < 1.4, (name, ratio)

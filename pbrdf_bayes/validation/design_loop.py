"""Whether the information that a design promises is what measuring and fitting again gives.

A paint is measured and fitted. For each candidate a truth is drawn from that posterior, the
candidate is measured on it by the law of the readings, everything is fitted again, and the drop of
the entropy
of (n, k, sigma_N0, rho0) is averaged over such truths: its expectation is the expected
information gain. Entropies are those of t mixtures fitted to the draws, before and after alike.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.design.beliefs import Beliefs, DrawnSets, beliefs_of_run, draw_sets
from pbrdf_bayes.design.candidates import Candidate, Costs, list_candidates
from pbrdf_bayes.design.hemispherical import draw_hemispherical, gain_law, hemispherical_values
from pbrdf_bayes.design.run import DesignChoices, DesignResult, design_measurements
from pbrdf_bayes.design.scans import draw_scans, law_of_rows, plan_scan
from pbrdf_bayes.errors import FitError
from pbrdf_bayes.inference.importance import K_HAT_LIMIT, adapt_mixture, importance_sample
from pbrdf_bayes.inference.laplace import laplace_mixture
from pbrdf_bayes.inference.map_fit import find_map
from pbrdf_bayes.inference.mixture import fit_mixture
from pbrdf_bayes.inference.posterior import build_posterior
from pbrdf_bayes.measurement import Measurement, measurement_from_columns
from pbrdf_bayes.model import Parameters
from pbrdf_bayes.simulate import simulate_measurement

Array = NDArray[np.float64]

CONFIG = RunConfig(accuracy="draft", holdout=False, threads=1)
SCAN = tuple(float(a) for a in range(-80, 81, 4))
PAINTS: Mapping[str, Parameters] = {
    "published": Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47),
    "smooth": Parameters(n=1.5, k=0.05, sigma_n0=0.6, rho0=0.08),
    "rough": Parameters(n=1.45, k=0.1, sigma_n0=0.3, rho0=1.2),
    "absorbing": Parameters(n=1.7, k=0.6, sigma_n0=0.5, rho0=0.3),
    "low index": Parameters(n=1.4, k=0.1, sigma_n0=0.7, rho0=0.6),
}
CANDIDATES: tuple[Candidate, ...] = tuple(
    Candidate(kind, q, angle, minutes=Costs().of(kind, len(SCAN)),
              theta_r_deg=SCAN if kind == "brdf" else ())
    for kind, q, angle in (
        ("brdf", "s", 75.0), ("brdf", "p", 45.0), ("brdf", "p", 75.0), ("brdf", "p", 60.0),
        ("dhr", "s", 80.0), ("dhr", "p", 80.0),
    )
)  # fmt: skip
"""Scans at new angles, a repeat of what was measured, and DHR."""
_MISFIT, _NOISE, _U_DHR = 0.03, 0.02, 0.001
_COMPONENTS = 5
_N_PROPOSALS, _N_DRAWS = 16_000, 4_000


def first_measurement(paint: str, *, seed: int) -> Measurement:
    """Scans of s and p light at 20 and 60 deg and DHR readings of a paint."""
    return simulate_measurement(
        PAINTS[paint], seed=seed, theta_i_deg=(20.0, 60.0), theta_r_deg=SCAN,
        polarizations=("s", "p"), dhr_theta_i_deg=(10.0, 45.0, 70.0), relative_noise=_NOISE,
        dhr_noise=_U_DHR,
    )  # fmt: skip


def fitted(measurement: Measurement, *, seed: int) -> Beliefs:
    """Posterior draws of a measurement, by importance sampling.

    Raises
    ------
    FitError
        When its weights are not reliable.
    """
    posterior = build_posterior(measurement, CONFIG)
    optima = find_map(posterior, n_starts=6, seed=seed)
    mixture = adapt_mixture(posterior, laplace_mixture(posterior, optima), seed=seed)
    found = importance_sample(
        posterior, mixture, n_proposals=_N_PROPOSALS, n_draws=_N_DRAWS, seed=seed
    )
    if found.k_hat > K_HAT_LIMIT:
        msg = f"importance sampling of the study is not reliable: k-hat {found.k_hat:.2f}"
        raise FitError(msg)
    return beliefs_of_run(posterior, posterior.from_coordinates(found.z))


def entropy(beliefs: Beliefs, *, seed: int) -> float:
    """Entropy of the parameters of interest in z, from t mixtures fitted to half of the draws."""
    z = beliefs.posterior.to_coordinates(beliefs.x)[:, beliefs.columns_about]
    centre, root = z.mean(axis=0), np.linalg.cholesky(np.cov(z, rowvar=False))
    scaled = np.linalg.solve(root, (z - centre).T).T
    rng = np.random.default_rng([seed, 50])
    half = rng.permutation(len(z)) % 2 == 0
    even = np.full(int(half.sum()), 1.0 / half.sum())
    mixture = fit_mixture(scaled[half], even, _COMPONENTS, rng)
    return float(-mixture.log_density(scaled[~half]).mean() + np.log(np.diag(root)).sum())


def measure(
    beliefs: Beliefs, candidates: Sequence[Candidate], truth: Array, *, seed: int
) -> Measurement:
    """The readings so far with simulated ones of the candidates.

    Parameters
    ----------
    beliefs : Beliefs
    candidates : sequence of Candidate
        Distinct geometries.
    truth : ndarray, shape (n_par,)
    seed : int

    Returns
    -------
    Measurement
    """
    sets = draw_sets(beliefs, truth[None, :], np.random.default_rng([seed, 51]))
    columns = _columns(beliefs.posterior.measurement)
    for candidate in candidates:
        values = _readings(beliefs, candidate, sets, seed)
        n = len(values)
        columns["quantity"] += [candidate.quantity] * n
        columns["polarization"] += [candidate.polarization] * n
        columns["theta_i_deg"] += [candidate.theta_i_deg] * n
        columns["theta_r_deg"] += list(candidate.theta_r_deg) or [np.nan] * n
        columns["value"] += values
        columns["scan"] += ["next"] * n
    return measurement_from_columns(sample="loop_simulated", wavelength_um=1.0, **columns)


def _readings(beliefs: Beliefs, candidate: Candidate, sets: DrawnSets, seed: int) -> list[float]:
    if candidate.quantity == "brdf":
        everything = np.ones(len(candidate.theta_r_deg), dtype=bool)
        planned = plan_scan(beliefs, candidate, everything)
        brdf, _ = beliefs.posterior.predict(sets.x, planned.geometry)
        law = law_of_rows(beliefs, planned, sets, brdf)
        kind = round(candidate.theta_i_deg * 10) + 10_000 * "spu".index(candidate.polarization)
        y = draw_scans(beliefs, planned, law, seed=seed + kind)[planned.new, 0]
        return [float(v) for v in np.exp(y)]
    value = hemispherical_values(beliefs.posterior, candidate, sets.x)
    gain = gain_law(beliefs, candidate.polarization, sets)
    seeds = (seed, 52, "spu".index(candidate.polarization))
    return [float(draw_hemispherical(value, gain, sets, seed=seeds)[0])]


def _columns(m: Measurement) -> dict[str, Any]:
    labels = [f"first {i}" for i, s in enumerate(m.scans) for _ in range(len(s))]
    brdf, dhr = m.brdf, m.dhr
    return {
        "quantity": ["brdf"] * len(brdf) + ["dhr"] * len(dhr),
        "polarization": [*brdf.polarization.tolist(), *dhr.polarization.tolist()],
        "theta_i_deg": [*brdf.theta_i_deg.tolist(), *dhr.theta_i_deg.tolist()],
        "theta_r_deg": [*brdf.theta_r_deg.tolist(), *dhr.theta_r_deg.tolist()],
        "value": [*brdf.value.tolist(), *dhr.value.tolist()],
        "scan": [*labels, *[""] * len(dhr)],
    }


def realised_drops(
    beliefs: Beliefs, candidates: Sequence[Candidate], *, n: int, seed: int
) -> Array:
    """Drop of the entropy by measuring and fitting again, for n truths, shape (n,) [nat].

    Truths follow from the seed: the same ones for every candidate would share their luck.
    """
    before = entropy(beliefs, seed=seed)
    truths = beliefs.x[np.random.default_rng([seed, 53]).choice(len(beliefs.x), n, replace=False)]
    drops = []
    for i, truth in enumerate(truths):
        after = fitted(measure(beliefs, candidates, truth, seed=1000 * seed + i), seed=seed + i)
        drops.append(before - entropy(after, seed=seed))
    return np.array(drops)


def compare(
    paint: str, *, n: int, seed: int, candidates: Sequence[Candidate] = CANDIDATES
) -> list[dict[str, Any]]:
    """Promised and realised information of candidates for one paint.

    Parameters
    ----------
    paint : str
        One of `PAINTS`.
    n : int
        Truths for each candidate.
    seed : int
    candidates : sequence of Candidate

    Returns
    -------
    list of dict
        ``eig``, ``se``, ``low``, ``high`` as promised, ``realised`` and ``realised_se`` [nat].
    """
    beliefs = fitted(first_measurement(paint, seed=seed), seed=seed)
    promised = design_measurements(beliefs, candidates, choices=_choices(seed))
    rows: list[dict[str, Any]] = []
    for e in promised.evaluated:
        drops = realised_drops(beliefs, [e.candidate], n=n, seed=seed + 100 * (len(rows) + 1))
        rows.append({
            "paint": paint, "candidate": e.candidate.label, "eig": e.gain.eig, "se": e.gain.se,
            "low": e.gain.low, "high": e.gain.high, "realised": float(drops.mean()),
            "realised_se": float(drops.std(ddof=1) / np.sqrt(n)), "n": n,
        })  # fmt: skip
    return rows


def _choices(seed: int) -> DesignChoices:
    return DesignChoices(n_outer=400, n_inner=2000, batch=3, seed=seed, threads=1)


def compare_grids(paint: str, *, n: int, seed: int) -> list[dict[str, Any]]:
    """Three scans chosen by the tool, evenly spread and at random: information realised."""
    beliefs = fitted(first_measurement(paint, seed=seed), seed=seed)
    options = list_candidates(
        quantities=("brdf",), polarizations=("s", "p"), theta_i_deg=range(0, 85, 10),
        theta_r_deg=SCAN,
    )  # fmt: skip
    by_name = {(c.polarization, c.theta_i_deg): c for c in options}
    chosen: DesignResult = design_measurements(beliefs, options, choices=_choices(seed))
    rng = np.random.default_rng([seed, 54])
    random = [[options[i] for i in rng.choice(len(options), 3, replace=False)] for _ in range(n)]
    grids: dict[str, Callable[[int], list[Candidate]]] = {
        "chosen": lambda _: [e.candidate for e in chosen.batch.members],
        "uniform": lambda i: [
            by_name["sp"[(i + j) % 2], a] for j, a in enumerate((0.0, 40.0, 80.0))
        ],
        "random": lambda i: random[i],
    }  # fmt: skip
    rows = []
    for name, grid in grids.items():
        drops = [realised_drops(beliefs, grid(i), n=1, seed=seed + 100 * i)[0] for i in range(n)]
        rows.append({
            "paint": paint, "grid": name, "minutes": sum(c.minutes for c in grid(0)),
            "realised": float(np.mean(drops)), "realised_se": float(np.std(drops, ddof=1) / n**0.5),
            "scans": [c.label for c in grid(0)],
            "promised": chosen.batch.eig if name == "chosen" else None,
        })  # fmt: skip
    return rows


def run_loop(
    *, n: int = 16, seed: int = 3, told: Callable[[str], None] = lambda _: None
) -> dict[str, list[dict[str, Any]]]:
    """Both studies over all paints: candidates one by one, and grids of three scans."""
    found: dict[str, list[dict[str, Any]]] = {"candidates": [], "grids": []}
    for paint in PAINTS:
        told(f"{paint}: candidates")
        found["candidates"] += compare(paint, n=n, seed=seed)
        told(f"{paint}: grids")
        found["grids"] += compare_grids(paint, n=n, seed=seed)
    return found


def main() -> int:
    """``python -m pbrdf_bayes.validation.design_loop``: both studies as JSON, half an hour."""
    found = run_loop(told=lambda line: _write(sys.stderr, line))
    _write(sys.stdout, json.dumps(found, indent=1, ensure_ascii=False))
    return 0


def _write(stream: TextIO, line: str) -> None:
    stream.write(line + "\n")
    stream.flush()


if __name__ == "__main__":
    sys.exit(main())

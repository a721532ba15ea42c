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
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes import __version__
from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.design.beliefs import Beliefs, DrawnSets, beliefs_of_run, draw_sets
from pbrdf_bayes.design.candidates import Candidate, Costs, list_candidates
from pbrdf_bayes.design.hemispherical import draw_hemispherical, gain_law, hemispherical_values
from pbrdf_bayes.design.run import DesignChoices, DesignResult, design_measurements
from pbrdf_bayes.design.scans import draw_scans, law_of_rows, plan_scan
from pbrdf_bayes.errors import FitError
from pbrdf_bayes.inference.optimum.laplace import laplace_mixture
from pbrdf_bayes.inference.optimum.map_fit import find_map
from pbrdf_bayes.inference.posterior import build_posterior
from pbrdf_bayes.inference.sampling.importance import K_HAT_LIMIT, adapt_mixture, importance_sample
from pbrdf_bayes.inference.sampling.mixture import fit_mixture
from pbrdf_bayes.io.run_folder import write_text
from pbrdf_bayes.io.significant import significant
from pbrdf_bayes.measurement import Measurement, measurement_from_columns
from pbrdf_bayes.model.four_parameter import Parameters
from pbrdf_bayes.model.simulate import simulate_measurement
from tools.validation.loop_page import render_loop
from tools.validation.run import pool, say

Array = NDArray[np.float64]

DEFAULT_FOLDER = Path("reports") / "design_loop"
N_TRUTHS = 24
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
_DIGITS = 4
_N_PROPOSALS, _N_DRAWS = 16_000, 4_000
_N_BEFORE = 8
"""Fits of the first measurement whose entropies are averaged: its error is in every drop."""


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
        y = draw_scans(beliefs, planned, law, seed=seed)[planned.new, 0]
        return [float(v) for v in np.exp(y)]
    value = hemispherical_values(beliefs.posterior, candidate, sets.x)
    gain = gain_law(beliefs, candidate.polarization, sets)
    seeds = (seed, 52, "spu".index(candidate.polarization))
    read = draw_hemispherical(value, gain, sets, seed=seeds, key=candidate.geometry)
    return [float(read[0])]


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


@dataclass(frozen=True, eq=False)
class Start:
    """What is known of a paint before the next measurement.

    Attributes
    ----------
    beliefs : Beliefs
    entropy, u_entropy : float
        Mean over independent fits of the same readings, and its standard error [nat].
    """

    beliefs: Beliefs
    entropy: float
    u_entropy: float


def first_fit(paint: str, *, seed: int) -> Start:
    """The first measurement of a paint, fitted several times."""
    measurement = first_measurement(paint, seed=seed)
    fits = [fitted(measurement, seed=seed + i) for i in range(_N_BEFORE)]
    found = np.array([entropy(fit, seed=seed + i) for i, fit in enumerate(fits)])
    return Start(fits[0], float(found.mean()), float(found.std(ddof=1) / np.sqrt(len(found))))


def realised_drops(start: Start, candidates: Sequence[Candidate], *, n: int, seed: int) -> Array:
    """Drop of the entropy by measuring and fitting again, for n truths, shape (n,) [nat].

    Truths follow from the seed: the same ones for every candidate would share their luck.
    """
    beliefs = start.beliefs
    truths = beliefs.x[np.random.default_rng([seed, 53]).choice(len(beliefs.x), n, replace=False)]
    drops = []
    for i, truth in enumerate(truths):
        after = fitted(measure(beliefs, candidates, truth, seed=1000 * seed + i), seed=seed + i)
        drops.append(start.entropy - entropy(after, seed=seed + i))
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
    start = first_fit(paint, seed=seed)
    promised = design_measurements(start.beliefs, candidates, choices=_choices(seed))
    rows: list[dict[str, Any]] = []
    for e in promised.evaluated:
        drops = realised_drops(start, [e.candidate], n=n, seed=seed + 100 * (len(rows) + 1))
        rows.append({
            "paint": paint, "candidate": e.candidate.label, "eig": e.gain.eig, "se": e.gain.se,
            "low": e.gain.low, "high": e.gain.high, "realised": float(drops.mean()),
            "realised_se": _error_of(drops, start), "n": n,
        })  # fmt: skip
    return rows


def _error_of(drops: Array, start: Start) -> float:
    """Standard error of the mean drop, that of the entropy before included."""
    return float(np.hypot(drops.std(ddof=1) / np.sqrt(drops.size), start.u_entropy))


def _choices(seed: int) -> DesignChoices:
    return DesignChoices(n_outer=400, n_inner=2000, batch=3, seed=seed, threads=1)


def compare_grids(paint: str, *, n: int, seed: int) -> list[dict[str, Any]]:
    """Three scans chosen by the tool, evenly spread and at random: information realised."""
    start = first_fit(paint, seed=seed)
    options = list_candidates(
        quantities=("brdf",), polarizations=("s", "p"), theta_i_deg=range(0, 85, 10),
        theta_r_deg=SCAN,
    )  # fmt: skip
    by_name = {(c.polarization, c.theta_i_deg): c for c in options}
    chosen: DesignResult = design_measurements(start.beliefs, options, choices=_choices(seed))
    whole = chosen.batch.gains[-1]
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
        drops = np.array(
            [realised_drops(start, grid(i), n=1, seed=seed + 100 * i)[0] for i in range(n)]
        )
        rows.append({
            "paint": paint, "grid": name, "minutes": sum(c.minutes for c in grid(0)), "n": n,
            "realised": float(drops.mean()), "realised_se": _error_of(drops, start),
            "scans": [c.label for c in grid(0)] if name != "random" else [],
            "promised": whole.eig if name == "chosen" else None,
            "promised_se": float(np.hypot(whole.se, 0.25 * (whole.high - whole.low)))
            if name == "chosen" else None,
        })  # fmt: skip
    return rows


def study_paint(paint: str, *, n: int = N_TRUTHS, seed: int = 3) -> dict[str, Any]:
    """Both studies of one paint: candidates one by one, and grids of three scans."""
    return {
        "candidates": compare(paint, n=n, seed=seed),
        "grids": compare_grids(paint, n=n, seed=seed),
    }


def run_loop(
    *, n: int = N_TRUTHS, processes: int = 2, told: Callable[[str], None] = lambda _: None
) -> dict[str, Any]:
    """Both studies over all paints.

    Parameters
    ----------
    n : int
        Truths for each candidate and each grid.
    processes : int
        Paints that are studied at the same time; results do not depend on it.
    told : callable
        Told how far it is.

    Returns
    -------
    dict
        The content of ``design_loop.json``.
    """
    started = perf_counter()
    with pool(processes) as run:
        parts = []
        for paint, part in zip(PAINTS, run(partial(study_paint, n=n), PAINTS), strict=True):
            told(f"{paint}: done")
            parts.append(part)
    return {
        "version": __version__,
        "seconds": round(perf_counter() - started),
        "n": n,
        "candidates": [row for part in parts for row in part["candidates"]],
        "grids": [row for part in parts for row in part["grids"]],
    }


def write_loop(result: dict[str, Any], folder: Path) -> Path:
    """Write ``index.html`` and ``design_loop.json``; returns the page's path."""
    folder.mkdir(parents=True, exist_ok=True)
    shown = significant(result, _DIGITS)
    text = json.dumps(shown, indent=1, ensure_ascii=False)
    write_text(folder / "design_loop.json", text + "\n")
    page = folder / "index.html"
    write_text(page, render_loop(shown))
    return page


def main(arguments: Sequence[str]) -> int:
    """``python -m tools.validation.design_loop [FOLDER]``; prints the page's path."""
    folder = Path(arguments[0]) if arguments else DEFAULT_FOLDER
    result = run_loop(told=lambda line: say(f"{line}\n"))
    sys.stdout.write(f"{write_loop(result, folder)}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

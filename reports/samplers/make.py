"""Compare samplers on the same posteriors: samplers.json and index.html beside this file.

OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python reports/samplers/make.py

Run it by hand on a machine that does nothing else; it needs the extra ``test`` (dynesty, nautilus).
All samplers see the very same density. They take turns in one process, so that whatever else the
machine does disturbs all of them. ``test_sampler_comparison.py`` looks at what is committed.
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from time import perf_counter
from typing import Any

import dynesty
import emcee
import nautilus
import numpy as np
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

import pbrdf_bayes as pb
from pbrdf_bayes.inference import arviz_adapter
from pbrdf_bayes.inference.optimum.laplace import laplace_mixture
from pbrdf_bayes.inference.optimum.map_fit import find_map
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.sampling.mixture import Mixture
from pbrdf_bayes.inference.sampling.sampling import sample_posterior, start_walkers
from pbrdf_bayes.model.simulate import simulate_measurement

Array = NDArray[np.float64]
Moves = list[tuple[Any, float]]

HERE = Path(__file__).parent
POSTERIORS = {
    "easy": "Five angles, s and p, with DHR: 10 scans of 321 points and 16 DHR readings",
    "curved": "One angle (60°), s and p, without DHR: 2 scans of 321 points",
}
OURS, OURS_DRAFT = "ours (standard)", "ours (draft: importance sampling)"
STRETCH = "emcee, stretch move (its default)"
N_ENSEMBLES, N_WALKERS, ROUNDS = 4, 32, 2
GOALS = {"correlated": 10.0, "iid": 3.0}
"""Seconds to an effective sample size of 2000, by likelihood."""


@dataclass(frozen=True)
class Effort:
    """Seconds of an emcee run and of a round of it; sizes of the nested samplers."""

    seconds: float = 8.0
    dynesty_live: int = 70
    nautilus_live: int = 500
    nautilus_effective: int = 1000


class Asked(pb.RunConfig):
    """The choices of a run that asks for 2000 effective draws."""

    @property
    def ess_target(self) -> int:
        """Of every parameter, bulk and tail."""
        return 2000


@dataclass(frozen=True, eq=False)
class Found:
    """What one sampler gave: draws with weights, effective sample size, and what they cost."""

    x: Array
    weights: Array
    ess: float
    seconds: float
    evaluations: int
    note: str = ""


# Posteriors ---------------------------------------------------------------------------------------


def build(name: str, noise: str = "correlated", *, points: int = 321) -> Posterior:
    """One of `POSTERIORS`, from simulated readings of the published paint."""
    choices: dict[str, Any] = {"theta_r_deg": np.linspace(-80.0, 80.0, points)}
    if name == "curved":
        choices |= {"theta_i_deg": (60.0,), "dhr_theta_i_deg": ()}
    measurement = simulate_measurement(pb.GREEN_PAINT, seed=1, **choices)
    return pb.build_posterior(measurement, pb.RunConfig(noise=noise, threads=1))


# Samplers -----------------------------------------------------------------------------------------


def run_ours(posterior: Posterior, laplace: Mixture, method: str, seed: int) -> Found:
    """As ``fit`` samples, the adaptation of the proposal included."""
    started = perf_counter()
    draws = sample_posterior(posterior, laplace, posterior.config, method=method, seed=seed)
    seconds = perf_counter() - started
    note = f"{draws.method}{'' if draws.converged else ', not converged'}"
    flat = draws.flat
    equal = np.full(len(flat), 1.0 / len(flat))
    evaluations = draws.n_evaluations
    return Found(flat, equal, float(draws.ess_bulk.min()), seconds, evaluations, note)


@dataclass
class Walk:
    """Independent emcee ensembles with given moves, from the starts that ours would take."""

    posterior: Posterior
    moves: Callable[[], Moves]
    starts: Sequence[Array]
    seed: int
    samplers: list[Any] = field(default_factory=list)
    seconds: float = 0.0
    evaluations: int = 0

    def go_on(self, seconds: float) -> None:
        """Walk until so many seconds more have passed."""
        started = perf_counter()
        while perf_counter() - started < seconds:
            self._step(10)
        self.seconds += perf_counter() - started

    def _step(self, n_steps: int) -> None:
        if not self.samplers:
            for i, start in enumerate(self.starts):
                sampler = emcee.EnsembleSampler(
                    len(start), self.posterior.n_par, self._density, moves=self.moves(),
                    vectorize=True,
                )  # fmt: skip
                random = np.random.RandomState(self.seed + i).get_state()
                state = emcee.State(start, random_state=random)
                sampler.run_mcmc(state, 1, skip_initial_state_check=True)
                self.samplers.append(sampler)
        for sampler in self.samplers:
            sampler.run_mcmc(None, n_steps, skip_initial_state_check=True)

    def _density(self, z: Array) -> Array:
        self.evaluations += len(z)
        return self.posterior.log_prob_coordinates(z)

    def found(self) -> Found:
        """Draws after eight autocorrelation times or a fifth, at most half, as ours discards."""
        chains = [sampler.get_chain() for sampler in self.samplers]
        n_steps = len(chains[0])
        tau = _longest_time([chain[n_steps // 4 :] for chain in chains])
        burn = min(int(max(8.0 * tau, n_steps // 5)), n_steps // 2)
        z = np.concatenate([chain[burn:].swapaxes(0, 1) for chain in chains])
        x = self.posterior.from_coordinates(z)
        ess = min(float(arviz_adapter.ess_bulk(x).min()), x.shape[0] * x.shape[1] / tau)
        flat = x.reshape(-1, x.shape[2])
        equal = np.full(len(flat), 1.0 / len(flat))
        note = f"{n_steps} steps, autocorrelation time {tau:.0f}"
        return Found(flat, equal, ess, self.seconds, self.evaluations, note)


def _longest_time(chains: Sequence[Array]) -> float:
    """Largest integrated autocorrelation time of the parameters, mean of the ensembles [steps]."""
    with np.errstate(divide="ignore", invalid="ignore"):  # a walker that never moved
        times = [emcee.autocorr.integrated_time(chain, tol=0, quiet=True) for chain in chains]
    tau = np.mean(times, axis=0)
    return max(float(tau.max()), 1.0) if np.isfinite(tau).all() else float(len(chains[0]))


RIVAL_MOVES: Mapping[str, Callable[[], Moves]] = {
    STRETCH: lambda: [(emcee.moves.StretchMove(), 1.0)],
    "emcee, half KDE + half DE": lambda: [
        (emcee.moves.KDEMove(), 0.5),
        (emcee.moves.DEMove(), 0.5),
    ],
    "emcee, 0.8 DE + 0.2 snooker": lambda: [
        (emcee.moves.DEMove(), 0.8),
        (emcee.moves.DESnookerMove(), 0.2),
    ],
}


def run_dynesty(posterior: Posterior, effort: Effort, seed: int) -> Found:
    """Nested sampling from the prior by random walks, one point at a time."""

    def transform(u: Array) -> Array:
        return posterior.prior_quantile(np.clip(u, 1e-12, 1.0 - 1e-12)[None, :])[0]

    def log_likelihood(x: Array) -> float:
        return max(float(posterior.log_likelihood(x[None, :])[0]), -1e300)

    started = perf_counter()
    sampler = dynesty.NestedSampler(
        log_likelihood, transform, posterior.n_par, nlive=effort.dynesty_live, sample="rwalk",
        rstate=np.random.default_rng(seed),
    )  # fmt: skip
    sampler.run_nested(dlogz=0.5, print_progress=False)
    seconds = perf_counter() - started
    weights = np.asarray(sampler.results.importance_weights())
    note = f"{effort.dynesty_live} live points"
    evaluations = int(np.sum(sampler.results.ncall))
    return Found(sampler.results.samples, weights, kish(weights), seconds, evaluations, note)


def run_nautilus(posterior: Posterior, effort: Effort, seed: int) -> Found:
    """Importance nested sampling with neural networks, in batches."""

    def transform(u: Array) -> Array:
        return posterior.prior_quantile(np.clip(u, 1e-12, 1.0 - 1e-12))

    def log_likelihood(x: Array) -> Array:
        return np.maximum(posterior.log_likelihood(x), -1e300)

    started = perf_counter()
    sampler = nautilus.Sampler(
        transform, log_likelihood, posterior.n_par, n_live=effort.nautilus_live, vectorized=True,
        pass_dict=False, seed=seed,
    )  # fmt: skip
    sampler.run(n_eff=effort.nautilus_effective)
    seconds = perf_counter() - started
    x, log_weights, _ = sampler.posterior()
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    note = f"{effort.nautilus_live} live points"
    return Found(np.asarray(x), weights, kish(weights), seconds, int(sampler.n_like), note)


def kish(weights: Array) -> float:
    """Effective sample size of weighted draws."""
    return float(np.sum(weights) ** 2 / np.sum(weights**2))


# Measuring ----------------------------------------------------------------------------------------


def compare(posterior: Posterior, effort: Effort) -> dict[str, Any]:
    """All samplers on one posterior, in turns.

    Returns
    -------
    dict
        parameters, n_readings, seconds_of_optimum, reference and rows; errors of a row are the
        largest over the parameters, in the reference's sd.
    """
    started = perf_counter()
    laplace = laplace_mixture(posterior, find_map(posterior, seed=1))
    optimum = perf_counter() - started
    walks = {name: _walk(posterior, laplace, moves) for name, moves in RIVAL_MOVES.items()}
    found: dict[str, list[Found]] = {name: [] for name in (OURS, OURS_DRAFT)}
    nested: dict[str, Callable[[], Found]] = {
        "dynesty": lambda: run_dynesty(posterior, effort, 1),
        "nautilus": lambda: run_nautilus(posterior, effort, 1),
    }
    for turn in range(ROUNDS):
        found[OURS].append(run_ours(posterior, laplace, "emcee", turn + 1))
        found[OURS_DRAFT].append(run_ours(posterior, laplace, "psis", turn + 1))
        for walk in walks.values():
            walk.go_on(effort.seconds / ROUNDS)
        if turn < len(nested):
            name = list(nested)[turn]
            found[name] = [nested[name]()]
    found |= {name: [walk.found()] for name, walk in walks.items()}
    order = [OURS, OURS_DRAFT, *walks, *nested]
    reference = _reference(posterior, laplace)
    return {
        "parameters": list(posterior.parameter_names),
        "n_readings": len(posterior.measurement.brdf) + len(posterior.measurement.dhr),
        "seconds_of_optimum": optimum,
        "reference": {"ess": reference.ess, "seconds": reference.seconds},
        "rows": [row(name, found[name], reference) for name in order],
    }


def _walk(posterior: Posterior, laplace: Mixture, moves: Callable[[], Moves]) -> Walk:
    starts = [start_walkers(posterior, laplace, N_WALKERS, 50 + i) for i in range(N_ENSEMBLES)]
    return Walk(posterior, moves, starts, 70)


def _reference(posterior: Posterior, laplace: Mixture) -> Found:
    """A run of ours of ten thousand effective draws, with another seed."""
    config = replace(posterior.config, accuracy="reference", threads=2)
    return run_ours(replace(posterior, config=config), laplace, "emcee", 1001)


def row(name: str, runs: Sequence[Found], reference: Found) -> dict[str, Any]:
    """Figures of a sampler: sums over its runs, and its largest errors in any run."""
    seconds, evaluations = sum(r.seconds for r in runs), sum(r.evaluations for r in runs)
    ess = sum(r.ess for r in runs)
    errors = np.array([_errors(r, reference) for r in runs]).max(axis=0)
    return {
        "sampler": name,
        "runs": len(runs),
        "seconds": seconds / len(runs),
        "evaluations": round(evaluations / len(runs)),
        "ess": ess / len(runs),
        "ess_per_second": ess / seconds,
        "ess_per_1000_evaluations": 1e3 * ess / evaluations,
        "error_mean": float(errors[0]),
        "error_sd": float(errors[1]),
        "note": runs[-1].note,
    }


def _errors(found: Found, reference: Found) -> tuple[float, float]:
    mean, sd = _moments(found)
    true_mean, true_sd = _moments(reference)
    return (
        float(np.max(np.abs(mean - true_mean) / true_sd)),
        float(np.max(np.abs(sd / true_sd - 1.0))),
    )


def _moments(found: Found) -> tuple[Array, Array]:
    mean = found.weights @ found.x
    return mean, np.sqrt(found.weights @ (found.x - mean) ** 2)


def measure_goals(*, points: int = 321) -> list[dict[str, Any]]:
    """Seconds of sampling until 2000 effective draws, with two threads."""
    rows = []
    for noise, goal in GOALS.items():
        posterior = build("easy", noise, points=points)
        laplace = laplace_mixture(posterior, find_map(posterior, seed=1))
        for seed in range(1, ROUNDS + 1):
            started = perf_counter()
            draws = sample_posterior(
                posterior, laplace, Asked(noise=noise, threads=2), method="emcee", seed=seed
            )
            rows.append(
                {
                    "noise": noise,
                    "goal_seconds": goal,
                    "seed": seed,
                    "seconds": perf_counter() - started,
                    "ess": float(min(draws.ess_bulk.min(), draws.ess_tail.min())),
                    "rhat": float(draws.rhat.max()),
                    "evaluations": draws.n_evaluations,
                    "converged": draws.converged,
                }
            )
    return rows


def machine() -> dict[str, Any]:
    """What it ran on, and the load of the last minutes."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    packages = ("numpy", "numba", "emcee", "dynesty", "nautilus-sampler")
    return {
        "processor": models[0] if models else platform.processor(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "versions": {"pbrdf-bayes": pb.__version__} | {p: metadata.version(p) for p in packages},
        "load": [round(v, 2) for v in os.getloadavg()],
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
    }


def measure(effort: Effort | None = None) -> dict[str, Any]:
    """Everything the page states."""
    effort = effort or Effort()
    before, started = machine(), perf_counter()
    with threadpool_limits(limits=1):
        _warm_up()
        compared = {name: compare(build(name), effort) for name in POSTERIORS}
        goals = measure_goals()
    return {
        "machine": before | {"load_after": machine()["load"], "seconds": perf_counter() - started},
        "posteriors": compared,
        "goals": goals,
    }


def _warm_up() -> None:
    """Have everything compiled before the clock runs."""
    for noise in GOALS:
        posterior = build("curved", noise, points=41)
        run_ours(posterior, laplace_mixture(posterior, find_map(posterior, seed=1)), "psis", 1)


# Page ---------------------------------------------------------------------------------------------


def page(result: Mapping[str, Any]) -> str:
    """The page as text."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters["sig"] = significant
    template = environment.from_string((HERE / "page.html.j2").read_text(encoding="utf-8"))
    return template.render(
        **result,
        css=Markup((HERE.parent / "pages.css").read_text(encoding="utf-8")),  # our own file
        titles=POSTERIORS,
        bars={name: list(bars(found["rows"])) for name, found in result["posteriors"].items()},
        gain={name: gain(found["rows"]) for name, found in result["posteriors"].items()},
        slowest={
            noise: max(g["seconds"] for g in result["goals"] if g["noise"] == noise)
            for noise in GOALS
        },
        goal=GOALS,
        all_met={
            noise: all(
                g["converged"] and g["ess"] >= 2000.0 and g["rhat"] < 1.01
                for g in result["goals"]
                if g["noise"] == noise
            )
            for noise in GOALS
        },
    )


def gain(rows: Sequence[Mapping[str, Any]]) -> float:
    """Effective draws per second of ours over emcee's default."""
    rate = {r["sampler"]: r["ess_per_second"] for r in rows}
    return float(rate[OURS] / rate[STRETCH])


def bars(rows: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """Lengths of bars, proportional to the effective draws per second, in per cent."""
    longest = max(r["ess_per_second"] for r in rows)
    for r in rows:
        yield {**r, "width": 100.0 * r["ess_per_second"] / longest}


def significant(value: float, digits: int = 3) -> str:
    """So many significant digits, thousands set apart by a thin space."""
    rounded = float(f"{value:.{digits}g}")
    if abs(rounded) >= min(10 ** (digits - 1), 1000):
        return f"{rounded:,.0f}".replace(",", "\N{THIN SPACE}")
    return f"{rounded:.{digits}g}"


def main() -> None:
    """Measure, and write both files."""
    result = measure()
    text = json.dumps(result, indent=1) + "\n"
    (HERE / "samplers.json").write_text(text, encoding="utf-8")
    (HERE / "index.html").write_text(page(result), encoding="utf-8")


if __name__ == "__main__":
    main()

"""Time of a likelihood: the headline, how it grows, and what each option costs."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.bench.baselines import Floor, PlainLikelihood
from pbrdf_bayes.bench.timing import straight_line, time_in_turns
from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.effects_table import EFFECT_PARAMETERS, EFFECTS, FRESNEL_AT, LINE_SHAPES
from pbrdf_bayes.inference.likelihood.iid import iid_log_likelihood
from pbrdf_bayes.inference.posterior import Posterior, build_posterior
from pbrdf_bayes.measurement import Measurement, select_scans
from pbrdf_bayes.model.simulate import GREEN_PAINT, simulate_measurement
from pbrdf_bayes.physics.given import NOTHING_GIVEN

Array = NDArray[np.float64]

N_SETS = 64
RTOL_DIGITS = 6.0
_SCATTER = 0.03
_CENTRES = {
    "s_rel_s": 0.02, "s_rel_p": 0.02, "s_rel_u": 0.02, "tau": 0.03, "ell_deg": 20.0, "u_dhr": 5e-4,
    **{name: parameter.typical for name, parameter in EFFECT_PARAMETERS.items()},
}  # fmt: skip
_IID = RunConfig(noise="iid")
_Case = tuple[Measurement, RunConfig]


def paper_posterior() -> Posterior:
    """Posterior of simulated data of the paper's size: 10 scans of 321 points and 16 DHR."""
    posterior = build_posterior(simulate_measurement(GREEN_PAINT, seed=1), _IID)
    return replace(posterior, digits=RTOL_DIGITS)


def parameter_sets(posterior: Posterior, n_sets: int = N_SETS, *, seed: int = 1) -> Array:
    """Sets scattered by 3 % about the published paint, shape (n_sets, n_par)."""
    known = {**_CENTRES, **{n: getattr(GREEN_PAINT, n) for n in ("n", "k", "sigma_n0", "rho0")}}
    centre = np.array([known[name] for name in posterior.parameter_names])
    rng = np.random.default_rng(seed)
    return np.asarray(centre * np.exp(_SCATTER * rng.standard_normal((n_sets, centre.size))))


def measure_headline(*, rounds: int) -> dict[str, float]:
    """Microseconds a parameter set at paper size, and its ratios within one run.

    Returns
    -------
    dict
        microseconds, gradient_microseconds, floor_microseconds, plain_microseconds [us a set];
        gradient_ratio, floor_ratio, plain_ratio, two_threads and two_threads_floor (see
        `measure_threads`) [1]; data_lobes and node_lobes a set; plain_difference [nat].
    """
    posterior = paper_posterior()
    x = parameter_sets(posterior)
    floor, plain = Floor(posterior, x), PlainLikelihood(posterior)
    times = time_in_turns(
        {
            "likelihood": lambda: posterior.log_likelihood(x),
            "gradient": lambda: posterior.log_prob_gradient(x),
            "floor": floor,
            "plain": lambda: plain(x[0]),
        },
        rounds=rounds,
    )
    threads = measure_threads(rounds=rounds)
    per_set = 1e6 / N_SETS
    return {
        "microseconds": times["likelihood"] * per_set,
        "gradient_microseconds": times["gradient"] * per_set,
        "floor_microseconds": times["floor"] * per_set,
        "plain_microseconds": times["plain"] * 1e6,
        "gradient_ratio": times["gradient"] / times["likelihood"],
        "floor_ratio": times["likelihood"] / times["floor"],
        "plain_ratio": times["plain"] * N_SETS / times["likelihood"],
        "two_threads": threads["speed_up"],
        "two_threads_floor": threads["floor_speed_up"],
        "data_lobes": float(floor.n_data),
        "node_lobes": float(floor.n_nodes.mean()),
        "plain_difference": abs(plain(x[0]) - float(posterior.log_likelihood(x[:1])[0])),
    }


def measure_scaling(*, quick: bool) -> dict[str, dict[str, Any]]:
    """Time against points per scan, scans, sets a call and threads.

    Returns
    -------
    dict
        For each variable: sizes, microseconds (a set; a call for ``sets``), exponent, and the
        straight line ``fixed + per_unit * size`` [us] with the largest relative distance from it.
    """
    rounds = 8 if quick else 50
    return {
        "points": _sweep(_of_points, (21, 81, 321, 1281) if quick else _POINTS, rounds),
        "scans": _sweep(_of_scans, (2, 10, 40) if quick else _SCANS, rounds),
        "sets": _set_sweep((1, 4, 16, 64, 256) if quick else (1, 4, 16, 64, 256, 1024), rounds),
        "threads": measure_threads(rounds=4 * rounds),
    }


_POINTS = (21, 81, 321, 1281, 5121)
_SCANS = (2, 10, 40, 160)


def _of_points(n: int) -> Posterior:
    grid = np.linspace(-80.0, 80.0, n)
    return build_posterior(simulate_measurement(GREEN_PAINT, seed=1, theta_r_deg=grid), _IID)


def _of_scans(n: int) -> Posterior:
    angles = np.linspace(0.0, 80.0, n // 2).tolist()
    grid = np.linspace(-80.0, 80.0, 81)
    made = simulate_measurement(GREEN_PAINT, seed=1, theta_i_deg=angles, theta_r_deg=grid)
    return build_posterior(made, _IID)


def _sweep(make: Callable[[int], Posterior], sizes: tuple[int, ...], rounds: int) -> dict[str, Any]:
    made = {str(n): replace(make(n), digits=RTOL_DIGITS) for n in sizes}
    sets = {name: parameter_sets(p, 16) for name, p in made.items()}
    times = time_in_turns({name: _call(made[name], sets[name]) for name in made}, rounds=rounds)
    micro = [times[str(n)] * 1e6 / 16 for n in sizes]
    return _series(sizes, micro)


def _series(sizes: tuple[int, ...], micro: list[float]) -> dict[str, Any]:
    return {"sizes": list(sizes), "microseconds": micro, **straight_line(sizes, micro)}


def _call(posterior: Posterior, x: Array) -> Callable[[], object]:
    return lambda: posterior.log_likelihood(x)


def _set_sweep(sizes: tuple[int, ...], rounds: int) -> dict[str, Any]:
    posterior = paper_posterior()
    times = time_in_turns(
        {str(n): _call(posterior, parameter_sets(posterior, n)) for n in sizes}, rounds=rounds
    )
    return _series(sizes, [times[str(n)] * 1e6 for n in sizes])


def measure_threads(*, rounds: int) -> dict[str, Any]:
    """Time of many parameter sets in one call, and in two halves on two threads.

    The halves and the threads are there before; a thread holds no lock while it computes. One
    thread is handed its call in the same way as two. The loop of the floor, which shares nothing,
    has its turns in the same rounds, over twice the sets, so that they last about as long: what the
    second core gives at the moment.

    Returns
    -------
    dict
        sizes, microseconds (a set), speed_up and floor_speed_up [1].
    """
    posterior = paper_posterior()
    x = parameter_sets(posterior, _THREADED_SETS)
    halves = [half.copy() for half in np.split(x, 2)]
    parts: dict[str, list[Callable[[], object]]] = {
        "1": [_kernel(posterior, x)],
        "2": [_kernel(posterior, half) for half in halves],
        "floor 1": [Floor(posterior, np.tile(x, (2, 1)))],
        "floor 2": [Floor(posterior, np.tile(half, (2, 1))) for half in halves],
    }
    with ThreadPoolExecutor(2) as pool:
        times = time_in_turns(
            {name: _at_once(pool, calls) for name, calls in parts.items()}, rounds=rounds
        )
    return {
        "sizes": [1, 2],
        "microseconds": [times[n] * 1e6 / len(x) for n in ("1", "2")],
        "speed_up": times["1"] / times["2"],
        "floor_speed_up": times["floor 1"] / times["floor 2"],
    }


_THREADED_SETS = 256
"""Handing a call to a thread takes some 50 us, which the sets of a call are to outweigh."""


def _kernel(posterior: Posterior, x: Array) -> Callable[[], object]:
    geometry, rows, digits = posterior.geometry, posterior.rows, posterior.digits
    none = posterior.errors[None]
    return lambda: iid_log_likelihood(geometry, rows, x, digits, NOTHING_GIVEN, none)


def _at_once(pool: ThreadPoolExecutor, calls: list[Callable[[], object]]) -> Callable[[], object]:
    return lambda: [done.result() for done in [pool.submit(call) for call in calls]]


def _with_effects(measurement: Measurement, off: RunConfig) -> dict[str, _Case]:
    """Each effect, line shape and place of the Fresnel factor alone; with the DHR readings."""
    cases = {f"effect {name}": replace(off, effects=(name,)) for name in EFFECTS}
    cases |= {f"{name} line shape": replace(off, line_shape=name) for name in list(LINE_SHAPES)[1:]}
    cases |= {f"Fresnel factor at {at}": replace(off, fresnel_at=at) for at in FRESNEL_AT[1:]}
    return {name: (measurement, config) for name, config in cases.items()}


def _of_one_scan_an_angle(off: RunConfig) -> dict[str, _Case]:
    """One scan at each angle of incidence in place of s and p: half the scans, the same angles."""
    words = {"s": "s readings alone", "u": "unpolarised readings"}
    return {
        f"{word}, the same angles, half the scans": (
            simulate_measurement(GREEN_PAINT, seed=1, polarizations=(q,), dhr_theta_i_deg=()),
            off,
        )
        for q, word in words.items()
    }


def measure_options(*, quick: bool) -> list[dict[str, Any]]:
    """Cost of every option switched on alone, relative to all off, and of the gradient.

    Returns
    -------
    list of dict
        option, microseconds (a set), ratio to all off.
    """
    measurement = simulate_measurement(GREEN_PAINT, seed=1)
    brdf_only = select_scans(measurement, np.ones(len(measurement.scans), dtype=bool), dhr=False)
    off = RunConfig(noise="iid", u_dhr_cal=0.0)
    correlated = replace(off, noise="correlated")
    cases = {
        "all off: the four-parameter model, BRDF rows only": (brdf_only, off),
        "DHR readings": (measurement, off),
        "DHR readings with a calibration gain": (measurement, _IID),
        "calibration gain of each scan": (brdf_only, replace(off, u_brdf_cal=0.02)),
        "scale of each scan free": (measurement, replace(off, brdf_scale="relative")),
        "instrument floor": (brdf_only, replace(off, brdf_floor=1e-6)),
        **_of_one_scan_an_angle(off),
        "discrepancy correlated along theta_r (Matérn 3/2)": (brdf_only, correlated),
        "the same, Matérn 1/2": (brdf_only, replace(correlated, discrepancy="matern-1/2")),
        "discrepancy and calibration gain": (brdf_only, replace(correlated, u_brdf_cal=0.02)),
        "Student-t noise": (brdf_only, replace(off, tails="student-t")),
        **_with_effects(measurement, off),
    }
    made = {
        name: replace(build_posterior(data, config), digits=RTOL_DIGITS)
        for name, (data, config) in cases.items()
    }
    functions = {name: _call(p, parameter_sets(p)) for name, p in made.items()}
    first = next(iter(made))
    base, x = made[first], parameter_sets(made[first])
    functions["gradient by all parameters"] = lambda: base.log_prob_gradient(x)
    for digits in (4.0, 10.0):
        finer = replace(base, digits=digits)
        functions[f"rtol 1e-{digits:.0f} instead of 1e-6"] = _call(finer, x)
    times = time_in_turns(functions, rounds=10 if quick else 60)
    return [
        {"option": name, "microseconds": t * 1e6 / N_SETS, "ratio": t / times[first]}
        for name, t in times.items()
    ]

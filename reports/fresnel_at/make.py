"""Where the reflectance of a lobe is taken, put to the test: fresnel_at.json and index.html.

OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python reports/fresnel_at/make.py FOLDER

The paper takes it at the mean direction sine, Stover as sqrt(F(theta_i) F(theta_r)); the mean angle
is a third way. Each is fitted to measured scans and to simulated paints whose truth is known, and
scored by the angles of incidence left out in turn, as ``fit --effects auto`` scores effects. FOLDER
holds the measured scans (see `MEASURED`); they are not part of this project. One core, about five
minutes. Without FOLDER the page is made again from fresnel_at.json.
``tests/reports/test_fresnel_at_page.py`` looks at what is committed.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

import pbrdf_bayes as pb
from pbrdf_bayes.effects_table import FRESNEL_AT
from pbrdf_bayes.inference.effects_choice.choose import TYPICAL_N, compare_configs
from pbrdf_bayes.inference.prediction.holdout_cases import list_cases
from pbrdf_bayes.measurement import Measurement
from pbrdf_bayes.model.effects import Effects
from pbrdf_bayes.model.simulate import simulate_measurement

Array = NDArray[np.float64]

HERE = Path(__file__).parent
MEASURED = {
    "Aeroglaze Z307": "ua_aeroglaze_z307_650nm_mean3.csv",
    "Singularity Black": "ua_singularity_black_650nm_mean3.csv",
}
"""Black coatings, unpolarised, 10, 30, 50 and 70 deg, 650 nm: University of Arizona LOFT group."""
MODELS: Mapping[str, tuple[str, ...]] = {
    "four parameters": (),
    "with lambert and volume, n = 1.5": ("lambert", "volume"),
}
THETA_I_DEG = (10.0, 30.0, 50.0, 70.0)
THETA_R_DEG = np.linspace(-80.0, 80.0, 81)
NOISE, MISFIT, MISFIT_DEG = 0.03, 0.07, 20.0
"""White noise and correlated misfit of simulated scans [ln BRDF], and its length [deg]: what black
coatings leave under the best model of this project is as large."""
SEED = 1


@dataclass(frozen=True)
class Paint:
    """A simulated paint: parameters, effects, what is measured and how often it is drawn."""

    parameters: pb.Parameters
    effects: Mapping[str, float] = field(default_factory=dict)
    polarizations: tuple[str, ...] = ("s", "p")
    dhr_theta_i_deg: tuple[float, ...] = THETA_I_DEG
    seeds: tuple[int, ...] = (1, 2)


PAINTS = {
    "green paint": Paint(pb.GREEN_PAINT),
    "smooth, no absorption": Paint(pb.Parameters(n=1.5, k=0.0, sigma_n0=0.3, rho0=0.15)),
    "rough, high index": Paint(pb.Parameters(n=1.9, k=0.5, sigma_n0=0.7, rho0=0.9)),
    "like Aeroglaze": Paint(
        pb.Parameters(n=TYPICAL_N, k=0.0, sigma_n0=0.2, rho0=1.31),
        {"lambert": 0.0111, "volume": 0.0067}, ("u",), (), (1, 2, 3),
    ),
    "like Singularity": Paint(
        pb.Parameters(n=TYPICAL_N, k=0.0, sigma_n0=0.0091, rho0=0.96),
        {"lambert": 0.0012, "volume": 0.0039}, ("u",), (), (1, 2, 3),
    ),
}  # fmt: skip
"""The last two have what was fitted to the measured scans, rounded."""


def simulate(paint: Paint, fresnel_at: str, seed: int) -> Measurement:
    """Scans of a paint whose lobes take their reflectance at a known place."""
    clean = simulate_measurement(
        paint.parameters, seed=seed, theta_i_deg=THETA_I_DEG, theta_r_deg=THETA_R_DEG,
        dhr_theta_i_deg=paint.dhr_theta_i_deg, polarizations=paint.polarizations,
        relative_noise=NOISE, effects=Effects(fresnel_at=fresnel_at, **paint.effects),
    )  # fmt: skip
    rng, value = np.random.default_rng([seed, 1]), clean.brdf.value.copy()
    for scan in clean.scans:
        value[scan.rows] *= np.exp(misfit(clean.brdf.theta_r_deg[scan.rows], rng))
    return replace(clean, brdf=replace(clean.brdf, value=value))


def misfit(theta_r_deg: Array, rng: np.random.Generator) -> Array:
    """A path of the Matérn 3/2 process: what no model of the run can follow [ln BRDF]."""
    a = np.sqrt(3.0) * np.abs(np.subtract.outer(theta_r_deg, theta_r_deg)) / MISFIT_DEG
    covariance = (1.0 + a) * np.exp(-a) + 1e-10 * np.eye(a.shape[0])
    return np.asarray(MISFIT * np.linalg.cholesky(covariance) @ rng.standard_normal(a.shape[0]))


def score(measurement: Measurement, effects: tuple[str, ...]) -> list[dict[str, Any]]:
    """The three ways on one measurement, one record for each."""
    held = {"n": {"kind": "fixed", "value": TYPICAL_N}} if effects else {}
    configs = [
        pb.RunConfig(effects=effects, fresnel_at=place, priors=held, threads=1)
        for place in FRESNEL_AT
    ]
    cases = [case for case in list_cases(measurement) if case.kind == "angle"]
    found = compare_configs(measurement, configs, seed=SEED, cases=cases)
    return [
        {
            "fresnel_at": place, "rms_dex": scored.rms_dex, "held_out_dex": scored.held_out_dex,
            "score": scored.score, "difference": scored.difference,
            "u_difference": scored.u_difference, "beaten": beaten, "best": scored.chosen,
            "at_bound": list(scored.at_bound),
        }
        for place, (scored, beaten) in zip(FRESNEL_AT, found, strict=True)
    ]  # fmt: skip


def measured_rows(folder: Path) -> Iterator[dict[str, Any]]:
    """Measured scans under both models."""
    for sample, name in MEASURED.items():
        measurement = pb.read_measurement(folder / name)
        for model, effects in MODELS.items():
            yield {"sample": sample, "model": model, "rows": score(measurement, effects)}


def simulated_rows(names: Sequence[str] = tuple(PAINTS)) -> Iterator[dict[str, Any]]:
    """Simulated paints under the model that they have, every truth and seed."""
    for name in names:
        paint = PAINTS[name]
        for truth in FRESNEL_AT:
            for seed in paint.seeds:
                rows = score(simulate(paint, truth, seed), tuple(paint.effects))
                yield {"sample": name, "truth": truth, "seed": seed, "rows": rows}


def verdicts(simulated: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """How often the way of the truth is found.

    Returns
    -------
    dict
        n; right in sample and right left out (the truth is the best of the three); decided (both
        others are beaten by the truth); misled (the truth is beaten by another).
    """
    found = {"n": len(simulated), "in_sample": 0, "left_out": 0, "decided": 0, "misled": 0}
    for one in simulated:
        rows = {row["fresnel_at"]: row for row in one["rows"]}
        true, others = (
            rows[one["truth"]],
            [r for r in one["rows"] if r["fresnel_at"] != one["truth"]],
        )
        found["in_sample"] += all(true["rms_dex"] <= r["rms_dex"] for r in others)
        found["left_out"] += true["best"]
        found["decided"] += true["best"] and all(r["beaten"] for r in others)
        found["misled"] += true["beaten"]
    return found


def measure(folder: Path) -> dict[str, Any]:
    """Everything the page states."""
    started = perf_counter()
    with threadpool_limits(limits=1):
        measured = list(measured_rows(folder))
        simulated = list(simulated_rows())
    return {
        "version": pb.__version__,
        "seconds": perf_counter() - started,
        "measured": measured,
        "simulated": simulated,
    }


def page(result: Mapping[str, Any]) -> str:
    """The page as text."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters["words"] = lambda place: place.replace("-", " ")
    template = environment.from_string((HERE / "page.html.j2").read_text(encoding="utf-8"))
    kinds = {"s and p, with DHR": ("s", "p"), "unpolarised, no DHR": ("u",)}
    return template.render(
        css=Markup((HERE.parent / "pages.css").read_text(encoding="utf-8")),  # our own file
        **result, places=FRESNEL_AT, noise=NOISE, misfit=MISFIT, misfit_deg=MISFIT_DEG,
        tallies={kind: verdicts(of_kind(result["simulated"], q)) for kind, q in kinds.items()},
        finding=finding(result["measured"]),
    )  # fmt: skip


def of_kind(
    simulated: Sequence[Mapping[str, Any]], polarizations: tuple[str, ...]
) -> list[Mapping[str, Any]]:
    """Simulated paints that were measured in these polarisations."""
    return [one for one in simulated if PAINTS[one["sample"]].polarizations == polarizations]


def finding(measured: Sequence[Mapping[str, Any]]) -> str:
    """What the measured scans say of the paper's choice."""
    papers = [next(r for r in one["rows"] if r["fresnel_at"] == FRESNEL_AT[0]) for one in measured]
    best, beaten = sum(r["best"] for r in papers), sum(r["beaten"] for r in papers)
    others = sum(r["beaten"] for one in measured for r in one["rows"]) - beaten
    return (
        f"On measured scans the mean direction sine predicts angles left out best in {best} of "
        f"{len(papers)} cases and is beaten beyond chance in {beaten}; the two others are beaten "
        f"in {others} of {2 * len(papers)}."
    )


def main() -> None:
    """Measure if scans are given, and write the page."""
    stored = HERE / "fresnel_at.json"
    if len(sys.argv) > 1:
        text = json.dumps(measure(Path(sys.argv[1])), indent=1) + "\n"
        stored.write_text(text, encoding="utf-8")
    result = json.loads(stored.read_text(encoding="utf-8"))
    (HERE / "index.html").write_text(page(result), encoding="utf-8")


if __name__ == "__main__":
    main()

"""Can a DDR reading replace the BRDF scan? The question that the 2011 paper leaves open.

python reports/ddr/make.py

DHR readings tell sigma_N0, n and k, and nothing of the roughness rho0: a scan is measured for it.
The diffuse directional reflectance (DDR) is the DHR less the light inside a specular port, and that
light depends on rho0. Three paints are read, simulated with their instrument: the DHR alone is
fitted, then with a scan, then with DDR readings of several ports, and what is known of rho0 and of
curves afterwards is compared with the truth. ``test_ddr_page.py`` repeats a part of it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

import pbrdf_bayes as pb
from pbrdf_bayes import __version__
from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.design.beliefs import Beliefs, DrawnSets, draw_sets
from pbrdf_bayes.design.candidates import Candidate
from pbrdf_bayes.design.hemispherical import (
    gain_law,
    hemispherical_log_likelihoods,
    hemispherical_values,
)
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.io.significant import significant
from pbrdf_bayes.measurement import Measurement, measurement_from_columns
from pbrdf_bayes.model.four_parameter import DOMAIN
from pbrdf_bayes.physics.geometry import prepare_geometry
from pbrdf_bayes.report.figures.axes import figure_style
from pbrdf_bayes.report.figures.svg import inline_svg
from tools.validation.design_loop import fitted
from tools.validation.experiments import draw_misfit, matern

Array = NDArray[np.float64]

HERE = Path(__file__).parent
DIGITS = 4
N_REPEATS = 8
"""Independent sets of noise for each paint."""
PORTS = (2.0, 5.0, 10.0, 15.0, 20.0)
PLANS: Mapping[str, tuple[tuple[str, float], ...]] = {
    "one": (("s", 20.0),),
    "bright": (("s", 60.0),),
    "four": (("s", 20.0), ("p", 20.0), ("s", 60.0), ("p", 60.0)),
}
"""DDR readings: polarisation and incidence."""
CURVES: Mapping[str, tuple[str, float]] = {"f_s at 20°": ("s", 20.0), "f_p at 60°": ("p", 60.0)}
"""Predicted curves: the one that the scan measures, and one that nothing measures."""
SCAN = ("s", 20.0)
SCAN_THETA_R = np.arange(-80.0, 81.0, 2.0)
CURVE_THETA_R = np.arange(-70.0, 71.0, 5.0)
DHR_THETA_I = tuple(float(a) for a in range(10, 90, 10))
U_DHR, U_DHR_CAL, U_BRDF_CAL, NOISE = 0.0005, 0.01, 0.02, 0.02
USUAL = 0.002
NOISES = (U_DHR, 0.001, USUAL, 0.003)
"""Standard uncertainties of a reading of the sphere."""
MISFIT, MISFIT_DEG = 0.03, 20.0
CONFIG = RunConfig(
    accuracy="draft", holdout=False, threads=1, u_brdf_cal=U_BRDF_CAL, u_dhr_cal=U_DHR_CAL
)
N_DRAWS, N_CURVES = 4000, 500


@dataclass(frozen=True)
class Paint:
    """A paint: its parameters, and the line shape that it truly has."""

    name: str
    rho0: float
    nu: float = 1.0

    @property
    def parameters(self) -> pb.Parameters:
        """Those of the published paint but for the roughness."""
        return pb.Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=self.rho0)

    @property
    def effects(self) -> pb.Effects | None:
        """None for the Lorentzian of the paper."""
        return None if self.nu == 1.0 else pb.Effects(line_shape="cauchy", nu=self.nu)


PAINTS = (
    Paint("smoother", 0.05),
    Paint("published", 0.47),
    Paint("rougher", 1.2),
    Paint("other line shape", 0.47, nu=1.3),
)


# ------------------------------------------------------------------------------ readings


@dataclass(frozen=True, eq=False)
class Bench:
    """The instrument on one day: gains of s and p, and a stream of noise."""

    paint: Paint
    gain: Mapping[str, float]
    rng: np.random.Generator

    def dhr(self, q: str, theta_i: float) -> float:
        """A DHR reading."""
        true = float(pb.dhr(self.paint.parameters, theta_i, q, effects=self.paint.effects))
        return self.gain[q] * true + U_DHR * float(self.rng.standard_normal())

    def ddr(self, q: str, theta_i: float, port: float) -> float:
        """A DDR reading: the same sphere, with the same gain."""
        true = float(
            pb.ddr(self.paint.parameters, theta_i, q, port_deg=port, effects=self.paint.effects)
        )
        return self.gain[q] * true + U_DHR * float(self.rng.standard_normal())

    def scan(self) -> Array:
        """Readings of the BRDF scan: noise, a gain, and a smooth misfit."""
        q, theta_i = SCAN
        true = pb.brdf(self.paint.parameters, theta_i, SCAN_THETA_R, q, effects=self.paint.effects)
        law = matern(MISFIT, MISFIT_DEG)(SCAN_THETA_R, np.zeros(SCAN_THETA_R.size, np.int64))
        gain = U_BRDF_CAL * self.rng.standard_normal()
        noise = NOISE * self.rng.standard_normal(SCAN_THETA_R.size)
        return np.asarray(true * np.exp(draw_misfit(law, self.rng) + gain + noise))


def bench(paint: Paint, seed: int) -> Bench:
    """The instrument of a seed."""
    rng = np.random.default_rng([seed, round(1000 * paint.rho0), round(100 * paint.nu)])
    return Bench(paint, {q: 1.0 + U_DHR_CAL * float(rng.standard_normal()) for q in "sp"}, rng)


def as_measurement(dhr: Mapping[tuple[str, float], float], scan: Array | None) -> Measurement:
    """DHR readings by polarisation and angle, with a scan or without one."""
    n = 0 if scan is None else scan.size
    q, theta_i = SCAN
    return measurement_from_columns(
        sample="ddr_simulated", wavelength_um=3.39,
        quantity=["brdf"] * n + ["dhr"] * len(dhr),
        polarization=[q] * n + [q for q, _ in dhr],
        theta_i_deg=[theta_i] * n + [a for _, a in dhr],
        theta_r_deg=[*SCAN_THETA_R[:n]] + [np.nan] * len(dhr),
        value=[*(() if scan is None else scan), *dhr.values()],
    )  # fmt: skip


# ------------------------------------------------------------------------------ inference


def with_ddr(
    beliefs: Beliefs, readings: Mapping[tuple[str, float], float], port: float, *, seed: int
) -> Array:
    """Draws after DDR readings through one port, shape (N_DRAWS, n_par).

    DHR readings say nothing of rho0: it has its prior, uniform in its logarithm, whatever n, k and
    sigma_N0 are. Draws get rho0 from ever narrower windows about where the readings have put it,
    and are weighed by the likelihood of the readings, with the gain that the DHR readings tell.
    """
    rng = np.random.default_rng([seed, 7])
    column = beliefs.posterior.parameter_names.index("rho0")
    low, high = (float(v) for v in np.log(DOMAIN["rho0"]))
    for _ in range(3):
        x = np.repeat(beliefs.x, 4, axis=0)
        spread = (rng.permutation(len(x)) + rng.random(len(x))) / len(x)
        x[:, column] = np.exp(low + (high - low) * spread)
        sets = draw_sets(beliefs, x, rng)
        log_weight = np.zeros(len(x))
        for q in sorted({q for q, _ in readings}):
            log_weight += _log_likelihood(beliefs, sets, readings, q, port)
        weight = np.exp(log_weight - log_weight.max())
        chosen = rng.choice(len(x), 4 * N_DRAWS, p=weight / weight.sum())
        a, b = np.quantile(np.log(x[chosen, column]), (0.001, 0.999))
        low, high = max(low, a - (b - a) - 0.02), min(high, b + (b - a) + 0.02)
    return x[chosen[:N_DRAWS]]


def _log_likelihood(
    beliefs: Beliefs, sets: DrawnSets, readings: Mapping[tuple[str, float], float], q: str,
    port: float,
) -> Array:  # fmt: skip
    """Of the DDR readings of one polarisation, which share a gain, shape (n_sets,)."""
    angles = [a for p, a in readings if p == q]
    values = [
        hemispherical_values(
            beliefs.posterior, Candidate("ddr", q, a, minutes=3.0, port_deg=port), sets.x
        )
        for a in angles
    ]
    read = [np.array([readings[q, a]]) for a in angles]
    law = gain_law(beliefs, q, sets)
    return hemispherical_log_likelihoods(read, values, law, sets, matched=False)[0]


def judge(posterior: Posterior, x: Array, paint: Paint) -> dict[str, Any]:
    """What draws know: rho0 and curves, and how far they are from the truth.

    Spreads are standard deviations of logarithms, curves the root mean square over theta_r.
    """
    column = posterior.parameter_names.index("rho0")
    ln_rho0 = np.log(x[:, column])
    found: dict[str, Any] = {
        "sd_rho0": float(ln_rho0.std()),
        "off_rho0": float(ln_rho0.mean() - np.log(paint.rho0)),
    }
    for name, (q, theta_i) in CURVES.items():
        ln_f = np.log(_curve(posterior, x[:: len(x) // N_CURVES], q, theta_i))
        true = np.log(pb.brdf(paint.parameters, theta_i, CURVE_THETA_R, q, effects=paint.effects))
        found[f"sd {name}"] = float(np.sqrt(ln_f.var(axis=0).mean()))
        found[f"off {name}"] = float(np.sqrt(np.mean((ln_f.mean(axis=0) - true) ** 2)))
    return found


def _curve(posterior: Posterior, x: Array, q: str, theta_i: float) -> Array:
    geometry = prepare_geometry(
        theta_i=np.full(CURVE_THETA_R.size, np.deg2rad(theta_i)),
        theta_r=np.deg2rad(CURVE_THETA_R), phi_r=np.zeros(CURVE_THETA_R.size),
        polarization=np.full(CURVE_THETA_R.size, q), dhr_theta_i=np.zeros(0),
        dhr_polarization=np.zeros(0, np.str_),
    )  # fmt: skip
    return posterior.predict(x, geometry)[0]


def study(paint: Paint, seed: int, ports: Sequence[float] = PORTS) -> list[dict[str, Any]]:
    """One day at the bench: the DHR, then a scan or DDR readings beside it."""
    day = bench(paint, seed)
    dhr = {(q, a): day.dhr(q, a) for q in "sp" for a in DHR_THETA_I}
    scan = day.scan()
    before = fitted(as_measurement(dhr, None), seed=seed)
    after_scan = fitted(as_measurement(dhr, scan), seed=seed)
    tau = after_scan.x[:, after_scan.posterior.parameter_names.index("tau")]
    known = judge(after_scan.posterior, after_scan.x, paint)
    rows = [{"plan": "scan", "port": 0.0, "tau": float(np.median(tau)), **known}]
    for port in ports:
        read = {at: day.ddr(*at, port) for at in PLANS["four"]}
        for plan, which in PLANS.items():
            x = with_ddr(before, {at: read[at] for at in which}, port, seed=seed)
            rows.append({"plan": plan, "port": port, **judge(before.posterior, x, paint)})
    return [{"paint": paint.name, "seed": seed, **row} for row in rows]


def averaged(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Root mean square over the seeds."""
    keys = list(dict.fromkeys((r["paint"], r["plan"], r["port"]) for r in rows))
    table = []
    for paint, plan, port in keys:
        own = [r for r in rows if (r["paint"], r["plan"], r["port"]) == (paint, plan, port)]
        names = [k for k in own[0] if k.startswith(("sd", "off", "tau"))]
        mean = {k: float(np.sqrt(np.mean([r[k] ** 2 for r in own]))) for k in names}
        table.append({"paint": paint, "plan": plan, "port": port, "n": len(own), **mean})
    return table


def run() -> dict[str, Any]:
    """All paints and seeds."""
    started = perf_counter()
    rows = [
        row for paint in PAINTS for seed in range(1, N_REPEATS + 1) for row in study(paint, seed)
    ]
    return {
        "version": __version__, "seconds": round(perf_counter() - started), "n": N_REPEATS,
        "table": significant(averaged(rows), DIGITS),
    }  # fmt: skip


# ---------------------------------------------------------------------------------- page

AS_GOOD = 2.0
"""Ratio of spreads below which a reading is called as good as the scan."""
_INK = {"scan": "#1c2126", "one": "#7fa8cb", "bright": "#0067a5", "four": "#c24d00"}
_WORDS = {
    "scan": "scan, s at 20°",
    "one": "DDR, s at 20°",
    "bright": "DDR, s at 60°",
    "four": "four DDR",
}


def of(table: Sequence[Mapping[str, Any]], paint: str, plan: str) -> list[Mapping[str, Any]]:
    """Rows of one paint and plan, by port."""
    return [r for r in table if r["paint"] == paint and r["plan"] == plan]


def best(table: Sequence[Mapping[str, Any]], paint: str, plan: str) -> Mapping[str, Any]:
    """The port with which rho0 is known best."""
    return min(of(table, paint, plan), key=lambda r: r["sd_rho0"])


def finding(table: Sequence[Mapping[str, Any]]) -> str:
    """The answer in words."""
    ratios, told = [], []
    for paint in PAINTS[:3]:
        scan, bright, one = (best(table, paint.name, p) for p in ("scan", "bright", "one"))
        ratios.append(bright["sd_rho0"] / scan["sd_rho0"])
        told.append(
            f"{_percent(bright['sd_rho0'])} with a port of {bright['port']:g}° against "
            f"{_percent(scan['sd_rho0'])} by the scan and {_percent(one['sd_rho0'])} by a reading "
            f"at 20° ({paint.name}, ρ₀ = {paint.rho0:g})"
        )
    worst = max(r["sd_rho0"] for r in _brights(table))
    answer = "Yes" if max(ratios) < AS_GOOD else "Not quite"
    return (
        f"{answer}, while the model holds and the sphere repeats to {U_DHR}: one DDR reading of s "
        f"light at 60°, with the right port, tells ρ₀ within {_percent(worst)}: "
        f"{'; '.join(told)}. Predicted curves are then known alike. {noisier(table)}"
    )


def _brights(table: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    return [best(table, paint.name, "bright") for paint in PAINTS[:3]]


def least_spread(paint: Paint, port: float, noise: float) -> float:
    """Of ln rho0 after one DDR reading of s light at 60 deg: noise / |d DDR / d ln rho0|.

    By central differences; what is known of DHR and gain only widens it.
    """
    (q, theta_i), step = PLANS["bright"][0], 0.01
    shifted = (replace(paint.parameters, rho0=paint.rho0 * np.exp(d)) for d in (step, -step))
    up, down = (float(pb.ddr(p, theta_i, q, port_deg=port)) for p in shifted)
    return noise * 2.0 * step / abs(up - down)


def by_noise(table: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Least spreads for noises of the sphere: with the right port of each paint, and with one port.

    The port for all is that of the smallest largest spread.
    """
    common = min(PORTS, key=lambda port: max(least_spread(p, port, 1.0) for p in PAINTS[:3]))
    ports = {p.name: (best(table, p.name, "bright")["port"], common) for p in PAINTS[:3]}
    rows = [
        (noise, [least_spread(p, port, noise) for p in PAINTS[:3] for port in ports[p.name]])
        for noise in NOISES
    ]
    scans = {p.name: best(table, p.name, "scan")["sd_rho0"] for p in PAINTS[:3]}
    return {"ports": ports, "rows": rows, "scans": scans}


def noisier(table: Sequence[Mapping[str, Any]]) -> str:
    """What becomes of the answer with a sphere of the usual noise."""
    found = [least_spread(p, best(table, p.name, "bright")["port"], USUAL) for p in PAINTS[:3]]
    scans = [best(table, p.name, "scan")["sd_rho0"] for p in PAINTS[:3]]
    ratios = [a / b for a, b in zip(found, scans, strict=True)]
    return (
        f"With noise of {USUAL} the answer is no: the reading leaves at least "
        f"{_percent(min(found))} to {_percent(max(found))}, {min(ratios):.1f} to "
        f"{max(ratios):.1f} times what the scan leaves."
    )


def caution(table: Sequence[Mapping[str, Any]]) -> str:
    """What happens when the line shape is another one."""
    other = PAINTS[3].name
    scan, bright = best(table, other, "scan"), best(table, other, "bright")
    name = next(iter(CURVES))
    return (
        f"Of a paint with another line shape the DDR reading claims the s curve at 20° to "
        f"{_percent(bright[f'sd {name}'])} and is off by {_percent(bright[f'off {name}'])}; "
        f"nothing in it tells that. The scan is off by {_percent(scan[f'off {name}'])} where it "
        f"claims {_percent(scan[f'sd {name}'])}, but its fit shows a discrepancy of "
        f"{_percent(scan['tau'])} along the scan, which a report calls a misfit."
    )


def _percent(value: float) -> str:
    return f"{100.0 * value:.2g} %" if value < 0.1 else f"{100.0 * value:.0f} %"


def port_figure(table: Sequence[Mapping[str, Any]], paint: Paint, index: int) -> Markup:
    """Spread of rho0 against the port, and the scan beside it."""
    with figure_style():
        figure = Figure(figsize=(4.6, 3.2), layout="constrained")
        axes = figure.add_subplot()
        for plan in PLANS:
            rows = of(table, paint.name, plan)
            axes.plot([r["port"] for r in rows], [100.0 * r["sd_rho0"] for r in rows], "o-",
                      ms=4.5, color=_INK[plan], label=_WORDS[plan])  # fmt: skip
        level = 100.0 * best(table, paint.name, "scan")["sd_rho0"]
        axes.axhline(level, color=_INK["scan"], lw=1.2, ls=(0, (4, 2)), label=_WORDS["scan"])
        _dress(axes, index)
        label = (
            f"{paint.name}: standard deviation of ρ0 against the half angle of the port; "
            f"scan {level:.2g} %"
        )
        return inline_svg(figure, name=f"port-{index}", label=label)


def _dress(axes: Axes, index: int) -> None:
    axes.set_yscale("log")
    axes.set(xlim=(0, 21), ylim=(0.7, 150), xticks=PORTS, yticks=(1, 3, 10, 30, 100))
    axes.set_xticklabels([f"{p:g}°" for p in PORTS])
    axes.set_yticklabels([f"{y} %" for y in (1, 3, 10, 30, 100)])
    axes.minorticks_off()
    axes.set_xlabel("half angle of the port")
    axes.set_ylabel("standard deviation of ρ_0")
    axes.grid(axis="y", color="#e6e9ec")
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    if index == 0:
        axes.legend(frameon=False, fontsize=9)


def page(result: Mapping[str, Any]) -> str:
    """The page as text."""
    environment = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    environment.filters["percent"] = _percent
    table = result["table"]
    chosen = {
        paint.name: [best(table, paint.name, plan) for plan in ("scan", "bright", "four", "one")]
        for paint in PAINTS
    }
    return environment.get_template("page.html.j2").render(
        css=Markup((HERE.parent / "pages.css").read_text(encoding="utf-8")),  # our own file
        **result, chosen=chosen, words=_WORDS, curves=list(CURVES), paints=PAINTS,
        figures=[port_figure(table, paint, i) for i, paint in enumerate(PAINTS)],
        finding=finding(table), by_noise=by_noise(table), caution=caution(table),
        u_dhr=U_DHR, gain=U_DHR_CAL, scan_gain=U_BRDF_CAL,
        noise=NOISE, misfit=MISFIT, misfit_deg=MISFIT_DEG,
    )  # fmt: skip


def make(target: Path) -> None:
    """Run the study and write numbers and page into ``target``."""
    result = run()
    (target / "ddr.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    (target / "index.html").write_text(page(result), encoding="utf-8")


if __name__ == "__main__":
    make(HERE)

"""Made-up but plausible `Analysis` records, one per situation a report has to cope with.

Nothing here evaluates the package's model: curves are Lorentzians in direction cosine with a
Fresnel factor, draws are normal, bands follow from made-up relative uncertainties.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pbrdf_bayes.results import QUANTILES, Analysis
from tests.report.synthetic_cases import CASES, CENTRES, PHYSICAL, Case
from tests.report.synthetic_summary import config_toml, eq5, summary_of

Array = NDArray[np.float64]
Z90, Z50 = 1.6448536, 0.6744898


def analysis(name: str = "demo", *, seed: int = 7) -> Analysis:
    """Build the synthetic analysis of one of the `CASES`."""
    case = CASES[name]
    rng = np.random.default_rng(seed)
    names = _parameter_names(case)
    posterior, prior = _draws(case, names, rng)
    data = _readings(case, rng)
    groups = {
        "posterior": posterior,
        "prior": prior,
        "sample_stats": _sample_stats(posterior, rng),
        "observed_data": data["observed"],
        "constant_data": data["constant"],
        "curves": _curves(case),
        "dhr_curves": _dhr_curves(case),
        "widths": _widths(case),
    }
    if case.holdout:
        groups["holdout"] = _holdout(data)
    if case.theta_i_deg:
        groups["leave_one_out"] = _leave_one_out(data, rng)
    summary = summary_of(case, names, posterior, prior, data)
    return Analysis(summary, xr.DataTree.from_dict(groups), config_toml(case))


def _leave_one_out(data: dict[str, Any], rng: np.random.Generator) -> xr.Dataset:
    n = data["observed"]["brdf"].size
    return xr.Dataset(
        {
            "brdf_elpd": ("brdf_obs", rng.normal(2.5, 0.7, n)),
            "brdf_k_hat": ("brdf_obs", rng.uniform(-0.3, 0.4, n)),
            "brdf_pit": ("brdf_obs", rng.random(n)),
        }
    )


def lorentzian(pol: Any, theta_i_deg: Any, theta_r_deg: Any) -> Array:
    """Return a peak in direction cosine times a Fresnel-like factor [sr^-1]."""
    theta_i, theta_r = np.radians(theta_i_deg), np.radians(theta_r_deg)
    alpha_i, alpha = np.sin(theta_i), np.sin(theta_r)
    half = np.arcsin((alpha + alpha_i) / 2)
    width = 0.47 * (np.cos(theta_i) + np.cos(theta_r)) / 2
    return np.asarray(0.19 * fresnel(pol, half) / ((alpha - alpha_i) ** 2 + width**2 + 1e-3))


def fresnel(pol: Any, angle: Any) -> Array:
    """Power reflectance of a medium of index 1.526 - 0.193i."""
    m2 = (1.526 - 0.193j) ** 2
    cos, root = np.cos(angle), np.sqrt(m2 - np.sin(angle) ** 2)
    f_s = np.abs((cos - root) / (cos + root)) ** 2
    f_p = np.abs((m2 * cos - root) / (m2 * cos + root)) ** 2
    pol = np.asarray(pol)
    return np.asarray(np.where(pol == "s", f_s, np.where(pol == "p", f_p, (f_s + f_p) / 2)))


def _parameter_names(case: Case) -> list[str]:
    noise = [f"s_rel_{p}" for p in case.polarizations] if case.theta_i_deg else []
    return [*PHYSICAL, *noise, *(["u_dhr"] if case.dhr else [])]


def _draws(case: Case, names: list[str], rng: np.random.Generator) -> tuple[xr.Dataset, xr.Dataset]:
    n_chain, n_draw = (4, 250) if case.method == "psis" else (64, 50)
    common = rng.normal(size=(n_chain, n_draw))
    posterior, prior = {}, {}
    for index, name in enumerate(names):
        centre, spread = CENTRES[name]
        mix = (0.8, -0.6, -0.7, 0.3)[index] if index < 4 else 0.05
        z = mix * common + np.sqrt(1 - mix**2) * rng.normal(size=common.shape)
        values = centre + spread * z
        before = _prior_draws(name, centre, rng, common.shape)
        if name in case.unidentified:
            values = np.quantile(before, 0.5) + 0.85 * (before - np.quantile(before, 0.5))
        if case.status != "done":
            values = values + spread * np.repeat([-1.5, 0.2, 0.4, 1.8], n_chain // 4)[:, None]
        posterior[name] = (("chain", "draw"), values)
        prior[name] = (("chain", "draw"), before)
    ensemble = ("chain", np.arange(n_chain) // max(1, n_chain // 4))
    return xr.Dataset(posterior, coords={"ensemble": ensemble}), xr.Dataset(prior)


def _prior_draws(
    name: str, centre: float, rng: np.random.Generator, shape: tuple[int, ...]
) -> Array:
    if name == "n":
        return np.clip(rng.normal(1.5, 0.2, shape), 1.0, 3.0)
    if name == "k":
        return np.abs(rng.normal(0, 0.5, shape))
    if name == "sigma_n0":
        return rng.uniform(0, 1, shape)
    if name == "rho0":
        return np.asarray(np.exp(rng.uniform(np.log(1e-3), np.log(4), shape)))
    return np.asarray(centre * np.exp(1.5 * rng.normal(size=shape)))


def _sample_stats(posterior: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
    shape = posterior["n"].shape
    return xr.Dataset(
        {
            "lp": (("chain", "draw"), 9000 + rng.normal(size=shape)),
            "acceptance_rate": ("chain", np.full(shape[0], 0.42)),
        }
    )


def _readings(case: Case, rng: np.random.Generator) -> dict[str, Any]:
    pol, theta_i, theta_r, index, labels, u = [], [], [], [], [], []
    grid = np.linspace(-80, 80, case.n_points)
    for angle in case.theta_i_deg:
        for p in case.polarizations:
            for run in range(case.runs):
                suffix = case.label_suffix + (f" run{run + 1}" if case.runs > 1 else "")
                index += [len(labels)] * case.n_points
                labels.append(f"{p} {angle:g} deg{suffix}")
                pol += [p] * case.n_points
                theta_i += [angle] * case.n_points
                theta_r.append(grid)
                u.append(np.full(case.n_points, np.nan))
    theta_r_all = np.concatenate(theta_r) if theta_r else np.zeros(0)
    pols, angles = np.asarray(pol, dtype=np.str_), np.asarray(theta_i, dtype=np.float64)
    model = lorentzian(pols, angles, theta_r_all)
    shape = case.misfit * np.cos(np.radians(3 * theta_r_all + angles))
    value = model * np.exp(shape + 0.01 * rng.normal(size=model.size))
    if case.broken_values and value.size > 40:
        value[5], value[17], model[30] = -1e-5, np.nan, np.nan
    d_pol = np.repeat(_dhr_polarizations(case), 8) if case.dhr else np.zeros(0, np.str_)
    d_theta = np.tile(np.arange(10.0, 81.0, 10.0), d_pol.size // 8)
    d_map = 0.4528 * fresnel(d_pol, np.radians(d_theta))
    d_value = d_map + 0.002 * rng.normal(size=d_map.size)
    obs, dhr = "brdf_obs", "dhr_obs"
    constant = xr.Dataset(
        {
            "brdf_polarization": (obs, pols), "brdf_theta_i_deg": (obs, angles),
            "brdf_theta_r_deg": (obs, theta_r_all), "brdf_phi_r_deg": (obs, 0 * angles),
            "brdf_scan": (obs, np.asarray(index, np.int64)),
            "brdf_u": (obs, np.concatenate(u) if u else np.zeros(0)),
            "brdf_row": (obs, np.arange(angles.size) + 2), "brdf_map": (obs, model),
            "brdf_best": (obs, model), "dhr_polarization": (dhr, d_pol),
            "dhr_theta_i_deg": (dhr, d_theta), "dhr_u": (dhr, np.full(d_map.size, 0.002)),
            "dhr_row": (dhr, np.arange(d_map.size)), "dhr_map": (dhr, d_map),
        },
        coords={"scan": ("scan", np.asarray(labels, dtype=np.str_))},
    )  # fmt: skip
    observed = xr.Dataset({"brdf": (obs, value), "dhr": (dhr, d_value)})
    return {"observed": observed, "constant": constant}


def _dhr_polarizations(case: Case) -> list[str]:
    return ["u"] if case.polarizations == ("u",) else ["s", "p"]


def _bands(curve: Array, u_model: Any, u_noise: float) -> tuple[Array, Array]:
    """Quantiles of the model and of the predictive band around a curve, last axis quantile."""
    z = np.array([-Z90, -Z50, 0.0, Z50, Z90])
    u_model = np.broadcast_to(u_model, curve.shape)[..., None]
    total = np.hypot(u_model, u_noise)
    return curve[..., None] * np.exp(z * u_model), curve[..., None] * np.exp(z * total)


def _curves(case: Case) -> xr.Dataset:
    between = [10.0, 30.0, 50.0, 70.0] if len(case.theta_i_deg) > 1 else [0.0, 45.0]
    angles = [(a, True) for a in case.theta_i_deg] + [(a, False) for a in between]
    pols = case.polarizations if case.polarizations != ("u",) else ("s", "p", "u")
    keys = [
        (p, a, m) for a, m in angles for p in pols if p == "u" or not m or pols != ("s", "p", "u")
    ]
    theta_r = np.arange(-85.0, 85.5, 0.5)
    pol = np.array([k[0] for k in keys])
    theta_i = np.array([k[1] for k in keys])
    curve = lorentzian(pol[:, None], theta_i[:, None], theta_r)
    away = np.abs(np.sin(np.radians(theta_r)) - np.sin(np.radians(theta_i))[:, None])
    u_model = 0.002 + 0.01 * away + 0.3 * (pol[:, None] != "u") * bool(case.unidentified)
    model, predictive = _bands(curve, u_model, 0.26 if case.misfit else 0.01)
    dims = ("curve", "theta_r_deg", "quantile")
    return xr.Dataset(
        {
            "model_band": (dims, model), "predictive_band": (dims, predictive),
            "map": (dims[:2], curve),
        },
        coords={
            "quantile": list(QUANTILES), "theta_r_deg": theta_r,
            "curve_polarization": ("curve", pol), "curve_theta_i_deg": ("curve", theta_i),
            "curve_phi_r_deg": ("curve", 0 * theta_i),
            "curve_measured": ("curve", np.array([k[2] for k in keys])),
        },
    )  # fmt: skip


def _dhr_curves(case: Case) -> xr.Dataset:
    theta_i = np.arange(0.0, 86.0, 1.0)
    pol = np.array(["s", "p"] if case.polarizations != ("u",) else ["s", "p", "u"])
    curve = 0.4528 * fresnel(pol[:, None], np.radians(theta_i))
    model, predictive = _bands(curve, 0.004 if case.dhr else 0.3, 0.01)
    dims = ("polarization", "theta_i_deg", "quantile")
    return xr.Dataset(
        {
            "model_band": (dims, model),
            "predictive_band": (dims, predictive),
            "map": (dims[:2], curve),
        },
        coords={"quantile": list(QUANTILES), "theta_i_deg": theta_i, "polarization": pol},
    )


def _widths(case: Case) -> xr.Dataset:
    theta_i = np.arange(0.0, 86.0, 1.0)
    pol = list(case.polarizations) if case.theta_i_deg else []
    curve = np.array([eq5(p, theta_i) for p in pol]).reshape(len(pol), theta_i.size)
    dims = ("polarization", "theta_i_deg", "quantile")
    return xr.Dataset(
        {"model_band": (dims, _bands(curve, 0.002, 0.0)[0]), "map": (dims[:2], curve)},
        coords={
            "quantile": list(QUANTILES), "theta_i_deg": theta_i,
            "polarization": np.array(pol, dtype=np.str_),
        },
    )  # fmt: skip


def _holdout(data: dict[str, Any]) -> xr.Dataset:
    constant, value = data["constant"], data["observed"]["brdf"].values
    labels = constant["scan"].values[constant["brdf_scan"].values]
    rows = labels != labels[0]
    _, band = _bands(constant["brdf_map"].values[rows], 0.012, 0.011)
    return xr.Dataset(
        {
            "scan": ("holdout_obs", labels[rows]),
            "theta_r_deg": ("holdout_obs", constant["brdf_theta_r_deg"].values[rows]),
            "value": ("holdout_obs", value[rows]),
            "predictive_band": (("holdout_obs", "quantile"), band),
        },
        coords={"quantile": list(QUANTILES)},
    )

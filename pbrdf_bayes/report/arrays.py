"""The arrays of an analysis as the records that are drawn; no computing beyond regrouping."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.quantities import POLARIZATIONS
from pbrdf_bayes.results import QUANTILES, Analysis

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Curve:
    """Predicted BRDF along one scan plane; bands of shape (n_theta, n_quantile) [sr^-1]."""

    polarization: str
    theta_i_deg: float
    phi_r_deg: float
    measured: bool
    theta_r_deg: Array
    model_band: Array | None
    predictive_band: Array
    map: Array


@dataclass(frozen=True, eq=False)
class ScanPoints:
    """Readings of one scan and the model at the MAP [sr^-1], along ``theta_r_deg``."""

    label: str
    polarization: str
    theta_i_deg: float
    phi_r_deg: float
    theta_r_deg: Array
    value: Array
    map: Array

    @property
    def residual_dex(self) -> Array:
        """log10(measured / model at the MAP); NaN where either is not positive."""
        good = (self.value > 0) & (self.map > 0)
        ratio = np.divide(self.value, self.map, out=np.ones_like(self.value), where=good)
        return np.where(good, np.log10(ratio), np.nan)


@dataclass(frozen=True, eq=False)
class DhrPoints:
    """DHR readings of one polarisation [1]."""

    polarization: str
    theta_i_deg: Array
    value: Array
    u_value: Array
    map: Array


@dataclass(frozen=True, eq=False)
class AngleCurve:
    """DHR or lobe width against incidence [1]; bands of shape (n_theta, n_quantile).

    The predictive band is NaN where there is none: a width is no reading.
    """

    polarization: str
    theta_i_deg: Array
    model_band: Array
    predictive_band: Array
    map: Array


def curves_of(analysis: Analysis, *, measured: bool) -> list[Curve]:
    """Predicted curves, at the measured incidence angles or at the others."""
    get = _group(analysis, "curves")
    theta_r, polarization = get("theta_r_deg"), _words(get("curve_polarization"))
    theta_i, phi_r, was = get("curve_theta_i_deg"), get("curve_phi_r_deg"), get("curve_measured")
    return [
        Curve(
            polarization=polarization[i],
            theta_i_deg=float(theta_i[i]),
            phi_r_deg=float(phi_r[i]) if phi_r.size else 0.0,
            measured=measured,
            theta_r_deg=np.asarray(theta_r, dtype=np.float64),
            model_band=_five(get("model_band")[i]),
            predictive_band=_five(get("predictive_band")[i]),
            map=np.asarray(get("map")[i], dtype=np.float64),
        )
        for i in range(theta_i.size)
        if bool(was[i]) == measured
    ]


def scans_of(analysis: Analysis) -> list[ScanPoints]:
    """Return the readings scan by scan, in the order of the measurement."""
    get, observed = _group(analysis, "constant_data"), _group(analysis, "observed_data")
    index, labels = get("brdf_scan"), _words(get("scan"))
    columns = {
        "theta_r_deg": get("brdf_theta_r_deg"), "value": observed("brdf"), "map": get("brdf_map"),
    }  # fmt: skip
    found = []
    for i, rows in enumerate(_rows_by(index, len(labels))):
        if rows.size == 0:
            continue
        first = int(rows[0])
        phi = get("brdf_phi_r_deg")
        found.append(
            ScanPoints(
                label=labels[i],
                polarization=str(get("brdf_polarization")[first]),
                theta_i_deg=float(get("brdf_theta_i_deg")[first]),
                phi_r_deg=float(phi[first]) if phi.size else 0.0,
                **{k: np.asarray(v[rows], dtype=np.float64) for k, v in columns.items()},
            )
        )
    return found


def dhr_points_of(analysis: Analysis) -> list[DhrPoints]:
    """DHR readings by polarisation, in the order s, p, u."""
    get, value = _group(analysis, "constant_data"), _group(analysis, "observed_data")("dhr")
    words = np.asarray(_words(get("dhr_polarization")), dtype=np.str_)
    stated = get("dhr_u")
    u_value = stated if stated.size else np.full(value.shape, np.nan)
    return [
        DhrPoints(
            polarization=p,
            theta_i_deg=get("dhr_theta_i_deg")[words == p],
            value=value[words == p],
            u_value=u_value[words == p],
            map=get("dhr_map")[words == p],
        )
        for p in POLARIZATIONS
        if np.any(words == p)
    ]


def dhr_curves_of(analysis: Analysis) -> list[AngleCurve]:
    """Predicted DHR by polarisation."""
    return _angle_curves(analysis, "dhr_curves")


def width_curves_of(analysis: Analysis) -> list[AngleCurve]:
    """Width of the lobes by Eq. (5), by polarisation; none in a run without widths."""
    return _angle_curves(analysis, "widths")


def _angle_curves(analysis: Analysis, group: str) -> list[AngleCurve]:
    get = _group(analysis, group)
    model, predictive = get("model_band"), get("predictive_band")
    predictive = predictive if predictive.size else np.full_like(model, np.nan)
    return [
        AngleCurve(
            polarization=q,
            theta_i_deg=np.asarray(get("theta_i_deg"), dtype=np.float64),
            model_band=_five(model[i]),
            predictive_band=_five(predictive[i]),
            map=np.asarray(get("map")[i], dtype=np.float64),
        )
        for i, q in enumerate(_words(get("polarization")))
    ]


@dataclass(frozen=True, eq=False)
class ScanPlaces:
    """Places of the readings of one scan in what all others predict, in [0, 1], ascending."""

    label: str
    polarization: str
    pit: Array
    p_value: float


def places_of(analysis: Analysis) -> list[ScanPlaces]:
    """Return the probability integral transforms scan by scan, in the order of the measurement."""
    pit, get = _group(analysis, "leave_one_out")("brdf_pit"), _group(analysis, "constant_data")
    told = (analysis.summary.get("leave_one_out") or {}).get("pit", [])
    p_values = {scan["label"]: float(scan["p_value"]) for scan in told}
    labels, index = _words(get("scan")), get("brdf_scan")
    if pit.size == 0 or pit.size != index.size:
        return []
    found = []
    for label, rows in zip(labels, _rows_by(index, len(labels)), strict=True):
        known = np.sort(pit[rows][np.isfinite(pit[rows])])
        if known.size and label in p_values:
            polarization = str(get("brdf_polarization")[int(rows[0])])
            found.append(ScanPlaces(label, polarization, known, p_values[label]))
    return found


@dataclass(frozen=True, eq=False)
class ScanWidthPoints:
    """Widths of the scans of one polarisation, standard errors, and Eq. (5) there [1]."""

    polarization: str
    theta_i_deg: Array
    width: Array
    u_width: Array
    model: Array


def scan_widths_of(analysis: Analysis) -> list[ScanWidthPoints]:
    """Widths of single scans by polarisation, in the order s, p, u."""
    scans = analysis.summary.get("scan_widths") or []
    names = ("theta_i_deg", "rho", "u_rho", "rho_model")
    return [
        ScanWidthPoints(p, *np.array([[_number(s[n]) for n in names] for s in found]).T)
        for p in POLARIZATIONS
        if (found := [s for s in scans if s["polarization"] == p])
    ]


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)


def held_out_of(analysis: Analysis) -> tuple[list[Curve], list[ScanPoints]]:
    """Return the scans that were left out and the predictive bands made without them.

    The model of these records is the median of the predictive band.
    """
    get = _group(analysis, "holdout")
    labels = np.asarray(_words(get("scan")), dtype=np.str_)
    curves, scans = [], []
    for scan in analysis.summary["input"]["scans"]:
        rows = np.flatnonzero(labels == scan["label"])
        if rows.size == 0:
            continue
        rows = rows[np.argsort(get("theta_r_deg")[rows], kind="stable")]
        theta_r, band = get("theta_r_deg")[rows], _five(get("predictive_band")[rows])
        key = (scan["polarization"], float(scan["theta_i_deg"]), float(scan["phi_r_deg"] or 0.0))
        curves.append(Curve(*key, True, theta_r, None, band, band[:, 2]))
        scans.append(ScanPoints(scan["label"], *key, theta_r, get("value")[rows], band[:, 2]))
    return curves, scans


def draws_of(analysis: Analysis, group: str, name: str) -> Array:
    """Draws of a parameter, shape (n_chain, n_draw); empty where there are none."""
    values = np.asarray(_group(analysis, group)(name), dtype=np.float64)
    return values if values.ndim == 2 else np.zeros((0, 0))


def ensembles_of(analysis: Analysis) -> NDArray[np.int64]:
    """Independent ensemble that each chain of the posterior belongs to."""
    found = _group(analysis, "posterior")("ensemble")
    n_chain = next(
        (draws_of(analysis, "posterior", n).shape[0] for n in analysis.summary["parameters"]), 0
    )
    return np.asarray(found, np.int64) if found.size == n_chain else np.zeros(n_chain, np.int64)


def _group(analysis: Analysis, name: str) -> Any:
    """Reader of the variables of a group; an empty array for what is not there."""
    group = analysis.draws.children.get(name)
    variables = {} if group is None else group.variables
    cache: dict[str, NDArray[Any]] = {}

    def get(variable: str) -> NDArray[Any]:
        if variable not in cache:
            there = variable in variables
            cache[variable] = np.asarray(variables[variable].values) if there else np.zeros(0)
        return cache[variable]

    return get


def _words(values: NDArray[Any]) -> list[str]:
    return [v.decode() if isinstance(v, bytes) else str(v) for v in values.tolist()]


def _rows_by(index: NDArray[Any], count: int) -> list[NDArray[np.int64]]:
    """Rows of each group, by one sort."""
    order = np.argsort(index, kind="stable")
    ends = np.searchsorted(index[order], np.arange(count + 1))
    return [order[a:b] for a, b in pairwise(ends.tolist())]


def _five(band: NDArray[Any]) -> Array:
    """Band with its last axis of the length of `QUANTILES`."""
    band = np.asarray(band, dtype=np.float64)
    if band.shape[-1] != len(QUANTILES):
        msg = f"a band has {band.shape[-1]} quantiles where {len(QUANTILES)} are stored"
        raise ValueError(msg)
    return band

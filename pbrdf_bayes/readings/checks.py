"""Checks of a measurement against itself, before any fit.

None of them needs the model's parameters. Each gives a verdict, the numbers behind it and, where
something is wrong, what to do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from math import isnan, log, nan

import numpy as np

from pbrdf_bayes.measurement import Measurement, Readings, Scan
from pbrdf_bayes.readings.scan_statistics import (
    Profile,
    covers_specular,
    find_spikes,
    hemisphere_bracket,
    in_plane,
    mirror_asymmetry,
    normal_incidence_ratio,
    point_noise,
    profile,
    repeat_deviation,
    zero_offset,
)


@dataclass(frozen=True)
class Limit:
    """Values above ``warn`` are warned of, above ``fail`` they fail."""

    warn: float
    fail: float
    unit: str


LIMITS: Mapping[str, Limit] = {
    "repeatability": Limit(warn=0.05, fail=0.2, unit="dex"),
    "symmetry": Limit(warn=0.03, fail=0.2, unit="dex"),
    "dhr_level": Limit(warn=1.5, fail=5.0, unit="factor"),
    "spikes": Limit(warn=0.0, fail=float("inf"), unit="points"),
    "coverage": Limit(warn=0.0, fail=float("inf"), unit="scans"),
    "s_equals_p": Limit(warn=0.03, fail=0.2, unit="dex"),
    "noise": Limit(warn=float("inf"), fail=float("inf"), unit="%"),
}
"""Limits of the verdicts; those of symmetry and s_equals_p rise with the noise of the scans."""

NORMAL_WITHIN_DEG = 0.05
NEAR_NORMAL_DEG = 10.0
SIGNIFICANT = 3.0
SPIKE_SD = 10.0
SPIKE_DEX = 0.15
MIN_POINTS = 5
_SAME = 9
"""Decimals [dex] to which deviations are compared."""
SPECULAR_WITHIN_DEG = 2.5
DHR_WITHIN_DEG = 10.0
MIN_LOBE_WIDTH_DEG = 1.0
MAX_THETA_I_P_DEG = 45.0
BRACKET_MARGIN = (2.25, 1.3)
"""Lower and upper margin of the hemispherical bracket: what lobes of the four-parameter model, not
round about the specular direction, need for n 1.2 to 4, rho0 0.05 to 2, theta_i 0 to 80 deg."""
DEX_TO_PERCENT = 100 * log(10)


@dataclass(frozen=True)
class DataCheck:
    """Outcome of one check.

    Attributes
    ----------
    name, title : str
        Identifier, and what the check asks.
    verdict : {"PASS", "WARN", "FAIL", "SKIP"}
        ``SKIP`` where the measurement has not what the check needs.
    value, threshold : float
        Number compared and limit beyond which the verdict is not PASS; NaN where there is none.
    unit : str
        Unit of both.
    statement : str
        What was found, in numbers.
    advice : str
        What to do; empty for PASS and SKIP.
    """

    name: str
    title: str
    verdict: str
    value: float
    threshold: float
    unit: str
    statement: str
    advice: str


def check_measurement(measurement: Measurement) -> tuple[DataCheck, ...]:
    """Check a measurement against itself, always with the same checks in the same order.

    Parameters
    ----------
    measurement : Measurement

    Returns
    -------
    tuple of DataCheck
        ``repeatability``: readings of one geometry agree. ``symmetry``: at normal incidence the
        scan is the same on both sides. ``dhr_level``: the in-plane level fits the DHR.
        ``spikes``: no isolated points. ``coverage``: scans reach the specular direction with
        enough points. ``s_equals_p``: at normal incidence and theta_r = 0 both are equal.
        ``noise``: noise from point to point, for information.

    Examples
    --------
    >>> from pbrdf_bayes.measurement import measurement_from_columns
    >>> theta = [-40.0, -20.0, 0.0, 20.0, 40.0]
    >>> m = measurement_from_columns(
    ...     sample="a", wavelength_um=3.39, quantity=["brdf"] * 5, polarization=["s"] * 5,
    ...     theta_i_deg=[0.0] * 5, theta_r_deg=theta, value=[0.01, 0.02, 0.04, 0.02, 0.01])
    >>> [(check.name, check.verdict) for check in check_measurement(m)][3:5]
    [('spikes', 'PASS'), ('coverage', 'PASS')]
    """
    profiles = tuple(profile(measurement, scan) for scan in measurement.scans)
    return (
        _check_repeatability(measurement),
        _check_symmetry(profiles),
        _check_dhr_level(measurement.dhr, profiles),
        _check_spikes(profiles),
        _check_coverage(profiles),
        _check_s_equals_p(profiles),
        _report_noise(profiles),
    )


TITLES = {
    "repeatability": "Repeated readings agree",
    "symmetry": "Forward and backward sides agree at normal incidence",
    "dhr_level": "BRDF level is consistent with the DHR",
    "spikes": "No isolated points",
    "coverage": "Scans cover their specular direction",
    "s_equals_p": "s and p agree at normal incidence",
    "noise": "Noise from point to point",
}


def _skip(name: str, reason: str) -> DataCheck:
    """Outcome of a check that the measurement gives no occasion for."""
    return DataCheck(name, TITLES[name], "SKIP", nan, nan, LIMITS[name].unit, reason, "")


def _judge(
    name: str, value: float, statement: str, advice: str, *, at_least: float = 0.0
) -> DataCheck:
    """Compare a value with its limit, which is raised to ``at_least``."""
    limit = LIMITS[name]
    warn = max(limit.warn, at_least)
    verdict = "FAIL" if value > max(limit.fail, warn) else "WARN" if value > warn else "PASS"
    threshold = warn if np.isfinite(warn) else nan
    advice = "" if verdict == "PASS" else advice
    return DataCheck(name, TITLES[name], verdict, value, threshold, limit.unit, statement, advice)


def _check_repeatability(measurement: Measurement) -> DataCheck:
    """Compare the spread of readings of one geometry with the limit."""
    deviation, scan = repeat_deviation(measurement)
    if deviation.size == 0:
        return _skip("repeatability", "No geometry was measured more than once.")
    spread = float(np.sqrt(np.mean(deviation**2)))
    several = np.unique(scan)
    means = [float(np.mean(deviation[scan == index])) for index in several]
    largest = np.round(np.abs(means), _SAME)
    worst = int(np.flatnonzero(largest == largest.max())[-1])  # of two alike the later one
    label = measurement.scans[several[worst]].label
    statement = (
        f"{deviation.size} repeated readings agree to {spread:.3f} dex "
        f"({spread * DEX_TO_PERCENT:.1f} %); largest mean deviation of a scan "
        f"{means[worst]:+.3f} dex ({label})."
    )
    advice = (
        "Look for drift of the source or another spot on the sample; flag the scan that is off, or "
        "let each scan have its own scale (u_brdf_cal)."
    )
    return _judge("repeatability", spread, statement, advice)


def _check_symmetry(profiles: tuple[Profile, ...]) -> DataCheck:
    """Compare both sides of the scans at normal incidence, and look for an angular offset.

    Every plane counts: at normal incidence both of its halves are alike, whatever the azimuth.
    """
    found = [
        (asymmetry, p)
        for p in profiles
        if p.scan.theta_i_deg <= NORMAL_WITHIN_DEG and not isnan(asymmetry := mirror_asymmetry(p))
    ]
    if not found:
        return _skip("symmetry", "No scan at normal incidence has both sides.")
    asymmetry, p = max(found, key=lambda item: item[0])
    centre, left = zero_offset(p)
    statement = f"Both sides of {p.scan.label} agree to {asymmetry:.3f} dex rms."
    advice = "Check the alignment of the sample and the stray light on either side."
    if abs(centre) >= NORMAL_WITHIN_DEG and left < 0.6 * asymmetry:
        statement += f" About theta_r = {centre:+.2f} deg they agree to {left:.3f} dex."
        advice = (
            f"Correct theta_r_deg by {-centre:+.2f} deg, or realign the zero of the goniometer."
        )
    noise = point_noise(p)
    return _judge("symmetry", asymmetry, statement, advice, at_least=SIGNIFICANT * 2**0.5 * noise)


def _check_dhr_level(dhr: Readings, profiles: tuple[Profile, ...]) -> DataCheck:
    """Compare each DHR reading with the bracket of the hemispherical integral of its scan."""
    found: list[tuple[float, str]] = []
    for p in profiles:
        reading = _dhr_at(dhr, p.scan)
        if reading is None or not shows_its_lobe(p):
            continue
        lower, upper = hemisphere_bracket(p)
        lower, upper = lower / BRACKET_MARGIN[0], upper * BRACKET_MARGIN[1]
        factor = max(lower / reading, reading / upper, 1.0)
        text = f"{p.scan.label}: DHR {reading:.3g}, from the scan {lower:.2g} to {upper:.2g}"
        found.append((factor, text))
    if not found:
        return _skip("dhr_level", "No scan and DHR reading of one polarisation can be compared.")
    factor, text = max(found)
    statement = f"{len(found)} scan{'s' if len(found) > 1 else ''} compared; farthest is {text}."
    advice = (
        "Check the units (DHR as a fraction; BRDF per steradian, not multiplied by pi or "
        "cos(theta_r)) and the reference of both instruments; brdf_scale = 'relative' fits the "
        "shape of the scans alone."
    )
    return _judge("dhr_level", factor, statement, advice)


def _dhr_at(dhr: Readings, scan: Scan) -> float | None:
    """DHR at the incidence and polarisation of a scan, interpolated; None where not near."""
    polarizations = ("s", "p") if scan.polarization == "u" else (scan.polarization,)
    own = dhr.polarization == scan.polarization
    groups = [own] if np.any(own) else [dhr.polarization == q for q in polarizations]
    readings = []
    for group in groups:
        angle, value = dhr.theta_i_deg[group], dhr.value[group]
        if not value.size or np.min(np.abs(angle - scan.theta_i_deg)) > DHR_WITHIN_DEG:
            return None
        readings.append(float(np.interp(scan.theta_i_deg, angle, value)))
    reading = float(np.mean(readings))
    return reading if reading > 0 else None


def shows_its_lobe(p: Profile) -> bool:
    """Tell whether the level of a scan says something about its hemispherical integral.

    It does not out of plane, without the specular direction, for a lobe narrower than the step,
    nor for p near the Brewster angle, where the plane of incidence is darker than the rest.
    """
    brewster = p.scan.polarization == "p" and p.scan.theta_i_deg > MAX_THETA_I_P_DEG
    if (
        brewster
        or len(p) < MIN_POINTS
        or not covers_specular(p, within_deg=SPECULAR_WITHIN_DEG)
        or not in_plane(p.scan)
    ):
        return False
    bright = p.theta_r_deg[p.level > p.level.max() + np.log10(0.5)]
    return bool(bright.size >= MIN_POINTS - 2 and np.ptp(bright) >= MIN_LOBE_WIDTH_DEG)


def _check_spikes(profiles: tuple[Profile, ...]) -> DataCheck:
    """Find single points far from the curve through their neighbours."""
    long = [p for p in profiles if len(p) >= MIN_POINTS]
    if not long:
        return _skip("spikes", f"No scan has {MIN_POINTS} points or more.")
    spikes = sorted((spike for p in long for spike in _describe_spikes(p)), reverse=True)
    low = min(float(p.level.min()) for p in long)
    high = max(float(p.level.max()) for p in long)
    statement = (
        f"BRDF from {10**low:.3g} to {10**high:.3g} sr^-1 ({high - low:.1f} decades); "
        f"{len(spikes) or 'no'} isolated point{'s' if len(spikes) != 1 else ''}"
    )
    listed = "; ".join(text for _, text in spikes[:5])
    statement += f": {listed}{'; ...' if len(spikes) > 5 else ''}." if spikes else "."
    advice = (
        "Look for a reflection in the set-up, the edge of an obscured region or a lost reading "
    )
    advice += "there, and flag the rows."
    return _judge("spikes", float(len(spikes)), statement, advice)


def _describe_spikes(p: Profile) -> list[tuple[float, str]]:
    """Size [dex] and place of the isolated points of a scan."""
    index, deviation = find_spikes(p, at_least=SPIKE_DEX, significant=SPIKE_SD)
    spikes = []
    for i, size in zip(index.tolist(), deviation.tolist(), strict=True):
        place = f"line {p.row[i]}, " if p.row[i] else ""
        text = f"{place}{p.scan.label}, theta_r {p.theta_r_deg[i]:.6g} deg ({size:+.2f} dex)"
        spikes.append((abs(size), text))
    return spikes


def _check_coverage(profiles: tuple[Profile, ...]) -> DataCheck:
    """Count scans in plane that miss their specular direction, and any with too few points."""
    if not any(in_plane(p.scan) for p in profiles):
        return _skip("coverage", "There is no BRDF scan in the plane of incidence.")
    few = [p.scan.label for p in profiles if len(p) < MIN_POINTS]
    missed = [
        p.scan.label
        for p in profiles
        if len(p) >= MIN_POINTS
        and in_plane(p.scan)
        and not covers_specular(p, within_deg=SPECULAR_WITHIN_DEG)
    ]
    out_of_plane = sum(not in_plane(p.scan) for p in profiles if len(p) >= MIN_POINTS)
    counted = len(profiles) - out_of_plane
    statement = f"{counted - len(few) - len(missed)} of {counted} scans are complete."
    if out_of_plane:
        statement += f" {out_of_plane} out of the plane of incidence not counted."
    if missed:
        statement += f" Without the specular direction: {', '.join(missed[:5])}."
    if few:
        statement += f" With fewer than {MIN_POINTS} points: {', '.join(few[:5])}."
    advice = (
        "Extend these scans past theta_r = theta_i with at least "
        f"{MIN_POINTS} points, or expect wider intervals for rho0 and sigma_n0."
    )
    return _judge("coverage", float(len(few) + len(missed)), statement, advice)


def _check_s_equals_p(profiles: tuple[Profile, ...]) -> DataCheck:
    """Compare s with p at normal incidence, where they are one and the same, plane by plane."""
    normal = [p for p in profiles if p.scan.theta_i_deg <= NORMAL_WITHIN_DEG]
    pairs = product(
        (p for p in normal if p.scan.polarization == "s"),
        [p for p in normal if p.scan.polarization == "p"],
    )
    found = [
        (*normal_incidence_ratio(a, b, NEAR_NORMAL_DEG), a, b)
        for a, b in pairs
        if a.scan.phi_r_deg == b.scan.phi_r_deg
    ]
    found = [item for item in found if not isnan(item[0])]
    if not found:
        return _skip(
            "s_equals_p",
            "No pair of s and p scans of one plane at normal incidence covers theta_r = 0.",
        )
    ratio, error, a, b = max(found, key=lambda item: abs(item[0]))
    statement = (
        f"log10 of {a.scan.label} over {b.scan.label} at theta_r = 0 is {ratio:+.3f} dex "
        f"(standard error {error:.3f}), a factor {10**ratio:.3f}."
    )
    advice = (
        "Check the gain and the leakage of the polarisers, and whether the sample was turned "
        "between the scans; a grain in the paint makes s and p differ too."
    )
    return _judge("s_equals_p", abs(ratio), statement, advice, at_least=SIGNIFICANT * error)


def _report_noise(profiles: tuple[Profile, ...]) -> DataCheck:
    """State the noise of the quietest, the median and the noisiest scan."""
    noise = {
        p.scan.label: point_noise(p) * DEX_TO_PERCENT for p in profiles if len(p) >= MIN_POINTS
    }
    if not noise:
        return _skip("noise", f"No scan has {MIN_POINTS} points or more.")
    median = float(np.median(list(noise.values())))
    worst = max(noise, key=lambda label: noise[label])
    statement = (
        f"Median {median:.2g} %, from {min(noise.values()):.2g} % to {noise[worst]:.2g} % "
        f"({worst}). What varies slowly along a scan is not in it."
    )
    return _judge("noise", median, statement, "")

"""Checks of a measurement against itself, before any fit.

None of them needs the model's parameters. Each gives a verdict, the numbers behind it and, where
something is wrong, what to do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import isnan, log, nan
from typing import Any

import numpy as np

from pbrdf_bayes.measurement import Measurement, Readings, Scan
from pbrdf_bayes.quantities import S_AND_P
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
from pbrdf_bayes.records.checks import Check, Finding
from pbrdf_bayes.words import OF_READINGS, counted, judged, say, skipped


@dataclass(frozen=True)
class Limit:
    """Values above ``warn`` are warned of, above ``fail`` they fail."""

    warn: float
    fail: float


LIMITS: Mapping[str, Limit] = {
    "repeatability": Limit(warn=0.05, fail=0.2),
    "symmetry": Limit(warn=0.03, fail=0.2),
    "dhr_level": Limit(warn=1.5, fail=5.0),
    "spikes": Limit(warn=0.0, fail=float("inf")),
    "coverage": Limit(warn=0.0, fail=float("inf")),
    "s_equals_p": Limit(warn=0.03, fail=0.2),
    "noise": Limit(warn=float("inf"), fail=float("inf")),
}
"""Limits of the verdicts; those of symmetry and s_equals_p rise with the noise of the scans."""

NORMAL_WITHIN_DEG = 0.05
NEAR_NORMAL_DEG = 10.0
SIGNIFICANT = 3.0
SPIKE_SD = 10.0
SPIKE_DEX = 0.15
MIN_POINTS = 5
_LISTED = 5
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


def check_measurement(measurement: Measurement) -> tuple[Check, ...]:
    """Check a measurement against itself, always with the same checks in the same order.

    Parameters
    ----------
    measurement : Measurement

    Returns
    -------
    tuple of Check
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


def find_problems(measurement: Measurement) -> tuple[Finding, ...]:
    """Checks that did not pass, as findings about the sample.

    Parameters
    ----------
    measurement : Measurement

    Returns
    -------
    tuple of Finding
    """
    return tuple(
        Finding(
            code=check.name, sample=measurement.sample, verdict=check.verdict, scans=check.scans,
            lines=check.lines, size=check.value, statement=check.statement,
            remedy=check.advice or "",
        )
        for check in check_measurement(measurement)
        if check.verdict in ("WARN", "FAIL")
    )  # fmt: skip


def _judge(
    code: str, value: float, *, at_least: float = 0.0, scans: Sequence[str] = (),
    lines: Sequence[int] = (), advice: str = "", more: str = "", **numbers: Any,
) -> Check:  # fmt: skip
    """Compare a value with its limit, which is raised to ``at_least``."""
    limit = LIMITS[code]
    warn = max(limit.warn, at_least)
    verdict = "FAIL" if value > max(limit.fail, warn) else "WARN" if value > warn else "PASS"
    threshold = warn if np.isfinite(warn) else nan
    return judged(
        code, value, threshold, verdict, of=OF_READINGS, scans=scans, lines=lines, advice=advice,
        more=more, **numbers,
    )  # fmt: skip


def _check_repeatability(measurement: Measurement) -> Check:
    """Compare the spread of readings of one geometry with the limit."""
    deviation, scan = repeat_deviation(measurement)
    if deviation.size == 0:
        return skipped("repeatability")
    spread = float(np.sqrt(np.mean(deviation**2)))
    several = np.unique(scan)
    means = [float(np.mean(deviation[scan == index])) for index in several]
    largest = np.round(np.abs(means), _SAME)
    worst = int(np.flatnonzero(largest == largest.max())[-1])  # of two alike the later one
    label = measurement.scans[several[worst]].label
    return _judge(
        "repeatability", spread, scans=[label], n=deviation.size,
        percent=spread * DEX_TO_PERCENT, label=label, mean=means[worst],
    )  # fmt: skip


def _check_symmetry(profiles: tuple[Profile, ...]) -> Check:
    """Compare both sides of the scans at normal incidence, and look for an angular offset.

    Every plane counts: at normal incidence both of its halves are alike, whatever the azimuth.
    """
    found = [
        (asymmetry, p)
        for p in profiles
        if p.scan.theta_i_deg <= NORMAL_WITHIN_DEG and not isnan(asymmetry := mirror_asymmetry(p))
    ]
    if not found:
        return skipped("symmetry")
    asymmetry, p = max(found, key=lambda item: item[0])
    centre, left = zero_offset(p)
    more = advice = ""
    if abs(centre) >= NORMAL_WITHIN_DEG and left < 0.6 * asymmetry:
        more = say("symmetry.zero", centre=centre, left=left)
        advice = say("symmetry.shift", shift=-centre)
    return _judge(
        "symmetry", asymmetry, at_least=SIGNIFICANT * 2**0.5 * point_noise(p),
        scans=[p.scan.label], label=p.scan.label, more=more, advice=advice,
    )  # fmt: skip


def _check_dhr_level(dhr: Readings, profiles: tuple[Profile, ...]) -> Check:
    """Compare each DHR reading with the bracket of the hemispherical integral of its scan."""
    found: list[tuple[float, str, float, float, float]] = []
    for p in profiles:
        reading = _dhr_at(dhr, p.scan)
        if reading is None or not shows_its_lobe(p):
            continue
        lower, upper = hemisphere_bracket(p)
        lower, upper = lower / BRACKET_MARGIN[0], upper * BRACKET_MARGIN[1]
        factor = max(lower / reading, reading / upper, 1.0)
        found.append((factor, p.scan.label, reading, lower, upper))
    if not found:
        return skipped("dhr_level")
    factor, label, reading, lower, upper = max(found)
    return _judge(
        "dhr_level", factor, scans=[label], compared=counted(len(found), "scan"), label=label,
        dhr=reading, low=lower, high=upper,
    )  # fmt: skip


def _dhr_at(dhr: Readings, scan: Scan) -> float | None:
    """DHR at the incidence and polarisation of a scan, interpolated; None where not near."""
    polarizations = S_AND_P if scan.polarization == "u" else (scan.polarization,)
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


def _check_spikes(profiles: tuple[Profile, ...]) -> Check:
    """Find single points far from the curve through their neighbours."""
    long = [p for p in profiles if len(p) >= MIN_POINTS]
    if not long:
        return skipped("spikes", least=MIN_POINTS)
    spikes = sorted((spike for p in long for spike in _list_spikes(p)), reverse=True)
    low = min(float(p.level.min()) for p in long)
    high = max(float(p.level.max()) for p in long)
    listed = [text for _, text, *_ in spikes[:_LISTED]] + ["..."] * (len(spikes) > _LISTED)
    return _judge(
        "spikes", float(len(spikes)), scans=tuple(dict.fromkeys(s for *_, s, _ in spikes)),
        lines=sorted(row for *_, row in spikes if row), low=10**low, high=10**high,
        decades=high - low, points=counted(len(spikes), "isolated point"),
        listed=f": {'; '.join(listed)}" if spikes else "",
    )  # fmt: skip


def _list_spikes(p: Profile) -> list[tuple[float, str, str, int]]:
    """Size [dex], place, scan and line of the isolated points of a scan."""
    index, deviation = find_spikes(p, at_least=SPIKE_DEX, significant=SPIKE_SD)
    spikes = []
    for i, size in zip(index.tolist(), deviation.tolist(), strict=True):
        row = int(p.row[i])
        text = say(
            "spikes.line" if row else "spikes.one", row=row, label=p.scan.label,
            theta_r=p.theta_r_deg[i], size=size,
        )  # fmt: skip
        spikes.append((abs(size), text, p.scan.label, row))
    return spikes


def _check_coverage(profiles: tuple[Profile, ...]) -> Check:
    """Count scans in plane that miss their specular direction, and any with too few points."""
    if not any(in_plane(p.scan) for p in profiles):
        return skipped("coverage")
    few = [p.scan.label for p in profiles if len(p) < MIN_POINTS]
    missed = [
        p.scan.label
        for p in profiles
        if len(p) >= MIN_POINTS
        and in_plane(p.scan)
        and not covers_specular(p, within_deg=SPECULAR_WITHIN_DEG)
    ]
    out_of_plane = sum(not in_plane(p.scan) for p in profiles if len(p) >= MIN_POINTS)
    in_all = len(profiles) - out_of_plane
    more = say("coverage.out_of_plane", n=out_of_plane) if out_of_plane else ""
    more += say("coverage.missed", labels=", ".join(missed[:_LISTED])) if missed else ""
    more += say("coverage.few", least=MIN_POINTS, labels=", ".join(few[:_LISTED])) if few else ""
    return _judge(
        "coverage", float(len(few) + len(missed)), scans=[*missed, *few], least=MIN_POINTS,
        complete=in_all - len(few) - len(missed), counted=in_all, more=more,
    )  # fmt: skip


def _check_s_equals_p(profiles: tuple[Profile, ...]) -> Check:
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
        return skipped("s_equals_p")
    ratio, error, a, b = max(found, key=lambda item: abs(item[0]))
    labels = (a.scan.label, b.scan.label)
    return _judge(
        "s_equals_p", abs(ratio), at_least=SIGNIFICANT * error, scans=labels, s=labels[0],
        p=labels[1], ratio=ratio, error=error, factor=10**ratio,
    )  # fmt: skip


def _report_noise(profiles: tuple[Profile, ...]) -> Check:
    """State the noise of the quietest, the median and the noisiest scan."""
    noise = {
        p.scan.label: point_noise(p) * DEX_TO_PERCENT for p in profiles if len(p) >= MIN_POINTS
    }
    if not noise:
        return skipped("noise", least=MIN_POINTS)
    median = float(np.median(list(noise.values())))
    worst = max(noise, key=lambda label: noise[label])
    return _judge("noise", median, least=min(noise.values()), most=noise[worst], label=worst)

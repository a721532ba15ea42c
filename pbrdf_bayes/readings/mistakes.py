"""Mistakes that benches make, found in the readings alone.

Each function looks for one mistake and returns the scans that show it. None of them uses the model:
they rest on what every surface shows. A lobe lies on the forward side. At its peak s light is
reflected more than p. The BRDF is smooth in theta_r and levels out towards grazing directions on
the backward side. Levels of scans agree with the DHR to one common factor.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import log, log10, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.measurement import Measurement, Readings
from pbrdf_bayes.quantities import S_AND_P
from pbrdf_bayes.readings.checks import MAX_THETA_I_P_DEG, shows_its_lobe
from pbrdf_bayes.readings.scan_statistics import (
    Profile,
    find_spikes,
    hemisphere_bracket,
    in_plane,
    neighbour_deviation,
    point_noise,
    profile,
    zero_offset,
)
from pbrdf_bayes.records.checks import Finding
from pbrdf_bayes.verdict import FAIL, WARN
from pbrdf_bayes.words import of_mistake

Array = NDArray[np.float64]
Index = NDArray[np.int64]

OBLIQUE_DEG = 12.0
"""Incidence from which the forward and the backward side differ."""
_CLEAR = 8.0
"""Standard deviations of the noise from which a deviation is no chance."""
_LEAST_DEX = 0.06
_FEWEST = 7
_ALIKE_SHARE = 0.3
_END_DEG = 58.0
_COSINE_SLOPE = 0.6
_SHUFFLED = 0.65
_SHUFFLED_DEX = 0.08
_RETRO_DEX = 0.6
"""Backward over forward side that no retroreflecting coating shows."""
_SMOOTH_DEX = 0.015
"""Slow deviation along a scan that is no zero error."""
_GAIN_DEX = 0.3
_SHADOW_DEX = 0.12
_SHADOW_REACH_DEG = 6.0
_ZERO_DEG = 0.3
_PI_DEX = 0.15
_BROAD_DEG = 16.0
"""Full width of a lobe from which its integral follows from one plane to a factor 2."""
_CONTRAST_DEX = 0.2
_METAL_DEX = 0.45
"""p over s at the peak that no metal shows."""
_SIGMA_RATIO = 4.0
_PERCENT = log(10.0) * 100.0


def find_mistakes(measurement: Measurement) -> tuple[Finding, ...]:
    """Mistakes that the readings show by themselves.

    Parameters
    ----------
    measurement : Measurement

    Returns
    -------
    tuple of Finding
        Empty where nothing is found. A scan that is named takes no part in later searches.

    Examples
    --------
    >>> from pbrdf_bayes.measurement import measurement_from_columns
    >>> theta = np.linspace(-70.0, 70.0, 15)
    >>> m = measurement_from_columns(
    ...     sample="a", wavelength_um=3.39, quantity=["brdf"] * 15, polarization=["s"] * 15,
    ...     theta_i_deg=[40.0] * 15, theta_r_deg=theta, value=np.exp(-((theta + 40.0) / 30.0) ** 2))
    >>> [(f.code, f.scans) for f in find_mistakes(m)]
    [('theta_r_sign', ('s 40 deg',))]
    """
    profiles = [profile(measurement, scan) for scan in measurement.scans if in_plane(scan)]
    profiles = [p for p in profiles if len(p) >= _FEWEST]
    found = _sign_lost(measurement)
    for search in () if found else _SEARCHES:
        named = {label for finding in found for label in finding.scans}
        found += search(measurement, [p for p in profiles if p.scan.label not in named])
    return tuple(found)


def _finding(
    measurement: Measurement, code: str, profiles: Iterable[Profile], *, case: str = "",
    size: float | None = None, lines: Sequence[int] = (), verdict: str = FAIL, **numbers: Any,
) -> Finding:  # fmt: skip
    labels = tuple(p.scan.label for p in profiles)
    rows = tuple(int(n) for n in lines if n)
    statement, remedy = of_mistake(f"{code}{case}", size=size, **numbers)
    return Finding(code, measurement.sample, verdict, labels, rows, size, statement, remedy)


def _names(profiles: Sequence[Profile], everything: int) -> str:
    """Scans in words."""
    if len(profiles) == everything and everything > 1:
        return f"all {everything} scans"
    listed = ", ".join(p.scan.label for p in profiles[:4])
    return (
        f"scan {listed}"
        if len(profiles) == 1
        else f"scans {listed}" + ", ..." * (len(profiles) > 4)
    )


def _at(p: Profile, angle: float | Array) -> Array:
    """Level at an angle [dex], NaN outside the scan."""
    return np.asarray(np.interp(angle, p.theta_r_deg, p.level, left=np.nan, right=np.nan))


def _noise(p: Profile) -> float:
    """Noise of a point [dex], at least 0.2 %."""
    return max(float(np.nan_to_num(point_noise(p), nan=0.0)), 0.001)


def _near_brewster(p: Profile) -> bool:
    """Tell whether the lobe of p light may all but vanish."""
    return p.scan.polarization == "p" and p.scan.theta_i_deg > MAX_THETA_I_P_DEG


def _forward_excess(p: Profile) -> float:
    """Mean of level(+t) - level(-t) over the angles t around theta_i on both sides [dex]."""
    t = np.linspace(0.5, 1.25, 16) * p.scan.theta_i_deg
    difference = _at(p, t) - _at(p, -t)
    seen = difference[np.isfinite(difference)]
    return float(np.mean(seen)) if seen.size >= 4 else float("nan")


def _theta_r_sign(measurement: Measurement, profiles: list[Profile]) -> list[Finding]:
    """Scans whose lobe lies on the backward side."""
    oblique = [p for p in profiles if p.scan.theta_i_deg >= OBLIQUE_DEG]
    excess = {p.scan.label: _forward_excess(p) for p in oblique}
    reversed_ = []
    for p in oblique:
        peak = float(p.theta_r_deg[np.argmax(p.level)])
        limit = max(_LEAST_DEX, _CLEAR * _noise(p) / 4.0)
        if excess[p.scan.label] < -limit and peak < -0.4 * p.scan.theta_i_deg:
            reversed_.append(p)
    if not reversed_:
        return []
    forward = [p for p in oblique if excess[p.scan.label] > _LEAST_DEX]
    if forward:
        reversed_ = [p for p in reversed_ if _stands_out(p, forward, excess)]
    elif not any(excess[p.scan.label] < -_RETRO_DEX for p in reversed_):
        reversed_ = []
    if not reversed_:
        return []
    names = _names(reversed_, len(oblique))
    return [
        _finding(
            measurement, "theta_r_sign", reversed_,
            names=names, size=float(np.mean([excess[p.scan.label] for p in reversed_])),
        )
    ]  # fmt: skip


def _stands_out(p: Profile, forward: list[Profile], excess: dict[str, float]) -> bool:
    """Tell a reversed scan from one of a retroreflecting coating.

    Retroreflection prevails below some incidence, and for p near the Brewster angle.
    """
    near = min(forward, key=lambda f: abs(f.scan.theta_i_deg - p.scan.theta_i_deg))
    size = -excess[p.scan.label]
    if _near_brewster(p):
        return size > 2.0 * _RETRO_DEX
    lowest = min(f.scan.theta_i_deg for f in forward)
    if p.scan.polarization == "p" and size < 0.5 * _RETRO_DEX:
        return False
    return size > _RETRO_DEX or (
        p.scan.theta_i_deg >= lowest and size > 0.3 * excess[near.scan.label]
    )


def _sign_lost(measurement: Measurement) -> list[Finding]:
    """No negative angle anywhere, and angles given twice with different values."""
    brdf = measurement.brdf
    if not len(brdf) or (brdf.theta_r_deg < 0.0).any():
        return []
    folded: list[Profile] = []
    lines: list[int] = []
    n_oblique = 0
    for scan in measurement.scans:
        angle, value = brdf.theta_r_deg[scan.rows], brdf.value[scan.rows]
        n_oblique += scan.theta_i_deg >= OBLIQUE_DEG
        order = np.argsort(angle, kind="stable")
        same = np.diff(angle[order]) == 0.0
        pairs = np.log10(np.maximum(value[order], 1e-280))
        apart = np.abs(np.diff(pairs))[same]
        if same.sum() < max(3, _ALIKE_SHARE * np.unique(angle).size):
            continue
        if scan.theta_i_deg >= OBLIQUE_DEG and np.median(apart) > _LEAST_DEX:
            folded.append(profile(measurement, scan))
            lines.append(int(brdf.row[scan.rows][order][1:][same][0]))
    if not folded or 2 * len(folded) < n_oblique:
        return []
    return [
        _finding(
            measurement, "sign_lost", folded,
            names=_names(folded, n_oblique), lines=lines,
        )
    ]  # fmt: skip


def _polarization_excess(s: Profile, p: Profile) -> tuple[float, float]:
    """Level of s over p around the specular direction and its error [dex]; NaN without a lobe."""
    theta_i = s.scan.theta_i_deg
    near = s.theta_r_deg[np.abs(s.theta_r_deg - theta_i) <= max(0.25 * theta_i, 5.0)]
    difference = _at(s, near) - _at(p, near)
    seen = difference[np.isfinite(difference)]
    lobe = min(float(_at(q, min(theta_i, q.theta_r_deg[-1])) - np.median(q.level)) for q in (s, p))
    if seen.size < 2 or not lobe > 0.2:
        return float("nan"), float("nan")
    noise = np.hypot(_noise(s), _noise(p)) / np.sqrt(seen.size)
    return float(np.median(seen)), float(np.hypot(noise, 0.012))


def _swapped_polarization(measurement: Measurement, profiles: list[Profile]) -> list[Finding]:
    """Incidences at which p is brighter than s at the peak, or its DHR larger."""
    pairs = [
        (s, p)
        for s in profiles
        for p in profiles
        if s.scan.polarization == "s" and p.scan.polarization == "p"
        and s.scan.theta_i_deg == p.scan.theta_i_deg >= OBLIQUE_DEG
    ]  # fmt: skip
    judged = [(s, p, *_polarization_excess(s, p)) for s, p in pairs]
    judged = [j for j in judged if np.isfinite(j[2])]
    limits = [max(3.5 * j[3], 0.04) for j in judged]
    dark = [j for j, limit in zip(judged, limits, strict=True) if j[2] < -limit]
    right = any(j[2] > limit for j, limit in zip(judged, limits, strict=True))
    clear = [
        j for j in dark if right or j[2] < -min(_METAL_DEX, _half_contrast(measurement.dhr, j[0]))
    ]
    swapped = dark if clear and len(dark) == len(judged) else clear
    dhr_excess, dhr_error = _dhr_excess(measurement.dhr)
    dhr_swapped = dhr_excess < -3.5 * dhr_error
    if not swapped and not dhr_swapped:
        return []
    kept = len(judged) - len(swapped)
    if dhr_swapped and not kept and swapped:
        what = "every BRDF scan and in the DHR"
    elif swapped:
        angles = sorted({s.scan.theta_i_deg for s, *_ in swapped})
        at = ", ".join(f"{a:g}" for a in angles[:4])
        what = f"the scans at theta_i {at} deg" if kept else "every BRDF scan"
    else:
        what = "the DHR"
    scans = [q for s, p, *_ in swapped for q in (s, p)]
    return [
        _finding(
            measurement, "swapped_polarization", scans,
            where=what,
            size=float(np.mean([j[2] for j in swapped])) if swapped else dhr_excess,
        )
    ]  # fmt: skip


def _half_contrast(dhr: Readings, s: Profile) -> float:
    """Half of |log10 DHR_s/DHR_p| at the incidence of a scan; infinite where that tells nothing."""
    p = Profile(replace(s.scan, polarization="p"), s.theta_r_deg, s.level, s.row)
    of_s, of_p = _dhr_near(dhr, s), _dhr_near(dhr, p)
    contrast = abs(log10(of_s / of_p)) if of_s and of_p else 0.0
    return 0.5 * contrast if contrast > _CONTRAST_DEX else float("inf")


def _dhr_excess(dhr: Readings) -> tuple[float, float]:
    """Mean of DHR_s - DHR_p at common oblique angles, and its error [1]."""
    by = {q: dhr.polarization == q for q in S_AND_P}
    s, p = (
        {round(float(a), 3): float(v) for a, v in zip(
            dhr.theta_i_deg[rows], dhr.value[rows], strict=True)}
        for rows in by.values()
    )  # fmt: skip
    both = [a for a in s if a in p and a >= 2.0 * OBLIQUE_DEG]
    if len(both) < 2:
        return 0.0, float("inf")
    difference = np.array([s[a] - p[a] for a in both])
    level = np.array([s[a] + p[a] for a in both])
    error = float(np.std(difference, ddof=1)) if len(both) > 2 else 0.0
    return float(np.mean(difference)), max(0.01 * float(np.mean(level)), 0.25 * error)


def _cosine_factor(measurement: Measurement, profiles: list[Profile]) -> list[Finding]:
    """A common power of cos(theta_r) at the grazing end of the backward side."""
    slopes = []
    for p in profiles:
        sides = (-1.0, 1.0) if p.scan.theta_i_deg < 1.0 else (-1.0,)
        for side in sides:
            angle = side * p.theta_r_deg
            end = (angle > _END_DEG) & (angle < 88.0)
            x = np.log10(np.cos(np.deg2rad(angle[end])))
            if end.sum() >= 4 and np.ptp(x) > 0.2:
                slope = float(np.polyfit(x, p.level[end], 1)[0])
                error = _noise(p) / (np.std(x) * np.sqrt(x.size))
                slopes.append((slope, error, p))
    if not slopes:
        return []
    values = np.array([slope for slope, *_ in slopes])
    median = float(np.median(values))
    error = float(np.median([e for _, e, _ in slopes])) / np.sqrt(values.size)
    same = np.mean(np.sign(values) == np.sign(median))
    if abs(median) < _COSINE_SLOPE + 3.0 * error or same < 0.8 or abs(median) > 2.0:
        return []
    times = median > 0.0
    return [
        _finding(
            measurement, "cosine_factor", [p for *_, p in slopes],
            case=".times" if times else ".over", size=median, n=len(slopes),
        )
    ]  # fmt: skip


def _clipped(measurement: Measurement, profiles: list[Profile]) -> list[Finding]:
    """Scans whose highest readings are one and the same number."""
    brdf, found = measurement.brdf, []
    for p in profiles:
        value, row = brdf.value[p.scan.rows], brdf.row[p.scan.rows]
        top = value >= value.max() * (1.0 - 1e-6)
        distinct = np.unique(brdf.theta_r_deg[p.scan.rows][top]).size
        if distinct < 3 or np.unique(value).size < 5:
            continue
        rest = np.unique(value[~top], return_counts=True)[1]
        if rest.size and rest.max() >= distinct:  # coarse numbers everywhere
            continue
        found.append(
            _finding(
                measurement, "clipped", [p],
                n=distinct, label=p.scan.label, size=float(value.max()),
                lines=sorted(row[top].tolist()),
            )
        )  # fmt: skip
    return found


def _shadow(measurement: Measurement, profiles: list[Profile]) -> list[Finding]:
    """Dips about theta_r = -theta_i, where the detector passes before the source."""
    shadowed: list[Profile] = []
    lines: list[int] = []
    depth: list[float] = []
    for p in profiles:
        rows, size = _dip(p)
        if rows.size:
            shadowed.append(p)
            lines.extend(p.row[rows].tolist())
            depth.append(size)
    if not shadowed:
        return []
    return [
        _finding(
            measurement, "shadow", shadowed,
            names=_names(shadowed, len(profiles)), depth=abs(float(np.median(depth))),
            size=float(np.median(depth)), lines=sorted(set(lines)),
        )
    ]  # fmt: skip


def _dip(p: Profile) -> tuple[Index, float]:
    """Readings of a dip about retroreflection, and its depth [dex]; none without one.

    The narrowest window that leaves readings on both sides which a cubic describes well.
    """
    distance = p.theta_r_deg + p.scan.theta_i_deg
    step = float(np.median(np.diff(p.theta_r_deg)))
    nothing = np.zeros(0, np.int64), 0.0
    for half in (0.6, 1.6, 2.6, 3.6):
        reach = max(half * step, 0.1)
        if reach > _SHADOW_REACH_DEG and half > 0.6:
            break
        inside = np.flatnonzero(np.abs(distance) <= reach)
        beside = np.flatnonzero(
            (np.abs(distance) > reach) & (np.abs(distance) <= reach + 6.2 * step)
        )
        left = int((distance[beside] < 0.0).sum())
        if not inside.size or min(left, beside.size - left) < 3:
            continue
        x = distance[beside] / (reach + 6.2 * step)
        coefficients = np.polyfit(x, p.level[beside], 3)
        rest = p.level[beside] - np.polyval(coefficients, x)
        scatter = max(float(np.std(rest)) * np.sqrt(x.size / max(x.size - 4, 1)), _noise(p))
        deviation = p.level[inside] - np.polyval(
            coefficients, distance[inside] / (reach + 6.2 * step)
        )
        deep = deviation < -max(_SHADOW_DEX, _CLEAR * scatter)
        if deep.any() and deep.sum() >= 0.5 * inside.size:
            return inside[deep], float(np.median(deviation[deep]))
    return nothing


def _shuffled(measurement: Measurement, profiles: list[Profile]) -> list[Finding]:
    """Scans in which neighbours are no more alike than any two readings."""
    found = []
    for p in profiles:
        if len(p) < 12 or not point_noise(p) > _SHUFFLED_DEX:
            continue
        ratio = float(np.mean(np.diff(p.level) ** 2) / (2.0 * np.var(p.level, ddof=1)))
        spikes, _ = find_spikes(p, at_least=0.15, significant=10.0)
        if ratio > _SHUFFLED and spikes.size < 0.1 * len(p):
            found.append(
                _finding(
                    measurement, "shuffled", [p],
                    label=p.scan.label, percent=point_noise(p) * _PERCENT, size=ratio,
                )
            )  # fmt: skip
    return found


def _level_ratios(measurement: Measurement, profiles: list[Profile]) -> dict[str, float]:
    """log10 of the hemispherical integral of a scan over its DHR, where both are known."""
    ratio = {}
    for p in profiles:
        reading = _dhr_near(measurement.dhr, p)
        if reading and shows_its_lobe(p) and p.theta_r_deg[0] <= 0.0 <= p.theta_r_deg[-1]:
            lower, upper = hemisphere_bracket(p)
            ratio[p.scan.label] = 0.5 * log10(max(lower * upper, 1e-280)) - log10(reading)
    return ratio


def _scan_gain(measurement: Measurement, profiles: list[Profile]) -> list[Finding]:
    """Scans whose level is off by a factor that the others do not have."""
    ratio = _level_ratios(measurement, profiles)
    if len(ratio) < 3:
        return []
    deviation = {
        label: own - float(np.median([r for other, r in ratio.items() if other != label]))
        for label, own in ratio.items()
    }
    limit = max(_GAIN_DEX, 5.0 * float(np.median(np.abs(list(deviation.values())))))
    off = [p for p in profiles if abs(deviation.get(p.scan.label, 0.0)) > limit]
    off = [p for p in off if all(_not_exchanged(p, o, deviation) for o in profiles)]
    if 2 * len(off) >= len(ratio):
        return []
    return [
        _finding(
            measurement, "scan_gain", [p],
            label=p.scan.label, size=10.0 ** deviation[p.scan.label],
        )
        for p in off
    ]  # fmt: skip


def _not_exchanged(p: Profile, other: Profile, deviation: dict[str, float]) -> bool:
    """Tell that two scans of one incidence are not each other's: those deviate oppositely."""
    pair = {p.scan.polarization, other.scan.polarization} == {"s", "p"}
    if not pair or p.scan.theta_i_deg != other.scan.theta_i_deg:
        return True
    of_other = deviation.get(other.scan.label)
    return of_other is not None and abs(of_other) < 0.5 * abs(deviation[p.scan.label])


def _pi_factor(measurement: Measurement, profiles: list[Profile]) -> list[Finding]:
    """All levels off by pi, for lobes whose integral follows from one plane."""
    ratio = _level_ratios(measurement, profiles)
    broad = [
        p
        for p in profiles
        if p.scan.label in ratio
        and p.scan.theta_i_deg < MAX_THETA_I_P_DEG
        and np.ptp(p.theta_r_deg[p.level > p.level.max() - log10(2.0)]) > _BROAD_DEG
    ]
    ratios = np.array([ratio[p.scan.label] for p in broad])
    middle = float(np.median(ratios)) if ratios.size >= 2 else 0.0
    if abs(abs(middle) - log10(pi)) > _PI_DEX or np.std(ratios) > _PI_DEX:
        return []
    times = middle > 0.0
    return [
        _finding(
            measurement, "pi_factor", broad,
            case=".times" if times else ".over", size=10.0**middle, verdict=WARN,
        )
    ]  # fmt: skip


def _dhr_near(dhr: Readings, p: Profile) -> float | None:
    """DHR of the polarisation of a scan at its incidence, or None."""
    own = dhr.polarization == p.scan.polarization
    if not own.any():
        return None
    angle, value = dhr.theta_i_deg[own], dhr.value[own]
    if np.min(np.abs(angle - p.scan.theta_i_deg)) > 10.0:
        return None
    order = np.argsort(angle)
    reading = float(np.interp(p.scan.theta_i_deg, angle[order], value[order]))
    return reading if reading > 0.0 else None


def _zero_theta_r(measurement: Measurement, profiles: list[Profile]) -> list[Finding]:
    """Scans at normal incidence that are symmetric about another angle than 0."""
    offsets = []
    for p in profiles:
        if p.scan.theta_i_deg > 0.05 or np.ptp(p.level) < 0.1:
            continue
        centre, left = zero_offset(p)
        slope = _rms_slope(p)
        error = np.hypot(_noise(p) / np.sqrt(len(p)), _SMOOTH_DEX / np.sqrt(3.0)) / max(slope, 1e-6)
        if np.isfinite(left) and left < 4.0 * _noise(p) + 0.01:
            offsets.append((centre, float(error), p))
    if not offsets:
        return []
    centres = np.array([c for c, *_ in offsets])
    error = float(np.median([e for _, e, _ in offsets])) / np.sqrt(len(offsets))
    mean = float(np.mean(centres))
    apart = float(np.ptp(centres)) if centres.size > 1 else 0.0
    if abs(mean) < max(_ZERO_DEG, 3.0 * error) or apart > 0.5 * abs(mean):
        return []
    return [
        _finding(
            measurement, "zero_theta_r", [p for *_, p in offsets],
            shift=-mean, size=mean, verdict=WARN,
        )
    ]  # fmt: skip


def _rms_slope(p: Profile) -> float:
    """Rms slope of the level along theta_r [dex/deg], the part of the noise taken out."""
    way = p.theta_r_deg[4:] - p.theta_r_deg[:-4]
    square = ((p.level[4:] - p.level[:-4]) ** 2 - 2.0 * _noise(p) ** 2) / way**2
    return float(np.sqrt(max(float(np.mean(square)), 0.0)))


def _stated_sigma(measurement: Measurement, profiles: list[Profile]) -> list[Finding]:
    """Stated uncertainties far from what neighbouring readings scatter."""
    brdf, ratios = measurement.brdf, []
    for p in profiles:
        stated = brdf.u_value[p.scan.rows] / np.maximum(brdf.value[p.scan.rows], 1e-280)
        if np.isfinite(stated).sum() >= _FEWEST and neighbour_deviation(p)[0].size >= _FEWEST:
            level = float(np.nanmedian(stated)) / log(10.0)
            ratios.append((_noise(p) / max(level, 1e-12), p))
    off = [(r, p) for r, p in ratios if r > _SIGMA_RATIO or r < 1.0 / _SIGMA_RATIO**2]
    if not off or 2 * len(off) < len(ratios):
        return []
    size = float(np.median([r for r, _ in off]))
    return [
        _finding(
            measurement, "stated_sigma", [p for _, p in off],
            size=size, verdict=WARN,
        )
    ]  # fmt: skip


_SEARCHES = (
    _shuffled, _clipped, _shadow, _theta_r_sign, _scan_gain, _swapped_polarization, _cosine_factor,
    _pi_factor, _zero_theta_r, _stated_sigma,
)  # fmt: skip
"""In this order: a scan that one search names is left out of the later ones."""

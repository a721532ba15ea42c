"""Elementary functions against 40 digits, in units in the last place (ulp) of the exact value.

The bounds follow from counting roundings, u = 2^-53 each, and 2 u is at most 2 ulp of a result at
the upper end of its binade:

- log: fdlibm's algorithm, below 1 ulp.
- exp: argument reduction (u/4), product and sum of the last Horner step (u/2 + u), below 1.5 ulp;
  the series ends at r^13/13! with |r| < ln(2)/2, 2e-18 relative.
- half_sincos: sin = 2 s c with s and c to 1.5 u and two products, 4 u or 4 ulp; cos = 1 - 2 s^2
  with s^2 <= 1/2, 4 u absolute (it vanishes at x = pi, where no relative accuracy is claimed).
"""

from __future__ import annotations

from collections.abc import Callable

import mpmath
import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from pbrdf_bayes.physics import elementary

Array = NDArray[np.float64]
mp = mpmath.MPContext()
mp.dps = 40
ROUNDING = 2.0**-53


@njit
def _log(x: Array, out: Array) -> None:
    for i in range(x.size):
        out[i] = elementary.log(x[i])


@njit
def _log_ratio(a: Array, b: Array, out: Array) -> None:
    for i in range(a.size):
        out[i] = elementary.log_ratio(a[i], b[i])


@njit
def _exp(x: Array, out: Array) -> None:
    for i in range(x.size):
        out[i] = elementary.exp(x[i])


@njit
def _half_sincos(x: Array, sine: Array, cosine: Array) -> None:
    for i in range(x.size):
        sine[i], cosine[i] = elementary.half_sincos(x[i])


def ulps(found: Array, x: Array, exact: Callable[[object], mpmath.mpf]) -> tuple[float, float]:
    """Largest error in ulp of the exact value, and where."""
    errors = []
    for value, argument in zip(found.tolist(), x.tolist(), strict=True):
        wanted = exact(mp.mpf(argument))
        unit = mp.mpf(float(np.spacing(abs(float(wanted)))))
        errors.append(float(abs(mp.mpf(value) - wanted) / unit))
    worst = int(np.argmax(errors))
    return errors[worst], float(x[worst])


def test_log_is_within_one_ulp_over_all_normal_numbers() -> None:
    rng = np.random.default_rng(1)
    near_one = rng.choice([-1.0, 1.0], 2000) * 10.0 ** rng.uniform(-16.0, -1.0, 2000)
    x = np.concatenate([
        np.exp(rng.uniform(-708.0, 709.0, 3000)),
        rng.uniform(0.7, 1.5, 2000),
        1.0 + near_one,
        [np.finfo(float).tiny, np.finfo(float).max, np.sqrt(0.5), np.sqrt(2.0), 2.0, 0.5],
        [np.nextafter(1.0, 2.0), np.nextafter(1.0, 0.0)],
    ])  # fmt: skip
    found = np.empty(x.size)
    _log(x, found)
    worst, where = ulps(found, x, mp.log)
    assert worst < 1.0, f"{worst:.3f} ulp at {where!r}"


def test_log_of_a_ratio_is_within_two_ulp_also_where_the_ratio_is_nearly_one() -> None:
    rng = np.random.default_rng(2)
    a = np.exp(rng.uniform(-300.0, 300.0, 6000))
    b = a * np.concatenate([
        np.exp(rng.uniform(-300.0, 300.0, 2000)),
        2.0 ** rng.uniform(-1.0, 1.0, 2000),
        1.0 + 10.0 ** rng.uniform(-15.0, -1.0, 2000),
    ])  # fmt: skip
    found = np.empty(a.size)
    _log_ratio(a, b, found)
    exact = [mp.log(mp.mpf(p) / mp.mpf(q)) for p, q in zip(a.tolist(), b.tolist(), strict=True)]
    units = np.spacing(np.abs(np.array([float(e) for e in exact])))
    error = [float(abs(mp.mpf(f) - e)) for f, e in zip(found.tolist(), exact, strict=True)]
    assert np.max(np.array(error) / units) < 2.0
    assert elementary.log_ratio(3.0, 3.0) == 0.0
    assert elementary.log_ratio(1e-307, 1.0) == pytest.approx(np.log(1e-307), rel=1e-15)


def test_log_of_one_is_exactly_zero() -> None:
    assert elementary.log(1.0) == 0.0


@pytest.mark.parametrize(("low", "high"), [(-700.0, 700.0), (-1.0, 1.0), (-1e-8, 1e-8)])
def test_exp_is_within_one_and_a_half_ulp(low: float, high: float) -> None:
    x = np.concatenate([np.random.default_rng(2).uniform(low, high, 3000), [low, high, 0.0]])
    found = np.empty(x.size)
    _exp(x, found)
    worst, where = ulps(found, x, mp.exp)
    assert worst < 1.5, f"{worst:.3f} ulp at {where!r}"


def test_sine_of_half_the_angle_is_within_four_ulp() -> None:
    rng = np.random.default_rng(3)
    x = np.concatenate(
        [rng.uniform(-np.pi, np.pi, 3000), 10.0 ** rng.uniform(-290.0, 0.0, 1000), [np.pi, -np.pi]]
    )
    sine, cosine = np.empty(x.size), np.empty(x.size)
    _half_sincos(x, sine, cosine)
    worst, where = ulps(sine, x, lambda v: mp.sin(v / 2))
    assert worst < 4.0, f"{worst:.3f} ulp at {where!r}"


def test_cosine_of_half_the_angle_is_within_four_roundings_of_one() -> None:
    x = np.concatenate([np.random.default_rng(4).uniform(-np.pi, np.pi, 3000), [np.pi, -np.pi]])
    sine, cosine = np.empty(x.size), np.empty(x.size)
    _half_sincos(x, sine, cosine)
    errors = np.array(
        [float(abs(mp.mpf(c) - mp.cos(mp.mpf(v) / 2))) for c, v in zip(cosine, x, strict=True)]
    )
    worst = int(np.argmax(errors))
    assert errors[worst] < 4.0 * ROUNDING, f"{errors[worst]:.2e} at {x[worst]!r}"


def test_half_sincos_is_odd_and_even_bit_for_bit() -> None:
    x = np.random.default_rng(5).uniform(0.0, np.pi, 500)
    plus, minus = np.empty((2, x.size)), np.empty((2, x.size))
    _half_sincos(x, plus[0], plus[1])
    _half_sincos(-x, minus[0], minus[1])
    np.testing.assert_array_equal(minus[0], -plus[0])
    np.testing.assert_array_equal(minus[1], plus[1])

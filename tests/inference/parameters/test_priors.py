"""Priors against scipy.stats and numerical integration."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, stats

from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.inference.parameters.prior_density import Prior
from pbrdf_bayes.inference.parameters.priors import NOISE_PRIORS, PRESETS, prior_from_table

ALL = {
    f"{preset}.{name}": prior for preset, table in PRESETS.items() for name, prior in table.items()
}
ALL |= dict(NOISE_PRIORS)
ALL["half of a normal, off centre"] = Prior(kind="normal", mean=2.0, sd=0.5, low=1.7, high=2.1)
ALL["far tail"] = Prior(kind="normal", mean=0.0, sd=1.0, low=4.0, high=6.0)
ALL["narrow log-normal"] = Prior(kind="lognormal", mean=0.0, sd=0.01, low=0.5, high=2.0)
every_prior = pytest.mark.parametrize("name", ALL)
PROBABILITIES = np.concatenate([[0.0, 1e-4, 1.0 - 1e-4, 1.0], np.linspace(0.01, 0.99, 33)])


def independent(prior: Prior) -> Any:
    """The same law as a frozen scipy distribution (of the logarithm for log kinds)."""
    low, high = prior.low, prior.high
    if prior.is_log:
        low, high = (math.log(v) if v > 0.0 else -math.inf for v in (low, high))
    if prior.kind in ("normal", "lognormal"):
        a, b = (low - prior.mean) / prior.sd, (high - prior.mean) / prior.sd
        return stats.truncnorm(a, b, loc=prior.mean, scale=prior.sd)
    return stats.uniform(low, high - low)


@every_prior
def test_density_integrates_to_one(name: str) -> None:
    """In the variable in which the density is simple, split at its quantiles."""
    prior = ALL[name]
    law = independent(prior)

    def integrand(v: float) -> float:
        value = math.exp(v) if prior.is_log else v
        value = min(max(value, prior.low), prior.high)
        jacobian = value if prior.is_log else 1.0
        return float(np.exp(prior.log_density(np.array([value])))[0] * jacobian)

    ends = law.ppf([1e-12, 0.01, 0.1, 0.5, 0.9, 0.99, 1.0 - 1e-12])
    parts = [
        integrate.quad(integrand, a, b, epsabs=1e-13, epsrel=1e-12)[0] for a, b in pairwise(ends)
    ]
    assert sum(parts) == pytest.approx(1.0, abs=1e-9)


@every_prior
def test_density_is_that_of_scipy(name: str) -> None:
    prior = ALL[name]
    law = independent(prior)
    v = law.ppf(PROBABILITIES[(PROBABILITIES > 0.0) & (PROBABILITIES < 1.0)])
    values = np.exp(v) if prior.is_log else v
    wanted = law.logpdf(v) - (v if prior.is_log else 0.0)
    np.testing.assert_allclose(prior.log_density(values), wanted, rtol=1e-9, atol=1e-9)


@every_prior
def test_quantile_is_the_inverse_of_the_distribution_function(name: str) -> None:
    prior = ALL[name]
    law = independent(prior)
    values = prior.quantile(PROBABILITIES)
    assert np.all((values >= prior.low) & (values <= prior.high))
    assert np.all(np.diff(prior.quantile(np.linspace(0.0, 1.0, 200))) >= 0.0)
    v = np.log(values) if prior.is_log else values
    np.testing.assert_allclose(law.cdf(v), PROBABILITIES, atol=1e-9)


@every_prior
def test_standard_deviation_is_that_of_scipy(name: str) -> None:
    """20 000 quantiles: the midpoint rule leaves out the last 2.5e-5 of either tail."""
    prior = ALL[name]
    law = independent(prior)
    if prior.is_log:
        moments = [
            law.expect(lambda v, k=k: np.exp(k * v), epsabs=0.0, epsrel=1e-9, limit=400)
            for k in (1, 2)
        ]
        wanted = math.sqrt(moments[1] - moments[0] ** 2)
    else:
        wanted = float(law.std())
    assert prior.standard_deviation == pytest.approx(wanted, rel=3e-3, abs=0.0)


@every_prior
def test_outside_the_support_the_density_is_zero(name: str) -> None:
    prior = ALL[name]
    outside = np.array(
        [prior.low - 1e-9, prior.high + 1e-9, -1e300, 1e300, np.nan, np.inf, -np.inf]
    )
    assert np.all(np.isneginf(prior.log_density(outside)))
    assert np.all(np.isfinite(prior.log_density(np.array([prior.low, prior.high]))))


def test_presets_are_the_documented_ones() -> None:
    common = {"sigma_n0": ("uniform", 0.0, 1.0), "rho0": ("loguniform", 1e-3, 4.0)}
    for table in PRESETS.values():
        assert list(table) == ["n", "k", "sigma_n0", "rho0"]
        for name, (kind, low, high) in common.items():
            assert (table[name].kind, table[name].low, table[name].high) == (kind, low, high)
    paint, dielectric, metal = (PRESETS[name] for name in ("paint", "dielectric", "metal"))
    assert paint["n"] == Prior(kind="normal", mean=1.5, sd=0.2, low=1.0, high=3.0)
    assert (dielectric["n"].kind, dielectric["n"].low, dielectric["n"].high) == (
        "uniform",
        1.0,
        3.0,
    )
    for table in (paint, dielectric):
        k = table["k"]
        assert (k.kind, k.mean, k.sd, k.low) == ("normal", 0.0, 0.5, 0.0)
        assert k.describe() == "HalfNormal(0.5)"
    assert (metal["n"].kind, metal["n"].low, metal["n"].high) == ("uniform", 0.05, 6.0)
    assert (metal["k"].kind, metal["k"].low, metal["k"].high) == ("uniform", 0.1, 12.0)
    noise = NOISE_PRIORS["s_rel"]
    assert (noise.kind, noise.mean, noise.sd) == ("lognormal", math.log(0.02), 1.5)


@pytest.mark.parametrize(
    ("table", "wanted"),
    [
        ({"kind": "uniform"}, Prior(kind="uniform", low=1.0, high=3.0)),
        ({"kind": "uniform", "low": 1.2, "high": 2}, Prior(kind="uniform", low=1.2, high=2.0)),
        ({"mean": 1.6, "sd": 0.05}, Prior(kind="normal", mean=1.6, sd=0.05, low=1.0, high=3.0)),
        (
            {"kind": "halfnormal", "sd": 2},
            Prior(kind="normal", mean=0.0, sd=2.0, low=1.0, high=3.0),
        ),
        ({"kind": "loguniform"}, Prior(kind="loguniform", low=1.0, high=3.0)),
        (
            {"kind": "lognormal", "median": 1.5, "factor": 1.2},
            Prior(kind="lognormal", mean=math.log(1.5), sd=math.log(1.2), low=1.0, high=3.0),
        ),
    ],
)
def test_a_table_replaces_a_prior(table: dict[str, Any], wanted: Prior) -> None:
    assert prior_from_table("n", table, PRESETS["paint"]["n"]) == wanted


@pytest.mark.parametrize(
    ("name", "table", "message"),
    [
        ("n", {"kind": "normal", "mean": 1.5, "sdev": 0.1},
         r"priors\.n: unknown key 'sdev'\. Did you mean 'sd'\?"),
        ("n", {"kind": "gaussian", "mean": 1.5, "sd": 0.1}, r"priors\.n\.kind = 'gaussian' is not known"),
        ("n", {"kind": "unifrom"}, r"Did you mean 'uniform'\?"),
        ("n", {"kind": "normal", "mean": 1.5}, r"priors\.n: 'sd' is missing"),
        ("n", {"kind": "normal", "sd": 1.5}, r"priors\.n: 'mean' is missing"),
        ("n", {"kind": "lognormal", "median": 1.5}, r"priors\.n: 'factor' is missing"),
        ("n", {"kind": "normal", "mean": 1.5, "sd": 0.0}, r"priors\.n\.sd = 0\.0 is not allowed"),
        ("n", {"kind": "normal", "mean": 1.5, "sd": -1}, r"priors\.n\.sd = -1 is not allowed"),
        ("n", {"kind": "normal", "mean": "1.5", "sd": 1}, r"priors\.n\.mean = '1\.5' is not allowed"),
        ("n", {"kind": "normal", "mean": True, "sd": 1}, r"priors\.n\.mean = True is not allowed"),
        ("n", {"kind": "normal", "mean": math.nan, "sd": 1}, r"priors\.n\.mean = nan is not allowed"),
        ("n", {"kind": "uniform", "low": 0.5}, r"priors\.n\.low = 0\.5 is not allowed: give a number in \[1, 3\]"),
        ("n", {"kind": "uniform", "high": 3.5}, r"priors\.n\.high = 3\.5 is not allowed"),
        ("n", {"kind": "uniform", "low": 2.0, "high": 2.0}, r"low = 2 is not below high = 2"),
        ("k", {"kind": "loguniform"}, r"priors\.k: loguniform needs low > 0"),
        ("n", {"kind": "lognormal", "median": 1.5, "factor": 1.0}, r"priors\.n\.factor = 1\.0 is not allowed"),
        ("n", {"kind": "normal", "mean": 100.0, "sd": 0.1}, r"Normal\(100, 0\.1\) has no mass on \[1, 3\]"),
        ("n", {"kind": ["normal"]}, r"priors\.n\.kind = \['normal'\] is not known"),
    ],
)  # fmt: skip
def test_bad_tables_are_refused(name: str, table: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        prior_from_table(name, table, PRESETS["paint"][name])


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"kind": "lognormal", "median": 1e-5, "factor": 1.5}, r"no mass on"),
        ({"kind": "lognormal", "median": 1e5, "factor": 1.5}, r"no mass on"),
    ],
)
def test_a_log_normal_without_mass_on_the_support_is_refused(
    table: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        prior_from_table("rho0", table, PRESETS["paint"]["rho0"])


@given(
    st.floats(-5.0, 8.0), st.floats(0.05, 5.0), st.floats(0.05, 5.9), st.floats(0.0, 1.0),
)  # fmt: skip
@settings(max_examples=200, deadline=None)
def test_any_accepted_normal_prior_is_a_distribution(
    mean: float, sd: float, low: float, probability: float
) -> None:
    try:
        prior = prior_from_table(
            "n", {"kind": "normal", "mean": mean, "sd": sd, "low": low},
            Prior(kind="uniform", low=0.05, high=6.0),
        )  # fmt: skip
    except ConfigError:
        return
    value = prior.quantile(np.array([probability]))
    law = stats.truncnorm((low - mean) / sd, (6.0 - mean) / sd, loc=mean, scale=sd)
    # probabilities near one lose what is small against one: 1e-16 over the mass on the support
    mass = stats.norm.cdf(6.0, mean, sd) - stats.norm.cdf(low, mean, sd)
    assert law.cdf(value)[0] == pytest.approx(probability, abs=1e-9 + 1e-15 / mass)
    assert np.isfinite(prior.log_density(value))[0]

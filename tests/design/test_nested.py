"""Nested estimates of the information gain against the closed form of linear normal readings."""

from __future__ import annotations

import numpy as np
import pytest

from pbrdf_bayes.design.linear import LinearLaw, Told, entropy_of_draws
from pbrdf_bayes.design.nested import PairTable, expected_gain, expected_spread

N_ABOUT, N_ALL, N_READINGS = 2, 4, 3


class Linear:
    """y = A x + noise with x = (theta, eta) normal: everything is known."""

    def __init__(self, seed: int, size: float) -> None:
        rng = np.random.default_rng(seed)
        self.a = size * rng.normal(size=(N_READINGS, N_ALL))
        root = np.tril(rng.normal(size=(N_ALL, N_ALL)))
        self.covariance = root @ root.T + 0.2 * np.eye(N_ALL)
        self.noise2 = 0.3

    @property
    def gain(self) -> float:
        """I(theta; y) = 1/2 ln det S_tt / det (S_tt | y), by dense algebra on the joint law."""
        s, a = self.covariance, self.a
        of_y = a @ s @ a.T + self.noise2 * np.eye(len(a))
        after = s - s @ a.T @ np.linalg.solve(of_y, a @ s)
        block = slice(0, N_ABOUT)
        before, later = s[block, block], after[block, block]
        return 0.5 * float(np.linalg.slogdet(before)[1] - np.linalg.slogdet(later)[1])

    def log_density(self, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        """ln p(y_i | x_j), shape (n_y, n_x), or (n_y, n) for x of shape (n_y, n, n_all)."""
        away = y[:, None, :] - x @ self.a.T
        level = N_READINGS * np.log(2.0 * np.pi * self.noise2)
        return -0.5 * (np.sum(away**2, axis=2) / self.noise2 + level)

    def table(self, rng: np.random.Generator, n: int, m: int, n_nuisance: int) -> PairTable:
        x = rng.multivariate_normal(np.zeros(N_ALL), self.covariance, size=n + m)
        own, inner = x[:n], x[n:]
        y = own @ self.a.T + np.sqrt(self.noise2) * rng.normal(size=(n, N_READINGS))
        s = self.covariance
        t, e = slice(0, N_ABOUT), slice(N_ABOUT, N_ALL)
        to_eta = np.linalg.solve(s[t, t], s[t, e])
        rest = np.linalg.cholesky(s[e, e] - s[e, t] @ to_eta)
        normal = rng.normal(size=(n, n_nuisance, N_ALL - N_ABOUT))
        other = np.repeat(own[:, None], n_nuisance, axis=1)
        other[:, :, N_ABOUT:] = (own[:, :N_ABOUT] @ to_eta)[:, None] + normal @ rest.T
        return PairTable(
            own=self.log_density(y, own[:, None])[:, 0],
            inner=self.log_density(y, inner[None]),
            nuisance=self.log_density(y, other),
            log_weights=np.full((n, n_nuisance), -np.log(n_nuisance)),
        )


@pytest.mark.parametrize("size", [0.2, 0.6, 1.2])
def test_the_middle_is_the_truth_and_the_bracket_holds_it(size: float) -> None:
    law = Linear(1, size)
    gain, _ = expected_gain(law.table(np.random.default_rng(2), 4000, 600, 600))
    assert gain.low < gain.high
    assert gain.low - 3.0 * gain.se < law.gain < gain.high + 3.0 * gain.se
    assert abs(gain.eig - law.gain) < 4.0 * gain.se


def test_bias_falls_as_one_over_m() -> None:
    """Plain nested Monte Carlo is high by a term of order 1/M, the contrastive one low by it."""
    law = Linear(3, 0.7)
    rng = np.random.default_rng(4)
    sizes = np.array([25, 50, 100, 200, 400])
    high, low, middle = [], [], []
    for m in sizes:
        gains = [expected_gain(law.table(rng, 400, int(m), 2))[0] for _ in range(60)]
        only = [(g.low, g.high, g.eig) for g in gains]
        mean = np.mean(only, axis=0)
        low.append(mean[0])
        high.append(mean[1])
        middle.append(mean[2])
    # the nuisance part has the same bias at every M: its share is the limit for large M
    up, down = np.array(high) - high[-1], low[-1] - np.array(low)
    slope_up = np.polyfit(np.log(sizes[:4]), np.log(up[:4] + up[0] * 25 / 400), 1)[0]
    slope_down = np.polyfit(np.log(sizes[:4]), np.log(down[:4] + down[0] * 25 / 400), 1)[0]
    assert slope_up == pytest.approx(-1.0, abs=0.25)
    assert slope_down == pytest.approx(-1.0, abs=0.35)
    assert np.ptp(middle) < 0.35 * up[0]


def test_expectations_are_those_of_the_plain_estimates() -> None:
    """Taking the expectation over which draw a reading came from leaves the means as they are."""
    law = Linear(5, 0.5)
    rng = np.random.default_rng(6)
    away = []
    for _ in range(300):
        table = law.table(rng, 60, 30, 2)
        bare = PairTable(table.own, table.inner)
        inner = np.logaddexp.reduce(bare.inner, axis=1)
        nested = (bare.own - (inner - np.log(30))).mean()
        contrastive = (bare.own - (np.logaddexp(inner, bare.own) - np.log(31))).mean()
        gain, _ = expected_gain(bare)
        away.append((gain.high - nested, gain.low - contrastive))
    mean, error = np.mean(away, axis=0), np.std(away, axis=0, ddof=1) / np.sqrt(300)
    assert np.all(np.abs(mean) < 3.5 * error)
    plain = np.std([(t.own - np.logaddexp.reduce(t.inner, axis=1)).mean()
                    for t in (law.table(rng, 200, 200, 2) for _ in range(100))])  # fmt: skip
    ours = np.std([expected_gain(PairTable(t.own, t.inner))[0].eig
                   for t in (law.table(rng, 200, 200, 2) for _ in range(100))])  # fmt: skip
    assert ours < plain


def test_chain_rule_of_two_measurements() -> None:
    """Both together: the gain of the joint table is that of the joint law in closed form."""
    law = Linear(7, 0.5)
    first, second = Linear(7, 0.5), Linear(7, 0.5)
    first.a, second.a = law.a[:1], law.a[1:]
    rng = np.random.default_rng(8)
    x = rng.multivariate_normal(np.zeros(N_ALL), law.covariance, size=4600)
    own, inner = x[:4000], x[4000:]
    tables = []
    for part in (first, second):
        y = own @ part.a.T + np.sqrt(law.noise2) * rng.normal(size=(4000, len(part.a)))
        tables.append(
            PairTable(part.log_density(y, own[:, None])[:, 0], part.log_density(y, inner[None]))
        )
    s, a = law.covariance, law.a
    of_y = np.eye(3) + a @ s @ a.T / law.noise2
    whole = PairTable(tables[0].own + tables[1].own, tables[0].inner + tables[1].inner)
    joint, _ = expected_gain(whole)
    assert abs(joint.eig - 0.5 * np.linalg.slogdet(of_y)[1]) < 4.0 * joint.se
    alone = sum(expected_gain(t)[0].eig for t in tables)
    assert joint.eig < alone


def linear_gain(covariance: np.ndarray, precision: np.ndarray) -> float:
    law = LinearLaw(np.linalg.inv(covariance)[None], np.arange(N_ABOUT))
    return float(law.gain([Told(precision[None])])[0])


def test_the_linear_law_is_the_closed_form() -> None:
    law = Linear(9, 0.8)
    precision = law.a.T @ law.a / law.noise2
    assert linear_gain(law.covariance, precision) == pytest.approx(law.gain, rel=1e-10)


def test_the_linear_law_does_not_depend_on_the_coordinates() -> None:
    """Any invertible map of theta, and of all parameters beside it, leaves the gain as it is."""
    law = Linear(10, 0.8)
    rng = np.random.default_rng(11)
    change = np.zeros((N_ALL, N_ALL))
    change[:N_ABOUT, :N_ABOUT] = rng.normal(size=(N_ABOUT, N_ABOUT))
    change[N_ABOUT:] = rng.normal(size=(N_ALL - N_ABOUT, N_ALL))
    back = np.linalg.inv(change)
    precision = law.a.T @ law.a / law.noise2
    moved = linear_gain(change @ law.covariance @ change.T, back.T @ precision @ back)
    assert moved == pytest.approx(law.gain, rel=1e-8)


def test_the_linear_law_obeys_the_chain_rule() -> None:
    """What two readings tell is what one tells and what the other adds to it."""
    law = Linear(9, 0.8)
    first, second = (Told((a.T @ a / law.noise2)[None]) for a in (law.a[:1], law.a[1:]))
    here = LinearLaw(np.linalg.inv(law.covariance)[None], np.arange(N_ABOUT))
    one_by_one = here.gain([first]) + here.gain([second], [first])
    assert one_by_one[0] == pytest.approx(law.gain, rel=1e-10)


@pytest.mark.parametrize("resampled", [False, True])
def test_entropy_of_correlated_draws(resampled: bool) -> None:
    """A normal law in four dimensions: 1/2 ln det 2 pi e S, from its draws or by resampling."""
    s = Linear(9, 0.8).covariance
    rng = np.random.default_rng(3)
    z = rng.multivariate_normal(np.zeros(N_ALL), (1.5 if resampled else 1.0) * s, size=4000)
    if resampled:
        share = np.exp(-0.5 * (1.0 - 1.0 / 1.5) * np.sum(z * np.linalg.solve(s, z.T).T, axis=1))
        z = z[rng.choice(4000, 4000, p=share / share.sum())]
    found, se = entropy_of_draws(z)
    wanted = 0.5 * np.linalg.slogdet(2.0 * np.pi * np.e * s)[1]
    assert abs(found - wanted) < 3.0 * se + 0.1


def test_expected_standard_deviations() -> None:
    """Root mean square of the standard deviation after, which no linear reading makes depend on y."""
    law = Linear(12, 0.6)
    rng = np.random.default_rng(13)
    x = rng.multivariate_normal(np.zeros(N_ALL), law.covariance, size=5000)
    own, inner = x[:1000], x[1000:]
    y = own @ law.a.T + np.sqrt(law.noise2) * rng.normal(size=(1000, N_READINGS))
    table = PairTable(law.log_density(y, own[:, None])[:, 0], law.log_density(y, inner[None]))
    weights = expected_gain(table)[1]
    ratio, error = expected_spread(weights, own, inner).sd_ratio()
    s, a = law.covariance, law.a
    of_y = a @ s @ a.T + law.noise2 * np.eye(N_READINGS)
    after = np.diag(s - s @ a.T @ np.linalg.solve(of_y, a @ s))
    wanted = np.sqrt(after / np.diag(s))
    assert np.all(np.abs(ratio - wanted) < 0.02 + 4.0 * error)


def test_densities_of_any_size_do_no_harm() -> None:
    own = np.array([-5000.0, 3000.0, -1e5])
    inner = np.array([[-5001.0, -9000.0], [10.0, 0.0], [-1e6, -1e7]])
    gain, _ = expected_gain(PairTable(own, inner))
    assert np.isfinite([gain.eig, gain.low, gain.high, gain.se, gain.ess]).all()
    assert gain.low <= np.log(3.0)

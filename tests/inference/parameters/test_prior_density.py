"""All priors at once: the sum of each alone, and slopes against differences of the density."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pbrdf_bayes.inference.parameters.prior_density import Prior, tabulate
from pbrdf_bayes.inference.parameters.priors import NOISE_PRIORS, PRESETS

FIXED = Prior(kind="fixed", mean=0.25, low=0.0, high=1.0)
PRIORS = [*PRESETS["paint"].values(), *PRESETS["metal"].values(), *NOISE_PRIORS.values(), FIXED]


def draw(rng, n_sets):
    return np.stack([prior.quantile(rng.uniform(0.01, 0.99, n_sets)) for prior in PRIORS], axis=1)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([1, 2, 17]))
def test_the_table_is_the_sum_of_each_prior(seed, n_sets):
    """Each of them is held against SciPy's laws in test_priors."""
    rng = np.random.default_rng(seed)
    x = draw(rng, n_sets)
    out = rng.random(x.shape) < 0.02
    x[out] = rng.choice([-1.0, 0.0, 1e9, np.nan], size=int(out.sum()))
    each = [prior.log_density(v) for prior, v in zip(PRIORS, x.T, strict=True)]
    np.testing.assert_array_equal(tabulate(PRIORS).log_density(x), np.sum(each, axis=0))


def test_slopes_are_those_of_the_density():
    x = draw(np.random.default_rng(1), 50)
    slopes = tabulate(PRIORS).slopes(x)
    for i, prior in enumerate(PRIORS[:-1]):
        step = 1e-6 * np.abs(x[:, i])
        ends = [prior.log_density(x[:, i] + sign * step) for sign in (1.0, -1.0)]
        wanted = (ends[0] - ends[1]) / (2.0 * step)
        np.testing.assert_allclose(slopes[:, i], wanted, rtol=1e-5, atol=1e-5)
    assert not slopes[:, -1].any()


def test_there_is_no_slope_outside_the_support():
    x = np.full((1, len(PRIORS)), -1.0)
    assert not tabulate(PRIORS).slopes(x).any()

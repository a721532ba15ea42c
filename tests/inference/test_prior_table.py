"""All priors at once against each prior by itself, bit for bit."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pbrdf_bayes.inference.prior_table import tabulate
from pbrdf_bayes.inference.priors import NOISE_PRIORS, PRESETS, Prior

FIXED = Prior(kind="fixed", mean=0.25, low=0.0, high=1.0)
PRIORS = [*PRESETS["paint"].values(), *PRESETS["metal"].values(), *NOISE_PRIORS.values(), FIXED]


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([1, 2, 17]))
def test_the_table_is_each_prior_by_itself(seed, n_sets):
    rng = np.random.default_rng(seed)
    columns = [prior.quantile(rng.random(n_sets)) for prior in PRIORS]
    x = np.stack(columns, axis=1)
    out = rng.random(x.shape) < 0.02
    x[out] = rng.choice([-1.0, 0.0, 1e9, np.nan], size=int(out.sum()))
    table = tabulate(PRIORS)
    each = [prior.log_density(v) for prior, v in zip(PRIORS, x.T, strict=True)]
    np.testing.assert_array_equal(table.log_density(x), np.sum(each, axis=0))
    slopes = np.stack([p.slope(v) for p, v in zip(PRIORS, x.T, strict=True)], axis=1)
    np.testing.assert_array_equal(table.slopes(x), slopes)

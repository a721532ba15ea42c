"""What a design promises against what measuring and fitting again gives, on a small scale."""

from __future__ import annotations

import numpy as np
import pytest

from tools.validation.design_loop import CANDIDATES, compare

pytestmark = pytest.mark.slow


def test_promised_information_is_realised() -> None:
    """A new scan and the repeat of one, ten simulated paints drawn from the posterior for each."""
    rows = compare("published", n=10, seed=4, candidates=CANDIDATES[2:4])
    for row in rows:
        error = np.hypot(row["realised_se"], row["se"]) + 0.25 * (row["high"] - row["low"])
        assert abs(row["realised"] - row["eig"]) < 3.5 * error, row
        assert row["realised"] > 4.0 * row["realised_se"], row
    new, repeat = rows
    assert new["eig"] > repeat["eig"]

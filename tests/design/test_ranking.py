"""Which candidate is best, and which are not told apart from it: chances, ties and front."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import studentized_range
from scipy.stats import t as student

from pbrdf_bayes.design.ranking import Ranking, rank


def ranked(terms: np.ndarray, **other: np.ndarray) -> Ranking:
    return rank(terms, np.ones(len(terms)), per_minute=False, seed=1, **other)


def test_chances_are_those_of_the_paired_difference() -> None:
    """By its t law; one that is 15 standard errors behind is told apart."""
    away = np.random.default_rng(4).standard_normal((3, 9))
    away -= away.mean(axis=1, keepdims=True)
    terms = np.array([5.0 + 0.0 * away[0], 5.0 - 0.3 + away[1], 5.0 - 5.0 + away[2]])
    found = ranked(terms)
    se = terms[1].std(ddof=1) / 3.0
    assert found.p_best[1] == pytest.approx(student.sf(0.3 / se, 8), abs=0.02)
    assert found.p_best.sum() == pytest.approx(1.0)
    assert found.tied.tolist() == [True, True, False]


def test_candidates_that_are_equal_are_all_not_told_apart() -> None:
    """24 of one mean, with readings of their own: in 95 % of the cases, here 120."""
    rng = np.random.default_rng(7)
    held = [ranked(rng.standard_normal((24, 100))).tied.all() for _ in range(120)]
    assert 0.88 < np.mean(held) <= 1.0
    assert ranked(np.repeat(rng.standard_normal((1, 100)), 24, axis=0)).tied.all()


@pytest.mark.parametrize("n", [2, 24])
def test_the_limit_is_that_of_the_studentised_range(n: int) -> None:
    """Independent means of equal errors: the largest of the differences that equal ones show."""
    rng = np.random.default_rng(8)
    away = rng.standard_normal((n, 400))
    away -= away.mean(axis=1, keepdims=True)
    away = np.linalg.qr(away.T)[0].T * 20.0  # errors of 0.05, no correlation
    limit = studentized_range.ppf(0.95, n, 399) * 0.05
    for behind, tied in ((0.9 * limit, True), (1.1 * limit, False)):
        mean = np.full(n, -behind / 2.0)
        mean[:2] = 0.0, -behind
        assert ranked(away + mean[:, None]).tied[1] == tied, behind


def test_a_common_error_tells_nothing_of_the_order() -> None:
    """Paired: 0.1 behind is told apart where the readings move both alike, whatever their error."""
    rng = np.random.default_rng(9)
    both = rng.standard_normal(100)
    terms = np.array([both + 0.1, both + 0.01 * rng.standard_normal(100)])
    assert ranked(terms).tied.tolist() == [True, False]


def test_what_may_be_nothing_is_not_on_the_front() -> None:
    """1.6 standard errors above 0: cheap, and no gain for it."""
    minutes = np.array([1.0, 10.0, 20.0])
    wave = np.tile([1.0, -1.0], 50)
    terms = np.array([0.0068 + 0.0428 * wave, 0.5 + 0.1 * wave, 0.4 + 0.1 * wave])
    found = rank(terms, minutes, per_minute=False, seed=1)
    assert found.pareto.tolist() == [False, True, False]
    sure = rank(terms, minutes, per_minute=False, seed=1, se=np.array([0.002, 0.01, 0.01]))
    assert sure.pareto.tolist() == [True, True, False]


def test_candidates_with_wide_brackets_are_ranked_by_their_overlap() -> None:
    """Bounds 5 to 30 and 4 to 9 overlap, 1 to 1.1 lies below both."""
    terms = np.array([[4.9, 5.1, 5.0], [3.9, 4.1, 4.0], [0.9, 1.1, 1.0]])
    reach = np.array([[0.0, 25.0], [0.0, 5.0], [0.0, 0.0]])
    minutes = np.array([10.0, 10.0, 1.0])
    known = rank(terms, minutes, per_minute=False, seed=1)
    assert known.p_best.tolist() == [1.0, 0.0, 0.0]
    found = rank(terms, minutes, per_minute=False, seed=1, reach=reach)
    assert found.tied.tolist() == [True, True, False]
    assert found.p_best.tolist() == [0.5, 0.5, 0.0]
    assert found.n_readings == 3
    apart = rank(terms, minutes, per_minute=False, seed=1, reach=0.02 * reach)
    assert apart.tied.tolist() == [True, False, False]
    assert apart.p_best.tolist() == [1.0, 0.0, 0.0]

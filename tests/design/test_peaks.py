"""The place where an adaptation starts, against normal laws and laws with an edge."""

from __future__ import annotations

import numpy as np

from pbrdf_bayes.design.peaks import peak_of


def test_a_narrow_normal_law_far_away() -> None:
    """Correlated, 1e-4 to 1e-1 of the scales, from 3 standard deviations of these away."""
    rng = np.random.default_rng(1)
    root = np.tril(rng.normal(size=(4, 4))) * [1e-4, 1e-3, 1e-2, 1e-1]
    covariance = root @ root.T
    inverse = np.linalg.inv(covariance)

    def normal(z: np.ndarray) -> np.ndarray:
        return -0.5 * np.einsum("ni,ij,nj->n", z - 0.5, inverse, z - 0.5)

    found = peak_of(normal, np.full(4, 3.5), np.ones(4))
    assert found is not None
    centre, wide, spent = found
    away = np.linalg.solve(np.linalg.cholesky(covariance), centre - 0.5)
    assert np.abs(away).max() < 0.5
    ratio = np.linalg.eigvals(wide @ inverse).real
    assert ratio.min() > 0.2
    assert ratio.max() < 5.0
    assert spent < 10_000


def test_beyond_an_edge_there_is_nothing() -> None:
    def half(z: np.ndarray) -> np.ndarray:
        return np.where(z[:, 0] >= 0.0, -0.5 * np.sum((z / 0.1) ** 2, axis=1), -np.inf)

    found = peak_of(half, np.ones(2), np.ones(2))
    assert found is not None
    centre, wide, _ = found
    assert np.all(np.abs(centre) < 0.05)
    assert np.all(np.linalg.eigvalsh(wide) > 0.0)


def test_an_unknown_direction_is_no_wider_than_before() -> None:
    found = peak_of(lambda z: -0.5 * (z[:, 0] / 0.01) ** 2, np.ones(2), np.array([1.0, 3.0]))
    assert found is not None
    assert np.sqrt(found[1][1, 1]) <= 3.0 + 1e-9

"""The block factorisation against a dense solve, over graphs of every kind."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from planfit.lsq.normal_equations import BlockPattern


def system(rng, n, pairs):
    """A positive definite matrix with blocks at `pairs` and on the diagonal: pattern, blocks, dense."""
    pairs = np.sort(np.asarray(pairs, dtype=int).reshape(-1, 2), axis=1)
    poses = np.arange(n)
    pattern = BlockPattern(np.append(poses, pairs[:, 0]), np.append(poses, pairs[:, 1]), n)
    blocks = rng.normal(size=(n + len(pairs), 6, 6))
    degree = np.bincount(pairs.ravel(), minlength=n)
    blocks[:n] = blocks[:n] @ np.swapaxes(blocks[:n], 1, 2)
    blocks[:n] += (12.0 * (degree + 1))[:, None, None] * np.eye(6)
    upper = pattern.sum_blocks(blocks)
    for k in pattern.diagonal:  # a pair of a pose with itself made these lopsided
        upper[k] = 0.5 * (upper[k] + upper[k].T)
    return pattern, upper, pattern.symmetric(upper).toarray()


def check(rng, n, pairs):
    pattern, upper, dense = system(rng, n, pairs)
    added, right = rng.uniform(0, 2, 6 * n), rng.normal(size=(6 * n, 7))
    expected = np.linalg.solve(dense + np.diag(added), right)
    factor = pattern.any_cholesky.factorise(upper, added)
    for found in (
        factor.solve(right),
        np.hstack([factor.solve(right[:, k : k + 1]) for k in range(7)]),
    ):
        assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max() + 1e-14)


@pytest.mark.parametrize("n", [1, 2, 7, 40])
@pytest.mark.parametrize("kind", ["none", "path", "star", "ring", "full", "scattered"])
def test_solves_as_a_dense_solve_does(n, kind, rng):
    i, j = np.triu_indices(n, 1)
    pairs = {
        "none": np.zeros((0, 2)),
        "path": np.column_stack([np.arange(n - 1), np.arange(1, n)]),
        "star": np.column_stack([np.zeros(n - 1), np.arange(1, n)]),
        "ring": np.column_stack([np.arange(n), (np.arange(n) + 1) % n]),
        "full": np.column_stack([i, j]),
        "scattered": rng.integers(n, size=(2 * n, 2)),
    }[kind]
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    check(rng, n, pairs)


@settings(max_examples=60, deadline=None)
@given(st.integers(2, 25), st.integers(0, 60), st.integers(0, 2**32 - 1))
def test_solves_any_graph(n, n_pairs, seed):
    rng = np.random.default_rng(seed)
    pairs = rng.integers(n, size=(n_pairs, 2))
    check(rng, n, pairs[pairs[:, 0] != pairs[:, 1]])


def test_solves_fronts_of_several_panels_and_tiles(rng):
    ahead = [(i, i + k) for k in (1, 2, 15, 16) for i in range(150 - k)]
    check(rng, 150, np.array(ahead))


def test_the_matrix_is_not_changed_and_solves_repeat(rng):
    pattern, upper, _ = system(rng, 9, [(0, 5), (5, 8), (2, 3)])
    kept = upper.copy()
    right = rng.normal(size=(54, 3))
    kept_right = right.copy()
    factor = pattern.any_cholesky.factorise(upper, np.zeros(54))
    first = factor.solve(right)
    assert np.array_equal(upper, kept)
    assert np.array_equal(right, kept_right)
    assert np.array_equal(factor.solve(right), first)
    assert np.array_equal(pattern.any_cholesky.factorise(upper, np.zeros(54)).solve(right), first)


def test_an_indefinite_matrix_is_refused(rng):
    pattern, upper, _ = system(rng, 5, [(0, 1), (1, 4)])
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        pattern.any_cholesky.factorise(upper, np.full(30, -1e4))

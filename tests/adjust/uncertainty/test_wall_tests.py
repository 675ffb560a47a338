"""Walls tested by all other evidence: beside offsets that were put in, and beside a slow obvious solve."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planfit.adjust.moved_walls import MOVED_SIGMA_M
from planfit.adjust.uncertainty import model_errors
from planfit.adjust.uncertainty.wall_tests import run_wall_tests
from ring_of_cameras import N, noisy_problem


def walls_tested(problem):
    model = model_errors(problem, np.arange(N) // 6, np.ones(N), np.random.default_rng(0))
    return model, run_wall_tests(model, problem.correspondences.floorplan)


@pytest.mark.parametrize("drawn_m", [0.0, 0.01, 0.03])
def test_walls_as_drawn_are_not_called_moved_and_sigmas_are_right(drawn_m):
    squares, odds = [], []
    for seed in range(6):
        rng = np.random.default_rng([2, seed])
        for test in walls_tested(noisy_problem(rng, drawn_m)[1])[1]:
            # The offset is told together with what is usual: that is taken back.
            seen = test.offsets_m[0] * (1 + (test.sigma_m / MOVED_SIGMA_M) ** 2)
            squares.append((seen / test.sigma_m) ** 2)
            odds.append(test.odds)
    assert max(odds) < 10
    # Few walls tell how walls are drawn: the largest departures are wide of a normal distribution.
    assert 0.1 < np.mean(squares) < 2.0


def test_offset_and_poses_are_those_of_a_solve_with_the_offset_among_the_unknowns(rng):
    _, problem = noisy_problem(rng, 0.01, moved_m=[(3, 0.1)])
    model, found = walls_tested(problem)
    bundles = model.bundles["walls"]
    jacobian, weights = bundles.jacobian.toarray(), bundles.weights
    equations = np.linalg.inv(model.factors.inverse(np.arange(6 * len(problem.unknowns))))
    for test in found:
        own = np.isin(bundles.labels[bundles.cluster], test.faces).astype(float)
        n = len(equations)
        augmented = np.zeros((n + 1, n + 1))
        augmented[:n, :n] = equations
        augmented[:n, n] = augmented[n, :n] = -jacobian.T @ (weights * own)
        augmented[n, n] = weights @ own
        right = np.zeros(n + 1)
        right[n] = (weights * own) @ bundles.residuals[:, 0]
        solved = np.linalg.solve(augmented, right)
        shrunk = 1 + (test.sigma_m / MOVED_SIGMA_M) ** 2
        assert_allclose(test.offsets_m[0] * shrunk, solved[n], atol=1e-6)
        assert_allclose(test.change.ravel() * shrunk, solved[:n], atol=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_a_wall_that_alone_holds_a_direction_is_not_tested_by_rounding(seed):
    """All goes along with it: what is left of its weight is no evidence, though it may be no exact zero."""
    _, problem = noisy_problem(np.random.default_rng(seed), 0.0, held_by=(0, 4))
    for test in walls_tested(problem)[1]:
        assert abs(test.offsets_m[0]) < MOVED_SIGMA_M
        assert np.abs(test.change[:, 3:]).max() < MOVED_SIGMA_M

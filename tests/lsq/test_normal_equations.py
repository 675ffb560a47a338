"""Blocks into one sparse matrix, and its damped solution against a dense one."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import make_world, nudged
from planfit.lsq.blocks import NormalBlocks
from planfit.lsq.normal_equations import NormalEquations


def test_blocks_off_the_diagonal_stand_for_their_transpose(rng):
    block = rng.normal(size=(1, 6, 6))
    parts = [NormalBlocks(np.array([0]), np.array([2]), block, np.zeros((3, 6)))]
    matrix = NormalEquations(parts, 3).matrix.toarray()
    assert_array_equal(matrix[:6, 12:], block[0])
    assert_array_equal(matrix[12:, :6], block[0].T)


def test_parts_add_up(rng):
    blocks = rng.normal(size=(2, 6, 6))
    one = NormalBlocks(np.array([1]), np.array([1]), blocks[:1], np.ones((2, 6)))
    two = NormalBlocks(np.array([1]), np.array([1]), blocks[1:], np.full((2, 6), 2.0))
    equations = NormalEquations([one, two], 2)
    assert_allclose(equations.matrix.toarray()[6:, 6:], blocks.sum(axis=0))
    assert_array_equal(equations.gradient, 3.0)


@pytest.mark.parametrize("solver", ["auto", "direct", "cg"])
@pytest.mark.parametrize("damping", [0.0, 1e-6, 1e-2, 1.0, 1e3])
def test_sparse_step_equals_the_dense_solve(rng, damping, solver):
    world = make_world(rng)
    poses = nudged(rng, world.plan_from_cams, 2.0, 0.1)
    quadratics = [t.reweight(poses)[0] for t in world.scan_terms]
    equations = NormalEquations([q.normal_blocks(poses) for q in quadratics], len(poses))
    dense = equations.matrix.toarray()
    assert_allclose(dense, dense.T, atol=1e-9 * np.abs(dense).max())
    assert np.linalg.eigvalsh(dense).min() > -1e-9 * np.abs(dense).max()
    floor = 1e-9 * np.diag(dense).max()
    damped = dense + np.diag(damping * np.maximum(np.diag(dense), floor) + floor)
    expected = np.linalg.solve(damped, -equations.gradient.ravel()).reshape(-1, 6)
    scale = np.abs(expected).max()
    assert_allclose(equations.step(damping, solver), expected, atol=1e-5 * scale)


def test_predicted_decrease_is_that_of_the_linear_model(rng):
    jacobian, residual = rng.normal(size=(30, 12)), rng.normal(size=30)
    hessian = jacobian.T @ jacobian
    blocks = np.stack([hessian[:6, :6], hessian[:6, 6:], hessian[6:, 6:]])
    gradient = (jacobian.T @ residual).reshape(2, 6)
    part = NormalBlocks(np.array([0, 0, 1]), np.array([0, 1, 1]), blocks, gradient)
    delta = rng.normal(size=(2, 6))
    after = residual + jacobian @ delta.ravel()
    expected = 0.5 * (residual @ residual - after @ after)
    assert_allclose(NormalEquations([part], 2).predicted_decrease(delta), expected)


def test_a_pose_that_nothing_measures_stays():
    part = NormalBlocks(np.array([0]), np.array([0]), np.eye(6)[None], np.eye(12)[0].reshape(2, 6))
    step = NormalEquations([part], 2).step(1e-4)
    assert step[0, 0] < -0.9
    assert_array_equal(step[1], 0.0)


def test_nothing_measured_at_all_is_no_step():
    part = NormalBlocks(np.array([0]), np.array([0]), np.zeros((1, 6, 6)), np.zeros((1, 6)))
    assert_array_equal(NormalEquations([part], 1).step(1e-4), 0.0)


def chain_with_loops(rng, n, loops):
    """Normal equations of a chain of poses, each tied to the next three, and some loops."""
    rows = np.concatenate([np.arange(n - k) for k in (1, 2, 3)] + [loops[:, 0]])
    columns = np.concatenate([np.arange(k, n) for k in (1, 2, 3)] + [loops[:, 1]])
    first, second = rng.normal(size=(2, len(rows), 6, 6))
    poses = np.arange(n)
    blocks = [np.tile(1e-3 * np.eye(6), (n, 1, 1))]
    places = [(poses, poses)]
    for a, b, i, j in ((first, first, rows, rows), (second, second, columns, columns),
                       (first, second, rows, columns)):  # fmt: skip
        blocks.append(np.swapaxes(a, 1, 2) @ b)
        places.append((i, j))
    return NormalBlocks(
        np.concatenate([p[0] for p in places]),
        np.concatenate([p[1] for p in places]),
        np.concatenate(blocks),
        rng.normal(size=(n, 6)),
    )


@pytest.mark.parametrize("damping", [1e-8, 1e-2])
def test_conjugate_gradients_agree_with_the_factorisation(rng, damping):
    loops = np.sort(rng.choice(80, size=(15, 2)), axis=1)
    loops = loops[loops[:, 0] != loops[:, 1]]
    part = chain_with_loops(rng, 80, loops)
    direct = NormalEquations([part], 80).step(damping, "direct")
    iterated = NormalEquations([part], 80).step(damping, "cg")
    assert_allclose(iterated, direct, atol=1e-4 * np.abs(direct).max())


def test_band_is_the_whole_matrix_where_there_are_no_loops(rng):
    part = chain_with_loops(rng, 30, np.zeros((0, 2), dtype=int))
    equations = NormalEquations([part], 30)
    dense = equations.matrix.toarray()
    band = equations.pattern.banded(equations._upper)
    rebuilt = np.zeros_like(dense)
    for below in range(len(band)):
        for column in range(len(dense) - below):
            rebuilt[column + below, column] = band[below, column]
    assert_allclose(np.tril(rebuilt), np.tril(dense))


def test_pattern_is_used_again_only_where_it_fits(rng):
    part = chain_with_loops(rng, 20, np.array([[0, 15]]))
    first = NormalEquations([part], 20)
    assert NormalEquations([part], 20, first.pattern).pattern is first.pattern
    other = chain_with_loops(rng, 20, np.array([[1, 15]]))
    again = NormalEquations([other], 20, first.pattern)
    assert again.pattern is not first.pattern
    assert_allclose(again.matrix.toarray(), NormalEquations([other], 20).matrix.toarray())


def test_the_square_of_a_step_is_that_with_the_whole_matrix(rng):
    loops = np.array([[0, 9], [2, 11]])
    equations = NormalEquations([chain_with_loops(rng, 12, loops)], 12)
    delta = rng.normal(size=(12, 6))
    expected = delta.ravel() @ equations.matrix @ delta.ravel()
    assert_allclose(equations.pattern.square(equations._upper, delta), expected, rtol=1e-12)

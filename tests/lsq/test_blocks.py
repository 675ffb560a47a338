"""What residuals say of the poses that they name, as blocks by pose."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import jacobian_by_differences, nudged
from facing import facing_poses
from planfit.geometry import se3
from planfit.lsq.blocks import blocks_of_relative_poses, relative_poses, sum_by_pose
from planfit.lsq.normal_equations import NormalEquations


@pytest.fixture
def poses():
    return facing_poses()


def test_sum_by_pose_is_add_at(rng):
    idx, values = rng.integers(5, size=30), rng.normal(size=(30, 2, 3))
    expected = np.zeros((6, 2, 3))
    np.add.at(expected, idx, values)
    assert_allclose(sum_by_pose(idx, values, 6), expected)


def test_sum_by_pose_of_nothing_is_zero():
    assert_array_equal(sum_by_pose(np.zeros(0, dtype=int), np.zeros((0, 6, 6)), 3), 0.0)


def test_blocks_of_relative_poses_are_those_of_the_relative_pose(poses, rng):
    # Residuals: any linear function of the relative pose's change.
    at = nudged(rng, poses, 20.0, 1.0)
    pairs = np.array([[0, 1], [4, 2], [1, 5]])
    rows, offset = rng.normal(size=(3, 7, 6)), rng.normal(size=(3, 7))
    here = relative_poses(at, pairs)

    def residuals(other):
        change = se3.difference(relative_poses(other, pairs), here)
        return np.einsum("kra,ka->kr", rows, change) + offset

    rows_t = np.swapaxes(rows, 1, 2)
    gradients = np.einsum("kra,kr->ka", rows, offset)
    blocks = blocks_of_relative_poses(pairs, rows_t @ rows, gradients, at)
    jacobian = jacobian_by_differences(residuals, at)
    dense = NormalEquations([blocks], len(at)).matrix.toarray()
    assert_allclose(dense, jacobian.T @ jacobian, atol=1e-6 * dense.max())
    assert_allclose(blocks.gradient.ravel(), jacobian.T @ offset.ravel(), atol=1e-6 * dense.max())

"""Rigid transforms: group laws, charts near zero and near pi, projection, fits."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from builders import random_transforms
from planfit.geometry import se3

fixed = settings(max_examples=60, deadline=None, derandomize=True)


def vectors(size, n=3):
    return arrays(float, n, elements=st.floats(-size, size, allow_subnormal=False))


@st.composite
def rotation_vectors(draw):
    """Directions with angles from tiny to just below pi."""
    axis = draw(vectors(1.0).filter(lambda v: np.linalg.norm(v) > 1e-3))
    angle = draw(
        st.sampled_from([0.0, 1e-12, 1e-8, 9.9e-5, 1.01e-4, 1e-3, np.pi - 1e-3, np.pi - 1e-7])
        | st.floats(0, 3.1)
    )
    return axis / np.linalg.norm(axis) * angle


@st.composite
def transforms(draw):
    return se3.make_transform(se3.exp_so3(draw(rotation_vectors())), draw(vectors(100.0)))


@st.composite
def tangents(draw):
    return np.concatenate([draw(rotation_vectors()), draw(vectors(10.0))])


@fixed
@given(transforms(), transforms(), transforms())
def test_products_are_associative_and_rigid(a, b, c):
    assert_allclose((a @ b) @ c, a @ (b @ c), atol=1e-10)
    rotation = (a @ b)[:3, :3]
    assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


@fixed
@given(transforms())
def test_inverse_undoes(a):
    assert_allclose(a @ se3.inverse(a), np.eye(4), atol=1e-11)
    assert_allclose(se3.inverse(a) @ a, np.eye(4), atol=1e-11)
    assert_allclose(se3.inverse(se3.inverse(a)), a, atol=1e-11)


@fixed
@given(transforms(), transforms(), vectors(50.0))
def test_transforms_act_one_after_the_other(a, b, point):
    together = se3.transform(a @ b, point[None])
    assert_allclose(together, se3.transform(a, se3.transform(b, point[None])), atol=1e-10)
    assert_allclose(together[0], (a @ b @ [*point, 1.0])[:3], atol=1e-10)


@fixed
@given(rotation_vectors())
def test_exp_is_scipys(vector):
    assert_allclose(se3.exp_so3(vector), Rotation.from_rotvec(vector).as_matrix(), atol=1e-14)


@fixed
@given(rotation_vectors())
def test_log_undoes_exp(vector):
    # Near pi the matrix holds the axis to half the digits only.
    assert_allclose(se3.log_so3(se3.exp_so3(vector)), vector, atol=1e-7)
    assert se3.rotation_angle(se3.exp_so3(vector)) == pytest.approx(
        np.linalg.norm(vector), abs=1e-7
    )


@pytest.mark.parametrize("axis", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0.0, 0.8]])
def test_half_a_turn(axis):
    half = se3.exp_so3(np.pi * np.array(axis))
    found = se3.log_so3(half)
    assert np.linalg.norm(found) == pytest.approx(np.pi)
    assert_allclose(np.abs(found / np.pi), np.abs(axis), atol=1e-7)


@pytest.mark.parametrize("angle", [0, 1e-12, 1e-8, 9e-4, 1.1e-3, 1, 3, np.pi - 1e-4, np.pi - 1e-7])
@pytest.mark.parametrize("off", [0, 1e-13, 1e-9, 1e-3])
def test_log_is_scipys(rng, angle, off):
    # Rotations to rounding, and matrices for which the nearest ones stand.
    axes = rng.normal(size=(5, 40, 3))
    matrices = se3.exp_so3(angle * axes / np.linalg.norm(axes, axis=-1, keepdims=True))
    matrices += off * rng.normal(size=matrices.shape)
    expected = Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_rotvec()
    assert_allclose(se3.log_so3(matrices).reshape(-1, 3), expected, rtol=1e-14, atol=1e-18)
    assert_allclose(se3.log_so3(matrices[0, 0]), expected[0], rtol=1e-14, atol=1e-18)


def test_log_takes_any_layout_of_memory(rng):
    poses = random_transforms(rng, 6)
    back = np.swapaxes(poses[:, :3, :3], 1, 2)
    assert_array_equal(se3.log_so3(back), se3.log_so3(back.copy()))
    fixed_poses = poses[:, :3, :3].copy()
    fixed_poses.flags.writeable = False
    assert_array_equal(se3.log_so3(fixed_poses), se3.log_so3(poses[:, :3, :3]))


@pytest.mark.parametrize("matrix", [-np.eye(3), np.diag([1.0, 1, -1]), np.zeros((3, 3))])
def test_log_refuses_what_is_no_rotation(matrix):
    with pytest.raises(ValueError, match="left-handed or a flat"):
        se3.log_so3(np.stack([np.eye(3), matrix]))


def test_log_of_what_is_no_number_is_an_error():
    with np.errstate(invalid="ignore"), pytest.raises(np.linalg.LinAlgError):
        se3.log_so3(np.full((2, 3, 3), np.nan))


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-12, 9.999e-5, 1.0001e-4, 1e-3])
def test_exp_near_zero_is_its_series(size):
    vector = size * np.array([0.6, -0.8, 0.0])
    k = se3.skew(vector)
    series = np.eye(3) + k + k @ k / 2 + k @ k @ k / 6
    assert_allclose(se3.exp_so3(vector), series, atol=1e-13)


def test_exp_is_smooth_across_the_switch_of_formulas():
    angles = np.linspace(0.9e-4, 1.1e-4, 41)
    rotations = se3.exp_so3(angles[:, None] * [0.0, 0.0, 1.0])
    assert_allclose(rotations[:, 1, 0], np.sin(angles), rtol=1e-14)
    assert_allclose(rotations[:, 0, 0], np.cos(angles), rtol=1e-15)


@fixed
@given(transforms(), tangents())
def test_difference_undoes_retract(pose, delta):
    moved = se3.retract(pose, delta)
    assert_allclose(se3.difference(moved, pose), delta, atol=2e-7)
    assert_allclose(se3.retract(pose, se3.difference(moved, pose)), moved, atol=1e-7)


@fixed
@given(transforms())
def test_no_step_is_no_motion(pose):
    assert_allclose(se3.retract(pose, np.zeros(6)), pose, atol=1e-15)
    assert_allclose(se3.difference(pose, pose), 0.0, atol=1e-7)


def test_retract_rotates_about_the_camera_in_the_targets_axes(rng):
    pose = random_transforms(rng, 1)[0]
    delta = np.array([0.0, 0.0, 0.3, 1.0, 2.0, 3.0])
    moved = se3.retract(pose, delta)
    assert_allclose(moved[:3, 3], pose[:3, 3] + [1, 2, 3])
    assert_allclose(moved[:3, :3], se3.yaw_transform(0.3)[:3, :3] @ pose[:3, :3])


def test_points_move_to_first_order_as_the_page_says(rng):
    pose, point = random_transforms(rng, 1)[0], rng.normal(size=3)
    delta = rng.normal(size=6) * 1e-6
    moved = se3.transform(se3.retract(pose, delta), point[None])[0]
    at = se3.transform(pose, point[None])[0]
    expected = np.cross(delta[:3], pose[:3, :3] @ point) + delta[3:]
    assert_allclose(moved - at, expected, atol=1e-11)


@fixed
@given(rotation_vectors(), arrays(float, (3, 3), elements=st.floats(-0.2, 0.2)))
def test_projection_is_the_nearest_rotation(vector, noise):
    noisy = se3.exp_so3(vector) + noise
    rotation = se3.project_to_so3(noisy)
    assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    assert_allclose(se3.project_to_so3(rotation), rotation, atol=1e-12)
    for axis in np.concatenate([np.eye(3), -np.eye(3)]):
        other = se3.exp_so3(1e-3 * axis) @ rotation
        assert np.linalg.norm(other - noisy) >= np.linalg.norm(rotation - noisy) - 1e-9


def test_projection_of_a_mirror_is_a_rotation(rng):
    mirrors = np.diag([1.0, 1.0, -1.0]) @ random_transforms(rng, 7)[:, :3, :3]
    assert_allclose(np.linalg.det(se3.project_to_so3(mirrors)), 1.0)


@fixed
@given(rotation_vectors(), vectors(1.0).filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_rotation_between_takes_one_to_the_other_by_the_smallest_rotation(vector, a):
    b = 3.0 * se3.exp_so3(vector) @ a
    rotation = se3.rotation_between(a, b)
    unit_a, unit_b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    assert_allclose(rotation @ unit_a, unit_b, atol=1e-7)
    angle = np.arctan2(np.linalg.norm(np.cross(unit_a, unit_b)), unit_a @ unit_b)
    assert se3.rotation_angle(rotation) == pytest.approx(angle, abs=1e-7)
    assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("off", [0.0, 1e-14, 1e-12, 1e-11, 1e-10, 1e-9, 1e-6])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("a", [[0, 0, 1.0], [1.0, 0, 0], [0.48, 0.6, 0.64]])
def test_rotation_between_directions_almost_alike_or_opposite(a, off, sign):
    a = np.array(a)
    b = sign * a + off * np.array([0.3, -0.7, 0.2])
    rotation = se3.rotation_between(a, b)
    assert_allclose(rotation @ a, b / np.linalg.norm(b), atol=3e-8)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)


def test_yaw_is_about_z_and_then_translates():
    moved = se3.transform(se3.yaw_transform(np.pi / 2, np.array([10.0, 0, 1])), np.eye(3))
    assert_allclose(moved, [[10, 1, 1], [9, 0, 1], [10, 0, 2]], atol=1e-12)
    assert_array_equal(se3.yaw_transform(0.0), np.eye(4))


def test_skew_is_the_cross_product(rng):
    a, b = rng.normal(size=(2, 5, 3))
    assert_allclose(np.einsum("nij,nj->ni", se3.skew(a), b), np.cross(a, b))


def test_leading_axes_broadcast(rng):
    poses = random_transforms(rng, 6)
    grid = poses.reshape(2, 3, 4, 4)
    assert_allclose(se3.inverse(grid).reshape(6, 4, 4), se3.inverse(poses))
    assert_allclose(se3.log_so3(grid[..., :3, :3]).reshape(6, 3), se3.log_so3(poses[:, :3, :3]))
    points = rng.normal(size=(7, 3))
    assert se3.transform(grid, points).shape == (2, 3, 7, 3)
    assert_allclose(se3.transform(grid, points)[1, 2], se3.transform(poses[5], points))
    assert se3.make_transform(np.eye(3), np.zeros((5, 3))).shape == (5, 4, 4)


def test_no_transforms_at_all():
    none = np.zeros((0, 4, 4))
    assert se3.inverse(none).shape == (0, 4, 4)
    assert se3.log_so3(none[:, :3, :3]).shape == (0, 3)
    assert se3.retract(none, np.zeros((0, 6))).shape == (0, 4, 4)
    assert se3.project_to_so3(none[:, :3, :3]).shape == (0, 3, 3)


def test_fit_rigid_finds_the_motion(rng):
    truth, source = random_transforms(rng, 1)[0], rng.normal(size=(10, 3))
    assert_allclose(se3.fit_rigid(source, se3.transform(truth, source)), truth, atol=1e-12)


def test_fit_rigid_is_the_least_squares_one(rng):
    source, target = rng.normal(size=(2, 30, 3))
    weights = rng.uniform(0, 2, 30)
    best = se3.fit_rigid(source, target, weights)

    def cost(pose):
        return np.sum(weights * np.sum((se3.transform(pose, source) - target) ** 2, axis=1))

    for delta in np.concatenate([np.eye(6), -np.eye(6)]) * 1e-4:
        assert cost(se3.retract(best, delta)) > cost(best)


def test_fit_rigid_never_mirrors(rng):
    source = rng.normal(size=(20, 3))
    found = se3.fit_rigid(source, source * [1.0, 1.0, -1.0])
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1.0)


def test_weights_of_zero_leave_pairs_out(rng):
    truth, source = random_transforms(rng, 1)[0], rng.normal(size=(10, 3))
    target = se3.transform(truth, source)
    target[:4] += 5.0
    weights = np.r_[np.zeros(4), np.ones(6)]
    assert_allclose(se3.fit_rigid(source, target, weights), truth, atol=1e-12)


def test_each_point_has_its_own_transform(rng):
    poses, points = random_transforms(rng, 5), rng.normal(size=(5, 3))
    expected = [
        se3.transform(pose, point[None])[0] for pose, point in zip(poses, points, strict=True)
    ]
    assert_allclose(se3.transform_each(poses, points), expected, atol=1e-12)


def test_yaw_is_read_back_whatever_the_translation(rng):
    yaw = rng.uniform(-np.pi, np.pi, 20)
    transforms = np.array([se3.yaw_transform(a, rng.normal(size=3)) for a in yaw])
    assert_allclose(se3.yaw_of(transforms), yaw, atol=1e-12)
    assert se3.yaw_of(transforms[0]) == pytest.approx(yaw[0])
    assert_allclose(se3.wrap_angle(yaw + 4 * np.pi), yaw, atol=1e-12)


def test_points_are_mapped_by_the_transforms_that_they_name(rng, monkeypatch):
    monkeypatch.setattr(se3, "POINTS_AT_A_TIME", 3)
    transforms, points = random_transforms(rng, 4), rng.normal(size=(8, 3))
    idx = rng.integers(4, size=8)
    expected = np.array(
        [t[:3, :3] @ p + t[:3, 3] for t, p in zip(transforms[idx], points, strict=True)]
    )
    assert_allclose(se3.transform_indexed(transforms, idx, points), expected, atol=1e-12)
    assert se3.transform_indexed(transforms, idx[:0], points[:0]).shape == (0, 3)

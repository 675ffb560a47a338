"""Sums over points against their slow, obvious twins: one residual a point, J by differences."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import gradient_by_differences, jacobian_by_differences, random_transforms
from planfit.lsq.moments import pair_moments, plane_moments
from planfit.lsq.normal_equations import NormalEquations
from planfit.lsq.robust import Loss, LossKind, loss_value
from planfit.runtime import mapped
from planfit.runtime.mapped import is_mapped, map_rows

LOSSES = [Loss(kind, 1.5) for kind in LossKind]


@pytest.fixture
def planes_case(rng):
    """Five groups of points on three of four cameras; one group is empty."""
    start = np.array([0, 7, 7, 20, 21, 40])
    normals = rng.normal(size=(5, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return {
        "points_cam": rng.normal(size=(40, 3)) * 3,
        "start": start,
        "pose_idx": np.array([2, 0, 0, 3, 2]),
        "planes": np.column_stack([normals, rng.normal(size=5)]),
        "weight_per_point": np.array([1.0, 1.0, 0.3, 0.0, 2.0]),
        "target_from_cams": random_transforms(rng, 4),
        "sigma": 0.7,
    }


def plane_distances(case, poses):
    """One signed distance a point, point by point."""
    result = []
    for k in range(len(case["pose_idx"])):
        for m in range(case["start"][k], case["start"][k + 1]):
            pose = poses[case["pose_idx"][k]]
            point = pose[:3, :3] @ case["points_cam"][m] + pose[:3, 3]
            result.append(case["planes"][k, :3] @ point + case["planes"][k, 3])
    return np.array(result)


@pytest.fixture
def pairs_case(rng):
    """Four pairs of four cameras, one the wrong way round."""
    start = np.array([0, 6, 16, 17, 30])
    return {
        "points_a": rng.normal(size=(30, 3)) * 3,
        "points_b": rng.normal(size=(30, 3)) * 3,
        "sigma": rng.uniform(0.5, 2.0, 30),
        "start": start,
        "pairs": np.array([[0, 1], [1, 3], [3, 0], [2, 3]]),
        "weight_per_point": np.array([1.0, 0.2, 3.0, 0.5]),
        "target_from_cams": random_transforms(rng, 4),
    }


def pair_gaps(case, poses):
    """One gap (3,) a match, match by match."""
    result = []
    for k, (i, j) in enumerate(case["pairs"]):
        for m in range(case["start"][k], case["start"][k + 1]):
            a = poses[i, :3, :3] @ case["points_a"][m] + poses[i, :3, 3]
            b = poses[j, :3, :3] @ case["points_b"][m] + poses[j, :3, 3]
            result.append(a - b)
    return np.array(result)


def per_point(case, values):
    return np.repeat(values, np.diff(case["start"]))


def dense(quadratic, poses):
    return NormalEquations([quadratic.normal_blocks(poses)], len(poses)).matrix.toarray()


@pytest.mark.parametrize("loss", LOSSES)
def test_plane_moments_equal_the_sum_over_points(planes_case, loss, rng):
    poses = planes_case["target_from_cams"]
    quadratic, cost = plane_moments(**planes_case, loss=loss)
    s = (plane_distances(planes_case, poses) / planes_case["sigma"]) ** 2
    rho, weight = loss_value(s, loss)
    share = per_point(planes_case, planes_case["weight_per_point"])
    assert_allclose(cost, 0.5 * np.sum(share * rho))
    weight = share * weight / planes_case["sigma"] ** 2
    assert_allclose(quadratic.cost(poses), 0.5 * np.sum(weight * s * planes_case["sigma"] ** 2))
    elsewhere = random_transforms(rng, 4)
    distances = plane_distances(planes_case, elsewhere)
    assert_allclose(quadratic.cost(elsewhere), 0.5 * np.sum(weight * distances**2))

    def residuals(at):
        return np.sqrt(weight) * plane_distances(planes_case, at)

    jacobian = jacobian_by_differences(residuals, elsewhere)
    blocks = quadratic.normal_blocks(elsewhere)
    assert_allclose(dense(quadratic, elsewhere), jacobian.T @ jacobian, atol=1e-5)
    assert_allclose(blocks.gradient.ravel(), jacobian.T @ residuals(elsewhere), atol=1e-5)


@pytest.mark.parametrize("loss", LOSSES)
def test_pair_moments_equal_the_sum_over_matches(pairs_case, loss, rng):
    poses = pairs_case["target_from_cams"]
    quadratic, cost = pair_moments(**pairs_case, loss=loss)
    s = np.sum(pair_gaps(pairs_case, poses) ** 2, axis=1) / pairs_case["sigma"] ** 2
    rho, weight = loss_value(s, loss)
    share = per_point(pairs_case, pairs_case["weight_per_point"])
    assert_allclose(cost, 0.5 * np.sum(share * rho))
    weight = share * weight / pairs_case["sigma"] ** 2
    elsewhere = random_transforms(rng, 4)
    gaps = pair_gaps(pairs_case, elsewhere)
    assert_allclose(quadratic.cost(elsewhere), 0.5 * np.sum(weight * np.sum(gaps**2, axis=1)))

    def residuals(at):
        return (np.sqrt(weight)[:, None] * pair_gaps(pairs_case, at)).ravel()

    jacobian = jacobian_by_differences(residuals, elsewhere)
    blocks = quadratic.normal_blocks(elsewhere)
    assert_allclose(dense(quadratic, elsewhere), jacobian.T @ jacobian, atol=1e-4)
    assert_allclose(blocks.gradient.ravel(), jacobian.T @ residuals(elsewhere), atol=1e-4)
    assert np.all(blocks.rows <= blocks.columns)


def test_gradients_of_the_quadratics_meet_differences_of_their_cost(planes_case, pairs_case):
    loss = Loss(LossKind.CAUCHY, 2.0)
    for quadratic in (
        plane_moments(**planes_case, loss=loss)[0],
        pair_moments(**pairs_case, loss=loss)[0],
    ):
        poses = planes_case["target_from_cams"]
        expected = gradient_by_differences(quadratic.cost, poses)
        assert_allclose(quadratic.normal_blocks(poses).gradient, expected, atol=1e-5, rtol=1e-5)


def test_a_group_without_weight_costs_nothing(planes_case):
    planes_case["weight_per_point"] = np.zeros(5)
    quadratic, cost = plane_moments(**planes_case, loss=Loss())
    assert cost == 0.0
    assert not np.any(quadratic.moments)


def test_small_residuals_survive_far_from_the_origin(pairs_case):
    # A millimetre between points, a kilometre from the origin of the plan.
    poses = pairs_case["target_from_cams"].copy()
    poses[:, :3, 3] += [1000.0, -2000.0, 0.0]
    true = np.linalg.inv(poses[pairs_case["pairs"][:, 1]]) @ poses[pairs_case["pairs"][:, 0]]
    pair = np.repeat(np.arange(4), np.diff(pairs_case["start"]))
    homogeneous = np.column_stack([pairs_case["points_a"], np.ones(30)])
    exact = np.einsum("kab,kb->ka", true[pair], homogeneous)[:, :3]
    pairs_case |= {"points_b": exact + np.array([0.001, 0.0, 0.0]), "sigma": np.ones(30)}
    pairs_case |= {"target_from_cams": poses, "weight_per_point": np.ones(4)}
    quadratic, cost = pair_moments(**pairs_case, loss=Loss(LossKind.SQUARED))
    assert_allclose(cost, 0.5 * 30 * 1e-6, rtol=1e-3)
    assert_allclose(quadratic.cost(poses), 0.5 * 30 * 1e-6, rtol=1e-3)


def test_pairs_either_way_round_and_of_a_frame_with_itself_have_their_blocks(pairs_case, rng):
    """A pair is (1, 3) or (3, 1), two may name the same frames, one may be a frame's with itself."""
    pairs_case["pairs"] = np.array([[1, 3], [3, 1], [2, 2], [3, 1]])
    quadratic = pair_moments(**pairs_case, loss=Loss(LossKind.SQUARED))[0]
    at = random_transforms(rng, 4)
    root = np.sqrt(per_point(pairs_case, pairs_case["weight_per_point"])) / pairs_case["sigma"]

    def residuals(poses):
        return (root[:, None] * pair_gaps(pairs_case, poses)).ravel()

    jacobian = jacobian_by_differences(residuals, at)
    assert_allclose(dense(quadratic, at), jacobian.T @ jacobian, atol=1e-4)
    assert_allclose(
        quadratic.normal_blocks(at).gradient.ravel(), jacobian.T @ residuals(at), atol=1e-4
    )


def test_float32_points_are_summed_in_float64(planes_case, pairs_case):
    # Each coordinate is off by 6e-8 of itself; sums of float32 would be off by 1e-6 and more.
    loss = Loss(LossKind.CAUCHY, 2.0)
    for moments, case in ((plane_moments, planes_case), (pair_moments, pairs_case)):
        for name in ("points_cam", "points_a", "points_b"):
            if name in case:
                case[name] = case[name].astype(np.float32)
        rounded = {
            name: value.astype(float) if name.startswith("points") else value
            for name, value in case.items()
        }
        found, cost = moments(**case, loss=loss)
        expected, expected_cost = moments(**rounded, loss=loss)
        assert_allclose(cost, expected_cost, rtol=1e-13)
        for name in ("moments", "aa", "ab", "bb"):
            if hasattr(found, name):
                assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-12)


def test_mapped_points_give_the_same_bits(rng, monkeypatch):
    monkeypatch.setattr("planfit.runtime.mapped.MIN_BYTES", 0)
    monkeypatch.setattr("planfit.lsq.moments._PART_POINTS", 1000)
    points = rng.normal(size=(20_000, 3)).astype(np.float32)
    rows = map_rows([points[:1234], points[1234:]], points.shape, points.dtype)
    assert is_mapped(rows) == mapped.CAN_LET_GO
    start, poses, loss = np.arange(0, 20_001, 50), random_transforms(rng, 4), Loss(LossKind.CAUCHY)
    pose_idx, pairs = np.arange(400) % 4, np.array([[0, 1], [1, 2], [2, 3], [0, 3]] * 100)
    planes, weight = np.tile([0.0, 0.0, 1.0, 0.1], (400, 1)), np.ones(400)
    for found, expected in (
        (
            plane_moments(p, start, pose_idx, planes, weight, poses, 0.1, loss)
            for p in (rows, points)
        ),
        (
            pair_moments(p, p, np.ones(20_000), start, pairs, weight, poses, loss)
            for p in (rows, points)
        ),
    ):
        assert found[1] == expected[1]
        for name in ("moments", "aa", "ab", "bb"):
            if hasattr(found[0], name):
                assert_array_equal(getattr(found[0], name), getattr(expected[0], name))

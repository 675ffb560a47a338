"""Ray distance: against the distance of two lines, and parallel, opposite and missing rays."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import jacobian_by_differences, make_matches, nudged, random_transforms
from facing import facing_matches, facing_poses
from planfit.adjust.terms import rays
from planfit.adjust.terms.observation_models import RAYS
from planfit.adjust.terms.rays import RayTerm
from planfit.errors import OptionError
from planfit.lsq.normal_equations import NormalEquations
from planfit.lsq.robust import Loss, LossKind

SQUARED = Loss(LossKind.SQUARED)


@pytest.fixture
def poses():
    return facing_poses()


@pytest.fixture
def matches(rng, poses):
    return facing_matches(rng, poses)


def line_distances(matches, poses):
    """Least-squares meeting of each two lines: the slow twin; also the sine of their angle."""
    pair = np.repeat(matches.pairs, np.diff(matches.start), axis=0)
    result, sines = [], []
    for (i, j), p, q in zip(pair, matches.points_a, matches.points_b, strict=True):
        a, e = poses[i, :3, :3] @ p, poses[j, :3, :3] @ q
        a, e = a / np.linalg.norm(a), e / np.linalg.norm(e)
        between = poses[j, :3, 3] - poses[i, :3, 3]
        lines = np.stack([a, -e], axis=1)
        along = np.linalg.lstsq(lines, between)[0]
        result.append(np.linalg.norm(lines @ along - between))
        sines.append(np.linalg.norm(np.cross(a, e)))
    return np.array(result), np.array(sines)


def test_distance_is_that_of_the_lines_for_rays_of_any_direction(rng, monkeypatch):
    # Far from parallel, so that nothing fades; rays in a vertical plane and backwards among them.
    poses = random_transforms(rng, 4)
    matches = make_matches(poses, [(0, 1), (2, 3), (3, 0)], rng.uniform(-5, 5, (40, 3)))
    monkeypatch.setattr(rays, "PARALLEL_DEG", 1e-6)
    term = RayTerm(matches, RAYS)
    at = nudged(rng, poses, 5.0, 0.3)
    distance, _ = line_distances(matches, at)
    assert distance.max() > 0.3
    assert_allclose(np.abs(term.ray_pairs.distances(at)), distance, atol=1e-9)


def test_distance_fades_with_the_angle(matches, poses, rng, monkeypatch):
    at = nudged(rng, poses, 1.0, 0.05)
    monkeypatch.setattr(rays, "PARALLEL_DEG", 10.0)
    distance, sine = line_distances(matches, at)
    limit = np.sin(np.deg2rad(10.0))
    faded = distance * sine / np.hypot(sine, limit)
    assert faded.max() < 0.9 * distance.max()
    assert_allclose(np.abs(RayTerm(matches, RAYS).ray_pairs.distances(at)), faded, atol=1e-12)


def test_blocks_are_those_of_the_residuals(matches, poses, rng):
    at = nudged(rng, poses, 1.0, 0.05)
    term = RayTerm(matches, replace(RAYS, loss=SQUARED, max_observations=1e9))

    def residuals(here):
        return term.ray_pairs.distances(here) / matches.sigma

    jacobian = jacobian_by_differences(residuals, at)
    blocks = term.reweight(at)[0].normal_blocks(at)
    dense = NormalEquations([blocks], len(at)).matrix.toarray()
    assert_allclose(dense, jacobian.T @ jacobian, atol=1e-7 * dense.max())
    expected = jacobian.T @ residuals(at)
    assert_allclose(blocks.gradient.ravel(), expected, atol=1e-7 * np.abs(expected).max())


def test_depth_does_not_matter(matches, poses, rng):
    at = nudged(rng, poses, 1.0, 0.05)
    before = RayTerm(matches, RAYS).reweight(at)[1]
    matches.points_a[:] *= rng.uniform(0.5, 2.0, (matches.n_matches, 1))
    assert_allclose(RayTerm(matches, RAYS).reweight(at)[1], before)


def two_cameras(angle, opposite=False):
    """Cameras 0.5 m apart; their rays to the match meet at `angle` rad, or at pi - `angle`."""
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, :3, 3] = [0.3, 0.4, 0.0]
    matches = make_matches(poses, [(0, 1)], np.array([[0.0, 0.0, 2.0]]))
    direction = np.array([0.0, np.sin(angle), np.cos(angle)])
    matches.points_b[0] = -2.0 * direction if opposite else 2.0 * direction
    return poses, matches


@pytest.mark.parametrize("opposite", [False, True])
@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-160, 1e-12, 1e-6, 1e-3, 0.1])
def test_jacobian_at_and_near_parallel(angle, opposite):
    poses, matches = two_cameras(angle, opposite)
    term = RayTerm(matches, replace(RAYS, loss=SQUARED))
    quadratic, cost = term.reweight(poses)
    blocks = quadratic.normal_blocks(poses)
    assert np.isfinite(cost)
    scale = np.sqrt(quadratic.weight[0])
    jacobian = jacobian_by_differences(lambda at: scale * term.ray_pairs.distances(at), poses)
    dense = NormalEquations([blocks], 2).matrix.toarray()
    assert_allclose(dense, jacobian.T @ jacobian, atol=1e-5 * dense.max())


def test_exactly_parallel_rays_are_quiet():
    poses, matches = two_cameras(0.0)
    assert_array_equal(RayTerm(matches, RAYS).ray_pairs.distances(poses), 0.0)
    quadratic, cost = RayTerm(matches, RAYS).reweight(poses)
    assert cost == 0.0
    assert not quadratic.normal_blocks(poses).gradient.any()


def test_jacobian_is_continuous_through_parallel():
    blocks = []
    for angle in (-1e-7, 0.0, 1e-7):
        poses, matches = two_cameras(angle)
        quadratic, _ = RayTerm(matches, replace(RAYS, loss=SQUARED)).reweight(poses)
        blocks.append(quadratic.normal_blocks(poses).blocks)
    assert_allclose(blocks[0], blocks[1], atol=1e-4 * np.abs(blocks[1]).max())
    assert_allclose(blocks[2], blocks[1], atol=1e-4 * np.abs(blocks[1]).max())


def test_parallel_deg_is_the_angle_of_half_the_squared_distance():
    poses, matches = two_cameras(np.deg2rad(2.0))
    whole, _ = line_distances(matches, poses)
    for parallel_deg, share in ((1e-4, 1.0), (2.0, np.sqrt(0.5)), (60.0, 0.04)):
        with patch.object(rays, "PARALLEL_DEG", parallel_deg):
            term = RayTerm(matches, RAYS)
            found = term.ray_pairs.distances(poses)
        assert_allclose(np.abs(found), share * whole, rtol=0.01)


def test_coinciding_centres_have_no_distance(matches, poses, rng):
    at = poses.copy()
    at[:, :3, 3] = 1.0
    assert_allclose(RayTerm(matches, RAYS).reweight(at)[1], 0.0, atol=1e-20)


def test_sigma_of_the_match_divides_the_distance(matches, poses, rng):
    at = nudged(rng, poses, 1.0, 0.05)
    before = RayTerm(matches, replace(RAYS, loss=SQUARED)).reweight(at)[1]
    matches.sigma[:] *= 2
    assert_allclose(RayTerm(matches, replace(RAYS, loss=SQUARED)).reweight(at)[1], before / 4)


def test_a_match_without_direction_is_quiet(matches, poses):
    matches.points_a[0] = 0.0
    quadratic, cost = RayTerm(matches, RAYS).reweight(poses)
    assert_allclose(cost, 0.0, atol=1e-18)
    assert np.isfinite(quadratic.normal_blocks(poses).blocks).all()


def test_refuses_options_that_cannot_work():
    with pytest.raises(OptionError, match="max_observations"):
        replace(RAYS, max_observations=0.0)

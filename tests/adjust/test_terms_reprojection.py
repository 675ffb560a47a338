"""Reprojection error: against the camera itself, and points that cannot be seen."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import jacobian_by_differences, make_matches, nudged
from facing import facing_cameras, facing_matches, facing_poses
from planfit.adjust.terms import reprojection
from planfit.adjust.terms.observation_models import REPROJECTION
from planfit.adjust.terms.reprojection import ReprojectionTerm
from planfit.errors import OptionError
from planfit.geometry import se3
from planfit.lsq.normal_equations import NormalEquations
from planfit.lsq.robust import Loss, LossKind

SQUARED = Loss(LossKind.SQUARED)


@pytest.fixture
def poses():
    return facing_poses()


@pytest.fixture
def matches(rng, poses):
    return facing_matches(rng, poses)


def make_term(matches, n, **options):
    return ReprojectionTerm(matches, facing_cameras(n), replace(REPROJECTION, **options))


def residuals_px(matches, cameras, poses):
    """Both ways, with the cameras' own `project` and stored pixels: the slow twin."""
    result = []
    for k, (i, j) in enumerate(matches.pairs):
        part = slice(matches.start[k], matches.start[k + 1])
        a, b = matches.points_a[part], matches.points_b[part]
        for first, second, seen, lifted in ((i, j, a, b), (j, i, b, a)):
            uv = cameras[first].project(seen)
            relative = se3.inverse(poses[first]) @ poses[second]
            result.append(cameras[first].project(se3.transform(relative, lifted)) - uv)
    return np.concatenate(result)


def test_cost_is_that_of_projected_points(matches, poses, rng):
    at = nudged(rng, poses, 1.0, 0.05)
    term = make_term(matches, len(poses), loss=SQUARED, sigma=1.0, max_observations=1e9)
    gap = residuals_px(matches, term.cameras, at)
    assert_allclose(term.reweight(at)[1], 0.25 * np.sum(gap**2))


def test_blocks_are_those_of_the_residuals(matches, poses, rng):
    at = nudged(rng, poses, 1.0, 0.05)
    term = make_term(matches, len(poses), loss=SQUARED, sigma=np.sqrt(0.5), max_observations=1e9)

    def residuals(here):
        return residuals_px(matches, term.cameras, here).ravel()

    jacobian = jacobian_by_differences(residuals, at)
    blocks = term.reweight(at)[0].normal_blocks(at)
    dense = NormalEquations([blocks], len(at)).matrix.toarray()
    assert_allclose(dense, jacobian.T @ jacobian, atol=1e-7 * dense.max())
    expected = jacobian.T @ residuals(at)
    assert_allclose(blocks.gradient.ravel(), expected, atol=1e-7 * np.abs(expected).max())


def test_the_principal_point_does_not_matter(matches, poses, rng):
    at = nudged(rng, poses, 1.0, 0.05)
    term = make_term(matches, len(poses))
    shifted = tuple(replace(camera, cx=3.0, cy=99.0) for camera in term.cameras)
    expected = term.reweight(at)[1]
    assert_allclose(replace(term, cameras=shifted).reweight(at)[1], expected)
    finer = tuple(replace(c, fx=2 * c.fx, fy=2 * c.fy) for c in term.cameras)
    doubled = replace(term, cameras=finer, model=replace(term.model, sigma=4.0))
    assert_allclose(doubled.reweight(at)[1], expected)


def test_sigma_divides_the_residual(matches, poses, rng):
    at = nudged(rng, poses, 0.5, 0.02)
    one = make_term(matches, len(poses), loss=SQUARED, sigma=1.0).reweight(at)[1]
    assert_allclose(
        make_term(matches, len(poses), loss=SQUARED, sigma=3.0).reweight(at)[1], one / 9
    )


def turned_away(poses):
    """The second camera looks back: all it sees lies behind the others, and the reverse."""
    at = poses.copy()
    at[1, :3, :3] = se3.exp_so3(np.array([0.0, 0.0, np.pi])) @ at[1, :3, :3]
    return at


def test_points_behind_the_camera_have_no_weight(matches, poses):
    at = turned_away(poses)
    term = make_term(matches, len(poses), loss=SQUARED, max_observations=1e9)
    quadratic, cost = term.reweight(at)
    frames = np.repeat(quadratic.reprojected.pairs, np.diff(quadratic.reprojected.start), axis=0)
    with_second = np.any(frames == 1, axis=1)
    assert not quadratic.weight[with_second].any()
    assert np.all(quadratic.weight[~with_second] > 0)
    # Each is as far off as the image is wide and high: both cameras have 160 x 120 pixels.
    assert_allclose(cost, with_second.sum() * 0.25 * 200.0**2 / term.model.sigma**2)
    assert_allclose(quadratic.cost(at), 0.0, atol=1e-18)
    blocks = quadratic.normal_blocks(at)
    assert np.isfinite(blocks.blocks).all()
    assert not blocks.blocks[1].any()


def test_turning_away_costs_more(matches, poses, rng):
    term = make_term(matches, len(poses))
    at = nudged(rng, poses, 3.0, 0.1)
    assert term.reweight(turned_away(at))[1] > 1.2 * term.reweight(at)[1]


def test_no_step_gains_by_bringing_points_behind_the_camera(matches, poses):
    quadratic, cost = make_term(matches, len(poses)).reweight(poses)
    behind = quadratic.cost(turned_away(poses))
    assert np.isfinite(behind)
    assert behind > 1e6 * (cost + 1.0)


@pytest.mark.parametrize("depth_m", [0.5, 0.1251, 0.125, 0.0625, 0.0, -0.25])
def test_points_at_the_image_plane_are_safe(depth_m, monkeypatch):
    monkeypatch.setattr(reprojection, "MIN_DEPTH_M", 0.125)
    # Two cameras that look the same way; the second is moved until the point is at `depth_m`.
    poses = np.tile(np.eye(4), (2, 1, 1))
    matches = make_matches(poses, [(0, 1)], np.array([[0.2, -0.1, 3.0]]))
    at = poses.copy()
    at[1, 2, 3] = 3.0 - depth_m
    quadratic, cost = make_term(matches, 2).reweight(at)
    blocks = quadratic.normal_blocks(at)
    assert np.isfinite(cost)
    assert np.isfinite(blocks.blocks).all()
    assert np.isfinite(blocks.gradient).all()
    # ReprojectedMatches: the first camera sees the second's point further off; the second's are at depth_m.
    assert quadratic.weight[0] > 0
    assert (quadratic.weight[1] > 0) == (depth_m > 0.125)


def test_a_point_lifted_at_no_depth_has_no_weight(poses, rng):
    matches = facing_matches(rng, poses)
    matches.points_a[0] = 0.0
    quadratic, cost = make_term(matches, len(poses)).reweight(poses)
    assert quadratic.weight[0] == 0.0
    assert np.isfinite(cost)


@pytest.mark.parametrize("name", ["sigma", "max_observations"])
def test_refuses_options_that_cannot_work(name):
    with pytest.raises(OptionError, match=name):
        replace(REPROJECTION, **{name: 0.0})

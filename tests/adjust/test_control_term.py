"""The control term: zero at the truth, derivatives by differences, unknown heights, shared marks."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import gradient_by_differences, make_world, nudged, random_transforms
from planfit.adjust import (
    AdjustOptions,
    build_problem,
    hold_to_keyframes,
    reduce_measurements,
)
from planfit.adjust.terms import observation_models
from planfit.adjust.terms.control import ControlMarks, control_term
from planfit.adjust.terms.observation_models import CONTROL
from planfit.geometry import se3
from planfit.geometry.calibration import SensorCalibration
from planfit.lsq.residual_term import jacobian_by_differences
from planfit.lsq.robust import SQUARES

PLAIN = replace(CONTROL, loss=SQUARES)


def marks_of(poses, targets, pose_idx, sigma_m=0.02, point_idx=None):
    """Exact marks of points at poses, each of a point of its own."""
    pose_idx = np.asarray(pose_idx)
    points = se3.transform_each(se3.inverse(poses)[pose_idx], targets)
    own = np.arange(len(targets)) if point_idx is None else np.asarray(point_idx)
    return ControlMarks(points, pose_idx, own, np.full(len(targets), sigma_m), targets)


def test_a_metre_off_costs_its_square_in_sigmas(rng):
    poses = random_transforms(rng, 3)
    targets = rng.normal(size=(4, 3))
    marks = marks_of(poses, targets, [0, 1, 2, 2], sigma_m=0.5)
    assert control_term(marks, PLAIN).reweight(poses)[1] == pytest.approx(0.0, abs=1e-20)
    off = replace(marks, targets=targets + np.array([1.0, 0.0, 0.0]))
    assert control_term(off, PLAIN).reweight(poses)[1] == pytest.approx(4 * 0.5 * (1.0 / 0.5) ** 2)
    assert control_term(off, replace(PLAIN, weight=0.25)).reweight(poses)[1] == pytest.approx(2.0)


def test_jacobian_and_gradient_by_differences(rng):
    poses = random_transforms(rng, 4)
    targets = rng.normal(size=(5, 3))
    targets[2, 2] = np.nan  # a height that is not known
    marks = replace(marks_of(poses, np.nan_to_num(targets), [0, 1, 1, 3, 2]), targets=targets)
    there = nudged(rng, poses, 3.0, 0.1)
    term = control_term(marks, CONTROL)
    assert term.jacobian is not None
    at = there[term.pose_idx]
    assert_allclose(term.jacobian(at), jacobian_by_differences(term.residual, at), atol=1e-8)
    by_term = term.reweight(there)[0].normal_blocks(there).gradient
    slopes = gradient_by_differences(lambda p: term.reweight(p)[1], there)
    assert_allclose(by_term, slopes, rtol=1e-5, atol=1e-5 * np.abs(slopes).max())


def test_an_unknown_height_holds_no_height(rng):
    poses = random_transforms(rng, 1)
    marks = marks_of(poses, np.array([[1.0, 2.0, 3.0]]), [0])
    free = replace(marks, targets=np.array([[1.0, 2.0, np.nan]]))
    lifted = se3.retract(poses, np.array([[0, 0, 0, 0, 0, 5.0]]))
    assert control_term(free, PLAIN).reweight(lifted)[1] == pytest.approx(0.0, abs=1e-20)
    assert control_term(marks, PLAIN).reweight(lifted)[1] > 1e4


@pytest.mark.parametrize(("most", "worth"), [(5.0, 5.0), (1.0, 1.0), (100.0, 50.0)])
def test_marks_of_a_point_count_as_a_few(rng, most, worth):
    poses = random_transforms(rng, 50)
    marks = marks_of(
        poses, np.tile([[1.0, 2.0, 3.0]], (50, 1)), np.arange(50), 1.0, np.zeros(50, int)
    )
    off = replace(marks, targets=marks.targets + np.array([0.0, 0.1, 0.0]))
    cost = control_term(off, replace(PLAIN, max_observations=most)).reweight(poses)[1]
    assert cost == pytest.approx(0.5 * worth * 0.1**2)


def test_a_blunder_is_let_go_of(rng):
    world = make_world(rng)
    poses, centres = world.plan_from_cams, world.plan_from_cams[:, :3, 3]
    wrong = centres.copy()
    wrong[3] += (2.0, 0.0, 0.0)
    marks = replace(marks_of(poses, centres, np.arange(8)), targets=wrong)
    held = replace(world.measurements, control=marks)

    def error_m(model):
        with patch.dict(observation_models.ROBUST, control=model):
            solved = build_problem(held, AdjustOptions(), poses).solve().target_from_cams
        return np.linalg.norm(solved[:, :3, 3] - centres, axis=1).max()

    assert error_m(CONTROL) < 0.01 < 0.05 < error_m(PLAIN)


def test_without_targets_or_weight_there_is_no_term(rng):
    poses = random_transforms(rng, 1)
    marks = marks_of(poses, np.zeros((1, 3)), [0])
    assert control_term(replace(marks, targets=None), PLAIN) is None
    assert control_term(marks, replace(CONTROL, weight=0.0)) is None


def test_marks_between_keyframes_stay_in_the_problem(rng):
    """A frame that is no keyframe shows the point: the keyframe that holds it is told where it lies."""
    world = make_world(rng)
    poses = world.plan_from_cams
    targets = rng.uniform([0, 0, 0], [6, 4, 2], (3, 3))
    held = replace(world.measurements, control=marks_of(poses, targets, [1, 2, 6]))
    keys = hold_to_keyframes(poses, np.array([0, 3, 7]))
    reduced = reduce_measurements(held, keys).control
    assert set(reduced.pose_idx) <= {0, 1, 2}
    seen = se3.transform_each(poses[keys.frame_idx][reduced.pose_idx], reduced.points_cam)
    assert_allclose(seen, targets, atol=1e-12)


def test_control_points_alone_hold_a_scan(rng):
    """No gauge is needed where points hold the whole; one point leaves the yaw to it."""
    world = make_world(rng)
    poses = world.plan_from_cams
    centres = poses[:, :3, 3]
    three = replace(world.measurements, control=marks_of(poses, centres[:3], [0, 1, 2]))
    one = replace(world.measurements, control=marks_of(poses, centres[:1], [0]))
    assert build_problem(three, AdjustOptions(), poses).gauge is None
    assert build_problem(one, AdjustOptions(), poses).gauge is not None
    moved = (
        se3.make_transform(se3.exp_so3(np.array([0, 0, 0.05])), np.array([0.3, -0.2, 0.0])) @ poses
    )
    solved = build_problem(three, AdjustOptions(), moved).solve().target_from_cams
    assert_allclose(solved[:, :3, 3], centres, atol=2e-3)


def test_the_sensor_corrects_marks_but_not_cameras_at_points(rng):
    points = np.array([[0.3, -0.2, 2.0], [0.0, 0.0, 0.0]])
    marks = ControlMarks(points, np.array([0, 0]), np.array([0, 1]), np.full(2, 0.02))
    longer = marks.corrected(SensorCalibration(depth_scale=1.1, depth_offset_m=0.05))
    assert_allclose(longer.points_cam[0, 2], 2.25)
    assert_allclose(longer.points_cam[1], 0.0)

"""Storeys, ceilings and columns: each is found where it is, and holds what sees it."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import faces_plan, look, make_matches, make_structure, make_world, moved_plan
from planfit.adjust import AdjustOptions, Measurements, adjust_to_plan, ceilings
from planfit.adjust.ceilings import find_ceilings, settle_ceilings
from planfit.adjust.options import TermOptions
from planfit.geometry import se3
from planfit.scan.odometry import OdometryOptions, make_odometry
from planfit.segmentation import LevelPoints, storeys
from planfit.segmentation.storeys import find_storeys


def heights(levels_m, frames_each, rng, points=20, noise_m=0.02):
    """Floor heights of frames that stand on one level after the other; (heights, start)."""
    per_frame = np.repeat(levels_m, frames_each)
    found = np.repeat(per_frame, points) + rng.normal(0, noise_m, len(per_frame) * points)
    return found, np.arange(len(per_frame) + 1) * points


def test_one_storey_is_at_zero_however_its_height_drifts(rng):
    z, start = heights(np.linspace(-0.6, 0.6, 40) + 3.0, 1, rng)
    main_m, above_m = find_storeys(z, start)
    assert main_m == np.median(z)
    assert_allclose(above_m, 0.0)


def test_storeys_are_told_apart_and_stairs_belong_to_none(rng):
    z, start = heights([0.0] * 20 + [1.5] * 2 + [3.1] * 10, 1, rng)
    main_m, above_m = find_storeys(z, start)
    assert abs(main_m) < 0.02
    assert_allclose(above_m[:20], 0.0, atol=1e-9)
    assert np.isnan(above_m[20:22]).all()
    assert_allclose(above_m[22:], 3.1, atol=0.02)


def test_the_main_storey_is_the_one_most_seen(rng):
    z, start = heights([0.0] * 8 + [3.0] * 20, 1, rng)
    main_m, above_m = find_storeys(z, start)
    assert_allclose(main_m, 3.0, atol=0.02)
    assert_allclose(above_m[:8], -3.0, atol=0.02)


def test_a_frame_without_floor_stands_where_the_last_one_stood(rng):
    z, start = heights([0.0] * 10 + [3.0] * 10, 1, rng)
    start = np.insert(start, 15, start[15])  # frame 15 sees none
    _, above_m = find_storeys(z, start)
    assert len(above_m) == 21
    assert_allclose(above_m[15], 3.0, atol=0.02)


@pytest.mark.parametrize(
    ("name", "value", "n_storeys"), [("_MIN_STOREY_M", 4.0, 1), ("_MIN_SHARE", 0.6, 1)]
)
def test_thresholds_of_storeys_decide(name, value, n_storeys, rng):
    z, start = heights([0.0] * 20 + [3.0] * 16, 1, rng)
    _, default = find_storeys(z, start)
    with patch.object(storeys, name, value):
        _, other = find_storeys(z, start)
    assert len(np.unique(default.round(1))) == 2
    assert len(np.unique(other[np.isfinite(other)].round(1))) == n_storeys


def test_no_floor_no_storey():
    main_m, above_m = find_storeys(np.zeros(0), np.zeros(6, dtype=int))
    assert np.isnan(main_m)
    assert_allclose(above_m, np.zeros(5))


def test_frames_of_two_storeys_are_held_to_their_own_floor(rng):
    poses = np.stack([look([3, 2, 1.5 + 3.0 * (i // 4)], 90 * i, 15) for i in range(8)])
    floor = []
    for i in range(8):
        xy = rng.uniform(1, 3, (60, 2))
        floor.append((i, np.column_stack([xy, np.full(60, 3.0 * (i // 4))])))
    structure = replace(make_structure(poses, floor), floor_heights_m=np.repeat([0.0, 3.0], 4))
    empty = make_matches(poses, [], np.zeros((0, 3)))
    measurements = Measurements(empty, structure, make_odometry(poses, OdometryOptions()))
    lifted = poses.copy()
    lifted[:, 2, 3] += rng.uniform(-0.2, 0.2, 8)
    options = AdjustOptions(odometry=TermOptions(0.0))
    plan_adjustment = adjust_to_plan(
        measurements, faces_plan([[0, 0], [6, 0], [6, 4], [0, 4]]), lifted, options
    )
    assert_allclose(plan_adjustment.solution.target_from_cams[:, 2, 3], poses[:, 2, 3], atol=0.01)


def with_ceiling(world, heights_m, rng, wrong=0.1):
    """The world's structure with ceilings of given height above each frame, some of it ducts."""
    cams_from_plan = se3.inverse(world.plan_from_cams)
    points, counts = [], []
    for cam_from_plan, height in zip(cams_from_plan, heights_m, strict=True):
        n = 0 if np.isnan(height) else 50
        on_it = np.column_stack([rng.uniform(1, 5, (n, 2)), np.full(n, height)])
        on_it[: int(wrong * n), 2] -= 0.6
        points.append(se3.transform(cam_from_plan, on_it))
        counts.append(n)
    ceiling = LevelPoints(np.concatenate(points), np.cumsum([0, *counts]))
    return replace(world.structure, ceiling=ceiling)


def test_ceilings_of_two_heights_are_found(rng):
    world = make_world(rng, n=12)
    true_m = np.array([2.5] * 6 + [np.nan] + [3.2] * 4 + [2.9])
    structure = with_ceiling(world, true_m, rng)
    with patch.object(ceilings, "_MIN_SHARE", 0.3):
        found = find_ceilings(structure, world.plan_from_cams)
    assert_allclose(found[:6], 2.5, atol=0.01)
    assert_allclose(found[7:11], 3.2, atol=0.01)
    assert np.isnan(found[6])
    assert np.isnan(found[11])  # one frame's own height is not a ceiling
    with patch.object(ceilings, "_MIN_SHARE", 0.45):
        few = find_ceilings(structure, world.plan_from_cams)
    assert np.isnan(few[7:11]).all()


def test_ceilings_hold_frames_that_see_no_floor(rng):
    world = make_world(rng, n=12)
    structure = with_ceiling(world, np.full(12, 2.5), rng)
    counts = np.diff(structure.floor.start)
    counts[9:] = 0  # the last frames see no floor
    start = np.cumsum([0, *counts])
    floor = LevelPoints(structure.floor.points_cam[: start[-1]], start)
    empty = make_matches(world.plan_from_cams, [], np.zeros((0, 3)))
    measurements = Measurements(empty, replace(structure, floor=floor), world.odometry)
    lifted = world.plan_from_cams.copy()
    lifted[9:, 2, 3] += 0.06
    no_prior = AdjustOptions(odometry=TermOptions(0.0))
    on = adjust_to_plan(measurements, world.floorplan, lifted, no_prior)
    off = adjust_to_plan(
        measurements, world.floorplan, lifted, replace(no_prior, ceiling=TermOptions(0.0))
    )
    assert "ceiling" in on.solution.cost_by_term
    assert "ceiling" not in off.solution.cost_by_term
    assert_allclose(on.solution.target_from_cams[9:, 2, 3], 1.5, atol=0.02)
    assert_allclose(off.solution.target_from_cams[9:, 2, 3], 1.56, atol=0.02)


def column_world(rng):
    """A walk past a square column in a hall whose walls are not seen."""
    column = np.array([[4, 4], [4, 4.5], [4.5, 4.5], [4.5, 4]], dtype=float)
    plan = faces_plan(column, "column")  # clockwise: faces look away from its middle
    poses = np.stack([look([2.0, 2.0 + 0.5 * i, 1.5], 60 - 25 * i) for i in range(5)])
    patches = []
    for i in range(5):
        for face in range(4):
            towards = poses[i, :2, 3] - plan.ends[face].mean(axis=0)
            if towards @ plan.normals[face] > 0.2:
                t = rng.uniform(0, 1, (60, 1))
                xy = plan.ends[face, 0] * (1 - t) + plan.ends[face, 1] * t
                on_it = np.column_stack([xy, rng.uniform(0.3, 2.5, 60)])
                patches.append((i, on_it, plan.normals[face]))
    seen = make_structure(poses, patches=patches)
    structure = replace(make_structure(poses), columns=seen.walls)
    return plan, poses, structure


def test_columns_hold_the_scan_to_their_faces(rng):
    plan, poses, structure = column_world(rng)
    points = rng.uniform([3, 3, 0], [6, 6, 2.5], (30, 3))
    matches = make_matches(poses, [(i, i + 1) for i in range(4)], points)
    measurements = Measurements(matches, structure, make_odometry(poses, OdometryOptions()))
    moved = se3.make_transform(np.eye(3), np.array([0.08, -0.05, 0.0])) @ poses
    on = adjust_to_plan(measurements, plan, moved, AdjustOptions())
    assert {"columns"} <= set(on.solution.cost_by_term)
    assert "gauge" not in on.solution.cost_by_term
    assert_allclose(on.solution.target_from_cams[:, :2, 3], poses[:, :2, 3], atol=0.02)
    off = adjust_to_plan(measurements, plan, moved, AdjustOptions(columns=TermOptions(0.0)))
    assert "columns" not in off.solution.cost_by_term
    assert_allclose(off.solution.target_from_cams[:, :2, 3], moved[:, :2, 3], atol=0.02)


def test_moving_world_and_plan_together_changes_nothing_for_columns(rng):
    plan, poses, structure = column_world(rng)
    empty = make_matches(poses, [], np.zeros((0, 3)))
    measurements = Measurements(empty, structure, make_odometry(poses, OdometryOptions()))
    start = se3.make_transform(np.eye(3), np.array([0.04, 0.03, 0.0])) @ poses
    move = se3.yaw_transform(1.1, np.array([20.0, -7.0, 0.0]))
    here = adjust_to_plan(measurements, plan, start, AdjustOptions())
    there = adjust_to_plan(measurements, moved_plan(plan, move), move @ start, AdjustOptions())
    assert_allclose(
        there.solution.target_from_cams, move @ here.solution.target_from_cams, atol=1e-4
    )


def walk_that_looks_level(true_ceilings_m, fall_m, rng):
    """60 frames along a corridor, of which the last twenty see floor; recorded poses that fall by `fall_m` on
    the way from frame 20 to 40, and what they give; poses stand on the plan at the end."""
    n = len(true_ceilings_m)
    poses = np.stack([look([0.3 * i, 0.0, 1.5], 0.0) for i in range(n)])
    floor = [
        (i, np.column_stack([rng.uniform(-1, 1, (40, 2)) + poses[i, :2, 3], np.zeros(40)]))
        for i in range(n - 20, n)
    ]
    points = []
    for pose, height in zip(poses, true_ceilings_m, strict=True):
        at = np.column_stack([rng.uniform(-1, 1, (90, 2)) + pose[:2, 3], np.full(90, height)])
        points.append(
            se3.transform(se3.inverse(pose), at + rng.normal(0, 0.01, at.shape) * [0, 0, 1])
        )
    ceiling = LevelPoints(np.concatenate(points), np.arange(n + 1) * 90)
    structure = replace(make_structure(poses, floor, []), ceiling=ceiling)
    recorded = poses.copy()
    recorded[:, 2, 3] -= fall_m * np.interp(np.arange(n), [20, 40], [1.0, 0.0])
    no_matches = make_matches(poses, [], np.zeros((0, 3)))
    odometry = make_odometry(recorded, OdometryOptions())
    return Measurements(no_matches, structure, odometry), recorded


def test_one_ceiling_seen_at_two_heights_by_poses_that_fell_is_one(rng):
    """A real plan walked with level cameras: the drift of half a metre stayed, and nothing told of it."""
    measurements, recorded = walk_that_looks_level(np.full(60, 2.5), 0.5, rng)
    options = AdjustOptions()
    found, cameras_m = settle_ceilings(measurements, recorded, options)
    assert_allclose(found, 2.5, atol=0.02)
    assert_allclose(cameras_m, 1.5, atol=0.06)  # from 1.0
    with patch.object(ceilings, "MAX_DRIFT_M", 0.0):
        left, cameras_m = settle_ceilings(measurements, recorded, options)
    assert_allclose(left[:20], 2.0, atol=0.03)
    assert_allclose(cameras_m, recorded[:, 2, 3])
    with patch.object(ceilings, "_MIN_GAIN", 1e6):
        left, _ = settle_ceilings(measurements, recorded, options)
    assert_allclose(left[:20], 2.0, atol=0.03)


@pytest.mark.parametrize("step_m", [0.3, 0.5, 0.9])
def test_two_ceilings_stay_two(step_m, rng):
    true_m = np.where(np.arange(60) < 30, 2.5 - step_m, 2.5)
    measurements, recorded = walk_that_looks_level(true_m, 0.0, rng)
    found, cameras_m = settle_ceilings(measurements, recorded, AdjustOptions())
    assert_allclose(found, true_m, atol=0.02)
    assert_allclose(cameras_m, 1.5, atol=1e-6)


def test_two_ceilings_stay_two_where_poses_fell_on_the_way(rng):
    """By 0.1 m within the frames that see the first: they stand at one height of it still."""
    true_m = np.where(np.arange(60) < 45, 2.0, 2.5)
    measurements, recorded = walk_that_looks_level(true_m, 0.1, rng)
    found, _ = settle_ceilings(measurements, recorded, AdjustOptions())
    assert np.ptp(found[45:]) == 0
    assert_allclose(found[45:], 2.5, atol=0.02)
    assert_allclose(found[40:45], 2.0, atol=0.1)

"""What nothing but the recorded motion holds is named, and nothing else is."""

from dataclasses import replace

import numpy as np
import pytest

from builders import make_matches, make_structure, make_world, position_rms_m, room_plan
from planfit.adjust import AdjustOptions, Measurements, adjust_to_plan
from planfit.adjust.options import TermOptions
from planfit.findings import ResultKind

NO_PRIOR = AdjustOptions(odometry=TermOptions(0.0))


@pytest.fixture
def world(rng):
    return make_world(rng)


def without_frames(world, frames):
    """The same measurements, but `frames` match nothing and see nothing."""
    pairs = [(i, i + 1) for i in range(7) if i not in frames and i + 1 not in frames]
    points = world.matches.points_a[:25] @ world.plan_from_cams[0, :3, :3].T
    points = points + world.plan_from_cams[0, :3, 3]
    s, poses = world.structure, world.plan_from_cams

    def seen(points_cam, i):
        return points_cam @ poses[i, :3, :3].T + poses[i, :3, 3]

    floor = [
        (i, seen(s.floor.points_cam[s.floor.start[i] : s.floor.start[i + 1]], i))
        for i in range(8)
        if i not in frames
    ]
    patches = []
    for k, i in enumerate(s.walls.frame_idx):
        if i not in frames:
            part = slice(s.walls.start[k], s.walls.start[k + 1])
            normal = (poses[i, :3, :3] @ s.walls.normals_cam[k])[:2]
            patches.append((int(i), seen(s.walls.points_cam[part], i), normal))
    structure = make_structure(poses, floor, patches)
    return Measurements(make_matches(poses, pairs, points), structure, world.odometry)


def weakly_constrained(measurements, world, options=None, floorplan=None):
    options = options or AdjustOptions()
    plan_adjustment = adjust_to_plan(
        measurements, floorplan or world.floorplan, world.plan_from_cams.copy(), options
    )
    assert np.isfinite(plan_adjustment.solution.target_from_cams).all()
    return plan_adjustment.weakly_constrained


def test_nothing_is_said_of_a_observable_scan(world):
    assert weakly_constrained(world.measurements, world) == ()
    assert weakly_constrained(world.measurements, world, NO_PRIOR) == ()


def test_frames_constrained_by_odometry_alone_are_named(world):
    measurements = without_frames(world, {2, 3, 6})
    (found,) = weakly_constrained(measurements, world)
    assert found.kind is ResultKind.HELD_BY_ODOMETRY
    assert found.frames == ((2, 3), (6, 6))


def test_frames_that_nothing_holds_are_named_and_stay(world):
    measurements = without_frames(world, {4})
    moved = world.plan_from_cams.copy()
    moved[4, :3, 3] += 0.3
    plan_adjustment = adjust_to_plan(measurements, world.floorplan, moved, NO_PRIOR)
    found = plan_adjustment.weakly_constrained[0]
    assert found.kind is ResultKind.NOT_HELD
    assert found.frames == ((4, 4),)
    np.testing.assert_allclose(plan_adjustment.solution.target_from_cams[4], moved[4], atol=1e-6)


def test_frame_numbers_are_those_of_the_scan_where_only_some_are_solved_for(world):
    measurements = replace(without_frames(world, {2, 3}), frame_idx=10 * np.arange(8))
    (found,) = weakly_constrained(measurements, world)
    assert found.frames == ((20, 30),)


def test_a_plan_with_a_single_wall_leaves_the_way_along_it_free(world):
    one = room_plan()
    one = replace(one, ends=one.ends[:1], normals=one.normals[:1], is_oriented=one.is_oriented[:1])
    (found,) = weakly_constrained(world.measurements, world, floorplan=one)
    assert found.kind is ResultKind.NOTHING_HOLDS_ALONG
    assert found.facts["direction"] == pytest.approx((1.0, 0.0))
    assert found.frames == ()


def test_a_piece_of_the_scan_that_sees_no_wall_of_the_plan_is_named(world):
    # Two halves without a match between them; the second sees only floor.
    s, poses = world.structure, world.plan_from_cams
    pairs = [(0, 1), (1, 2), (2, 3), (4, 5), (5, 6), (6, 7)]
    points = np.random.default_rng(1).uniform([0, 0, 0], [6, 4, 2.5], (25, 3))
    keep = s.walls.frame_idx < 4
    n_points = int(s.walls.start[keep.sum()])
    walls = replace(
        s.walls,
        points_cam=s.walls.points_cam[:n_points],
        start=s.walls.start[: keep.sum() + 1],
        frame_idx=s.walls.frame_idx[keep],
        normals_cam=s.walls.normals_cam[keep],
        ends_cam=s.walls.ends_cam[keep],
    )
    measurements = Measurements(
        make_matches(poses, pairs, points), replace(s, walls=walls), world.odometry
    )
    assert weakly_constrained(measurements, world) == ()  # the recorded motion joins them
    (found,) = weakly_constrained(measurements, world, NO_PRIOR)
    assert found.kind is ResultKind.NO_WALL_HOLDS
    assert found.frames == ((4, 7),)


def test_coincident_frames_and_points_on_one_plane_are_solved(world):
    still = np.tile(world.plan_from_cams[:1], (8, 1, 1))
    flat = np.column_stack([np.random.default_rng(0).uniform(1, 3, (25, 2)), np.zeros(25)])
    measurements = Measurements(
        make_matches(still, [(i, i + 1) for i in range(7)], flat),
        make_structure(still, floor=[(i, flat) for i in range(8)]),
        world.odometry,
    )
    plan_adjustment = adjust_to_plan(measurements, world.floorplan, still, NO_PRIOR)
    assert position_rms_m(plan_adjustment.solution.target_from_cams, still) < 1e-3


def test_a_scan_with_floor_alone_stays_where_it_was_put(world):
    s = make_structure(
        world.plan_from_cams,
        floor=[(0, np.random.default_rng(0).uniform(0, 4, (50, 3)) * (1, 1, 0))],
    )
    empty = make_matches(world.plan_from_cams, [], np.zeros((0, 3)))
    options = AdjustOptions(odometry=TermOptions(0.0))
    plan_adjustment = adjust_to_plan(
        Measurements(empty, s, world.odometry), world.floorplan, world.plan_from_cams, options
    )
    assert position_rms_m(plan_adjustment.solution.target_from_cams, world.plan_from_cams) < 1e-6
    found = plan_adjustment.weakly_constrained[0]
    assert found.kind is ResultKind.NOT_HELD
    assert found.frames == ((1, 7),)

"""Held-out evidence: the split, and when a result counts as worse."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import make_matches, make_structure, make_world, nudged, room_plan
from planfit.geometry import se3
from planfit.pipeline.validation import (
    consistency_check,
    floor_heights,
    hold_out,
    match_check,
    match_distances,
    wall_check,
    wall_distances,
    wall_points_plan,
)


@pytest.fixture
def world(rng):
    return make_world(rng)


def rows(matches):
    pair = np.repeat(matches.pairs, np.diff(matches.start), axis=0)
    return {tuple(row) for row in np.column_stack([pair, matches.points_a, matches.points_b])}


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 1.0])
def test_every_match_is_in_exactly_one_part(world, rng, share):
    solving, held = hold_out(world.matches, share, rng)
    assert rows(solving) | rows(held) == rows(world.matches)
    assert not rows(solving) & rows(held)
    assert held.n_matches == pytest.approx(share * world.matches.n_matches, abs=25)
    for part in (solving, held):
        assert np.all(np.diff(part.start) > 0)
        assert part.start[-1] == part.n_matches == len(part.points_b) == len(part.sigma)
        assert len(part.pairs) == len(part.start) - 1


def test_no_matches_to_split(world, rng):
    none = make_matches(world.plan_from_cams, [], np.zeros((0, 3)))
    for part in hold_out(none, 0.5, rng):
        assert part.n_matches == 0
        assert_array_equal(part.start, [0])


def test_match_distances(world, rng):
    assert_allclose(match_distances(world.matches, world.plan_from_cams), 0, atol=1e-12)
    poses = world.plan_from_cams.copy()
    poses[3, 0, 3] += 0.5
    distances = match_distances(world.matches, poses)
    pair = np.repeat(world.matches.pairs, np.diff(world.matches.start), axis=0)
    assert_allclose(distances, np.where((pair == 3).any(axis=1), 0.5, 0.0), atol=1e-9)


def test_matches_that_drift_apart_are_worse(world, rng):
    off = nudged(rng, world.plan_from_cams, 1.0, 0.1)
    better = match_check(world.matches, off, world.plan_from_cams)
    worse = match_check(world.matches, world.plan_from_cams, off)
    assert not better.is_worse
    assert worse.is_worse
    assert better.before == worse.after > better.after == worse.before
    assert not match_check(world.matches, off, off).is_worse


def test_too_few_matches_to_tell(world, rng):
    few = make_matches(world.plan_from_cams, [(0, 1)], rng.normal(size=(29, 3)))
    assert match_check(few, world.plan_from_cams, world.plan_from_cams) is None


def test_walls_that_leave_the_plan_are_worse(world):
    true, off = world.plan_from_cams, world.plan_from_cams.copy()
    off[:, :2, 3] += 0.3
    worse = wall_check(world.structure, world.floorplan, true, off)
    assert worse.is_worse
    assert worse.before == pytest.approx(1.0)
    assert worse.after < 0.2
    assert not wall_check(world.structure, world.floorplan, off, true).is_worse
    assert not wall_check(world.structure, world.floorplan, true, true).is_worse


def test_no_walls_no_check(world):
    none = make_structure(world.plan_from_cams)
    assert wall_check(none, room_plan(), world.plan_from_cams, world.plan_from_cams) is None


def test_wall_points_are_all_there_and_on_the_plan(world):
    points = wall_points_plan(world.structure, world.plan_from_cams)
    assert len(points) == len(world.structure.walls.points_cam)
    distances = wall_distances(world.structure, world.floorplan, world.plan_from_cams)
    assert_allclose(distances, 0, atol=1e-9)
    loose = replace(
        world.structure,
        unassigned_points_cam=se3.transform(
            se3.inverse(world.plan_from_cams[2]), np.array([[3.0, 2.0, 1.0]])
        ),
        unassigned_frame_idx=np.array([2]),
    )
    assert_allclose(wall_points_plan(loose, world.plan_from_cams)[-1], [3, 2, 1])
    assert wall_distances(loose, world.floorplan, world.plan_from_cams).max() == pytest.approx(2.0)


def test_floor_heights(world):
    assert_allclose(floor_heights(world.structure, world.plan_from_cams), 0, atol=1e-9)
    raised = world.plan_from_cams.copy()
    raised[4, 2, 3] += 0.2
    expected = np.where(world.structure.floor.frame_idx == 4, 0.2, 0.0)
    assert_allclose(floor_heights(world.structure, raised), expected, atol=1e-9)


def test_tension_is_quiet_until_the_walls_pull_costs_a_quarter():
    assert consistency_check(1000.0, 1200.0, n_frames=10) is None
    found = consistency_check(1000.0, 1300.0, n_frames=10)
    assert found is not None
    assert found.is_worse
    assert found.after == pytest.approx(1.3)


def test_drift_that_only_walls_correct_is_no_tension():
    assert consistency_check(0.0, 300.0, n_frames=100) is None
    assert consistency_check(0.0, 400.0, n_frames=100) is not None

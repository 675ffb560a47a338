"""Held-out matches: the split, and when a result counts as worse."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from builders import make_matches, make_structure, make_world, nudged, room_plan
from planfit.pipeline.prepare import hold_out
from planfit.pipeline.validation import consistency_check, match_check, wall_check


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


def test_plan_and_scan_are_consistent_until_the_walls_cost_a_quarter():
    assert consistency_check(1000.0, 1200.0, n_frames=10) is None
    found = consistency_check(1000.0, 1300.0, n_frames=10)
    assert found is not None
    assert found.is_worse
    assert found.after == pytest.approx(1.3)


def test_drift_that_only_walls_correct_is_no_contradiction():
    assert consistency_check(0.0, 300.0, n_frames=100) is None
    assert consistency_check(0.0, 400.0, n_frames=100) is not None

"""Several starts: reach by what is known, votes of stretches, and the cost that they compete by."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import (
    faces_plan,
    gradient_by_differences,
    look,
    make_matches,
    make_structure,
    make_world,
    nudged,
    position_rms_m,
)
from planfit.adjust import (
    AdjustOptions,
    Measurements,
    adjust_to_plan,
    build_problem,
    competition,
    voting,
)
from planfit.adjust.alternation import PlanTask, alternate
from planfit.adjust.association import AssociationOptions, PatchesOnPlan, associate
from planfit.adjust.competition import best_of_starts, full_cost, is_clear, limits, patch_sigmas
from planfit.adjust.terms.observation_models import WALLS
from planfit.adjust.terms.walls import WallTerm, observations_of
from planfit.adjust.voting import MAX_SHIFT_M, vote
from planfit.errors import OptionError
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.scan.odometry import OdometryOptions, make_odometry

NICHES = [[0, 0], [8.7, 0], [8.7, 3], [5, 3], [5, 2.6], [3, 2.6], [3, 3], [0, 3]]


@pytest.fixture
def world(rng):
    return make_world(rng)


@pytest.fixture
def walk(rng):
    """A walk along a room with niches: each frame sees the face on either side, and the one ahead."""
    floorplan = faces_plan(NICHES)
    at = np.linspace(0.8, 7.5, 24)
    poses = np.stack([look([x, 1.5, 1.5], 0.0) for x in at])
    floor, patches = [], []
    for i, x in enumerate(at):
        floor.append((i, rng.uniform([x, 0.5, 0], [x + 1, 2.5, 0], (60, 3))))
        faces = [0, 2 if x > 5 else 4 if x > 3 else 6, 1]
        for k in faces:
            first, last = floorplan.ends[k]
            middle = np.clip(x, *sorted([first[0], last[0]])) if k != 1 else 8.7
            t = rng.uniform(-0.4, 0.4, 240)
            along = np.column_stack([middle + t, np.full(240, first[1])])
            if k == 1:
                along = np.column_stack([np.full(240, 8.7), 1.5 + t])
            on_wall = np.column_stack([along, rng.uniform(0.3, 2.5, 240)])
            patches.append((i, on_wall, floorplan.normals[k]))
    structure = make_structure(poses, floor, patches)
    return poses, floorplan, structure


def measured(structure, recorded):
    none = make_matches(recorded, [], np.zeros((0, 3)))
    return Measurements(none, structure, make_odometry(recorded, OdometryOptions()))


def bent(poses, side_m):
    """Drift that grows along the walk, to the left."""
    moved = poses.copy()
    moved[:, 1, 3] += side_m * np.linspace(0, 1, len(poses)) ** 2
    return moved


def aside(poses):
    """A whole that was aligned half a metre off."""
    return se3.yaw_transform(0.0, np.array([0.0, 0.55, 0.0])) @ poses


def on_plan(patches, floorplan, poses):
    return PatchesOnPlan(patches, floorplan, poses, AssociationOptions())


def task_of(measurements, floorplan, options=AdjustOptions()):  # noqa: B008
    n = len(measurements.odometry.cam_from_next) + 1
    return PlanTask(measurements, floorplan, options, np.full(n, np.nan))


def test_a_widened_loss_is_that_of_a_larger_sigma(world, rng):
    walls = world.structure.walls
    poses = nudged(rng, world.plan_from_cams, 2.0, 0.1)
    association = associate(walls, world.floorplan, poses, 1.0, AssociationOptions())
    options, w = WALLS, 3.0
    wide = WallTerm(walls, world.floorplan, association, options, widths=np.full(len(walls), w))
    larger = replace(options, sigma=w * options.sigma, weight=w**2)
    twin = WallTerm(walls, world.floorplan, association, larger)
    moments, cost = wide.reweight(poses)
    expected, expected_cost = twin.reweight(poses)
    assert cost == pytest.approx(expected_cost, rel=1e-9)
    assert_allclose(moments.moments, expected.moments, rtol=1e-9)


def test_each_patch_has_a_width_of_its_own(world, rng):
    walls = world.structure.walls
    poses = nudged(rng, world.plan_from_cams, 2.0, 0.1)
    association = associate(walls, world.floorplan, poses, 1.0, AssociationOptions())
    widths = rng.uniform(1.0, 5.0, len(walls))
    term = WallTerm(walls, world.floorplan, association, WALLS, widths=widths)
    found = term.reweight(poses)[0].normal_blocks(poses).gradient
    robust = gradient_by_differences(lambda p: term.reweight(p)[1], poses)
    assert_allclose(found, robust, atol=1e-5 * np.abs(found).max())


def test_wall_seen_from_unsure_poses_reaches_further(walk):
    poses, _, structure = walk
    measurements = measured(structure, poses)
    terms = build_problem(measurements, AdjustOptions(), poses).scan_terms
    sigmas = patch_sigmas(structure.walls, terms, poses)
    sides = structure.walls.normals_cam[:, 2] > -0.5  # of these, drift across the walk counts
    frame = structure.walls.frame_idx
    at_ends, in_middle = sigmas[sides & (frame >= 21)], sigmas[sides & (np.abs(frame - 12) < 3)]
    assert at_ends.min() > 1.05 * in_middle.max()
    # Matches from end to end leave less open.
    points = np.random.default_rng(3).uniform([0, 0, 0], [9, 3, 2.5], (40, 3))
    pairs = [(i, j) for i in range(0, 24, 4) for j in range(i + 1, 24)]
    matched = replace(measurements, matches=make_matches(poses, pairs, points))
    more = build_problem(matched, AdjustOptions(), poses).scan_terms
    assert (patch_sigmas(structure.walls, more, poses) <= sigmas + 1e-9).all()
    with patch.multiple(competition, WHOLE_SIGMA_M=0.01, _WHOLE_SIGMA_DEG=0.1):
        assert (patch_sigmas(structure.walls, terms, poses) < sigmas).all()


def test_stretches_vote_for_their_shift_whatever_was_moved(walk, rng):
    poses, floorplan, structure = walk
    walls = structure.walls
    off = np.where(rng.random(len(walls)) < 0.4, rng.uniform(0.1, 0.5, len(walls)), 0.0)
    shift = off[:, None] * walls.normals_cam
    points = walls.points_cam + np.repeat(shift, np.diff(walls.start), axis=0)
    spoilt = replace(walls, points_cam=points, ends_cam=walls.ends_cam + shift[:, None])
    start = bent(se3.yaw_transform(0.0, np.array([0.2, -0.25, 0.0])) @ poses, 0.3)
    worth = observations_of(walls, WALLS)
    voted = vote(on_plan(spoilt, floorplan, start), worth, MAX_SHIFT_M)
    assert position_rms_m(voted, poses) < 0.12 < 0.25 < position_rms_m(start, poses)
    again = vote(on_plan(spoilt, floorplan, start), worth, 0.1)
    assert np.abs(again[:, :2, 3] - start[:, :2, 3]).max() <= 0.1 + 1e-9
    with patch.object(voting, "BEND_SIGMA_M", 1e-3):
        whole = vote(on_plan(spoilt, floorplan, start), worth, MAX_SHIFT_M)
    moved = whole[:, :2, 3] - start[:, :2, 3]
    assert np.ptp(moved, axis=0).max() < 1e-9  # one shift for all


def test_where_walls_tell_nothing_stretches_stay(walk):
    poses, _, structure = walk
    worth = observations_of(structure.walls, WALLS)

    def shift_for(floorplan):
        """Largest shift along x, and that along y, of walls that are believed on the way."""
        voted = vote(on_plan(structure.walls, floorplan, poses), worth, MAX_SHIFT_M)
        return np.abs(voted - poses)[:, :2, 3].max(axis=0)

    far = Floorplan.from_segments([[[500.0, 500.0], [510.0, 500.0]]], [[0.0, 1.0]])
    assert_allclose(shift_for(far), 0.0, atol=1e-12)
    # A wall 0.3 m further to the left, and none ahead: along it nothing is known.
    corridor = Floorplan.from_segments([[[-50.0, -0.3], [50.0, -0.3]]], [[0.0, 1.0]])
    along, across = shift_for(corridor)
    assert along < 1e-12
    # The votes for one face have a limit, reached a step or two before.
    assert across == pytest.approx(0.3, abs=0.1)


def test_a_start_that_reaches_finds_what_a_narrow_loss_does_not(walk):
    poses, floorplan, structure = walk
    start = aside(bent(poses, 0.1))
    measurements = measured(structure, start)
    # One that ends beside the walls would be brought onto them as onto another copy of the plan.
    alone = patch.object(competition, "on_other_copy", lambda _: None)
    with alone:
        narrow = adjust_to_plan(measurements, floorplan, start, AdjustOptions(starts=("aligned",)))
    assert position_rms_m(narrow.solution.target_from_cams, poses) > 0.1
    for starts in (("reach",), ("vote",), ("wide",), AdjustOptions().starts):
        with patch.object(competition, "WHOLE_SIGMA_M", 0.4):
            options = AdjustOptions(starts=starts)
            found = adjust_to_plan(measurements, floorplan, start, options)
        assert position_rms_m(found.solution.target_from_cams, poses) < 0.03, starts
    with alone, patch.object(competition, "MAX_REACH_M", 0.1):
        close = AdjustOptions(starts=("wide",))
        found = adjust_to_plan(measurements, floorplan, start, close)
    assert position_rms_m(found.solution.target_from_cams, poses) > 0.1


def test_the_cheapest_end_is_taken_and_true_poses_cost_no_less(walk):
    poses, floorplan, structure = walk
    start = aside(bent(poses, 0.1))
    task = task_of(measured(structure, start), floorplan)
    narrow = alternate(task, start, (0.35,))
    best = best_of_starts(task, start).best
    from_truth = best_of_starts(task, poses).best
    assert full_cost(task, best) < full_cost(task, narrow)
    assert full_cost(task, best) == pytest.approx(full_cost(task, from_truth), rel=0.01)
    assert is_clear(task, best)
    assert not is_clear(task, narrow)


def test_where_else_a_start_ended_is_a_rival_with_what_it_costs_more(walk):
    poses, floorplan, structure = walk
    start = aside(bent(poses, 0.1))
    task = task_of(measured(structure, start), floorplan)
    found = best_of_starts(task, start)
    assert found.rivals[0].excess_cost > 1.0
    assert position_rms_m(found.rivals[0].plan_from_cams, poses) > 0.1  # as aligned
    assert best_of_starts(task, poses).rivals == ()
    adjusted = adjust_to_plan(task.measurements, floorplan, start, AdjustOptions())
    assert len(adjusted.rivals) == len(found.rivals)


def test_many_patches_of_one_wall_do_not_outvote_several_walls():
    # Of four parallel faces, the one that most patches see was moved by 0.3 m.
    lines = [[[0.0, y], [6.0, y]] for y in (0.0, 3.0, 6.0, 9.0)]
    floorplan = Floorplan.from_segments(lines, [[0.0, 1.0]] * 4)
    pose = look([3.0, 4.5, 1.5], 90.0)[None]
    seen = [0.0, 3.0, 6.0, *[9.3] * 8]
    x = np.linspace(1.0, 5.0, 240)
    patches = [
        (0, np.column_stack([x, np.full(240, y), np.linspace(0.5, 2, 240)]), np.array([0.0, 1.0]))
        for y in seen
    ]
    walls = make_structure(pose, (), patches).walls
    worth = observations_of(walls, WALLS)
    found = {}
    for limit in (8.0, 1e9):
        with patch.object(voting, "MAX_OBSERVATIONS_PER_FACE", limit):
            moved = vote(on_plan(walls, floorplan, pose), worth, MAX_SHIFT_M)
        found[limit] = moved[0, 1, 3]
    assert found[8.0] == pytest.approx(4.5, abs=0.03)
    assert found[1e9] == pytest.approx(4.2, abs=0.03)


def test_letting_go_of_wall_does_not_pay(world):
    task = task_of(world.measurements, world.floorplan)
    beyond = se3.yaw_transform(0.0, np.array([30.0, 0.0, 0.0])) @ world.plan_from_cams
    lost = alternate(task, beyond, (0.35,))
    assert lost.correspondences.walls.n_associated == 0
    assert full_cost(task, lost) >= limits(task).sum()
    assert full_cost(task, alternate(task, world.plan_from_cams, (0.35,))) < limits(task).sum() / 2


def test_starts_are_named(world):
    for starts in ((), ("nearest",)):
        with pytest.raises(OptionError, match="starts: expected"):
            AdjustOptions(starts=starts)
    assert not AdjustOptions(wall_strategy="iterative").has_several_starts
    assert not AdjustOptions(is_bounded=True).has_several_starts

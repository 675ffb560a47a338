"""Walls that stand elsewhere than drawn: found, measured, named, and let go of."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest

from builders import (
    faces_plan,
    look,
    make_structure,
    make_world,
    nudged,
    position_rms_m,
    room_plan,
)
from planfit.adjust import (
    AdjustOptions,
    adjust_to_plan,
    alternation,
    moved_wall_findings,
    moved_walls,
)
from planfit.adjust.association import AssociationOptions, PatchesOnPlan, associate, displaced
from planfit.adjust.moved_walls import MovedWall, find_moved
from planfit.floorplan import Floorplan
from planfit.geometry import se3


@pytest.fixture
def world(rng):
    return make_world(rng)


def drawn_off(world, offsets_m):
    """The plan with faces drawn so that the wall stands `offsets_m` off, along their normals."""
    return displaced(world.floorplan, -np.asarray(offsets_m, dtype=float))


def found(world, floorplan, known=()):
    walls, poses, chosen = world.structure.walls, world.plan_from_cams, AssociationOptions()
    association = associate(walls, floorplan, poses, 0.35, chosen)
    return find_moved(PatchesOnPlan(walls, floorplan, poses, chosen), association, known)


def test_a_right_plan_has_no_moved_wall(world):
    assert np.isnan(found(world, world.floorplan)).all()


@pytest.mark.parametrize("offset_m", [0.12, -0.3, 0.55])
def test_a_moved_wall_is_found_with_its_offset(world, offset_m):
    moved_m = found(world, drawn_off(world, [0, offset_m, 0, 0]))
    assert moved_m[1] == pytest.approx(offset_m, abs=0.02)
    assert np.isnan(moved_m[[0, 2, 3]]).all()


def test_each_threshold_decides(world):
    plan = drawn_off(world, [0, 0.2, 0, 0])  # four patches see each wall

    def n_moved(**changes):
        with patch.multiple(moved_walls, **changes):
            return int(np.isfinite(found(world, plan)).sum())

    assert np.isfinite(found(world, plan)).sum() == 1
    assert n_moved(MAX_OFFSET_M=0.15) == 0
    assert n_moved(MIN_OFFSET_M=0.25) == 0
    assert n_moved(MIN_WITNESSES=4) == 1
    assert n_moved(MIN_WITNESSES=5) == 0


def test_walls_known_to_be_moved_say_nothing_against_the_poses(world):
    plan = drawn_off(world, [0.3, 0.2, -0.25, 0])  # most of what is seen
    assert np.isnan(found(world, plan)).all()
    moved_m = found(world, plan, known=(0, 2))
    np.testing.assert_allclose(moved_m, [0.3, 0.2, -0.25, np.nan], atol=0.02)


@pytest.mark.parametrize(("n_standing", "moved"), [(3, [4]), (2, [])])
def test_a_pilaster_is_told_from_the_wall_beside_it(rng, n_standing, moved):
    """Where most of what was seen would stand on moved walls, the poses are off: none is moved."""
    # 1 m wide and drawn 0.15 m before the wall y = 3; it stands 0.4 m further into the room.
    plan = faces_plan([[0, 0], [6, 0], [6, 3], [4, 3], [4, 2.85], [3, 2.85], [3, 3], [0, 3]])
    pose = look([3.5, 1.0, 1.5], 90.0)
    spans = [(4.2, 5.2, 3.0), *[(3.0, 4.0, 2.45)] * 3, (1.5, 2.8, 3.0), (0.2, 1.4, 3.0)]
    patches = []
    for low, high, y in spans[: 3 + n_standing]:
        x = np.array([low, *rng.uniform(low, high, 60), high])
        wall = np.column_stack([x, np.full(62, y), rng.uniform(0.5, 2.0, 62)])
        patches.append((0, wall, np.array([0.0, -1.0])))
    walls, chosen = make_structure(pose[None], (), patches).walls, AssociationOptions()
    association = associate(walls, plan, pose[None], 0.35, chosen)
    moved_m = find_moved(PatchesOnPlan(walls, plan, pose[None], chosen), association)
    assert np.flatnonzero(np.isfinite(moved_m)).tolist() == moved
    assert moved_m[moved] == pytest.approx(0.4, abs=0.01)


def test_wall_seen_where_it_is_drawn_speaks_against(world):
    # Half of the patches of wall 1 stand 0.3 m before it, as a cupboard does.
    walls = world.structure.walls
    on_wall = np.flatnonzero(
        associate(walls, world.floorplan, world.plan_from_cams, 0.1, AssociationOptions()).face_idx
        == 1
    )
    points, ends = walls.points_cam.copy(), walls.ends_cam.copy()
    for k in on_wall[:2]:
        points[walls.start[k] : walls.start[k + 1]] += 0.3 * walls.normals_cam[k]
        ends[k] += 0.3 * walls.normals_cam[k]
    before = replace(walls, points_cam=points, ends_cam=ends)
    spoilt = replace(world, structure=replace(world.structure, walls=before))
    with patch.object(moved_walls, "MIN_WITNESSES", 2):
        assert np.isnan(found(spoilt, world.floorplan)).all()
        with patch.object(moved_walls, "MIN_SHARE", 0.4):
            assert np.isfinite(found(spoilt, world.floorplan))[1]


def test_scattered_patches_agree_on_nothing(world, rng):
    walls = world.structure.walls
    off = rng.uniform(0.1, 0.6, len(walls))[:, None] * walls.normals_cam
    points = walls.points_cam + np.repeat(off, np.diff(walls.start), axis=0)
    loose = replace(walls, points_cam=points, ends_cam=walls.ends_cam + off[:, None])
    spoilt = replace(world, structure=replace(world.structure, walls=loose))
    with patch.object(moved_walls, "WITHIN_M", 0.01):
        assert np.isnan(found(spoilt, world.floorplan)).all()


def test_the_adjustment_names_a_moved_wall_and_is_not_pulled(world, rng):
    plan = drawn_off(world, [0, 0, 0.15, 0])
    start = nudged(rng, world.plan_from_cams, 0.5, 0.03)
    adjusted = adjust_to_plan(world.measurements, plan, start, AdjustOptions())
    [wall] = adjusted.moved_walls
    assert wall.face_idx == 2
    assert wall.offset_m == pytest.approx(0.15, abs=0.02)
    assert wall.n_patches == 4
    assert 0 < wall.sigma_m < 0.05
    assert adjusted.offsets_m[2] == wall.offset_m
    assert np.isnan(adjusted.offset_sigmas_m[[0, 1, 3]]).all()
    assert position_rms_m(adjusted.solution.target_from_cams, world.plan_from_cams) < 0.01
    # What a patch is said to be off is said against the plan as drawn.
    off = adjusted.association.distance_m[adjusted.association.face_idx == 2]
    assert off == pytest.approx(0.15, abs=0.03)
    held = adjusted.correspondences
    assert held.is_moved.sum() == 4
    assert not (held.walls_as_drawn.face_idx == 2).any()


def test_a_scan_that_is_off_does_not_move_the_walls(world):
    away = se3.yaw_transform(0.0, np.array([0.5, 0.5, 0.0])) @ world.plan_from_cams
    options = AdjustOptions(wall_distances_m=(0.3,), starts=("aligned",))
    assert adjust_to_plan(world.measurements, world.floorplan, away, options).moved_walls == ()


def test_an_offset_below_its_sigma_moves_nothing(world):
    plan = drawn_off(world, [0, 0, 0.15, 0])
    with patch.object(alternation, "MIN_SIGMAS", 100.0):
        adjusted = adjust_to_plan(world.measurements, plan, world.plan_from_cams, AdjustOptions())
    assert adjusted.moved_walls == ()
    assert not adjusted.correspondences.is_moved.any()


def test_moved_walls_stay_unnamed_where_they_are_not_looked_for(world):
    plan = drawn_off(world, [0, 0, 0.15, 0])
    options = AdjustOptions(finds_moved_walls=False)
    assert adjust_to_plan(world.measurements, plan, world.plan_from_cams, options).moved_walls == ()


def test_walls_are_found_with_place_and_direction():
    plan = room_plan()
    (one,) = moved_wall_findings((MovedWall(1, 0.23, 0.01, 5),), plan)
    assert one.faces == (1,)
    assert (one.facts["from_xy_m"], one.facts["to_xy_m"]) == ((6.0, 0.0), (6.0, 4.0))
    assert (one.facts["offset_m"], one.facts["normal"]) == (0.23, (-1.0, 0.0))
    assert one.words.endswith("0.23 m towards -x")
    slanted = Floorplan.from_segments([[[0, 0], [1, 1]], [[0, 3], [3, 3]], [[3, 0], [3, 3]]])
    assert "towards (" in moved_wall_findings((MovedWall(0, 0.2, 0.01, 3),), slanted)[0].words


def test_faces_of_one_wall_are_named_as_one():
    ends = [
        [[0, 0], [3, 0]],  # one side of a wall with a door,
        [[3.9, 0], [7, 0]],
        [[7, 0.2], [0, 0.2]],  # the other side,
        [[0, 2], [7, 2]],  # another wall
    ]
    plan = Floorplan.from_segments(ends, [[0, -1], [0, -1], [0, 1], [0, -1]])
    alike = tuple(MovedWall(k, off, 0.01, 3 + k) for k, off in enumerate((0.3, 0.32, -0.29)))
    (wall,) = moved_wall_findings(alike, plan)
    assert wall.faces == (2,)  # the face that most patches saw
    assert wall.facts["offset_m"] == -0.29
    other = MovedWall(3, 0.3, 0.01, 3)
    assert len(moved_wall_findings((*alike, other), plan)) == 2
    unlike = MovedWall(1, -0.3, 0.01, 3)
    assert len(moved_wall_findings((alike[0], unlike, alike[2]), plan)) == 2

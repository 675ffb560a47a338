"""The paper's alignment: right where its assumptions hold, and it says so where they do not."""

from dataclasses import replace

import numpy as np
import pytest

from builders import faces_plan, moved_plan
from planfit.alignment import align_paper, sample_walls
from planfit.alignment.paper import boundary_scan, floorplan_3d, main_direction
from planfit.errors import ScanError
from planfit.findings import PlanKind
from planfit.floorplan import nearest_faces
from planfit.geometry import se3

# An L: no turn brings it onto itself.
PLAN = faces_plan([[0, 0], [12, 0], [12, 4], [5, 4], [5, 9], [0, 9]], "L")


def scanned(plan, faces, rng):
    """Points of walls and floor, and the walls, of some faces."""
    walls = sample_walls(plan.normals[faces], plan.ends[faces], 0.05)
    n = 8
    points = np.repeat(np.column_stack([walls.xy, np.zeros(len(walls.xy))]), n, axis=0)
    points[:, 2] = rng.uniform(0.0, 2.6, len(points))
    floor = np.column_stack(
        [rng.uniform(0.5, 4.5, (3 * len(points), 2)), np.zeros(3 * len(points))]
    )
    return np.concatenate([points, floor]), walls


@pytest.mark.parametrize("yaw", [0.0, 1.7, -2.4])
def test_a_whole_scan_is_aligned_with_its_scale(rng, yaw):
    points, walls = scanned(PLAN, np.arange(6), rng)
    level_from_plan = se3.yaw_transform(yaw, np.array([3.0, -2.0, 0.0]))
    points = se3.transform(level_from_plan, points)
    rotation, translation = level_from_plan[:2, :2], level_from_plan[:2, 3]
    walls = replace(
        walls, xy=walls.xy @ rotation.T + translation, normals=walls.normals @ rotation.T
    )
    plan = replace(PLAN, ends=PLAN.ends / 0.02, is_metric=False)
    found = align_paper(points, walls, plan, rng)
    assert found.scale_xy == pytest.approx((0.02, 0.02), rel=0.02)
    off = found.plan_from_level @ level_from_plan
    assert np.linalg.norm(off[:2, 3]) < 0.2
    assert np.rad2deg(se3.rotation_angle(off[:3, :3])) < 1.0
    assert found.is_sure
    assert len(found.candidates) == 4


def test_a_partial_scan_breaks_its_first_assumption(rng):
    points, walls = scanned(PLAN, np.array([3, 4, 5]), rng)
    plan = replace(PLAN, ends=PLAN.ends / 0.02, is_metric=False)
    found = align_paper(points, walls, plan, rng)
    assert not found.is_sure
    assert any(each.kind is PlanKind.EXTENTS_DIFFER for each in found.findings)


def test_a_square_breaks_its_choice_of_rotation(rng):
    plan = faces_plan([[0, 0], [6, 0], [6, 6], [0, 6]])
    found = align_paper(*scanned(plan, np.arange(4), rng), plan, rng)
    assert any(each.kind is PlanKind.ROTATIONS_ALIKE for each in found.findings)


def test_walls_of_many_directions_break_its_right_angles(rng):
    angle = np.arange(12) * np.pi / 6 + 0.1
    ring = faces_plan(5 * np.column_stack([np.cos(angle), np.sin(angle)]))
    found = align_paper(*scanned(ring, np.arange(12), rng), ring, rng)
    assert any(each.kind is PlanKind.FEW_RIGHT_ANGLES for each in found.findings)


def test_floor_and_outliers_are_no_boundary(rng):
    points, _ = scanned(PLAN, np.arange(6), rng)
    furniture = rng.uniform([1, 1, 0.3], [4, 8, 1.0], (60, 3))
    kept = boundary_scan(np.concatenate([points, furniture]))
    assert kept[:, 2].min() > 0.15
    off = nearest_faces.nearest_distance(kept[:, :2], PLAN.ends)
    assert np.mean(off > 0.1) < 0.002


def test_the_3d_floorplan_is_uniform_on_the_walls(rng):
    points = floorplan_3d(PLAN, 0.5, 2.5, rng)
    assert nearest_faces.nearest_distance(points[:, :2], PLAN.ends).max() < 1e-9
    assert (points[:, 2].min(), points[:, 2].max()) == pytest.approx((0.5, 2.5), abs=0.01)
    on_longest = np.mean(np.abs(points[:, 1]) < 1e-9)
    assert on_longest == pytest.approx(PLAN.lengths[0] / PLAN.lengths.sum(), abs=0.02)


def test_the_main_direction_is_that_of_most_normals(rng):
    angle = np.deg2rad(23.0) + rng.integers(0, 4, 500) * np.pi / 2
    angle[:50] = rng.uniform(0, 2 * np.pi, 50)
    found, share = main_direction(np.column_stack([np.cos(angle), np.sin(angle)]))
    assert np.rad2deg(found) == pytest.approx(23.0, abs=0.3)
    assert 0.9 < share < 0.95


def test_a_scan_without_walls_above_the_floor_is_refused(rng):
    floor = np.column_stack([rng.uniform(0, 5, (500, 2)), np.zeros(500)])
    _, walls = scanned(PLAN, np.arange(6), rng)
    with pytest.raises(ScanError, match="expected walls above the floor, found 0 points"):
        align_paper(floor, walls, PLAN, rng)


def test_a_plan_in_metres_keeps_its_scale_wherever_it_lies(rng):
    move = se3.yaw_transform(0.6, np.array([50.0, 20.0, 0.0]))
    points, walls = scanned(PLAN, np.arange(6), rng)
    found = align_paper(points, walls, moved_plan(PLAN, move), rng)
    assert found.scale_xy == (1.0, 1.0)
    assert found.score < 1.0

"""Which face a wall patch may belong to: side, angle, overlap, distance."""

from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import faces_plan, look, make_structure, make_world, moved_plan, room_plan
from planfit.adjust import association
from planfit.adjust.association import AssociationOptions, associate, wall_patches_in_plan
from planfit.floorplan import Floorplan
from planfit.geometry import se3

CAMERA_POSE = look([3, 2, 1.5], 90)[None]


def line(first, last, z=1.2, n=30):
    t = np.linspace(0, 1, n)[:, None]
    xy = np.array(first) * (1 - t) + np.array(last) * t
    return np.column_stack([xy, np.full(n, z)])


def matched(floorplan, first, last, normal, max_distance_m=0.5, **options):
    """Face and signed distance of one wall patch from `first` to `last`, seen along -normal."""
    structure = make_structure(
        CAMERA_POSE, patches=[(0, line(first, last), np.array(normal, dtype=float))]
    )
    found = associate(
        structure.walls, floorplan, CAMERA_POSE, max_distance_m, AssociationOptions(**options)
    )
    return int(found.face_idx[0]), float(found.distance_m[0])


def test_every_wall_finds_its_face(rng):
    world = make_world(rng)
    found = associate(
        world.structure.walls, world.floorplan, world.plan_from_cams, 0.5, AssociationOptions()
    )
    frame = np.arange(8).repeat(2)
    expected = np.stack([frame[::2] % 4, (frame[::2] + 1) % 4], axis=1).ravel()
    assert_array_equal(found.face_idx, expected)
    assert_allclose(found.distance_m, 0.0, atol=1e-9)
    assert found.n_associated == 16


def test_distance_is_signed_along_the_normal():
    assert matched(room_plan(), [1, 0.2], [3, 0.2], [0, 1]) == (0, pytest.approx(0.2))
    assert matched(room_plan(), [1, -0.2], [3, -0.2], [0, 1]) == (0, pytest.approx(-0.2))


def test_max_distance():
    assert matched(room_plan(), [1, 0.2], [3, 0.2], [0, 1], max_distance_m=0.21)[0] == 0
    face, distance = matched(room_plan(), [1, 0.2], [3, 0.2], [0, 1], max_distance_m=0.19)
    assert face == -1
    assert np.isnan(distance)


def test_the_opposite_face_is_not_matched():
    # A wall 0.2 m thick; the far face is nearer to where drift has put the scanned wall.
    ends = np.array([[[0, 0], [5, 0]], [[0, -0.2], [5, -0.2]]], dtype=float)
    plan = Floorplan.from_segments(ends, name="two faces")
    assert plan.is_oriented.all()
    face, distance = matched(plan, [1, -0.15], [3, -0.15], [0, 1])
    assert face == 0
    assert distance == pytest.approx(-0.15)
    face, distance = matched(plan, [1, -0.05], [3, -0.05], [0, -1])
    assert face == 1


def test_a_face_of_unknown_side_is_matched_from_either():
    plan = Floorplan.from_segments([[[0, 0], [5, 0]]], name="stroke")
    assert not plan.is_oriented.any()
    assert matched(plan, [1, 0.1], [3, 0.1], [0, 1])[0] == 0
    assert matched(plan, [1, 0.1], [3, 0.1], [0, -1])[0] == 0


def test_max_angle_deg():
    tilt = np.deg2rad(8.0)
    normal, along = [-np.sin(tilt), np.cos(tilt)], np.array([np.cos(tilt), np.sin(tilt)])
    first, last = [2, 0] - 0.5 * along, [2, 0] + 0.5 * along
    assert matched(room_plan(), first, last, normal)[0] == 0
    with patch.object(association, "MAX_ANGLE_DEG", 7.5):
        assert matched(room_plan(), first, last, normal)[0] == -1


def test_min_overlap():
    # Two metres of wall, 0.8 m of which are beside the face and 0.3 m in its margin.
    first, last = [5.2, 0], [7.2, 0]
    assert matched(room_plan(), first, last, [0, 1])[0] == 0
    with patch.object(association, "MIN_OVERLAP", 0.6):
        assert matched(room_plan(), first, last, [0, 1])[0] == -1


def test_end_margin_m_is_a_length():
    first, last = [5.5, 0], [6.5, 0]
    long = faces_plan([[0, 0], [60, 0], [60, 4], [0, 4]])
    with patch.object(association, "MIN_OVERLAP", 0.75):
        assert matched(room_plan(), first, last, [0, 1])[0] == 0
        with patch.object(association, "END_MARGIN_M", 0.2):
            assert matched(room_plan(), first, last, [0, 1])[0] == -1
            # Ten times the face, the same margin.
            assert matched(long, [59.5, 0], [60.5, 0], [0, 1])[0] == -1


def test_a_wall_beyond_the_end_of_a_face_is_not_matched():
    assert matched(room_plan(), [7, 0], [9, 0], [0, 1])[0] == -1


def test_the_nearest_of_several_faces_wins():
    ends = np.array([[[0, 0], [5, 0]], [[0, 0.3], [5, 0.3]], [[0, 2], [5, 2]]], dtype=float)
    plan = Floorplan("stripes", ends, np.tile([0.0, 1.0], (3, 1)), np.ones(3, dtype=bool))
    assert matched(plan, [1, 0.1], [3, 0.1], [0, 1])[0] == 0
    assert matched(plan, [1, 0.2], [3, 0.2], [0, 1])[0] == 1


def test_moving_scan_and_plan_together_changes_nothing(rng):
    world = make_world(rng)
    move = se3.yaw_transform(0.7, np.array([12.0, -40.0, 0.0]))
    poses = se3.retract(world.plan_from_cams, rng.normal(0, 0.05, (8, 6)))
    here = associate(world.structure.walls, world.floorplan, poses, 0.5, AssociationOptions())
    there = associate(
        world.structure.walls,
        moved_plan(world.floorplan, move),
        move @ poses,
        0.5,
        AssociationOptions(),
    )
    assert_array_equal(here.face_idx, there.face_idx)
    assert_allclose(here.distance_m, there.distance_m, atol=1e-9)


def test_no_patches_no_association():
    found = associate(
        make_structure(CAMERA_POSE).walls, room_plan(), CAMERA_POSE, 0.5, AssociationOptions()
    )
    assert found.n_associated == 0
    assert found.face_idx.shape == (0,)


def test_many_patches_are_done_in_parts_with_the_same_answer(rng):
    patches = [
        (0, line([1, y], [3, y], n=3), np.array([0.0, 1.0])) for y in rng.uniform(-1, 1, 2100)
    ]
    structure = make_structure(CAMERA_POSE, patches=patches)
    found = associate(structure.walls, room_plan(), CAMERA_POSE, 0.5, AssociationOptions())
    y = np.array([points[0, 1] for _, points, _ in patches])
    assert_array_equal(found.face_idx, np.where(np.abs(y) < 0.5, 0, -1))
    assert_allclose(found.distance_m[np.abs(y) < 0.5], y[np.abs(y) < 0.5], atol=1e-9)


def test_wall_patches_in_plan_are_unit_normals_and_true_ends(rng):
    world = make_world(rng)
    tilted = se3.retract(world.plan_from_cams, np.tile([0.1, -0.1, 0, 0, 0, 0], (8, 1)))
    normals, _ = wall_patches_in_plan(world.structure.walls, tilted)
    assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    normals, ends = wall_patches_in_plan(world.structure.walls, world.plan_from_cams)
    faces = np.stack([np.arange(8) % 4, (np.arange(8) + 1) % 4], axis=1).ravel()
    assert_allclose(normals, world.floorplan.normals[faces], atol=1e-9)
    gap = np.einsum("kei,ki->ke", ends, world.floorplan.normals[faces])
    assert_allclose(gap - world.floorplan.offsets[faces][:, None], 0.0, atol=1e-9)

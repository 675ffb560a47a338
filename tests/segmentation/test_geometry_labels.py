"""Floor, wall and ceiling by geometry alone, against the true surface of every pixel."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import look, room_scan
from planfit.geometry import se3
from planfit.runtime import Runtime
from planfit.scan import Label
from planfit.scan.views import FilesView
from planfit.segmentation import (
    Gravity,
    SegmentationOptions,
    back_ends,
    choose_back_end,
)
from planfit.segmentation.label_kernels import CELL_M, label_level, label_walls
from planfit.segmentation.visibility_map import Submap

POSE = look([1.0, 2.0, 1.5], 10, 20)
TABLE = ((2.5, 1.0, 0.0), (3.5, 2.0, 0.8))
CUPBOARD = ((5.3, 1.0, 0.0), (6.0, 3.0, 2.0))
ROOM_TOP = 2.6


def labelled(poses=(POSE,), boxes=(), holes=(), room_from_world=None, frame=0):
    """Labels of one frame of a scan of the room, and its points in the room."""
    room_from_world = np.eye(4) if room_from_world is None else room_from_world
    scan = room_scan(np.stack(poses), room_from_world, boxes=boxes, holes=holes)
    chosen = SegmentationOptions(back_end="geometry")
    up = Gravity(room_from_world[2, :3], 1.0, "known")
    depth = scan.files.depth(frame)
    labels = choose_back_end(scan, up, chosen, Runtime(1)).labels(frame, depth)
    points = scan.cameras[frame].lift_image(depth).reshape(-1, 3)
    return labels, se3.transform(poses[frame], points).reshape(*depth.shape, 3)


def iou(found, true):
    return np.sum(found & true) / np.sum(found | true)


def views(pitch_deg, n=8, at=(1.5, 2.0, 1.5)):
    return [
        look([at[0] + 0.1 * i, at[1] + 0.05 * i, at[2]], 8 * i - 30, pitch_deg) for i in range(n)
    ]


def surfaces(points):
    """The room's floor, walls and ceiling among points (h, w, 3) of a room without furniture."""
    floor, ceiling = points[..., 2] < 0.01, points[..., 2] > ROOM_TOP - 0.01
    return floor, ~floor & ~ceiling, ceiling


@pytest.mark.parametrize("pitch_deg", [-20.0, 0.0, 20.0, 35.0])
def test_floor_walls_and_ceiling_of_an_empty_room(pitch_deg):
    labels, points = labelled(views(pitch_deg))
    assert labels.shape == points.shape[:2]
    assert labels.dtype == np.uint8
    for label, true in zip((Label.FLOOR, Label.WALL, Label.CEILING), surfaces(points), strict=True):
        if true.sum() > 1000:
            assert iou(labels == label, true) > 0.9
        else:
            assert np.sum(labels == label) < 1500


def test_walls_whose_tops_are_never_in_view_are_walls():
    labels, points = labelled(views(40.0))
    _, wall, _ = surfaces(points)
    assert points[..., 2].max() < 1.3
    assert wall.sum() > 1000
    found = labels == Label.WALL
    assert not np.any(found & ~wall)
    assert np.mean(found[wall]) > 0.7  # but for corners where less than min_wall_rise_m is in view


def test_a_table_is_neither():
    labels, points = labelled(views(20.0), boxes=[TABLE])
    low, high = np.array(TABLE)
    inside = np.all((points[..., :2] > low[:2] + 0.1) & (points[..., :2] < high[:2] - 0.1), axis=-1)
    top = inside & (np.abs(points[..., 2] - 0.8) < 0.02)
    assert top.sum() > 50
    assert np.mean(labels[top] == Label.NONE) > 0.95
    front = (
        (np.abs(points[..., 0] - low[0]) < 0.02) & (points[..., 2] > 0.35) & (points[..., 2] < 0.7)
    )
    front &= (points[..., 1] > low[1]) & (points[..., 1] < high[1])
    assert front.sum() > 50
    assert np.mean(labels[front] == Label.WALL) < 0.01


def share_of_front(poses, frame=0):
    labels, points = labelled(poses, [CUPBOARD], frame=frame)
    front = (np.abs(points[..., 0] - CUPBOARD[0][0]) < 0.02) & (points[..., 2] > 0.4)
    front &= points[..., 2] < 1.8
    assert front.sum() > 300
    return np.mean(labels[front] == Label.WALL)


def test_a_cupboard_that_is_seen_over_is_no_wall_in_frames_that_do_not_see_over_it():
    down, level = (
        look([2.0, 2.0, 1.6], 0, 30),
        [look([2.0, 1.6 + 0.05 * i, 1.6], 0, -12) for i in range(8)],
    )
    assert share_of_front([down]) > 0.8  # it alone cannot know
    assert share_of_front([down, *level]) < 0.1


def test_free_above_m():
    level = [look([2.0, 1.6 + 0.05 * i, 1.6], 0, -12) for i in range(8)]
    with patch.multiple(back_ends, _FREE_ABOVE_M=0.15):
        assert share_of_front(level) < 0.1
    with patch.multiple(back_ends, _FREE_ABOVE_M=2.0):
        assert share_of_front(level) > 0.8


def test_submap_frames_is_how_far_lines_of_sight_are_shared():
    down = look([2.0, 2.0, 1.6], 0, 30)
    level = [look([2.0, 1.6 + 0.05 * i, 1.6], 0, -12) for i in range(8)]
    poses = [*[down] * 4, *level]
    with patch.multiple(back_ends, _SUBMAP_FRAMES=12):
        assert share_of_front(poses) < 0.1
    with patch.multiple(back_ends, _SUBMAP_FRAMES=2):
        assert share_of_front(poses) > 0.8


def test_min_wall_rise_m():
    with patch.multiple(back_ends, _MIN_WALL_RISE_M=9.0):
        labels, _ = labelled(views(20.0))
    assert not np.any(labels == Label.WALL)
    assert np.any(labels == Label.FLOOR)


def test_a_ceiling_is_not_the_floor():
    labels, points = labelled(views(-30.0))
    assert not np.any(labels[points[..., 2] > 2.5] == Label.FLOOR)
    assert np.mean(labels[points[..., 2] > 2.59] == Label.CEILING) > 0.95


def test_holes_have_no_label_and_spoil_little():
    holes = [(60, 80), (61, 80), (90, 20)]
    labels, _ = labelled(views(20.0), holes=holes)
    whole, _ = labelled(views(20.0))
    assert np.mean(labels == whole) > 0.97
    assert all(labels[hole] == Label.NONE for hole in holes)


def test_a_tilted_world_gives_the_same_labels():
    room_from_world = se3.make_transform(
        se3.exp_so3(np.array([0.4, -0.3, 1.0])), np.array([3.0, -2, 7])
    )
    straight, _ = labelled(views(20.0))
    tilted, _ = labelled(views(20.0), room_from_world=room_from_world)
    assert np.mean(straight == tilted) > 0.97


def test_max_tilt_deg():
    off = se3.make_transform(se3.exp_so3(np.array([np.deg2rad(9.0), 0, 0])), np.zeros(3))
    scan = room_scan(np.stack(views(20.0)))

    def wall(max_tilt_deg):
        options = SegmentationOptions(back_end="geometry")
        gravity = Gravity(off[2, :3], 1.0, "9 deg off")
        with (
            patch.object(back_ends, "MAX_TILT_DEG", max_tilt_deg),
            patch.object(back_ends, "MAX_TILT_DEG", max_tilt_deg),
        ):
            back_end = choose_back_end(scan, gravity, options, Runtime(1))
            labels = back_end.labels(0, scan.files.depth(0))
        return np.mean(labels == Label.WALL)

    assert wall(15.0) > wall(3.0) + 0.1


def test_floor_band_m_is_about_the_floors_height():
    step = ((2.0, 1.0, 0.0), (4.0, 3.0, 0.12))

    def share(band_m):
        with patch.multiple(back_ends, _FLOOR_BAND_M=band_m):
            labels, points = labelled(views(25.0), [step])
        top = np.abs(points[..., 2] - 0.12) < 0.005
        assert top.sum() > 300
        return np.mean(labels[~top & (points[..., 2] < 0.01)] == Label.FLOOR), np.mean(
            labels[top] == Label.FLOOR
        )

    assert share(0.05)[0] + share(0.05)[1] > 0.9
    narrow = min(share(0.05))
    assert narrow < 0.1


def test_tolerance_and_growth_fill_what_normals_leave():
    poses = views(20.0)
    grown, points = labelled(poses)
    with patch.multiple(back_ends, _GROW_PX=1):
        bare, _ = labelled(poses)
    with patch.multiple(back_ends, _TOLERANCE_M=1e-4, _TOLERANCE_PER_M2=0.0):
        tight, _ = labelled(poses)
    with patch.multiple(back_ends, _TOLERANCE_M=0.2):
        wide, _ = labelled(poses)
    n = [np.sum(x == Label.WALL) for x in (grown, bare, tight, wide)]
    assert n[0] > n[1]
    assert n[0] >= n[2]
    # A tolerance of 20 cm lets the floor grow up the foot of the walls.
    assert np.sum((wide == Label.FLOOR) & (points[..., 2] > 0.05)) > np.sum(
        (grown == Label.FLOOR) & (points[..., 2] > 0.05)
    )


def test_a_larger_radius_is_steadier():
    with patch.multiple(back_ends, _NORMAL_RADIUS_PX=2):
        fine, _ = labelled(views(20.0))
    with patch.multiple(back_ends, _NORMAL_RADIUS_PX=8):
        blurred, _ = labelled(views(20.0))
    assert 0.8 < np.mean(fine == blurred) < 1.0


def wild_surfaces(rng, shape=(40, 60)):
    """Points about the origin and normals that face anywhere, a tenth of each NaN."""
    points = rng.uniform(-2, 2, (*shape, 3)).astype(np.float32)
    normals = rng.normal(size=(*shape, 3))
    normals = (normals / np.linalg.norm(normals, axis=-1, keepdims=True)).astype(np.float32)
    points[rng.random(shape) < 0.1] = np.nan
    normals[rng.random(shape) < 0.1] = np.nan
    return points, normals


def test_walls_are_laid_as_in_numpy(rng):
    points, normals = wild_surfaces(rng)
    cells = rng.random((50, 43)) < 0.5
    submap = Submap(np.array([-1.0, 0.5]), np.packbits(cells, axis=1), 43, 0.0, np.zeros(0))
    centre = np.array([0.4, 1.5, 1.2])
    with np.errstate(invalid="ignore"):
        cell = np.floor((points[..., :2] + centre[:2] - submap.low_xy) / CELL_M)
        inside = (cell >= 0).all(axis=-1) & (cell < cells.shape).all(axis=-1)
        is_upright = np.abs(normals[..., 2]) < 0.5
    i, j = np.where(inside[..., None], cell, 0).astype(int).transpose(2, 0, 1)
    is_wall = is_upright & inside & cells[i, j]
    assert 50 < is_wall.sum() < 2000
    level = normals[..., :2] / np.linalg.norm(normals[..., :2], axis=-1, keepdims=True)
    expected = np.zeros((*is_wall.shape, 4))
    expected[is_wall, :2] = level[is_wall]
    expected[is_wall, 3] = np.sum(level * points[..., :2], axis=-1)[is_wall]
    labels, planes = np.zeros(is_wall.shape, np.uint8), np.zeros((*is_wall.shape, 4), np.float32)
    on_wall = submap.wall_at(points[..., :2] + centre[:2])
    label_walls(labels, planes, points, normals, 0.5, on_wall, int(Label.WALL))
    assert_array_equal(labels, np.where(is_wall, Label.WALL, Label.NONE))
    assert_allclose(planes, expected, atol=1e-5)


@pytest.mark.parametrize("facing", [1.0, -1.0])
def test_a_level_is_laid_as_in_numpy(rng, facing):
    points, normals = wild_surfaces(rng)
    plane = np.array([0.02, -0.01, 1.0, 0.3], np.float32)
    tolerance = rng.uniform(0.1, 0.8, points.shape[:2]).astype(np.float32)
    near = rng.random(points.shape[:2]) < 0.7
    with np.errstate(invalid="ignore"):
        off = np.abs(points @ plane[:3] - plane[3])
        on_it = near & (off < tolerance) & ~(facing * normals[..., 2] < 0.7)
    assert on_it[np.isnan(normals[..., 2])].any()
    labels, planes = np.full(on_it.shape, Label.WALL, np.uint8), np.zeros((*on_it.shape, 4))
    planes = planes.astype(np.float32)
    label_level(
        labels, planes, points, np.ascontiguousarray(normals[..., 2]), near, tolerance, plane,
        np.float32(facing), int(Label.FLOOR),
    )  # fmt: skip
    assert_array_equal(labels, np.where(on_it, Label.FLOOR, Label.WALL))
    assert_array_equal(planes, np.where(on_it[..., None], plane, np.float32(0)))


def test_depth_of_frames_that_submaps_share_is_decoded_once():
    scan = room_scan(np.stack(views(10.0, 12)))
    decoded = []

    class Counted(FilesView):
        def depth(self, frame_idx):
            decoded.append(frame_idx)
            return super().depth(frame_idx)

    options = SegmentationOptions(back_end="geometry")
    up = Gravity(np.array([0.0, 0.0, 1.0]), 1.0, "known")
    with patch.object(back_ends, "_SUBMAP_FRAMES", 4):
        choose_back_end(replace(scan, files=Counted(scan.files)), up, options, Runtime(1))
    assert sorted(decoded) == list(range(12))

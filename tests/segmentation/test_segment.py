"""Floor points and wall patches of a room, in camera frames, from either back end."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import NoFiles, look, make_matches, room_plan, room_scan
from planfit.adjust.association import wall_patches_in_plan
from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.pipeline.together.joined import join_structures
from planfit.runtime import Runtime
from planfit.runtime.mapped import CAN_LET_GO, is_mapped
from planfit.scan import Label
from planfit.segmentation import ArrayBackEnd, Gravity, SegmentationOptions, segment, segment_scan

VIEWS = np.stack([look([2 + 0.3 * i, 1.6, 1.4], 60 * i, 12) for i in range(6)])
UP = Gravity(np.array([0, 0, 1.0]), 1.0, "known")
SMALL = SegmentationOptions(max_points_per_frame=400)


def extracted(scan, options=SMALL, runtime=None):
    return segment_scan(scan, UP, options, runtime or Runtime(2))


class Masked(NoFiles):
    """The room's files with true masks."""

    def __init__(self, scan):
        self._scan = scan

    def depth(self, i):
        return self._scan.files.depth(i)

    def labels(self, i):
        scan = self._scan
        points = scan.cameras[i].lift_image(self.depth(i)).reshape(-1, 3)
        z = se3.transform(VIEWS[i], points)[:, 2].reshape(120, 160)
        labels = np.full(z.shape, Label.WALL, dtype=np.uint8)
        labels[z < 0.02] = Label.FLOOR
        labels[z > 2.58] = Label.CEILING
        return labels


@pytest.fixture(scope="module")
def scan():
    return room_scan(VIEWS)


@pytest.fixture(scope="module")
def masked(scan):
    return replace(scan, files=Masked(scan), has_labels=True, fingerprint="masked")


@pytest.mark.parametrize("back_end", ["masks", "geometry"])
def test_points_are_where_the_floor_and_the_walls_are(scan, masked, back_end):
    found = extracted(masked if back_end == "masks" else scan)
    assert found.back_end == back_end
    poses = VIEWS[found.floor.frame_idx]
    floor = se3.transform(poses, found.floor.points_cam[:, None])[:, 0]
    assert len(floor) > 500
    assert np.median(np.abs(floor[:, 2])) < 0.005
    assert found.floor_height_m == pytest.approx(0.0, abs=0.01)
    wall = se3.transform(VIEWS[found.walls.point_frame_idx], found.walls.points_cam[:, None])[:, 0]
    assert len(wall) > 500
    plan = room_plan()
    distance = np.abs(wall[:, :2] @ plan.normals.T - plan.offsets).min(axis=1)
    assert np.quantile(distance, 0.99) < 0.03


@pytest.mark.parametrize("back_end", ["masks", "geometry"])
def test_patches_lie_on_the_walls_seen_from_inside(scan, masked, back_end):
    found = extracted(masked if back_end == "masks" else scan)
    assert len(found.walls) >= 6
    normals, ends = wall_patches_in_plan(found.walls, VIEWS)
    plan = room_plan()
    cosine = normals @ plan.normals.T
    face = cosine.argmax(axis=1)
    assert cosine.max(axis=1).min() > np.cos(np.deg2rad(2.0))
    gap = np.einsum("kei,ki->ke", ends, plan.normals[face]) - plan.offsets[face][:, None]
    assert np.abs(gap).max() < 0.05
    assert_array_equal(np.unique(face), np.arange(4))


def test_the_index_arrays_fit_together(scan):
    found = extracted(scan)
    assert found.floor.start[-1] == len(found.floor.points_cam) == len(found.floor.frame_idx)
    assert found.walls.start[-1] == len(found.walls.points_cam) == len(found.walls.point_frame_idx)
    assert len(found.walls.start) == len(found.walls) + 1
    assert found.walls.normals_cam.shape == (len(found.walls), 3)
    assert found.walls.ends_cam.shape == (len(found.walls), 2, 3)
    assert len(found.floor.start) == len(scan) + 1
    assert len(found.unassigned_points_cam) == len(found.unassigned_frame_idx)
    assert np.all(np.diff(found.walls.frame_idx) >= 0)
    assert_allclose(np.linalg.norm(found.walls.normals_cam, axis=1), 1.0)


def test_threads_and_cache_do_not_change_the_result(scan, tmp_path):
    one = extracted(scan)
    for _ in range(2):
        two = extracted(scan, runtime=Runtime(1, tmp_path))
        assert_array_equal(one.floor.points_cam, two.floor.points_cam)
        assert_array_equal(one.walls.points_cam, two.walls.points_cam)
        assert_array_equal(one.walls.ends_cam, two.walls.ends_cam)


def test_no_floor_is_supposed_where_poses_were_recorded_in_the_axes_of_the_plan():
    up = np.stack([look([3, 2, 1.4], 0, -89.0)] * 2)
    found = extracted(replace(room_scan(up), plan_from_world_axes=np.eye(4)))
    assert np.isnan(found.floor_height_m)


def test_a_world_with_another_up_and_origin(scan):
    room_from_world = se3.make_transform(
        se3.exp_so3(np.array([np.pi / 2, 0, 0])), np.array([1.0, 2, 5])
    )
    moved = room_scan(VIEWS, room_from_world, fingerprint="moved")
    gravity = Gravity(room_from_world[2, :3], 1.0, "known")
    found = segment_scan(moved, gravity, SMALL, Runtime(2))
    assert found.floor_height_m == pytest.approx(-5.0, abs=0.01)
    assert len(found.walls) == len(extracted(scan).walls)


def test_a_view_without_floor_and_walls_is_empty():
    up = np.stack([look([3, 2, 1.4], 0, -89.0)] * 2)
    found = extracted(room_scan(up))
    assert len(found.walls) == 0
    assert len(found.floor.points_cam) == 0
    # Supposed below the camera, at 1.4 m.
    assert found.floor_height_m == pytest.approx(0.1, abs=0.2)
    assert found.walls.ends_cam.shape == (0, 2, 3)
    assert found.walls.points_cam.shape == (0, 3)


def test_masks_where_there_are_none_are_an_error_and_not_a_silent_change(scan):
    with pytest.raises(ScanError, match="room: expected floor and wall masks"):
        extracted(scan, replace(SMALL, back_end="masks"))


def test_geometry_is_used_where_asked_for_in_spite_of_masks(masked):
    assert extracted(masked, replace(SMALL, back_end="geometry")).back_end == "geometry"
    assert extracted(masked, replace(SMALL, back_end="masks")).back_end == "masks"


def test_max_points_per_frame(scan):
    found = extracted(scan, SegmentationOptions(max_points_per_frame=50))
    assert np.diff(found.floor.start).max() <= 50
    per_frame = np.bincount(found.walls.point_frame_idx, minlength=6) + np.bincount(
        found.unassigned_frame_idx, minlength=6
    )
    assert per_frame.max() <= 50


def test_max_depth_m(scan):
    near, far = extracted(scan, replace(SMALL, max_depth_m=2.5)), extracted(scan)
    for points in (near.floor.points_cam, near.walls.points_cam):
        assert 2.3 < points[:, 2].max() < 2.5
    assert far.floor.points_cam[:, 2].max() > 2.5
    assert far.walls.points_cam[:, 2].max() > 2.5


def n_points(scan, **options):
    found = extracted(scan, SegmentationOptions(**({"max_points_per_frame": 10**6} | options)))
    return (
        len(found.floor.points_cam) + len(found.walls.points_cam) + len(found.unassigned_points_cam)
    )


def test_stride_px(scan):
    assert n_points(scan, stride_px=6) == pytest.approx(n_points(scan, stride_px=3) / 4, rel=0.1)


def test_erode_px(masked):
    def with_erosion(erode_px):
        with patch.object(segment, "_ERODE_PX", erode_px):
            return n_points(masked)

    assert with_erosion(8) < 0.9 * with_erosion(0)


def test_edge_step():
    table = room_scan(VIEWS, boxes=[((3.5, 2.0, 0), (4.5, 3.0, 0.8))], fingerprint="table")
    masked = replace(table, files=Masked(table), has_labels=True)

    def with_edges(edge_step):
        with patch.object(segment, "_EDGE_STEP", edge_step):
            return n_points(masked)

    assert with_edges(0.005) < with_edges(10.0)


def test_another_seed_chooses_other_points(scan):
    few = replace(SMALL, max_points_per_frame=60)
    one = extracted(scan, few)
    assert_array_equal(one.floor.points_cam, extracted(scan, few).floor.points_cam)
    with patch.object(segment, "SEED", 1):
        other = extracted(scan, few)
    assert not np.array_equal(one.floor.points_cam, other.floor.points_cam)


def test_unmatched_builders_agree(rng):
    # The builder of exact matches is itself checked here, as other tests lean on it.
    points = rng.uniform(0, 3, (4, 3))
    matches = make_matches(VIEWS, [(0, 3)], points)
    assert_allclose(se3.transform(VIEWS[0], matches.points_a), points)
    assert_allclose(se3.transform(VIEWS[3], matches.points_b), points)


def test_labels_from_memory_are_those_of_masks_on_disk(masked):
    labels = np.stack([masked.files.labels(i) for i in range(len(masked))])
    from_memory = segment_scan(masked, UP, SMALL, Runtime(2), ArrayBackEnd(labels))
    expected = extracted(masked)
    assert len(expected.walls) > 0
    assert_array_equal(from_memory.walls.points_cam, expected.walls.points_cam)
    assert_array_equal(from_memory.floor.points_cam, expected.floor.points_cam)
    assert_array_equal(from_memory.ceiling.points_cam, expected.ceiling.points_cam)


def test_other_labels_from_memory_are_another_entry_of_the_cache(masked, tmp_path):
    labels = np.stack([masked.files.labels(i) for i in range(len(masked))])
    runtime = Runtime(2, tmp_path)
    some = segment_scan(masked, UP, SMALL, runtime, ArrayBackEnd(labels))
    none = segment_scan(masked, UP, SMALL, runtime, ArrayBackEnd(np.zeros_like(labels)))
    assert some.has_floor
    assert not none.has_floor
    assert not none.has_walls


def test_labels_that_do_not_fit_the_scan_are_refused(scan):
    n = len(scan)
    with pytest.raises(ScanError, match="0 to 5"):
        ArrayBackEnd(np.full((n, 120, 160), 6, np.uint8))
    with pytest.raises(ScanError, match="0 to 5"):
        ArrayBackEnd(np.full((n, 120, 160), -1))
    with pytest.raises(ScanError, match="each frame"):
        segment_scan(scan, UP, SMALL, Runtime(1), ArrayBackEnd(np.ones((2, 120, 160), np.uint8)))
    with pytest.raises(ScanError, match="160 x 120"):
        segment_scan(scan, UP, SMALL, Runtime(1), ArrayBackEnd(np.ones((n, 60, 80), np.uint8)))


def test_points_are_float32_and_the_same_bits_in_a_file(scan, tmp_path, monkeypatch):
    in_memory = extracted(scan)
    monkeypatch.setattr("planfit.runtime.mapped.MIN_BYTES", 1000)
    monkeypatch.setattr("planfit.runtime.mapped.ROWS_AT_A_TIME", 100)
    mapped = extracted(scan, runtime=Runtime(1, tmp_path))
    assert is_mapped(mapped.floor.points_cam) == CAN_LET_GO
    for one, other in (
        (in_memory.floor.points_cam, mapped.floor.points_cam),
        (in_memory.walls.points_cam, mapped.walls.points_cam),
        (in_memory.unassigned_points_cam, mapped.unassigned_points_cam),
    ):
        assert one.dtype == other.dtype == np.float32
        assert_array_equal(one, other)


def test_points_of_several_scans_stay_in_files(scan, monkeypatch):
    monkeypatch.setattr("planfit.runtime.mapped.MIN_BYTES", 1000)
    found = extracted(scan)
    both = join_structures([found, found], 0.0)
    assert is_mapped(both.floor.points_cam) == CAN_LET_GO
    assert_array_equal(both.floor.points_cam[len(found.floor) :], found.floor.points_cam)

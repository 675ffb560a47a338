"""Scans as one: frames, files, matches, structure and tracking keep what they are; no step leads across."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.matching import Matches
from planfit.pipeline.together.joined import APART_M, join_structures, join_trackings
from planfit.scan import scan_from_arrays
from planfit.scan.joined import join_scans, short_names
from planfit.scan.odometry import OdometryOptions
from planfit.scan.views import select_frames
from planfit.segmentation import LevelPoints, Structure, WallPatches
from planfit.tracking import believe


def make(name, n, size=(32, 24), has_color=True, seed=0):
    rng = np.random.default_rng(seed)
    w, h = size
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, 0, 3] = np.arange(n) * 0.2
    colors = rng.integers(0, 255, (n, h, w, 3), dtype=np.uint8) if has_color else None
    depths = (
        np.full((n, h, w), 2.0, dtype=np.float32) + np.arange(n, dtype=np.float32)[:, None, None]
    )
    camera = Camera(w, h, float(w), float(w), (w - 1) / 2, (h - 1) / 2)
    return scan_from_arrays(colors, depths, camera, poses, name=name)


def test_frames_keep_their_images_and_say_whose_they_are(tmp_path):
    one, other = make("/data/A", 3), make("/data/B", 4, (48, 36), has_color=False)
    moved = se3.yaw_transform(0.7, np.array([5.0, 1.0, 0.0]))
    joined, frames = join_scans([one, other], ["A", "B"], [np.eye(4), moved])
    assert joined.frame_ids[2:4] == ("A/000002", "B/000000")
    assert [(own.first, own.last) for own in frames] == [(0, 2), (3, 6)]
    assert joined.files.color(2).shape == (24, 32, 3)
    assert joined.files.color(3) is None
    assert joined.files.depth(5)[0, 0] == pytest.approx(4.0)
    assert joined.has_color
    assert joined.cameras[3].width == 48
    np.testing.assert_allclose(joined.world_from_cams[4], moved @ other.world_from_cams[1])
    # Of some frames, too; and poses are written for each scan apart.
    some = select_frames(joined, np.array([1, 4]), joined.world_from_cams[[1, 4]])
    assert some.files.depth(1)[0, 0] == pytest.approx(3.0)
    joined.files.write_poses(tmp_path, joined.world_from_cams)
    assert (tmp_path / "A" / "trajectory.tum").exists()
    assert len((tmp_path / "B" / "trajectory.tum").read_text().splitlines()) >= 4


def test_names_are_as_short_as_they_can_be():
    named = [make(path, 1) for path in ("/a/monday/scan", "/a/friday/scan")]
    assert short_names(named) == ("monday_scan", "friday_scan")
    assert short_names([make("/a/A", 1), make("/b/B", 1)]) == ("A", "B")


def test_a_scan_given_twice_is_refused():
    with pytest.raises(ScanError, match="found this one twice"):
        short_names([make("/a/A", 1), make(str(Path("/a/b/../A")), 1)])


def test_matches_of_both_are_sorted_by_pair():
    rng = np.random.default_rng(1)
    one, other = (
        Matches.from_arrays(np.array(pairs), rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), 0.01)
        for pairs in ([[0, 1], [4, 5], [4, 5]], [[0, 4], [1, 5], [1, 5]])
    )
    both = one.joined(other)
    assert both.pairs.tolist() == [[0, 1], [0, 4], [1, 5], [4, 5]]
    assert np.diff(both.start).tolist() == [1, 1, 2, 2]
    np.testing.assert_array_equal(both.points_a[1], other.points_a[0])
    np.testing.assert_array_equal(both.points_b[4:], one.points_b[1:])
    assert len(Matches.none().joined(one).pairs) == 2


def test_structures_stand_one_after_the_other():
    one, other = (structure(n_frames, points) for n_frames, points in ((2, 3), (3, 5)))
    both = join_structures([one, replace(other, back_end="geometry")], 0.25)
    assert len(both.floor.start) == 6
    assert both.floor.frame_idx.tolist() == [0] * 3 + [2] * 5
    assert both.walls.frame_idx.tolist() == [1, 4]
    assert both.unassigned_frame_idx.tolist() == [0, 2]
    assert both.back_end == "geometry"
    assert both.floor_height_m == 0.25


def structure(n_frames, n_points):
    rng = np.random.default_rng(n_points)
    floor = LevelPoints(rng.normal(size=(n_points, 3)), np.r_[0, np.full(n_frames, n_points)])
    walls = WallPatches(
        rng.normal(size=(n_points, 3)),
        np.array([0, n_points]),
        np.array([n_frames - 1]),
        np.array([[1.0, 0.0, 0.0]]),
        rng.normal(size=(1, 2, 3)),
    )
    return Structure(
        floor=floor,
        floor_heights_m=np.zeros(n_frames),
        walls=walls,
        unassigned_points_cam=np.zeros((1, 3)),
        unassigned_frame_idx=np.array([0]),
        ceiling=floor,
        columns=walls,
        back_end="masks",
        floor_height_m=0.0,
    )


def test_no_step_leads_from_scan_to_scan():
    scans = [make("/a/A", 3), make("/b/B", 4)]
    worlds = [np.eye(4), se3.yaw_transform(1.0, np.array([30.0, 0.0, 0.0]))]
    _, frames = join_scans(scans, ["A", "B"], worlds)
    trackings = [believe(scan.world_from_cams, "recorded", OdometryOptions()) for scan in scans]
    joined = join_trackings(trackings, frames, worlds)
    assert joined.odometry.sigma_translation[2] == APART_M
    assert np.delete(joined.odometry.sigma_translation, 2).max() < 0.1
    assert joined.open_steps.tolist() == [2]
    # Nothing was tracked between the scans, but both have a place.
    assert joined.unplaced == ()


def test_frames_lost_within_a_scan_stay_without_a_place():
    scans = [make("/a/A", 9), make("/b/B", 6)]
    worlds = [np.eye(4), np.eye(4)]
    _, frames = join_scans(scans, ["A", "B"], worlds)
    first, second = (believe(scan.world_from_cams, "recorded", OdometryOptions()) for scan in scans)
    lost = replace(first, open_steps=np.array([6]))
    # The last two frames of A, just before B begins, are of neither.
    assert join_trackings([lost, second], frames, worlds).unplaced == ((7, 8),)

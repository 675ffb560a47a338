"""Tables that the apps themselves wrote, with images of the right size beside them where those were left out.

The images are made: what is tested is that nothing in a real table is refused, and what it says.
"""

import os
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from planfit.errors import ScanError
from planfit.scan import read_scan
from planfit.scan.formats.bag import open_bag
from planfit.scan.formats.bag_poses import read_tf
from planfit.scan.formats.colmap_model import read_model, write_model
from planfit.scan.pose_files import read_poses
from planfit.scan.source import FolderSource
from scan_samples import jpg, png, put, write_video

DATA = Path(os.environ.get("PLANFIT_SHARED", Path(__file__).parents[2].parent / "shared" / "data"))
REAL = DATA / "real_files"

pytestmark = [
    pytest.mark.shared,
    pytest.mark.skipif(not REAL.is_dir(), reason="no real files: set PLANFIT_SHARED"),
]


def gray(width, height, value=90):
    return np.full((height, width, 3), value, np.uint8)


def depth_mm(width, height):
    return np.full((height, width), 2000, np.uint16)


@pytest.mark.parametrize("kind", ["eyeq_9col", "srivabhi22_15col"])
def test_stray_scanner(kind, tmp_path):
    folder = tmp_path / "scan"
    shutil.copytree(REAL / "stray_scanner" / kind, folder, copy_function=shutil.copy)
    lines = (folder / "odometry.csv").read_text().splitlines()
    rows = [[word.strip() for word in line.split(",")] for line in lines[1:7]]
    put(folder / "odometry.csv", "\n".join(lines[:7]) + "\n")
    write_video(folder / "rgb.mp4", [gray(1920, 1440, 20 * i) for i in range(6)], first=-1)
    for i in range(6):
        if not (folder / "depth" / f"{i:06d}.png").exists():
            put(folder / "depth" / f"{i:06d}.png", png(depth_mm(256, 192)))
    scan = read_scan(folder)
    assert scan.skipped == ()
    assert scan.frame_ids == tuple(f"{i:06d}" for i in range(6))
    assert_allclose(scan.timestamps, [float(row[0]) for row in rows])
    assert_allclose(scan.world_from_cams[:, :3, 3], np.array([row[2:5] for row in rows], float))
    scale = 1920 / scan.cameras[0].width
    shared = float((folder / "camera_matrix.csv").read_text().split(",")[0])
    expected = [float(row[9]) for row in rows] if len(rows[0]) == 15 else [shared] * 6
    assert_allclose([camera.fx * scale for camera in scan.cameras], expected)
    # Neither looks at the sky. The first phone is held across: its picture's down is the world's.
    assert (np.abs(scan.world_from_cams[:, 1, 2]) < 0.8).all()
    if kind == "eyeq_9col":
        assert (scan.world_from_cams[:, 1, 1] < -0.99).all()
    assert np.nanmedian(scan.files.depth(1)) == 2.0


def test_record3d_as_exr_and_jpg():
    pytest.importorskip("OpenEXR")
    scan = read_scan(REAL / "record3d" / "exr_rgb" / "EXR_RGBD")
    assert scan.frame_ids == ("0", "1")  # the others were left out of the copy
    assert len(scan.skipped) == 343
    assert 0.2 < np.nanmedian(scan.files.depth(0)) < 0.3
    assert scan.files.color(0).shape[0] > scan.files.color(0).shape[1]
    # Portrait images, and poses of them: up in the picture is up in the world.
    assert (scan.world_from_cams[:, 1, 1] < -0.5).all()


@pytest.mark.parametrize(("kind", "frame", "n"), [("corridor", 156, 1), ("chair_scan", 0, 0)])
def test_scanner_app(kind, frame, n, tmp_path):
    """Two of three frames have no picture in the corridor; the chair's was left out of the copy."""
    folder = tmp_path / "scan"
    shutil.copytree(REAL / "scanner3d_app" / kind, folder, copy_function=shutil.copy)
    if n == 0:
        put(folder / f"frame_{frame:05d}.jpg", jpg(gray(1920, 1440)))
    scan = read_scan(folder)
    whole = scan.lacking.index("")
    assert scan.frame_ids[whole] == f"{frame:05d}"
    assert len(scan) == 1 + n
    assert all("is missing" in line for line in scan.skipped)
    depth = scan.files.depth(whole)
    assert 0.5 < np.nanmedian(depth) < 5.0
    # Held across: the picture's down is the world's; confidence 0 is left out.
    assert scan.world_from_cams[whole, 1, 1] < -0.7
    confidence = cv2.imread(str(folder / f"conf_{frame:05d}.png"), -1)
    assert set(np.unique(confidence)) <= {0, 1, 2}
    small = depth[1::2, 1::2] if depth.shape[0] == 2 * confidence.shape[0] else None
    if small is not None:
        assert not np.isfinite(small[confidence == 0]).any()


@pytest.mark.parametrize(
    ("name", "kind", "n", "first"),
    [
        ("trajectory/evo/KITTI_00_gt.txt", "kitti", 200, 0),
        ("trajectory/evo/fr2_desk_groundtruth.txt", "tum", 197, 1311868163.8696),
        ("trajectory/evo/freiburg1_xyz-ORB_kf_mono.txt", "tum", 32, 1305031110.043299),
        ("trajectory/evo/V102_groundtruth.csv", "tum", 199, 1403715524.907143),
        ("trajectory/open3d/trajectory.log", "log", 211, 0),
        ("rtabmap/rtabmap_poses_tum.txt", "tum", 267, 0.002667),
    ],
)
def test_trajectories_of_other_programs(name, kind, n, first):
    table = read_poses(REAL / name)
    assert (table.kind, len(table.poses)) == (kind, n)
    assert table.keys[0] == pytest.approx(first, abs=1e-3)
    # All of these begin or go on as rigid motions of a few metres a step at most.
    steps = np.linalg.norm(np.diff(table.poses[:, :3, 3], axis=0), axis=1)
    assert np.median(steps) < 2.0


@pytest.mark.parametrize(
    ("name", "children"),
    [
        ("tf_example.bag", {"base_link", "odom"}),
        ("tf_example", {"base_link", "odom"}),
        ("nav2_turtlebot.mcap", {"base_link"}),
    ],
)
def test_transforms_of_real_bags(name, children):
    path = REAL / "ros_bag" / "evo" / name
    reader = open_bag(path)
    tree = read_tf(reader)
    reader.close()
    assert tree
    for edge in tree.values():
        turns = np.array(edge.parent_from_child)[:, :3, :3]
        assert_allclose(
            turns @ turns.transpose(0, 2, 1), np.tile(np.eye(3), (len(turns), 1, 1)), atol=1e-6
        )
    with pytest.raises(ScanError, match="expected image topics of colour and depth, found /"):
        read_scan(path)


@pytest.mark.parametrize(
    ("name", "n", "n_seen"), [("splatam_bin_cut", 10, 1430), ("arkit_text", 20, 0)]
)
def test_colmap_models(name, n, n_seen, tmp_path):
    source = FolderSource(REAL / "colmap" / name)
    cameras, images = read_model(source, observations=True)
    assert (len(images), len(images[0].uv)) == (n, n_seen)
    write_model(tmp_path, list(cameras.values()), images)
    again_cameras, again = read_model(FolderSource(tmp_path), observations=True)
    assert again_cameras == cameras
    for old, new in zip(images, again, strict=True):
        assert (old.name, old.camera_id) == (new.name, new.camera_id)
        assert_allclose(old.world_from_cam, new.world_from_cam, atol=1e-8)

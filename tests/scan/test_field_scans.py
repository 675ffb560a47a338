"""Scans as people have them (PLANFIT_SHARED): each is read as its maker's notes say it is right."""

import os
from pathlib import Path

import numpy as np
import pytest

from planfit.errors import ScanError
from planfit.scan import ScanOptions, read_scan
from planfit.scan.statistics import path_statistics

REAL = (
    Path(os.environ.get("PLANFIT_SHARED", Path(__file__).parents[2].parent / "shared" / "data"))
    / "field/scans"
)
pytestmark = pytest.mark.skipif(
    not REAL.is_dir(), reason="no scans of others: set PLANFIT_SHARED to their folder"
)
COMMAS = "decimal-comma-trajectory"


def read(path, poses="", **options):
    poses_path = REAL / poses if poses else None
    return read_scan(REAL / path, options=ScanOptions(poses=poses_path, **options))


@pytest.mark.parametrize("kind", ["space.txt", "tab.txt", "semicolon.csv", "kitti.txt"])
def test_decimal_commas_are_read(kind):
    scan = read(COMMAS, f"{COMMAS}/poses_{kind}")
    np.testing.assert_allclose(scan.world_from_cams, read(COMMAS).world_from_cams, atol=1e-5)


@pytest.mark.parametrize(
    ("path", "form", "n_frames", "length_m", "warnings"),
    [
        ("orbslam-associations", "tum", 40, 9.955, 0),
        ("scannet-frames-25k/scene0000_00", "scannet", 40, 9.955, 0),
        ("rtabmap-export-no-prefix", "rtabmap-export", 5, 0.979, 0),
        ("nerfstudio-float-tiff", "nerfstudio", 5, 0.979, 0),
        ("nerfstudio-npy-mm", "nerfstudio", 40, 9.955, 1),
        ("bag-odometry-beside-tf-static/odometry_and_tf_static", "bag", 12, 2.259, 1),
        ("bag-odometry-beside-tf-static/zed_pose_and_tf_static", "bag", 12, 2.259, 2),
    ],
)
def test_folders_and_bags_of_other_programs(path, form, n_frames, length_m, warnings):
    scan = read(path)
    assert (scan.format, len(scan), len(scan.warnings)) == (form, n_frames, warnings)
    assert path_statistics(scan).length_m == pytest.approx(length_m, abs=0.002)
    assert 0.5 < np.nanmedian(scan.files.depth(0)) < 3


def test_bags_that_lack_something(tmp_path):
    folder = "bag-odometry-beside-tf-static"
    with pytest.raises(ScanError, match=r"no /tf_static was recorded"):
        read(f"{folder}/tf_without_tf_static")
    with pytest.raises(ScanError, match="--intrinsics"):
        read(f"{folder}/no_camera_info")
    lens = tmp_path / "lens.txt"
    lens.write_text("123.189197 123.189197 79.5 59.5\n")
    scan = read(f"{folder}/no_camera_info", intrinsics=str(lens))
    right = read(f"{folder}/odometry_and_tf_static")
    np.testing.assert_allclose(scan.world_from_cams, right.world_from_cams, atol=1e-9)


@pytest.mark.parametrize(
    ("cloud", "path"),
    [
        ("ns.laz", "s.txt"),
        ("us.laz", "s.txt"),
        ("1e15.laz", "s.txt"),
        ("ns.laz", "ns.txt"),
        ("s.laz", "s_comma.txt"),
    ],
)
def test_clocks_of_clouds_in_other_units(cloud, path):
    folder = "laz-times-in-nanoseconds"
    right = read(f"{folder}/cloud_s.laz", f"{folder}/traj_s.txt")
    found = read(f"{folder}/cloud_{cloud}", f"{folder}/traj_{path}")
    np.testing.assert_allclose(found.world_from_cams, right.world_from_cams, atol=1e-3)
    np.testing.assert_allclose(found.timestamps, right.timestamps, atol=1e-3)


def test_a_trajectory_as_laz():
    folder = "laz-times-in-nanoseconds"
    scan = read(f"{folder}/cloud_s.laz", f"{folder}/traj.laz")
    assert path_statistics(scan).length_m == pytest.approx(9.7, abs=0.5)

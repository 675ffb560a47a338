"""BundleFusion's layout and its relatives: the camera is what info.txt says, never a Kinect's."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planfit.errors import ScanError
from planfit.scan import ScanOptions, read_scan
from scan_samples import (
    HEIGHT,
    WIDTH,
    N,
    jpg,
    k_of,
    matrix_text,
    png,
    put,
    write_bundlefusion,
    write_seven_scenes,
)


def write(folder, s, table="info.txt", inside="", depth_mm=None, **values):
    """As BundleFusion and 12-Scenes: depth as PNG, of one camera with colour unless `values` say more."""
    k = np.eye(4)
    k[:3, :3] = k_of(s.camera)
    lines = {"m_calibrationColorIntrinsic": " ".join(f"{v:.9g}" for v in k.ravel())} | values
    put(folder / table, "\n".join(f"{name} = {value}" for name, value in lines.items()))
    depth_mm = s.depth_mm if depth_mm is None else depth_mm
    for i, pose in enumerate(s.poses):
        put(folder / inside / f"frame-{i:06d}.color.jpg", jpg(s.color[i]))
        put(folder / inside / f"frame-{i:06d}.depth.png", png(depth_mm[i]))
        put(folder / inside / f"frame-{i:06d}.pose.txt", matrix_text(pose))


def metres(depth_mm):
    return np.where(depth_mm > 0, depth_mm / 1000, np.nan)


@pytest.mark.parametrize("table", ["info.txt", "_info.txt"])
@pytest.mark.parametrize("inside", ["", "data"])
def test_the_camera_is_that_of_the_table(table, inside, sample, tmp_path):
    write(tmp_path, sample, table, inside)
    scan = read_scan(tmp_path)
    assert (scan.format, len(scan), scan.skipped) == ("bundlefusion", N, ())
    assert scan.cameras[0].fx == pytest.approx(sample.camera.fx)
    assert_allclose(scan.world_from_cams, sample.poses, atol=1e-8)
    assert_allclose(scan.files.depth(2), metres(sample.depth_mm[2]), atol=1e-6)


def test_three_rows_and_units_of_another_size(sample, tmp_path):
    k = np.hstack([k_of(sample.camera), np.zeros((3, 1))])
    k[0, 0] *= 2
    twelve = " ".join(map(str, k.ravel()))
    write(tmp_path, sample, m_calibrationColorIntrinsic=twelve, m_depthShift="5000")
    scan = read_scan(tmp_path)
    assert scan.cameras[0].fx == pytest.approx(2 * sample.camera.fx)
    assert_allclose(scan.files.depth(2), metres(sample.depth_mm[2]) / 5, atol=1e-6)
    asked = read_scan(tmp_path, options=ScanOptions(depth_scale=0.002))
    assert_allclose(asked.files.depth(2), 2 * metres(sample.depth_mm[2]), atol=1e-6)


def test_extrinsics_of_depth_register_it(sample, tmp_path):
    flat = [np.full((HEIGHT, WIDTH), 2000, np.uint16) for _ in range(N)]
    mount = "1 0 0 0 0 1 0 0 0 0 1 0.5 0 0 0 1"
    write(tmp_path, sample, depth_mm=flat, m_calibrationDepthExtrinsic=mount)
    depth = read_scan(tmp_path).files.depth(0)
    assert_allclose(depth[HEIGHT // 2, WIDTH // 2], 2.5, atol=1e-6)
    write(tmp_path, sample, m_calibrationColorExtrinsic=mount)
    with pytest.raises(ScanError, match="m_calibrationColorExtrinsic: expected the identity"):
        read_scan(tmp_path)


def test_lost_frames_are_left_out(sample, tmp_path):
    write_bundlefusion(tmp_path, sample)
    put(tmp_path / "frame-000002.pose.txt", matrix_text(np.full((4, 4), -np.inf)))
    assert read_scan(tmp_path).frame_ids == ("000000", "000001", "000003", "000004", "000005")


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("m_calibrationColorIntrinsic", "525 0 320", "expected 16 numbers after"),
        ("m_calibrationDepthIntrinsic", "one two", "expected 16 numbers after"),
        ("m_calibrationDepthExtrinsic", "0 " * 16, "expected"),
        ("m_depthShift", "0", "say them with --depth-scale"),
        ("m_depthShift", "mm", "say them with --depth-scale"),
    ],
)
def test_a_damaged_table_says_which_line(name, value, says, sample, tmp_path):
    write(tmp_path, sample, **{name: value})
    with pytest.raises(ScanError, match=says) as error:
        read_scan(tmp_path)
    assert str(error.value).startswith(str(tmp_path / "info.txt"))


def test_another_info_beside_seven_scenes_changes_nothing(sample, tmp_path):
    write_seven_scenes(tmp_path, sample)
    put(tmp_path / "info.txt", "recorded on a Monday")
    put(tmp_path / "_info.txt", b"\xff\xfe\x00")
    assert read_scan(tmp_path).format == "7-scenes"

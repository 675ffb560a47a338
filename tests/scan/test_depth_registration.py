"""Depth of a camera beside the colour camera: what the colour camera would have measured itself."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.scan import read_scan
from planfit.scan.images.depth_registration import register_depth
from scan_samples import matrix_text, png, put

DEPTH = Camera(160, 120, 146.0, 147.0, 80.0, 59.0)
COLOR = Camera(160, 120, 131.0, 131.0, 78.5, 61.0)
COLOR_FROM_DEPTH = se3.make_transform(
    se3.exp_so3(np.array([0.01, -0.02, 0.015])), np.array([-0.06, 0.01, 0.02])
)
EDGE_M = 0.3
"""The plate ends here, and the wall begins."""


def rendered(camera, color_from_cam):
    """Depth (h, w) m of a plate at 1 m, left of x = 0.3 m, before a slanted wall at about 2.5 m."""
    rows, columns = np.mgrid[: camera.height, : camera.width]
    uv = np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float)
    rays = camera.rays(uv) @ color_from_cam[:3, :3].T  # z of the camera is 1 along each
    start = color_from_cam[:3, 3]
    to_plate = (1.0 - start[2]) / rays[:, 2]
    normal = np.array([0.2, -0.1, 1.0])
    to_wall = (2.5 - start @ normal) / (rays @ normal)
    is_plate = start[0] + to_plate * rays[:, 0] < EDGE_M
    depth = np.where(is_plate, to_plate, to_wall).reshape(camera.height, camera.width)
    return depth.astype(np.float32), is_plate.reshape(depth.shape)


def far_from(edges, n=3):
    """Pixels more than n columns from any change of a mask (h, w)."""
    near = np.zeros(edges.shape, dtype=bool)
    for row, change in zip(near, np.diff(edges.astype(int), axis=1) != 0, strict=True):
        for column in np.flatnonzero(change):
            row[max(0, column - n) : column + n + 2] = True
    return ~near


@pytest.mark.parametrize("scale", [1, 3], ids=["same size", "colour is finer"])
def test_the_colour_camera_sees_what_it_would_have_measured(scale):
    camera = COLOR.scaled(COLOR.width * scale, COLOR.height * scale)
    stored, _ = rendered(DEPTH, COLOR_FROM_DEPTH)
    wanted, is_plate = rendered(camera, np.eye(4))
    found = register_depth(stored, DEPTH, COLOR_FROM_DEPTH, camera)
    assert found.dtype == np.float32
    inner = far_from(is_plate, 3 * scale)
    border = 22 * scale  # what the depth camera, looking elsewhere, does not see
    inner[:border] = inner[-border:] = inner[:, :border] = inner[:, -border:] = False
    # Behind the plate's edge lies what only the colour camera sees: nothing may be made up there.
    hidden = inner & np.isnan(found)
    assert not (hidden & is_plate).any()
    shadow = round(camera.fx * 0.06 * (1 / 1.0 - 1 / 2.2)) + 3 * scale
    columns = np.flatnonzero(hidden.any(axis=0))
    edge = camera.fx * EDGE_M + camera.cx
    assert ((columns > edge - 3 * scale) & (columns < edge + shadow)).all()
    seen = inner & np.isfinite(found)
    assert seen.sum() > 0.75 * inner.sum()
    # Depth of a slanted wall changes within a pixel: 2 % of its depth in 3 px.
    assert_allclose(found[seen], wanted[seen], rtol=0.01)
    assert_allclose(found[seen & is_plate], 1.0, atol=1e-5)


def test_no_measurement_hangs_between_two_surfaces():
    stored, _ = rendered(DEPTH, COLOR_FROM_DEPTH)
    found = register_depth(stored, DEPTH, COLOR_FROM_DEPTH, COLOR)
    assert not ((found > 1.01) & (found < 1.9)).any()


def test_the_nearer_surface_hides_the_farther():
    depth = np.full((1, 9), np.nan, dtype=np.float32)
    camera = Camera(9, 1, 10.0, 10.0, 4.0, 0.0)
    depth[0, 3], depth[0, 4] = 2.0, 1.0  # both fall on column 4 - 2 once shifted
    color_from_depth = np.eye(4)
    color_from_depth[0, 3] = -0.2
    found = register_depth(depth, camera, color_from_depth, camera)
    assert_array_equal(np.flatnonzero(np.isfinite(found[0])), [2])
    assert found[0, 2] == 1.0


def test_a_camera_in_its_own_place_sees_its_own_depth():
    stored, _ = rendered(DEPTH, COLOR_FROM_DEPTH)
    stored[5:9, 7:30] = np.nan
    assert_allclose(register_depth(stored, DEPTH, np.eye(4), DEPTH), stored, rtol=1e-6)


def test_nothing_behind_the_camera_or_without_a_measurement_is_seen():
    behind = np.eye(4)
    behind[2, 3] = -3.0
    for depth in (np.full((120, 160), 2.0), np.zeros((120, 160)), np.full((120, 160), np.inf)):
        assert np.isnan(register_depth(depth, DEPTH, behind, COLOR)).all()


def test_a_measurement_beside_the_colour_camera_does_not_cover_the_image():
    ahead = np.eye(4)
    ahead[2, 3] = -0.3
    depth = np.full((120, 160), 2.0, dtype=np.float32)
    without = register_depth(depth, DEPTH, ahead, COLOR)
    depth[60, 80] = 0.301
    found = register_depth(depth, DEPTH, ahead, COLOR)
    assert np.count_nonzero(found != without) < np.isnan(without).sum() + 9
    assert np.nanmin(found) > 1.6


def write_kinect(folder, intrinsics):
    """Raw images of one plane at 2 m, square to the depth camera, as 7-Scenes has them."""
    poses = se3.make_transform(
        se3.exp_so3(np.array([[0.0, 0.1, 0.2], [0.3, -0.2, 0.1]])),
        np.array([[1.0, 2.0, 3.0], [1.1, 2.0, 3.0]]),
    )
    for i, pose in enumerate(poses):
        put(folder / f"frame-{i:06d}.color.png", png(np.zeros((480, 640, 3), dtype=np.uint8)))
        put(folder / f"frame-{i:06d}.depth.png", png(np.full((480, 640), 2000, dtype=np.uint16)))
        put(folder / f"frame-{i:06d}.pose.txt", matrix_text(pose))
    if intrinsics:
        f = intrinsics
        put(
            folder / "camera-intrinsics.txt",
            matrix_text(np.array([[f, 0, 320], [0, f, 240], [0, 0, 1]])),
        )
    return poses


@pytest.mark.parametrize("intrinsics", [None, 585.0])
def test_raw_frames_of_7_scenes_are_registered(intrinsics, tmp_path):
    poses = write_kinect(tmp_path, intrinsics)
    scan = read_scan(tmp_path)
    assert scan.cameras[0].fx == 525
    # The colour camera stands 2.5 cm to the right of the depth camera, whose poses are recorded.
    depth_from_color = se3.inverse(poses) @ scan.world_from_cams
    assert_allclose(depth_from_color[:, :3, 3], [[0.0256, 0, 0]] * 2, atol=2.5e-3)
    points = scan.cameras[0].lift_image(scan.files.depth(0)).reshape(-1, 3)
    seen = points[np.isfinite(points).all(axis=1)]
    assert len(seen) > 0.6 * 640 * 480
    plane = se3.transform(se3.inverse(poses[0]) @ scan.world_from_cams[0], seen)
    # A pixel takes the measurement next to it: half a pixel of a plane turned by 0.6 deg is 0.1 mm.
    assert_allclose(plane[:, 2], 2.0, atol=1e-3)


def test_frames_named_as_those_of_7_scenes_are_said_to_be_taken_for_them(tmp_path):
    """Others name frames so too; the folders of 7-Scenes itself hold no intrinsics."""
    write_kinect(tmp_path / "office", None)
    (warning,) = read_scan(tmp_path / "office").warnings
    assert "taken for the Kinect's" in warning
    for folder, intrinsics in (("seq-03", None), ("with", 585.0), ("other", 577.87)):
        write_kinect(tmp_path / folder, intrinsics)
        assert read_scan(tmp_path / folder).warnings == ()


def test_refined_poses_of_raw_frames_are_the_depth_cameras_again(tmp_path):
    poses = write_kinect(tmp_path / "in", 585.0)
    scan = read_scan(tmp_path / "in")
    (tmp_path / "out").mkdir()
    scan.files.write_poses(tmp_path / "out", scan.world_from_cams)
    for i, pose in enumerate(poses):
        assert_allclose(np.loadtxt(tmp_path / "out" / f"frame-{i:06d}.pose.txt"), pose, atol=1e-8)


def test_raw_frames_of_another_size_need_intrinsics(tmp_path):
    write_kinect(tmp_path, None)
    for path in tmp_path.glob("*.color.png"):
        path.write_bytes(png(np.zeros((720, 1280, 3), dtype=np.uint8)))
    with pytest.raises(
        ScanError, match=r"color\.png: expected 640 x 480 px .* add camera-intrinsics\.txt"
    ):
        read_scan(tmp_path)


def test_other_intrinsics_mean_depth_registered_to_colour(tmp_path):
    poses = write_kinect(tmp_path, 577.87)
    scan = read_scan(tmp_path)
    assert scan.cameras[0].fx == pytest.approx(577.87)
    assert_allclose(scan.world_from_cams, poses, atol=1e-8)
    assert_allclose(scan.files.depth(0), 2.0)

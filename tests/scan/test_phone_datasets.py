"""ScanNet with two cameras, ScanNet++, ARKitScenes, Record3D as EXR, as their own tools take them."""

import json
import zipfile

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan import read_scan
from scan_samples import (
    HEIGHT,
    WIDTH,
    N,
    k_of,
    matrix_text,
    png,
    put,
    record3d_files,
    write_arkit_scenes,
    write_nerfstudio,
    write_scannet,
    write_scannetpp,
    write_video,
)


def test_scannet_with_a_depth_camera_beside(sample, tmp_path):
    """A wall 2 m ahead of the depth camera; the colour camera stands 5 cm beside it and is turned."""
    write_scannet(tmp_path, sample)
    turn = se3.exp_so3(np.array([0.0, 0.06, 0.0]))
    color_from_depth = se3.make_transform(turn, np.array([0.05, 0.0, 0.0]))
    put(tmp_path / "intrinsic" / "extrinsic_depth.txt", matrix_text(color_from_depth))
    for i in range(N):
        put(
            tmp_path / "depth" / f"{i}.png",
            png(np.full((HEIGHT // 2, WIDTH // 2), 2000, np.uint16)),
        )
    scan = read_scan(tmp_path)
    assert_allclose(scan.world_from_cams, sample.poses, atol=2e-6)
    depth = scan.files.depth(2)
    points = scan.cameras[2].lift_image(depth).reshape(-1, 3)
    seen = points[np.isfinite(points).all(axis=1)]
    assert len(seen) > 0.5 * WIDTH * HEIGHT
    in_depth_camera = se3.transform(se3.inverse(color_from_depth), seen)
    assert_allclose(in_depth_camera[:, 2], 2.0, atol=0.01)


def test_a_picture_whose_name_is_no_number_is_none_of_scannets(sample, tmp_path):
    write_scannet(tmp_path, sample)
    # A small 2 counts as a digit in Unicode, and is no number.
    put(tmp_path / "color" / "\u00b2.jpg", (tmp_path / "color" / "0.jpg").read_bytes())
    assert len(read_scan(tmp_path)) == N


def test_scannetpp_takes_colour_from_the_video(sample, tmp_path):
    write_scannetpp(tmp_path, sample)
    phone = tmp_path / "iphone"
    by_files = [read_scan(tmp_path).files.color(i) for i in range(N)]
    for path in (phone / "rgb").iterdir():
        path.unlink()
    write_video(phone / "rgb.mkv", sample.color[:5])
    for folder in (tmp_path, phone):
        scan = read_scan(folder)
        assert scan.skipped == ("frame frame_000005: the video ends after 5 frames",)
        for i in (4, 0, 2):
            assert np.abs(scan.files.color(i).astype(int) - by_files[i]).mean() < 6


def test_scannetpp_reads_what_was_unpacked_of_it(sample, tmp_path):
    """The toolkit unpacks each tenth frame if it is asked to: the others lack nothing."""
    write_scannetpp(tmp_path, sample)
    for i in (1, 2, 4, 5):
        (tmp_path / "iphone" / "depth" / f"frame_{i:06d}.png").unlink()
        (tmp_path / "iphone" / "rgb" / f"frame_{i:06d}.jpg").unlink()
    scan = read_scan(tmp_path)
    assert scan.frame_ids == ("frame_000000", "frame_000003")
    assert scan.skipped == ()


def test_scannetpp_whose_depth_is_packed_says_how_to_unpack_it(sample, tmp_path):
    write_scannetpp(tmp_path, sample)
    for path in (tmp_path / "iphone" / "depth").iterdir():
        path.unlink()
    put(tmp_path / "iphone" / "depth.bin", bytes(100))
    with pytest.raises(ScanError, match=r"found depth\.bin alone; unpack it with the toolkit's"):
        read_scan(tmp_path)


def test_scannetpp_keeps_what_is_no_pose(sample, tmp_path):
    write_scannetpp(tmp_path, sample)
    scan = read_scan(tmp_path)
    (tmp_path / "out").mkdir()
    scan.files.write_poses(tmp_path / "out", sample.poses[::-1])
    old, new = (
        json.loads((folder / "pose_intrinsic_imu.json").read_text())
        for folder in (tmp_path / "iphone", tmp_path / "out")
    )
    assert list(old) == list(new)
    for i, name in enumerate(old):
        assert_allclose(new[name].pop("aligned_pose"), sample.poses[N - 1 - i])
        del old[name]["aligned_pose"]
    assert old == new


def test_arkit_scenes_interpolates_poses_between_its_rows(sample, tmp_path):
    """Images at 60 Hz, poses at 10: a camera that goes straight is where it must be between two rows."""
    write_arkit_scenes(tmp_path, sample)
    times = np.array([float(f"{time:.3f}") for time in sample.times])
    speed = np.array([0.3, -0.2, 0.5])
    start = times[0] - 0.01
    rows = []
    for time in start + 0.1 * np.arange(4):
        words = " ".join(f"{v:.9f}" for v in (0.0, 0.0, 0.0, *(-speed * (time - start))))
        rows.append(f"{time:.6f} {words}")
    put(tmp_path / "lowres_wide.traj", "\n".join(rows) + "\n")
    scan = read_scan(tmp_path)
    assert len(scan) == N
    expected = speed * (times - start)[:, None]
    assert_allclose(scan.world_from_cams[:, :3, 3], expected, atol=1e-4)


def test_arkit_scenes_takes_the_finest_colour_with_its_own_intrinsics(sample, tmp_path):
    write_arkit_scenes(tmp_path, sample)
    names = sorted(p.name for p in (tmp_path / "lowres_wide").iterdir())
    matrix = k_of(sample.camera)
    for name in names[::2]:  # half as often
        big = np.repeat(np.repeat(sample.color[names.index(name)], 2, axis=0), 2, axis=1)
        put(tmp_path / "vga_wide" / name, png(big))
        # Twice the size: pixel centres move by half a pixel.
        numbers = (2 * WIDTH, 2 * HEIGHT, 2 * matrix[0, 0], 2 * matrix[1, 1],
                   2 * matrix[0, 2] + 0.5, 2 * matrix[1, 2] + 0.5)  # fmt: skip
        put(tmp_path / "vga_wide_intrinsics" / f"{name[:-4]}.pincam", " ".join(map(str, numbers)))
    scan = read_scan(tmp_path)
    assert scan.lacking == ("", "colour") * 3
    assert scan.cameras[2].width == 2 * WIDTH
    assert_allclose(scan.world_from_cams, sample.poses, atol=2e-6)
    assert scan.cameras[3] == scan.cameras[2]
    scaled = scan.cameras[2].scaled(WIDTH, HEIGHT)
    assert (scaled.fx, scaled.cx) == pytest.approx((sample.camera.fx, sample.camera.cx))


def test_arkit_scenes_of_two_videos(sample, tmp_path):
    write_arkit_scenes(tmp_path, sample)
    rows = (tmp_path / "lowres_wide.traj").read_text().splitlines()
    moved = [" ".join([f"{float(row.split()[0]) + 100:.3f}", *row.split()[1:]]) for row in rows]
    put(tmp_path / "lowres_wide.traj", "\n".join(moved) + "\n")
    with pytest.raises(ScanError, match="of the same times, found none; are they of one video"):
        read_scan(tmp_path)


def write_exr(path, metres):
    import OpenEXR

    path.parent.mkdir(parents=True, exist_ok=True)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"R": metres.astype(np.float16)}).write(str(path))


def write_record3d_exr(folder, sample):
    files = record3d_files(sample)
    put(folder / "metadata.json", files["metadata"])
    for i in range(N):
        put(folder / "rgb" / f"{i}.jpg", files[f"rgbd/{i}.jpg"])
        metres = sample.small_mm[i] / 1000
        write_exr(folder / "depth" / f"{i}.exr", np.where(metres > 0, metres, np.nan))


@pytest.mark.parametrize("is_zipped", [False, True])
def test_record3d_as_exr_and_jpg(is_zipped, sample, tmp_path):
    pytest.importorskip("OpenEXR")
    folder = path = tmp_path / "EXR_RGBD"
    write_record3d_exr(folder, sample)
    if is_zipped:
        path = tmp_path / "EXR_RGBD.zip"
        with zipfile.ZipFile(path, "w") as archive:
            for file in sorted(folder.rglob("*")):
                archive.write(file, file.relative_to(tmp_path))
    scan = read_scan(path)
    assert (scan.format, len(scan), scan.skipped) == ("record3d", N, ())
    assert_allclose(scan.world_from_cams, sample.poses, atol=1e-6)
    depth = np.repeat(np.repeat(sample.small_mm[1], 2, axis=0), 2, axis=1) / 1000
    assert_allclose(scan.files.depth(1), np.where(depth > 0, depth, np.nan), rtol=1e-3)
    (tmp_path / "out").mkdir()
    scan.files.write_poses(tmp_path / "out", sample.poses[::-1])
    written = json.loads((tmp_path / "out" / "metadata.json").read_text())
    assert_allclose([pose[4:] for pose in written["poses"]], sample.poses[::-1, :3, 3])


def test_a_damaged_exr_names_the_file(sample, tmp_path):
    pytest.importorskip("OpenEXR")
    write_record3d_exr(tmp_path, sample)
    path = tmp_path / "depth" / "1.exr"
    whole = path.read_bytes()
    for data in (whole[:200], whole[: len(whole) // 2], b"", bytes(500)):
        path.write_bytes(data)
        with pytest.raises(ScanError, match=r"1\.exr: expected an OpenEXR image"):
            read_scan(tmp_path).files.depth(1)


def test_exr_without_the_library_says_what_to_install(sample, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "OpenEXR", None)
    files = record3d_files(sample)
    put(tmp_path / "metadata.json", files["metadata"])
    for i in range(N):
        put(tmp_path / "rgb" / f"{i}.jpg", files[f"rgbd/{i}.jpg"])
        put(tmp_path / "depth" / f"{i}.exr", b"v/1")
    with pytest.raises(ScanError, match=r"found none; pip install .planfit\[record3d\]"):
        read_scan(tmp_path).files.depth(0)


def test_depth_as_instant_ngp_and_nerfcapture_name_it(sample, tmp_path):
    """`depth_path`, a scale of its own, and images named without their suffix."""
    write_nerfstudio(tmp_path, sample)
    path = tmp_path / "transforms.json"
    content = json.loads(path.read_text())
    content["integer_depth_scale"] = 4.0 / 65535
    for i, frame in enumerate(content["frames"]):
        frame["depth_path"] = frame.pop("depth_file_path")
        frame["file_path"] = "./" + frame["file_path"].removesuffix(".png")
        units = np.rint(sample.depth_mm[i] / 1000 * 65535 / 4.0).clip(0, 65534).astype(np.uint16)
        put(tmp_path / frame["depth_path"], png(units))
    path.write_text(json.dumps(content))
    scan = read_scan(tmp_path)
    assert (len(scan), scan.skipped, scan.warnings) == (N, (), ())
    depth = sample.depth_mm[2] / 1000
    expected = np.where((depth > 0) & (depth < 3.99), depth, np.nan)
    found = np.where(depth < 3.99, scan.files.depth(2), np.nan)
    assert_allclose(found, expected, atol=1e-4)
    for bad in (0, "x", -1, None, [1, 2]):
        path.write_text(json.dumps({**content, "integer_depth_scale": bad}))
        with pytest.raises(ScanError, match="integer_depth_scale"):
            read_scan(tmp_path)

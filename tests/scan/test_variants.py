"""Variants of layouts as programs of others write them, which the samples of each format do not have."""

import json
import re
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from planfit.errors import ScanError
from planfit.scan import ScanOptions, read_scan
from scan_samples import (
    GL,
    HEIGHT,
    WIDTH,
    WRITERS,
    N,
    jpg,
    matrix_text,
    png,
    put,
    quaternion,
    write_arkit_scenes,
    write_colmap,
    write_polycam,
    write_redwood,
    write_rtabmap_export,
    write_scanner_app,
    write_stray,
    write_tum,
)

MANY = 12
"""Frames enough for names of one and of two digits."""


@pytest.fixture
def many(sample):
    """A sample of more frames, which show the same places again."""
    poses = np.concatenate([sample.poses, sample.poses])
    poses[:, 0, 3] += np.arange(MANY)
    return replace(sample, color=sample.color * 2, depth_mm=sample.depth_mm * 2, poses=poses)


def test_redwood_with_names_that_are_not_padded(many, tmp_path):
    # 10.png stands before 2.png by letters, and the log counts frames.
    log = []
    for i, pose in enumerate(many.poses):
        put(tmp_path / "color" / f"{i}.png", png(many.color[i]))
        put(tmp_path / "depth" / f"{i}.png", png(many.depth_mm[i]))
        log.append(f"{i} {i} {i + 1}\n{matrix_text(pose)}")
    put(tmp_path / "trajectory.log", "".join(log))
    scan = read_scan(tmp_path)
    assert scan.frame_ids == tuple(str(i) for i in range(MANY))
    assert_allclose(scan.world_from_cams, many.poses, atol=1e-8)


def test_colmap_with_names_that_are_not_padded(many, tmp_path):
    c, lines = many.camera, []
    for i, pose in enumerate(many.poses):
        put(tmp_path / "images" / f"frame_{i}.jpg", jpg(many.color[i]))
        put(tmp_path / "depth" / f"frame_{i}.png", png(many.depth_mm[i]))
        cam_from_world = np.linalg.inv(pose)
        x, y, z, w = quaternion(cam_from_world)
        words = " ".join(f"{v:.12f}" for v in (w, x, y, z, *cam_from_world[:3, 3]))
        lines.append(f"{MANY - i} {words} 1 frame_{i}.jpg\n\n")
    put(tmp_path / "images.txt", "".join(lines))
    put(tmp_path / "points3D.txt", "")
    camera = f"1 PINHOLE {WIDTH} {HEIGHT} {c.fx} {c.fy} {c.cx + 0.5} {c.cy + 0.5}\n"
    put(tmp_path / "cameras.txt", camera)
    scan = read_scan(tmp_path)
    assert scan.frame_ids == tuple(f"frame_{i}" for i in range(MANY))
    assert_allclose(scan.world_from_cams, many.poses, atol=1e-8)


def test_polycam_with_corrected_depth_and_frames_that_were_not_corrected(sample, tmp_path):
    write_polycam(tmp_path, sample)
    keyframes = tmp_path / "keyframes"
    names = sorted(path.stem for path in (keyframes / "cameras").iterdir())
    moved = np.eye(4)
    moved[0, 3] = 2.0
    for i, name in enumerate(names[:-1]):
        content = json.loads((keyframes / "cameras" / f"{name}.json").read_text())
        gl = moved @ sample.poses[i] @ GL
        content |= {f"t_{r}{k}": gl[r, k] for r in range(3) for k in range(4)}
        put(keyframes / "corrected_cameras" / f"{name}.json", json.dumps(content))
        put(keyframes / "corrected_images" / f"{name}.jpg", jpg(sample.color[i]))
        put(keyframes / "corrected_depth" / f"{name}.png", png(sample.small_mm[i] + 100))
        for folder in ("depth", "corrected_depth", "confidence"):
            put(keyframes / folder / f"{name}.Clean.png", b"")
    scan = read_scan(tmp_path)
    assert scan.frame_ids == tuple(names[:-1])
    assert scan.skipped == (
        f"frame {names[-1]}: keyframes/corrected_cameras/{names[-1]}.json is missing",
    )
    assert_allclose(scan.world_from_cams, moved @ sample.poses[:-1], atol=1e-6)
    depth = scan.files.depth(0)
    known = np.isfinite(depth)
    near = np.repeat(np.repeat(sample.small_mm[0], 2, axis=0), 2, axis=1)[known] / 1000 + 0.1
    assert_allclose(depth[known], near, atol=1e-4)


def test_polycam_given_as_its_folder_of_keyframes(sample, tmp_path):
    write_polycam(tmp_path, sample)
    scan = read_scan(tmp_path / "keyframes")
    assert (scan.format, len(scan), scan.skipped) == ("polycam", N, ())
    assert_allclose(scan.world_from_cams, read_scan(tmp_path).world_from_cams)


@pytest.fixture
def recorded(sample, tmp_path):
    """Images in the layout of TUM without poses, and the trajectory that ORB-SLAM made of them."""
    write_tum(tmp_path / "scan", sample)
    trajectory = tmp_path / "CameraTrajectory.txt"
    (tmp_path / "scan" / "groundtruth.txt").rename(trajectory)
    return tmp_path / "scan", trajectory


def test_tum_with_the_trajectory_of_a_tracker(sample, recorded):
    folder, trajectory = recorded
    scan = read_scan(folder, options=ScanOptions(poses=trajectory))
    assert (scan.format, len(scan), scan.skipped) == ("tum", N, ())
    assert_allclose(scan.world_from_cams, sample.poses, atol=1e-6)


def test_tum_without_any_poses(recorded):
    with pytest.raises(ScanError, match=r"poses in groundtruth.txt, found none; .* --poses FILE$"):
        read_scan(recorded[0])


def test_tum_with_a_trajectory_without_times(recorded, sample):
    folder, trajectory = recorded
    rows = [" ".join(f"{v:.9f}" for v in pose[:3].ravel()) for pose in sample.poses]
    trajectory.write_text("\n".join(rows[1:]) + "\n")
    with pytest.raises(ScanError, match="expected poses with times"):
        read_scan(folder, options=ScanOptions(poses=trajectory))


def transforms(sample, folder, order, **more):
    """transforms.json of NeRFCapture: names without a suffix, times, intrinsics of each frame."""
    c, frames = sample.camera, []
    for i in order:
        put(folder / "images" / f"{i}.png", png(sample.color[i]))
        put(folder / "images" / f"{i}.depth.png", png(sample.depth_mm[i]))
        frames.append(
            {
                "file_path": f"images/{i}", "depth_path": f"images/{i}.depth.png",
                "transform_matrix": (sample.poses[i] @ GL).tolist(), "timestamp": 5000.25 + i / 4,
                "fl_x": c.fx, "fl_y": c.fy, "cx": c.cx + 0.5, "cy": c.cy + 0.5, "w": WIDTH, "h": HEIGHT,
            }
        )  # fmt: skip
    put(folder / "transforms.json", json.dumps({"frames": frames, **more}))
    return frames


def test_frames_of_nerf_capture_in_the_order_they_were_taken(sample, tmp_path):
    # The app adds a frame to the list when its picture is written, in whatever order that ends.
    transforms(sample, tmp_path, [1, 0, 2, 5, 3, 4])
    scan = read_scan(tmp_path)
    assert_allclose(scan.world_from_cams, sample.poses, atol=1e-6)
    assert_allclose(np.diff(scan.timestamps), 0.25)


@pytest.mark.parametrize("times", [[1.0] * N, [None] * N, [1, 2, 3, 4, 5, "6"]])
def test_frames_without_a_clock_keep_the_order_of_the_list(sample, tmp_path, times):
    frames = transforms(sample, tmp_path, range(N))
    for frame, time in zip(frames, times, strict=True):
        frame["timestamp"] = time
    put(tmp_path / "transforms.json", json.dumps({"frames": frames}))
    assert_allclose(read_scan(tmp_path).world_from_cams, sample.poses, atol=1e-6)


def test_names_with_backslashes(sample, tmp_path):
    frames = transforms(sample, tmp_path, range(N))
    for i, frame in enumerate(frames):
        frame |= {"file_path": f".\\images\\{i}.png", "depth_path": f"images\\{i}.depth.png"}
    put(tmp_path / "transforms.json", json.dumps({"frames": frames}))
    scan = read_scan(tmp_path)
    assert (len(scan), scan.skipped) == (N, ())


@pytest.mark.parametrize("model", ["SIMPLE_RADIAL", "RADIAL"])
def test_radial_lenses_of_nerfstudio(sample, tmp_path, model):
    transforms(sample, tmp_path, range(N), camera_model=model, k1=0.0)
    assert len(read_scan(tmp_path)) == N


def test_nerf_capture_without_its_depth(sample, tmp_path):
    # The app's own recordings name depth that they do not hold; streams have it.
    transforms(sample, tmp_path, range(N))
    for file in (tmp_path / "images").glob("*.depth.png"):
        file.unlink()
    with pytest.raises(ScanError, match=r"frame images_0: images/0\.depth\.png is missing"):
        read_scan(tmp_path)


def half_size(sample, i):
    depth = np.repeat(np.repeat(sample.small_mm[i], 2, axis=0), 2, axis=1) / 1000
    return np.where(depth > 0, depth, np.nan)


@pytest.mark.parametrize("channels", [{"R": 1}, {"RGB": 3}], ids=["one channel", "three"])
def test_3d_scanner_app_with_depth_as_exr(sample, tmp_path, channels):
    exr = pytest.importorskip("OpenEXR")
    write_scanner_app(tmp_path, sample)
    ((name, n),) = channels.items()
    for i, path in enumerate(sorted(tmp_path.glob("depth_*.png"))):
        metres = (sample.small_mm[i] / 1000).astype(np.float32)
        plane = metres if n == 1 else np.repeat(metres[..., None], n, axis=2)
        header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
        exr.File(header, {name: plane}).write(str(path.with_suffix(".exr")))
        path.unlink()
    scan = read_scan(tmp_path, options=ScanOptions(min_confidence=0))
    assert (scan.format, len(scan), scan.skipped, scan.warnings) == ("scanner-app", N, (), ())
    assert_allclose(scan.files.depth(2), half_size(sample, 2), atol=1e-5)
    first = min(tmp_path.glob("depth_*.exr"))
    for damaged in (b"no image", first.read_bytes()[:400]):
        first.write_bytes(damaged)
        with pytest.raises(ScanError, match=rf"{first.name}: expected an OpenEXR image"):
            read_scan(tmp_path).files.depth(0)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("layout", ["nerfstudio", "colmap"])
def test_depth_as_numbers_in_metres(sample, tmp_path, layout, kind):
    WRITERS[layout](tmp_path, sample)
    for i, path in enumerate(sorted((tmp_path / "depth").glob("*.png"))):
        np.save(path.with_suffix(".npy"), (sample.depth_mm[i] / 1000).astype(kind))
        path.unlink()
    if layout == "nerfstudio":
        content = (tmp_path / "transforms.json").read_text()
        renamed = re.sub(r"(depth/frame_\d+)\.png", r"\1.npy", content)
        (tmp_path / "transforms.json").write_text(renamed)
    scan = read_scan(tmp_path)
    assert (len(scan), scan.warnings) == (N, ())
    depth = np.where(sample.depth_mm[1] > 0, sample.depth_mm[1] / 1000, np.nan)
    assert_allclose(scan.files.depth(1), depth, atol=1e-5)
    scaled = read_scan(tmp_path, options=ScanOptions(depth_scale=0.5))
    assert_allclose(scaled.files.depth(1), depth / 2, atol=1e-5)


@pytest.mark.parametrize("kind", [np.uint16, np.float32])
def test_stray_scanner_with_depth_as_numbers_in_millimetres(sample, tmp_path, kind):
    pytest.importorskip("av")
    write_stray(tmp_path, sample)
    for i, path in enumerate(sorted((tmp_path / "depth").glob("*.png"))):
        np.save(path.with_suffix(".npy"), sample.small_mm[i].astype(kind))
        path.unlink()
    scan = read_scan(tmp_path, options=ScanOptions(min_confidence=0))
    assert (len(scan), scan.warnings) == (N, ())
    assert_allclose(scan.files.depth(2), half_size(sample, 2), atol=1e-5)


def test_stray_scanner_without_the_library_for_its_video_is_depth_alone(
    sample, tmp_path, monkeypatch
):
    pytest.importorskip("av")
    write_stray(tmp_path, sample)
    options = ScanOptions(min_confidence=0)
    whole = read_scan(tmp_path, options=options)
    monkeypatch.setitem(sys.modules, "av", None)
    scan = read_scan(tmp_path, options=options)
    assert not scan.has_color
    assert scan.files.color(2) is None
    (warning,) = scan.warnings
    assert "pip install 'planfit[video]'" in warning
    assert_allclose(scan.world_from_cams, whole.world_from_cams)
    depth_m = np.where(sample.small_mm[2] > 0, sample.small_mm[2] / 1000, np.nan)
    assert_allclose(scan.files.depth(2), depth_m, atol=1e-5)
    camera, of_colour = scan.cameras[2], whole.cameras[2].scaled(WIDTH // 2, HEIGHT // 2)
    assert (camera.width, camera.height) == (WIDTH // 2, HEIGHT // 2)
    assert_allclose(camera.matrix, of_colour.matrix)
    assert scan.fingerprint != whole.fingerprint
    (tmp_path / "rgb.mp4").write_bytes(b"cut off")
    with pytest.raises(ScanError, match="expected a video"):
        read_scan(tmp_path)


def test_3d_scanner_app_is_read_in_the_order_of_its_numbers(sample, tmp_path):
    write_scanner_app(tmp_path, sample)
    first = sorted(tmp_path.glob("frame_*.json"))[0]
    content = json.loads(first.read_text())
    first.write_text(json.dumps({**content, "time": content["time"] + 1000.0}))
    ids = read_scan(tmp_path).frame_ids
    assert list(ids) == sorted(ids)


@pytest.mark.parametrize("is_depth_first", [False, True])
@pytest.mark.parametrize(
    ("list_name", "poses_name"),
    [("associations.txt", "CameraTrajectory.txt"), ("associate.txt", "room.gt.freiburg")],
)
def test_tum_with_a_list_of_pairs(is_depth_first, list_name, poses_name, sample, tmp_path):
    """ORB-SLAM's input and output, and ICL-NUIM's."""
    path, out = tmp_path / "scan", tmp_path / "out"
    write_tum(path, sample)
    rows = zip(
        *((path / f"{n}.txt").read_text().splitlines()[1:] for n in ("rgb", "depth")), strict=False
    )
    order = slice(None, None, -1 if is_depth_first else 1)
    listed = [
        row
        for row in rows
        if not row[1].startswith("#") and "rgb/" in row[0] and "depth/" in row[1]
    ]
    put(path / list_name, "\n".join(" ".join(row[order]) for row in listed) + "\n")
    (path / "groundtruth.txt").rename(path / poses_name)
    for name in ("rgb.txt", "depth.txt"):
        (path / name).unlink()
    scan = read_scan(path)
    assert (scan.format, scan.warnings) == ("tum", ())
    assert len(scan) == len(listed)
    shown = [int(np.argmin(np.abs(sample.times - t))) for t in scan.timestamps]
    assert_allclose(scan.world_from_cams, sample.poses[shown], atol=1e-6)
    assert scan.files.color(0) is not None
    out.mkdir()
    scan.files.write_poses(out, scan.world_from_cams)
    assert [p.name for p in out.iterdir()] == [poses_name]
    if poses_name.endswith(".freiburg"):
        (path / "calibration.txt").unlink()
        assert read_scan(path).warnings[0].endswith("those of ICL-NUIM")


@pytest.mark.parametrize("name", ["intrinsics_{}.txt", "intrinsic_{}.txt"])
def test_scannet_as_its_frames_of_25k(name, sample, tmp_path):
    path = tmp_path / "scan"
    WRITERS["scannet"](path, sample)
    for kind in ("color", "depth"):
        (path / f"intrinsic/intrinsic_{kind}.txt").rename(path / name.format(kind))
    for i in reversed(range(N)):
        for folder, end in (("color", "jpg"), ("depth", "png"), ("pose", "txt")):
            (path / folder / f"{i}.{end}").rename(path / folder / f"{100 * i:06d}.{end}")
    scan = read_scan(path)
    assert scan.frame_ids == tuple(f"{100 * i:06d}" for i in range(N))
    assert_allclose(scan.world_from_cams, sample.poses, atol=1e-6)
    assert_allclose(scan.cameras[0].fx, sample.camera.fx)


def test_rtabmap_with_poses_of_its_base(sample, tmp_path):
    path, out = tmp_path / "scan", tmp_path / "out"
    write_rtabmap_export(path, sample, of_camera=False)
    scan = read_scan(path)
    assert "robot's base" in scan.warnings[0]
    assert_allclose(scan.world_from_cams, sample.poses, atol=1e-6)
    out.mkdir()
    scan.files.write_poses(out, scan.world_from_cams)
    again, before = ((p / "walk_poses.txt").read_text().splitlines() for p in (out, path))
    assert [line.split()[-1] for line in again] == [line.split()[-1] for line in before]
    numbers = [np.loadtxt(lines) for lines in (again, before)]
    assert_allclose(numbers[0], numbers[1], atol=1e-6)


@pytest.mark.parametrize("suffix", [".npy", ".tif"])
@pytest.mark.parametrize(("scale", "unit"), [(1.0, 1e3), (1e3, 1.0)])
def test_nerfstudio_with_floating_point_depth(suffix, scale, unit, sample, tmp_path):
    """Metres, as apps write; millimetres, as nerfstudio has them."""
    WRITERS["nerfstudio"](tmp_path, sample)
    content = json.loads((tmp_path / "transforms.json").read_text())
    content.pop("integer_depth_scale", None)
    for i, frame in enumerate(content["frames"]):
        image = (sample.depth_mm[i] / 1e3 * scale).astype(np.float32)
        frame["depth_file_path"] = f"depth/{i}{suffix}"
        (tmp_path / "depth").mkdir(exist_ok=True)
        if suffix == ".npy":
            np.save(tmp_path / frame["depth_file_path"], image)
        else:
            cv2.imwrite(str(tmp_path / frame["depth_file_path"]), image)
    put(tmp_path / "transforms.json", json.dumps(content))
    scan = read_scan(tmp_path)
    assert [("millimetres" in w) for w in scan.warnings] == ([True] if scale > 1 else [])
    expected = np.where(sample.depth_mm[0] > 0, sample.depth_mm[0] / 1e3, np.nan)
    assert_allclose(scan.files.depth(0), expected, rtol=1e-5)
    said = read_scan(tmp_path, options=ScanOptions(depth_scale=unit / 1e3))
    assert said.warnings == ()
    assert_allclose(said.files.depth(0), expected, rtol=1e-5)


def test_open3d_with_a_trajectory_as_json(sample, tmp_path):
    path, out = tmp_path / "scan", tmp_path / "out"
    write_redwood(path, sample)
    intrinsic = json.loads((path / "camera_intrinsic.json").read_text())
    cameras = [
        {"class_name": "PinholeCameraParameters", "intrinsic": intrinsic,
         "extrinsic": np.linalg.inv(pose).ravel(order="F").tolist()}
        for pose in sample.poses
    ]  # fmt: skip
    for name in ("camera_intrinsic.json", "trajectory.log"):
        (path / name).unlink()
    put(path / "trajectory.json", json.dumps({"parameters": cameras}))
    scan = read_scan(path)
    assert (scan.format, scan.warnings) == ("redwood", ())
    assert_allclose(scan.world_from_cams, sample.poses, atol=1e-9)
    assert_allclose(scan.cameras[0].fy, sample.camera.fy)
    moved = sample.poses.copy()
    moved[:, 2, 3] += 0.5
    out.mkdir()
    scan.files.write_poses(out, moved)
    (out / "trajectory.json").replace(path / "trajectory.json")
    assert_allclose(read_scan(path).world_from_cams, moved, atol=1e-9)
    put(path / "trajectory.json", json.dumps({"parameters": [1]}))
    with pytest.raises(ScanError, match="expected a list `parameters`"):
        read_scan(path)


def test_replica_of_semantic_nerf(sample, tmp_path):
    rows = "\n".join(" ".join(f"{v:.18e}" for v in pose.ravel()) for pose in sample.poses)
    put(tmp_path / "traj_w_c.txt", rows + "\n")
    for i in range(N):
        put(tmp_path / "rgb" / f"rgb_{i}.png", png(sample.color[i]))
        put(tmp_path / "depth" / f"depth_{i}.png", png(sample.depth_mm[i]))
    scan = read_scan(tmp_path)
    assert (scan.format, len(scan), scan.warnings) == ("replica", N, ())
    c = scan.cameras[0]
    assert (c.fx, c.fy, c.cx, c.cy) == (WIDTH / 2, WIDTH / 2, (WIDTH - 1) / 2, (HEIGHT - 1) / 2)
    assert_allclose(scan.world_from_cams, sample.poses, atol=1e-9)
    expected = np.where(sample.depth_mm[2] > 0, sample.depth_mm[2] / 1e3, np.nan)
    assert_allclose(scan.files.depth(2), expected, rtol=1e-6)
    scan.files.write_poses(tmp_path, scan.world_from_cams)
    assert_allclose(
        np.loadtxt(tmp_path / "traj_w_c.txt").reshape(-1, 4, 4), sample.poses, atol=1e-8
    )


def test_colmap_with_its_own_depth(sample, tmp_path):
    write_colmap(tmp_path, sample)
    (folder,) = (tmp_path / name for name in ("depth", "depths") if (tmp_path / name).is_dir())
    for file in list(folder.iterdir()):
        file.unlink()
    folder.rmdir()
    for i, file in enumerate(sorted((tmp_path / "images").rglob("*.*"))):
        depth = (sample.depth_mm[i] / 1e3).astype("<f4")
        name = file.relative_to(tmp_path / "images")
        head = f"{WIDTH}&{HEIGHT}&1&".encode()
        put(tmp_path / f"stereo/depth_maps/{name}.geometric.bin", head + depth.tobytes())
    scan = read_scan(tmp_path)
    assert (scan.format, len(scan)) == ("colmap", N)
    expected = np.where(sample.depth_mm[1] > 0, sample.depth_mm[1] / 1e3, np.nan)
    assert_allclose(scan.files.depth(1), expected, rtol=1e-6)
    put(tmp_path / f"stereo/depth_maps/{name}.geometric.bin", head + b"0")
    with pytest.raises(ScanError, match="expected depth as COLMAP writes it"):
        read_scan(tmp_path)


def test_arkit_scenes_of_the_first_release(sample, tmp_path):
    path, out = tmp_path / "scan", tmp_path / "out"
    write_arkit_scenes(path, sample)
    right = read_scan(path)
    color = next(name for name in ("vga_wide", "lowres_wide", "wide") if (path / name).is_dir())
    for old, new in (
        (color, "wide"),
        (f"{color}_intrinsics", "color_intrinsics"),
        ("lowres_depth", "depth_densified"),
    ):
        for file in sorted((path / old).iterdir()):
            name = file.name.split("_")[-1]
            put(path / new / name, file.read_bytes())
            file.unlink()
        (path / old).rmdir()
    (path / "lowres_wide.traj").rename(path / "color.traj")
    scan = read_scan(path)
    assert (scan.format, len(scan)) == ("arkit-scenes", len(right))
    assert_allclose(scan.world_from_cams, right.world_from_cams)
    assert scan.cameras == right.cameras
    out.mkdir()
    scan.files.write_poses(out, scan.world_from_cams)
    assert [p.name for p in out.iterdir()] == ["color.traj"]


@pytest.mark.parametrize(
    ("times", "is_told"),
    [
        (np.arange(N) / 30, False),
        (np.full(N, 1 / 30), True),
        ([5.0, 6.0, 7.0, 1.0, 2.0, 3.0], True),
    ],
)
def test_nerfstudio_with_times_of_several_clocks_or_durations(times, is_told, sample, tmp_path):
    WRITERS["nerfstudio"](tmp_path, sample)
    content = json.loads((tmp_path / "transforms.json").read_text())
    for i, frame in enumerate(content["frames"]):
        frame["timestamp"] = float(times[i])
        frame["transform_matrix"][0][3] = float(i)
    put(tmp_path / "transforms.json", json.dumps(content))
    scan = read_scan(tmp_path)
    assert_allclose(scan.world_from_cams[:, 0, 3], np.arange(N))
    assert_allclose(scan.timestamps, np.arange(N) if is_told else times)
    assert ["order of the list" in w for w in scan.warnings] == [True] * is_told


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("sensors.yaml", "%YAML:1.0\n---\nx: 1\n", "expected a matrix of 4 numbers"),
        (
            "sensors.yaml",
            "%YAML:1.0\n---\nd400_color_optical_frame: [1, 2]\n",
            "expected YAML of OpenCV",
        ),
        ("trans_matrix.yaml", "%YAML:1.0\n---\nx: 1\n", "expected frames that lead from base_link"),
        ("trans_matrix.yaml", "[", "expected"),
        ("aligned_depth.txt", "1.0 a.png\n", "expected depth within 0.02 s of colour images"),
    ],
)
def test_damaged_files_of_openloris(name, text, words, sample, tmp_path):
    WRITERS["openloris"](tmp_path, sample)
    put(tmp_path / name, text)
    with pytest.raises(ScanError, match=words):
        read_scan(tmp_path)


def test_matrices_of_openloris_are_read_number_by_number(sample, tmp_path):
    """One whose columns are not told ended the process within OpenCV 5."""
    WRITERS["openloris"](tmp_path, sample)
    whole = read_scan(tmp_path)
    mounts, lens = ((tmp_path / name).read_text() for name in ("trans_matrix.yaml", "sensors.yaml"))
    put(tmp_path / "trans_matrix.yaml", mounts.replace("cols: 4", "c: 4"))
    assert_allclose(read_scan(tmp_path).world_from_cams, whole.world_from_cams)
    put(
        tmp_path / "sensors.yaml",
        lens.replace("0.0, 0.0, 0.0, 0.0, 0.0", "0.0, 0.0, 0.0, 0.0, 0.9"),
    )
    assert not np.array_equal(read_scan(tmp_path).files.color(0), whole.files.color(0))


def test_openloris_with_depth_of_its_own_camera_is_no_tum(sample, tmp_path):
    WRITERS["openloris"](tmp_path, sample)
    put(tmp_path / "depth.txt", "0.0 depth/0.0.png\n")
    assert read_scan(tmp_path).format == "openloris"

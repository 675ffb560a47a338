"""Every reader gives back what the format's own files say: images, depth, intrinsics, poses, times."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.errors import OptionError, ScanError
from planfit.scan import ScanOptions, read_scan
from planfit.scan.formats.colmap_model import read_model
from planfit.scan.source import FolderSource
from scan_samples import HALF_DEPTH, HAS_CONFIDENCE, LOSSY_COLOR, WIDTH, WRITERS, N, write_colmap


def written(kind, sample, tmp_path):
    path = tmp_path / ("capture.r3d" if kind == "record3d" else "scan")
    WRITERS[kind](path, sample)
    return path


def expected_depth(kind, sample, i, least_confidence=1):
    depth = sample.depth_mm[i].astype(np.float32) / np.float32(1000)
    if kind in HALF_DEPTH:
        depth = np.repeat(np.repeat(depth[::2, ::2], 2, axis=0), 2, axis=1)
    if kind in HAS_CONFIDENCE:
        depth = depth.copy()
        depth[: (0, 8, 16)[least_confidence]] = 0
    return np.where(depth > 0, depth, np.nan)


@pytest.mark.parametrize("kind", WRITERS)
def test_what_was_written_is_read(kind, sample, tmp_path):
    scan = read_scan(written(kind, sample, tmp_path))
    assert scan.format == kind
    assert len(scan) == N
    assert scan.skipped == ()
    assert scan.warnings == ()
    # Files hold six to nine decimals.
    assert_allclose(scan.world_from_cams, sample.poses, atol=2e-6)
    for i in range(N):
        camera = scan.cameras[i]
        assert (camera.width, camera.height) == (sample.camera.width, sample.camera.height)
        more = i if kind == "record3d" else 0  # it has intrinsics of their own for each frame
        assert_allclose(
            (camera.fx, camera.fy, camera.cx, camera.cy),
            (sample.camera.fx + more, sample.camera.fy + more, sample.camera.cx, sample.camera.cy),
            atol=1e-6,
        )
        color = scan.files.color(i)
        assert color.dtype == np.uint8
        error = np.abs(color.astype(int) - sample.color[i].astype(int))
        assert error.mean() < (6 if kind in LOSSY_COLOR else 1e-9)
        # No other frame is so near, so frames are not exchanged.
        others = [np.abs(color.astype(int) - c.astype(int)).mean() for c in sample.color]
        assert np.argmin(others) == i
        depth = scan.files.depth(i)
        assert depth.dtype == np.float32
        assert_allclose(depth, expected_depth(kind, sample, i), atol=1e-4)


@pytest.mark.parametrize("kind", WRITERS)
def test_frames_are_read_in_any_order(kind, sample, tmp_path):
    scan = read_scan(written(kind, sample, tmp_path))
    forward = [scan.files.color(i) for i in range(N)]
    for i in (N - 1, 0, 3, 1, 2, 2, N - 1):
        assert_array_equal(scan.files.color(i), forward[i])


@pytest.mark.parametrize("kind", WRITERS)
def test_poses_go_back_in_the_formats_own_way(kind, sample, tmp_path):
    path = written(kind, sample, tmp_path)
    scan = read_scan(path)
    moved = sample.poses.copy()
    moved[:, :3, 3] += np.linspace(0.1, 0.4, N)[:, None] * [1.0, -2.0, 0.5]
    rotation = np.array([[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]])
    moved[:, :3, :3] = moved[:, :3, :3] @ rotation
    out = tmp_path / "out"
    out.mkdir()
    scan.files.write_poses(out, moved)
    names = {p.name for p in out.iterdir()}
    again = tmp_path / "again"
    WRITERS[kind](again if kind != "record3d" else tmp_path / "again.r3d", sample)
    if kind == "record3d":
        import zipfile

        from scan_samples import record3d_files, write_zip

        again = tmp_path / "again.r3d"
        files = record3d_files(sample) | {"metadata": (out / "metadata").read_bytes()}
        with zipfile.ZipFile(path) as archive:
            assert set(archive.namelist()) == set(files)
        write_zip(again, files)
    else:
        for name in names:
            place = [p for p in again.rglob(name)]
            place = [p for p in place if p.parent.name in (
                "scan", "again", "pose", "cameras", "0", "iphone")]  # fmt: skip
            if name == "points3D.txt":
                continue
            assert len(place) == 1, name
            place[0].write_bytes((out / name).read_bytes())
    assert_allclose(read_scan(again).world_from_cams, moved, atol=2e-6)


@pytest.mark.parametrize("kind", WRITERS)
def test_some_frames_poses_go_to_their_own_frames(kind, sample, tmp_path):
    scan = read_scan(written(kind, sample, tmp_path))
    out, whole = tmp_path / "out", tmp_path / "whole"
    for folder in (out, whole):
        folder.mkdir()
    scan.files.write_poses(whole, scan.world_from_cams)
    scan.files.write_poses(out, scan.world_from_cams[[1, 4]], np.array([1, 4]))
    for path in out.iterdir():
        if kind in (
            "replica",
            "record3d",
            "scannetpp",
        ):  # tables of all frames; others stay as recorded
            lines = len(path.read_text().splitlines())
            assert lines == len((whole / path.name).read_text().splitlines())
        else:
            text = (whole / path.name).read_text().split()
            assert set(path.read_text().split()) <= set(text)
    assert {p.name for p in out.iterdir()} <= {p.name for p in whole.iterdir()}


@pytest.mark.parametrize("kind", sorted(HAS_CONFIDENCE))
@pytest.mark.parametrize("least", [0, 1, 2])
def test_depth_without_confidence_is_left_out(kind, least, sample, tmp_path):
    path = written(kind, sample, tmp_path)
    scan = read_scan(path, options=ScanOptions(min_confidence=least))
    assert_allclose(scan.files.depth(1), expected_depth(kind, sample, 1, least), atol=1e-4)


@pytest.mark.parametrize("kind", ["stray", "scanner-app", "polycam", "replica"])
def test_formats_that_know_up_say_so(kind, sample, tmp_path):
    up = read_scan(written(kind, sample, tmp_path)).up_world
    assert_array_equal(up, [0, 0, 1] if kind == "replica" else [0, 1, 0])


@pytest.mark.parametrize("kind", ["tum", "nerfstudio", "scannet", "record3d"])
def test_formats_that_do_not_know_up_do_not_guess(kind, sample, tmp_path):
    assert read_scan(written(kind, sample, tmp_path)).up_world is None


def test_a_text_model_without_its_last_empty_line(sample, tmp_path):
    """The line of the last image's points is empty where it has none, and editors trim it."""
    write_colmap(tmp_path, sample)
    path = tmp_path / "sparse" / "0" / "images.txt"
    whole, seen = colmap_poses(tmp_path)
    assert seen == 2
    path.write_text("\n".join(path.read_text().splitlines()[:-1]) + "\n")
    trimmed, seen = colmap_poses(tmp_path)
    assert_allclose(trimmed, whole)
    assert seen == 0


def colmap_poses(folder):
    """Poses of a model, and how many points its last image saw."""
    _, images = read_model(FolderSource(folder), "sparse/0", observations=True)
    return np.stack([image.world_from_cam for image in images]), len(images[-1].uv)


def test_a_binary_model_reads_like_a_text_model(sample, tmp_path):
    write_colmap(tmp_path / "text", sample)
    write_colmap(tmp_path / "binary", sample, binary=True)
    text, binary = read_scan(tmp_path / "text"), read_scan(tmp_path / "binary")
    assert_allclose(text.world_from_cams, binary.world_from_cams, atol=1e-9)
    assert text.cameras[0].fx == pytest.approx(binary.cameras[0].fx)


def test_the_format_can_be_named(sample, tmp_path):
    path = written("redwood", sample, tmp_path)
    assert read_scan(path, options=ScanOptions(format="redwood")).format == "redwood"
    with pytest.raises(ScanError, match=r"expected a scan of the format tum: rgb\.txt"):
        read_scan(path, options=ScanOptions(format="tum"))
    with pytest.raises(OptionError, match=r"format: expected auto, facap.* found 'kinect'"):
        read_scan(path, options=ScanOptions(format="kinect"))


def test_images_can_be_made_smaller(sample, tmp_path):
    path = written("tum", sample, tmp_path)
    scan = read_scan(path, options=ScanOptions(image_size_px=64))
    assert scan.files.color(0).shape == (48, 64, 3)
    depth = scan.files.depth(0)
    assert depth.shape == (48, 64)
    assert scan.cameras[0].fx == pytest.approx(sample.camera.fx / 2)
    assert scan.cameras[0].cx == pytest.approx((sample.camera.cx + 0.5) / 2 - 0.5)
    # Each is one of the stored measurements.
    stored = np.unique(sample.depth_mm[0])
    assert np.isin(np.rint(depth[np.isfinite(depth)] * 1000), stored).all()


def test_the_depth_scale_can_be_given(sample, tmp_path):
    path = written("redwood", sample, tmp_path)
    plain = read_scan(path).files.depth(0)
    scaled = read_scan(path, options=ScanOptions(depth_scale=0.002)).files.depth(0)
    assert_allclose(scaled, 2 * plain, rtol=1e-5)


@pytest.mark.parametrize(
    ("kind", "read_in_m"),
    [("tum", 1 / 5000), ("7-scenes", 1e-3), ("replica", None), ("record3d", None)],
)
def test_a_unit_of_depth_that_is_stated_is_told_from_a_usual_one(kind, read_in_m, sample, tmp_path):
    """Replica's cam_params.json says the scale; Record3D's files are metres."""
    path = written(kind, sample, tmp_path)
    assert read_scan(path).depth_read_in_m == read_in_m
    if kind in ("tum", "7-scenes"):
        assert read_scan(path, options=ScanOptions(depth_scale=1e-3)).depth_read_in_m is None
    if kind == "replica":
        camera = json.loads((path.parent / "cam_params.json").read_text())
        del camera["camera"]["scale"]
        (path.parent / "cam_params.json").write_text(json.dumps(camera))
        assert read_scan(path).depth_read_in_m == pytest.approx(1 / 6553.5)


@pytest.mark.parametrize("is_published", [True, False])
def test_a_lens_of_replica_is_not_that_of_images_of_another_size(is_published, sample, tmp_path):
    path = written("replica", sample, tmp_path)
    file = path.parent / "cam_params.json"
    if is_published:
        file.unlink()
    else:
        file.write_text(file.read_text().replace(f'"w": {WIDTH}', '"w": 1200'))
    with pytest.raises(ScanError, match=r"cam_params.json: expected the camera of 128 x 96 px"):
        read_scan(path)


def test_any_input_file_changes_the_fingerprint(sample, tmp_path):
    path = written("7-scenes", sample, tmp_path)
    before = read_scan(path).fingerprint
    assert read_scan(path).fingerprint == before
    assert read_scan(path, options=ScanOptions(depth_scale=0.002)).fingerprint != before
    pose = path / "frame-000002.pose.txt"
    pose.write_text(pose.read_text() + " ")
    assert read_scan(path).fingerprint != before

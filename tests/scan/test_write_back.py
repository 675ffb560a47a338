"""Refined poses in the input's own format, put in place of the recorded ones, are read back equal."""

import hashlib
import json
import shutil
import struct
import zipfile

import numpy as np
import pytest
from bag_writer import BagWriter, write_images, write_tf
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from planfit.geometry import se3
from planfit.scan import ScanOptions, read_scan
from planfit.scan.formats.colmap_model import read_model
from planfit.scan.source import FolderSource
from planfit.synth import BuildingOptions, SynthOptions, WalkOptions, make_scan, write_facap
from scan_samples import WRITERS, N, put, write_colmap, write_zip

PLACE = {
    "7-scenes": "", "tum": "", "redwood": "", "scannet": "pose", "replica": "", "nerfstudio": "",
    "stray": "", "scanner-app": "", "polycam": "keyframes/cameras", "colmap": "sparse/0",
    "facap": "arcore", "arkit-scenes": "", "scannetpp": "iphone",
}  # fmt: skip
"""Folder of each format that its poses lie in."""


def moved(poses):
    """As a refinement moves them: every frame a little differently, and all of them by a motion."""
    n = len(poses)
    steps = np.linspace(0, 1, n)[:, None]
    rotations = se3.exp_so3(steps * [0.05, -0.2, 0.1])
    translations = steps * [0.4, -0.1, 0.3] + [1e3, -20.0, 5.0]  # far from the origin, too
    return se3.make_transform(rotations, translations) @ poses


def checksums(folder):
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return {p: hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def put_back(kind, folder, out):
    """Copy what was written to where the format has it; each file must replace one that was there."""
    for path in out.iterdir():
        target = folder / PLACE[kind] / path.name
        assert target.exists() or path.name == "points3D.txt", path.name
        shutil.copy(path, target)


def write_scan(kind, folder, sample):
    if kind == "facap":
        write_facap(folder, make_scan(SynthOptions(
            seed=5, building=BuildingOptions(n_rooms=1), walk=WalkOptions(n_frames=N))))  # fmt: skip
    else:
        WRITERS[kind](folder, sample)


@pytest.mark.parametrize("kind", PLACE)
def test_of_a_folder(kind, sample, tmp_path):
    folder, out = tmp_path / "in" / "scan", tmp_path / "out"
    write_scan(kind, folder, sample)
    out.mkdir()
    before = checksums(tmp_path / "in")
    scan = read_scan(folder)
    refined = moved(scan.world_from_cams)
    scan.files.write_poses(out, refined)
    assert checksums(tmp_path / "in") == before
    put_back(kind, folder, out)
    again = read_scan(folder)
    assert again.format == kind
    assert again.frame_ids == scan.frame_ids
    assert_allclose(again.timestamps, scan.timestamps, rtol=0, atol=1e-6)
    # Replica writes ten digits, a micrometre at a kilometre; others nine decimals or all digits.
    assert_allclose(again.world_from_cams, refined, atol=5e-6)
    assert again.cameras == scan.cameras


def test_of_an_archive(sample, tmp_path):
    path, out = tmp_path / "scan.r3d", tmp_path / "out"
    WRITERS["record3d"](path, sample)
    out.mkdir()
    scan = read_scan(path)
    refined = moved(scan.world_from_cams)
    scan.files.write_poses(out, refined)
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    assert [p.name for p in out.iterdir()] == ["metadata"]
    write_zip(path, files | {"metadata": (out / "metadata").read_bytes()})
    assert_allclose(read_scan(path).world_from_cams, refined, atol=1e-9)


def write_rig(folder, sample, binary):
    """As COLMAP 3.12 has it beside a model: one rig, and a frame an image with numbers of their own."""
    frames = []
    for i, pose in enumerate(sample.poses):
        x, y, z, w = Rotation.from_matrix(pose[:3, :3].T).as_quat()
        frames.append((i + 11, 5, w, x, y, z, *np.linalg.inv(pose)[:3, 3], 1, 1, i + 1))
    if binary:
        put(folder / "rigs.bin", struct.pack("<QIIiI", 1, 5, 1, 0, 1))
        rows = [struct.pack("<II7dIiIQ", *row[:10], 0, *row[10:]) for row in frames]
        put(folder / "frames.bin", struct.pack("<Q", N) + b"".join(rows))
    else:
        put(folder / "rigs.txt", "# rigs\n5 1 CAMERA 1\n")
        lines = [" ".join(map(str, (*row[:10], "CAMERA", *row[10:]))) for row in frames]
        put(folder / "frames.txt", "\n".join(lines) + "\n")


@pytest.mark.parametrize("has_frames", [False, True])
@pytest.mark.parametrize("binary", [False, True])
def test_colmap_finds_the_refined_poses_in_its_own_model(binary, has_frames, sample, tmp_path):
    """It prefers binary files to text beside them, and poses of frames to those of images."""
    folder, out = tmp_path / "scan" / "sparse" / "0", tmp_path / "out"
    write_colmap(tmp_path / "scan", sample, binary)
    suffix = "bin" if binary else "txt"
    put(folder / f"points3D.{suffix}", struct.pack("<Q", 0) if binary else "# no points\n")
    if has_frames:
        write_rig(folder, sample, binary)
    out.mkdir()
    scan = read_scan(tmp_path / "scan")
    refined = moved(scan.world_from_cams)
    scan.files.write_poses(out, refined[1:], np.arange(1, N))
    assert {p.name for p in out.iterdir()} == {p.name for p in folder.iterdir()}
    put_back("colmap", tmp_path / "scan", out)
    assert_allclose(read_scan(tmp_path / "scan").world_from_cams, refined[1:], atol=1e-9)
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    model = pycolmap.Reconstruction(str(folder))
    assert sorted(model.images) == list(range(2, N + 1))
    for number, image in model.images.items():
        expected = np.linalg.inv(refined[number - 1])[:3]
        assert_allclose(image.cam_from_world().matrix(), expected, atol=1e-9)
        assert_allclose([point.xy for point in image.points2D], [[10.5, 20.5], [30.25, 40.0]])
    camera = model.cameras[1]
    assert (camera.width, camera.height) == (sample.camera.width, sample.camera.height)
    assert_allclose(camera.params[:2], [sample.camera.fx, sample.camera.fy], atol=1e-9)


@pytest.mark.parametrize("binary", [False, True])
def test_a_model_keeps_what_its_images_observed(binary, sample, tmp_path):
    """But not the points, which lay where the old poses put them."""
    folder, out = tmp_path / "scan", tmp_path / "out"
    write_colmap(folder, sample, binary=binary)
    out.mkdir()
    scan = read_scan(folder)
    scan.files.write_poses(out, moved(scan.world_from_cams))
    _, images = read_model(FolderSource(out), observations=True)
    assert len(images) == N
    for image in images:
        assert_allclose(image.uv, [[10.5, 20.5], [30.25, 40.0]])
        assert image.point_id.tolist() == [-1, -1]
    points = (out / f"points3D.{'bin' if binary else 'txt'}").read_bytes()
    assert points == bytes(8) if binary else points.startswith(b"#") and points.count(b"\n") == 1


def put_open3d_json(folder, sample):
    """The trajectory as camera parameters instead of a log."""
    WRITERS["redwood"](folder, sample)
    (folder / "trajectory.log").unlink()
    c = sample.camera
    lens = {"width": c.width, "height": c.height,
            "intrinsic_matrix": [c.fx, 0, 0, 0, c.fy, 0, c.cx, c.cy, 1]}  # fmt: skip
    parameters = [
        {"intrinsic": lens, "extrinsic": np.linalg.inv(pose).T.ravel().tolist()}
        for pose in sample.poses
    ]
    put(folder / "trajectory.json", json.dumps({"parameters": parameters}))


COUNTED = {"record3d": WRITERS["record3d"], "open3d": put_open3d_json}


@pytest.mark.parametrize(
    "kind", [*COUNTED, "nerfstudio", "stray", "tum", "arkit-scenes", "scannetpp"]
)
def test_frames_that_were_left_out_have_no_recorded_poses(kind, sample, tmp_path):
    """They are not there, or, where frames are counted, keep their place beside the one before them."""
    path, out = tmp_path / ("scan.r3d" if kind == "record3d" else "scan"), tmp_path / "out"
    (COUNTED | WRITERS)[kind](path, sample)
    out.mkdir()
    scan = read_scan(path)
    kept = np.array([1, 2, 4])
    refined = moved(scan.world_from_cams)
    scan.files.write_poses(out, refined[kept], kept)
    if kind == "record3d":
        with zipfile.ZipFile(path) as archive:
            files = {name: archive.read(name) for name in archive.namelist()}
        write_zip(path, files | {"metadata": (out / "metadata").read_bytes()})
    elif kind == "open3d":
        shutil.copy(out / "trajectory.json", path)
    else:
        put_back(kind, path, out)
    again = read_scan(path)
    if kind in ("tum", "arkit-scenes"):  # whose readers interpolate over a gap as short
        (file,) = out.iterdir()
        assert len(file.read_text().splitlines()) == len(kept)
        return
    if kind not in COUNTED:
        assert again.frame_ids == tuple(scan.frame_ids[i] for i in kept)
        assert_allclose(again.world_from_cams, refined[kept], atol=5e-6)
        return
    beside = [1, 1, 2, 2, 4, 4]
    recorded = scan.world_from_cams
    expected = refined[beside] @ np.linalg.inv(recorded[beside]) @ recorded
    assert_allclose(again.world_from_cams, expected, atol=5e-6)


def test_of_a_bag(sample, tmp_path):
    """A bag is not rewritten: its poses come as TUM, and take the place of its own by --poses."""
    path, out = tmp_path / "scan.bag", tmp_path / "out"
    bag = BagWriter(path, 1)
    with bag.writer:
        write_images(bag, sample)
        write_tf(bag, sample)
    out.mkdir()
    scan = read_scan(path)
    refined = moved(scan.world_from_cams)
    scan.files.write_poses(out, refined)
    again = read_scan(path, options=ScanOptions(poses=out / "trajectory.tum"))
    assert len(again) == N
    assert_allclose(again.world_from_cams, refined, atol=1e-6)

"""Refined poses in the input's own format, put in place of the recorded ones, are read back equal."""

import hashlib
import shutil
import zipfile

import numpy as np
import pytest
from bag_writer import BagWriter, write_images, write_tf
from numpy.testing import assert_allclose

from planfit.geometry import se3
from planfit.scan import ScanOptions, read_scan
from planfit.scan.formats.colmap_model import read_model
from planfit.scan.source import FolderSource
from planfit.synth import BuildingOptions, SynthOptions, WalkOptions, make_scan, write_facap
from scan_samples import WRITERS, N, write_colmap, write_zip

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


def test_of_a_binary_model(sample, tmp_path):
    """It comes back as text, which COLMAP reads too where the binary files are not there."""
    folder, out = tmp_path / "scan", tmp_path / "out"
    write_colmap(folder, sample, binary=True)
    out.mkdir()
    scan = read_scan(folder)
    refined = moved(scan.world_from_cams)
    scan.files.write_poses(out, refined)
    shutil.rmtree(folder / "sparse" / "0")
    shutil.copytree(out, folder / "sparse" / "0")
    assert_allclose(read_scan(folder).world_from_cams, refined, atol=1e-6)


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
    points = (out / "points3D.txt").read_text().splitlines()
    assert all(line.startswith("#") for line in points)


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

"""RTAB-Map's databases: what its serialisers write is read, and what is written back is as they would."""

import hashlib
import os
import sqlite3
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from rtabmap_writer import (
    BASE_FROM_CAM,
    camera_blob,
    float_png,
    inverse_png,
    legacy_camera_blob,
    rvl,
    write_rtabmap,
)

from planfit.errors import ScanError
from planfit.scan import read_scan
from planfit.scan.formats import rtabmap_source
from scan_samples import N, png
from spoiled_scans import refused, spoken

DATA = Path(os.environ.get("PLANFIT_SHARED", Path(__file__).parents[2].parent / "shared" / "data"))
REAL = DATA / "real_files" / "rtabmap" / "openvins_ros2.db"
ATOL = 2e-6  # float32 of poses a few metres from the origin


def shifted(poses, along):
    moved = poses.copy()
    moved[:, :3, 3] += along
    return moved


def test_a_database_is_read(sample, tmp_path):
    path = tmp_path / "map.db"
    write_rtabmap(path, sample)
    scan = read_scan(path)
    assert scan.format == "rtabmap"
    assert scan.frame_ids == tuple(str(i + 1) for i in range(N))
    assert_allclose(scan.world_from_cams, sample.poses, atol=ATOL)
    assert_allclose(scan.timestamps, sample.times)
    assert scan.skipped == scan.warnings == ()
    camera = scan.cameras[2]
    assert (camera.fx, camera.cy) == pytest.approx((sample.camera.fx, sample.camera.cy))
    small = np.repeat(np.repeat(sample.small_mm[3], 2, axis=0), 2, axis=1) / 1000
    assert_allclose(scan.files.depth(3), np.where(small > 0, small, np.nan), atol=1e-6)
    errors = [np.abs(scan.files.color(3).astype(int) - c.astype(int)).mean() for c in sample.color]
    assert np.argmin(errors) == 3


@pytest.mark.parametrize(("depth", "relative"), [(rvl, 0), (float_png, 1e-6), (inverse_png, 2e-3)])
def test_every_kind_of_stored_depth(depth, relative, sample, tmp_path):
    write_rtabmap(tmp_path / "map.db", sample, depth=depth)
    write_rtabmap(tmp_path / "plain.db", sample)
    found = read_scan(tmp_path / "map.db").files.depth(1)
    expected = read_scan(tmp_path / "plain.db").files.depth(1)
    assert np.isfinite(expected).any()
    assert_allclose(found, expected, rtol=relative)


@pytest.mark.parametrize("kind", ["p", "legacy"])
def test_every_kind_of_calibration(kind, sample, tmp_path):
    blob = (
        camera_blob(sample.camera, with_p=True)
        if kind == "p"
        else legacy_camera_blob(sample.camera)
    )
    write_rtabmap(tmp_path / "map.db", sample, calibration=blob)
    scan = read_scan(tmp_path / "map.db")
    assert scan.cameras[0].fx == pytest.approx(sample.camera.fx, rel=1e-6)
    assert scan.cameras[0].cx == pytest.approx(sample.camera.cx, rel=1e-6)
    assert_allclose(scan.world_from_cams, sample.poses, atol=ATOL)


def test_the_first_of_two_cameras_is_read(sample, tmp_path):
    other = BASE_FROM_CAM @ np.diag([-1.0, 1, -1, 1])
    blob = camera_blob(sample.camera) + camera_blob(sample.camera, other)
    write_rtabmap(tmp_path / "map.db", sample, calibration=blob, side_by_side=2)
    scan = read_scan(tmp_path / "map.db")
    assert "2 cameras" in scan.warnings[0]
    assert scan.files.color(0).shape == (96, 128, 3)
    assert scan.files.depth(0).shape == (96, 128)
    assert_allclose(scan.world_from_cams, sample.poses, atol=ATOL)


def test_optimised_poses_are_taken_and_others_follow(sample, tmp_path):
    """Odometry drifts; nodes 1, 3 and 4 are optimised, the others keep their place beside them."""
    drifted = sample.poses.copy()
    drifted[2:, :3, 3] += [0.5, 0.2, 0.0]
    drifted[:, :3, 3] += [3.0, 1.0, 0.0]
    optimised = {number: sample.poses[number - 1] for number in (1, 3, 4)}
    write_rtabmap(tmp_path / "map.db", sample, odometry=drifted, optimised=optimised)
    scan = read_scan(tmp_path / "map.db")
    assert len(scan) == N
    assert_allclose(scan.world_from_cams, sample.poses, atol=5 * ATOL)


def test_sessions_without_a_common_world(sample, tmp_path):
    write_rtabmap(tmp_path / "map.db", sample, map_ids=(0, 0, 1, 1, 1, 1))
    scan = read_scan(tmp_path / "map.db")
    assert scan.frame_ids == ("3", "4", "5", "6")
    assert "2 sessions" in scan.warnings[0]
    assert scan.skipped[0] == "frame 1: its session 0 is not joined with the others"
    write_rtabmap(tmp_path / "joined.db", sample, map_ids=(0, 0, 1, 1, 1, 1),
                  odometry=shifted(sample.poses, [[0, 0, 0]] * 2 + [[9, 9, 9]] * 4),
                  optimised={1: sample.poses[0], 3: sample.poses[2]})  # fmt: skip
    assert_allclose(read_scan(tmp_path / "joined.db").world_from_cams, sample.poses, atol=5 * ATOL)


@pytest.mark.parametrize("is_optimised", [False, True])
def test_refined_poses_go_into_a_copy(is_optimised, sample, tmp_path):
    path, out = tmp_path / "map.db", tmp_path / "out"
    out.mkdir()
    optimised = {i + 1: sample.poses[i] for i in range(N)} if is_optimised else None
    write_rtabmap(path, sample, optimised=optimised)
    before = hashlib.sha256(path.read_bytes()).hexdigest()
    scan = read_scan(path)
    refined = shifted(scan.world_from_cams, [0.3, -0.2, 0.1])
    scan.files.write_poses(out, refined[1:5], np.arange(1, 5))
    assert hashlib.sha256(path.read_bytes()).hexdigest() == before
    again = read_scan(out / "map.db")
    assert_allclose(again.world_from_cams, refined, atol=ATOL)  # those left out follow
    # As RTAB-Map reads them: ids and poses as zlib, with rows, columns and type behind.
    with sqlite3.connect(out / "map.db") as con:
        ids, poses, cloud = con.execute(
            "SELECT opt_ids, opt_poses, opt_cloud FROM Admin"
        ).fetchone()
    assert struct.unpack("<3i", ids[-12:]) == (1, N, 4)
    assert struct.unpack("<3i", poses[-12:]) == (1, 12 * N, 5)
    assert np.frombuffer(zlib.decompress(ids[:-12]), "<i4").tolist() == list(range(1, N + 1))
    assert cloud is None
    con.close()


def change(path, statement, *values):
    con = sqlite3.connect(path)
    con.execute(statement, values)
    con.commit()
    con.close()


@pytest.mark.parametrize(
    ("statement", "value", "word"),
    [
        ("UPDATE Data SET calibration = ?", b"\0" * 30, "calibration of node 1"),
        ("UPDATE Data SET calibration = ?", b"\1" * 164, "calibration of node 1"),
        ("UPDATE Data SET depth = ?", None, "expected nodes with image, depth and calibration"),
        ("UPDATE Data SET depth = ?", b"DEPTHRVL" + b"\xff" * 9, "depth/1"),
        ("UPDATE Node SET pose = ? WHERE id = 3", b"\x7f" * 48, "pose of node 3"),
        ("UPDATE Node SET stamp = ? WHERE id = 3", "x", "node 3"),
        ("UPDATE Admin SET opt_ids = ?, opt_poses = opt_ids", b"\x7f" * 48, "optimised poses"),
        ("ALTER TABLE Data RENAME COLUMN depth TO ?", None, "map.db"),
        ("DROP TABLE Data", None, "map.db"),
    ],
)
def test_a_damaged_database(statement, value, word, sample, tmp_path):
    path = tmp_path / "map.db"
    write_rtabmap(path, sample, optimised={1: sample.poses[0]})
    if "TO ?" in statement:
        change(path, statement.replace("?", "right_image"))
    else:
        change(path, statement, *([value] if "?" in statement else []))
    with pytest.raises(ScanError, match=word) as caught:
        read_scan(path).files.depth(0)
    assert "\n" not in str(caught.value)


def test_a_stereo_database_is_refused(sample, tmp_path):
    write_rtabmap(tmp_path / "map.db", sample, calibration=camera_blob(sample.camera, kind=1))
    with pytest.raises(ScanError, match="stereo camera; planfit needs depth"):
        read_scan(tmp_path / "map.db")


def outcome(path):
    """What an attempt to read says; empty where it can be read."""
    try:
        scan = read_scan(path)
        scan.files.depth(0), scan.files.color(0)
    except ScanError as error:
        return str(error)
    return ""


def test_a_database_cut_off(sample, tmp_path):
    path = tmp_path / "map.db"
    write_rtabmap(path, sample)
    data = path.read_bytes()
    rng = np.random.default_rng(4)
    for share in (0.1, 0.5, 0.95):
        path.write_bytes(data[: int(share * len(data))])
        with pytest.raises(ScanError):
            read_scan(path).files.color(5)
    for _ in range(60):
        spoiled = bytearray(data)
        for at in rng.integers(16, len(data), 30):
            spoiled[at] = rng.integers(256)
        path.write_bytes(bytes(spoiled))
        assert "\n" not in outcome(path)


@pytest.mark.parametrize("kind", ["rvl", "float", "inverse"])
def test_damaged_depth_is_an_error_that_names_the_node(kind, sample, tmp_path):
    encode = {"rvl": rvl, "float": float_png, "inverse": inverse_png}[kind]
    write_rtabmap(tmp_path / "map.db", sample, depth=lambda d: encode(d)[:700])
    with pytest.raises(ScanError, match="depth/1"):
        read_scan(tmp_path / "map.db").files.depth(0)


ENDLESS = "WITH RECURSIVE r(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM r)"


def test_a_database_whose_tables_have_no_end(sample, tmp_path, capsys, monkeypatch):
    """Neither a view, nor any other query that SQLite is at work on."""
    path = tmp_path / "map.db"
    write_rtabmap(path, sample)
    assert spoken(capsys, "inspect", path)[0] == 0
    monkeypatch.setattr(rtabmap_source, "MAX_QUERY_S", 0.2)
    with pytest.raises(ScanError, match=r"cannot be read \(interrupted\); copy it again"):
        rtabmap_source.DatabaseSource(path).rows(f"{ENDLESS} SELECT sum(x) FROM r")
    with sqlite3.connect(path) as map_:
        map_.execute("ALTER TABLE Data RENAME TO Old")
        map_.execute(f"CREATE VIEW Data AS {ENDLESS} SELECT Old.* FROM Old, r")
    assert refused(capsys, "inspect", path) == (
        f"{path}: expected tables of RTAB-Map, found a view (Data), which is a query that may have no end; "
        "do not trust this database, or save the map again"
    )


@pytest.mark.shared
@pytest.mark.skipif(not REAL.is_file(), reason="no real database: set PLANFIT_SHARED")
def test_a_real_database_without_images_says_what_it_lacks():
    with pytest.raises(ScanError, match="found none among 411; record with Mem/BinDataKept true"):
        read_scan(REAL)


def test_real_tables_with_images_put_in(sample, tmp_path):
    """411 nodes of a real robot, of which the first six get the sample's images."""
    if not REAL.is_file():
        pytest.skip("no real database: set PLANFIT_SHARED")
    path = tmp_path / "real.db"
    path.write_bytes(REAL.read_bytes())
    for i in range(6):
        change(path, "UPDATE Data SET image = ?, depth = ?, calibration = ? WHERE id = ?",
               png(sample.color[i]), png(sample.depth_mm[i]), camera_blob(sample.camera), i + 1)  # fmt: skip
    scan = read_scan(path)
    assert scan.timestamps[0] == pytest.approx(1758022420.1723204)
    (tmp_path / "out").mkdir()
    moved = shifted(scan.world_from_cams, [1.0, 0, 0])
    scan.files.write_poses(tmp_path / "out", moved)
    again = read_scan(tmp_path / "out" / "real.db")
    assert_allclose(again.world_from_cams, moved, atol=1e-5)

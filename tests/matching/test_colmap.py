"""Matches of COLMAP files, written byte for byte as its documentation says."""

import sqlite3
import struct
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import CAMERA, look, room_scan
from planfit.errors import ScanError
from planfit.evaluation import match_distances
from planfit.geometry import se3
from planfit.matching import MatchingOptions, find_matches
from planfit.matching.colmap import read_colmap_matches
from planfit.runtime import Runtime
from planfit.scan.odometry import OdometryOptions, make_odometry

POSES = np.stack([look([1.0 + 0.15 * i, 2.0, 1.3], 4.0 * i, 5) for i in range(4)])


@pytest.fixture(scope="module")
def scan():
    return room_scan(POSES)


@pytest.fixture(scope="module")
def seen(scan):
    """Points of frame 0 seen in every frame: uv (k, 2) each, planfit's pixels; NaN where not seen."""
    rng = np.random.default_rng(0)
    uv = rng.uniform([10, 10], [150, 110], (120, 2))
    depth = scan.files.depth(0)
    at = np.round(uv).astype(int)
    points = se3.transform(POSES[0], CAMERA.lift(at, depth[at[:, 1], at[:, 0]]))
    result = []
    for pose in POSES:
        found = CAMERA.project(se3.transform(se3.inverse(pose), points))
        inside = (found > 3).all(axis=1) & (found < [CAMERA.width - 4, CAMERA.height - 4]).all(
            axis=1
        )
        result.append(np.where(inside[:, None], found, np.nan))
    return result


def names(n):
    return [f"rgb/frame-{i:04d}.jpg" for i in range(n)]


def write_database(path, seen, image_names=None, table="two_view_geometries", scale=1):
    """Every keypoint is listed in every image, in an order of its own."""
    rng = np.random.default_rng(1)
    database = sqlite3.connect(path)
    database.executescript(
        "CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY, model INTEGER, width INTEGER, "
        "height INTEGER, params BLOB, prior_focal_length INTEGER);"
        "CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT, camera_id INTEGER);"
        "CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB);"
        "CREATE TABLE matches (pair_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB);"
        "CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, "
        "data BLOB, config INTEGER);"
    )
    database.execute(
        "INSERT INTO cameras VALUES (1, 0, ?, ?, ?, 0)",
        (CAMERA.width * scale, CAMERA.height * scale, b""),
    )
    order = []
    for i, uv in enumerate(seen):
        shown = rng.permutation(np.flatnonzero(np.isfinite(uv[:, 0])))
        order.append(shown)
        # Four columns, as COLMAP's own SIFT writes them: x, y, scale, orientation.
        rows = np.column_stack([(uv[shown] + 0.5) * scale, np.ones((len(shown), 2))])
        name = (image_names or names(len(seen)))[i]
        database.execute("INSERT INTO images VALUES (?, ?, 1)", (i + 1, name))
        data = rows.astype("<f4").tobytes()
        database.execute("INSERT INTO keypoints VALUES (?, ?, 4, ?)", (i + 1, len(rows), data))
    for i in range(len(seen)):
        for j in range(i + 1, len(seen)):
            _, a, b = np.intersect1d(order[i], order[j], return_indices=True)
            data = np.column_stack([a, b]).astype("<u4").tobytes()
            values = ((i + 1) * 2147483647 + j + 1, len(a), 2, data)
            extra = ", 3" if table == "two_view_geometries" else ""
            database.execute(f"INSERT INTO {table} VALUES (?, ?, ?, ?{extra})", values)
    database.commit()
    database.close()


def write_model(folder, seen, binary):
    n = len(seen)
    observations = []
    for uv in seen:
        ids = np.where(np.isfinite(uv[:, 0]), np.arange(len(uv)), -1)
        observations.append((np.nan_to_num(uv) + 0.5, ids))
    if binary:
        with (folder / "cameras.bin").open("wb") as file:
            file.write(struct.pack("<QiiQQ4d", 1, 7, 1, CAMERA.width, CAMERA.height, 1, 1, 1, 1))
        with (folder / "images.bin").open("wb") as file:
            file.write(struct.pack("<Q", n))
            for i, (uv, ids) in enumerate(observations):
                file.write(struct.pack("<I7dI", i + 1, 1, 0, 0, 0, 0, 0, 0, 7))
                file.write(names(n)[i].encode() + b"\0" + struct.pack("<Q", len(uv)))
                for (x, y), point in zip(uv, ids, strict=True):
                    file.write(struct.pack("<ddq", x, y, point))
        return
    (folder / "cameras.txt").write_text(
        f"# Camera list\n7 PINHOLE {CAMERA.width} {CAMERA.height} 130 130 80 60\n"
    )
    lines = ["# Image list with two lines of data per image:"]
    for i, (uv, ids) in enumerate(observations):
        lines.append(f"{i + 1} 1 0 0 0 0 0 0 7 {names(n)[i]}")
        lines.append(" ".join(f"{x:.6f} {y:.6f} {p}" for (x, y), p in zip(uv, ids, strict=True)))
    (folder / "images.txt").write_text("\n".join(lines) + "\n")


def check(found, seen):
    """Every pair of images matches the keypoints that show the same point, to the pixel."""
    assert_array_equal(found.pairs, [(i, j) for i in range(4) for j in range(i + 1, 4)])
    for (i, j), idx in zip(found.pairs, found.matches, strict=True):
        both = np.isfinite(seen[i][:, 0]) & np.isfinite(seen[j][:, 0])
        assert len(idx) == both.sum() > 20
        a, b = found.uv[i][idx[:, 0]], found.uv[j][idx[:, 1]]
        order, expected = np.lexsort(np.round(a, 2).T), np.lexsort(np.round(seen[i][both], 2).T)
        assert_allclose(a[order], seen[i][both][expected], atol=1e-4)
        assert_allclose(b[order], seen[j][both][expected], atol=1e-4)


@pytest.mark.parametrize("table", ["two_view_geometries", "matches"])
@pytest.mark.parametrize("scale", [1, 2])
def test_database(scan, seen, tmp_path, table, scale):
    write_database(tmp_path / "database.db", seen, table=table, scale=scale)
    before = (tmp_path / "database.db").read_bytes()
    check(read_colmap_matches(tmp_path / "database.db", scan), seen)
    assert (tmp_path / "database.db").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["database.db"]


@pytest.mark.parametrize("binary", [True, False])
def test_model(scan, seen, tmp_path, binary):
    write_model(tmp_path, seen, binary)
    check(read_colmap_matches(tmp_path, scan), seen)


def test_an_image_without_points_in_a_text_model(scan, seen, tmp_path):
    none = [*seen[:3], np.full_like(seen[3], np.nan)]
    write_model(tmp_path, none, binary=False)
    lines = (tmp_path / "images.txt").read_text().splitlines()
    lines[-1] = ""
    (tmp_path / "images.txt").write_text("\n".join(lines) + "\n")
    found = read_colmap_matches(tmp_path, scan)
    assert_array_equal(found.pairs, [(0, 1), (0, 2), (1, 2)])


@pytest.mark.parametrize(
    ("number", "name", "count"), [(9, "RADIAL_FISHEYE", 5), (10, "THIN_PRISM_FISHEYE", 12)]
)
def test_a_model_of_any_lens_gives_matches(scan, seen, tmp_path, number, name, count):
    """Only sizes are used: points are lifted by the scan's own lens."""
    size = CAMERA.width, CAMERA.height
    for kind in ("binary", "text"):
        folder = tmp_path / kind
        folder.mkdir()
        write_model(folder, seen, kind == "binary")
        if kind == "binary":
            data = struct.pack(f"<QiiQQ{count}d", 1, 7, number, *size, *range(count))
            (folder / "cameras.bin").write_bytes(data)
        else:
            row = " ".join(["7", name, *map(str, (*size, *range(count)))])
            (folder / "cameras.txt").write_text(f"{row}\n")
        check(read_colmap_matches(folder, scan), seen)


def matched(scan, path):
    odometry = make_odometry(scan.world_from_cams, OdometryOptions())
    return find_matches(scan, odometry, MatchingOptions(colmap=str(path)), Runtime(2))


def test_imported_matches_are_lifted_and_verified(scan, seen, tmp_path):
    write_database(tmp_path / "database.db", seen)
    found = matched(scan, tmp_path / "database.db")
    assert found.n_tried == 6
    assert len(found.pairs) == 6
    assert np.median(match_distances(found, POSES)) < 0.02
    wrong = [seen[0], seen[1], seen[2][::-1], seen[3]]
    write_database(tmp_path / "wrong.db", wrong)
    found = matched(scan, tmp_path / "wrong.db")
    assert not np.any(found.pairs == 2)
    assert len(found.pairs) == 3


@pytest.mark.parametrize("image_names", [["0000", "0001", "0002", "0003"],
                                         ["b/0000.png", "b/0001.png", "b/0002.png", "b/0003.png"],
                                         ["IMG_0.JPG", "IMG_1.JPG", "IMG_2.JPG", "IMG_3.JPG"]])  # fmt: skip
def test_names_of_images(scan, seen, tmp_path, image_names):
    write_database(tmp_path / "database.db", seen, image_names)
    check(read_colmap_matches(tmp_path / "database.db", scan), seen)


def test_images_in_another_order(scan, seen, tmp_path):
    turned = seen[::-1]
    write_database(tmp_path / "database.db", turned, names(4)[::-1])
    check(read_colmap_matches(tmp_path / "database.db", scan), seen)


def refused(path, scan, message):
    with pytest.raises(ScanError, match=message):
        read_colmap_matches(path, scan)


def test_bad_input(scan, seen, tmp_path):
    refused(tmp_path / "none.db", scan, "found nothing there")
    refused(tmp_path, scan, "found neither cameras.bin and images.bin")
    (tmp_path / "text.db").write_text("no database, but long enough to be taken for one" * 50)
    refused(tmp_path / "text.db", scan, "expected a COLMAP database")
    sqlite3.connect(tmp_path / "empty.db").close()
    refused(tmp_path / "empty.db", scan, "expected a COLMAP database")
    write_database(tmp_path / "other.db", seen, ["a.jpg", "b.jpg", "c.jpg", "d.jpg"])
    refused(tmp_path / "other.db", scan, r"found 4 images of which 0 are \(such as a.jpg\)")
    write_database(tmp_path / "twice.db", seen, ["0000", "x-0000", "0002", "0003"])
    refused(tmp_path / "twice.db", scan, "found two that are frame 0000")


def test_corrupt_tables(scan, seen, tmp_path):
    path = tmp_path / "database.db"
    for statement, message in (
        ("UPDATE keypoints SET rows = rows + 1", "damaged table"),
        ("UPDATE two_view_geometries SET data = NULL", "damaged table"),
        ("UPDATE keypoints SET rows = 0, data = NULL WHERE image_id = 2", "existing keypoints"),
    ):
        path.unlink(missing_ok=True)
        write_database(path, seen)
        database = sqlite3.connect(path)
        database.execute(statement)
        database.commit()
        database.close()
        refused(path, scan, message)


@pytest.mark.parametrize("binary", [True, False])
def test_a_truncated_model(scan, seen, tmp_path, binary):
    write_model(tmp_path, seen, binary)
    path = tmp_path / ("images.bin" if binary else "images.txt")
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    refused(tmp_path, scan, "damaged")


def test_a_changed_file_is_read_again(scan, seen, tmp_path):
    path = tmp_path / "database.db"
    write_database(path, seen)
    odometry = make_odometry(scan.world_from_cams, OdometryOptions())
    scan = replace(scan, fingerprint="room")
    runtime = Runtime(1, tmp_path / "cache")
    assert find_matches(scan, odometry, MatchingOptions(colmap=str(path)), runtime).n_matches > 100
    path.unlink()
    write_database(path, [np.where(np.arange(120)[:, None] < 50, uv, np.nan) for uv in seen])
    again = find_matches(scan, odometry, MatchingOptions(colmap=str(path)), runtime)
    fresh = find_matches(scan, odometry, MatchingOptions(colmap=str(path)), Runtime(1))
    assert_array_equal(again.points_a, fresh.points_a)

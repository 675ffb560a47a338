"""E57 with a trajectory: read as the same walk in LAZ is, and written back with all that the file had."""

import os
from pathlib import Path

import numpy as np
import pye57
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pye57 import libe57

from laser_scans import SITE_M, at_site, off_the_sides_m, tum_lines, walk_in_a_room, write_e57
from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan import ScanOptions, read_scan
from planfit.scan.formats.e57 import E57File
from planfit.scan.laser.e57_nodes import make_buffers, names_of, pose_in

DATA = Path(os.environ.get("PLANFIT_SHARED", Path(__file__).parents[2].parent / "shared" / "data"))
REAL = DATA / "real_files" / "e57"
STEP = np.array([1.0, 2.0, 3.0])
FILES = sorted(path.relative_to(REAL).as_posix() for path in REAL.glob("*/*.e57"))


def fields_of(path: Path) -> list[dict[str, np.ndarray]]:
    """All fields of all scans, by the library itself."""
    file = libe57.ImageFile(str(path), "r")
    found = []
    for k in range(file.root()["data3D"].childCount()):
        points = file.root()["data3D"][k]["points"]
        n, prototype = points.childCount(), libe57.StructureNode(points.prototype())
        arrays, buffers = make_buffers(file, prototype, names_of(prototype), max(n, 1))
        if n:
            points.reader(buffers).read()
        found.append({name: values[:n] for name, values in arrays.items()})
    file.close()
    return found


def matrix_of(header):
    """The pose that pye57 reads."""
    return se3.make_transform(header.rotation_matrix, np.asarray(header.translation, dtype=float))


def read(cloud, trajectory, **options):
    return read_scan(cloud, options=ScanOptions(poses=trajectory, **options))


def write_walk(folder, walk, clock_s=0.0, **e57):
    cloud, trajectory = folder / "scan.e57", folder / "trajectory.txt"
    write_e57(cloud, walk, **e57)
    trajectory.write_text("\n".join(tum_lines(walk, clock_s)))
    return cloud, trajectory


@pytest.mark.parametrize("is_spherical", [False, True])
def test_frames_show_the_room_where_it_is(is_spherical, tmp_path):
    walk = at_site(walk_in_a_room())
    scan = read(*write_walk(tmp_path, walk, is_spherical=is_spherical))
    assert scan.format == "e57"
    moved_m = np.rint(walk.poses[0, :3, 3] / 1000) * 1000
    for i in range(0, len(scan), 7):
        points = scan.cameras[i].lift_image(scan.files.depth(i)).reshape(-1, 3)
        world = se3.transform(scan.world_from_cams[i], points[np.isfinite(points[:, 2])]) + moved_m
        assert np.quantile(off_the_sides_m(world, SITE_M), 0.9) < 0.05


@pytest.mark.parametrize(
    "form", [{}, {"is_scaled": True}, {"is_spherical": True}, {"starts_s": (100.0, 101.0)}]
)
def test_what_is_written_back(form, tmp_path):
    """Points moved by a known motion, everything else as it was."""
    walk = at_site(walk_in_a_room(seconds=2.0))
    cloud, trajectory = write_walk(tmp_path, walk, **form)
    scan = read(cloud, trajectory)
    motion = se3.retract(np.eye(4), np.array([0.0, 0.0, 0.001, 0.3, -0.2, 0.1]))
    out = tmp_path / "out"
    out.mkdir()
    scan.files.write_poses(out, motion @ scan.world_from_cams)
    moved_m = np.rint(walk.poses[0, :3, 3] / 1000) * 1000
    before, after = (np.concatenate([p.xyz for p in E57File(path).pieces()])
                     for path in (cloud, out / "scan.e57"))  # fmt: skip
    is_valid = np.concatenate([p.is_valid for p in E57File(cloud).pieces()])
    expected = se3.transform(motion, before - moved_m) + moved_m
    assert_allclose(
        after[is_valid], expected[is_valid], rtol=0, atol=1e-4 if form.get("is_scaled") else 2e-9
    )
    for old, new in zip(fields_of(cloud), fields_of(out / "scan.e57"), strict=True):
        assert {"timeStamp", "intensity", "colorRed", "own:quality"} <= set(new) == set(old)
        for name in set(old) - {f"cartesian{a}" for a in "XYZ"}:
            if not name.startswith("spherical") or name.endswith("State"):
                assert_array_equal(new[name], old[name])
    read_again, original = pye57.E57(str(out / "scan.e57")), pye57.E57(str(cloud))
    header = read_again.get_header(0)
    assert header["name"].value() == "walk"
    # The pose of a scan that moved as a whole has all of the motion, and its points stay where it saw them.
    to_site = se3.make_transform(np.eye(3), moved_m)
    poses = [matrix_of(one.get_header(0)) for one in (read_again, original)]
    of_image = [pose_in(one.root["images2D"][0]) for one in (read_again, original)]
    for refined_pose, pose in (poses, of_image):
        expected = to_site @ motion @ np.linalg.inv(to_site) @ pose
        assert_allclose(refined_pose, expected, rtol=0, atol=5e-9)
    for old, new in zip(fields_of(cloud), fields_of(out / "scan.e57"), strict=True):
        for name in set(old) & {f"cartesian{a}" for a in "XYZ"}:
            assert_allclose(
                new[name], old[name], rtol=0, atol=1e-4 if form.get("is_scaled") else 5e-9
            )
    blob = read_again.root["images2D"][0]["jpegImage"]
    data = np.zeros(100, dtype=np.uint8)
    blob.read(data, 0, 100)
    assert_array_equal(data, np.arange(100))
    if not form.get("is_spherical"):
        points = read_again.read_scan(0, ignore_missing_fields=True)
        assert np.abs(points["cartesianX"] - 2_683_416).max() < 10


def test_each_scan_of_a_file_gets_its_refined_pose(tmp_path):
    """Three scans of a walk whose correction grows: the pose of each has that of half way through it, its
    points the rest, and together they are where the correction of their times puts them."""
    walk, begin_s = walk_in_a_room(seconds=6.0), 1_440_000_000.0
    walk = type(walk)(walk.xyz, walk.times + begin_s, walk.pose_times + begin_s, walk.poses)
    starts_s = tuple(begin_s + np.array([0.0, 2.0, 4.0]))
    cloud, trajectory = write_walk(tmp_path, walk, starts_s=starts_s)
    scan = read(cloud, trajectory)
    times = scan.timestamps - begin_s
    speed = np.array([0.05, -0.02, 0.01])
    refined = scan.world_from_cams.copy()
    refined[:, :3, 3] += times[:, None] * speed
    (tmp_path / "out").mkdir()
    scan.files.write_poses(tmp_path / "out", refined)
    fields = [fields_of(path) for path in (cloud, tmp_path / "out" / "scan.e57")]
    with pye57.E57(str(cloud)) as before, pye57.E57(str(tmp_path / "out" / "scan.e57")) as after:
        for k in range(3):
            old, new = (matrix_of(file.get_header(k)) for file in (before, after))
            assert_allclose(new[:3, :3], old[:3, :3], atol=1e-12)
            assert_allclose(new[:3, 3] - old[:3, 3], (2 * k + 1) * speed, atol=0.02 * 0.25)
            own, moved = (of_file[k] for of_file in fields)
            xyz_own, xyz_moved = (np.stack([one[f"cartesian{a}"] for a in "XYZ"], axis=1)
                                  for one in (own, moved))  # fmt: skip
            assert np.linalg.norm(xyz_moved - xyz_own, axis=1).max() < np.linalg.norm(1.3 * speed)
            expected = se3.transform(old, xyz_own) + np.clip(
                own["timeStamp"] + 2 * k, times[0], times[-1]
            )[:, None] * speed  # fmt: skip
            valid = own["cartesianInvalidState"] == 0
            assert_allclose(se3.transform(new, xyz_moved)[valid], expected[valid], atol=1e-8)


def test_scans_that_count_from_a_start_each(tmp_path):
    """Two scans of one walk: times are seconds since each began, in GPS time; the trajectory has Unix's."""
    walk = walk_in_a_room(seconds=4.0)
    start = 1_440_000_000.0
    later = type(walk)(walk.xyz, walk.times + start, walk.pose_times, walk.poses)
    cloud, trajectory = write_walk(
        tmp_path, later, clock_s=start + 315_964_800 - 18, starts_s=(start, start + 2.0)
    )
    scan = read(cloud, trajectory)
    assert "against Unix time" in scan.warnings[0]
    assert len(np.unique(scan.timestamps)) == 8
    plain, poses = write_walk(tmp_path, walk)
    same = read(plain, poses)
    for i in (2, 17, 30):
        equal = np.isclose(scan.files.depth(i), same.files.depth(i), atol=1e-3, equal_nan=True)
        assert equal.mean() > 0.98


def test_an_e57_without_times(tmp_path):
    name = tmp_path / "plain.e57"
    with pye57.E57(str(name), mode="w") as file:
        file.write_scan_raw({f"cartesian{axis}": np.arange(5.0) for axis in "XYZ"})
    (tmp_path / "t.txt").write_text("0 0 0 0\n1 1 -1 0\n")
    with pytest.raises(
        ScanError, match="expected points with times, found scan 0 with cartesianX, "
    ):
        read(name, tmp_path / "t.txt")


@pytest.mark.shared
@pytest.mark.skipif(not FILES, reason="needs the real E57 files of $PLANFIT_SHARED")
@pytest.mark.parametrize("name", FILES)
def test_real_files_are_read_and_written_back(name, tmp_path):
    """None has times: they are read and moved without."""
    file, out = E57File(REAL / name), tmp_path / "out.e57"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(E57File, "_times", staticmethod(lambda _, n, __: np.zeros(n)))
        patch.setattr(E57File, "_middle_s", lambda *_: 0.0)
        before = [p.xyz for p in file.pieces()]
        file.write_moved(out, lambda xyz, _: xyz + STEP)
        after = [p.xyz for p in E57File(out).pieces()]
        valid = [p.is_valid for p in file.pieces()]
    assert sum(map(len, before)) == file.n_points
    for old, new, ok in zip(before, after, valid, strict=True):
        assert_allclose(new[ok], old[ok] + STEP, rtol=0, atol=2e-4)
    for old, new in zip(fields_of(REAL / name), fields_of(out), strict=True):
        assert set(old) == set(new)
        for field in set(old) - {f"cartesian{axis}" for axis in "XYZ"}:
            assert_array_equal(new[field], old[field])

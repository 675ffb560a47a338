"""Laser scans: the frames that are cut from a cloud show its room, and what is written back is the cloud."""

import os
import random
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation, Slerp

from laser_scans import (
    SITE_M,
    at_site,
    off_the_sides_m,
    tum_lines,
    walk_in_a_room,
    write_las,
    write_walk,
)
from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan import ScanOptions, read_scan
from planfit.scan.formats.las import LasFile
from planfit.scan.laser.faces import find_up

DATA = Path(os.environ.get("PLANFIT_SHARED", Path(__file__).parents[2].parent / "shared" / "data"))
REAL = DATA / "real_files" / "las_laz" / "laspy"
ALL_AROUND, TO_ONE_SIDE = 360.0, 60.0


def read(cloud, trajectory, **options):
    return read_scan(cloud, options=ScanOptions(poses=trajectory, **options))


def attributes_of(path):
    points = laspy.read(path)
    names = [n for n in points.point_format.dimension_names if n not in ("X", "Y", "Z")]
    return {name: np.array(points[name]) for name in names}


@pytest.mark.parametrize(("side_deg", "n_cameras"), [(ALL_AROUND, 4), (TO_ONE_SIDE, 1)])
def test_frames_show_the_room_where_it_is(side_deg, n_cameras, tmp_path):
    """Points of all frames, brought into the world, lie on the sides of the room: at site coordinates, while
    the scanner walks and turns within a frame."""
    walk = at_site(walk_in_a_room(side_deg=side_deg))
    scan = read(*write_walk(tmp_path, walk))
    assert scan.format == "las"
    assert len(scan) == 12 * n_cameras
    assert np.abs(scan.world_from_cams[:, :3, 3]).max() < 1000
    assert scan.warnings[0].startswith(
        "places of frames are the cloud's less (2683000, 1248000, 0) m"
    )
    moved_m = np.rint(walk.poses[0, :3, 3] / 1000) * 1000
    for i in range(0, len(scan), 5):
        image = scan.files.depth(i)
        assert np.isfinite(image).mean() > 0.45
        points = scan.cameras[i].lift_image(image).reshape(-1, 3)
        points = points[np.isfinite(points[:, 2])]
        world = se3.transform(scan.world_from_cams[i], points) + moved_m
        off = off_the_sides_m(world, SITE_M)
        assert np.median(off) < 0.01
        assert np.quantile(off, 0.9) < 0.05
        assert_allclose(scan.world_from_cams[i, :3, 1], [0, 0, -1], atol=1e-12)  # level


def test_order_of_points_does_not_matter(tmp_path):
    """Tiles and voxels are in no order of time."""
    walk = walk_in_a_room(seconds=3.0)
    in_order = read(*write_walk(tmp_path / "a", walk))
    shuffled = np.random.default_rng(1).permutation(len(walk.times))
    mixed = type(walk)(walk.xyz[shuffled], walk.times[shuffled], walk.pose_times, walk.poses)
    scan = read(*write_walk(tmp_path / "b", mixed))
    assert_allclose(scan.timestamps, in_order.timestamps, atol=1e-9)
    for i in (0, 7, 15):
        same = np.isclose(scan.files.depth(i), in_order.files.depth(i), atol=1e-4, equal_nan=True)
        assert same.mean() > 0.995  # a point amid two pixels may fall into either


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_poses_as_recorded_give_the_very_same_cloud(suffix, tmp_path):
    walk = at_site(walk_in_a_room())
    cloud, trajectory = write_walk(tmp_path, walk, suffix)
    scan = read(cloud, trajectory)
    out = tmp_path / "out"
    out.mkdir()
    scan.files.write_poses(out, scan.world_from_cams)
    before, after = laspy.read(cloud), laspy.read(out / cloud.name)
    for name in "XYZ":
        assert_array_equal(after[name], before[name])
    found = attributes_of(out / cloud.name)
    assert {"gps_time", "intensity", "red", "return_number", "range_m"} <= set(found)
    for name, values in attributes_of(cloud).items():
        assert_array_equal(found[name], values)
    assert_array_equal(after.header.offsets, before.header.offsets)
    assert_array_equal(after.header.scales, before.header.scales)
    assert after.header.are_points_compressed == (suffix == ".laz")
    poses, times = (np.loadtxt(out / trajectory.name)[:, k] for k in (slice(1, 8), 0))
    recorded = np.loadtxt(trajectory)
    assert_allclose(times, recorded[:, 0])
    assert_allclose(poses[:, :3], recorded[:, 1:4], atol=2e-9)
    signs = np.sign(np.einsum("ij,ij->i", poses[:, 3:], recorded[:, 4:]))
    assert_allclose(signs[:, None] * poses[:, 3:], recorded[:, 4:], atol=2e-9)


def test_every_point_is_moved_by_the_correction_of_its_time(tmp_path):
    """Against a slow twin: SciPy's Slerp between instants, the scanner's place carried straight."""
    walk = at_site(walk_in_a_room(seconds=3.0))
    cloud, trajectory = write_walk(tmp_path, walk)
    scan = read(cloud, trajectory)
    rng = np.random.default_rng(2)
    instants, of_frame = np.unique(scan.timestamps, return_inverse=True)
    motions = se3.retract(np.eye(4), rng.normal(0.0, [0.001] * 3 + [0.1] * 3, (len(instants), 6)))
    out = tmp_path / "out"
    out.mkdir()
    scan.files.write_poses(out, motions[of_frame] @ scan.world_from_cams)
    moved_m = np.rint(walk.poses[0, :3, 3] / 1000) * 1000

    def places(times):
        return np.stack(
            [np.interp(times, walk.pose_times, walk.poses[:, i, 3]) for i in range(3)], 1
        )

    slerp = Slerp(instants, Rotation.from_matrix(motions[:, :3, :3]))
    xyz, times = laspy.read(cloud).xyz, walk.times
    at = np.clip(times, instants[0], instants[-1])
    centre = places(times) - moved_m
    carried = np.stack([se3.transform(motion, centre) for motion in motions])  # (k, n, 3)
    expected = slerp(at).apply(xyz - moved_m - centre) + moved_m
    for axis in range(3):
        path = np.array([np.interp(t, instants, carried[:, i, axis]) for i, t in enumerate(at)])
        expected[:, axis] += path
    found = laspy.read(out / cloud.name).xyz
    assert np.abs(found - xyz).max() > 0.05
    assert_allclose(found, expected, rtol=0, atol=1.1e-4)  # the file's scale
    # The trajectory goes the same way.
    refined = np.loadtxt(out / trajectory.name)
    for k, instant in enumerate(instants):
        row = int(np.argmin(np.abs(refined[:, 0] - instant)))
        before = se3.transform(motions[k], walk.poses[row : row + 1, :3, 3] - moved_m) + moved_m
        assert np.abs(refined[row, 1:4] - before).max() < 0.02


GPS = 1_440_000_123.4
"""Some GPS second of 2025."""
WEEK = GPS % 604_800
UNIX = GPS + 315_964_800 - 18


@pytest.mark.parametrize(
    ("cloud_s", "is_standard", "trajectory_s", "words"),
    [
        (0.0, False, 0.0, ""),
        (UNIX, False, UNIX, ""),
        (GPS - 1e9, True, GPS - 1e9, ""),
        (GPS - 1e9, True, GPS, "against GPS seconds"),
        (GPS - 1e9, True, UNIX, "against Unix time"),
        (GPS - 1e9, True, WEEK, "against seconds of the GPS week"),
        (WEEK, False, GPS, "against GPS seconds"),
        (WEEK, False, GPS - 1e9, "against GPS seconds less a billion"),
        (WEEK, False, UNIX, "against Unix time"),
        (WEEK, False, UNIX + 18, "against Unix time without leap seconds"),
    ],
)
def test_clocks_of_every_kind(cloud_s, is_standard, trajectory_s, words, tmp_path):
    walk = walk_in_a_room(seconds=4.0, per_second=5000)
    write_las(tmp_path / "s.las", walk, cloud_s, is_standard)
    (tmp_path / "t.txt").write_text("\n".join(tum_lines(walk, trajectory_s)))
    scan = read(tmp_path / "s.las", tmp_path / "t.txt")
    expected = np.repeat(0.25 + 0.5 * np.arange(8), 4)
    assert_allclose(scan.timestamps - trajectory_s, expected, atol=0.02)
    told = [w for w in scan.warnings if "times of the cloud" in w]
    assert [w.endswith(words) for w in told] == ([True] if words else [])


@pytest.mark.parametrize(
    ("cloud_unit", "trajectory_unit"),
    [(1e-3, 1), (1e-6, 1), (1e-9, 1), (1e-15, 1), (1, 1e-3), (1, 1e-6), (1, 1e-9), (1e-9, 1e-9)],
)
@pytest.mark.parametrize(("cloud_s", "trajectory_s"), [(WEEK, WEEK), (WEEK, UNIX)])
def test_clocks_in_other_units(cloud_unit, trajectory_unit, cloud_s, trajectory_s, tmp_path):
    walk = walk_in_a_room(seconds=4.0, per_second=5000)
    write_las(tmp_path / "s.las", walk, cloud_s, per_second=1 / cloud_unit)
    lines = tum_lines(walk, trajectory_s, 1 / trajectory_unit)
    (tmp_path / "t.txt").write_text("\n".join(lines))
    scan = read(tmp_path / "s.las", tmp_path / "t.txt")
    expected = np.repeat(0.25 + 0.5 * np.arange(8), 4)
    assert_allclose(scan.timestamps - trajectory_s, expected, atol=0.02)
    told = [w for w in scan.warnings if "not seconds" in w]
    assert len(told) == (cloud_unit != 1) + (trajectory_unit != 1)
    (tmp_path / "out").mkdir()
    scan.files.write_poses(tmp_path / "out", scan.world_from_cams)
    assert_allclose(laspy.read(tmp_path / "out/s.las").xyz, walk.xyz, atol=2e-4)


def test_a_trajectory_that_is_a_cloud(tmp_path):
    walk = at_site(walk_in_a_room(seconds=4.0, per_second=5000))
    cloud, _ = write_walk(tmp_path, walk)
    path = replace(walk, xyz=walk.poses[:, :3, 3], times=walk.pose_times)
    write_las(tmp_path / "path.laz", path, per_second=1e9)
    scan = read(cloud, tmp_path / "path.laz")
    text = read(cloud, tmp_path / "trajectory.txt")
    assert_allclose(scan.world_from_cams[:, :3, 3], text.world_from_cams[:, :3, 3], atol=1e-3)
    assert any("path.laz: times are nanoseconds" in w for w in scan.warnings)
    moved = scan.world_from_cams.copy()
    moved[:, :3, 3] += [0.5, 0.25, -0.125]
    (tmp_path / "out").mkdir()
    scan.files.write_poses(tmp_path / "out", moved)
    again = laspy.read(tmp_path / "out/path.laz")
    assert_allclose(again.xyz, path.xyz + np.array([0.5, 0.25, -0.125]), atol=2e-4)
    assert_array_equal(again.gps_time, laspy.read(tmp_path / "path.laz").gps_time)
    with pytest.raises(ScanError, match="a cloud itself; give the trajectory"):
        read(cloud, cloud)


def test_clocks_that_nothing_relates_are_refused_unless_told(tmp_path):
    walk = walk_in_a_room(seconds=4.0, per_second=5000)
    cloud, trajectory = write_walk(tmp_path, walk, clock_s=777.25)
    with pytest.raises(ScanError, match=r"expected points at times of trajectory.txt \(-0.250 to 4.2\d+ s\), "
                       r"found 777.2\d+ to 781.2\d+ s .* --cloud-time-offset-s"):  # fmt: skip
        read(cloud, trajectory)
    scan = read(cloud, trajectory, cloud_time_offset_s=-777.25)
    assert "-777.25 s were added" in scan.warnings[0]
    with pytest.raises(ScanError, match="with 5 s added"):
        read(cloud, trajectory, cloud_time_offset_s=5.0)


def test_clocks_that_several_relations_fit_are_refused(tmp_path):
    """The trajectory goes on for a minute at both ends: leap seconds or none, both fit."""
    walk = walk_in_a_room(seconds=4.0, per_second=5000)
    write_las(tmp_path / "s.las", walk, GPS - 1e9, True)
    lines = tum_lines(walk, UNIX)
    words = lines[0].split()[1:]
    longer = [" ".join([f"{UNIX + t:.3f}", *words]) for t in range(-60, 0)]
    longer += [*lines, *(" ".join([f"{UNIX + t:.3f}", *words]) for t in range(5, 65))]
    (tmp_path / "t.txt").write_text("\n".join(longer))
    with pytest.raises(
        ScanError, match=r"several that fit: .* against Unix time .* or .* without leap"
    ):
        read(tmp_path / "s.las", tmp_path / "t.txt")


def test_a_cloud_in_another_coordinate_system(tmp_path):
    walk = walk_in_a_room()
    cloud, trajectory = write_walk(tmp_path, walk)
    write_las(cloud, at_site(walk))
    with pytest.raises(
        ScanError, match="found 100% of them more than 40 m from where the scanner was"
    ):
        read(cloud, trajectory)


def test_a_cloud_without_times_or_without_points(tmp_path):
    walk = walk_in_a_room(seconds=1.0, per_second=1000)
    _, trajectory = write_walk(tmp_path, walk)
    header = laspy.LasHeader(point_format=0, version="1.2")
    plain = laspy.LasData(header)
    plain.x, plain.y, plain.z = walk.xyz.T
    plain.write(str(tmp_path / "plain.las"))
    with pytest.raises(ScanError, match="found point format 0, which has none"):
        read(tmp_path / "plain.las", trajectory)
    laspy.LasData(laspy.LasHeader(point_format=6, version="1.4")).write(str(tmp_path / "none.las"))
    with pytest.raises(ScanError, match=r"none\.las: expected a cloud, found no points"):
        read(tmp_path / "none.las", trajectory)
    write_las(tmp_path / "one.las", type(walk)(walk.xyz, 0 * walk.times + 3, *(0, 0)))
    with pytest.raises(
        ScanError, match="expected points with times of their own, found 3 s for all"
    ):
        read(tmp_path / "one.las", trajectory)


def test_a_cloud_without_its_trajectory(tmp_path):
    cloud, _ = write_walk(tmp_path, walk_in_a_room(seconds=1.0, per_second=1000))
    with pytest.raises(
        ScanError, match=r"give it with --poses FILE.*; beside it are trajectory.txt"
    ):
        read_scan(cloud)


def test_noise_and_withheld_points_take_no_part(tmp_path):
    cloud, trajectory = write_walk(tmp_path, walk_in_a_room())
    marked = laspy.read(cloud)
    bad = np.random.default_rng(3).random(len(marked.points)) < 0.3
    xyz = np.array(marked.xyz)
    xyz[bad] += [0.0, 0.0, 1.0]
    marked.xyz = xyz
    noise, withheld = bad.copy(), bad.copy()
    noise[::2], withheld[1::2] = False, False
    marked.classification, marked.withheld = np.where(noise, 7, 0), withheld
    marked.write(str(tmp_path / "marked.las"))
    scan = read(tmp_path / "marked.las", trajectory)
    for i in (3, 10):
        points = scan.cameras[i].lift_image(scan.files.depth(i)).reshape(-1, 3)
        world = se3.transform(scan.world_from_cams[i], points[np.isfinite(points[:, 2])])
        assert np.quantile(off_the_sides_m(world, np.zeros(3)), 0.95) < 0.05


@pytest.mark.shared
@pytest.mark.skipif(not REAL.is_dir(), reason="needs the real LAS files of $PLANFIT_SHARED")
@pytest.mark.parametrize(
    "name", ["simple.las", "simple.laz", "plane.laz", "test1_4.las", "1_4_w_evlr.laz"]
)
def test_real_clouds_are_read_and_written_back(name, tmp_path):
    file = LasFile(REAL / name)
    before = laspy.read(REAL / name)
    pieces = list(file.pieces())
    assert sum(len(p.times) for p in pieces) == len(before.points) == file.n_points
    assert_array_equal(np.concatenate([p.xyz for p in pieces]), before.xyz)
    assert_array_equal(np.concatenate([p.times for p in pieces]), before.gps_time)
    assert file.clock.is_gps_week == ("1_4" not in name)
    assert_array_equal(np.isin(file.sample_times(), before.gps_time), True)
    step = 1000 * np.array(before.header.scales)
    file.write_moved(tmp_path / name, lambda xyz, _: xyz + step)
    after = laspy.read(tmp_path / name)
    for axis in "XYZ":
        assert_array_equal(after[axis], before[axis] + 1000)
    for dimension in before.point_format.dimension_names:
        if dimension not in "XYZ":
            assert_array_equal(after[dimension], before[dimension])
    assert len(after.header.evlrs or []) == len(before.header.evlrs or [])
    assert [v.record_id for v in after.header.vlrs] == [v.record_id for v in before.header.vlrs]


def test_points_beyond_what_the_file_can_tell(tmp_path):
    cloud, _ = write_walk(tmp_path, walk_in_a_room(seconds=1.0, per_second=500))
    with pytest.raises(ScanError, match="expected points within what scale"):
        LasFile(cloud).write_moved(tmp_path / "far.las", lambda xyz, _: xyz + 1e6)


def mutants(data, n):
    """Cut off, bytes changed anywhere or in the header, a stretch zeroed, put in or taken out."""
    for seed in range(n):
        rng = random.Random(seed)
        at, spoiled = rng.randrange(len(data)), bytearray(data)
        kind = seed % 6
        if kind == 0:
            del spoiled[at:]
        elif kind in (1, 2):
            for _ in range(rng.randrange(1, 60)):
                spoiled[rng.randrange(600 if kind == 1 else len(data))] = rng.randrange(256)
        elif kind == 3:
            spoiled[at : at + 900] = bytes(900)
        elif kind == 4:
            spoiled[at:at] = rng.randbytes(rng.randrange(1, 300))
        else:
            del spoiled[at : at + rng.randrange(1, 2000)]
        yield bytes(spoiled)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_mutants_are_read_or_refused(suffix, tmp_path):
    """lazrs ends the process where a table of chunks claims more memory than there is."""
    walk = walk_in_a_room(seconds=2.0, per_second=2000)
    cloud, trajectory = write_walk(tmp_path, walk, suffix)
    whole = cloud.read_bytes()
    n_refused = 0
    for spoiled in mutants(whole, 18):
        cloud.write_bytes(spoiled)
        try:
            scan = read(cloud, trajectory)
        except ScanError:
            n_refused += 1
        else:
            assert np.isfinite(scan.world_from_cams).all()
    assert n_refused > 3


@pytest.mark.parametrize("up", ["x", "y", "-z"])
def test_clouds_whose_z_is_not_up(up, tmp_path):
    """A y-up cloud is noticed by its path; any other is as the user says."""
    walk = walk_in_a_room()
    turned = {"y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]], "x": [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
              "-z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]]}[up]  # fmt: skip
    rotation = np.array(turned, dtype=float)
    poses = walk.poses.copy()
    poses[:, :3] = rotation @ poses[:, :3]
    # Enough of a walk to tell: to tell which way it goes.
    cloud, trajectory = write_walk(
        tmp_path, type(walk)(walk.xyz @ rotation.T, walk.times, walk.pose_times, poses)
    )
    scan = read(cloud, trajectory, cloud_up=up)
    assert_allclose(
        scan.world_from_cams[:, :3, 1], np.tile(-rotation[:, 2], (len(scan), 1)), atol=1e-9
    )
    points = scan.cameras[5].lift_image(scan.files.depth(5)).reshape(-1, 3)
    world = se3.transform(scan.world_from_cams[5], points[np.isfinite(points[:, 2])])
    assert np.quantile(off_the_sides_m(world @ rotation, np.zeros(3)), 0.9) < 0.05


@pytest.mark.parametrize(
    ("spread", "up"),
    [
        ((8.0, 5.0, 0.1), "z"),
        ((8.0, 0.1, 5.0), "y"),
        ((0.1, 8.0, 5.0), "x"),
        ((8.0, 5.0, 3.0), "z"),  # several storeys
        ((8.0, 0.1, 0.2), "z"),  # straight through a corridor
        ((0.2, 0.2, 9.0), "y"),
    ],
)
def test_up_by_the_path(spread, up):
    path = np.random.default_rng(0).normal(0.0, spread, (500, 3))
    level_from_world, notes = find_up(path, "auto")
    assert_allclose(level_from_world[2], np.eye(3)["xyz".index(up)], atol=1e-12)
    assert len(notes) == (up != "z")

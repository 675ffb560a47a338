"""Laser scans on the command line: read, refined, written back, exported; and files spoiled one by one."""

import re
from pathlib import Path

import laspy
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from laser_scans import SITE_M, at_site, tum_lines, walk_in_a_room, write_e57, write_walk
from planfit.cli import run
from planfit.geometry import se3
from planfit.scan import read_tum
from spoiled_scans import refused, spoken

HARMS = {
    "empty": lambda _: b"",
    "cut off": lambda data: data[: len(data) // 2],
    "zeroes": lambda data: bytes(len(data)),
    "other bytes": lambda _: b"\x89\xff\x00garbage\xfe" * 40,
    "text": lambda _: b"{}",
    "NaN": lambda data: re.sub(rb"-?\d+\.\d{3,}", b"NaN", data),
    "beyond all numbers": lambda data: re.sub(rb"-?\d+\.\d{3,}", b"1e400", data),
}


@pytest.mark.parametrize("suffix", [".las", ".laz", ".e57"])
def test_files_missing_or_spoiled(suffix, tmp_path, capsys):
    walk = walk_in_a_room(seconds=1.0, per_second=3000)
    cloud, trajectory = tmp_path / f"scan{suffix}", tmp_path / "trajectory.txt"
    if suffix == ".e57":
        write_e57(cloud, walk)
        trajectory.write_text("\n".join(tum_lines(walk)))
    else:
        write_walk(tmp_path, walk, suffix)
    for path in (cloud, trajectory):
        whole = path.read_bytes()
        for harm in ("missing", *HARMS):
            if harm == "missing":
                path.unlink()
            elif (data := HARMS[harm](whole)) != whole:
                path.write_bytes(data)
            else:
                continue
            code, errors, notes = spoken(capsys, "inspect", cloud, "--poses", trajectory)
            if code != 0 or path == cloud:
                assert code == 2, f"{path.name} {harm}: {notes}"
                assert path.name in errors[0], f"{harm}: {errors}"
                assert len(errors[0]) < 600
        path.write_bytes(whole)
    assert "give it with --poses FILE" in refused(capsys, "inspect", cloud)


@pytest.mark.slow
def test_refine_and_export(tmp_path, capsys):
    """Without a plan, level and at the floor: files of a run, and the cloud in axes of both kinds."""
    walk = at_site(walk_in_a_room(seconds=4.0, per_second=60_000, side_deg=120.0))
    cloud, trajectory = write_walk(tmp_path, walk, ".laz")
    out = tmp_path / "out"
    words = ["refine", cloud, "--poses", trajectory, "--no-plan", "-o", out, "--workers", 1]
    assert run([str(word) for word in words]) in (0, 1)
    assert sorted(p.name for p in (out / "poses").iterdir()) == ["scan.laz", "trajectory.txt"]
    before, after = laspy.read(cloud), laspy.read(out / "poses" / "scan.laz")
    assert np.abs(before.xyz - after.xyz).max() < 0.2
    assert_array_equal(before.range_m, after.range_m)
    for frame, name in (("world", "w.laz"), ("plan", "p.laz")):
        words = ["export", out, "--to", "cloud", "--frame", frame, "-o", tmp_path / name]
        assert run([str(word) for word in words]) == 0
    assert_allclose(laspy.read(tmp_path / "w.laz").xyz, after.xyz, rtol=0, atol=1.1e-4)
    level = laspy.read(tmp_path / "p.laz")
    assert_array_equal(level.gps_time, before.gps_time)
    assert np.abs(np.quantile(level.z, [0.01, 0.99]) - [0, 2.7]).max() < 0.1
    # As rigid as the poses are: a run's trajectory in the axes of the plan is where the points say.
    times, poses = read_tum(out / "trajectory.tum")
    k = len(times) // 2
    near = np.abs(before.gps_time - times[k]) < 0.02
    moved = np.rint(walk.poses[0, :3, 3] / 1000) * 1000
    recorded = walk.poses[int(np.argmin(np.abs(walk.pose_times - times[k]))), :3, 3]
    reach = np.linalg.norm(before.xyz[near] - recorded, axis=1)
    again = np.linalg.norm(level.xyz[near] - poses[k, :3, 3], axis=1)
    assert_allclose(again, reach, atol=0.1)
    assert np.abs(moved - SITE_M).max() < 1000
    assert se3.rotation_angle(poses[k, :3, :3]) > 0.1
    message = refused(capsys, "export", out, "--to", "cloud", "-o", tmp_path / "x.las")
    assert "expected a file of .laz" in message


def test_the_cloud_of_a_scan_of_images(tmp_path, capsys):
    words = ["synth", tmp_path / "scan", "--walk.n-frames", 3, "--building.n-rooms", 1]
    code = run([str(word) for word in words])
    assert code == 0
    message = refused(
        capsys, "export", tmp_path / "scan", "--to", "cloud", "-o", Path(tmp_path / "x.laz")
    )
    assert "expected a laser scanner's cloud, found a scan of images" in message

"""TUM files: the way there and back, and what is wrong with a line."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import random_transforms
from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan import read_tum, write_tum


def test_round_trip(tmp_path, rng):
    poses = random_transforms(rng, 20)
    poses[0] = np.eye(4)
    poses[1] = se3.make_transform(np.diag([1.0, -1.0, -1.0]), np.array([1e3, -1e-4, 0]))
    times = np.cumsum(rng.uniform(0.01, 1, 20))
    write_tum(tmp_path / "t.tum", times, poses)
    read_times, read = read_tum(tmp_path / "t.tum")
    assert_array_equal(read_times, times)
    assert_allclose(read, poses, atol=5e-9)


def test_seconds_since_1970_keep_their_fraction(tmp_path):
    times = np.array([1305031102.175304, 1305031102.211214])
    write_tum(tmp_path / "t.tum", times, np.tile(np.eye(4), (2, 1, 1)))
    assert_array_equal(read_tum(tmp_path / "t.tum")[0], times)


def test_frame_numbers_stay_whole(tmp_path):
    write_tum(tmp_path / "t.tum", np.array([3.0, 120000.0]), np.tile(np.eye(4), (2, 1, 1)))
    lines = (tmp_path / "t.tum").read_text().splitlines()
    assert [line.split()[0] for line in lines] == ["3", "120000"]
    assert all(len(line.split()) == 8 for line in lines)


def test_order_is_x_y_z_w_and_comments_are_skipped(tmp_path):
    half = np.sqrt(0.5)
    (tmp_path / "t.tum").write_text(f"# time ...\n\n1.5 1 2 3 0 0 {half} {half} # a quarter turn\n")
    times, poses = read_tum(tmp_path / "t.tum")
    assert_array_equal(times, [1.5])
    assert_allclose(poses[0], se3.yaw_transform(np.pi / 2, np.array([1.0, 2, 3])), atol=1e-12)


def test_quaternions_need_not_be_unit(tmp_path):
    (tmp_path / "t.tum").write_text("0 0 0 0 0 0 3 3\n")
    assert_allclose(read_tum(tmp_path / "t.tum")[1][0], se3.yaw_transform(np.pi / 2), atol=1e-12)


@pytest.mark.parametrize(
    "line",
    [
        "1 2 3",
        "0 0 0 0 0 0 0 1 9",
        "0,0,0,0,0,0,0,1",
        "nan 0 0 0 0 0 0 1",
        "0 1e300 0 0 0 0 0 1",
        "time x y z a b c d",
    ],
)
def test_malformed_lines_are_named_by_number(tmp_path, line):
    (tmp_path / "bad.tum").write_text(f"# header\n0 0 0 0 0 0 0 1\n{line}\n")
    with pytest.raises(ScanError, match=r"bad\.tum, line 3: expected eight"):
        read_tum(tmp_path / "bad.tum")


@pytest.mark.parametrize("line", ["1 0 nan 0 0 0 0 1", "1 inf 0 0 0 0 0 1", "1 0 0 0 0 0 0 0"])
def test_lines_of_a_lost_tracker_are_left_out(tmp_path, line):
    (tmp_path / "lost.tum").write_text(f"0 0 0 0 0 0 0 1\n{line}\n2 0 0 0 0 0 0 1\n")
    assert_array_equal(read_tum(tmp_path / "lost.tum")[0], [0, 2])


def test_files_without_poses(tmp_path):
    (tmp_path / "empty.tum").write_text("# nothing\n")
    with pytest.raises(ScanError, match=r"empty\.tum"):
        read_tum(tmp_path / "empty.tum")
    with pytest.raises(ScanError, match=r"nowhere\.tum"):
        read_tum(tmp_path / "nowhere.tum")
    (tmp_path / "bytes.tum").write_bytes(b"\xff\xfe\x81")
    with pytest.raises(ScanError, match=r"bytes\.tum"):
        read_tum(tmp_path / "bytes.tum")
    with pytest.raises(ScanError, match=tmp_path.name):
        read_tum(tmp_path)

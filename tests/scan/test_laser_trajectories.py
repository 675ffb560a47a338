"""Trajectories of laser scanners, in the forms that programs write them, read and written back."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.laser.trajectory import read_trajectory

N = 30
TIMES = 100.0 + 0.05 * np.arange(N)
ROTATIONS = Rotation.from_euler("zyx", np.random.default_rng(0).uniform(-1, 1, (N, 3)))
PLACES = np.random.default_rng(1).normal([2_600_000.0, 1_200_000.0, 400.0], 3, (N, 3))
POSES = se3.make_transform(ROTATIONS.as_matrix(), PLACES)
X, Y, Z, W = ROTATIONS.as_quat().T


def table(header, *columns, separator=" "):
    rows = [separator.join(f"{v:.9f}" for v in row) for row in zip(*columns, strict=True)]
    return "\n".join([*header, *rows]) + "\n"


def hdmapping():
    """As HDMapping's lidar_odometry_step_1 names its columns: nanoseconds, 3x4 by row."""
    names = ["timestamp_nanoseconds", *(f"pose{i}{j}" for i in range(3) for j in range(4)),
             "timestampUnix_nanoseconds", "om_rad", "fi_rad", "ka_rad"]  # fmt: skip
    columns = [POSES[:, i, j] for i in range(3) for j in range(4)]
    return table([" ".join(names)], TIMES * 1e9, *columns, *[np.zeros(N)] * 4)


FORMS = {
    "tum": (table([], TIMES, *PLACES.T, X, Y, Z, W), True),
    "tum with a header": (table(["# timestamp x y z qx qy qz qw"], TIMES, *PLACES.T, X, Y, Z, W), True),
    # raycloudtools: positions, then whatever the user has.
    "raycloudtools": (table(["%time x y z userfields"], TIMES, *PLACES.T, X, Y), False),
    "w first": (table(["%time x y z qw qx qy qz"], TIMES, *PLACES.T, W, X, Y, Z), True),
    "w first by number": (
        table(["%time x y z q0 q1 q2 q3 userfields"], TIMES, *PLACES.T, W, X, Y, Z, X), True),
    "hdmapping": (hdmapping(), True),
    "navvis": (
        table(["# pano poses v1.0: ID; filename; timestamp; pano_pos_x; pano_pos_y; pano_pos_z; pano_ori_w; "
               "pano_ori_x; pano_ori_y; pano_ori_z"],
              np.arange(N), np.arange(N), TIMES, *PLACES.T, W, X, Y, Z, separator="; "), True),
    "riprocess": (
        table(["Time[s],Easting[m],Northing[m],Height[m],Roll[deg],Pitch[deg],Yaw[deg]"],
              TIMES, *PLACES.T, X, Y, Z, separator=","), False),
    "time x y z": (table([], TIMES, *PLACES.T), False),
    "x y z time": (table([], *PLACES.T, TIMES), False),
    "cloudcompare": (table(["//X Y Z GpsTime"], *PLACES.T, TIMES), False),
    "trjt": (table(["#version=1.0", "#timebase=0"], *PLACES.T, TIMES, separator="\t"), False),
    "euroc": (
        table(["#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],"
               "q_RS_z []"],
              TIMES * 1e9, *PLACES.T, W, X, Y, Z, separator=","), True),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_read_and_written_back(form, tmp_path):
    text, has_rotation = FORMS[form]
    path, out = tmp_path / "t.txt", tmp_path / "out.txt"
    path.write_text(text)
    found = read_trajectory(path)
    assert bool({"qw", "r00"} & set(found.columns)) == has_rotation
    assert_allclose(found.times, TIMES, rtol=0, atol=1e-7)
    assert_allclose(found.world_from_scanner[:, :3, 3], PLACES, rtol=0, atol=1e-8)
    if has_rotation:
        assert_allclose(found.world_from_scanner, POSES, atol=1e-7)
    offset = np.array([2_600_000.0, 1_200_000.0, 0.0])
    moved = found.moved(offset)
    motion = se3.retract(np.eye(4), np.array([0.1, -0.2, 0.3, 1.0, 2.0, 3.0]))
    moved.write(out, motion @ moved.world_from_scanner)
    again = read_trajectory(out)
    assert_allclose(again.times, found.times, rtol=0, atol=1e-7)
    near = POSES.copy()
    near[:, :3, 3] -= offset
    expected = motion @ near
    expected[:, :3, 3] += offset
    assert_allclose(again.world_from_scanner[:, :3, 3], expected[:, :3, 3], rtol=0, atol=2e-9)
    if has_rotation:
        assert_allclose(again.world_from_scanner, expected, atol=1e-7)
    assert again.header[:1] == found.header[:1] or form == "riprocess"
    if form == "riprocess":
        assert out.read_text().startswith("Time[s],Easting[m],Northing[m],Height[m]\n")
        assert "roll, pitch, yaw" in found.warnings[0]
        assert again.warnings == ()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (table(["time latitude longitude height"], TIMES, *PLACES.T), "found latitude and longitude"),
        (table([], *[TIMES] * 12), "KITTI's twelve numbers a line, which have none"),
        (table([], *[TIMES] * 4), "of which both the first and the last go on"),
        (table([], *PLACES.T, PLACES[:, 0]), "of which neither goes on"),
        (table([], *[TIMES] * 6), "found 6 columns without a header"),
        (table(["a b c d e f"], *[TIMES] * 6), "found 6 columns without a header"),
        ("", "found no line of numbers"),
        ("1 2 3 4\n1 2 3\n1 2 3 4\n", "expected lines of one length, found 3 to 4 words"),
        (table([], TIMES, *PLACES.T, X, Y, Z, 5 + W), "expected unit quaternions"),
        (table([], 0 * TIMES, *PLACES.T, X, Y, Z, W), "at times that go on"),
        (table([], TIMES, *(PLACES.T * 1e6), X, Y, Z, W), "places in metres"),
        (table([], TIMES[:1], *PLACES[:1].T, X[:1], Y[:1], Z[:1], W[:1]), "found 1 poses"),
    ],
)  # fmt: skip
def test_what_leaves_something_open_is_refused(text, words, tmp_path):
    path = tmp_path / "t.txt"
    path.write_text(text)
    with pytest.raises(ScanError, match=words) as caught:
        read_trajectory(path)
    assert str(caught.value).startswith(f"{path}: expected ")


def test_a_binary_trajectory_is_named(tmp_path):
    (tmp_path / "sbet.out").write_bytes(np.zeros(34).tobytes())
    with pytest.raises(ScanError, match="found a binary SBET, which has latitude and longitude"):
        read_trajectory(tmp_path / "sbet.out")
    with pytest.raises(
        ScanError, match=r"gone\.txt: expected a trajectory.* found none that can be read"
    ):
        read_trajectory(tmp_path / "gone.txt")


def test_a_line_cut_off_at_the_end_and_poses_that_were_lost(tmp_path):
    lines = FORMS["tum"][0].splitlines()
    lines[4] = "100.2 nan nan nan nan nan nan nan"
    (tmp_path / "t.txt").write_text("\n".join([*lines[:-1], lines[-1][:30]]))
    found = read_trajectory(tmp_path / "t.txt")
    assert_allclose(found.times, np.delete(TIMES, [4, N - 1]))

"""Another tracker's poses in place of the scan's own: TUM, KITTI, Open3D log."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan import ScanOptions, read_scan
from planfit.scan.pose_files import read_poses
from planfit.scan.tables import number_table
from scan_samples import N, matrix_text, quaternion, write_seven_scenes, write_stray, write_tum


def other_poses(sample):
    """The same walk in axes of another tracker, drifted."""
    transform = se3.make_transform(
        se3.exp_so3(np.array([1.0, 0.2, -0.7])), np.array([5.0, -3.0, 1.0])
    )
    poses = transform @ sample.poses
    poses[:, :3, 3] += np.linspace(0, 0.3, N)[:, None]
    return poses


def tum_text(times, poses):
    rows = (
        " ".join(f"{v:.9f}" for v in (t, *pose[:3, 3], *quaternion(pose)))
        for t, pose in zip(times, poses, strict=True)
    )
    return "# a tracker\n" + "\n".join(rows) + "\n"


def kitti_text(poses):
    return "\n".join(" ".join(f"{v:.9e}" for v in pose[:3].ravel()) for pose in poses) + "\n"


def log_text(numbers, poses):
    return "".join(
        f"{i} {i} {i + 1}\n{matrix_text(p)}" for i, p in zip(numbers, poses, strict=True)
    )


@pytest.fixture
def scenes(sample, tmp_path):
    """7-Scenes: frames have numbers and no time, 0 to 5."""
    write_seven_scenes(tmp_path / "scan", sample)
    return tmp_path / "scan"


def take(scan_path, tmp_path, text, **options):
    path = tmp_path / "poses.txt"
    path.write_text(text)
    return read_scan(scan_path, options=ScanOptions(poses=path, **options))


def euroc_text(times, poses):
    """As EuRoC's ground truth: nanoseconds, w first, and columns behind that are no pose."""
    lines = [
        "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y []"
    ]
    for time, pose in zip(times, poses, strict=True):
        x, y, z, w = quaternion(pose)
        numbers = ",".join(f"{v:.9f}" for v in (*pose[:3, 3], w, x, y, z, *[0.125] * 9))
        lines.append(f"{round(time * 1e9)},{numbers}")
    return "\n".join(lines) + "\n"


def named_text(times, poses, header, separator):
    """A table whose header names its columns, in any order."""
    lines = [header]
    for k, (time, pose) in enumerate(zip(times, poses, strict=True)):
        x, y, z = pose[:3, 3]
        qx, qy, qz, qw = quaternion(pose)
        values = {"x": x, "y": y, "z": z, "qx": qx, "qy": qy, "qz": qz, "qw": qw, "frame": k}
        words = {name: f"{value:.9f}" for name, value in values.items()}
        words |= {"t_rel_s": f"{time:.6f}", "timestamp": f"{time:.6f}", "time": f"{time:.6f}"}
        names = [word.strip(" #") for word in header.lstrip("# ").split(separator)]
        lines.append(separator.join(words[name] for name in names))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("header", "separator"),
    [
        ("timestamp,x,y,z,qx,qy,qz,qw", ","),
        ("timestamp, frame, x, y, z, qx, qy, qz, qw", ","),  # Stray Scanner's odometry.csv
        ("time;qw;qx;qy;qz;x;y;z", ";"),
        ("# time x y z qw qx qy qz", " "),  # raycloudtools: read as TUM, w would be taken for x
    ],
)
def test_columns_that_a_header_names(sample, tmp_path, header, separator):
    poses = other_poses(sample)
    path = tmp_path / "poses.csv"
    path.write_text(named_text(sample.times, poses, header, separator))
    table = read_poses(path)
    assert table.kind == "tum"
    assert_allclose(table.keys, sample.times, atol=1e-6)
    assert_allclose(table.poses, poses, atol=1e-7)


@pytest.mark.parametrize("by_column", [False, True])
def test_whole_matrices_a_line(sample, tmp_path, by_column):
    poses = other_poses(sample)
    rows = poses.transpose(0, 2, 1) if by_column else poses
    path = tmp_path / "traj.txt"
    path.write_text("\n".join(" ".join(f"{v:.9e}" for v in pose.ravel()) for pose in rows) + "\n")
    table = read_poses(path)
    assert table.kind == "kitti"
    assert_allclose(table.poses, poses, atol=1e-8)


def test_eurocs_table_and_rtabmaps_numbers(sample, tmp_path):
    poses = other_poses(sample)
    numbered = tum_text(sample.times, poses).splitlines()
    numbered = [numbered[0], *(f"{line} {i + 7}" for i, line in enumerate(numbered[1:]))]
    for text in (euroc_text(sample.times, poses), "\n".join(numbered)):
        path = tmp_path / "poses.csv"
        path.write_text(text)
        table = read_poses(path)
        assert table.kind == "tum"
        assert_allclose(table.keys, sample.times, rtol=0, atol=1e-6)
        assert_allclose(table.poses, poses, atol=1e-8)


def test_a_damaged_table_of_euroc(sample, tmp_path):
    path = tmp_path / "poses.csv"
    rows = euroc_text(sample.times, sample.poses).splitlines()
    for row in (rows[1].replace("0.125000000", "x").replace(",", ",x", 1), "1,2,3,4,5,6,7,8"):
        path.write_text("\n".join([rows[0], rows[1], row]) + "\n")
        with pytest.raises(ScanError, match=r"poses\.csv, line 2"):
            read_poses(path)


def test_kinds_are_told_by_their_lines(sample, tmp_path):
    poses = other_poses(sample)
    for kind, text in (
        ("tum", tum_text(sample.times, poses)),
        ("kitti", kitti_text(poses)),
        ("log", log_text(range(N), poses)),
    ):
        path = tmp_path / f"{kind}.txt"
        path.write_text(text)
        table = read_poses(path)
        assert table.kind == kind
        assert_allclose(table.poses, poses, atol=1e-7)


def test_tum_by_time_with_the_frames_without_a_pose_left_out(sample, tmp_path):
    write_tum(tmp_path / "scan", sample)
    poses = other_poses(sample)
    kept = [0, 1, 3, 4]
    scan = take(tmp_path / "scan", tmp_path, tum_text(sample.times[kept], poses[kept]),
                max_time_gap_s=0.005)  # fmt: skip
    assert_allclose(scan.world_from_cams, poses[kept], atol=1e-7)
    assert_allclose(scan.timestamps, sample.times[kept], atol=1e-6)
    for i, frame in enumerate(kept):
        assert_array_equal(scan.files.color(i), sample.color[frame])
    assert len(scan.skipped) == 2
    assert "poses.txt has no pose" in scan.skipped[0]


def test_poses_are_written_to_the_frames_they_belong_to(sample, scenes, tmp_path):
    poses = other_poses(sample)
    scan = take(scenes, tmp_path, log_text([1, 4], poses[[1, 4]]))
    assert scan.frame_ids == ("000001", "000004")
    out = tmp_path / "out"
    out.mkdir()
    scan.files.write_poses(out, scan.world_from_cams)
    assert {p.name for p in out.iterdir()} == {"frame-000001.pose.txt", "frame-000004.pose.txt"}
    assert_allclose(np.loadtxt(out / "frame-000004.pose.txt"), poses[4], atol=1e-8)


def test_tum_by_number_where_the_scan_has_no_time(sample, scenes, tmp_path):
    poses = other_poses(sample)
    scan = take(scenes, tmp_path, tum_text(np.arange(N), poses))
    assert_allclose(scan.world_from_cams, poses, atol=1e-7)


def test_kitti_by_row_and_by_number(sample, scenes, tmp_path):
    poses = other_poses(sample)
    assert_allclose(take(scenes, tmp_path, kitti_text(poses)).world_from_cams, poses, atol=1e-7)
    # A frame is missing from the scan, not from the poses: rows are numbers then.
    (scenes / "frame-000002.pose.txt").unlink()
    kept = [0, 1, 3, 4, 5]
    scan = take(scenes, tmp_path, kitti_text(poses))
    assert_allclose(scan.world_from_cams, poses[kept], atol=1e-7)
    with pytest.raises(
        ScanError, match=r"poses\.txt: expected a row for each of 5 frames, found 3"
    ):
        take(scenes, tmp_path, kitti_text(poses[:3]))


def test_a_whole_log_by_order_and_part_of_one_by_number(sample, scenes, tmp_path):
    poses = other_poses(sample)
    whole = take(scenes, tmp_path, log_text(range(N), poses))
    assert_allclose(whole.world_from_cams, poses, atol=1e-7)
    part = take(scenes, tmp_path, log_text([0, 5], poses[[0, 5]]))
    assert part.frame_ids == ("000000", "000005")


def test_the_other_trackers_world_is_its_own(sample, tmp_path):
    write_stray(tmp_path / "scan", sample)
    assert read_scan(tmp_path / "scan").up_world is not None
    scan = take(tmp_path / "scan", tmp_path, tum_text(sample.times, other_poses(sample)))
    assert scan.up_world is None


def test_the_fingerprint_tells_the_poses(sample, scenes, tmp_path):
    poses = other_poses(sample)
    first = take(scenes, tmp_path, kitti_text(poses)).fingerprint
    assert take(scenes, tmp_path, kitti_text(poses)).fingerprint == first
    poses[0, 0, 3] += 0.01
    assert take(scenes, tmp_path, kitti_text(poses)).fingerprint != first


def test_times_that_never_match(sample, tmp_path):
    write_tum(tmp_path / "scan", sample)
    text = tum_text(sample.times - 1e9, other_poses(sample))
    with pytest.raises(
        ScanError,
        match=r"poses\.txt: expected poses at times between 1305031102\.175 and 1305031102\.342.*--max-time",
    ):
        take(tmp_path / "scan", tmp_path, text)


BAD = {
    "nothing": ("", "found lines of nothing"),
    "seven numbers": ("1 2 3 4 5 6 7\n", "found lines of 7"),
    "words": ("one two three four five six seven eight nine ten eleven twelve\n", "numbers alone"),
    "no rotation": ("2 0 0 0 0 2 0 0 0 0 2 0\n", "pose 0: expected a rotation"),
    "beyond all": ("1e99 0 0 0 0 1 0 0 0 0 1 0\n", "pose 0: expected finite numbers"),
    "a log cut off": ("0 0 1\n1 0 0 0\n0 1 0 0\n", "found lines of 3, 4"),
}


@pytest.mark.parametrize("kind", BAD)
def test_files_that_hold_no_poses(kind, scenes, tmp_path):
    text, words = BAD[kind]
    with pytest.raises(ScanError, match=words):
        take(scenes, tmp_path, text)


def test_a_missing_file(scenes, tmp_path):
    with pytest.raises(ScanError, match=r"nowhere\.txt: .*poses, found none that can be read"):
        read_scan(scenes, options=ScanOptions(poses=tmp_path / "nowhere.txt"))


NUMBERS = st.lists(
    st.floats(-1e6, 1e6, allow_nan=False).map(lambda v: round(v, 6)), min_size=8, max_size=8
)


@given(rows=st.lists(NUMBERS, min_size=1, max_size=6), comma=st.booleans(), note=st.booleans())
def test_tables_read_at_once_are_those_read_line_by_line(rows, comma, note):
    text = "# a note\n" if note else ""
    text += "\n".join((", " if comma else " ").join(map(repr, row)) for row in rows) + "\n"
    at_once = number_table(text.replace(",", " "))
    assert_array_equal(at_once, np.array(rows))


@pytest.mark.parametrize("text", ["", "# only\n# notes\n", "1 2\n3\n", "1 x\n", "1,2\n"])
def test_what_is_no_table_of_numbers_is_none(text):
    assert number_table(text) is None


def test_of_many_poses_the_first_that_is_none_is_named(tmp_path):
    rows = np.tile(np.eye(4)[:3].ravel(), (50, 1))
    rows[7] = 0.0  # lost: left out later
    rows[9, 3] = np.inf  # lost too
    path = tmp_path / "kitti.txt"
    np.savetxt(path, rows)
    assert len(read_poses(path).poses) == 50
    for entry, value, words in (
        (0, 3.0, "rotation"),
        (0, -1.0, "right-handed"),
        (3, 1e12, "finite"),
    ):
        bad = rows.copy()
        bad[20, entry] = value
        np.savetxt(path, bad)
        with pytest.raises(ScanError, match=rf"kitti\.txt: pose 20: .*{words}"):
            read_poses(path)


def test_four_numbers_with_decimal_commas_are_no_eight(tmp_path):
    path = tmp_path / "comma.txt"
    path.write_text("0,5 1,2 3,4 5,6\n1,5 2,2 3,4 5,6\n")
    with pytest.raises(ScanError, match=r"comma\.txt: expected poses .* found lines of 4"):
        read_poses(path)


@pytest.mark.parametrize("separator", [" ", "\t", ";", " ; "])
def test_decimal_commas_are_read_where_other_marks_stand_between_numbers(
    separator, sample, tmp_path
):
    path = tmp_path / "poses.txt"
    text = tum_text(sample.times, sample.poses).replace(" a tracker", " a, b")
    rows = text.replace(".", ",").replace(" ", separator)
    path.write_text(rows.replace(f"#{separator}a", "# a"))
    table = read_poses(path)
    assert_allclose(table.keys, sample.times, atol=1e-9)
    assert_allclose(table.poses, sample.poses, atol=1e-7)
    path.write_text(kitti_text(sample.poses).replace(".", ","))
    assert_allclose(read_poses(path).poses, sample.poses, atol=1e-7)


def test_points_and_semicolons_are_read(sample, tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text(tum_text(sample.times, sample.poses).replace(" ", ";"))
    assert_allclose(read_poses(path).poses, sample.poses, atol=1e-7)


def test_commas_that_may_be_both_are_named(sample, tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text(tum_text(sample.times, sample.poses).replace(".", ",").replace(" ", ","))
    with pytest.raises(ScanError, match="decimal commas with commas between numbers"):
        read_poses(path)

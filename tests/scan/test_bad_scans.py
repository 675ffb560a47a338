"""Bad input in every format: one line that names the file, what was looked for, and what to do."""

import gc
import hashlib
import json
import os
import struct
import zipfile

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from planfit.errors import FloorplanError, ScanError
from planfit.floorplan import read_floorplan
from planfit.scan import ScanOptions, corrupt_frames, read_scan
from planfit.scan.formats import READERS
from planfit.scan.formats.stray import STRAY
from planfit.scan.source import open_source
from planfit.synth import SynthOptions, WalkOptions, make_scan, write_facap
from scan_samples import (
    HEIGHT,
    WIDTH,
    WRITERS,
    N,
    png,
    put,
    record3d_files,
    write_nerfstudio,
    write_polycam,
    write_redwood,
    write_replica,
    write_scanner_app,
    write_scannet,
    write_seven_scenes,
    write_stray,
    write_tum,
    write_video,
    write_zip,
)


def refused(path, *words, **options):
    """The error is a ScanError of one line, which names each of `words`."""
    with pytest.raises(ScanError) as caught:
        read_scan(path, options=ScanOptions(**options))
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message, message
    return message


def test_an_unknown_folder_says_what_was_looked_for(tmp_path):
    put(tmp_path / "letter.doc", b"")
    message = refused(tmp_path, str(tmp_path), "'planfit help scan-formats'")
    for name in READERS:
        assert f" {name}" in message


def test_a_scene_of_several_scans_names_them(sample, tmp_path):
    write_seven_scenes(tmp_path / "chess" / "seq-01", sample)
    refused(
        tmp_path / "chess",
        f"found a folder that holds {tmp_path / 'chess' / 'seq-01'} (7-scenes); give it",
    )


def test_a_link_that_leads_in_a_circle(tmp_path):
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    refused(tmp_path / "a", str(tmp_path / "a"), "cannot be opened")


def test_circles_inside_a_scan_are_not_followed(sample, tmp_path):
    write_redwood(tmp_path / "scan", sample)
    (tmp_path / "scan" / "color" / "again").symlink_to(tmp_path / "scan")
    (tmp_path / "scan" / "depth" / "00006.png").symlink_to(
        tmp_path / "scan" / "depth" / "00006.png"
    )
    assert len(read_scan(tmp_path / "scan")) == N


@pytest.mark.parametrize(
    "name", ["../evil.txt", "/etc/evil", "a/../../evil", "..\\evil", "C:/evil"]
)
def test_archives_that_point_outside(name, sample, tmp_path):
    write_zip(tmp_path / "scan.r3d", record3d_files(sample) | {name: b"evil"})
    refused(tmp_path / "scan.r3d", "points outside", "evil")


def test_an_archive_with_a_link(sample, tmp_path):
    path = tmp_path / "scan.r3d"
    write_zip(path, record3d_files(sample))
    with zipfile.ZipFile(path, "a") as archive:
        link = zipfile.ZipInfo("rgbd/9.jpg")
        link.external_attr = 0o120777 << 16
        archive.writestr(link, "/etc/passwd")
    refused(path, "points outside", "rgbd/9.jpg")


def test_an_archive_that_is_cut_off(sample, tmp_path):
    path = tmp_path / "scan.r3d"
    write_zip(path, record3d_files(sample))
    path.write_bytes(path.read_bytes()[:-3000])
    refused(path, "scan.r3d")


@pytest.mark.parametrize(
    "kind",
    ["tum", "7-scenes", "scannet", "polycam", "scanner-app", "redwood", "nerfstudio", "replica",
     "colmap", "stray", "facap", "arkit-scenes", "scannetpp"],
)  # fmt: skip
def test_a_zipped_folder_reads_like_the_folder(kind, sample, tmp_path):
    folder, path = tmp_path / "scan", tmp_path / "scan.zip"
    if kind == "facap":
        write_facap(folder, make_scan(SynthOptions(walk=WalkOptions(n_frames=N))))
    else:
        WRITERS[kind](folder, sample)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(folder.rglob("*")):
            archive.write(file, file.relative_to(tmp_path))
    plain, zipped = read_scan(folder), read_scan(path)
    assert zipped.format == kind
    assert_array_equal(plain.world_from_cams, zipped.world_from_cams)
    assert_array_equal(plain.files.depth(2), zipped.files.depth(2))
    assert_array_equal(plain.files.color(N - 1), zipped.files.color(N - 1))


def zip_of(path, folder):
    with zipfile.ZipFile(path, "w") as archive:
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                archive.write(file, file.relative_to(folder))


def test_several_sessions_in_one_archive(sample, tmp_path):
    write_stray(tmp_path / "all" / "monday" / "71de12f9", sample)
    write_scannet(tmp_path / "all" / "tuesday", sample)
    put(tmp_path / "all" / "readme.txt", b"notes")
    path = tmp_path / "scans.zip"
    zip_of(path, tmp_path / "all")
    refused(
        path, "expected one scan in the archive, found 2", f"{path}/monday/71de12f9, {path}/tuesday"
    )
    monday, tuesday = read_scan(path / "monday"), read_scan(path / "tuesday")
    assert (monday.format, tuesday.format) == ("stray", "scannet")
    assert monday.name == str(path / "monday" / "71de12f9")
    assert_array_equal(monday.files.color(3).shape, (96, 128, 3))
    again = read_scan(monday.name)
    assert_array_equal(again.world_from_cams, monday.world_from_cams)
    assert monday.fingerprint == again.fingerprint
    refused(path / "friday", str(path / "friday"), "expected a scan, found none of this name")
    refused(tmp_path / "nothing.zip" / "friday", "expected the folder of a scan, found nothing")


def test_the_only_scan_of_an_archive_is_read_however_deep_it_lies(sample, tmp_path):
    write_stray(tmp_path / "all" / "export" / "2024" / "office", sample)
    put(tmp_path / "all" / "__MACOSX" / "x", b"")
    put(tmp_path / "all" / "readme.txt", b"notes")
    zip_of(tmp_path / "scan.zip", tmp_path / "all")
    scan = read_scan(tmp_path / "scan.zip")
    assert (scan.format, len(scan)) == ("stray", N)


def test_a_zipped_plan_is_the_plan_of_the_folder(tmp_path):
    folder, path = tmp_path / "scan", tmp_path / "scan.zip"
    write_facap(folder, make_scan(SynthOptions(walk=WalkOptions(n_frames=2))))
    with zipfile.ZipFile(path, "w") as archive:
        for file in sorted(folder.rglob("*")):
            archive.write(file, file.relative_to(tmp_path))
    scan = read_scan(path)
    assert scan.floorplan_path == path / "scan" / "floorplan.npy"
    plan, zipped = (read_floorplan(p) for p in (folder / "floorplan.npy", scan.floorplan_path))
    assert zipped.name == str(scan.floorplan_path)
    assert zipped.fingerprint == plan.fingerprint
    assert_array_equal(zipped.ends, plan.ends)
    with pytest.raises(FloorplanError, match="expected a floorplan, found nothing"):
        read_floorplan(path / "scan" / "other.npy")


def test_what_is_unpacked_goes_with_the_scan(sample, tmp_path):
    write_stray(tmp_path / "scan", sample)
    zip_of(tmp_path / "scan.zip", tmp_path / "scan")
    recording = STRAY.read(open_source(tmp_path / "scan.zip"), ScanOptions())
    video = recording.images.video
    assert video.path == tmp_path / "scan.zip" / "rgb.mp4"
    assert video.file.read_bytes() == (tmp_path / "scan" / "rgb.mp4").read_bytes()
    unpacked = video.file.parent
    del recording, video
    gc.collect()
    assert not unpacked.exists()


@pytest.mark.parametrize("kind", WRITERS)
def test_nothing_of_the_input_is_changed(kind, sample, tmp_path):
    path = tmp_path / "in" / ("capture.r3d" if kind == "record3d" else "scan")
    path.parent.mkdir()
    WRITERS[kind](path, sample)

    def state():
        files = sorted(p for p in path.parent.rglob("*") if p.is_file())
        return [
            (str(p), hashlib.sha256(p.read_bytes()).hexdigest(), p.stat().st_mtime_ns)
            for p in files
        ]

    before = state()
    out = tmp_path / "out"
    out.mkdir()
    scan = read_scan(path)
    scan.files.color(0), scan.files.depth(0)
    scan.files.write_poses(out, scan.world_from_cams)
    assert state() == before


# Video.


def test_a_video_that_ends_early(sample, tmp_path):
    write_stray(tmp_path, sample)
    write_video(tmp_path / "rgb.mp4", sample.color[:4])
    scan = read_scan(tmp_path)
    assert len(scan) == 4
    assert scan.skipped == (
        "frame 000004: the video ends after 4 frames",
        "frame 000005: the video ends after 4 frames",
    )
    scan.files.color(3)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_a_video_that_is_cut_off(share, sample, tmp_path):
    write_stray(tmp_path, sample)
    path = tmp_path / "rgb.mp4"
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    refused(tmp_path, "rgb.mp4", "expected a video", "copy it again")


def test_a_video_spoiled_in_the_middle_is_an_error_or_a_picture(sample, tmp_path):
    write_stray(tmp_path, sample)
    path = tmp_path / "rgb.mp4"
    data = bytearray(path.read_bytes())
    begin = data.find(b"mdat") + 1500
    data[begin : begin + 4000] = bytes(4000)
    path.write_bytes(bytes(data))
    scan = read_scan(tmp_path)
    outcomes = []
    for i in range(N):
        try:
            outcomes.append(scan.files.color(i).shape)
        except ScanError as error:
            outcomes.append("rgb.mp4" in str(error))
    assert set(outcomes) <= {(96, 128, 3), True}


def test_depth_shorter_than_colour(sample, tmp_path):
    write_stray(tmp_path, sample)
    for i in (4, 5):
        (tmp_path / "depth" / f"{i:06d}.png").unlink()
    scan = read_scan(tmp_path)
    assert scan.lacking == ("", "", "", "", "depth", "depth")
    assert "2 of 6 frames have no depth" in scan.warnings[0]
    assert not np.isfinite(scan.files.depth(4)).any()
    assert scan.files.color(4) is not None


def test_odometry_of_another_shape(sample, tmp_path):
    write_stray(tmp_path, sample)
    path = tmp_path / "odometry.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:3], lines[3][:40]]) + "\n")
    refused(tmp_path, "odometry.csv, line 4", "9 finite numbers")
    path.write_text("x,y,z\n1,2,3\n")
    refused(tmp_path, "odometry.csv", "expected columns timestamp")


def write_current_stray(folder, sample, cells=", , "):
    """Fifteen columns, as the app writes them today: a lens for each frame, and two that are empty."""
    write_stray(folder, sample)
    path = folder / "odometry.csv"
    header, *rows = path.read_text().splitlines()
    names = "fx, fy, cx, cy, distortion_center_x, distortion_center_y"
    c = sample.camera
    lens = [f"{c.fx + i}, {c.fy + i}, {c.cx}, {c.cy}{cells}" for i in range(len(rows))]
    lines = [f"{header}, {names}", *(f"{row}, {k}" for row, k in zip(rows, lens, strict=True))]
    path.write_text("\n".join(lines) + "\n")
    return lines


def test_empty_cells_of_stray_are_missing_values(sample, tmp_path):
    lines = write_current_stray(tmp_path, sample)
    scan = read_scan(tmp_path)
    assert len(scan) == N
    assert scan.skipped == ()
    assert [k.fx - sample.camera.fx for k in scan.cameras] == pytest.approx(range(N), abs=1e-9)
    out = tmp_path / "out"
    out.mkdir()
    scan.files.write_poses(out, scan.world_from_cams)
    written = (out / "odometry.csv").read_text().splitlines()
    assert written[0] == lines[0]
    for old, new in zip(lines[1:], written[1:], strict=True):
        old, new = (line.split(", ") for line in (old, new))
        assert old[:2] + old[9:] == new[:2] + new[9:]


def test_a_row_of_stray_without_a_lens_takes_the_shared_one(sample, tmp_path):
    lines = write_current_stray(tmp_path, sample)
    cells = lines[3].split(",")
    lines[3] = ",".join([*cells[:9], " ", *cells[10:]])
    lines[4] = ",".join([*cells[:1], " 000003", *[" "] * 7, *cells[9:]])
    (tmp_path / "odometry.csv").write_text("\n".join(lines) + "\n")
    scan = read_scan(tmp_path)
    assert scan.cameras[1].fx == pytest.approx(sample.camera.fx + 1)
    assert scan.cameras[2].fx == pytest.approx(sample.camera.fx)
    assert scan.skipped == ("frame 000003: the tracker had no pose",)


@pytest.mark.parametrize("words", ["", "x", "inf"])
def test_a_row_of_stray_without_time_or_with_words(words, sample, tmp_path):
    lines = write_current_stray(tmp_path, sample)
    column = 0 if not words else 12
    cells = lines[2].split(",")
    cells[column] = words
    (tmp_path / "odometry.csv").write_text("\n".join([*lines[:2], ",".join(cells)]) + "\n")
    refused(tmp_path, "odometry.csv, line 3", "15 finite numbers")


def test_a_video_whose_first_frame_is_hidden(sample, tmp_path):
    """Stray Scanner counts frames from -1: an edit list hides the first, and what players show is late."""
    write_stray(tmp_path, sample)
    plain = [read_scan(tmp_path).files.color(i) for i in range(N)]
    write_video(tmp_path / "rgb.mp4", sample.color, first=-1)
    scan = read_scan(tmp_path)
    assert scan.skipped == ()
    for i in (0, N - 1, 2):
        assert np.abs(scan.files.color(i).astype(int) - plain[i]).mean() < 2


# Frames that lack something.


def test_frames_without_depth_colour_or_pose_are_named(sample, tmp_path):
    write_seven_scenes(tmp_path, sample)
    (tmp_path / "frame-000001.depth.png").unlink()
    (tmp_path / "frame-000003.pose.txt").unlink()
    scan = read_scan(tmp_path)
    assert scan.frame_ids == ("000000", "000001", "000002", "000004", "000005")
    assert scan.lacking == ("", "depth", "", "", "")
    assert set(scan.skipped) == {"frame 000003: frame-000003.pose.txt is missing"}


def test_lost_tracking_in_scannet(sample, tmp_path):
    write_scannet(tmp_path, sample)
    (tmp_path / "pose" / "2.txt").write_text("-inf -inf -inf -inf\n" * 4)
    scan = read_scan(tmp_path)
    assert "2" not in scan.frame_ids
    assert scan.skipped == ("frame 2: the tracker had no pose",)
    assert_array_equal(scan.timestamps, [0, 1, 3, 4, 5])


def test_more_depth_than_colour_in_scanner_app(sample, tmp_path):
    write_scanner_app(tmp_path, sample)
    for i in (1, 2, 4, 5):
        (tmp_path / f"frame_{i:05d}.jpg").unlink()
    scan = read_scan(tmp_path)
    assert len(scan) == N
    assert scan.lacking == ("", "colour", "colour", "", "colour", "colour")
    assert scan.skipped == ()
    assert "4 of 6 frames have no colour" in scan.warnings[0]
    assert scan.files.color(1) is None
    assert np.isfinite(scan.files.depth(1)).any()
    assert scan.cameras[1] == scan.cameras[0]


def test_no_frame_is_left(sample, tmp_path):
    write_redwood(tmp_path, sample)
    put(tmp_path / "trajectory.log", "99 99 100\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    refused(tmp_path, "expected frames with colour, depth and a pose", "trajectory.log has no pose")


def test_times_that_never_match(sample, tmp_path):
    write_tum(tmp_path, sample)
    lines = (tmp_path / "depth.txt").read_text().splitlines()
    moved = [f"{float(w[0]) + 60:.6f} {w[1]}" for w in (line.split() for line in lines[1:])]
    (tmp_path / "depth.txt").write_text("\n".join(moved) + "\n")
    refused(tmp_path, "expected depth within 0.02 s", "1305031102.175304", "--max-time-gap-s")


def test_times_of_poses_that_never_match(sample, tmp_path):
    write_tum(tmp_path, sample)
    lines = (tmp_path / "groundtruth.txt").read_text().splitlines()
    moved = [
        " ".join([f"{float(w[0]) - 60:.6f}", *w[1:]]) for w in (line.split() for line in lines[1:])
    ]
    (tmp_path / "groundtruth.txt").write_text("\n".join(moved) + "\n")
    refused(tmp_path, "expected poses within 0.02 s", "--max-time-gap-s")


# Images.


def test_mixed_image_sizes(sample, tmp_path):
    write_redwood(tmp_path, sample)
    put(tmp_path / "depth" / "00003.png", png(sample.depth_mm[3][::2, ::2]))
    refused(tmp_path, "00003.png", "expected depth of 128 x 96 px", "found 64 x 48")


def test_colour_and_depth_of_other_proportions(sample, tmp_path):
    write_redwood(tmp_path, sample)
    for i in range(N):
        put(tmp_path / "depth" / f"{i:05d}.png", png(sample.depth_mm[i][:60]))
    refused(tmp_path, "128 x 96", "128 x 60", "register depth to colour")


def test_intrinsics_of_another_size(sample, tmp_path):
    write_nerfstudio(tmp_path, sample)
    content = json.loads((tmp_path / "transforms.json").read_text())
    (tmp_path / "transforms.json").write_text(json.dumps(content | {"w": 640, "h": 480}))
    refused(tmp_path, "expected 640 x 480 px as the intrinsics say, found 128 x 96")


def test_depth_that_is_all_zero(sample, tmp_path):
    write_redwood(tmp_path, sample)
    for i in range(N):
        put(tmp_path / "depth" / f"{i:05d}.png", png(np.zeros_like(sample.depth_mm[0])))
    refused(tmp_path, "expected depth, found no measurement in any of the 6 frames")


@pytest.mark.parametrize(
    ("scale", "word"), [(1.0, "m, where 0.2 to 20 m"), (1e-5, "--depth-scale")]
)
def test_a_depth_scale_that_cannot_be_right_is_questioned(scale, word, sample, tmp_path):
    write_redwood(tmp_path, sample)
    scan = read_scan(tmp_path, options=ScanOptions(depth_scale=scale))
    assert len(scan.warnings) == 1
    assert word in scan.warnings[0]


def long_scan(folder, sample, n):
    """Frames over and over, as 7-Scenes."""
    write_seven_scenes(folder, sample)
    for i in range(N, n):
        for end in ("color.png", "depth.png", "pose.txt"):
            os.link(folder / f"frame-{i % N:06d}.{end}", folder / f"frame-{i:06d}.{end}")


def spoil(path, data):
    path.unlink()
    path.write_bytes(data)


def test_one_file_cut_off_among_many_is_skipped_counted_and_named(sample, tmp_path):
    long_scan(tmp_path, sample, 120)
    path = tmp_path / "frame-000050.depth.png"
    spoil(path, path.read_bytes()[:2000])
    scan = read_scan(tmp_path)
    assert len(scan) == 119
    assert len(scan.skipped) == 1
    assert "frame 000050" in scan.skipped[0]
    assert "without an end" in scan.skipped[0]


def test_one_file_spoiled_inside_is_blank_counted_and_named(sample, tmp_path):
    long_scan(tmp_path, sample, 120)
    path = tmp_path / "frame-000050.depth.png"
    data = path.read_bytes()
    spoil(path, data[:60] + bytes(len(data) - 80) + data[-20:])
    scan = read_scan(tmp_path)
    assert len(scan) == 120
    assert corrupt_frames(scan) == {}
    assert np.isnan(scan.files.depth(50)).all()
    assert scan.files.depth(50).shape == (96, 128)
    assert np.isfinite(scan.files.depth(51)).any()
    assert list(corrupt_frames(scan)) == ["000050"]
    assert "frame-000050.depth.png" in corrupt_frames(scan)["000050"]
    color = tmp_path / "frame-000007.color.png"
    spoil(color, color.read_bytes()[:60] + bytes(5000) + color.read_bytes()[-20:])
    # Two of 120 are more than one in a hundred.
    with pytest.raises(ScanError, match=r"frame-000007\.color\.png"):
        scan.files.color(7)


def test_many_files_cut_off_are_an_error(sample, tmp_path):
    long_scan(tmp_path, sample, 120)
    for i in (10, 20):
        path = tmp_path / f"frame-{i:06d}.color.png"
        spoil(path, path.read_bytes()[:2000])
    refused(tmp_path, "frame-000010.color.png", "without an end")


# Tables and calibrations.

JSON_CASES = {
    "no JSON": ("{", "expected JSON"),
    "a list": ("[]", "expected a JSON object"),
    "no frames": ("{}", "expected a list `frames`"),
    "no depth": ('{"frames": [{"file_path": "a.png"}]}', "planfit needs depth"),
    "no matrix": ('{"frames": [{"file_path": "a.png", "depth_file_path": "b.png"}]}', "16 numbers"),
}


@pytest.mark.parametrize("kind", JSON_CASES)
def test_transforms_that_cannot_be_used(kind, tmp_path):
    text, words = JSON_CASES[kind]
    put(tmp_path / "transforms.json", text)
    refused(tmp_path, "transforms.json", words)


def test_a_lens_that_is_not_known(sample, tmp_path):
    write_nerfstudio(tmp_path, sample)
    content = json.loads((tmp_path / "transforms.json").read_text())
    put(tmp_path / "transforms.json", json.dumps(content | {"camera_model": "EQUIRECTANGULAR"}))
    refused(tmp_path, "EQUIRECTANGULAR", "undistort")


def test_a_pose_that_is_no_rotation(sample, tmp_path):
    write_polycam(tmp_path, sample)
    path = sorted((tmp_path / "keyframes" / "cameras").iterdir())[2]
    path.write_text(json.dumps(json.loads(path.read_text()) | {"t_00": 7.0}))
    refused(tmp_path, path.name, "expected a rotation")


@pytest.mark.parametrize("wrong", [{"fx": 0.0}, {"fy": 1e-30}, {"cy": 1e36}])
def test_intrinsics_that_cannot_be_used(wrong, sample, tmp_path):
    write_polycam(tmp_path, sample)
    path = sorted((tmp_path / "keyframes" / "cameras").iterdir())[2]
    path.write_text(json.dumps(json.loads(path.read_text()) | wrong))
    refused(tmp_path, path.name, "usable intrinsics")


def test_a_trajectory_of_another_width(sample, tmp_path):
    write_replica(tmp_path / "room0", sample)
    put(tmp_path / "room0" / "traj.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n" * N)
    refused(tmp_path / "room0", "traj.txt", "expected 16 numbers a line, found 12")


def test_a_trajectory_that_is_too_short(sample, tmp_path):
    write_replica(tmp_path / "room0", sample)
    rows = (tmp_path / "room0" / "traj.txt").read_text().splitlines()
    put(tmp_path / "room0" / "traj.txt", "\n".join(rows[:4]) + "\n")
    scan = read_scan(tmp_path / "room0")
    assert len(scan) == 4
    assert scan.skipped[0] == "frame 000004: traj.txt has only 4 rows"


def test_depth_that_is_not_registered(sample, tmp_path):
    write_scannet(tmp_path, sample)
    moved = "1 0 0 0.05\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    put(tmp_path / "intrinsic" / "extrinsic_color.txt", moved)
    refused(tmp_path, "extrinsic_color.txt", "register depth to colour")
    (tmp_path / "intrinsic" / "extrinsic_color.txt").unlink()
    put(tmp_path / "intrinsic" / "extrinsic_depth.txt", moved)
    (tmp_path / "intrinsic" / "intrinsic_depth.txt").unlink()
    refused(tmp_path, "intrinsic_depth.txt", "extrinsic_depth.txt", "found none")


def test_a_colmap_model_that_is_cut_off(sample, tmp_path):
    WRITERS["colmap"](tmp_path, sample, binary=True)
    path = tmp_path / "sparse" / "0" / "images.bin"
    path.write_bytes(path.read_bytes()[:-30])
    refused(tmp_path, "images.bin", "cut off")


@pytest.mark.parametrize("is_binary", [True, False])
def test_a_colmap_model_with_a_lens_that_is_not_known(sample, tmp_path, is_binary):
    WRITERS["colmap"](tmp_path, sample, binary=is_binary)
    folder = tmp_path / "sparse" / "0"
    parameters = [0.5] * 12
    if is_binary:
        data = struct.pack("<QIiQQ12d", 1, 1, 10, WIDTH, HEIGHT, *parameters)
        (folder / "cameras.bin").write_bytes(data)
    else:
        row = " ".join(map(str, [1, "THIN_PRISM_FISHEYE", WIDTH, HEIGHT, *parameters]))
        (folder / "cameras.txt").write_text(f"{row}\n")
    refused(tmp_path, "cameras", "found THIN_PRISM_FISHEYE; undistort the images first")


def test_a_colmap_model_without_cameras(sample, tmp_path):
    WRITERS["colmap"](tmp_path, sample, binary=True)
    (tmp_path / "sparse" / "0" / "cameras.bin").unlink()
    refused(tmp_path, "sparse/0", "found neither cameras.bin and images.bin")


def test_record3d_depth_of_another_size(sample, tmp_path):
    files = record3d_files(sample)
    files["rgbd/0.depth"] = files["rgbd/0.depth"][:-100] + b"bvx$"
    write_zip(tmp_path / "scan.r3d", files)
    scan = read_scan(tmp_path / "scan.r3d")
    with pytest.raises(ScanError, match=r"0\.depth"):
        scan.files.depth(0)


def test_compressed_record3d_without_the_library_says_what_to_install(sample, tmp_path):
    try:
        import liblzfse  # noqa: F401
    except ImportError:
        pass
    else:
        pytest.skip("pyliblzfse is installed")
    files = record3d_files(sample)
    for i in range(N):
        files[f"rgbd/{i}.depth"] = b"bvx2" + bytes(500)
    write_zip(tmp_path / "scan.r3d", files)
    scan = read_scan(tmp_path / "scan.r3d")
    with pytest.raises(ScanError, match=r"planfit\[record3d\]"):
        scan.files.depth(0)


@pytest.mark.parametrize("words", ["nan, nan, nan, nan, nan, nan, nan", "0, 0, 0, 0, 0, 0, 0"])
def test_lost_tracking_in_stray(sample, tmp_path, words):
    write_stray(tmp_path, sample)
    path = tmp_path / "odometry.csv"
    lines = path.read_text().splitlines()
    cells = lines[3].split(",")
    lines[3] = ",".join([*cells[:2], *words.split(","), *cells[9:]])
    path.write_text("\n".join(lines) + "\n")
    scan = read_scan(tmp_path)
    assert len(scan.frame_ids) == len(lines) - 2
    assert scan.skipped == ("frame 000002: the tracker had no pose",)

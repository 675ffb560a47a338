"""Scans of every format, spoiled file by file: one line on the command line, exit code 2, no traceback."""

import json
import os
import re
import socket
from pathlib import Path

import numpy as np
import pytest

from planfit.errors import FloorplanError, ScanError
from planfit.floorplan import read_floorplan
from planfit.scan import read_scan
from scan_samples import (
    WRITERS,
    N,
    Sample,
    make_sample,
    png,
    put,
    record3d_files,
    write_redwood,
    write_scannet,
    write_seven_scenes,
    write_stray,
    write_tum,
    write_video,
    write_zip,
)
from spoiled_scans import files_of, refused, spoken, write_all

FOLDERS = [kind for kind in WRITERS if kind != "record3d"]
PICTURES = (".png", ".jpg", ".mp4", ".depth", ".conf")
UNREAD = {"info.json", "mesh_info.json"}
"""Files of the formats that hold nothing of use."""
HAVE_DEFAULTS = {"cam_params.json", "camera-intrinsics.txt", "intrinsic_depth.txt",
                 "extrinsic_color.txt", "extrinsic_depth.txt"}  # fmt: skip
"""Files without which published values hold, or the depth's proportions."""


@pytest.fixture(scope="module")
def sample() -> Sample:
    return make_sample()


def numbers_to(word: bytes):
    return lambda data: re.sub(rb"-?\d+\.\d{3,}(e[-+]\d+)?", word, data)


HARMS = {
    "empty": lambda _: b"",
    "cut off": lambda data: data[: len(data) // 2],
    "zeroes": lambda data: bytes(len(data)),
    "no text": lambda _: b"\x89\xff\x00garbage\xfe" * 40,
}
HARMS_OF_TEXT = {
    "broken JSON": lambda _: b"{",
    "another JSON": lambda _: b"{}",
    "a ragged table": lambda _: b"1 2 3\n4 5\n",
    "NaN": numbers_to(b"NaN"),
    "null": numbers_to(b"null"),
    "beyond all numbers": numbers_to(b"1e400"),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_every_file_missing_or_spoiled(
    kind: str, sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Either the line names the file, or the scan is read and a note names the frame."""
    files = files_of(kind, sample, tmp_path / "whole")
    by_group: dict[str, list[str]] = {}
    for name in files:
        by_group.setdefault(re.sub(r"\d+", "#", name), []).append(name)
    for names in by_group.values():
        name = names[len(names) // 2]
        is_text = not name.endswith(PICTURES)
        harms = {**HARMS, **HARMS_OF_TEXT} if is_text else {"cut off": HARMS["cut off"]}
        for harm in ["missing", *harms]:
            spoiled = dict(files)
            if harm == "missing":
                del spoiled[name]
            elif (data := harms[harm](files[name])) != files[name]:
                spoiled[name] = data
            else:
                continue
            path = write_all(kind, spoiled, tmp_path / "spoiled")
            code, errors, notes = spoken(capsys, "inspect", path)
            case, last = f"{name} {harm}: {errors} {notes}", name.rsplit("/", 1)[-1]
            number = re.search(r"\d+", last)
            if code == 2:
                # Poses of all frames in one file: the line names a frame, as for a tracker that was lost.
                of_all = last.startswith("traj") or last in (
                    "transforms.json", "pose_intrinsic_imu.json")  # fmt: skip
                is_all = "the tracker had no pose" in errors[0] and of_all
                lists = ("rgb.txt", "depth.txt", "color.txt", "aligned_depth.txt")
                is_times = "times" in errors[0] and last in lists
                assert last in errors[0] or is_all or is_times, case
                assert len(errors[0]) < (2500 if harm == "missing" else 600), case
            else:
                assert code == 0, case
                named = last in notes or (number is not None and number[0] in notes)
                # Tables of frames that end early, or of one of their images.
                shortened = re.search("are left out|frames have no (colour|depth)", notes)
                default = harm == "missing" and last in HAVE_DEFAULTS
                later = kind == "record3d" and last.endswith(".jpg")  # colour is not looked at here
                no_conf = kind == "record3d" and last.endswith(".conf")
                assert named or shortened or default or later or no_conf or last in UNREAD, case


@pytest.mark.parametrize("kind", FOLDERS)
def test_an_empty_folder_of_every_format(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    message = refused(capsys, "inspect", tmp_path, "--format", kind)
    assert message.startswith(f"{tmp_path}: expected a scan of the format {kind}: ")
    assert message.endswith("found none")


@pytest.mark.parametrize(
    ("kind", "name"),
    [("tum", "depth.txt"), ("redwood", "trajectory.log"), ("stray", "rgb.mp4"),
     ("scannet", "intrinsic/intrinsic_color.txt"), ("replica", "traj.txt")],
)  # fmt: skip
def test_the_nearest_format_and_what_it_lacks(
    kind: str, name: str, sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "scan"
    WRITERS[kind](folder, sample)
    (folder / name).unlink()
    message = refused(capsys, "inspect", folder)
    assert message.startswith(
        f"{folder}: expected a scan, found most of one of the format {kind}, of which {name} is missing; it "
        "is told by "
    )
    assert ": copy or export the scan again, whole" in message
    # Where images alone are there, they may be of another program.
    others = kind in ("redwood", "scannet", "replica")
    assert ("--format any-folder, with --poses FILE" in message) == others


def test_an_unknown_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put(tmp_path / "scan" / "letter.doc", b"")
    message = refused(capsys, "refine", tmp_path / "scan", "-o", tmp_path / "out")
    assert message.startswith(
        f"{tmp_path}/scan: expected a scan, found none; 'planfit help scan-formats' describes what is "
        "read: facap, "
    )
    assert len(message) < 400
    assert not (tmp_path / "out").exists()


def test_nothing_there_and_a_lone_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert refused(capsys, "inspect", tmp_path / "no") == (
        f"{tmp_path}/no: expected the folder of a scan, found nothing; check the path"
    )
    put(tmp_path / "scan.tar", b"ustar")
    assert refused(capsys, "inspect", tmp_path / "scan.tar") == (
        f"{tmp_path}/scan.tar: expected the folder of a scan, a zip archive of one, a bag or a database, "
        "found a packed archive of another kind; unpack it and give the folder, or pack it as zip"
    )


def test_a_circle_of_links(
    sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    assert refused(capsys, "inspect", tmp_path / "a") == (
        f"{tmp_path}/a: expected the folder of a scan, cannot be opened (Too many levels of symbolic links)"
    )
    write_seven_scenes(tmp_path / "scan", sample)
    image = tmp_path / "scan" / "frame-000002.color.png"
    image.unlink()
    image.symlink_to(image)
    (tmp_path / "scan" / "again").symlink_to(tmp_path / "scan")
    code, _, notes = spoken(capsys, "inspect", tmp_path / "scan")
    assert code == 0
    assert "1 of 6 frames have no colour" in notes
    assert ": frame 000002: frame-000002.color.png is missing" in notes


def test_an_archive_that_points_outside(
    sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "in" / "scan.r3d"
    path.parent.mkdir()
    write_zip(path, record3d_files(sample) | {"../evil.txt": b"evil"})
    assert refused(capsys, "inspect", path) == (
        f"{path}: expected files inside the archive, found '../evil.txt', which points outside of it; do not "
        "trust this archive, export the scan again"
    )
    assert [p.name for p in tmp_path.rglob("*")] == ["in", "scan.r3d"]


def test_a_truncated_video(
    sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_stray(tmp_path, sample)
    path = tmp_path / "rgb.mp4"
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    message = refused(capsys, "inspect", tmp_path)
    assert message.startswith(
        f"{path}: expected a video, found a file that cannot be read as one ("
    )
    assert message.endswith("the recording may have been cut off, copy it again from the phone")
    write_video(path, sample.color[:4])
    code, _, notes = spoken(capsys, "inspect", tmp_path)
    assert code == 0
    assert "2 of 6 frames are left out: frame 000004: the video ends after 4 frames; " in notes


def test_depth_shorter_than_colour(
    sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_stray(tmp_path, sample)
    for i in range(2, N):
        (tmp_path / "depth" / f"{i:06d}.png").unlink()
    code, _, notes = spoken(capsys, "inspect", tmp_path)
    assert code == 0
    assert "4 of 6 frames have no depth" in notes
    assert (
        ": frame 000002: depth/000002.png is missing; frame 000003: "
        "depth/000003.png is missing; frame 000004: depth/000004.png is missing; and 1 more"
    ) in notes


def test_a_video_longer_than_its_poses(
    sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_stray(tmp_path, sample)
    rows = (tmp_path / "odometry.csv").read_text().splitlines()
    put(tmp_path / "odometry.csv", "\n".join(rows[:-1]) + "\n")
    code, _, notes = spoken(capsys, "inspect", tmp_path)
    assert code == 0
    assert "1 of 6 frames are left out: frame 000005: odometry.csv has no row" in notes


def test_one_corrupt_frame_among_many(
    sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_seven_scenes(tmp_path, sample)
    for i in range(N, 120):
        for end in ("color.png", "depth.png", "pose.txt"):
            os.link(
                tmp_path / f"frame-{i % N:06d}.{end}",
                tmp_path / f"frame-{i:06d}.{end}",
            )
    cut, inside = (tmp_path / f"frame-{i:06d}.depth.png" for i in (50, 119))
    data = cut.read_bytes()
    cut.unlink()
    cut.write_bytes(data[:2000])
    code, _, notes = spoken(capsys, "inspect", tmp_path)
    assert code == 0
    assert "1 of 120 frames are left out: frame 000050: " in notes
    assert f"{cut}: expected a whole image, found one without an end" in notes
    cut.write_bytes(data)
    inside.unlink()
    inside.write_bytes(data[:60] + bytes(len(data) - 80) + data[-20:])
    code, _, notes = spoken(capsys, "inspect", tmp_path)
    assert code == 0
    assert "1 of 120 frames cannot be decoded and take no part: frame 000119: " in notes
    assert str(inside) in notes


@pytest.mark.parametrize(("name", "what"), [("depth.txt", "depth"), ("groundtruth.txt", "poses")])
def test_times_that_never_match(
    name: str,
    what: str,
    sample: Sample,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    write_tum(tmp_path, sample)
    lines = (tmp_path / name).read_text().splitlines()[1:]
    moved = [" ".join([f"{float(w[0]) + 60:.6f}", *w[1:]]) for w in (s.split() for s in lines)]
    put(tmp_path / name, "\n".join(moved) + "\n")
    message = refused(capsys, "inspect", tmp_path)
    assert re.fullmatch(
        re.escape(f"{tmp_path}: expected {what} within 0.02 s of colour images (times "
                  "1305031102.175304 to 1305031102.341971), found times 1305031162.17")
        + r"\d+ to 1305031162\.34\d+; are the lists of one recording\? Else give --max-time-gap-s",
        message,
    ), message  # fmt: skip


def test_depth_without_any_measurement(
    sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_redwood(tmp_path, sample)
    for i in range(N):
        put(tmp_path / "depth" / f"{i:05d}.png", png(np.zeros_like(sample.depth_mm[0])))
    assert refused(capsys, "inspect", tmp_path) == (
        f"{tmp_path}: expected depth, found no measurement in any of the 6 frames looked at; export the "
        "scan again with depth"
    )


@pytest.mark.parametrize(("scale", "middle"), [(0.1, r"\d{3}"), (1e-5, r"0\.0\d+")])
def test_a_depth_scale_that_cannot_be_right_is_questioned(
    scale: float,
    middle: str,
    sample: Sample,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    write_redwood(tmp_path, sample)
    code, _, notes = spoken(capsys, "inspect", tmp_path, "--depth-scale", scale)
    assert code == 0
    assert re.search(
        rf"note: half of the depth is below {middle} m, where 0\.2 to 20 m are usual in a building: is it in "
        r"another unit\? `planfit refine` takes a usual one where recorded motion agrees; else say which "
        r"with --depth-scale \(metres of one stored unit\)",
        notes,
    ), notes


def test_images_of_two_sizes(
    sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_scannet(tmp_path, sample)
    put(tmp_path / "depth" / "3.png", png(sample.depth_mm[3]))
    assert refused(capsys, "inspect", tmp_path) == (
        f"{tmp_path}/depth/3.png: expected depth of 64 x 48 px as depth/0.png, found 128 x 96; all images of "
        "one camera must have one size"
    )


def test_a_time_that_is_none(
    sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = record3d_files(sample)
    metadata = json.loads(files["metadata"])
    metadata["frameTimestamps"][2] = float("nan")
    write_zip(tmp_path / "s.r3d", files | {"metadata": json.dumps(metadata).encode()})
    assert refused(capsys, "inspect", tmp_path / "s.r3d") == (
        f"{tmp_path}/s.r3d: frame 2: expected a time, found NaN or infinity; remove the frame or export the "
        "scan again"
    )


def name_in(path: Path, old: str, new: str) -> None:
    """A list of names with another one in the place of one."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize("lead", ["../secret.png", "rgb/../../secret.png", "{tmp}/secret.png"])
@pytest.mark.parametrize("kind", ["tum", "nerfstudio", "openloris"])
def test_a_name_in_a_list_that_leads_out_of_the_scan(
    kind: str, lead: str, sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An image of another place is not read as one of the scan's; that a file is there is not told."""
    WRITERS[kind](tmp_path / "scan", sample)
    put(tmp_path / "secret.png", png(sample.depth_mm[0]))
    listed, name = {
        "tum": ("depth.txt", f"depth/{sample.times[0] + 0.004:.6f}.png"),
        "nerfstudio": ("transforms.json", "depth/frame_00001.png"),
        "openloris": ("aligned_depth.txt", f"aligned_depth/{sample.times[0]:.6f}.png"),
    }[kind]
    lead = lead.format(tmp=tmp_path)
    name_in(tmp_path / "scan" / listed, name, lead)
    assert refused(capsys, "inspect", tmp_path / "scan") == (
        f"{tmp_path}/scan: expected names of files inside this folder, found {lead!r} in one of its lists, "
        "which leads out of it; put that file inside and mend the list, or do not trust this scan"
    )


@pytest.mark.parametrize("lead", ["{scan}/images/frame_00001.png", "depth/../images/frame_00001"])
def test_a_name_that_leads_into_the_scan_again_is_read(
    lead: str, sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Programs write absolute paths, also through a link to the scan."""
    WRITERS["nerfstudio"](tmp_path / "scan", sample)
    (tmp_path / "link").symlink_to(tmp_path / "scan")
    name = lead.format(scan=tmp_path / "scan")
    name_in(tmp_path / "scan" / "transforms.json", "images/frame_00001.png", name)
    for path in (tmp_path / "scan", tmp_path / "link"):
        assert spoken(capsys, "inspect", path) == (0, [], "")


def test_links_that_lead_out_of_the_scan_are_followed_and_said(
    sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whoever has the disk may have his images elsewhere on it; a list of names may not."""
    scan, other = tmp_path / "scan", tmp_path / "other"
    write_redwood(scan, sample)
    (scan / "depth").rename(other)
    (scan / "depth").symlink_to(other)
    for name, place in (("00000.png", tmp_path), ("00001.png", scan)):
        (scan / "color" / name).rename(place / name)
        (scan / "color" / name).symlink_to(place / name)
    code, _, notes = spoken(capsys, "inspect", scan)
    assert code == 0
    assert f"{N + 1} of {2 * N + 2} files are read outside of the scan's folder" in notes
    assert "look whether they are of this scan" in notes


def test_a_name_too_long_for_any_file(
    sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_tum(tmp_path, sample)
    name = f"depth/{sample.times[0] + 0.004:.6f}.png"
    name_in(tmp_path / "depth.txt", name, "x" * 300)
    line = f"{tmp_path}/{'x' * 300}: cannot be read (File name too long); copy or export the scan again"
    assert refused(capsys, "inspect", tmp_path) == line
    with pytest.raises(ScanError, match="File name too long"):
        read_scan(tmp_path)


def test_what_is_written_is_not_told_to_be_put_into_a_file(
    capsys: pytest.CaptureFixture[str],
) -> None:
    message = refused(capsys, "plan", "plan.dxf", "-o", "/dev/null")
    assert "found a device" not in message


@pytest.mark.parametrize("made", ["a pipe", "a socket", "a device"])
def test_what_is_no_file_is_not_waited_for(
    made: str, sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As a scan, as a plan, as another file, and in a scan's folder."""
    scan, path = tmp_path / "scan", Path("/dev/zero")
    if made == "a pipe":
        path = tmp_path / "a.bag"
        os.mkfifo(path)
    if made == "a socket":
        path = tmp_path / "s"
        with socket.socket(socket.AF_UNIX) as one:
            one.bind(str(path))
    write_tum(scan, sample)
    step = "; write what it gives into a file, and give that"
    line = f"{path}: expected a file or a folder, found {made}{step}"
    out = tmp_path / "out"
    for words in (
        ["inspect", path],
        ["plan", path],
        ["inspect", scan, "--poses", path],
        ["refine", scan, "--plan", path, f"--config={path}", "-o", out],
    ):
        assert refused(capsys, *words) == line
    with pytest.raises(ScanError, match=f"found {made}; "):
        read_scan(path)
    with pytest.raises(FloorplanError, match=f"expected a floorplan, found {made}; "):
        read_floorplan(path)
    (scan / "groundtruth.txt").unlink()
    (scan / "groundtruth.txt").symlink_to(path)
    assert "found none" in refused(capsys, "inspect", scan)
    assert not out.exists()


def test_an_empty_path_of_a_variable_that_is_not_set(
    sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch
) -> None:
    write_tum(tmp_path / "scan", sample)
    monkeypatch.chdir(tmp_path)
    refine = ("refine", "scan", "-o", "out")
    for where, words in (
        ("plan", ["plan", ""]),
        ("inspect", ["inspect", ""]),
        ("--plan", [*refine, "--plan", ""]),
        ("--plan", [*refine, "--plan="]),
        ("--config", [*refine, "--config="]),
    ):
        assert refused(capsys, *words) == (
            f"{where}: expected a path, found an empty word; is a variable of the shell not set?"
        )
    for folder in (".", "/"):
        assert "IMDF" in refused(capsys, "plan", folder)
    with pytest.raises(FloorplanError, match="found an empty one"):
        read_floorplan("")


def test_a_video_whose_title_is_in_no_known_letters(
    sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_stray(tmp_path, sample)
    data = (tmp_path / "rgb.mp4").read_bytes()
    assert b"Lavf" in data
    (tmp_path / "rgb.mp4").write_bytes(data.replace(b"Lavf", b"La\xffv"))
    assert spoken(capsys, "inspect", tmp_path) == (0, [], "")


def test_a_video_that_is_a_list_of_other_files(
    sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """FFmpeg tells files by what they hold, and would open those that a list names."""
    write_stray(tmp_path, sample)
    (tmp_path / "rgb.mp4").rename(tmp_path / "other.mp4")
    put(tmp_path / "rgb.mp4", "ffconcat version 1.0\nfile other.mp4\n")
    assert "expected a video, found a file" in refused(capsys, "inspect", tmp_path)

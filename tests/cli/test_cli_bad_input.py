"""Bad input: one line that names the file and the next step, exit code 2, nothing half-written."""

import errno
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from planfit.cli import run
from planfit.export.write import FILES


def replace_file(path: Path, content: bytes) -> None:
    """Replace a linked file without touching the original."""
    path.unlink()
    path.write_bytes(content)


def _lines(path: Path, text: str) -> None:
    replace_file(path, text.encode())


def _no_frames(scan: Path) -> None:
    # Without colour alone, it would be a scan of depth.
    for path in (*(scan / "arcore").glob("frame-*"), *(scan / "arcore").glob("depth-*")):
        path.unlink()


def _image(path: Path, image: np.ndarray) -> None:
    replace_file(path, cv2.imencode(path.suffix, image)[1].tobytes())


POSE, DEPTH, CAMERA = (f"arcore/{name}" for name in ("pose-0007.txt", "depth-0007.png",
                                                     "cam_params-0007.txt"))  # fmt: skip

CASES: dict[str, tuple[Callable[[Path], None], str, str]] = {
    "no frames": (_no_frames, "arcore", "found none"),
    "colour without depth": (lambda s: (s / DEPTH).unlink(), "depth-0007.png", "59"),
    "depth without colour": (
        lambda s: (s / "arcore/frame-0007.jpg").unlink(), "depth-0007.png", "59 colour"),
    "unreadable colour": (
        lambda s: replace_file(s / "arcore/frame-0007.jpg", b"not an image"),
        "frame-0007.jpg", "cannot be read"),
    "truncated depth": (
        lambda s: replace_file(s / DEPTH, (s / DEPTH).read_bytes()[:500]),
        "depth-0007.png", "image"),
    "depth of eight bits": (
        lambda s: _image(s / DEPTH, np.full((240, 320), 9, np.uint8)), "depth-0007.png", "16-bit"),
    "depth of another size": (
        lambda s: _image(s / DEPTH, np.full((120, 160), 900, np.uint16)),
        "depth-0007.png", "160 x 120"),
    "pose of wrong shape": (lambda s: _lines(s / POSE, "1 0 0\n0 1 0\n0 0 1"), "pose-0007", "4x4"),
    "pose that is no rotation": (
        lambda s: _lines(s / POSE, "2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1"), "pose-0007", "rotation"),
    "pose of words": (lambda s: _lines(s / POSE, "one two"), "pose-0007", "matrix of numbers"),
    "intrinsics missing": (lambda s: (s / CAMERA).unlink(), "cam_params-0007", "59"),
    "intrinsics zero": (
        lambda s: _lines(s / CAMERA, "320 240 0 250 160 120"), "cam_params-0007", "positive"),
    "plan without segments": (
        lambda s: np.save(_fresh(s / "floorplan.npy"), np.zeros((0, 4))), "floorplan.npy", "none"),
    "plan in centimetres": (
        lambda s: _scale_plan(s, 100.0, 50.0), "floorplan.npy", "metres"),
    "mask of the wrong size": (
        lambda s: _image(s / "segmentation/frame-0007_wall.png", np.zeros((50, 60), np.uint8)),
        "frame-0007_wall.png", "quarter turn"),
}  # fmt: skip


def _fresh(path: Path) -> Path:
    path.unlink()
    return path


def _scale_plan(scan: Path, factor: float, repeat_m: float) -> None:
    plan = np.load(scan / "floorplan.npy")
    np.save(_fresh(scan / "floorplan.npy"), plan * factor + repeat_m)


@pytest.mark.parametrize("case", CASES)
def test_bad_scan_is_one_clear_line(
    case: str,
    spoiled_scan: Path,
    tmp_path: Path,
    brief: list[str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    spoil, names_file, says = CASES[case]
    spoil(spoiled_scan)
    out = tmp_path / "out"
    code = run(["refine", str(spoiled_scan), "-o", str(out), *brief])
    message = capsys.readouterr().err.splitlines()[-1]
    assert code == 2, message
    assert message.startswith("planfit: ")
    assert names_file in message
    assert says in message
    left = {path.name for path in out.iterdir()} if out.exists() else set()
    assert left <= {".planfit.json", ".planfit.lock"}


def test_folder_of_another_run_is_refused(
    small_scan: Path, spoiled_scan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    (out / "cache").mkdir(parents=True)
    other = {"scan": "another", "plan": "other plan"}
    (out / "run.json").write_text(json.dumps({"inputs": other}))
    assert run(["refine", str(small_scan), "-o", str(out)]) == 2
    message = capsys.readouterr().err
    assert "another run" in message
    assert "--overwrite" in message
    assert json.loads((out / "run.json").read_text()) == {"inputs": other}


def test_folder_with_other_files_is_refused(
    small_scan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    assert run(["refine", str(small_scan), "-o", str(tmp_path)]) == 2
    assert "found other files" in capsys.readouterr().err
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


@pytest.mark.slow
def test_full_disk_leaves_nothing_half_written(
    small_scan: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"

    def full(path: Path, *_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    own = {"cache", ".planfit.json", ".planfit.lock"}
    numbers = {*FILES, "overlay.png"} - {"control_points.csv"}
    for fails, left in (("write_sigmas", own), ("write_ply", own | numbers)):
        monkeypatch.setattr(f"planfit.export.write.{fails}", full)
        assert run(["refine", str(small_scan), "-o", str(out)]) == 2
        message = capsys.readouterr().err.splitlines()[-1]
        assert "No space left on device" in message
        assert "free disk space" in message
        assert {path.name for path in out.iterdir()} == left
        monkeypatch.undo()
    assert run(["refine", str(small_scan), "-o", str(out), "--report.no-has-view"]) == 0


@pytest.mark.slow
def test_stopping_keeps_what_was_finished(
    small_scan: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("planfit.pipeline.prepare.close_loops_untorn", interrupted)
    assert run(["refine", str(small_scan), "-o", str(out)]) == 130
    assert "goes on from there" in capsys.readouterr().err
    monkeypatch.undo()
    kept = {p: p.stat().st_mtime_ns for p in (out / "cache").rglob("*.chunk")}
    assert kept
    assert run(["refine", str(small_scan), "-o", str(out), "--report.no-has-view"]) == 0
    assert (
        kept.items() <= {p: p.stat().st_mtime_ns for p in (out / "cache").rglob("*.chunk")}.items()
    )


@pytest.mark.slow
def test_missing_plan_says_how_to_give_one(
    spoiled_scan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.move(spoiled_scan / "floorplan.npy", tmp_path / "plan.npy")
    out = str(tmp_path / "out")
    assert run(["refine", str(spoiled_scan), "-o", out]) == 2
    assert "planfit refine SCAN PLAN -o OUT" in capsys.readouterr().err
    words = ["refine", str(spoiled_scan), "-o", out, "--plan", str(tmp_path / "plan.npy")]
    assert run([*words, "--report.no-has-view"]) == 0


def test_overwrite_never_touches_files_that_are_no_runs(
    small_scan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "poses").mkdir()
    (tmp_path / "poses" / "mine.txt").write_text("mine")
    assert run(["refine", str(small_scan), "-o", str(tmp_path), "--overwrite"]) == 2
    assert "found other files" in capsys.readouterr().err
    assert (tmp_path / "poses" / "mine.txt").read_text() == "mine"


@pytest.mark.slow
def test_folder_of_a_run_that_never_finished_is_free(small_scan: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    (out / "cache").mkdir(parents=True)
    (out / "cache" / "inputs.json").write_text(json.dumps({"scan": "s", "plan": "another plan"}))
    assert run(["refine", str(small_scan), "-o", str(out), "--report.no-has-view"]) == 0


def test_poses_in_millimetres_are_refused(
    spoiled_scan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in (spoiled_scan / "arcore").glob("pose-*.txt"):
        pose = np.loadtxt(path)
        pose[:3, 3] *= 1000
        _lines(path, "\n".join(" ".join(str(v) for v in row) for row in pose))
    assert run(["refine", str(spoiled_scan), "-o", str(tmp_path / "out")]) == 2
    assert "divide translations by 1000" in capsys.readouterr().err


@pytest.mark.parametrize(
    "flags",
    [
        ["--adjust.max-alternations", "0"],
        ["--segmentation.stride-px", "0"],
        ["--seed", "-1"],
        ["--segmentation.max-depth-m", "inf"],
        ["--odometry.sigma-base-m", "nan"],
        ["--adjust.wall-offset-sigma-m", "-1"],
        ["--adjust.walls.weight", "-1"],
        ["--tolerance-m", "0"],
        ["--segmentation.learned.batch-size", "0"],
        ["--workers", "0"],
    ],
    ids=lambda flags: flags[-2],
)
def test_options_that_cannot_work_are_one_line(
    flags: list[str], small_scan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["refine", str(small_scan), "-o", str(tmp_path / "out"), *flags]) == 2
    assert "expected" in capsys.readouterr().err
    assert not (tmp_path / "out" / "run.json").exists()


def test_toml_choices_are_checked(
    small_scan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "options.toml"
    config.write_text('[segmentation]\nback_end = "foo"\n')
    words = ["refine", str(small_scan), "-o", str(tmp_path / "out"), "--config", str(config)]
    assert run(words) == 2
    assert "auto, masks, geometry or learned" in capsys.readouterr().err


def test_damaged_record_is_one_line(
    small_scan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for text in ("{", "{}", "[]"):
        (tmp_path / "run.json").write_text(text)
        truth = str(small_scan / "groundtruth.tum")
        assert run(["evaluate", str(tmp_path), "--truth", truth]) == 2
        assert "damaged" in capsys.readouterr().err


def test_stopped_synth_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("planfit.synth.facap._write_frame", interrupted)
    assert run(["synth", str(tmp_path / "scan"), "--walk.n-frames", "20"]) == 130
    assert "nothing of it is kept" in capsys.readouterr().err
    assert not (tmp_path / "scan").exists()

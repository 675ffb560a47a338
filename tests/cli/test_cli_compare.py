"""`planfit compare` on real runs of a small scan, through the command line's own entry point."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from planfit.cli import run
from planfit.scan import read_tum, write_tum

FEW = ("--map.frame-step", "4")


@pytest.fixture(scope="module")
def runs(
    small_scan: Path, fitted: Path, brief: list[str], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Path]:
    """A run with the plan, and one without it that begins with its cache."""
    alone = tmp_path_factory.mktemp("runs") / "alone"
    assert run(["refine", str(small_scan), "--no-plan", "-o", str(alone), *brief]) == 0
    return fitted, alone


def compared(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    assert run(["compare", *map(str, words), *FEW, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_run_is_preferred_to_the_recorded_poses(runs, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert run(["compare", str(runs[0]), "-o", str(out), *FEW]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "The evidence prefers A" in shown
    assert "B the poses as recorded" in shown
    record = json.loads((out / "comparison.json").read_text())
    assert record["preferred"] == "a"
    assert record["axes"] == "plan"
    assert {w["name"] for w in record["witnesses"]} == {"matches", "plan", "map", "free space"}
    assert record["metrics"]["off_plan"]["a"] < record["metrics"]["off_plan"]["b"]
    apart = np.array(record["by_frame"]["distance_m"])
    assert len(apart) == record["frames"] == 60
    assert record["difference"]["max_m"] == pytest.approx(apart.max(), abs=1e-6)
    page = (out / "comparison.html").read_text()
    assert page.count("<figure>") == page.count("<svg viewBox") == 4
    assert "The evidence prefers A" in page
    assert run(["compare", str(runs[0]), "-o", str(out), *FEW]) == 2
    assert "pass --overwrite" in capsys.readouterr().err


@pytest.mark.slow
def test_two_runs_and_the_same_run_twice(runs, capsys) -> None:
    fitted, alone = runs
    both = compared(capsys, fitted, alone, "--no-depth-maps")
    assert both["axes"] == "world"  # one of them is on no plan
    off_plan = both["metrics"]["off_plan"]  # the other one is put on the plan by its walls
    assert off_plan["a"] <= off_plan["b"] + 1.0
    assert off_plan["b"] < 50.0
    same = compared(capsys, fitted, fitted, "--no-depth-maps")
    assert same["preferred"] == "neither"
    assert same["difference"]["max_m"] == 0.0
    assert same["stretches"] == []


@pytest.mark.slow
def test_poses_of_a_file_moved_in_one_stretch(runs, tmp_path: Path, capsys) -> None:
    fitted, _ = runs
    times, poses = read_tum(fitted / "trajectory.tum")
    poses[20:30, 0, 3] += 0.3
    write_tum(tmp_path / "moved.tum", times, poses)
    report = compared(capsys, fitted, "--poses", tmp_path / "moved.tum", "--poses-frame", "plan",
                      "--no-depth-maps")  # fmt: skip
    (stretch,) = report["stretches"]
    assert (stretch["first_frame"], stretch["last_frame"]) == (20, 29)
    assert stretch["max_m"] == pytest.approx(0.3, abs=1e-5)
    assert stretch["wall_near_plan"]["a"] > stretch["wall_near_plan"]["b"]
    assert report["preferred"] == "a"
    # The same poses as a whole elsewhere: the difference is one motion, which --align takes out.
    write_tum(tmp_path / "shifted.tum", *read_tum(fitted / "trajectory.tum"))
    words = (fitted, "--poses", tmp_path / "shifted.tum", "--no-depth-maps", "--align")
    aligned = compared(capsys, *words)
    assert aligned["difference"]["max_m"] == pytest.approx(0.0, abs=1e-5)
    assert aligned["is_aligned"] is True


def test_bad_input_is_one_line(runs, small_scan: Path, tmp_path: Path, capsys) -> None:
    fitted, alone = runs
    other = tmp_path / "other"
    shutil.copytree(fitted, other, ignore=shutil.ignore_patterns("cache"))
    record = json.loads((other / "run.json").read_text())

    def spoiled(**changes: Any) -> None:
        (other / "run.json").write_text(json.dumps(record | changes))

    cases = [
        ([str(small_scan)], "expected the record of a run"),
        ([str(fitted), str(small_scan)], "expected the record of a run"),
        ([str(fitted), str(alone), "--poses", "x.tum"], "found both; leave out one"),
        ([str(fitted), "--poses", str(tmp_path / "no.tum")], "no.tum: expected a file of poses"),
    ]
    for words, message in cases:
        assert run(["compare", *words]) == 2
        assert message in capsys.readouterr().err
    inputs = record["inputs"]
    spoiled(inputs=inputs | {"scan": "/elsewhere", "scan_fingerprint": "0"})
    assert run(["compare", str(fitted), str(other)]) == 2
    assert "found one over /elsewhere; compare two runs over one scan" in capsys.readouterr().err
    spoiled(inputs=inputs | {"scan_fingerprint": "0"})
    assert run(["compare", str(fitted), str(other)]) == 2
    assert "has changed between the two" in capsys.readouterr().err
    spoiled(frames=59)
    assert run(["compare", str(fitted), str(other)]) == 2
    assert "expected the 60 frames of" in capsys.readouterr().err


def test_a_folder_with_other_files_is_left_alone(runs, tmp_path: Path, capsys) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    assert run(["compare", str(runs[0]), "-o", str(tmp_path)]) == 2
    assert "expected an empty folder or an earlier comparison" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]

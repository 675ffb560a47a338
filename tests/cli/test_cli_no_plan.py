"""`planfit refine --no-plan` and what is done with its results, through the command line itself."""

import json
from pathlib import Path

import numpy as np
import pytest

from planfit.cli import run
from planfit.evaluation import position_errors
from planfit.scan import read_scan, read_tum


@pytest.fixture(scope="module")
def alone(small_scan: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run without plan of a scan whose folder holds one."""
    out = tmp_path_factory.mktemp("run") / "out"
    assert run(["refine", str(small_scan), "--no-plan", "-o", str(out)]) == 0
    return out


def test_loops_and_floor_take_out_drift(alone: Path, small_scan: Path) -> None:
    before = read_scan(small_scan).world_from_cams
    after = np.stack([np.loadtxt(p) for p in sorted((alone / "poses").iterdir())])
    _, truth = read_tum(small_scan / "groundtruth.tum")
    first, last = (position_errors(poses, truth).aligned_rms_m for poses in (before, after))
    assert last < 0.6 * first


def test_the_record_has_no_plan(alone: Path) -> None:
    record = json.loads((alone / "run.json").read_text())
    assert not {"plan", "plan_fingerprint"} & set(record["inputs"])
    assert record["plan_faces"] is record["alignment"] is None
    assert "walls" not in record["cost_by_term"]
    assert set(record["metrics"]) == {"floor_plane_rms", "floor_height_rms", "floor_height_median"}
    assert record["verdict"]["outcome"] == "refined"
    _, level_from_cams = read_tum(alone / "trajectory.tum")
    poses = np.stack([np.loadtxt(p) for p in sorted((alone / "poses").iterdir())])
    np.testing.assert_allclose(
        np.array(record["world_from_plan"]) @ level_from_cams, poses, atol=1e-6
    )


def test_the_same_files_as_with_a_plan_are_written(alone: Path) -> None:
    assert {path.name for path in alone.iterdir()} == {
        "report.html", "overlay.png", "poses", "trajectory.tum", "cloud_before.ply",
        "cloud_after.ply", "run.json", "matches.npz", "covariances.npz",
        "trajectory_sigma.csv", "registration.csv", "cache", ".planfit.json", ".planfit.lock",
    }  # fmt: skip
    assert "Walls of the plan" not in (alone / "report.html").read_text()


def test_what_is_said_at_the_end(alone: Path, small_scan: Path, capsys) -> None:
    words = ["refine", str(small_scan), "--no-plan", "-o", str(alone), "--report.no-has-view"]
    assert run(words) == 0  # from the cache
    shown = capsys.readouterr().out
    assert "plan none: loops, floor and ceilings alone" in shown
    assert "wall patches on the plan" not in shown


def test_evaluate_and_export_take_it(alone: Path, tmp_path: Path, capsys) -> None:
    assert run(["evaluate", str(alone), "--no-depth-maps", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["plan"] is None
    assert "nsd" not in report["metrics"]
    assert report["metrics"]["floor_height_rms"]["difference"] < 0
    assert run(["export", str(alone), "--to", "tum", "-o", str(tmp_path / "poses.tum")]) == 0
    assert run(["evaluate", str(alone), "--plan", str(alone / "overlay.png")]) == 2
    assert "expected no plan, as the run was made without one" in capsys.readouterr().err


def test_another_run_of_the_folder_is_told(alone: Path, small_scan: Path, capsys) -> None:
    assert run(["refine", str(small_scan), "-o", str(alone)]) == 2
    assert "scan with no plan); choose another folder" in capsys.readouterr().err


def test_both_ways_are_named_where_there_is_no_plan(spoiled_scan: Path, tmp_path, capsys) -> None:
    (spoiled_scan / "floorplan.npy").unlink()
    assert run(["refine", str(spoiled_scan), "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert "planfit refine SCAN PLAN -o OUT" in error
    assert "--no-plan" in error


def test_a_plan_beside_no_plan_is_refused(small_scan: Path, tmp_path: Path, capsys) -> None:
    words = ["refine", str(small_scan), "--no-plan", "-o", str(tmp_path / "out")]
    for more in (["--plan", str(small_scan / "floorplan.npy")], ["--unit", "mm"]):
        assert run([*words, *more]) == 2
        assert "--no-plan: expected no flags of a plan" in capsys.readouterr().err

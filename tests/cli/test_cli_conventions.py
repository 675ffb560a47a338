"""Commands that read a run again take the scan's poses in the convention that the run took them in."""

import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planfit.cli import run

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
"""Camera axes of OpenGL from those of OpenCV: y up, z backward."""
FEW = ("--map.frame-step", "10")


@pytest.fixture(scope="module")
def runs(
    small_scan: Path, fitted: Path, brief: list[str], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Path]:
    """The same scan refined twice: as it is, and with poses written in OpenGL axes, which the run is told."""
    folder = tmp_path_factory.mktemp("conventions")
    turned = folder / "scan"
    shutil.copytree(small_scan, turned, copy_function=os.link)
    for path in (turned / "arcore").glob("pose-*.txt"):
        pose = np.loadtxt(path)
        path.unlink()  # a link to the file of the scan that all tests share
        np.savetxt(path, pose @ FLIP, fmt="%.18g")
    words = ["refine", str(turned), "-o", str(folder / "told"), "--poses-convention", "opengl"]
    assert run([*words, *brief]) == 0
    return fitted, folder / "told"


def answer(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    capsys.readouterr()  # what runs before have said
    assert run([*map(str, words), *FEW, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_evaluate_judges_the_poses_that_the_run_took(runs, capsys) -> None:
    usual, told = (answer(capsys, "evaluate", folder)["metrics"] for folder in runs)
    assert told["nsd"]["after"] < told["nsd"]["before"]
    assert usual.keys() == told.keys()
    for name, metric in usual.items():
        for when in ("before", "after"):
            assert told[name][when] == pytest.approx(metric[when], rel=1e-3, abs=1e-6), name


def test_compare_holds_a_run_against_the_poses_that_it_took(runs, capsys) -> None:
    usual, told = (answer(capsys, "compare", folder, "--no-depth-maps") for folder in runs)
    assert told["preferred"] == usual["preferred"] == "a"
    assert_allclose(told["by_frame"]["angle_deg"], usual["by_frame"]["angle_deg"], atol=1e-2)
    assert_allclose(told["by_frame"]["distance_m"], usual["by_frame"]["distance_m"], atol=1e-4)


@pytest.mark.slow
def test_compare_two_runs_that_took_the_poses_otherwise(
    runs, brief, tmp_path: Path, capsys
) -> None:
    # Of one scan, taken as recorded and as in OpenGL axes: the former stands on its head.
    _, told = runs
    scan = json.loads((told / "run.json").read_text())["inputs"]["scan"]
    words = ["refine", scan, "-o", str(tmp_path / "as_recorded"), "--no-plan"]
    assert run([*words, *brief, "--tracking.no-is-judged"]) in (0, 1)
    both = answer(capsys, "compare", told, tmp_path / "as_recorded", "--no-depth-maps")
    assert both["preferred"] == "a"
    assert np.median(both["by_frame"]["angle_deg"]) > 90.0
    again = answer(capsys, "compare", tmp_path / "as_recorded", told, "--no-depth-maps")
    assert_allclose(
        again["by_frame"]["angle_deg"], both["by_frame"]["angle_deg"], rtol=1e-6, atol=1e-4
    )


def test_export_writes_the_steps_that_the_run_took(runs, tmp_path: Path) -> None:
    def rows(folder: Path) -> np.ndarray:
        path = tmp_path / f"{folder.name}.g2o"
        assert run(["export", str(folder), "--to", "g2o", "-o", str(path)]) == 0
        edges = [r.split()[3:] for r in path.read_text().splitlines() if r.startswith("EDGE")]
        return np.array(edges, dtype=float)

    usual, told = (rows(folder) for folder in runs)
    assert_allclose(told[:, :7], usual[:, :7], atol=1e-6)
    assert_allclose(told[:, 7:], usual[:, 7:], rtol=1e-3)


@pytest.mark.slow
def test_auto_is_recorded_by_the_name_that_was_found(runs, brief, tmp_path: Path, capsys) -> None:
    _, told = runs
    scan = json.loads((told / "run.json").read_text())["inputs"]["scan"]
    words = ["refine", scan, "-o", str(tmp_path / "found"), "--poses-convention", "auto"]
    assert run([*words, *brief]) == 0
    before = answer(capsys, "evaluate", tmp_path / "found", "--no-depth-maps")["metrics"]
    expected = answer(capsys, "evaluate", told, "--no-depth-maps")["metrics"]
    assert before == expected

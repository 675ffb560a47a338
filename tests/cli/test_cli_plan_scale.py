"""A plan in metres that is off in scale: poses are held to it at the scale that was found."""

import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from planfit.cli import run
from planfit.scan import read_tum, write_tum

TOO_LARGE = 1.1
"""By more than any depth is off: of less, this short walk cannot tell which of the two is wrong."""


@pytest.fixture(scope="module")
def finished(
    small_scan: Path, brief: list[str], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Path]:
    """A scan whose plan is drawn too large, and its run."""
    folder = tmp_path_factory.mktemp("plan_scale")
    scan, out = folder / "scan", folder / "out"
    shutil.copytree(small_scan, scan, copy_function=os.link)
    segments = np.load(scan / "floorplan.npy")
    (scan / "floorplan.npy").unlink()  # a link to the file of the scan that all tests share
    np.save(scan / "floorplan.npy", TOO_LARGE * segments)
    allowed = ["--align.metric-scale-tolerance", "0.12"]
    assert run(["refine", str(scan), "-o", str(out), *brief, *allowed]) in (0, 1)
    found = json.loads((out / "run.json").read_text())["alignment"]["metres_per_unit_xy"]
    assert found[0] == pytest.approx(1 / TOO_LARGE, rel=0.01)
    return scan, out


def metrics(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    capsys.readouterr()  # what was said before
    assert run(["evaluate", *map(str, words), "--no-depth-maps", "--json"]) == 0
    return json.loads(capsys.readouterr().out)["metrics"]


def test_poses_on_the_plan_are_held_to_the_plan_of_the_run(finished, capsys) -> None:
    _, out = finished
    of_run = metrics(capsys, out)
    words = ("--poses", out / "trajectory.tum", "--poses-frame", "plan")
    on_plan = metrics(capsys, out, *words)
    for name, metric in of_run.items():
        assert on_plan[name]["after"] == pytest.approx(metric["after"], rel=1e-3), name


def test_poses_in_the_scans_axes_are_held_to_the_plan_at_its_scale(
    finished, tmp_path: Path, capsys
) -> None:
    _, out = finished
    times, _ = read_tum(out / "trajectory.tum")
    refined = np.stack([np.loadtxt(p) for p in sorted((out / "poses").iterdir())])
    write_tum(tmp_path / "world.tum", times, refined)
    of_run = metrics(capsys, out)
    again = metrics(capsys, out, "--poses", tmp_path / "world.tum")
    assert again["off_plan"]["after"] == pytest.approx(of_run["off_plan"]["after"], abs=2.0)
    assert again["nsd"]["after"] == pytest.approx(of_run["nsd"]["after"], rel=0.2)


def test_a_plan_that_may_not_be_rescaled_is_taken_as_drawn_and_named(
    finished, brief, tmp_path: Path, capsys
) -> None:
    scan, _ = finished
    assert run(["refine", str(scan), "-o", str(tmp_path / "out"), *brief]) == 1
    told = json.loads((tmp_path / "out" / "run.json").read_text())
    assert told["alignment"]["metres_per_unit_xy"] == [1.0, 1.0]
    other = told["alignment"]["other_scale"]
    assert other["metres_per_unit"] == pytest.approx(1 / TOO_LARGE, rel=0.01)
    said = "".join(capsys.readouterr())  # lines of a screen are broken anywhere
    said = "".join(said.split()).replace("-", "")
    assert "align.metricscaletolerance0.12" in said
    words = ["align", str(scan), str(scan / "floorplan.npy"), "-o", str(tmp_path / "a")]
    assert run([*words, *brief[:2]]) == 1
    alignment = json.loads((tmp_path / "a" / "alignment.json").read_text())
    assert alignment["other_scale"]["metres_per_unit"] == pytest.approx(1 / TOO_LARGE, rel=0.01)


def test_flags_of_a_scan_are_refused_with_a_run(finished, capsys) -> None:
    _, out = finished
    words = ["evaluate", str(out), "--poses", str(out / "trajectory.tum"), "--depth-scale", "0.001"]
    assert run(words) == 2
    assert "is read as the run did, found some; leave them out" in capsys.readouterr().err

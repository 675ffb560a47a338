"""Depth images that are 3 % long, through the command line: found, said, and corrected in what is written."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from planfit.cli import run
from planfit.scan import ScanOptions, read_scan


@pytest.fixture(scope="module")
def long_scan(small_scan: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("long") / "scan"
    shutil.copytree(small_scan, folder)
    for path in (folder / "arcore").glob("depth*.png"):
        depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(path), np.rint(1.03 * depth).astype(depth.dtype))
    return folder


@pytest.fixture(scope="module")
def finished(long_scan: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("run") / "out"
    assert run(["refine", str(long_scan), "-o", str(out), "--report.no-has-view"]) in (0, 1)
    return out


def test_depth_that_is_long_is_found_and_said(finished: Path) -> None:
    record = json.loads((finished / "run.json").read_text())
    scale = record["sensor"]["parameters"]["depth_scale"]
    assert scale["kept"]
    assert scale["sigma"] < 0.007  # a plan in metres tells it, which may be off by 0.6 % itself
    assert scale["found"] == pytest.approx(1 / 1.03, abs=scale["sigma"])
    assert any("depth was measured" in warning for warning in record["warnings"])
    assert not any("the plan is drawn" in warning for warning in record["warnings"])
    assert ">The sensor</h2>" in (finished / "report.html").read_text()


def test_exported_depth_has_its_true_size(finished: Path, small_scan: Path, tmp_path: Path) -> None:
    out = tmp_path / "colmap"
    assert run(["export", str(finished), "--to", "colmap", "-o", str(out)]) == 0
    true = read_scan(small_scan).files.depth(5)
    path = sorted((out / "depth").iterdir())[5]
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) / 1e3
    known = np.isfinite(true) & (found > 0)
    assert np.median(found[known] / true[known]) == pytest.approx(1.0, abs=0.007)


def test_evaluate_gives_the_metrics_of_the_run(finished: Path, capsys) -> None:
    assert run(["evaluate", str(finished), "--json", "--no-depth-maps"]) == 0
    metrics = json.loads(capsys.readouterr().out)["metrics"]
    record = json.loads((finished / "run.json").read_text())
    assert metrics["nsd"]["after"] == pytest.approx(record["metrics"]["nsd"]["after"])


@pytest.mark.slow
def test_calibrate_writes_what_other_scans_are_read_with(
    long_scan: Path, small_scan: Path, tmp_path: Path
) -> None:
    path = tmp_path / "device.json"
    plan = str(long_scan / "floorplan.npy")
    words = ["calibrate", str(long_scan), "--plan", plan, "-o", str(path)]
    assert run(words) == 0
    read = read_scan(long_scan, options=ScanOptions(calibration=path))
    ratio = read.files.depth(5) / read_scan(small_scan).files.depth(5)
    assert np.nanmedian(ratio) == pytest.approx(1.0, abs=0.007)
    assert run(words) == 2  # the file is there already

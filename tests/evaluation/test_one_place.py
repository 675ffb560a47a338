"""Each metric is computed once: record, checks, report and `planfit evaluate` of a run tell the same."""

import json
import re
from html import unescape
from pathlib import Path

import numpy as np
import pytest

from planfit.cli import run
from planfit.evaluation import EvaluateOptions, Truth, evaluate
from planfit.floorplan import read_floorplan
from planfit.pipeline.observations import extract_observations
from planfit.pipeline.options import RefineOptions
from planfit.runtime import Runtime
from planfit.scan import read_scan, read_tum
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    DriftOptions,
    SynthOptions,
    WalkOptions,
    make_scan,
    write_facap,
)
from planfit.tracking import TrackingOptions

STOREY_M = 3.2
OPTIONS = SynthOptions(
    seed=3,
    building=BuildingOptions(n_rooms=2),
    walk=WalkOptions(n_frames=40),
    camera=CameraOptions(width_px=240, height_px=180),
    drift=DriftOptions(yaw_deg=0.4, translation_m=0.03),
)


@pytest.fixture(scope="module")
def two_storeys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a scan whose second half was walked one storey up, over the same plan."""
    folder = tmp_path_factory.mktemp("storeys") / "scan"
    write_facap(folder, make_scan(OPTIONS))
    poses = sorted((folder / "arcore").glob("pose-*.txt"))
    plan_from_world = read_scan(folder).plan_from_world_axes
    assert plan_from_world is not None
    up_world = plan_from_world[2, :3]
    for path in poses[len(poses) // 2 :]:
        pose = np.loadtxt(path)
        pose[:3, 3] += STOREY_M * up_world
        np.savetxt(path, pose)
    return folder


@pytest.fixture(scope="module")
def finished(two_storeys: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("run") / "out"
    # The images show that nobody climbed: judged, the storey between the halves would be a jump.
    words = ["refine", str(two_storeys), "-o", str(out), "--tracking.no-is-judged"]
    assert run([*words, "--report.no-has-view"]) in (0, 1)
    return out


@pytest.fixture(scope="module")
def record(finished: Path) -> dict:
    return json.loads((finished / "run.json").read_text())


def test_the_scan_has_two_storeys(two_storeys: Path) -> None:
    runtime = Runtime()
    options = RefineOptions(tracking=TrackingOptions(is_judged=False))
    seen = extract_observations(read_scan(two_storeys), options, runtime)
    heights = seen.structure.floor_heights_m
    assert np.ptp(heights[np.isfinite(heights)]) == pytest.approx(STOREY_M, abs=0.3)


def test_record_and_evaluate_tell_the_same(finished: Path, record: dict, capsys) -> None:
    assert run(["evaluate", str(finished), "--json", "--no-depth-maps"]) == 0
    metrics = json.loads(capsys.readouterr().out)["metrics"]
    names = {"nsd", "nsd_oriented", "off_plan", "floor_plane_rms", "floor_height_rms"}
    assert names | {"floor_height_median"} == set(record["metrics"])
    for name, recorded in record["metrics"].items():
        assert metrics[name]["unit"] == recorded["unit"]
        for when in ("before", "after"):  # trajectory.tum keeps less than all digits of the poses
            assert metrics[name][when] == pytest.approx(recorded[when], rel=1e-4), (name, when)


def test_storeys_do_not_count_as_heights_of_one_floor(record: dict) -> None:
    for name in ("floor_height_rms", "floor_plane_rms", "floor_height_median"):
        for when in ("before", "after"):
            assert record["metrics"][name][when] < 100 * 0.1 * STOREY_M, (name, when)


def test_checks_and_record_tell_the_same(record: dict) -> None:
    (check,) = [check for check in record["checks"] if check["unit"] == "share"]
    for when in ("before", "after"):
        off_plan = record["metrics"]["off_plan"][when]
        assert 100 * (1 - check[when]) == pytest.approx(off_plan, rel=1e-9)


def test_report_and_record_tell_the_same(finished: Path, record: dict) -> None:
    html = (finished / "report.html").read_text()
    for title, name in (
        ("Distance to the plan (NSD)", "nsd"),
        ("Floor, half of the points", "floor_height_median"),
        ("Floor, all points", "floor_height_rms"),
    ):
        row = html[html.index(f"<strong>{title}") :].split("</tr>")[0]
        for when in ("before", "after"):
            found = re.search(rf'<span class="{when}">([\d.]+)', unescape(row))
            assert found is not None
            metres = record["metrics"][name][when] / 100
            assert float(found[1]) == pytest.approx(metres, abs=0.00051), (name, when)


def test_evaluate_poses_takes_what_the_command_takes(
    two_storeys: Path, finished: Path, record: dict, capsys
) -> None:
    """Poses alone, in the plan frame, against true ones, by the function and by the command."""
    truth_path, after_path = two_storeys / "groundtruth.tum", finished / "trajectory.tum"
    words = ["evaluate", two_storeys, "--poses", after_path, "--poses-frame", "plan"]
    words += ["--truth", truth_path, "--truth-frame", "plan", "--no-depth-maps", "--json"]
    assert run([str(word) for word in words]) == 0
    shown = json.loads(capsys.readouterr().out)
    scan = read_scan(two_storeys)
    assert scan.floorplan_path is not None
    _, after = read_tum(after_path)
    _, true_poses = read_tum(truth_path)
    evaluation = evaluate(
        scan,
        after,
        read_floorplan(scan.floorplan_path),
        Truth(np.arange(len(scan)), true_poses, frame="plan"),
        EvaluateOptions(depth_maps=False),
    )
    assert evaluation.n_true_poses == len(scan)
    assert set(evaluation.metrics) == set(shown["metrics"])
    for name, metric in evaluation.metrics.items():
        assert metric.before == pytest.approx(shown["metrics"][name]["before"], rel=1e-9), name
        assert metric.after == pytest.approx(shown["metrics"][name]["after"], rel=1e-9), name
    assert evaluation["nsd"].after == pytest.approx(record["metrics"]["nsd"]["after"], rel=1e-4)

"""The benchmark on a tiny scan; what it measures goes through refine and evaluate like a user's scan."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from paper_tables.measure import load_case, measure
from paper_tables.results import Measured
from paper_tables.run import BenchOptions, run_bench
from paper_tables.scans import descent_scan, paper_scans, small_scans
from paper_tables.variants import (
    DESCENT_VARIANTS,
    PAPER_DESCENT,
    TRUE_POSES,
    UNADJUSTED,
    VARIANTS,
    setup_digest,
)
from planfit.adjust.paper.descent import DescentSchedule
from planfit.errors import OutputError
from planfit.evaluation import position_errors
from planfit.lsq.solver import SolverOptions
from planfit.runtime import Runtime
from planfit.synth import CameraOptions, WalkOptions

BY_KEY = {variant.key: variant for variant in VARIANTS}


def tiny_scan():
    scan = small_scans()[0]
    synth = replace(
        scan.synth,
        walk=WalkOptions(n_frames=30),
        camera=CameraOptions(width_px=200, height_px=150),
    )
    return replace(scan, name="tiny", synth=synth)


@pytest.fixture(scope="module")
def tiny():
    return load_case(tiny_scan(), Runtime())


def options_of(key: str):
    return BY_KEY[key].options(0.6).adjust


def test_each_row_of_the_tables_is_there_once_with_both_presets():
    assert len(BY_KEY) == len(VARIANTS) == 25
    for preset in ("paper", "default"):
        assert options_of(f"{preset}/geometric").floor.weight == 0
        assert options_of(f"{preset}/geometric").walls.weight == 0
        assert options_of(f"{preset}/geometric + floor").walls.weight == 0
        assert options_of(f"{preset}/geometric + floor").floor.weight > 0
        assert options_of(f"{preset}/geometric + walls").floor.weight == 0
        assert options_of(f"{preset}/nearest point").wall_strategy == "nearest-point"
        assert options_of(f"{preset}/iterative nearest wall").wall_strategy == "iterative"
        assert options_of(f"{preset}/reprojection").geometric == "reprojection"
        assert options_of(f"{preset}/ray distance").geometric == "rays"
        assert options_of(f"{preset}/bounded, reprojection").is_bounded
    sides = [
        options_of(f"{preset}/{name}").association.oriented
        for preset in ("paper", "default")
        for name in ("geometric + walls", "fixed nearest wall, faces")
    ]
    assert sides == [False, True, True, False]
    assert options_of("paper/all").walls.weight == 0.6
    assert options_of("paper/all").association.mutual
    assert {options_of(key).method for key in BY_KEY if BY_KEY[key].change} == {"lm"}
    assert BY_KEY["paper/all, paper's alignment"].options(0.6).align.method == "paper"


def test_the_papers_descent_is_the_papers_cost_by_its_whole_schedule():
    adjust = PAPER_DESCENT.options(0.6).adjust
    assert replace(adjust, method="lm") == options_of("paper/all")
    assert adjust.method == "sgd"
    keys = [variant.key for variant in DESCENT_VARIANTS]
    assert keys[-1] == PAPER_DESCENT.key
    assert {"paper/all", "default/all", UNADJUSTED.key, TRUE_POSES.key} < set(keys)
    assert descent_scan().name not in {scan.name for scan in (*paper_scans(), *small_scans())}


def test_the_setup_changes_with_the_defaults(monkeypatch):
    before = setup_digest()
    assert setup_digest() == before
    assert setup_digest("other maps") != before
    monkeypatch.setattr(SolverOptions, "__repr__", lambda _: "a default that has changed")
    assert setup_digest() != before


def test_ten_scans_in_two_sets():
    scans = paper_scans()
    assert len({scan.name for scan in scans}) == 10
    assert len({scan.synth.seed for scan in scans}) == 10
    for name, has_true_plan in (("redwood-like", True), ("phone-like", False)):
        of_set = [scan for scan in scans if scan.set_name == name]
        assert len(of_set) == 5
        assert all((scan.habits is None) == has_true_plan for scan in of_set)
        assert {4, 10} <= {scan.synth.building.n_rooms for scan in of_set}


def test_metrics_of_a_variant(tiny):
    none, default = (measure(tiny, v, Runtime()) for v in (UNADJUSTED, BY_KEY["default/all"]))
    assert "solve_s" not in none.metrics
    assert default.metrics["ate"] < 0.5 * none.metrics["ate"]
    assert default.metrics["mme"] < none.metrics["mme"]
    assert default.metrics["nsd"] < none.metrics["nsd"]
    assert default.metrics["step_ms"] > 0


def test_a_descent_is_measured_without_a_verdict(tiny, monkeypatch):
    pytest.importorskip("torch", reason="PyTorch is not installed (pip install planfit[torch])")

    def few_steps(adjust):
        assert PAPER_DESCENT.change is not None
        return replace(PAPER_DESCENT.change(adjust), max_alternations=1)

    short = DescentSchedule(drop_after_steps=20, max_steps=40)
    monkeypatch.setattr("planfit.adjust.problem.PAPER_SCHEDULE", short)
    found = measure(tiny, replace(PAPER_DESCENT, change=few_steps), Runtime())
    none = measure(tiny, UNADJUSTED, Runtime())
    assert set(none.metrics) | {"solve_s", "step_ms"} == set(found.metrics)
    assert 0 < found.metrics["step_ms"] * 20 < 1e3 * found.metrics["solve_s"]
    assert not any(variant.is_descent for variant in VARIANTS)


def test_true_poses_are_measured_unrefined(tiny):
    true = measure(tiny, TRUE_POSES, Runtime())
    assert true.metrics["nnd"] == tiny.judge.values(tiny.true_plan_from_cams)["nnd"]
    assert true.metrics["nsd"] > 0
    assert not {"ate", "ate_aligned", "solve_s", "step_ms"} & set(true.metrics)


def test_truth_has_the_smallest_distance_to_the_true_scan(tiny):
    true = tiny.judge.values(tiny.true_plan_from_cams)
    off = tiny.true_plan_from_cams.copy()
    off[15:, 0, 3] += 0.1
    assert true["nnd"] < 2.0
    assert tiny.judge.values(off)["nnd"] > true["nnd"] + 0.5
    assert position_errors(off, tiny.true_plan_from_cams).rms_m == pytest.approx(
        0.1 / np.sqrt(2), abs=0.005
    )


@pytest.mark.slow
def test_a_run_that_stopped_goes_on(tmp_path: Path):
    variants = (UNADJUSTED, BY_KEY["default/all"])
    options = BenchOptions(tmp_path / "out.json", (tiny_scan(),), variants=variants[:1])
    told: list[Measured] = []
    first = run_bench(options, "1", "here", Runtime(), told.append)
    assert [m.variant for m in told] == ["default/none"]
    both = run_bench(replace(options, variants=variants), "1", "here", Runtime(), told.append)
    assert [m.variant for m in told] == ["default/none", "default/all"]
    assert both.measured[0] == first.measured[0]
    assert [p.name for p in tmp_path.iterdir()] == ["out.json"]
    run_bench(replace(options, variants=variants), "1", "here", Runtime(), told.append)
    assert len(told) == 2
    stale = replace(both, setup="of a default that has changed")
    stale.write(tmp_path / "stale.json")
    with pytest.raises(OutputError, match="a default has changed since"):
        run_bench(
            replace(options, out=tmp_path / "stale.json"), "1", "here", Runtime(), told.append
        )
    with pytest.raises(OutputError, match="results of planfit 2, found those of 1"):
        run_bench(options, "2", "here", Runtime(), told.append)

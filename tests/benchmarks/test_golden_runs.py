"""Golden runs: what is a change of results and what is not, on made-up poses."""

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from golden.command import tell
from golden.compare import compare_runs
from golden.kept import KEPT, Kept, Run, read_kept, write_kept
from golden.plans import PLANS
from golden.runs import CASES, SCANS

from planfit.errors import OptionError
from planfit.geometry import se3
from planfit.synth import BuildingOptions, make_building

HERE = {"processor": "this one", "numpy": "2.4"}


@pytest.fixture
def runs(rng: np.random.Generator) -> list[Run]:
    """Two runs of a few poses, one of them without a plan."""
    poses = [se3.retract(np.tile(np.eye(4), (6, 1, 1)), rng.normal(size=(6, 6))) for _ in range(2)]
    return [
        Run("a scan, a plan", poses[0], "refined", 0.025),
        Run("a scan, no plan", poses[1], "no better", math.nan),
    ]


def kept(runs: list[Run]) -> Kept:
    return Kept({run.name: run for run in runs}, HERE)


def moved(run: Run, frame: int, tangent: list[float]) -> Run:
    """A frame moved by a tangent vector: rotation (rad), translation (m)."""
    poses = run.plan_from_cams.copy()
    poses[frame] = se3.retract(poses[frame], np.array(tangent))
    return replace(run, plan_from_cams=poses)


def told(
    found: list[Run],
    runs: list[Run],
    capsys: pytest.CaptureFixture[str],
    is_strict: bool = False,
    here: dict[str, str] | None = None,
) -> tuple[int, str]:
    """Exit code, and what is said of faults."""
    before = kept(runs)
    code = tell(compare_runs(found, before.runs), before, here or HERE, is_strict)
    return code, capsys.readouterr().err


def test_the_same_runs_pass(runs, capsys):
    assert told(runs, runs, capsys, is_strict=True) == (0, "")
    assert all(each.are_bits_equal for each in compare_runs(runs, kept(runs).runs))


@pytest.mark.parametrize(
    ("tangent", "words"),
    [
        ([0, 0, 0, 0, 2e-6, 0], "a scan, a plan: frame 4 is 2e-06 m away"),
        ([0, 2e-6, 0, 0, 0, 0], "a scan, a plan: frame 4 is turned by 2e-06 rad"),
    ],
)
def test_a_pose_that_is_moved_fails_and_is_named(runs, capsys, tangent, words):
    code, said = told([moved(runs[0], 4, tangent), runs[1]], runs, capsys)
    assert code == 1
    assert words in said
    assert "benchmarks/golden record" in said
    assert "no plan" not in said


def test_last_digits_pass_unless_bits_are_asked_for_on_the_same_machine(runs, capsys):
    found = [moved(runs[0], 2, [1e-9, 0, 0, 0, 3e-7, 0]), runs[1]]
    assert told(found, runs, capsys) == (0, "")
    code, said = told(found, runs, capsys, is_strict=True)
    assert code == 1
    assert "a scan, a plan: bits differ, by at most 3e-07 m" in said
    other = HERE | {"processor": "another"}
    assert told(found, runs, capsys, is_strict=True, here=other) == (0, "")


def test_a_run_that_is_missing_or_new_fails(runs, capsys):
    code, said = told(runs[:1], runs, capsys)
    assert (code, "a scan, no plan: was not run" in said) == (1, True)
    code, said = told(runs, runs[:1], capsys)
    assert (code, "a scan, no plan: is not kept" in said) == (1, True)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"outcome": "improved"}, "outcome is 'improved', was 'refined'"),
        ({"metres_per_unit": 0.02500001}, "scale is 0.02500001, was 0.025"),
        ({"metres_per_unit": math.nan}, "scale is nan, was 0.025"),
        ({"plan_from_cams": np.tile(np.eye(4), (5, 1, 1))}, "has 5 poses, had 6"),
        ({"plan_from_cams": np.full((6, 4, 4), math.nan)}, "frame 0 is no number"),
    ],
)
def test_another_choice_fails(runs, capsys, changes, words):
    code, said = told([replace(runs[0], **changes), runs[1]], runs, capsys)
    assert code == 1
    assert f"a scan, a plan: {words}" in said


def test_kept_runs_are_read_to_the_last_bit(runs, tmp_path):
    write_kept(tmp_path / "poses.npz", runs, HERE)
    again = read_kept(tmp_path / "poses.npz")
    assert again.machine == HERE
    assert all(each.are_bits_equal for each in compare_runs(runs, again.runs))
    assert not any(each.faults for each in compare_runs(runs, again.runs))


@pytest.mark.parametrize("data", [None, b"", b"no runs"])
def test_a_file_that_is_missing_or_damaged_is_told(tmp_path: Path, data: bytes | None):
    path = tmp_path / "poses.npz"
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(OptionError, match="expected golden runs"):
        read_kept(path)


def test_kept_runs_are_the_eight():
    there = read_kept(KEPT).runs
    assert set(there) == {case.name for case in CASES}
    for case in CASES:
        assert len(there[case.name].plan_from_cams) == SCANS[case.scan].walk.n_frames
    assert KEPT.stat().st_size < 200_000
    for each in (Counter(case.scan for case in CASES), Counter(case.plan for case in CASES)):
        assert list(each.values()) == [2, 2, 2, 2]


def test_plans_are_of_four_kinds(rng):
    true = make_building(BuildingOptions(n_rooms=2), rng).floorplan
    made = {name: make(true) for name, make in PLANS.items()}
    assert made["faces"] is true
    assert not made["centre lines"].is_oriented.any()
    assert made["centre lines"].is_metric
    assert not made["drawing"].is_metric
    assert made["drawing"].source.kind == "DXF drawing"
    assert made["drawing"].lengths.sum() == pytest.approx(40 * true.lengths.sum(), rel=0.05)
    assert made["no plan"] is None

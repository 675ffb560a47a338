"""The table of real buildings: its drifts, what it calls wrong, what it compares; with scans made here."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from buildings.cases import Case, all_cases, base_name, choose
from buildings.changes import (
    AS_RECORDED,
    DRIFTS,
    STEADINESS,
    frames_left_out,
    kept_faces,
    kept_frames,
    one_jump,
    slow_shift,
    slow_turn,
    tracker_scale,
    true_jumps,
    walls_left_out,
)
from buildings.command import present
from buildings.failures import compare, failures_of
from buildings.judging import Announced, corrections, flipped, moved_sigmas
from buildings.measure import absent, measure
from buildings.rows import SILENT, Row
from buildings.sites import ALL_KINDS, Building, buildings
from buildings.table import columns, make_page, read_kept, totals, write_kept
from faults.inputs import Inputs
from faults.measure import CRASHED, REFUSED, How
from faults.scans import inputs_of
from numpy.testing import assert_allclose

from planfit.errors import OutputError
from planfit.geometry import se3
from planfit.synth import BuildingOptions, CameraOptions, SynthOptions, WalkOptions, make_scan

SMALL = SynthOptions(
    seed=3,
    building=BuildingOptions(n_rooms=2),
    walk=WalkOptions(n_frames=40),
    camera=CameraOptions(width_px=160, height_px=120),
)


@pytest.fixture(scope="module")
def inputs() -> Inputs:
    return inputs_of(make_scan(SMALL))


def off_steps(inputs: Inputs, changed: Inputs) -> np.ndarray:
    """Recorded steps against true ones."""
    true, recorded = inputs.true_world_from_cams, changed.scan.world_from_cams
    steps = [se3.inverse(poses[:-1]) @ poses[1:] for poses in (true, recorded)]
    return se3.inverse(steps[0]) @ steps[1]


def tracker(inputs: Inputs, change, seed: int = 1) -> Inputs:
    return change(inputs, np.random.default_rng(seed))


@pytest.mark.parametrize("change", [slow_turn, slow_shift])
def test_a_slow_drift_has_small_steps_and_a_large_end(inputs, change) -> None:
    ends = []
    for seed in range(20):
        changed = tracker(inputs, change, seed)
        off = off_steps(inputs, changed)
        assert np.linalg.norm(off[:, :3, 3], axis=1).max() < 0.15
        assert np.rad2deg(se3.rotation_angle(off[:, :3, :3])).max() < 2.0
        ends.append(changed.recorded_in_true_plan()[-1] - inputs.true_positions()[-1])
    assert 0.1 < np.sqrt(np.mean(np.square(ends))) < 1.0


def test_a_slow_turn_turns_about_the_vertical_alone(inputs) -> None:
    changed = tracker(inputs, slow_turn)
    ups = changed.scan.world_from_cams[:, :3, :3].transpose(0, 2, 1) @ inputs.up_world
    true_ups = inputs.true_world_from_cams[:, :3, :3].transpose(0, 2, 1) @ inputs.up_world
    tilt_deg = np.rad2deg(np.arccos(np.clip(np.sum(ups * true_ups, axis=1), -1, 1)))
    assert tilt_deg.max() < 1.0


def test_a_tracker_that_is_too_long_or_short_is_so_by_that_share(inputs) -> None:
    true, ways = np.ptp(inputs.true_positions()[:, :2], axis=0), set()
    for seed in range(8):
        changed = tracker(inputs, tracker_scale(0.2), seed)
        times = np.median(np.ptp(changed.recorded_in_true_plan()[:, :2], axis=0) / true)
        assert min(abs(times - 0.8), abs(times - 1.2)) < 0.02  # the noise of steps
        ways.add(bool(times > 1))
    assert ways == {True, False}


def test_a_jump_is_where_the_recorded_motion_departs(inputs) -> None:
    for seed in range(10):
        changed = tracker(inputs, one_jump, seed)
        assert len(true_jumps(inputs.true_world_from_cams, changed.scan.world_from_cams)) == 1
    quiet = tracker(inputs, slow_turn)
    assert len(true_jumps(inputs.true_world_from_cams, quiet.scan.world_from_cams)) == 0


def test_drifts_are_the_same_each_time_and_others_with_another_seed(inputs) -> None:
    (case,) = [c for c in all_cases(0) if c.name == "orebro: slow turn"]
    (other,) = [c for c in all_cases(1) if c.name == "orebro: slow turn"]
    poses = [c.inputs(inputs).scan.world_from_cams for c in (case, case, other)]
    assert_allclose(poses[0], poses[1], rtol=0, atol=0)
    assert np.abs(poses[0] - poses[2]).max() > 0.01


def test_a_tenth_of_the_frames_is_left_out_ten_ways(inputs) -> None:
    gone = [np.setdiff1d(np.arange(40), kept_frames(40, k)) for k in range(10)]
    assert_allclose(np.sort(np.concatenate(gone)), np.arange(40))
    left = tracker(inputs, frames_left_out(3))
    assert len(left.scan) == len(left.true_world_from_cams) == 36
    assert left.scan.frame_ids[3] == inputs.scan.frame_ids[4]
    assert left.scan.fingerprint != inputs.scan.fingerprint


def test_a_tenth_of_the_wall_is_left_out_five_ways(inputs) -> None:
    lengths = np.random.default_rng(0).uniform(0.5, 6.0, 100)
    ways = [kept_faces(lengths, k) for k in range(5)]
    assert len({way.tobytes() for way in ways}) == 5
    for way in ways:
        assert 0.04 < lengths[~way].sum() / lengths.sum() <= 0.1
    left = tracker(inputs, walls_left_out(1))
    assert len(left.floorplan) < len(inputs.floorplan)
    assert left.floorplan.fingerprint != inputs.floorplan.fingerprint


def test_something_is_left_out_of_the_drifted_scan(inputs) -> None:
    cases = {case.name: case for case in all_cases()}
    left, base = cases["kitchen: frames left out, 2"], cases["kitchen: slow turn"]
    assert base_name(left) == base.name
    kept = base.inputs(inputs).scan.world_from_cams[kept_frames(40, 2)]
    assert_allclose(left.inputs(inputs).scan.world_from_cams, kept)


def test_cases_have_names_and_numbers_of_their_own_and_all_drifts() -> None:
    cases = all_cases()
    assert len({case.name for case in cases}) == len({case.number for case in cases}) == len(cases)
    for building in buildings():
        own = {case.change.name for case in cases if case.building and case.scan == building.name}
        assert {drift.name for drift in DRIFTS} <= own
        if building.is_steadied:
            assert {change.name for change in STEADINESS} <= own
    short = choose(cases, "", is_short=True)
    assert {case.scan for case in short} == {case.scan for case in cases}
    only = choose(cases, "conslam|one jump", is_short=False)
    assert {case.name for case in only} >= {"conslam: slow turn", "mirror: one jump"}
    assert all("conslam" in case.name or "one jump" in case.name for case in only)


NOTHING = Announced(1.0, None, (1.0, 0.0, 0.0), 1.0, None, (), ())
NO_JUMPS = np.array([], dtype=int)


@pytest.mark.parametrize(
    ("claims", "jumps", "expected"),
    [
        (NOTHING, [], {}),
        (replace(NOTHING, metres_per_unit=1.13), [], {"scale": "false"}),
        (replace(NOTHING, other_scale=0.97), [], {"scale": "false"}),
        (replace(NOTHING, depth=(1.02, 0.0, 0.0)), [], {"depth": "false"}),
        (replace(NOTHING, depth=(1.0, 0.03, 0.0)), [], {"depth": "false"}),
        (replace(NOTHING, focal_scale=0.99), [], {"focal length": "false"}),
        (replace(NOTHING, thickness_m=0.28), [], {"thickness": "false"}),
        (replace(NOTHING, walls_m=(0.5,)), [], {"walls": "false"}),
        (replace(NOTHING, jumps=(30,)), [], {"jumps": "false"}),
        (replace(NOTHING, jumps=(30,)), [31], {"jumps": "right"}),
        (replace(NOTHING, jumps=(30,)), [50], {"jumps": "false"}),
        (replace(NOTHING, jumps=(30, 70)), [31], {"jumps": "false"}),
        (NOTHING, [31], {"jumps": "missed"}),
    ],
)
def test_corrections_are_right_false_or_missed(claims, jumps, expected) -> None:
    found = corrections(claims, np.array(jumps, dtype=int), ALL_KINDS, is_metric=True)
    assert {kind: verdict for kind, (_, _, verdict) in found.items()} == expected


def test_corrections_of_which_nothing_is_known_are_not_judged() -> None:
    claims = replace(NOTHING, depth=(1.02, 0.0, 0.0), metres_per_unit=0.01)
    assert corrections(claims, NO_JUMPS, frozenset({"scale"}), is_metric=False) == {}


DECIDED = {"outcome": 0, "scale": 1.0, "depth": 1.0, "focal length": 1.0, "thickness": 0.0,
           "place": [10.0, 4.0, 5.0]}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({}, None),
        ({"outcome": 1}, "outcome"),
        ({"scale": 1.13}, "scale"),
        ({"scale": 1.004}, None),
        ({"depth": 0.98}, "depth"),
        ({"focal length": 1.017}, "focal length"),
        ({"thickness": 0.28}, "thickness"),
        ({"place": [10.0, 7.6, 5.0]}, "place"),
        ({"place": [190.0, 4.0, 5.0]}, "place"),
        ({"place": [-349.0, 4.1, 5.0]}, None),
    ],
)
def test_decisions_that_flip_are_named(change, expected) -> None:
    found = flipped(DECIDED, {**DECIDED, **change})
    assert [words.partition(":")[0] for words in found] == ([expected] if expected else [])


def test_frames_move_by_sigmas_of_the_run_that_had_all() -> None:
    before = np.array([[0.0, 0, 0, 0.02], [1, 1, 1, 0.1]])
    now = np.array([[0.03, 0.04, 0, 9.0], [1, 1, 1, 9.0]])
    assert_allclose(moved_sigmas(before, now), [2.5, 0.0])


GOOD = Row(1, "somewhere: slow turn", "", 0, "refined: fine", 0.5, 0.04, 0.03, 0.08, 0.0,
           predicted_m=0.04, sigmas=1.0, building="somewhere", change="slow turn",
           height_before_m=0.02, height_m=0.01)  # fmt: skip


@pytest.mark.parametrize(
    ("change", "kinds"),
    [
        ({}, []),
        ({"exit_code": CRASHED}, ["crashed"]),
        ({"exit_code": REFUSED}, ["refused"]),
        ({"error_m": 0.2, "sigmas": 1.0}, [SILENT]),
        ({"error_m": 0.1, "sigmas": 4.0}, [SILENT]),
        ({"error_m": 0.01, "sigmas": 4.0}, []),  # nearer than any truth is known
        (
            {"exit_code": 1, "error_m": 3.6, "sigmas": 60.0, "before_m": 9.0},
            ["predicted too small"],
        ),
        ({"exit_code": 1, "error_m": 0.05}, ["right, refused"]),
        ({"exit_code": 1, "said": "improved", "error_m": 0.6, "sigmas": 1.0}, ["made worse"]),
        ({"exit_code": 1, "said": "no better: x", "error_m": 0.6, "sigmas": 1.0}, []),
        ({"height_m": 0.15}, ["heights worse"]),
        ({"corrections": {"depth": [[1.04, 0, 0], [1, 0, 0], "false"]}}, ["false depth"]),
        ({"corrections": {"jumps": [[], [30], "missed"]}}, ["missed jumps"]),
        ({"corrections": {"jumps": [[30], [30], "right"]}}, []),
        ({"flipped": ["scale: 1 -> 1.13"]}, ["flipped scale"]),
        ({"moved_within": 0.5}, ["unsteady"]),
        ({"is_metric": False, "scale_error": 0.022, "scale_sigma": 0.0045}, ["metre"]),
        ({"is_metric": False, "scale_error": 0.022, "scale_sigma": 0.01}, []),
        ({"reading": "right"}, []),
        ({"reading": SILENT, "facts": [["doors", "0", "5", False]]}, [SILENT]),
    ],
)
def test_what_is_wrong_with_a_row_is_told(change, kinds) -> None:
    assert [failure.kind for failure in failures_of(replace(GOOD, **change))] == kinds


def test_regressions_come_first_and_the_worst_of_them_at_the_top() -> None:
    names = ("a", "b", "c", "d")
    kept = [replace(GOOD, name=name) for name in names]
    now = [
        replace(kept[0], error_m=0.06),
        replace(kept[1], error_m=0.9, sigmas=20.0),
        replace(kept[2], error_m=0.02),
        replace(kept[3], error_m=0.041),
        replace(GOOD, name="e"),
    ]
    found = compare(kept, now)
    assert [words.partition(":")[0] for words in found.worse] == ["b", "a"]
    assert "0.040 -> 0.060 m" in found.worse[1]
    assert [words.partition(":")[0] for words in found.better] == ["c"]
    assert found.new == ("e",)


def test_a_failure_that_changes_its_numbers_is_no_regression() -> None:
    before = replace(GOOD, corrections={"depth": [[1.04, 0, 0], [1, 0, 0], "false"]})
    now = replace(GOOD, corrections={"depth": [[1.03, 0, 0], [1, 0, 0], "false"]})
    assert compare([before], [now]).worse == ()


def test_kept_rows_are_read_as_they_were_written(tmp_path: Path) -> None:
    rows = [replace(GOOD, warnings=("one", "two"), corrections={"jumps": [[30], [30], "right"]})]
    path = tmp_path / "kept.json"
    write_kept(rows, {"seed": 0}, path)
    assert json.loads(path.read_text())["conditions"] == {"seed": 0}
    (found,) = read_kept(path)
    assert found == replace(rows[0], digest="", seconds=0.0)
    path.write_text("[]")
    with pytest.raises(OutputError, match="expected rows"):
        read_kept(path)


def test_buildings_that_are_left_out_stand_apart_from_the_totals() -> None:
    rows = [GOOD, replace(GOOD, name="there: x", building="there", error_m=0.9, sigmas=20.0)]
    found = columns(rows, [])
    everything, without = totals(found), totals(found, ["there"])
    assert [cells[0] for cells in everything[:3]] == ["somewhere", "there", "all"]
    assert [cells[0] for cells in without] == [
        "somewhere",
        "all",
        "all but those chosen on",
        "there",
    ]
    assert (everything[2][3], without[1][3]) == ("2", "1")
    page = make_page(rows, [], {"seed": 0})
    assert "there: x" in page
    assert page.index("silent wrong: 0.900 m") < page.index("## Every scan")


def test_what_is_not_at_hand_is_said_once_and_left_out(monkeypatch, tmp_path: Path, capsys) -> None:
    for module in ("buildings.sites", "buildings.measure", "buildings.reading_cases"):
        monkeypatch.setattr(f"{module}.SHARED", tmp_path)
    cases = all_cases()
    assert present(cases) == []
    said = "".join(capsys.readouterr().out.split())
    assert said.count(str(tmp_path / "conslam")) == 1


def test_a_folder_of_links_in_place_of_images_is_not_at_hand(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr("buildings.sites.SHARED", tmp_path)
    image = tmp_path / "buildings" / "lounge" / "arcore" / "depth-0001.png"
    image.parent.mkdir(parents=True)
    image.write_text("/elsewhere/depth/00003.png")
    (case,) = [case for case in all_cases() if case.name == "lounge: slow turn"]
    assert "is no image" in absent(case)


@pytest.mark.slow
def test_a_case_is_measured_from_scan_to_row(inputs, tmp_path: Path) -> None:
    building = Building("two rooms", "rendered", lambda _: inputs, is_rendered=False)
    for change in (AS_RECORDED, DRIFTS[0]):
        case = Case(0, f"two rooms: {change.name}", "two rooms", building, change)
        row = measure(case, How(tmp_path, "digest"))
        assert row.exit_code in (0, 1), row.said
        assert row.error_m is not None
        assert row.before_m is not None
        assert row.error_m < 0.05
        assert (row.before_m < 1e-6) == (change is AS_RECORDED)
        assert row.cpu_s > 0.5
        assert 0.05 < row.peak_gb < 5.0
        assert row.decisions["scale"] == 1.0

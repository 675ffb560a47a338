"""A walk through two storeys, up the stairs and down again, each storey held to its own plan."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import planfit
from builders import keep_images, look, make_structure, room_plan
from planfit.adjust.association import AssociationOptions, associate
from planfit.cli.main import run
from planfit.cli.refine_inputs import read_plans
from planfit.errors import FloorplanError, OptionError, PlanfitError
from planfit.evaluation import wall_distances
from planfit.floorplan import Floorplan, PlanOptions, write_floorplan_json
from planfit.floorplan.plans_on_sheet import join_storeys
from planfit.geometry import se3
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.storey_heights import settle_floors
from planfit.pipeline.verdict import Outcome
from planfit.runtime import Runtime, StageTimer
from planfit.segmentation import NO_STOREY, number_storeys
from planfit.synth import (
    ON_STAIRS,
    BuildingOptions,
    CameraOptions,
    SynthOptions,
    WalkOptions,
    make_scan,
    write_facap,
)

OPTIONS = SynthOptions(
    seed=1,
    building=BuildingOptions(n_storeys=2, n_rooms=1),
    walk=WalkOptions(n_frames=90),
    camera=CameraOptions(width_px=240, height_px=180),
)
RISE_M = 2.9


@pytest.fixture(scope="module")
def synthetic():
    made = make_scan(OPTIONS)
    return replace(made, scan=keep_images(made.scan))


@pytest.fixture(scope="module")
def observations(synthetic):
    return planfit.extract_observations(synthetic.scan)


@pytest.fixture(scope="module")
def refined(synthetic, observations):
    return refine(synthetic, observations, dict(enumerate(synthetic.floorplans)))


def test_true_storeys_are_not_taken_for_one_floor_with_drift(synthetic, observations):
    timer = StageTimer(Runtime())
    seen, _ = settle_floors(synthetic.scan, observations, RefineOptions(), timer)
    assert seen is observations


def refine(synthetic, observations, plans):
    return planfit.refine(synthetic.scan, plans, observations=observations)


def errors_m(synthetic, result, storey, own_from_true=None, scale=1.0):
    """Position errors of the frames on a storey on its own drawing, in true metres, floor at 0."""
    own = result.storeys.walked[storey].own
    frames = np.flatnonzero(synthetic.frame_storeys == storey)
    true = synthetic.true_plan_from_cams[frames]
    true[:, 2, 3] -= synthetic.floors_z[storey]
    if own_from_true is not None:
        true = own_from_true @ true
    found = se3.inverse(own.plan_from_own) @ result.plan_from_cams[frames]
    found[:, :2, 3] *= scale / own.alignment.metres_per_unit
    return np.linalg.norm(found[:, :3, 3] - true[:, :3, 3], axis=1)


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def test_both_storeys_lie_on_their_plans(synthetic, refined):
    assert refined.verdict.outcome is Outcome.REFINED
    for storey in (0, 1):
        assert rms(errors_m(synthetic, refined, storey)) < 0.04
    lowest, upper = refined.storeys.walked
    assert lowest.floor_m == 0.0
    assert upper.floor_m == pytest.approx(RISE_M, abs=0.02)  # recorded 0.02 m off, less the stairs
    assert lowest.own.shares_axes
    assert upper.own.shares_axes
    assert_array_equal(upper.own.plan_from_own[:3, :3], np.eye(3))
    near = next(check for check in refined.checks if check.unit == "share")
    assert near.after > 0.95


def test_frames_know_their_storeys(synthetic, refined):
    found, true = refined.storeys.of_frames, synthetic.frame_storeys
    assert {NO_STOREY, 0, 1} == set(found)
    assert NO_STOREY == ON_STAIRS
    # No frame is on the other storey; the first and last steps of the stairs count to either.
    assert np.mean(found == true) > 0.8
    assert not np.any((found == 0) & (true == 1))
    assert not np.any((found == 1) & (true == 0))
    # Up and down again: the lowest storey is walked at the start and at the end.
    assert len(refined.storeys.walked[0].frames) == 2
    assert len(refined.storeys.walked[1].frames) == 1


@pytest.mark.slow
def test_a_plan_with_axes_and_unit_of_its_own(synthetic, observations):
    plan_from_true = se3.yaw_transform(np.pi / 2, np.array([13.0, -4.0, 0.0]))
    upper = synthetic.floorplans[1].placed(plan_from_true).scaled(1 / 0.013)
    plans = {0: synthetic.floorplans[0], 1: replace(upper, is_metric=False)}
    result = refine(synthetic, observations, plans)
    assert result.verdict.outcome is Outcome.REFINED
    own = result.storeys.walked[1].own
    assert not own.shares_axes
    assert own.alignment.metres_per_unit == pytest.approx(0.013, rel=0.01)
    assert rms(errors_m(synthetic, result, 0)) < 0.04
    assert rms(errors_m(synthetic, result, 1, plan_from_true, 0.013)) < 0.05
    true_from_plan = se3.inverse(plan_from_true)
    assert_allclose(own.plan_from_own[:2, :2], true_from_plan[:2, :2], atol=0.05)
    # A scale off by 0.7 % over 14 m to the plan's origin, and drift on the stairs.
    assert_allclose(own.plan_from_own[:2, 3], true_from_plan[:2, 3], atol=0.3)


def test_swapped_plans_stop_the_run(synthetic, observations):
    lower, upper = synthetic.floorplans
    plans = {3: replace(upper, name="upper.dxf"), 5: replace(lower, name="lower.dxf")}
    with pytest.raises(FloorplanError, match=r"--plan 3=lower\.dxf --plan 5=upper\.dxf"):
        refine(synthetic, observations, plans)


@pytest.mark.parametrize("given", [0, 1])
def test_a_storey_without_a_plan_is_named(synthetic, observations, given):
    result = refine(synthetic, observations, {given: synthetic.floorplans[given]})
    assert result.verdict.outcome is Outcome.IMPROVED
    (without,) = result.storeys.without_plan
    assert without is result.storeys.walked[1 - given]
    (reservation,) = [r for r in result.verdict.reservations if "without a plan" in r.words]
    assert reservation.frames == without.frames
    assert rms(errors_m(synthetic, result, given)) < 0.04
    # Held to the other storey by matches, recorded motion and floor: in heights, and roughly across.
    assert result.storeys.walked[given].floor_m == 0.0
    assert abs(without.floor_m) == pytest.approx(RISE_M, abs=0.02)
    frames = synthetic.frame_storeys == 1 - given
    off = result.plan_from_cams - synthetic.true_plan_from_cams
    off[:, 2, 3] += synthetic.floors_z[given]
    assert rms(off[frames, 2, 3]) < 0.03
    assert rms(np.linalg.norm(off[frames, :2, 3], axis=1)) < 0.3


@pytest.mark.slow
def test_a_plan_of_a_storey_that_was_not_walked_is_left_out(synthetic, observations, refined):
    plans = {**dict(enumerate(synthetic.floorplans)), 2: room_plan(9.0, 7.0, "attic")}
    result = refine(synthetic, observations, plans)
    assert result.storeys.not_walked == (2,)
    assert any("storey 2" in warning for warning in result.warnings)
    assert_array_equal(result.plan_from_cams, refined.plan_from_cams)


def test_what_only_one_plan_can_have_is_refused(synthetic, observations):
    plans = dict(enumerate(synthetic.floorplans))
    for options in (
        planfit.RefineOptions(align=planfit.alignment.AlignOptions(start="0,0,0")),
        planfit.RefineOptions(adjust=planfit.adjust.AdjustOptions(wall_strategy="iterative")),
    ):
        with pytest.raises(OptionError, match="plans by storey"):
            planfit.refine(synthetic.scan, plans, options, observations=observations)
    with pytest.raises(OptionError, match="found none"):
        refine(synthetic, observations, {})


@pytest.mark.slow
def test_the_command_line_writes_an_overlay_a_storey(synthetic, tmp_path, capsys):
    scan, out = tmp_path / "scan", tmp_path / "out"
    write_facap(scan, synthetic)
    plans = ["--plan", f"0={scan / 'plan_0.npy'}", "--plan", f"1={scan / 'plan_1.npy'}"]
    assert run(["refine", str(scan), "-o", str(out), *plans, "--report.no-has-view"]) == 0
    assert "storey 1" in capsys.readouterr().out
    assert {path.name for path in out.glob("overlay*")} == {"overlay_0.png", "overlay_1.png"}
    record = json.loads((out / "run.json").read_text())
    lowest, upper = record["storeys"]["walked"]
    assert (lowest["number"], upper["number"]) == (0, 1)
    assert upper["plan_from_own"][2][3] == upper["floor_m"] == pytest.approx(RISE_M, abs=0.02)
    frames = [f for s in (lowest, upper) for a, b in s["frames"] for f in range(a, b + 1)]
    stairs = [f for a, b in record["storeys"]["frames_on_stairs"] for f in range(a, b + 1)]
    assert sorted(frames + stairs) == list(range(len(synthetic.scan)))
    report = (out / "report.html").read_text()
    assert ">Storey 0</h2>" in report
    assert ">Storey 1</h2>" in report
    # Its metrics are in the record; read as a run on one plan, they would be wrong.
    assert run(["evaluate", str(out)]) == 2
    assert "plans by storey" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["ground={plan}"], "whole number of a storey"),
        (["{plan}", "{plan}"], "whole number of a storey"),
        (["0={plan}", "0={plan}"], "one plan for storey 0"),
        (["0={plan}", "1={plan}"], "file of several storeys"),
    ],
)
def test_bad_numbers_are_told_in_one_line(words, found, tmp_path):
    plan = tmp_path / "plan.json"
    write_floorplan_json(plan, room_plan())
    with pytest.raises(PlanfitError, match=found) as raised:
        read_plans([word.format(plan=plan) for word in words], PlanOptions())
    assert len(str(raised.value).splitlines()) == 1


def test_plans_are_read_by_their_numbers(tmp_path):
    plan = tmp_path / "a=b.json"
    write_floorplan_json(plan, room_plan())
    copy = tmp_path / "upper.json"
    write_floorplan_json(copy, room_plan())
    assert isinstance(read_plans([str(plan)], PlanOptions()), Floorplan)
    plans = read_plans([f"-1={plan}", f"0={copy}"], PlanOptions())
    assert sorted(plans) == [-1, 0]
    assert plans[-1].name == str(plan)


def joined_rooms():
    """The same room twice, one wall of the upper one 0.3 m further in; faces 0 to 3 and 4 to 7."""
    lower = room_plan()
    ends = lower.ends.copy()
    ends[0, :, 1] += 0.3
    return join_storeys({0: lower, 1: replace(lower, ends=ends)})


def on_storey(storey):
    pose = look([3, 2, 1.5], -90)[None]
    points = np.column_stack([np.linspace(1, 3, 30), np.full(30, 0.28), np.linspace(1.0, 1.4, 30)])
    structure = make_structure(pose, patches=[(0, points, np.array([0.0, 1.0]))])
    return replace(structure, storeys=np.array([storey])), pose


@pytest.mark.parametrize(("storey", "face", "off_m"), [(0, 0, 0.28), (1, 4, -0.02)])
def test_a_patch_finds_the_face_of_its_storey(storey, face, off_m):
    structure, pose = on_storey(storey)
    plan, options = joined_rooms(), AssociationOptions()
    found = associate(structure.walls, plan, pose, 0.5, options, structure.storeys)
    assert found.face_idx[0] == face
    assert found.distance_m[0] == pytest.approx(off_m)
    distances = wall_distances(structure, plan, pose)
    assert_allclose(distances.nearest_m, abs(off_m), atol=1e-9)


def test_walls_without_a_storey_are_refused_where_the_plan_has_some():
    structure, pose = on_storey(0)
    with pytest.raises(OptionError, match="storey of each piece of wall"):
        associate(structure.walls, joined_rooms(), pose, 0.5, AssociationOptions())
    with pytest.raises(OptionError, match="storey of each piece of wall"):
        wall_distances(replace(structure, storeys=None), joined_rooms(), pose)


def test_a_frame_on_stairs_is_on_no_storey():
    floors = np.array([0.0, 0.0, 0.0, 0.0, np.nan, 2.9, 2.9, 2.9])
    cameras = np.array([1.5, 1.4, 1.5, 2.6, 3.0, 3.1, 4.4, 4.3])
    heights, of_frames = number_storeys(floors, cameras)
    assert_allclose(heights, [0.0, 2.9])
    assert_array_equal(of_frames, [0, 0, 0, NO_STOREY, NO_STOREY, NO_STOREY, 1, 1])


def test_a_placed_plan_keeps_its_drawing():
    plan = room_plan()
    drawn = replace(plan, source=replace(plan.source, file_from_plan=np.diag([100.0, -100.0, 1.0])))
    placed = drawn.placed(se3.yaw_transform(0.4, np.array([3.0, -2.0, 0.0])))
    assert isinstance(placed, Floorplan)
    corners = np.concatenate([placed.ends.reshape(-1, 2), np.ones((8, 1))], axis=1)
    in_file = corners @ placed.source.file_from_plan.T
    assert_allclose(in_file[:, :2], plan.ends.reshape(-1, 2) * [100.0, -100.0], atol=1e-9)

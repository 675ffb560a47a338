"""`planfit.refine(scan, None)`: loops, floor and ceilings alone, on a synthetic walk whose truth is known."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import planfit
from planfit.adjust import AdjustOptions, adjust_to_plan
from planfit.adjust.options import TermOptions
from planfit.errors import OptionError
from planfit.evaluation import evaluate, position_errors
from planfit.geometry import se3
from planfit.lsq import ResidualTerm
from planfit.pipeline.prepare import prepare
from planfit.report.html.page import make_report
from planfit.report.measures import measure
from planfit.report.plots.overlay import draw_overlay
from planfit.segmentation import LevelPoints
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    DriftOptions,
    SynthOptions,
    WalkOptions,
    make_scan,
)
from planfit.tracking import KeyframeOptions


@pytest.fixture(scope="module")
def synthetic():
    return make_scan(
        SynthOptions(
            seed=4,
            building=BuildingOptions(n_rooms=2),
            walk=WalkOptions(n_frames=50),
            camera=CameraOptions(width_px=160, height_px=120),
            drift=DriftOptions(yaw_deg=0.5, translation_m=0.03),
        )
    )


@pytest.fixture(scope="module")
def observations(synthetic):
    return planfit.extract_observations(synthetic.scan)


@pytest.fixture(scope="module")
def alone(synthetic, observations):
    return planfit.refine(synthetic.scan, None, observations=observations)


def test_drift_is_taken_out_without_a_plan(synthetic, alone):
    truth = synthetic.true_world_from_cams
    before = position_errors(synthetic.scan.world_from_cams, truth).aligned_rms_m
    after = position_errors(alone.world_from_cams, truth).aligned_rms_m
    assert after < 0.6 * before
    assert alone.verdict.is_refined
    assert alone.evidence.is_alone


def test_nothing_of_a_plan_is_in_the_result(alone):
    assert alone.floorplan is alone.alignment is None
    assert alone.adjustment.correspondences is None
    assert alone.adjustment.association.n_associated == 0
    assert [check.unit for check in alone.checks] == ["m"]  # matches; no share of wall
    assert not {"walls", "columns"} & set(alone.cost_by_term)
    assert not any("plan" in warning for warning in alone.warnings)


def test_results_are_in_the_levelled_world_with_the_recorded_origin(synthetic, alone):
    scan = synthetic.scan
    level_from_world = alone.initial_plan_from_cams[0] @ se3.inverse(scan.world_from_cams[0])
    assert_allclose(level_from_world[:2, 3], 0.0, atol=1e-12)
    # The first frame keeps its place and yaw; both ways back to the scan's own axes agree.
    first = alone.world_from_cams[0]
    assert_allclose(first[:3, 3], scan.world_from_cams[0, :3, 3], atol=2e-3)
    assert_allclose(alone.world_from_plan @ alone.plan_from_cams, alone.world_from_cams)
    up = alone.world_from_plan[:3, :3] @ [0.0, 0.0, 1.0]
    assert_allclose(up, alone.gravity.up_world, atol=1e-9)
    eye_m = alone.plan_from_cams[:, 2, 3]
    assert np.all((eye_m > 1.0) & (eye_m < 2.0))  # floor at 0


def test_the_stages_with_no_plan_are_refine_bit_for_bit(synthetic, observations, alone):
    prepared = prepare(synthetic.scan, observations)
    adjustment = adjust_to_plan(
        prepared.measurements, None, prepared.level_from_keys, AdjustOptions()
    )
    assert_array_equal(adjustment.solution.target_from_cams, alone.plan_from_cams)


def with_ceiling(synthetic, observations, height_m, rng):
    """The same observations, and in each frame a dozen points of a ceiling."""
    cams_from_plan = se3.inverse(synthetic.true_plan_from_cams)
    eyes_xy = synthetic.true_plan_from_cams[:, None, :2, 3]
    n = len(eyes_xy)
    points = np.full((n, 12, 3), height_m)
    points[..., :2] = eyes_xy + rng.uniform(-2.0, 2.0, (n, 12, 2))
    frames = np.repeat(np.arange(n), 12)
    points_cam = se3.transform_each(cams_from_plan[frames], points.reshape(-1, 3))
    ceiling = LevelPoints(points_cam.astype(np.float32), 12 * np.arange(n + 1))
    structure = dataclasses.replace(observations.structure, ceiling=ceiling)
    return dataclasses.replace(observations, structure=structure)


def test_ceilings_hold_where_nothing_else_does(synthetic, observations, rng):
    """Without floor and surfaces, tilt and height drift; ceilings take them out again."""
    seen = with_ceiling(synthetic, observations, 2.6, rng)
    true_m = synthetic.true_plan_from_cams[:, 2, 3]
    spread = {}
    for weight in (0.0, 1.0):
        ceiling = dataclasses.replace(AdjustOptions().ceiling, weight=weight)
        adjust = AdjustOptions(
            floor=TermOptions(0.0),
            surfaces=TermOptions(0.0),
            ceiling=ceiling,
        )
        options = planfit.RefineOptions(adjust=adjust)
        result = planfit.refine(synthetic.scan, None, options, observations=seen)
        spread[weight] = np.std(result.plan_from_cams[:, 2, 3] - true_m)
    assert spread[1.0] < 0.7 * spread[0.0]


def test_known_positions_take_the_place_of_the_gauge(synthetic, observations, alone):
    frames = np.array([0, 30, 49])
    wanted = alone.plan_from_cams[frames, :3, 3] + [1.0, 0.0, 0.0]
    known = ResidualTerm(
        frames[:, None], lambda at: at[:, 0, :3, 3] - wanted, sigma=0.001, name="positions"
    )
    result = planfit.refine(synthetic.scan, None, observations=observations, extra_terms=[known])
    assert_allclose(result.plan_from_cams[frames, :3, 3], wanted, atol=5e-3)
    assert "positions" in result.cost_by_term


class Unreadable:
    """Images that must not be looked at."""

    def color(self, i):
        raise AssertionError("an image was read")

    depth = labels = color

    def write_poses(self, directory, world_from_cams):
        raise NotImplementedError


@pytest.mark.parametrize("floorplan", [None, "given"])
def test_what_extra_terms_need_is_told_before_anything_is_read(synthetic, floorplan):
    scan = dataclasses.replace(synthetic.scan, files=Unreadable())
    plan = synthetic.floorplan if floorplan else None
    term = ResidualTerm(np.array([[0]]), lambda at: at[:, 0, :3, 3], name="mine")
    keyframes = KeyframeOptions(min_frames=2, max_step_m=1.0)
    with pytest.raises(OptionError, match=r"expected all frames as unknowns.*min_frames"):
        planfit.refine(scan, plan, planfit.RefineOptions(keyframes=keyframes), extra_terms=[term])
    papers = planfit.RefineOptions(adjust=dataclasses.replace(paper_adjust(), method="sgd"))
    with pytest.raises(OptionError, match="use lm with extra terms"):
        planfit.refine(scan, plan, papers, extra_terms=[term])


def paper_adjust():
    from planfit.pipeline.options import preset

    return preset("paper").adjust


def test_the_report_shows_the_scan_alone(alone):
    html = make_report("scan", None, alone, "")
    for words in ("without a plan", "Seen from above", "Places seen twice", "nothing holds"):
        assert words in html
    for words in ("Walls of the plan", "Distance of wall points", "found on the plan", "NSD)"):
        assert words not in html
    xy = np.array([[0.0, 0.0], [4.0, 3.0]])
    shown = measure(None, alone, (xy, xy))
    assert draw_overlay(None, shown) != draw_overlay(None, measure(None, alone))


def test_evaluate_takes_a_result_without_a_plan(synthetic, alone):
    metrics = evaluate(
        synthetic.scan, alone, options=planfit.EvaluateOptions(depth_maps=False)
    ).metrics
    assert "nsd" not in metrics
    assert metrics["floor_height_rms"].after < metrics["floor_height_rms"].before


def test_frames_are_moved_as_one_by_the_way_back(synthetic, alone):
    """world_from_cams differs from plan_from_cams by one rigid motion."""
    motions = alone.world_from_cams @ se3.inverse(alone.plan_from_cams)
    assert_allclose(motions, np.broadcast_to(motions[0], motions.shape), atol=1e-9)

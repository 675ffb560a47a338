"""The middle level of the interface: the stages that `refine` consists of, and what users put in."""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import planfit
from planfit.adjust import AdjustOptions, adjust_to_plan
from planfit.adjust.options import TermOptions
from planfit.errors import OptionError, ScanError
from planfit.lsq import ResidualTerm
from planfit.pipeline.align import align_to_plan
from planfit.pipeline.prepare import prepare
from planfit.pipeline.validation import validate
from planfit.runtime import Runtime, StageTimer
from planfit.synth import BuildingOptions, CameraOptions, SynthOptions, WalkOptions, make_scan


@pytest.fixture(scope="module")
def synthetic():
    return make_scan(
        SynthOptions(
            seed=3,
            building=BuildingOptions(n_rooms=2),
            walk=WalkOptions(n_frames=40),
            camera=CameraOptions(width_px=160, height_px=120),
        )
    )


@pytest.fixture(scope="module")
def observations(synthetic):
    return planfit.extract_observations(synthetic.scan)


@pytest.mark.slow
def test_the_stages_one_by_one_are_refine_bit_for_bit(synthetic, observations):
    scan, options, timer = synthetic.scan, planfit.RefineOptions(), StageTimer(Runtime())
    prepared = prepare(scan, observations)
    on_plan = align_to_plan(scan, prepared, synthetic.floorplan, options, timer)
    adjustment = adjust_to_plan(
        prepared.measurements,
        on_plan.floorplan,
        on_plan.plan_from_level @ prepared.level_from_keys,
        options.adjust,
    )
    found = validate(prepared, on_plan, adjustment, observations.structure, options)
    whole = planfit.refine(scan, synthetic.floorplan)
    assert_array_equal(found.after, whole.plan_from_cams)
    assert_array_equal(found.before, whole.initial_plan_from_cams)
    assert found.checks == whole.checks
    assert found.cost_by_term == whole.cost_by_term


@pytest.mark.slow
def test_align_is_the_first_half_of_refine(synthetic, observations):
    aligned = planfit.align(synthetic.scan, synthetic.floorplan)
    whole = planfit.refine(synthetic.scan, synthetic.floorplan, observations=observations)
    assert_array_equal(aligned.alignment.plan_from_level, whole.alignment.plan_from_level)
    before = aligned.plan_from_world @ synthetic.scan.world_from_cams
    # Floor is at height 0 in both; the format of this scan claims its alignment, which the walls refine.
    assert np.abs(before - whole.initial_plan_from_cams).max() < 0.1


@pytest.mark.slow
def test_align_says_that_no_wall_was_seen(synthetic):
    scan = synthetic.scan
    floor = np.full((120, 160), 1.5, np.float32)  # all cameras look straight down at a floor
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    poses = np.tile(down, (len(scan), 1, 1))
    poses[:, 2, 3], poses[:, 0, 3] = 1.5, 0.05 * np.arange(len(scan))
    blind = planfit.scan_from_arrays(
        [scan.files.color(i) for i in range(len(scan))], [floor] * len(scan), scan.cameras, poses,
        up_world=np.array([0.0, 0.0, 1.0]),
    )  # fmt: skip
    with pytest.raises(ScanError, match="expected walls to align the scan by, found none"):
        planfit.align(blind, synthetic.floorplan)


def known_positions(synthetic, frames, offset_m):
    wanted = synthetic.true_plan_from_cams[frames, :3, 3] + offset_m
    return ResidualTerm(
        frames[:, None], lambda at: at[:, 0, :3, 3] - wanted, sigma=0.001, name="positions"
    )


@pytest.mark.slow
def test_extra_terms_hold_the_poses_and_their_cost_is_told(synthetic, observations):
    frames, offset_m = np.array([0, 20, 39]), np.array([0.03, 0.0, 0.0])
    without = planfit.refine(synthetic.scan, synthetic.floorplan, observations=observations)
    term = known_positions(synthetic, frames, offset_m)
    held = planfit.refine(
        synthetic.scan, synthetic.floorplan, observations=observations, extra_terms=[term]
    )
    wanted = synthetic.true_plan_from_cams[frames, :3, 3] + offset_m
    assert np.abs(without.plan_from_cams[frames, :3, 3] - wanted).max() > 0.02
    assert np.abs(held.plan_from_cams[frames, :3, 3] - wanted).max() < 0.005
    before, after = held.cost_by_term["positions"]
    assert after < 0.01 * before
    assert "positions" not in without.cost_by_term


def test_extra_terms_that_cannot_work_are_refused(synthetic, observations):
    scan, floorplan = synthetic.scan, synthetic.floorplan
    with pytest.raises(OptionError, match="found 400"):
        planfit.refine(
            scan, floorplan, observations=observations,
            extra_terms=[ResidualTerm(np.array([[400]]), lambda at: at[:, 0, :3, 3], sigma=1.0)],
        )  # fmt: skip
    points = known_positions(synthetic, np.array([0]), np.zeros(3))
    points = dataclasses.replace(points, name="points")
    with pytest.raises(OptionError, match="expected a name that no other term has"):
        planfit.refine(scan, floorplan, observations=observations, extra_terms=[points])
    few = dataclasses.replace(observations, keyframe_idx=np.arange(0, len(scan), len(scan) - 1))
    fine = known_positions(synthetic, np.array([0]), np.zeros(3))
    with pytest.raises(OptionError, match="expected all frames as unknowns"):
        planfit.refine(scan, floorplan, observations=few, extra_terms=[fine])


def test_own_matches_take_the_place_of_ours(synthetic, observations):
    own = planfit.Matches.from_arrays(
        np.array([[1, 0]] * 3), np.ones((3, 3)), np.ones((3, 3)), sigma=0.01
    )
    found = planfit.extract_observations(synthetic.scan, matches=own)
    assert found.matches is own
    assert_array_equal(found.gravity.up_world, observations.gravity.up_world)


def test_names_that_users_need_are_at_the_top():
    wanted = (
        "refine align evaluate read_scan read_floorplan Scan Floorplan RefineOptions RefineResult"
    )
    for name in [*wanted.split(), "Problem", "Term", "errors", "extract_observations", "prepare"]:
        assert name in dir(planfit)
        assert getattr(planfit, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'refin'"):
        planfit.refin  # noqa: B018


def test_extra_terms_may_be_a_generator(synthetic, observations):
    term = known_positions(synthetic, np.array([0, 20]), np.zeros(3))
    result = planfit.refine(
        synthetic.scan,
        synthetic.floorplan,
        observations=observations,
        extra_terms=(one for one in [term]),
    )
    assert "positions" in result.cost_by_term


def test_options_are_checked_also_where_observations_are_given(synthetic, observations):
    options = planfit.RefineOptions(adjust=AdjustOptions(points=TermOptions(-1.0)))
    with pytest.raises(OptionError, match="weight"):
        planfit.refine(synthetic.scan, synthetic.floorplan, options, observations=observations)


def test_names_may_be_asked_for_from_many_threads_at_first():
    code = """
import planfit
from concurrent.futures import ThreadPoolExecutor
names = [n for n in dir(planfit) if not n.startswith("_")] * 4
with ThreadPoolExecutor(32) as pool:
    assert all(value is not None for value in pool.map(lambda n: getattr(planfit, n), names))
print(planfit.adjust.build_problem.__name__)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "build_problem\n"

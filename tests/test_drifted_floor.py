"""A floor that drifted poses saw at another height is that floor, though a storey would be as high."""

from dataclasses import replace

import numpy as np
import pytest

import planfit
from planfit.findings import ScanKind
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.storey_heights import settle_floors
from planfit.runtime import Runtime, StageTimer
from planfit.segmentation.storeys import find_storeys
from planfit.synth import BuildingOptions, CameraOptions, SynthOptions, WalkOptions, make_scan

RISE_M = 2.6
CLIMB, TOP, FALL = slice(12, 22), slice(22, 38), slice(38, 48)
"""Frames over which the recorded height drifts up, stays, and drifts down again; level before and after."""


@pytest.fixture(scope="module")
def synthetic():
    return make_scan(
        SynthOptions(
            seed=5,
            building=BuildingOptions(n_rooms=2),
            walk=WalkOptions(n_frames=60),
            camera=CameraOptions(width_px=160, height_px=120),
        )
    )


@pytest.fixture(scope="module")
def observations(synthetic):
    """What the true poses show."""
    scan = replace(synthetic.scan, world_from_cams=synthetic.true_world_from_cams)
    return planfit.extract_observations(scan)


def drift_m():
    up = np.zeros(60)
    up[CLIMB], up[TOP] = np.linspace(0, RISE_M, 10), RISE_M
    up[FALL] = np.linspace(RISE_M, 0, 10)
    return up


@pytest.fixture(scope="module")
def drifted(synthetic, observations):
    """The scan and what it shows where the tracker climbed by a storey on a level floor."""
    world_from_cams = synthetic.true_world_from_cams.copy()
    world_from_cams[:, :3, 3] += drift_m()[:, None] * synthetic.true_plan_from_world[2, :3]
    floor, heights = observations.structure.floor, drift_m()
    per_point = np.repeat(heights, np.diff(floor.start))
    _, above_m = find_storeys(per_point, floor.start)
    assert len(np.unique(above_m[np.isfinite(above_m)])) == 2  # by heights alone, two storeys
    structure = replace(observations.structure, floor_heights_m=above_m)
    scan = replace(synthetic.scan, world_from_cams=world_from_cams)
    return scan, replace(observations, structure=structure, tracking=None)


def settled(drifted, options):
    return settle_floors(*drifted, options, StageTimer(Runtime()))


def test_the_floor_is_one_and_poses_come_down_to_it(synthetic, drifted):
    seen, prepared = settled(drifted, RefineOptions())
    assert np.array_equal(seen.structure.floor_heights_m, np.zeros(60))
    assert seen.structure.drifted_floors_m == pytest.approx([RISE_M], abs=0.2)
    true_m = synthetic.true_plan_from_cams[prepared.keyframes.frame_idx, 2, 3]
    off_m = prepared.level_from_keys[:, 2, 3] - true_m
    assert np.abs(off_m - np.median(off_m)).max() < 0.15


def test_the_result_says_so(drifted):
    result = planfit.refine(drifted[0], None, observations=drifted[1])
    assert any(each.kind is ScanKind.FLOOR_DRIFTED for each in result.findings)


def test_without_the_floor_term_nothing_is_settled(drifted):
    options = RefineOptions()
    floor = replace(options.adjust.floor, weight=0.0)
    seen, _ = settled(drifted, replace(options, adjust=replace(options.adjust, floor=floor)))
    assert seen is drifted[1]

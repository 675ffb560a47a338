"""Floors that slope or have pieces at other heights are followed; level ones stay level."""

from dataclasses import replace

import numpy as np
import pytest

import planfit
from planfit.findings import ScanKind
from planfit.geometry import se3
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.storey_heights import settle_floors
from planfit.runtime import Runtime, StageTimer
from planfit.synth import BuildingOptions, CameraOptions, SynthOptions, WalkOptions, make_scan


@pytest.fixture(scope="module")
def synthetic():
    return make_scan(
        SynthOptions(
            seed=8,
            building=BuildingOptions(n_rooms=4),
            walk=WalkOptions(n_frames=90),
            camera=CameraOptions(width_px=160, height_px=120),
        )
    )


@pytest.fixture(scope="module")
def observations(synthetic):
    """What the true poses show."""
    scan = replace(synthetic.scan, world_from_cams=synthetic.true_world_from_cams)
    return planfit.extract_observations(scan)


def on_relief(synthetic, observations, relief, rng):
    """Scan and observations as if the floor of the plan had the height relief(xy), walls upright.

    Each point is lifted by the relief at its place less that at its camera, in camera axes. The poses are the
    true ones on that floor, with a tracker's noise.
    """
    plan_from_cams = synthetic.true_plan_from_cams

    def lifted(points_cam, frame_idx):
        poses = plan_from_cams[frame_idx]
        at = se3.transform_each(poses, points_cam)[:, :2]
        up_m = relief(at) - relief(poses[:, :2, 3])
        return points_cam + up_m[:, None] * poses[:, 2, :3]

    seen, matches = observations.structure, observations.matches
    pair = np.repeat(np.arange(len(matches.pairs)), np.diff(matches.start))
    first, second = matches.pairs[pair].T
    floor = replace(seen.floor, points_cam=lifted(seen.floor.points_cam, seen.floor.frame_idx))
    walls = replace(
        seen.walls, points_cam=lifted(seen.walls.points_cam, seen.walls.point_frame_idx)
    )
    matches = replace(
        matches,
        points_a=lifted(matches.points_a, first),
        points_b=lifted(matches.points_b, second),
    )
    world_from_plan = se3.inverse(synthetic.true_plan_from_world)
    risen = plan_from_cams.copy()
    risen[:, 2, 3] += relief(risen[:, :2, 3])
    noise_m = np.cumsum(rng.normal(0.0, 0.002, (len(risen), 3)), axis=0)
    risen[:, :3, 3] += noise_m
    scan = replace(synthetic.scan, world_from_cams=world_from_plan @ risen)
    found = replace(
        observations,
        structure=replace(seen, floor=floor, walls=walls),
        matches=matches,
        surfaces=type(observations.surfaces).none(),
        tracking=None,
    )
    return scan, found, risen[:, 2, 3] - noise_m[:, 2]


def settled(synthetic, observations, relief, rng, options=None):
    scan, found, true_m = on_relief(synthetic, observations, relief, rng)
    timer = StageTimer(Runtime())
    seen, prepared = settle_floors(scan, found, options or RefineOptions(), timer)
    off_m = prepared.level_from_keys[:, 2, 3] - true_m[prepared.keyframes.frame_idx]
    return seen.structure, off_m - off_m.mean()


def split_at(synthetic, height_m):
    middle = np.median(synthetic.true_plan_from_cams[:, 0, 3])
    return lambda xy: height_m * (xy[:, 0] > middle)


def ramp(synthetic, slope):
    """Level, a ramp over the middle half of the walk, and level again."""
    low, high = np.quantile(synthetic.true_plan_from_cams[:, 0, 3], [0.25, 0.75])
    return lambda xy: slope * (np.clip(xy[:, 0], low, high) - low)


@pytest.mark.parametrize("slope", [0.04, -0.08])
def test_a_sloped_floor_is_followed(synthetic, observations, rng, slope):
    structure, off_m = settled(synthetic, observations, lambda xy: slope * xy[:, 1], rng)
    ((height_m, found),) = structure.floor_pieces
    assert height_m == 0.0
    assert found == pytest.approx(abs(slope), abs=0.008)
    assert np.sqrt((off_m**2).mean()) < 0.03


@pytest.mark.parametrize("height_m", [0.35, -0.8])
def test_a_piece_at_another_height_is_followed(synthetic, observations, rng, height_m):
    structure, off_m = settled(synthetic, observations, split_at(synthetic, height_m), rng)
    heights = [height for height, _ in structure.floor_pieces]
    assert np.abs(heights).max() == pytest.approx(abs(height_m), abs=0.05)
    assert np.sqrt((off_m**2).mean()) < 0.03


def test_a_ramp_between_two_levels_is_followed(synthetic, observations, rng):
    structure, off_m = settled(synthetic, observations, ramp(synthetic, 0.12), rng)
    assert structure.floor_pieces != ()
    assert np.sqrt((off_m**2).mean()) < 0.04


def test_a_level_floor_stays_level_though_heights_drift(synthetic, observations, rng):
    structure, off_m = settled(synthetic, observations, lambda xy: np.zeros(len(xy)), rng)
    assert structure.floor_pieces == ()
    assert np.sqrt((off_m**2).mean()) < 0.03


def test_a_worktop_that_is_labelled_floor_is_no_piece(synthetic, observations, rng):
    # Nobody stands on it: seen floor is 0.9 m higher in a corner that the walk only passes.
    centre = synthetic.true_plan_from_cams[:, :2, 3].mean(axis=0)
    away = np.linalg.norm(synthetic.true_plan_from_cams[:, :2, 3] - centre, axis=1)
    corner = synthetic.true_plan_from_cams[np.argmax(away), :2, 3]
    scan, found, _ = on_relief(synthetic, observations, lambda xy: np.zeros(len(xy)), rng)
    floor = found.structure.floor
    poses = synthetic.true_plan_from_cams[floor.frame_idx]
    at = se3.transform_each(poses, floor.points_cam)[:, :2]
    up_m = 0.9 * (np.linalg.norm(at - corner, axis=1) < 1.2)
    heaped = replace(floor, points_cam=floor.points_cam + up_m[:, None] * poses[:, 2, :3])
    found = replace(found, structure=replace(found.structure, floor=heaped))
    seen, _ = settle_floors(scan, found, RefineOptions(), StageTimer(Runtime()))
    assert seen.structure.floor_pieces == ()


def test_the_result_says_that_the_floor_is_not_level(synthetic, observations, rng):
    scan, found, _ = on_relief(synthetic, observations, split_at(synthetic, 0.5), rng)
    result = planfit.refine(scan, None, observations=found)
    (told,) = [each for each in result.findings if each.kind is ScanKind.FLOOR_NOT_LEVEL]
    assert np.abs(told.facts["heights_m"]).max() == pytest.approx(0.5, abs=0.05)


def test_without_the_floor_term_no_piece_is_looked_for(synthetic, observations, rng):
    options = RefineOptions()
    floor = replace(options.adjust.floor, weight=0.0)
    held = replace(options, adjust=replace(options.adjust, floor=floor))
    structure, _ = settled(synthetic, observations, split_at(synthetic, 0.5), rng, held)
    assert structure.floor_pieces == ()

"""The first half of the method, which needs no plan: gravity, floor and walls, matches, closed loops."""

from dataclasses import dataclass

import numpy as np

from planfit.adjust import (
    Keyframes,
    Measurements,
    choose_keyframes,
    close_loops,
    reduce_measurements,
)
from planfit.matching import Matches, find_matches
from planfit.pipeline import validation as checks
from planfit.pipeline.options import RefineOptions
from planfit.runtime import Runtime, StageTimer
from planfit.scan import Scan
from planfit.scan.odometry import make_odometry
from planfit.segmentation import (
    Gravity,
    Structure,
    find_gravity,
    level_from_world,
    segment_scan,
)


@dataclass(frozen=True)
class Observations:
    """What the images of a scan show, before anything is solved."""

    gravity: Gravity
    structure: Structure
    matches: Matches


@dataclass(frozen=True)
class Prepared:
    """What a scan says before a plan is looked at: levelled, matched, loops closed."""

    held_out: Matches
    """Matches kept out of the solve."""
    keyframes: Keyframes
    measurements: Measurements
    """Of the keyframes."""
    level_from_world: np.ndarray  # (4, 4)
    level_from_keys: np.ndarray  # (k, 4, 4) keyframes, loops closed


def extract_observations(
    scan: Scan, options: RefineOptions, runtime: Runtime, timer: StageTimer
) -> Observations:
    """Everything that takes the images: gravity, floor and walls, matches."""
    with timer.stage("level"):
        gravity = find_gravity(scan, options.segmentation.gravity, runtime)
    with timer.stage("floor and walls"):
        structure = segment_scan(scan, gravity, options.segmentation, runtime)
    with timer.stage("matching"):
        odometry = make_odometry(scan.world_from_cams, options.odometry)
        matches = find_matches(scan, odometry, options.matching, runtime)
    return Observations(gravity, structure, matches)


def prepare(scan: Scan, seen: Observations, options: RefineOptions, timer: StageTimer) -> Prepared:
    """The rest of what needs no plan: matches held out, keyframes, closed loops."""
    gravity, structure, matches = seen.gravity, seen.structure, seen.matches
    odometry = make_odometry(scan.world_from_cams, options.odometry)
    rng = np.random.default_rng(options.seed)
    solving, held_out = checks.hold_out(matches, options.held_out_share, rng)
    keyframes = choose_keyframes(scan.world_from_cams, options.adjust.keyframes, matches.sharpness)
    measurements = reduce_measurements(
        Measurements(solving, structure, odometry, scan.cameras), keyframes
    )
    level = level_from_world(gravity, structure.floor_height_m)
    recorded = level @ scan.world_from_cams
    level_from_keys = recorded[keyframes.frame_idx]
    if options.adjust.loops_first:
        with timer.stage("close loops"):
            closed = close_loops(measurements, level_from_keys, options.adjust)
            level_from_keys = closed.target_from_cams
    return Prepared(held_out, keyframes, measurements, level, level_from_keys)

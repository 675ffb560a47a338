"""What a scan says before a plan is looked at: gravity, floor and walls, matches, closed loops."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.adjust import (
    Keyframes,
    Measurements,
    choose_keyframes,
    close_loops,
    reduce_measurements,
)
from planfit.errors import require_plain_numbers
from planfit.matching import Matches, find_matches
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
    """What the images of a scan show, before anything is solved. Any part may be a user's own."""

    gravity: Gravity
    structure: Structure
    matches: Matches


@dataclass(frozen=True)
class PreparedScan:
    """A scan ready for a plan: levelled, matched, loops closed."""

    keyframes: Keyframes
    measurements: Measurements
    """Of the keyframes."""
    level_from_world: Float[np.ndarray, "4 4"]
    level_from_cams: Float[np.ndarray, "n 4 4"]
    """All frames as recorded, levelled."""
    level_from_keys: Float[np.ndarray, "k 4 4"]
    """Keyframes, loops closed."""


def extract_observations(
    scan: Scan,
    options: RefineOptions | None = None,
    runtime: Runtime | None = None,
    matches: Matches | None = None,
    timer: StageTimer | None = None,
) -> Observations:
    """Everything that takes the images: gravity, floor and walls, matches.

    Args:
        scan: posed RGB-D frames; where it has labels, floor and walls are taken from them.
        options: of segmentation, matching and odometry; by default what works best.
        runtime: threads, cache and progress.
        matches: a user's own; without, keypoints are matched here.
        timer: times the stages.

    Raises:
        ScanError: a file of the scan cannot be used.
        OptionError: an option has a value that cannot work.
    """
    chosen = options or RefineOptions()
    require_plain_numbers(chosen)
    running = runtime or Runtime()
    stages = timer or StageTimer(running)
    with stages.stage("level"):
        gravity = find_gravity(scan, chosen.segmentation.gravity, running)
    with stages.stage("floor and walls"):
        structure = segment_scan(scan, gravity, chosen.segmentation, running)
    if matches is not None:
        return Observations(gravity, structure, matches)
    with stages.stage("matching"):
        odometry = make_odometry(scan.world_from_cams, chosen.odometry)
        return Observations(
            gravity, structure, find_matches(scan, odometry, chosen.matching, running)
        )


def prepare(
    scan: Scan,
    observations: Observations,
    options: RefineOptions | None = None,
    timer: StageTimer | None = None,
) -> PreparedScan:
    """The rest of what needs no plan: keyframes, closed loops.

    Raises:
        ScanError: a point or a recorded step is not finite.
    """
    chosen, stages = options or RefineOptions(), timer or StageTimer(Runtime())
    require_plain_numbers(chosen)
    structure, odometry = (
        observations.structure,
        make_odometry(scan.world_from_cams, chosen.odometry),
    )
    matches = observations.matches
    keyframes = choose_keyframes(scan.world_from_cams, chosen.adjust.keyframes, matches.sharpness)
    measurements = reduce_measurements(
        Measurements(matches, structure, odometry, scan.cameras), keyframes
    )
    level = level_from_world(observations.gravity, structure.floor_height_m)
    level_from_cams = level @ scan.world_from_cams
    level_from_keys = level_from_cams[keyframes.frame_idx]
    if chosen.adjust.loops_first:
        with stages.stage("close loops"):
            closed = close_loops(measurements, level_from_keys, chosen.adjust)
        level_from_keys = closed.target_from_cams
    return PreparedScan(keyframes, measurements, level, level_from_cams, level_from_keys)

"""What a scan says before a plan is looked at: tracking, gravity, floor and walls, matches, closed loops."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.adjust import (
    Keyframes,
    Measurements,
    choose_keyframes,
    close_loops_untorn,
    reduce_measurements,
)
from planfit.errors import require_plain_numbers
from planfit.matching import Matches, find_matches, measure_neighbours
from planfit.pipeline.options import RefineOptions
from planfit.runtime import Runtime, StageTimer
from planfit.scan import Scan
from planfit.segmentation import (
    Gravity,
    Structure,
    find_gravity,
    level_from_world,
    segment_scan,
)
from planfit.tracking import Tracking, believe, judge_tracking, measured_motions


@dataclass(frozen=True)
class Observations:
    """What the images of a scan show, before anything is solved. Any part may be a user's own."""

    gravity: Gravity
    structure: Structure
    matches: Matches
    tracking: Tracking | None = None
    """How far the recorded poses can be believed; without, they are."""


@dataclass(frozen=True)
class PreparedScan:
    """A scan ready for a plan: levelled, matched, loops closed."""

    held_out: Matches
    """Matches kept out of the solve."""
    keyframes: Keyframes
    measurements: Measurements
    """Of the keyframes."""
    level_from_world: Float[np.ndarray, "4 4"]
    level_from_cams: Float[np.ndarray, "n 4 4"]
    """All frames as recorded, levelled."""
    level_from_keys: Float[np.ndarray, "k 4 4"]
    """Keyframes, loops closed."""
    warnings: tuple[str, ...] = ()
    """Revisits that were given up, a sentence each."""


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
    neighbours = None
    tracking = believe(scan.world_from_cams, chosen.poses_convention, chosen.odometry)
    if matches is None and chosen.tracking.is_judged:
        with stages.stage("tracking"):
            neighbours = measure_neighbours(scan, chosen.matching, running)
            tracking = judge_tracking(
                scan.name,
                scan.world_from_cams,
                measured_motions(neighbours.verified, chosen.matching.verify),
                chosen.poses_convention,
                chosen.odometry,
                chosen.tracking,
            )
    believed = scan
    # Equal poses stay the same array: to make them exact rotations once more would change their last digit,
    # and with it what is cached.
    if not np.array_equal(tracking.world_from_cams, scan.world_from_cams):
        believed = replace(scan, world_from_cams=tracking.world_from_cams)
    with stages.stage("level"):
        gravity = find_gravity(believed, chosen.segmentation.gravity, running)
    with stages.stage("floor and walls"):
        structure = segment_scan(believed, gravity, chosen.segmentation, running)
    if matches is None:
        with stages.stage("matching"):
            matches = find_matches(
                believed, tracking.odometry, chosen.matching, running, neighbours
            )
    return Observations(gravity, structure, matches, tracking)


def prepare(
    scan: Scan,
    observations: Observations,
    options: RefineOptions | None = None,
    timer: StageTimer | None = None,
) -> PreparedScan:
    """The rest of what needs no plan: matches held out, keyframes, closed loops.

    Raises:
        ScanError: a point or a recorded step is not finite.
    """
    chosen, stages = options or RefineOptions(), timer or StageTimer(Runtime())
    require_plain_numbers(chosen)
    structure, tracking = observations.structure, observations.tracking
    if tracking is None:
        tracking = believe(scan.world_from_cams, chosen.poses_convention, chosen.odometry)
    poses = tracking.world_from_cams
    rng = np.random.default_rng(chosen.seed)
    solving, held_out = hold_out(observations.matches, chosen.held_out_share, rng)
    keyframes = choose_keyframes(poses, chosen.adjust.keyframes, solving.sharpness)
    measurements = reduce_measurements(
        Measurements(solving, structure, tracking.odometry, scan.cameras), keyframes
    )
    level = level_from_world(observations.gravity, structure.floor_height_m)
    level_from_cams = level @ tracking.recorded_world_from_cams
    level_from_keys = level @ poses[keyframes.frame_idx]
    if not chosen.adjust.loops_first:
        return PreparedScan(
            held_out, keyframes, measurements, level, level_from_cams, level_from_keys
        )
    with stages.stage("close loops"):
        closed = close_loops_untorn(
            measurements, level_from_keys, chosen.adjust, chosen.matching.cycle_consistency
        )
    false_pairs = measurements.matches.pairs[closed.is_dropped]
    return PreparedScan(
        _without(held_out, false_pairs, keyframes),
        keyframes,
        closed.measurements,
        level,
        level_from_cams,
        closed.solution.target_from_cams,
        tuple(visit.sentence for visit in closed.dropped),
    )


def _without(matches: Matches, key_pairs: Int[np.ndarray, "q 2"], keyframes: Keyframes) -> Matches:
    """Matches without those between the frames of pairs of keyframes."""
    k = len(keyframes.frame_idx)
    # A pair as one number, i k + j, so that a set of pairs is a set of numbers.
    is_false = np.isin(keyframes.nearest[matches.pairs] @ (k, 1), key_pairs @ (k, 1))
    return matches.of_pairs(~is_false)


def hold_out(matches: Matches, share: float, rng: np.random.Generator) -> tuple[Matches, Matches]:
    """Split matches at random, within every pair: those to solve with, and those held out."""
    held = rng.random(matches.n_matches) < share
    return _keep(matches, ~held), _keep(matches, held)


def _keep(matches: Matches, keep: Bool[np.ndarray, " m"]) -> Matches:
    """Some of the matches; pairs of frames that keep none are dropped."""
    # The matches of a pair follow each other: sums over the ranges that begin at `start` count what each
    # pair keeps. (reduceat refuses an empty list of ranges.)
    sizes = np.zeros(0, dtype=int)
    if len(matches.pairs):
        sizes = np.add.reduceat(keep.astype(int), matches.start[:-1])
    some = sizes > 0
    return replace(
        matches,
        pairs=matches.pairs[some],
        start=np.cumsum([0, *sizes[some]]),
        points_a=matches.points_a[keep],
        points_b=matches.points_b[keep],
        sigma=matches.sigma[keep],
        explained=None if matches.explained is None else matches.explained[some],
    )

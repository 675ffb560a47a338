"""What a scan says before a plan is looked at: tracking, gravity, floor and walls, matches, closed loops."""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from planfit.adjust import (
    Keyframes,
    Measurements,
    choose_keyframes,
    close_loops_untorn,
    reduce_measurements,
)
from planfit.errors import require_plain_numbers
from planfit.matching import (
    Matches,
    NeighbourMotions,
    SurfaceMotions,
    SurfacePairs,
    find_matches,
    find_surface_pairs,
    measure_more,
    measure_neighbours,
    measure_surface_neighbours,
    search_matches,
    without_misled,
)
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
from planfit.short_repr import short_repr
from planfit.tracking import (
    Tracking,
    believe,
    judge_tracking,
    measured_motions,
    pairs_across,
    place_submaps,
    surface_motions,
    with_open_steps,
)


@dataclass(frozen=True)
class Observations:
    """What the images of a scan show, before anything is solved. Any part may be a user's own."""

    gravity: Gravity
    structure: Structure
    matches: Matches
    tracking: Tracking | None = None
    """How far the recorded poses can be believed; without, they are."""
    surfaces: SurfacePairs = field(default_factory=SurfacePairs.none)
    """Frames matched by geometry, where keypoints are few."""

    __repr__ = short_repr


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
    warnings: tuple[str, ...] = ()
    """Revisits that were given up, a sentence each."""
    unplaced: tuple[tuple[int, int], ...] = ()
    """Runs of frames, first and last, whose place nothing tells: tracking was lost there."""
    tracking_doubt: str = ""
    """Why the recorded poses as a whole say nothing, in words."""

    __repr__ = short_repr


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
    tracking = _believed(scan, chosen)
    known, by_surfaces = None, None
    if matches is None and chosen.tracking.is_judged:
        with stages.stage("tracking"):
            known = measure_neighbours(scan, chosen.matching, running)
            by_surfaces = _surface_neighbours(scan, known, tracking, chosen, running)
            tracking, known = _judge(scan, chosen, running, known, by_surfaces)
    believed = with_poses(scan, tracking.world_from_cams)
    with stages.stage("level"):
        gravity = find_gravity(believed, chosen.segmentation.gravity, running)
    with stages.stage("floor and walls"):
        structure = segment_scan(believed, gravity, chosen.segmentation, running)
    surfaces = SurfacePairs.none()
    if matches is None:
        with stages.stage("matching"):
            known = known or measure_neighbours(believed, chosen.matching, running)
            matches = find_matches(believed, tracking.odometry, chosen.matching, running, known)
        with stages.stage("matching by geometry"):
            surfaces = find_surface_pairs(
                believed,
                tracking.odometry,
                gravity.up_world,
                by_surfaces or _surface_neighbours(scan, known, tracking, chosen, running),
                chosen.matching,
                running,
            )
    return Observations(gravity, structure, matches, tracking, surfaces)


def _surface_neighbours(
    scan: Scan,
    known: NeighbourMotions,
    tracking: Tracking,
    options: RefineOptions,
    runtime: Runtime,
) -> SurfaceMotions:
    """Neighbours that keypoints do not bring together, by their surfaces."""
    matched = known.verified.relative_poses
    believed = with_poses(scan, tracking.world_from_cams)
    return measure_surface_neighbours(
        believed, matched, tracking.odometry, options.matching, runtime
    )


def with_poses(scan: Scan, world_from_cams: Float[np.ndarray, "n 4 4"]) -> Scan:
    """The scan with other poses; the very same one where they are equal.

    To make equal poses exact rotations once more would change their last digit, and with it what is cached.
    """
    if np.array_equal(world_from_cams, scan.world_from_cams):
        return scan
    return replace(scan, world_from_cams=world_from_cams)


def _believed(scan: Scan, options: RefineOptions) -> Tracking:
    convention, odometry = options.poses_convention, options.odometry
    return believe(scan.world_from_cams, convention, odometry, scan.timestamps)


def _judge(
    scan: Scan,
    options: RefineOptions,
    runtime: Runtime,
    known: NeighbourMotions,
    by_surfaces: SurfaceMotions,
) -> tuple[Tracking, NeighbourMotions]:
    """The recorded poses judged by neighbouring frames, doubtful steps by revisits; pairs that were tried."""
    matching = options.matching
    told_by_surfaces = surface_motions(by_surfaces.neighbours)

    def judged(known: NeighbourMotions) -> Tracking:
        return judge_tracking(
            scan.name,
            scan.world_from_cams,
            measured_motions(known.verified, matching.verify).joined(told_by_surfaces),
            options.poses_convention,
            options.odometry,
            options.tracking,
            scan.up_world,
            scan.timestamps,
        )

    tracking = judged(known)
    # As recorded, in the convention that was found: of another, all motions would seem misled.
    recorded = tracking.recorded_world_from_cams
    odometry = make_odometry(recorded, options.odometry, scan.timestamps)
    right = without_misled(known, recorded, odometry, matching)
    if right is not known:
        known, tracking = right, judged(right)
    if len(tracking.doubtful_steps):
        # Frames further apart may see what the nearest do not.
        pairs = pairs_across(tracking.doubtful_steps, len(scan), matching.pairs.neighbours)
        known = measure_more(scan, known, pairs, matching, runtime)
        known = without_misled(known, recorded, odometry, matching)
        tracking = judged(known)
    if len(tracking.doubtful_steps) == 0:
        return tracking, known
    open_steps = with_open_steps(tracking.odometry, tracking.doubtful_steps)
    mended = with_poses(scan, tracking.world_from_cams)
    found, known = search_matches(mended, open_steps, matching, runtime, known)
    return place_submaps(tracking, found, matching.verify, options.tracking), known


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
    structure, tracking = observations.structure, observations.tracking
    if tracking is None:
        tracking = _believed(scan, chosen)
    poses, matches = tracking.world_from_cams, observations.matches
    keyframes = choose_keyframes(poses, chosen.adjust.keyframes, matches.sharpness)
    measurements = reduce_measurements(
        Measurements(
            matches,
            structure,
            tracking.odometry,
            scan.cameras,
            surfaces=observations.surfaces,
        ),
        keyframes,
    )
    level = level_from_world(observations.gravity, structure.floor_height_m)
    level_from_cams = level @ tracking.recorded_world_from_cams
    level_from_keys = level @ poses[keyframes.frame_idx]
    if not chosen.adjust.loops_first:
        return PreparedScan(
            keyframes,
            measurements,
            level,
            level_from_cams,
            level_from_keys,
            unplaced=tracking.unplaced,
            tracking_doubt=tracking.doubt,
        )
    with stages.stage("close loops"):
        closed = close_loops_untorn(
            measurements, level_from_keys, chosen.adjust, chosen.matching.cycle_consistency
        )
    return PreparedScan(
        keyframes,
        closed.measurements,
        level,
        level_from_cams,
        closed.solution.target_from_cams,
        tuple(visit.sentence for visit in closed.dropped),
        tracking.unplaced,
        tracking.doubt,
    )

"""A scan made ready for a plan: levelled, held to its keyframes, loops closed."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from planfit.adjust import (
    Keyframes,
    Measurements,
    TornStep,
    close_loops_untorn,
    hold_to_keyframes,
    reduce_measurements,
)
from planfit.errors import require_plain_numbers
from planfit.findings import Finding
from planfit.geometry.se3 import Poses
from planfit.pipeline.by_hand import with_interpolated
from planfit.pipeline.observations import Observations
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.recorded_motion import believe_recorded
from planfit.runtime import Runtime, StageTimer, short_repr
from planfit.scan import Scan
from planfit.segmentation import level_from_world


@dataclass(frozen=True)
class PreparedScan:
    """A scan ready for a plan: levelled, matched, loops closed."""

    keyframes: Keyframes
    measurements: Measurements
    """Of the keyframes."""
    level_from_world: Float[np.ndarray, "4 4"]
    level_from_cams: Poses
    """All frames as recorded, levelled."""
    level_from_keys: Float[np.ndarray, "k 4 4"]
    """Keyframes, loops closed."""
    findings: tuple[Finding, ...] = ()
    """Revisits that were given up."""
    unplaced: tuple[tuple[int, int], ...] = ()
    """Runs of frames, first and last, whose place nothing tells (`Tracking.unplaced`)."""
    torn_steps: tuple[TornStep, ...] = ()
    """Recorded steps that closing loops gave up, the worst first."""
    tracking_doubt: Finding | None = None
    """Why the recorded poses as a whole say nothing."""
    leaps: tuple[tuple[int, int], ...] = ()
    """Frames before and after jumps by whose correction the walk leaps, as none can."""
    metres_per_pose_unit: float = 1.0
    """Of poses in a unit of their own, as images and depth show it."""

    __repr__ = short_repr


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
        tracking = believe_recorded(scan, chosen)
    poses, keyframe_idx = tracking.world_from_cams, observations.keyframe_idx
    if keyframe_idx is None:
        keyframe_idx = np.arange(len(scan))
    by_hand = observations.by_hand
    if by_hand is not None:
        poses = with_interpolated(poses, scan.timestamps, by_hand.is_excluded)
    keyframes = hold_to_keyframes(poses, keyframe_idx)
    measurements = reduce_measurements(
        Measurements(
            observations.matches,
            structure,
            tracking.odometry,
            scan.cameras,
            surfaces=observations.surfaces,
            control=observations.control,
            by_hand=None if by_hand is None else by_hand.matches.matches,
        ),
        keyframes,
    )
    level = level_from_world(observations.gravity, structure.floor_height_m)
    level_from_cams = level @ tracking.recorded_world_from_cams
    level_from_keys = level @ poses[keyframes.frame_idx]
    prepared = PreparedScan(
        keyframes,
        measurements,
        level,
        level_from_cams,
        level_from_keys,
        unplaced=tracking.unplaced,
        tracking_doubt=tracking.doubt,
        leaps=tracking.leaps,
        metres_per_pose_unit=tracking.metres_per_unit,
    )
    if not chosen.adjust.loops_first:
        return prepared
    with stages.stage("close loops"):
        closed = close_loops_untorn(measurements, level_from_keys, chosen.adjust)
    return replace(
        prepared,
        measurements=closed.measurements,
        level_from_keys=closed.solution.target_from_cams,
        findings=tuple(visit.finding for visit in closed.dropped),
        torn_steps=closed.torn_steps,
    )

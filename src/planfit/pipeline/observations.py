"""What the images of a scan show: how far its poses can be believed, gravity, floor and walls, matches.

Only keyframes are opened. Here they are a scan of their own; what is found is numbered by the whole scan's
frames in the end, so that nothing that follows needs to know.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Int

from planfit.adjust.calibration import PRIORS, CalibrationPriors
from planfit.adjust.terms.control import ControlMarks, no_control_marks
from planfit.corrections import NO_CORRECTIONS, Corrections
from planfit.errors import require_plain_numbers
from planfit.matching import (
    Matches,
    NeighbourMotions,
    SurfacePairs,
    find_matches,
    find_surface_pairs,
    measure_neighbours,
)
from planfit.pipeline.by_hand import HandSeen, allowed_neighbours, allowed_surfaces
from planfit.pipeline.depth_unit import AS_READ, DepthUnit
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.recorded_motion import (
    KeyedScan,
    believed_motion,
    judge_recorded_motion,
    keyed_scan,
    surface_neighbours,
)
from planfit.runtime import Runtime, StageTimer, short_repr
from planfit.scan import Scan
from planfit.segmentation import Gravity, Structure, find_gravity, segment_scan
from planfit.tracking import Tracking, with_open_steps


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
    keyframe_idx: Int[np.ndarray, " k"] | None = None
    """Frames whose images were looked at, increasing, first and last among them; None: all."""
    control: ControlMarks = field(default_factory=no_control_marks)
    """Surveyed control points, in whichever frames show them."""
    by_hand: HandSeen | None = None
    """What a person corrected of it, and what the images say of that."""
    priors: CalibrationPriors = PRIORS
    """How far the sensor, recorded steps and a plan may be off."""
    depth_unit: DepthUnit = AS_READ
    """Unit of depth, where it is another than the scan was read in; all of this is in metres."""

    __repr__ = short_repr


def extract_observations(
    scan: Scan,
    options: RefineOptions | None = None,
    runtime: Runtime | None = None,
    matches: Matches | None = None,
    timer: StageTimer | None = None,
    corrections: Corrections = NO_CORRECTIONS,
) -> Observations:
    """Everything that takes the images: gravity, floor and walls, matches.

    Args:
        scan: posed RGB-D frames; where it has labels, floor and walls are taken from them.
        options: of keyframes, segmentation, matching and odometry; by default what works best.
        runtime: threads, cache and progress.
        matches: a user's own, of any frames: all are looked at; without, keypoints are matched here.
        timer: times the stages.
        corrections: by hand: frames and pairs that are left out, loops that are there.

    Raises:
        ScanError: a file of the scan cannot be used.
        OptionError: an option has a value that cannot work, or a correction names what is not there.
    """
    chosen, running = options or RefineOptions(), runtime or Runtime()
    stages = timer or StageTimer(running)
    return observe(scan, chosen, running, stages, matches, corrections)[0]


def observe(
    scan: Scan,
    chosen: RefineOptions,
    running: Runtime,
    stages: StageTimer,
    matches: Matches | None = None,
    corrections: Corrections = NO_CORRECTIONS,
) -> tuple[Observations, NeighbourMotions | None]:
    """As `extract_observations`; with it the keypoints of the keyframes and all motions that were verified
    between neighbours, None where the matches are a user's own."""
    require_plain_numbers(chosen)

    known, by_surfaces, unit = None, None, AS_READ
    if matches is None and chosen.tracking.is_judged:
        judged = judge_recorded_motion(scan, chosen, running, stages, corrections)
        keyed, tracking, unit = judged.keyed, judged.tracking, judged.unit
        known, by_surfaces = judged.known, judged.by_surfaces
    else:
        keyed = keyed_scan(scan, chosen, running, stages, corrections, matches is not None)
        tracking = believed_motion(keyed)
    by_hand = keyed.by_hand
    believed = keyed.at(tracking.world_from_cams)
    opened = with_open_steps(tracking.odometry, tracking.contradicted_steps)
    odometry = keyed.odometry(replace(tracking, odometry=opened))
    with stages.stage("level"):
        gravity = find_gravity(believed, running)
    with stages.stage("floor and walls"):
        structure = segment_scan(believed, gravity, chosen.segmentation, running)
    surfaces = SurfacePairs.none()
    if matches is None:
        with stages.stage("matching"):
            verdicts = keyed.verdicts(tracking)
            known = known or measure_neighbours(believed, chosen.matching, running)
            allowed = allowed_neighbours(known, verdicts)
            matches = find_matches(believed, odometry, chosen.matching, running, allowed, verdicts)
        with stages.stage("matching by geometry"):
            if by_surfaces is None:
                by_surfaces = surface_neighbours(keyed, known, tracking)
                by_surfaces = allowed_surfaces(by_surfaces, verdicts)
            surfaces = find_surface_pairs(
                believed, odometry, gravity.up_world, by_surfaces, chosen.matching, running
            )
    found = Observations(gravity, structure, matches, tracking, surfaces, depth_unit=unit)
    found = found if keyed.is_whole else _numbered(found, keyed)
    return (found if by_hand is None else corrected_observations(found, by_hand)), known


def corrected_observations(observations: Observations, by_hand: HandSeen) -> Observations:
    """Observations as a person corrected them: what is ruled out is left out, whoever found it."""
    excluded = by_hand.is_excluded
    matches, surfaces = observations.matches, observations.surfaces
    idx = observations.keyframe_idx
    if excluded.any():
        frames = np.arange(len(excluded)) if idx is None else idx
        # The first and the last frame stay, without anything that they show.
        idx = frames[~excluded[frames] | (frames == 0) | (frames == len(excluded) - 1)]
    return replace(
        observations,
        structure=observations.structure.of_frames(~excluded),
        matches=matches.of_pairs(by_hand.allows(matches.pairs)),
        surfaces=surfaces[by_hand.allows(surfaces.pairs)],
        keyframe_idx=idx,
        by_hand=by_hand,
    )


def _numbered(found: Observations, keyed: KeyedScan) -> Observations:
    """What keyframes show, by the frames of the whole scan."""
    idx, n = keyed.frame_idx, len(keyed.scan)
    return replace(
        found,
        structure=found.structure.numbered(idx, n),
        matches=found.matches.numbered(idx),
        surfaces=found.surfaces.numbered(idx),
        keyframe_idx=idx,
    )

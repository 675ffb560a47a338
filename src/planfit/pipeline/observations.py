"""What the images of a scan show: how far its poses can be believed, gravity, floor and walls, matches.

Only keyframes are opened. Here they are a scan of their own; what is found is numbered by the whole scan's
frames in the end, so that nothing that follows needs to know.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.adjust.calibration import PRIORS, CalibrationPriors
from planfit.adjust.terms.control import ControlMarks, no_control_marks
from planfit.corrections import NO_CORRECTIONS, Corrections
from planfit.errors import require_plain_numbers
from planfit.geometry.calibration import NOMINAL, SensorCalibration
from planfit.matching import (
    HandVerdicts,
    Matches,
    NeighbourMotions,
    SurfaceMotions,
    SurfacePairs,
    find_matches,
    find_surface_pairs,
    measure_between,
    measure_more,
    measure_neighbours,
    measure_surface_neighbours,
    search_matches,
    spanned_steps,
    without_misled,
)
from planfit.pipeline.by_hand import (
    HandSeen,
    allowed_neighbours,
    allowed_surfaces,
    look_by_hand,
)
from planfit.pipeline.depth_or_tracker import (
    corrected_pairs,
    errs,
    errs_clearly_less,
    sensor_by_neighbours,
)
from planfit.pipeline.depth_unit import AS_READ, DepthUnit, in_unit, judged_in_its_unit
from planfit.pipeline.options import RefineOptions
from planfit.runtime import Runtime, StageTimer, short_repr
from planfit.scan import Scan
from planfit.scan.odometry import Odometry, make_odometry
from planfit.scan.views import select_frames
from planfit.segmentation import Gravity, Structure, find_gravity, segment_scan
from planfit.tracking import (
    Tracking,
    believe,
    choose_keyframes,
    frames_in_doubt,
    in_metres,
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


@dataclass(frozen=True)
class _Keyed:
    """A scan, and which of its frames are looked at."""

    scan: Scan
    frame_idx: Int[np.ndarray, " k"]
    """Keyframes: increasing, the first and the last frame among them."""
    by_hand: HandSeen | None = None
    """Corrections."""

    @property
    def is_whole(self) -> bool:
        """Whether all frames are keyframes."""
        return len(self.frame_idx) == len(self.scan)

    def at(self, world_from_cams: Float[np.ndarray, "n 4 4"]) -> Scan:
        """The keyframes alone, at these poses of all frames."""
        if self.is_whole:
            return with_poses(self.scan, world_from_cams)
        return select_frames(self.scan, self.frame_idx, world_from_cams[self.frame_idx])

    def odometry(self, tracking: Tracking) -> Odometry:
        """Steps between the keyframes."""
        poses = tracking.world_from_cams[self.frame_idx]
        return tracking.odometry.between(self.frame_idx, poses)

    def verdicts(self, tracking: Tracking) -> HandVerdicts | None:
        """What a person says of the keyframes."""
        if self.by_hand is None:
            return None
        return self.by_hand.verdicts(self.frame_idx, tracking.world_from_cams)

    def number_of(self, frames: Int[np.ndarray, "..."]) -> Int[np.ndarray, "..."]:
        """Of frames of the scan, the number of the last keyframe up to each."""
        return np.searchsorted(self.frame_idx, frames, side="right") - 1


@dataclass(frozen=True)
class _Judged:
    """The recorded poses judged, by motions between neighbouring keyframes."""

    keyed: _Keyed
    tracking: Tracking
    known: NeighbourMotions
    by_surfaces: SurfaceMotions


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

    def keyed_in(unit: DepthUnit) -> _Keyed:
        seen = in_unit(scan, unit)
        with stages.stage("corrections"):
            by_hand = look_by_hand(seen, corrections, chosen, running)
        return _Keyed(seen, _keyframes(seen, chosen, matches), by_hand)

    def judged_in(unit: DepthUnit) -> _Judged:
        keyed = keyed_in(unit)
        with stages.stage("tracking"):
            return _judge(keyed, _believed(keyed, chosen), chosen, running)

    known, by_surfaces, unit = None, None, AS_READ
    if matches is None and chosen.tracking.is_judged:
        judged, unit = judged_in_its_unit(scan, judged_in)
        keyed, tracking = judged.keyed, judged.tracking
        known, by_surfaces = judged.known, judged.by_surfaces
    else:
        keyed = keyed_in(unit)
        tracking = _believed(keyed, chosen)
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
                by_surfaces = _surface_neighbours(keyed, known, tracking, chosen, running)
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


def with_poses(scan: Scan, world_from_cams: Float[np.ndarray, "n 4 4"]) -> Scan:
    """The scan with other poses; the very same one where they are equal.

    To make equal poses exact rotations once more would change their last digit, and with it what is cached.
    """
    if np.array_equal(world_from_cams, scan.world_from_cams):
        return scan
    return replace(scan, world_from_cams=world_from_cams)


def believe_recorded(scan: Scan, options: RefineOptions) -> Tracking:
    """The recorded poses of all frames as they are."""
    return _believed(_Keyed(scan, np.arange(len(scan))), options)


def _keyframes(scan: Scan, options: RefineOptions, matches: Matches | None) -> np.ndarray:
    """Frames (k,) to look at: all, where matches name frames of their own."""
    if matches is not None or options.matching.colmap:
        return np.arange(len(scan))
    return choose_keyframes(scan.world_from_cams, scan.timestamps, options.keyframes, scan.lacking)


def _numbered(found: Observations, keyed: _Keyed) -> Observations:
    """What keyframes show, by the frames of the whole scan."""
    idx, n = keyed.frame_idx, len(keyed.scan)
    return replace(
        found,
        structure=found.structure.numbered(idx, n),
        matches=found.matches.numbered(idx),
        surfaces=found.surfaces.numbered(idx),
        keyframe_idx=idx,
    )


def _surface_neighbours(
    keyed: _Keyed,
    known: NeighbourMotions,
    tracking: Tracking,
    options: RefineOptions,
    runtime: Runtime,
) -> SurfaceMotions:
    """Neighbours that keypoints do not bring together, by their surfaces."""
    matched = known.verified.relative_poses
    believed = keyed.at(tracking.world_from_cams)
    odometry = keyed.odometry(tracking)
    return measure_surface_neighbours(believed, matched, odometry, options.matching, runtime)


def _believed(keyed: _Keyed, options: RefineOptions) -> Tracking:
    scan, convention = keyed.scan, options.poses_convention
    poses, times = scan.world_from_cams, scan.timestamps
    return believe(poses, convention, options.odometry, times, keyed.frame_idx)


def _judge(keyed: _Keyed, believed: Tracking, options: RefineOptions, runtime: Runtime) -> _Judged:
    """The recorded poses judged by neighbouring keyframes, doubtful steps by revisits.

    Where the tracker is in doubt, or neighbours do not match, more frames become keyframes.
    """
    matching = options.matching
    known = measure_neighbours(keyed.at(keyed.scan.world_from_cams), matching, runtime)
    judged = _by_neighbours(keyed, believed, known, options, runtime)
    found = judged.tracking.convention
    if found != believed.convention:
        # Surfaces are brought together from the recorded motion, too: now that of the convention found.
        believed = _believed(keyed, replace(options, poses_convention=found))
        judged = _by_neighbours(keyed, believed, known, options, runtime)
    more = frames_in_doubt(judged.tracking, keyed.frame_idx, _are_bridged(judged))
    more = more[[keyed.scan.lacking[i] != "depth" for i in more]]
    if len(more):
        denser = replace(keyed, frame_idx=np.union1d(keyed.frame_idx, more))
        known_idx = denser.number_of(keyed.frame_idx)
        # From what was measured: what a break misled may be right beside other frames.
        known = measure_between(
            denser.at(keyed.scan.world_from_cams), known, known_idx, matching, runtime
        )
        judged = _by_neighbours(denser, believed, known, options, runtime)
    return _by_revisits(judged, options, runtime)


def _by_neighbours(
    keyed: _Keyed,
    believed: Tracking,
    known: NeighbourMotions,
    options: RefineOptions,
    runtime: Runtime,
) -> _Judged:
    """The recorded poses compared with motions between neighbours, by keypoints and by surfaces.

    But for those that a person ruled out, or that patterns misled.
    """
    by_surfaces = _surface_neighbours(keyed, known, believed, options, runtime)
    verdicts, matching = keyed.verdicts(believed), options.matching
    known = allowed_neighbours(known, verdicts)
    judged = _Judged(keyed, believed, known, allowed_surfaces(by_surfaces, verdicts))
    tracking = _compared(judged, known, options)
    # As recorded, in the convention that was found: of another, all motions would seem misled.
    recorded = tracking.recorded_world_from_cams[keyed.frame_idx]
    odometry = make_odometry(recorded, options.odometry, keyed.scan.timestamps[keyed.frame_idx])
    right = without_misled(known, recorded, odometry)
    if right is not known:
        known, tracking = right, _compared(judged, right, options)
    if len(tracking.doubtful_steps):
        # Frames further apart may see what the nearest do not.
        steps = np.unique(keyed.number_of(tracking.doubtful_steps))
        pairs = pairs_across(steps, len(keyed.frame_idx), matching.pairs.neighbours)
        at_recorded = keyed.at(keyed.scan.world_from_cams)
        known = measure_more(at_recorded, known, pairs, matching, runtime)
        known = allowed_neighbours(known, keyed.verdicts(tracking))
        known = without_misled(known, recorded, odometry)
        tracking = _compared(judged, known, options)
    if errs(tracking) and options.calibration.is_on:
        cameras = keyed.at(keyed.scan.world_from_cams).cameras
        # As if the poses had no unit of their own.
        metric = in_metres(recorded, 1 / tracking.metres_per_unit)
        odometry = make_odometry(metric, options.odometry, keyed.scan.timestamps[keyed.frame_idx])
        sensor = sensor_by_neighbours(known.verified, metric, odometry, cameras, options)
        if not sensor.is_nominal:
            again = _compared(judged, known, options, sensor)
            tracking = again if errs_clearly_less(again, tracking) else tracking
    return replace(judged, tracking=tracking, known=known)


def _compared(
    judged: _Judged,
    known: NeighbourMotions,
    options: RefineOptions,
    sensor: SensorCalibration = NOMINAL,
) -> Tracking:
    """The recorded poses of all frames, compared with motions between keyframes that a sensor measured."""
    scan, idx = judged.keyed.scan, judged.keyed.frame_idx
    verified = corrected_pairs(known.verified, sensor)
    measured = measured_motions(verified)
    told_by_surfaces = surface_motions(judged.by_surfaces.neighbours.corrected(sensor))
    return judge_tracking(
        scan.name,
        scan.world_from_cams,
        measured.joined(told_by_surfaces).numbered(idx),
        options.poses_convention,
        options.odometry,
        options.tracking,
        scan.up_world,
        scan.timestamps,
        idx,
    )


def _are_bridged(judged: _Judged) -> Bool[np.ndarray, " g"]:
    """Of each gap between two keyframes, whether a pair of matched frames spans it."""
    by_keypoints = judged.known.verified.relative_poses.pairs
    pairs = np.concatenate([by_keypoints, judged.by_surfaces.neighbours.pairs])
    return spanned_steps(pairs, len(judged.keyed.frame_idx) - 1)


def _by_revisits(judged: _Judged, options: RefineOptions, runtime: Runtime) -> _Judged:
    """Doubtful steps decided by revisits that are sought with these open."""
    keyed, tracking, matching = judged.keyed, judged.tracking, options.matching
    if len(tracking.doubtful_steps) == 0:
        return judged
    opened = with_open_steps(tracking.odometry, tracking.doubtful_steps)
    steps = keyed.odometry(replace(tracking, odometry=opened))
    mended = keyed.at(tracking.world_from_cams)
    verdicts = keyed.verdicts(tracking)
    found, known = search_matches(mended, steps, matching, runtime, judged.known, verdicts)
    revisits = found.numbered(keyed.frame_idx)
    placed = place_submaps(tracking, revisits)
    return replace(judged, tracking=placed, known=known)

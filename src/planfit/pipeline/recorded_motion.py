"""The recorded motion of a scan, judged by what neighbouring keyframes show: unit, convention, clock, breaks.

The first stage that opens images. It needs neither gravity nor floor nor walls; what follows works at the
poses that it comes to.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Int

from planfit.corrections import NO_CORRECTIONS, Corrections
from planfit.geometry.calibration import NOMINAL, SensorCalibration
from planfit.geometry.se3 import Poses
from planfit.matching import (
    HandVerdicts,
    NeighbourMotions,
    SurfaceMotions,
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
    as_if_asked,
    corrected_pairs,
    errs,
    errs_clearly_less,
    sensor_by_neighbours,
)
from planfit.pipeline.depth_unit import AS_READ, DepthUnit, in_unit, judged_in_its_unit
from planfit.pipeline.options import RefineOptions
from planfit.runtime import Runtime, StageTimer
from planfit.scan import Scan
from planfit.scan.odometry import Odometry, make_odometry
from planfit.scan.views import select_frames
from planfit.tracking import (
    Tracking,
    believe,
    choose_keyframes,
    frames_in_doubt,
    judge_tracking,
    measured_motions,
    pairs_across,
    place_submaps,
    require_asked_convention,
    surface_motions,
    with_open_steps,
)


@dataclass(frozen=True)
class KeyedScan:
    """A scan, and which of its frames are looked at."""

    scan: Scan
    frame_idx: Int[np.ndarray, " k"]
    """Keyframes: increasing, the first and the last frame among them."""
    options: RefineOptions
    runtime: Runtime = field(default_factory=Runtime)
    by_hand: HandSeen | None = None
    """Corrections."""

    @property
    def is_whole(self) -> bool:
        """Whether all frames are keyframes."""
        return len(self.frame_idx) == len(self.scan)

    @property
    def recorded(self) -> Scan:
        """The keyframes alone, at the recorded poses."""
        return self.at(self.scan.world_from_cams)

    def at(self, world_from_cams: Poses) -> Scan:
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
class JudgedMotion:
    """The recorded poses judged, by motions between neighbouring keyframes."""

    keyed: KeyedScan
    tracking: Tracking
    known: NeighbourMotions
    """All that was verified between keyframes by keypoints."""
    by_surfaces: SurfaceMotions
    """Neighbours that keypoints do not bring together."""
    unit: DepthUnit = AS_READ
    """Of depth, where it is another than the scan was read in; all of this is in metres."""


def judge_recorded_motion(
    scan: Scan,
    options: RefineOptions | None = None,
    runtime: Runtime | None = None,
    timer: StageTimer | None = None,
    corrections: Corrections = NO_CORRECTIONS,
) -> JudgedMotion:
    """How far the recorded poses can be believed, and the unit that depth is in.

    Arguments are those of `extract_observations`.

    Raises:
        ScanError: a file of the scan cannot be used, or another convention explains what images show, and
            `auto` was not asked for.
        OptionError: an option has a value that cannot work, or a correction names what is not there.
    """
    chosen, running = options or RefineOptions(), runtime or Runtime()
    stages = timer or StageTimer(running)

    def judged_in(unit: DepthUnit) -> JudgedMotion:
        keyed = keyed_scan(in_unit(scan, unit), chosen, running, stages, corrections)
        with stages.stage("tracking"):
            return _by_revisits(_judge(keyed))

    judged, unit = judged_in_its_unit(scan, judged_in)
    require_asked_convention(scan.name, judged.tracking, chosen.poses_convention)
    return replace(judged, unit=unit)


def keyed_scan(
    scan: Scan,
    options: RefineOptions,
    runtime: Runtime,
    timer: StageTimer,
    corrections: Corrections = NO_CORRECTIONS,
    is_whole: bool = False,
) -> KeyedScan:
    """The frames to look at, all of them where the `is_whole` scan is, and what a person says of them."""
    with timer.stage("corrections"):
        by_hand = look_by_hand(scan, corrections, options, runtime)
    chosen = np.arange(len(scan))
    if not (is_whole or options.matching.colmap):
        poses, times = scan.world_from_cams, scan.timestamps
        chosen = choose_keyframes(poses, times, options.keyframes, scan.lacking)
    return KeyedScan(scan, chosen, options, runtime, by_hand)


def with_poses(scan: Scan, world_from_cams: Poses) -> Scan:
    """The scan with other poses; the very same one where they are equal.

    To make equal poses exact rotations once more would change their last digit, and with it what is cached.
    """
    if np.array_equal(world_from_cams, scan.world_from_cams):
        return scan
    return replace(scan, world_from_cams=world_from_cams)


def believe_recorded(scan: Scan, options: RefineOptions) -> Tracking:
    """The recorded poses of all frames as they are."""
    return believed_motion(KeyedScan(scan, np.arange(len(scan)), options))


def surface_neighbours(
    keyed: KeyedScan, known: NeighbourMotions, tracking: Tracking
) -> SurfaceMotions:
    """Neighbours that keypoints do not bring together, by their surfaces."""
    matched, odometry = known.verified.relative_poses, keyed.odometry(tracking)
    believed, matching = keyed.at(tracking.world_from_cams), keyed.options.matching
    return measure_surface_neighbours(believed, matched, odometry, matching, keyed.runtime)


def believed_motion(keyed: KeyedScan, convention: str | None = None) -> Tracking:
    """The recorded poses as they are, steps between keyframes as sure as usual.

    In the convention that the options name, or in another.
    """
    scan, options = keyed.scan, keyed.options
    named = convention or options.poses_convention
    poses, times = scan.world_from_cams, scan.timestamps
    return believe(poses, named, options.odometry, times, keyed.frame_idx)


def _judge(keyed: KeyedScan) -> JudgedMotion:
    """The recorded poses judged by neighbouring keyframes.

    Where the tracker is in doubt, or neighbours do not match, more frames become keyframes.
    """
    matching, runtime, believed = keyed.options.matching, keyed.runtime, believed_motion(keyed)
    known = measure_neighbours(keyed.recorded, matching, runtime)
    judged = _by_neighbours(keyed, believed, known)
    found = judged.tracking.convention
    if found != believed.convention:
        # Surfaces are brought together from the recorded motion, too: now that of the convention found.
        believed = believed_motion(keyed, found)
        judged = _by_neighbours(keyed, believed, known)
    more = frames_in_doubt(judged.tracking, keyed.frame_idx, _are_bridged(judged))
    more = more[[keyed.scan.lacking[i] != "depth" for i in more]]
    if len(more) == 0:
        return judged
    denser = replace(keyed, frame_idx=np.union1d(keyed.frame_idx, more))
    known_idx = denser.number_of(keyed.frame_idx)
    # From what was measured: what a break misled may be right beside other frames.
    known = measure_between(denser.recorded, known, known_idx, matching, runtime)
    return _by_neighbours(denser, believed, known)


def _by_neighbours(keyed: KeyedScan, believed: Tracking, known: NeighbourMotions) -> JudgedMotion:
    """The recorded poses compared with motions between neighbours, by keypoints and by surfaces.

    But for those that a person ruled out, or that patterns misled.
    """
    by_surfaces = surface_neighbours(keyed, known, believed)
    verdicts, options = keyed.verdicts(believed), keyed.options
    times = keyed.scan.timestamps[keyed.frame_idx]
    known = allowed_neighbours(known, verdicts)
    judged = JudgedMotion(keyed, believed, known, allowed_surfaces(by_surfaces, verdicts))
    tracking = _compared(judged, known)
    # As recorded, in the convention that was found: of another, all motions would seem misled.
    recorded = tracking.recorded_world_from_cams[keyed.frame_idx]
    odometry = make_odometry(recorded, options.odometry, times)
    right = without_misled(known, recorded, odometry)
    if right is not known:
        known, tracking = right, _compared(judged, right)
    if len(tracking.doubtful_steps):
        # Frames further apart may see what the nearest do not.
        steps = np.unique(keyed.number_of(tracking.doubtful_steps))
        pairs = pairs_across(steps, len(keyed.frame_idx), options.matching.pairs.neighbours)
        known = measure_more(keyed.recorded, known, pairs, options.matching, keyed.runtime)
        known = allowed_neighbours(known, keyed.verdicts(tracking))
        known = without_misled(known, recorded, odometry)
        tracking = _compared(judged, known)
    if errs(tracking) and options.calibration.is_on:
        metric = as_if_asked(recorded, tracking)
        odometry, cameras = make_odometry(metric, options.odometry, times), keyed.recorded.cameras
        found = sensor_by_neighbours(known.verified, metric, odometry, cameras, options)
        # A lens that is further off than lenses are is still more usual than a camera carried askew.
        is_lens = tracking.is_mount_doubtful and bool(found.implausible)
        sensor = found.unbelieved if is_lens else found.sensor
        if not sensor.is_nominal:
            again = _compared(judged, known, sensor)
            tracking = again if errs_clearly_less(again, tracking) else tracking
    return replace(judged, tracking=tracking, known=known)


def _compared(
    judged: JudgedMotion, known: NeighbourMotions, sensor: SensorCalibration = NOMINAL
) -> Tracking:
    """The recorded poses of all frames, compared with motions between keyframes that a sensor measured."""
    scan, idx, options = judged.keyed.scan, judged.keyed.frame_idx, judged.keyed.options
    measured = measured_motions(corrected_pairs(known.verified, sensor))
    told_by_surfaces = surface_motions(judged.by_surfaces.neighbours.corrected(sensor))
    return judge_tracking(
        scan.world_from_cams,
        measured.joined(told_by_surfaces).numbered(idx),
        options.poses_convention,
        options.odometry,
        options.tracking,
        scan.up_world,
        scan.timestamps,
        idx,
    )


def _are_bridged(judged: JudgedMotion) -> Bool[np.ndarray, " g"]:
    """Of each gap between two keyframes, whether a pair of matched frames spans it."""
    by_keypoints = judged.known.verified.relative_poses.pairs
    pairs = np.concatenate([by_keypoints, judged.by_surfaces.neighbours.pairs])
    return spanned_steps(pairs, len(judged.keyed.frame_idx) - 1)


def _by_revisits(judged: JudgedMotion) -> JudgedMotion:
    """Doubtful steps decided by revisits that are sought with these open."""
    keyed, tracking = judged.keyed, judged.tracking
    if len(tracking.doubtful_steps) == 0:
        return judged
    opened = with_open_steps(tracking.odometry, tracking.doubtful_steps)
    steps = keyed.odometry(replace(tracking, odometry=opened))
    mended = keyed.at(tracking.world_from_cams)
    verdicts, running = keyed.verdicts(tracking), (keyed.options.matching, keyed.runtime)
    found, known = search_matches(mended, steps, *running, judged.known, verdicts)
    revisits = found.numbered(keyed.frame_idx)
    placed = place_submaps(tracking, revisits)
    return replace(judged, tracking=placed, known=known)

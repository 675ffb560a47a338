"""One case: recorded motion judged as `planfit refine` does before anything is solved, beside the truth."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from faults.measure import CRASHED, REFUSED, How, KeypointsKept, Measured
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

import planfit
from planfit.errors import PlanfitError
from planfit.geometry import se3
from planfit.pipeline.align import observed_in_metres
from planfit.pipeline.depth_unit import MILLIMETRE, REPLICA, TUM
from planfit.pipeline.given import Given
from planfit.pipeline.recorded_motion import JudgedMotion, judge_recorded_motion
from planfit.runtime import StageTimer
from planfit.scan import Scan
from planfit.scan.pose_files import take_poses
from planfit.scan.poses import write_tum
from planfit.scan.views import FilesView
from planfit.tracking import (
    Tracking,
    TrackingOptions,
    judge_tracking,
    measured_motions,
    require_asked_convention,
    surface_motions,
)
from planfit.tracking.motions import MeasuredMotions
from planfit.tracking.numbered import mount_of
from recordings.cases import (
    CLOCK_FAULTS,
    CLOCKS,
    MOUNTS,
    NO_MOUNTS,
    OTHER_UNITS,
    OWN_UNITS,
    RIGHT_UNITS,
    UNITS,
    Case,
    Clock,
)
from recordings.sources import Recording, piece, walk_at_rate

RIGHT, ASKED, WRONG = "right", "asked", "wrong"
"""What a case comes to: as it should; the user is told what is open; wrong without a word."""
DEPTH_OFF_SHARE, TRACKER_OFF_SHARE = 0.015, 0.005
"""Depth cameras and trackers are so far off (standard deviations), in their right unit."""
MOST_STORED = 65535
TURN_DEG, ARM_M = 1.0, 0.05
"""Within which mounts are right."""
MOST_ARM_M = 0.5
MOUNT_FRAMES = 120
OWN_UNIT_M = (0.02, 50.0)
WITHIN_SHARE = 0.05
"""Of a unit of poses."""
MORE_TIMES, MORE_M = 1.5, 0.005
"""Errors of steps over a second may be so much larger than with clocks that agree."""
BEGIN_S = 1.7e9
MAX_GAP_S = 0.02

Poses = Float[np.ndarray, "n 4 4"]


@dataclass(frozen=True)
class Row(Measured):
    """What came of a case."""

    outcome: str = ""
    """One of `RIGHT`, `ASKED`, `WRONG`."""
    put_in: str = ""
    found: str = ""
    by_plan: str = ""
    """Of a unit that was asked for: what came of it with the scan's plan."""


@dataclass(frozen=True)
class StoredDepth(FilesView):
    """Depth as it comes from whole numbers that are read in another unit."""

    stored_m: float
    read_m: float
    factor: float
    """By which the sensor is off."""

    def depth(self, frame_idx: int) -> Float[np.ndarray, "h w"]:
        """m, as read."""
        stored = self.files.depth(frame_idx) * (self.factor / self.stored_m)
        if self.read_m != 1.0:  # floating-point numbers are stored as they are
            stored = np.where(stored <= MOST_STORED, np.round(stored), np.nan)
        return (stored * self.read_m).astype(np.float32)


def measure(case: Case, how: How) -> Row:
    """Judge a case. Errors of planfit are told to the user; others are crashes."""
    row = Row(case.number, case.name, how.digest, CRASHED)
    begin = time.perf_counter()
    try:
        row = _MEASURE[case.group](case, how, row)
    except PlanfitError as error:
        row = replace(row, exit_code=REFUSED, said=str(error), outcome=ASKED)
    except Exception as error:  # whatever it is: the battery goes on, and says so
        row = replace(row, said=f"{type(error).__name__}: {error}", outcome=WRONG)
    return replace(row, seconds=round(time.perf_counter() - begin, 2))


def _judged(scan: Scan, how: How, convention: str = "recorded") -> JudgedMotion:
    options = replace(how.options, poses_convention=convention)
    return judge_recorded_motion(scan, options, KeypointsKept(workers=1, cache_dir=how.cache_dir))


def _stored(
    recording: Recording, poses: Poses, stored_m: float, read_m: float, factor: float
) -> Scan:
    files = StoredDepth(recording.scan.files, stored_m, read_m, factor)
    fingerprint = f"{recording.scan.fingerprint} {stored_m:.6g} {read_m:.6g} {factor:.6g}"
    return replace(
        recording.scan,
        files=files,
        world_from_cams=poses,
        depth_read_in_m=read_m,
        fingerprint=fingerprint,
    )


def _in_metre(poses: Poses, metres: float) -> Poses:
    return se3.make_transform(poses[:, :3, :3], poses[:, :3, 3] / metres)


def _unit_changed(case: Case, how: How, row: Row) -> Row:
    read_m, stored_m = OTHER_UNITS[case.variant]
    rng, recording = case.rng(), piece(case.scan, case.is_last, how.cache_dir)
    poses = _in_metre(recording.tracked(rng), 1 + TRACKER_OFF_SHARE * rng.normal())
    factor = 1 + DEPTH_OFF_SHARE * rng.normal()
    return _unit_row(case, how, row, _stored(recording, poses, stored_m, read_m, factor), 1.0)


def _unit_right(case: Case, how: How, row: Row) -> Row:
    """Depth that is up to 8 per cent off, in its own unit."""
    read_m = (MILLIMETRE, TUM, REPLICA, 1.0)[case.variant]
    rng, recording = case.rng(), piece(case.scan, case.is_last, how.cache_dir)
    poses = _in_metre(recording.tracked(rng), 1 + TRACKER_OFF_SHARE * rng.normal())
    scan = _stored(recording, poses, read_m, read_m, 1 + rng.uniform(-0.08, 0.08))
    return _unit_row(case, how, row, scan, 1.0)


def _own_unit(case: Case, how: How, row: Row) -> Row:
    """Depth in its own unit, poses in another than a metre."""
    rng, recording = case.rng(), piece(case.scan, case.is_last, how.cache_dir)
    metres = 1.0
    while 1 / 1.2 < metres < 1.2:
        metres = float(np.exp(rng.uniform(*np.log(OWN_UNIT_M))))
    read_m = (MILLIMETRE, TUM)[case.variant]
    factor = 1 + DEPTH_OFF_SHARE * rng.normal()
    poses = _in_metre(recording.tracked(rng), metres)
    return _unit_row(case, how, row, _stored(recording, poses, read_m, read_m, factor), metres)


def _unit_row(case: Case, how: How, row: Row, scan: Scan, metres: float) -> Row:
    """Beside the unit that depth was stored in, and the one that poses have."""
    files = scan.files
    assert isinstance(files, StoredDepth)
    right = files.stored_m / files.read_m
    put_in = f"depth x {right:.4g}, poses in {metres:.4g} m"
    row = replace(row, put_in=put_in)
    judged = _judged(scan, how, "auto")
    unit, found_m = judged.unit, judged.tracking.metres_per_unit
    found = f"depth x {unit.factor:.4g}, poses in {found_m:.4g} m"
    is_right = np.isclose(unit.factor, right, rtol=0.01) and (
        abs(np.log(found_m / metres)) < WITHIN_SHARE or (abs(metres - 1) < 1e-9 and found_m == 1.0)
    )
    if unit.rival == 1.0:
        outcome = RIGHT if is_right else WRONG
        if outcome == WRONG and judged.tracking.doubt is not None:
            outcome = ASKED
        words = "; ".join(judged.tracking.warnings)[:200]
        return replace(row, exit_code=0, outcome=outcome, found=found, said=words)
    row = replace(row, exit_code=1, outcome=ASKED, found=f"{found}, or depth x {unit.rival:.4g}")
    return replace(row, by_plan=_by_plan(case, how, scan, right))


def _by_plan(case: Case, how: How, scan: Scan, right: float) -> str:
    plan = piece(case.scan, case.is_last, how.cache_dir).floorplan
    if not plan.is_metric:
        return "no plan"
    given = Given(scan, plan, replace(how.options, poses_convention="auto"), planfit.Runtime(1))
    timer = StageTimer(given.runtime)
    seen = planfit.extract_observations(scan, given.options, given.runtime, timer=timer)
    try:
        factor = observed_in_metres(given, seen, timer).depth_unit.factor
    except PlanfitError:
        return ASKED
    return RIGHT if np.isclose(factor, right, rtol=0.01) else WRONG


def _mounted(case: Case, how: How, row: Row) -> Row:
    """Poses of a body that carries the camera, turned by up to 180 degrees, an arm up to 0.5 m long."""
    rng, recording = case.rng(), piece(case.scan, case.is_last, how.cache_dir, MOUNT_FRAMES)
    axis, way = rng.normal(size=(2, 3))
    turn = rng.uniform(0, np.pi) * axis / np.linalg.norm(axis)
    arm_m = rng.uniform(0, MOST_ARM_M) * way / np.linalg.norm(way)
    body_from_cam = se3.make_transform(se3.exp_so3(turn), arm_m)
    poses = recording.tracked(rng) @ se3.inverse(body_from_cam)
    row = replace(row, put_in=_mount_words(body_from_cam))
    tracking = _tracking(recording, poses, how)
    found = mount_of(tracking.convention)
    if found is None:
        outcome = ASKED if tracking.doubt is not None else WRONG
        return replace(row, exit_code=0, outcome=outcome, found=tracking.convention)
    off_deg = float(np.rad2deg(se3.rotation_angle((se3.inverse(found) @ body_from_cam)[:3, :3])))
    off_m = found[:3, 3] - body_from_cam[:3, 3]
    # What no turn of the walk tells, such as a level robot's height, moves no camera.
    told = _told_by_turns(recording.true_world_from_cams @ se3.inverse(body_from_cam))
    told_m = float(np.linalg.norm(told @ off_m))
    is_right = off_deg <= TURN_DEG and told_m <= ARM_M
    words = f"{_mount_words(found)}; off {off_deg:.2f} deg, {np.linalg.norm(off_m):.3f} m"
    words += f", {told_m:.3f} m of it told by turns"
    return replace(row, exit_code=0, outcome=RIGHT if is_right else WRONG, found=words)


def _told_by_turns(world_from_bodies: Poses) -> Float[np.ndarray, "3 3"]:
    """Projection onto the directions in which an arm moves the camera by a tenth of its length and more, RMS
    over pairs of frames, against the others."""
    rotations = world_from_bodies[:, :3, :3]
    steps = np.swapaxes(rotations[:-4], 1, 2) @ rotations[4:] - np.eye(3)
    squared, axes = np.linalg.eigh(np.mean(np.swapaxes(steps, 1, 2) @ steps, axis=0))
    is_told = np.sqrt(squared) >= 0.1
    return axes[:, is_told] @ axes[:, is_told].T


def _mount_words(body_from_cam: Float[np.ndarray, "4 4"]) -> str:
    turn_deg = np.rad2deg(np.linalg.norm(se3.log_so3(body_from_cam[:3, :3])))
    return f"turn {turn_deg:.1f} deg, arm {np.linalg.norm(body_from_cam[:3, 3]):.3f} m"


def _not_mounted(case: Case, how: How, row: Row) -> Row:
    """Right poses of trackers that err as much as usual, twice, and four times as much."""
    rng, recording = case.rng(), piece(case.scan, case.is_last, how.cache_dir, MOUNT_FRAMES)
    poses = recording.tracked(rng, (1.0, 2.0, 4.0, 1.0)[case.variant])
    found = _tracking(recording, poses, how).convention
    outcome = RIGHT if found == "recorded" else WRONG
    return replace(row, exit_code=0, outcome=outcome, put_in="recorded", found=found)


def _clocked(case: Case, how: How, row: Row) -> Row:
    """A trajectory in a file, whose clock is another than that of the images."""
    clock, rng = CLOCK_FAULTS[case.variant], case.rng()
    recording = walk_at_rate(case.scan)
    motions = _motions(recording, how)
    row = replace(row, put_in=clock.words)
    state = rng.bit_generator.state
    usual_m, _, _ = _step_errors_m(
        recording, motions, replace(Clock(), poses_hz=clock.poses_hz), rng
    )
    rng.bit_generator.state = state
    error_m, tracking, told = _step_errors_m(recording, motions, clock, rng)
    found = "no offset" if tracking.clock is None else str(tracking.clock.finding.facts)
    found += f", steps {error_m:.4f} m off, {usual_m:.4f} m with clocks that agree"
    is_right = error_m <= MORE_TIMES * usual_m + MORE_M
    is_told = bool(told) or tracking.doubt is not None
    outcome = RIGHT if is_right else ASKED if is_told else WRONG
    return replace(row, exit_code=0, outcome=outcome, found=found, said="; ".join(told)[:300])


def _step_errors_m(
    recording: Recording, motions: MeasuredMotions, clock: Clock, rng: np.random.Generator
) -> tuple[float, Tracking, tuple[str, ...]]:
    """Of steps over a second, RMS; the tracking; and what was said while reading."""
    n = len(recording.scan)
    image_s = recording.scan.timestamps
    scan = replace(recording.scan, timestamps=BEGIN_S + image_s)
    drifted = recording.tracked(rng, 0.5)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "trajectory.txt"
        write_tum(path, *_trajectory(drifted, image_s, clock))
        read = take_poses(scan, path, MAX_GAP_S)
    idx = np.array([scan.frame_ids.index(name) for name in read.frame_ids])
    number = np.full(n, -1)
    number[idx] = np.arange(len(idx))
    pairs = number[motions.pairs]
    is_here = (pairs >= 0).all(axis=1)
    here = replace(motions[np.flatnonzero(is_here)], pairs=pairs[is_here])
    tracking = judge_tracking(
        read.world_from_cams,
        here,
        "recorded",
        planfit.RefineOptions().odometry,
        TrackingOptions(),
        None,
        read.timestamps,
    )
    require_asked_convention(scan.name, tracking, "recorded")
    return *_errors(tracking, recording.true_world_from_cams[idx]), tuple(read.warnings)


def _errors(tracking: Tracking, true: Poses) -> tuple[float, Tracking]:
    k = 30
    found, right = (
        se3.inverse(poses[:-k]) @ poses[k:] for poses in (tracking.world_from_cams, true)
    )
    off_m = np.linalg.norm((found - right)[:, :3, 3], axis=1)
    return float(np.sqrt(np.mean(off_m**2))), tracking


def _trajectory(
    poses: Poses, image_s: Float[np.ndarray, " n"], clock: Clock
) -> tuple[Float[np.ndarray, " k"], Poses]:
    """Times as a file has them, and poses of the tracker, which runs from before the first image on."""
    at = np.arange(image_s[0], image_s[-1] + 1e-9, 1 / clock.poses_hz)
    turns = RotationSpline(image_s, Rotation.from_matrix(poses[:, :3, :3]))(at).as_matrix()
    places = CubicSpline(image_s, poses[:, :3, 3])(at)
    times_s = at * (1 + clock.rate) + clock.late_s
    if clock.order == "set back":
        times_s = np.where(np.arange(len(at)) >= len(at) // 2, times_s - 1 / 3, times_s)
    times = (BEGIN_S + times_s) * clock.per_s
    order = np.arange(len(at))[:: -1 if clock.order == "backwards" else 1]
    return times[order], se3.make_transform(turns, places)[order]


def _tracking(recording: Recording, poses: Poses, how: How) -> Tracking:
    """Of recorded poses, by the motions that images show. No mount changes these, but for those of surfaces,
    which are brought together from the recorded motion.
    """
    scan = replace(recording.scan, world_from_cams=poses, up_world=None)
    if not scan.has_color:
        return _judged(scan, how, "auto").tracking
    motions = _motions(recording, how)
    options = planfit.RefineOptions()
    return judge_tracking(
        poses, motions, "auto", options.odometry, options.tracking, None, scan.timestamps
    )


def _motions(recording: Recording, how: How) -> MeasuredMotions:
    """Measured once of each recording."""
    scan = replace(recording.scan, world_from_cams=recording.true_world_from_cams)
    path = how.cache_dir / f"motions-{how.digest}-{scan.fingerprint}.npz"
    if not path.exists():
        judged = _judged(scan, how)
        by_keypoints = measured_motions(judged.known.verified)
        found = by_keypoints.joined(surface_motions(judged.by_surfaces.neighbours))
        np.savez(path, *(found.pairs, found.a_from_b, found.covariance, found.n_inliers))
    with np.load(path) as arrays:
        return MeasuredMotions(*(arrays[f"arr_{k}"] for k in range(4)))


_MEASURE: dict[str, Callable[[Case, How, Row], Row]] = {
    UNITS: _unit_changed,
    RIGHT_UNITS: _unit_right,
    OWN_UNITS: _own_unit,
    MOUNTS: _mounted,
    NO_MOUNTS: _not_mounted,
    CLOCKS: _clocked,
}

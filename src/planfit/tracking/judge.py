"""Judge the recorded poses: convention, clock, noise, breaks; and correct what can be corrected."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.errors import ScanError
from planfit.findings import Finding, PoseKind
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.scan.odometry import Odometry, OdometryOptions, make_odometry
from planfit.tracking.breaks import Displacement, find_displacement
from planfit.tracking.clock import ClockOffset, TrackingOptions, find_clock, tells_clock
from planfit.tracking.conventions import (
    AUTO,
    FRAME_DELAYS,
    RECORDED,
    WORLD_AXES,
    ConventionFit,
    apply_convention,
    best_convention,
    turned_axes,
)
from planfit.tracking.lost import Filled, fill_lost, void_steps
from planfit.tracking.lost_runs import (
    LostRun,
    between_held,
    count_repeated,
    find_lost_runs,
    is_identity,
    stands_still,
    usual_of_known,
)
from planfit.tracking.motions import MeasuredMotions, noise_factors, over_told_steps
from planfit.tracking.submaps import find_doubtful
from planfit.tracking.trajectory import (
    LONG_INTERVAL,
    FrameTimes,
    frame_times,
    fuse,
    interpolate_trajectory,
    interpolation_sigmas,
    with_steps_of,
)
from planfit.tracking.types import (
    NOTED_FACTOR,
    Tracking,
    TrackingBreak,
    describe_jump,
    size_of,
    without_leaps,
)

MAX_BREAKS_SHARE = 0.1
"""A tracker with more breaks a frame than this is not mended: what is broken then is no step."""


@dataclass(frozen=True)
class _Tracker:
    """How much a tracker errs over its steps."""

    options: OdometryOptions
    read_sigmas: Float[np.ndarray, "n 2"] | None = None
    """rad and m, of poses that were read between the recorded ones."""
    factors: tuple[float, float] = (1.0, 1.0)
    """On the sigmas of rotation and translation of all steps."""
    timestamps: Float[np.ndarray, " n"] | None = None
    """s; frames of one time are fixed to each other."""
    keyframe_idx: Int[np.ndarray, " k"] | None = None
    """Frames between which steps are as sure as `options` say; None: all."""
    up_world: Float[np.ndarray, "3"] | None = None
    """Unit vector against gravity, where the tracker knows it."""

    def steps(
        self,
        poses: Poses,
        displaced: Sequence[Displacement] = (),
        replaced: dict[int, tuple[float, float]] | None = None,
    ) -> Odometry:
        """Steps of corrected poses; those that were broken are as sure as what took their place."""
        odometry = make_odometry(poses, self.options, self.timestamps, self.keyframe_idx)
        rotation, translation = odometry.sigma_rotation, odometry.sigma_translation
        if self.read_sigmas is not None:
            of_step = np.hypot(self.read_sigmas[:-1], self.read_sigmas[1:])
            rotation = np.hypot(rotation, of_step[:, 0])
            translation = np.hypot(translation, of_step[:, 1])
        rotation, translation = rotation * self.factors[0], translation * self.factors[1]
        for d in displaced:
            # The step onto the first displaced frame, and where later frames stayed, that off the last.
            steps = [d.first - 1] + ([d.last] if d.last < len(poses) - 1 else [])
            rotation[steps] = np.hypot(rotation[steps], d.sigmas[0])
            translation[steps] = np.hypot(translation[steps], d.sigmas[1])
        for step, sigmas in (replaced or {}).items():
            rotation[step], translation[step] = sigmas
        return replace(odometry, sigma_rotation=rotation, sigma_translation=translation)


@dataclass(frozen=True)
class _Clocked:
    """What the time between images and poses is sought by."""

    times: FrameTimes
    is_at_origin: Bool[np.ndarray, " n"]
    motions: MeasuredMotions
    told: MeasuredMotions
    """Of these, those over steps that say something."""
    odometry: OdometryOptions
    keyframe_idx: Int[np.ndarray, " k"] | None
    options: TrackingOptions

    def find(self, recorded: Poses) -> ClockOffset | None:
        """The offset, where one is sought and significant."""
        if not self.options.clock_is_sought:
            return None
        is_whole = self._is_tracked(recorded)
        return find_clock(
            recorded,
            self.times,
            self.told,
            is_whole,
            self.odometry,
            self.options,
            self.keyframe_idx,
        )

    def read(
        self, recorded: Poses, clock: ClockOffset | None
    ) -> tuple[Poses, Float[np.ndarray, "n 2"] | None]:
        """Poses at the images' times, and their sigmas (rad, m); without an offset, as recorded."""
        if clock is None or not clock.is_read:
            return recorded, None
        is_whole = self._is_tracked(recorded)
        if self.options.mend:
            tracker = _Tracker(self.odometry, keyframe_idx=self.keyframe_idx)
            tracker = replace(
                tracker, factors=noise_factors(recorded, tracker.steps(recorded), self.told)
            )
            for d in _mended(Filled(recorded), self.motions, tracker)[1]:
                is_whole[[d.first - 1, min(d.last, len(is_whole) - 1)]] = False
        times = self.times.intervals
        offsets = clock.offsets(times)
        return (
            interpolate_trajectory(recorded, times, offsets, is_whole),
            interpolation_sigmas(recorded, times, offsets, is_whole),
        )

    def _is_tracked(self, recorded: Poses) -> Bool[np.ndarray, " s"]:
        """Steps that tracking was not lost over, and no frames are missing in."""
        lost = _lost_runs(recorded, self.is_at_origin, self.motions, self.options)
        return ~void_steps(len(recorded), lost) & (np.diff(self.times.intervals) <= LONG_INTERVAL)


def believe(
    world_from_cams: Poses,
    convention: str,
    odometry: OdometryOptions,
    timestamps: Float[np.ndarray, " n"] | None = None,
    keyframe_idx: Int[np.ndarray, " k"] | None = None,
) -> Tracking:
    """The recorded poses as they are, in a named convention; nothing is measured.

    Frames that have one of the `timestamps` (s) are fixed to each other. Steps between keyframes are as sure
    as `odometry` says; without these, all steps.

    Raises:
        OptionError: there is no convention of this name.
    """
    known = RECORDED if convention == AUTO else convention  # nothing here tells another one
    poses = apply_convention(world_from_cams, known)
    steps = make_odometry(poses, odometry, timestamps, keyframe_idx)
    return Tracking(poses, poses, steps, known)


def judge_tracking(
    world_from_cams: Poses,
    motions: MeasuredMotions,
    convention: str,
    odometry: OdometryOptions,
    options: TrackingOptions,
    up_world: Float[np.ndarray, "3"] | None = None,
    timestamps: Float[np.ndarray, " n"] | None = None,
    keyframe_idx: Int[np.ndarray, " k"] | None = None,
) -> Tracking:
    """Compare the recorded poses with measured motions, in the convention that explains these.

    Whether that may be another than was asked for is a matter of `require_asked_convention`.

    Args:
        motions: between neighbouring frames, measured from images and depth.
        convention: that of the poses: `recorded`, `auto`, or a name.
        up_world: unit vector against gravity, where the scan's format says which axis is up.
        timestamps: of the frames, s, or frame numbers; without, frames are numbered.
        keyframe_idx: frames whose images were looked at; without, all.

    Raises:
        OptionError: there is no convention of this name.
    """
    times = frame_times(
        np.arange(float(len(world_from_cams))) if timestamps is None else timestamps
    )
    motions = without_leaps(motions, world_from_cams)
    held = between_held(world_from_cams, times.intervals, motions) if options.mend else None
    n_held = 0 if held is None else int(stands_still(world_from_cams).sum())
    world_from_cams, held_sigmas = held or (world_from_cams, None)
    is_at_origin = is_identity(world_from_cams)
    told = over_told_steps(motions, ~stands_still(world_from_cams))
    clocked = _Clocked(times, is_at_origin, motions, told, odometry, keyframe_idx, options)
    chosen, fit, clock = _convention(world_from_cams, convention, clocked)
    chosen, recorded = _in_axes_of_format(world_from_cams, chosen, up_world)
    lost = _lost_runs(recorded, is_at_origin, motions, options)
    read, read_sigmas = clocked.read(recorded, clock)
    if held_sigmas is not None:
        read_sigmas = np.hypot(held_sigmas, 0.0 if read_sigmas is None else read_sigmas)
    tracker = _Tracker(odometry, read_sigmas, (1.0, 1.0), timestamps, keyframe_idx, up_world)
    tracker = _adapted(tracker, read, lost, motions)
    filled = _filled(read, lost, motions, tracker)
    poses, found, steps, doubtful = _corrected(filled, motions, tracker, options)
    displaced = [_described(read, poses, d) for d in found]
    return Tracking(
        recorded_world_from_cams=recorded,
        world_from_cams=poses,
        odometry=steps,
        convention=chosen,
        convention_fit=fit,
        clock=clock,
        sigma_factors=tracker.factors,
        breaks=tuple(sorted((*filled.breaks, *displaced), key=lambda b: b.first_frame)),
        n_motions=len(motions),
        doubtful_steps=doubtful,
        open_steps=filled.open_steps,
        linked=filled.linked,
        n_repeated=count_repeated(recorded, motions),
        n_held=n_held,
    )


def require_asked_convention(name: str, tracking: Tracking, asked: str) -> None:
    """Refuse a scan whose poses follow another convention than the one asked for.

    Args:
        tracking: of its poses, all evidence weighed.
        asked: `recorded`, `auto` (which allows any), or a name.

    Raises:
        ScanError: another convention explains the measured motions, or another axis is up than the format
            says, and `auto` was not asked for.
    """
    if asked == AUTO:
        return
    fit = tracking.convention_fit
    # A unit of the poses' own has no name to give: what it is in metres is measured, used and said.
    if fit is not None and fit.is_clear and not fit.is_own_unit:
        said = "as recorded" if asked == RECORDED else f"taken as {asked}"
        again = "auto" if fit.name == RECORDED else f"{fit.name}, or auto"
        raise ScanError(
            f"{name}: these poses look like {fit.name} (explains {fit.share:.0%} of {fit.n_motions} "
            f"measured motions, {said} {fit.asked_share:.0%}): run again with --poses-convention {again}"
        )
    found, known = (names.split(", ") for names in (tracking.convention, asked))
    axes = next((name for name in WORLD_AXES if name in found and name not in known), "")
    if axes:
        raise ScanError(
            f"{name}: these poses look like {axes}: the walk is level and the images are upright with "
            "another axis up than the scan's format has; run again with --poses-convention "
            f"{axes}, or auto"
        )


def _corrected(
    filled: Filled, motions: MeasuredMotions, tracker: _Tracker, options: TrackingOptions
) -> tuple[Poses, list[Displacement], Odometry, Int[np.ndarray, " k"]]:
    """Poses with broken steps mended, what was mended, their steps, and steps that nothing tells surely."""
    poses, found = filled.poses, []
    if options.mend:
        poses, found = _mended(filled, motions, tracker)
    steps = tracker.steps(poses, found, filled.sigmas)
    doubtful = filled.open_steps
    if options.mend:
        doubtful = np.union1d(doubtful, find_doubtful(poses, steps, motions))
    if max(tracker.factors) >= NOTED_FACTOR:
        poses = fuse(poses, steps, motions)
        steps = with_steps_of(steps, poses)
    return poses, found, steps, doubtful


def _in_axes_of_format(
    world_from_cams: Poses, chosen: str, up_world: Float[np.ndarray, "3"] | None
) -> tuple[str, Poses]:
    """Name of the convention, and poses whose up axis is that of the format."""
    poses = apply_convention(world_from_cams, chosen)
    axes = "" if up_world is None else turned_axes(poses, up_world)
    if not axes:
        return chosen, poses
    return (axes if chosen == RECORDED else f"{chosen}, {axes}"), apply_convention(poses, axes)


def _lost_runs(
    recorded: Poses,
    is_at_origin: Bool[np.ndarray, " n"],
    motions: MeasuredMotions,
    options: TrackingOptions,
) -> tuple[LostRun, ...]:
    """Lost frames, where they are to be mended."""
    return find_lost_runs(recorded, is_at_origin, motions) if options.mend else ()


def _adapted(
    tracker: _Tracker, read: Poses, lost: Sequence[LostRun], motions: MeasuredMotions
) -> _Tracker:
    """With the factors on its sigmas that its steps ask for."""
    told = over_told_steps(motions, ~void_steps(len(read), lost))
    return replace(tracker, factors=noise_factors(read, tracker.steps(read), told))


def _filled(
    read: Poses,
    lost: Sequence[LostRun],
    motions: MeasuredMotions,
    tracker: _Tracker,
) -> Filled:
    """Lost frames placed, by steps with the sigmas of this tracker."""
    if not lost:
        return Filled(read)
    usual = usual_of_known(read, ~void_steps(len(read), lost))
    return fill_lost(read, lost, motions, tracker.steps(read), usual)


def _convention(
    poses: Poses, asked: str, clocked: _Clocked
) -> tuple[str, ConventionFit, ClockOffset | None]:
    """The convention to apply, how well it fits, and the time between images and poses in it."""
    told, odometry, keys = clocked.told, clocked.odometry, clocked.keyframe_idx
    fit = best_convention(poses, told, odometry, RECORDED if asked == AUTO else asked, keys)
    is_delay = fit.is_clear and fit.name in FRAME_DELAYS
    base = fit.name if fit.is_clear and not is_delay else fit.asked
    in_base = apply_convention(poses, base)
    clock = clocked.find(in_base)
    if is_delay and clock is None and tells_clock(in_base, told, clocked.options):
        fit = replace(fit, name=base, share=fit.asked_share)
        is_delay = False
    if is_delay and not _is_of_clocks(clock, FRAME_DELAYS[fit.name], clocked.options):
        base, clock = fit.name, None
    if clock is not None and clock.is_read:
        read = best_convention(clocked.read(in_base, clock)[0], told, odometry, RECORDED, keys)
        if read.is_clear:  # what looked like an offset is another convention
            base, clock = (fit.name if fit.is_clear else fit.asked), None
        elif base == fit.asked:
            fit = replace(fit, name=base, share=read.asked_share, asked_share=read.asked_share)
        else:
            fit = replace(fit, share=read.asked_share)
    return base, fit, clock


def _is_of_clocks(clock: ClockOffset | None, frames: int, options: TrackingOptions) -> bool:
    """Whether images and poses have clocks that differ; else each image has the pose of another frame.

    A difference of 33 ms is a whole frame at 30 Hz, and as usual as one of 30 ms; at 1 Hz, where clocks
    differ by less, a whole frame is a file that begins a line late.
    """
    if clock is None or not clock.is_read:
        return False
    if clock.offset_s is not None and abs(clock.offset_s) <= options.clock_max_s:
        return True
    return not clock.is_whole(frames)


def _mended(
    filled: Filled, motions: MeasuredMotions, tracker: _Tracker
) -> tuple[Poses, list[Displacement]]:
    """Poses with displaced frames put where measured motions say, the surest first."""
    poses, found = filled.poses, []
    most = max(3, int(MAX_BREAKS_SHARE * len(poses)))
    while len(found) <= most:
        steps = tracker.steps(poses, found, filled.sigmas)
        displacement = find_displacement(poses, steps, motions, tracker.up_world)
        if displacement is None:
            return poses, found
        poses = poses.copy()
        of = slice(displacement.first, displacement.last + 1)
        poses[of] = displacement.world_from_recorded @ poses[of]
        found.append(displacement)
    return filled.poses, []


def _described(recorded: Poses, corrected: Poses, d: Displacement) -> TrackingBreak:
    """A displacement, for the user."""
    if d.last == len(recorded) - 1:
        return describe_jump(recorded, corrected, d.first - 1, d.n_motions, "images")
    moved = size_of(se3.inverse(recorded[d.first]) @ corrected[d.first])
    facts = {"displacement_m": moved[0], "displacement_deg": moved[1]}
    finding = Finding(PoseKind.FRAMES_DISPLACED, facts, ((d.first, d.last),))
    return TrackingBreak("outlier", d.first, d.last, moved, moved, d.n_motions, finding)

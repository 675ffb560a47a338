"""Judge the recorded poses: convention, noise, breaks; and correct what can be corrected."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.odometry import Odometry, OdometryOptions, make_odometry
from planfit.tracking.breaks import Displacement, find_displacement
from planfit.tracking.conventions import (
    AUTO,
    RECORDED,
    ConventionFit,
    apply_convention,
    best_convention,
    turned_axes,
)
from planfit.tracking.fuse import fuse, with_steps_of
from planfit.tracking.lost import Filled, fill_lost, void_steps
from planfit.tracking.lost_runs import (
    LostRun,
    count_repeated,
    find_lost_runs,
    is_identity,
    stands_still,
    usual_step,
)
from planfit.tracking.motions import MeasuredMotions
from planfit.tracking.noise import noise_factors
from planfit.tracking.options import TrackingOptions
from planfit.tracking.submaps import find_doubtful
from planfit.tracking.types import Tracking, TrackingBreak, describe_jump, size_of

MAX_BREAKS_SHARE = 0.1
"""A tracker with more breaks a frame than this is not mended: what is broken then is no step."""

MIN_TOLD = 0.5
"""Share of the motions that must lead over steps which say something, to be judged without the others."""

Poses = Float[np.ndarray, "n 4 4"]


def believe(world_from_cams: Poses, convention: str, odometry: OdometryOptions) -> Tracking:
    """The recorded poses as they are, in a named convention; nothing is measured.

    Raises:
        OptionError: there is no convention of this name.
    """
    known = RECORDED if convention == AUTO else convention  # nothing here tells another one
    poses = apply_convention(world_from_cams, known)
    return Tracking(poses, poses, make_odometry(poses, odometry), known)


def judge_tracking(
    name: str,
    world_from_cams: Poses,
    motions: MeasuredMotions,
    convention: str,
    odometry: OdometryOptions,
    options: TrackingOptions,
    up_world: Float[np.ndarray, "3"] | None = None,
) -> Tracking:
    """Compare the recorded poses with measured motions.

    Args:
        name: of the scan, for messages.
        world_from_cams: as recorded.
        motions: between neighbouring frames, measured from images and depth.
        convention: that of the poses: `recorded`, `auto`, or a name.
        odometry: what is usual of trackers.
        options: see there.
        up_world: unit vector against gravity, where the scan's format says which axis is up.

    Raises:
        ScanError: another convention explains the measured motions, or another axis is up than the format
            says, and `auto` was not asked for.
        OptionError: there is no convention of this name.
    """
    told = _over_told_steps(motions, ~stands_still(world_from_cams))
    chosen, fit = _convention(name, world_from_cams, told, convention, odometry)
    chosen, recorded = _in_axes_of_format(name, world_from_cams, chosen, convention, up_world)
    lost: tuple[LostRun, ...] = ()
    if options.mend:
        lost = find_lost_runs(recorded, is_identity(world_from_cams), motions, options)
    factors = (1.0, 1.0)
    if options.adapt_sigmas:
        told = _over_told_steps(motions, ~void_steps(len(recorded), lost))
        factors = noise_factors(recorded, make_odometry(recorded, odometry), told)
    filled = _filled(recorded, lost, motions, odometry, factors, options)
    poses, found = filled.poses, []
    if options.mend:
        poses, found = _mended(filled, motions, odometry, factors, options)
    steps = _odometry(poses, odometry, factors, found, filled.sigmas)
    doubtful = filled.open_steps
    if options.mend:
        doubtful = np.union1d(doubtful, find_doubtful(poses, steps, motions, options))
    if max(factors) >= options.fuse_above:
        poses = fuse(poses, steps, motions)
        steps = with_steps_of(steps, poses)
    displaced = [_described(recorded, poses, d) for d in found]
    return Tracking(
        recorded_world_from_cams=recorded,
        world_from_cams=poses,
        odometry=steps,
        convention=chosen,
        convention_fit=fit,
        sigma_factors=factors,
        breaks=tuple(sorted((*filled.breaks, *displaced), key=lambda b: b.first_frame)),
        n_motions=len(motions),
        doubtful_steps=doubtful,
        open_steps=filled.open_steps,
        linked=filled.linked,
        n_repeated=count_repeated(recorded, motions, options),
    )


def _in_axes_of_format(
    name: str,
    world_from_cams: Poses,
    chosen: str,
    asked: str,
    up_world: Float[np.ndarray, "3"] | None,
) -> tuple[str, Poses]:
    """Name of the convention, and poses whose up axis is that of the format."""
    poses = apply_convention(world_from_cams, chosen)
    axes = "" if up_world is None else turned_axes(poses, up_world)
    if not axes:
        return chosen, poses
    if asked != AUTO:
        raise ScanError(
            f"{name}: these poses look like {axes}: the walk is level and the images are upright with "
            "another axis up than the scan's format has; run again with --poses-convention "
            f"{axes}, or auto"
        )
    return (axes if chosen == RECORDED else f"{chosen}, {axes}"), apply_convention(poses, axes)


def _over_told_steps(motions: MeasuredMotions, is_told: Bool[np.ndarray, " s"]) -> MeasuredMotions:
    """Motions that lead over recorded steps which say something; all, where these are less than half."""
    n_void = np.concatenate([[0], np.cumsum(~is_told)])
    over = n_void[motions.pairs[:, 1]] == n_void[motions.pairs[:, 0]]
    return motions[np.flatnonzero(over)] if over.sum() >= MIN_TOLD * len(over) else motions


def _filled(
    recorded: Poses,
    lost: Sequence[LostRun],
    motions: MeasuredMotions,
    odometry: OdometryOptions,
    factors: tuple[float, float],
    options: TrackingOptions,
) -> Filled:
    """Lost frames placed, by steps with the sigmas of this tracker."""
    if not lost:
        return Filled(recorded)
    steps = _odometry(recorded, odometry, factors, [], {})
    usual = usual_step(recorded, ~void_steps(len(recorded), lost))
    return fill_lost(recorded, lost, motions, steps, usual, options)


def _convention(
    name: str, poses: Poses, motions: MeasuredMotions, asked: str, odometry: OdometryOptions
) -> tuple[str, ConventionFit]:
    """The convention to apply, and how well it fits."""
    fit = best_convention(poses, motions, odometry, RECORDED if asked == AUTO else asked)
    if asked == AUTO or not fit.is_clear:
        return (fit.name if fit.is_clear else fit.asked), fit
    said = "as recorded" if asked == RECORDED else f"taken as {asked}"
    again = "auto" if fit.name == RECORDED else f"{fit.name}, or auto"
    raise ScanError(
        f"{name}: these poses look like {fit.name} (explains {fit.share:.0%} of {fit.n_motions} measured "
        f"motions, {said} {fit.asked_share:.0%}): run again with --poses-convention {again}"
    )


def _mended(
    filled: Filled,
    motions: MeasuredMotions,
    options: OdometryOptions,
    factors: tuple[float, float],
    tracking: TrackingOptions,
) -> tuple[Poses, list[Displacement]]:
    """Poses with displaced frames put where measured motions say, the surest first."""
    poses, found = filled.poses, []
    most = max(3, int(MAX_BREAKS_SHARE * len(poses)))
    while len(found) <= most:
        odometry = _odometry(poses, options, factors, found, filled.sigmas)
        displacement = find_displacement(poses, odometry, motions, tracking)
        if displacement is None:
            return poses, found
        poses = poses.copy()
        of = slice(displacement.first, displacement.last + 1)
        poses[of] = displacement.world_from_recorded @ poses[of]
        found.append(displacement)
    return filled.poses, []


def _odometry(
    poses: Poses,
    options: OdometryOptions,
    factors: tuple[float, float],
    displaced: list[Displacement],
    replaced: dict[int, tuple[float, float]],
) -> Odometry:
    """Steps of corrected poses; those that were broken are as sure as what took their place."""
    odometry = make_odometry(poses, options)
    rotation = odometry.sigma_rotation * factors[0]
    translation = odometry.sigma_translation * factors[1]
    for d in displaced:
        # The step onto the first displaced frame, and where later frames stayed, that off the last.
        steps = [d.first - 1] + ([d.last] if d.last < len(poses) - 1 else [])
        rotation[steps] = np.hypot(rotation[steps], d.sigma_rotation)
        translation[steps] = np.hypot(translation[steps], d.sigma_translation)
    for step, sigmas in replaced.items():
        rotation[step], translation[step] = sigmas
    return replace(odometry, sigma_rotation=rotation, sigma_translation=translation)


def _described(recorded: Poses, corrected: Poses, d: Displacement) -> TrackingBreak:
    """A displacement in words."""
    if d.last == len(recorded) - 1:
        return describe_jump(recorded, corrected, d.first - 1, d.n_motions, "images")
    moved = size_of(se3.inverse(recorded[d.first]) @ corrected[d.first])
    which = f"frame {d.first} is" if d.first == d.last else f"frames {d.first}-{d.last} are"
    reason = (
        f"{which} recorded {moved[0]:.1f} m and {moved[1]:.0f} degrees away from where the images show "
        "them: corrected"
    )
    return TrackingBreak("outlier", d.first, d.last, moved, moved, d.n_motions, reason)

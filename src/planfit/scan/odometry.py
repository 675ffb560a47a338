"""Recorded motion between frames, and how far it may be off: the sigmas that all stages share."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import require_positive
from planfit.geometry import se3
from planfit.runtime import short_repr

FIXED_RAD, FIXED_M = 1e-5, 1e-4
"""Sigmas between cameras that are fixed to each other: as good as nothing, and no division by it."""
USUAL_SHARE = 0.9
"""Share of the steps that are as long as usual, or shorter."""
LONG = 1.5
"""Steps longer than so many usual ones are long. ConSLAM has eleven unmeasured ones that are no jumps."""
MOST_UNUSUAL = 4.0
"""Steps that are longer than long ones by more than this factor tell no more of a jump. Its square is what
the length of a step counts at most, beside squared sigmas of motions."""


@dataclass(frozen=True)
class OdometryOptions:
    """Sigma of the tracker's motion between two frames that follow each other.

    The defaults hold for phone and LiDAR-inertial trackers, which drift by one to three per cent.
    """

    sigma_base_m: float = 0.01
    """Sigma of a step's translation, each axis, however short the step."""
    sigma_per_m: float = 0.02
    """Growth of that sigma with the length of the step."""
    sigma_base_deg: float = 0.10
    """Sigma of a step's rotation, each axis, however small the rotation."""
    sigma_per_deg: float = 0.01
    """Growth of that sigma with the angle of the rotation."""

    def __post_init__(self) -> None:
        require_positive(self, "sigma_base_m", "sigma_base_deg")


@dataclass(frozen=True)
class Odometry:
    """Recorded steps between the n frames, and how sure they are."""

    cam_from_next: Float[np.ndarray, "s 4 4"]
    """s = n - 1 steps: frame i from frame i + 1."""
    sigma_rotation: Float[np.ndarray, " s"]
    """rad, each axis."""
    sigma_translation: Float[np.ndarray, " s"]
    """m, each axis."""

    __repr__ = short_repr

    def sigma_between(
        self, first: Int[np.ndarray, "*#k"], last: Int[np.ndarray, "*#k"]
    ) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "..."]]:
        """Sigmas of rotation (rad) and translation (m), each axis, from frames `first` to frames `last`.

        The two are broadcast against each other.

        Steps err independently, so variances add up; a rotation early on swings all that follows, which
        the distance walked times the sigma of the rotation bounds.
        """
        rotation_sq, translation_sq = self._variances
        walked = self.walked_m
        low, high = np.minimum(first, last), np.maximum(first, last)
        rotation = np.sqrt(rotation_sq[high] - rotation_sq[low])
        swing = rotation * (walked[high] - walked[low])
        # Rotation errors arise all along the path, so their lever is shorter than all of it: the mean
        # square of a lever that is uniform over the path is a third of the path's square.
        translation = np.sqrt(translation_sq[high] - translation_sq[low] + swing**2 / 3)
        return np.asarray(rotation), np.asarray(translation)  # one frame's are no arrays yet

    def between(
        self, frame_idx: Int[np.ndarray, " k"], target_from_frames: Float[np.ndarray, "k 4 4"]
    ) -> "Odometry":
        """Steps between some of the frames, given the recorded poses of these in any axes."""
        if len(frame_idx) == len(self.cam_from_next) + 1:
            return self
        rotation, translation = self.sigma_between(frame_idx[:-1], frame_idx[1:])
        steps = se3.inverse(target_from_frames[:-1]) @ target_from_frames[1:]
        return Odometry(steps, rotation, translation)

    @cached_property
    def _variances(self) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Of rotation and translation, summed from the first frame on: what lies between two frames is a
        difference of two of them."""
        rotation_sq = np.concatenate([[0.0], np.cumsum(self.sigma_rotation**2)])
        return rotation_sq, np.concatenate([[0.0], np.cumsum(self.sigma_translation**2)])

    @cached_property
    def walked_m(self) -> Float[np.ndarray, " n"]:
        """Path length from the first frame to each, m."""
        return np.concatenate([[0.0], np.cumsum(step_sizes(self.cam_from_next)[0])])


def step_sizes(
    cam_from_next: Float[np.ndarray, "s 4 4"],
) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, " s"]]:
    """Lengths (m) and angles (rad) of steps."""
    return (
        np.linalg.norm(cam_from_next[:, :3, 3], axis=1),
        np.asarray(se3.rotation_angle(cam_from_next[:, :3, :3])),
    )


def usual_step(
    cam_from_next: Float[np.ndarray, "s 4 4"], least: float = 1e-9
) -> tuple[float, float]:
    """Length (m) and angle (rad) that usual steps do not exceed, each at least `least`."""
    if len(cam_from_next) == 0:
        return least, least
    length, angle = (float(np.quantile(s, USUAL_SHARE)) for s in step_sizes(cam_from_next))
    return max(length, least), max(angle, least)


def times_usual(
    cam_from_next: Float[np.ndarray, "s 4 4"], usual: tuple[float, float]
) -> Float[np.ndarray, " s"]:
    """How many times as large as a usual step each is, in length or angle, whichever is more."""
    length, angle = step_sizes(cam_from_next)
    return np.maximum(length / usual[0], angle / usual[1])


def unusualness(
    cam_from_next: Float[np.ndarray, "s 4 4"], usual: tuple[float, float]
) -> Float[np.ndarray, " s"]:
    """How little each step is like those of a walk, as squared sigmas: the cost by which jumps are placed.

    Where several steps may hold a jump, it was at the one that is long, and not at the one that would be if
    the jump were undone there: the walk with the least sum is the likeliest.
    """
    return np.minimum(times_usual(cam_from_next, usual) / LONG, MOST_UNUSUAL) ** 2


def make_odometry(
    world_from_cams: Float[np.ndarray, "n 4 4"],
    options: OdometryOptions,
    times: Float[np.ndarray, " n"] | None = None,
    keyframe_idx: Int[np.ndarray, " k"] | None = None,
) -> Odometry:
    """Steps of a recorded trajectory.

    Sigmas of `options` are those of steps between keyframes, if these are given (increasing, the first and
    the last frame among them), so that a tracker is not believed less for recording more poses of the same
    walk: the steps between two keyframes share their variance.

    Frames that follow each other at one of the `times` (s) and at one place are of cameras fixed to each
    other, such as the views of a laser scanner: the steps between them are exact, and the step to the next
    instant is as sure as the motion of the first camera, whichever two the step joins. Two images of a coarse
    clock's second are at two places.
    """
    steps = se3.inverse(world_from_cams[:-1]) @ world_from_cams[1:]
    if keyframe_idx is not None and len(keyframe_idx) < len(world_from_cams):
        times = None if times is None else times[keyframe_idx]
        of_keys = make_odometry(world_from_cams[keyframe_idx], options, times)
        n_steps = np.diff(keyframe_idx)
        rotation, translation = (
            np.repeat(sigma / np.sqrt(n_steps), n_steps)
            for sigma in (of_keys.sigma_rotation, of_keys.sigma_translation)
        )
        return Odometry(steps, rotation, translation)
    length, angle = step_sizes(steps)
    is_fixed = np.zeros(len(steps), dtype=bool)
    if times is not None:
        is_fixed = (times[1:] == times[:-1]) & (length < FIXED_M)
        # The first frame of the instant that each frame is of.
        starts = np.concatenate([[True], ~is_fixed])
        first = np.maximum.accumulate(np.where(starts, np.arange(len(starts)), 0))
        rotations = world_from_cams[first, :3, :3]
        angle = se3.rotation_angle(np.swapaxes(rotations[:-1], -1, -2) @ rotations[1:])
    sigma_rotation = np.deg2rad(options.sigma_base_deg) + options.sigma_per_deg * angle
    sigma_translation = options.sigma_base_m + options.sigma_per_m * length
    return Odometry(
        cam_from_next=steps,
        sigma_rotation=np.where(is_fixed, FIXED_RAD, sigma_rotation),
        sigma_translation=np.where(is_fixed, FIXED_M, sigma_translation),
    )

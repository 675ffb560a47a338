"""The camera's path: someone walks the route with the camera in hand and looks around."""

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import gaussian_filter1d

from planfit.geometry import se3
from planfit.synth.building import Building
from planfit.synth.options import WalkOptions
from planfit.synth.plan_building import PlanBuilding
from planfit.synth.route import MARGIN_M, find_route

Space = Building | PlanBuilding
"""What a walk goes through."""

_STEP_M = 0.02
"""Spacing of the dense path that frames are picked from."""
_SMOOTH_M = 0.25
"""How far corners are rounded."""
_GIVE_M = 0.01
"""Where the way itself is nearer to walls than the clearance, rounding may come so much nearer."""
_FOLLOW_M = 0.45
"""Way over which the view follows a turn of the path."""
_ROTATION_PER_M = np.deg2rad(45.0)
"""A rotation this large counts as much motion between frames as a step of one metre."""


def walk_through(
    building: Building, options: WalkOptions, rng: np.random.Generator
) -> Float[np.ndarray, "n 4 4"]:
    """Poses plan_from_cam of a walk through all rooms, OpenCV camera axes.

    Raises:
        OptionError: some room cannot be entered with this clearance.
    """
    route = find_route(building, options, rng)
    return walk_along(route, building, options, rng, wraps=options.is_loop)


def walk_along(
    route: Float[np.ndarray, "k 2"],
    space: Space,
    options: WalkOptions,
    rng: np.random.Generator,
    wraps: bool,
    turns_inwards: bool = True,
) -> Float[np.ndarray, "n 4 4"]:
    """Poses plan_from_cam of a walk along a way (building frame, m), OpenCV camera axes; where it `wraps`, it
    ends with the view it began with. Corners are rounded only as far as walls allow."""
    walked = walk_ahead(route, space, options, rng)
    inwards = inwards_of(walked, space) if turns_inwards else np.zeros_like(walked)
    yaw = heading(walked, inwards, wraps)
    building_from_cams = look_ahead(walked, np.zeros(len(walked)), yaw, options, rng)
    picked = evenly_moving(building_from_cams, options.n_frames)
    return space.plan_from_building @ building_from_cams[picked]


def look_ahead(
    walked: Float[np.ndarray, "n 2"],
    floor_z: Float[np.ndarray, " n"],
    yaw: Float[np.ndarray, " n"],
    options: WalkOptions,
    rng: np.random.Generator,
) -> Float[np.ndarray, "n 4 4"]:
    """Poses building_from_cam of a hand that sways and looks around while someone walks: points `_STEP_M`
    apart (building frame), heights of the floor below (m), and yaw of the way ahead (rad)."""
    n = len(walked)
    ease = _easing(n)
    yaw = yaw + np.deg2rad(options.look_around_deg) * _swing(n, 2.0, rng) * ease
    pitch = np.deg2rad(options.pitch_deg) + np.deg2rad(options.pitch_swing_deg) * ease * _swing(
        n, 1.1, rng
    )
    roll = np.deg2rad(options.roll_swing_deg) * ease * _swing(n, 0.8, rng)
    height = floor_z + options.height_m + options.sway_m * ease * _swing(n, 0.5, rng)
    return se3.make_transform(_camera_axes(yaw, pitch, roll), np.column_stack([walked, height]))


def _easing(n: int) -> Float[np.ndarray, " n"]:
    """0 at both ends, so that a loop ends with the view it began with, and 1 between."""
    at = np.minimum(np.arange(n), np.arange(n)[::-1]) * _STEP_M
    return np.clip(at / min(1.0, 0.25 * n * _STEP_M), 0.0, 1.0)


def resample(points: Float[np.ndarray, "k c"]) -> Float[np.ndarray, "n c"]:
    """Points `_STEP_M` apart on straight lines between those given."""
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    wanted = np.linspace(0.0, at[-1], max(2, round(at[-1] / _STEP_M) + 1))
    return np.column_stack([np.interp(wanted, at, points[:, c]) for c in range(points.shape[1])])


def _smoothed(values: Float[np.ndarray, "n ..."], sigma_m: float) -> Float[np.ndarray, "n ..."]:
    return gaussian_filter1d(values, sigma_m / _STEP_M, axis=0, mode="nearest")


def _swing(n: int, wavelength_m: float, rng: np.random.Generator) -> Float[np.ndarray, " n"]:
    """Slow random swings along the path, of unit standard deviation."""
    raw = _smoothed(rng.normal(size=n), wavelength_m / 2.0)
    # The standard deviation of white noise after a Gaussian of sigma samples is 1 / sqrt(2 sqrt(pi) sigma).
    sigma = wavelength_m / 2.0 / _STEP_M
    return np.clip(raw * np.sqrt(2.0 * np.sqrt(np.pi) * sigma), -2.0, 2.0)


def walk_ahead(
    route: Float[np.ndarray, "k 2"],
    space: Space,
    options: WalkOptions,
    rng: np.random.Generator,
) -> Float[np.ndarray, "n 2"]:
    """Points `_STEP_M` apart of the way as it is walked: with rounded corners, and swaying, as far as the
    clearance allows."""
    planned = resample(route)
    n = len(planned)
    smooth = _smoothed(planned, _SMOOTH_M)
    sway = np.column_stack([_swing(n, 0.6, rng), _swing(n, 0.6, rng)])
    wanted = smooth + options.sway_m * _easing(n)[:, None] * sway
    # The ends stay where they are: smoothing would pull them in, and a loop would not close.
    share = np.clip(np.minimum(np.arange(n), np.arange(n)[::-1]) * _STEP_M / 0.5, 0.0, 1.0)
    # The planned path keeps MARGIN_M more than the clearance, but for narrow doors of plans and paths that
    # were given: a share of 0 always passes.
    least = np.minimum(space.clearance(planned) - _GIVE_M, options.clearance_m + 0.1 * MARGIN_M)
    walked = planned + share[:, None] * (wanted - planned)
    clearance = space.clearance(walked)
    for _ in range(60):
        is_near = clearance < least
        if not is_near.any():
            return walked
        cut = np.where(is_near, 0.6, 0.0)
        around = gaussian_filter1d(cut, 0.1 / _STEP_M, mode="nearest")
        share = share * (1.0 - np.maximum(cut, around))
        moved = np.flatnonzero(around > 0)
        walked[moved] = planned[moved] + share[moved, None] * (wanted - planned)[moved]
        clearance[moved] = space.clearance(walked[moved])
    return planned


def inwards_of(walked: Float[np.ndarray, "n 2"], space: Space) -> Float[np.ndarray, "n 2"]:
    """Near walls the view turns towards the middle of the room: nobody scans a wall from up close."""
    nearness = np.clip(1.3 - space.clearance(walked), 0.0, 1.0)[:, None]
    return 1.2 * nearness * _smoothed(space.inwards(walked), 0.2)


def heading(
    walked: Float[np.ndarray, "n 2"], inwards: Float[np.ndarray, "n 2"], wraps: bool
) -> Float[np.ndarray, " n"]:
    """Yaw, rad, of the way ahead, turned `inwards`; the end of a loop turns to the yaw of its beginning."""
    step = np.gradient(_smoothed(walked, 0.1), axis=0)
    step /= np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9)
    view = step + inwards
    yaw = _smoothed(np.unwrap(np.arctan2(view[:, 1], view[:, 0])), _FOLLOW_M)
    if wraps:
        gap = (yaw[0] - yaw[-1] + np.pi) % (2 * np.pi) - np.pi
        left = np.arange(len(yaw))[::-1] * _STEP_M / 2.0
        yaw = yaw + gap * (0.5 + 0.5 * np.cos(np.pi * np.clip(left, 0.0, 1.0)))
    return yaw


def _camera_axes(
    yaw: Float[np.ndarray, " n"], pitch: Float[np.ndarray, " n"], roll: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n 3 3"]:
    """Rotations, columns right, down, forward."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    forward = np.column_stack([cy * cp, sy * cp, sp])
    level_right = np.column_stack([sy, -cy, np.zeros_like(sy)])
    level_down = np.cross(forward, level_right)
    cr, sr = np.cos(roll)[:, None], np.sin(roll)[:, None]
    right, down = cr * level_right + sr * level_down, cr * level_down - sr * level_right
    return np.stack([right, down, forward], axis=-1)


def evenly_moving(poses: Float[np.ndarray, "n 4 4"], n_frames: int) -> Int[np.ndarray, " k"]:
    """Indices into dense poses such that each step holds the same motion."""
    relative = np.swapaxes(poses[:-1, :3, :3], 1, 2) @ poses[1:, :3, :3]
    rotation = se3.rotation_angle(relative) / _ROTATION_PER_M
    translation = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    motion = np.concatenate([[0.0], np.cumsum(np.hypot(rotation, translation))])
    wanted = np.linspace(0.0, motion[-1], n_frames)
    return np.clip(np.searchsorted(motion, wanted), 0, len(poses) - 1)

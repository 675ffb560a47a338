"""Faults of recorded poses: jumps, lost tracking, drift, delay, wrong conventions, wrong order."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation, Slerp

from faults.inputs import DRIFT, Fault, Inputs
from planfit.geometry import se3
from planfit.scan.poses import OPENGL_FROM_OPENCV
from planfit.scan.views import select_frames
from planfit.synth import drift_poses

JUMPS = ((1.0, 5.0), (3.0, 20.0), (8.0, 90.0))
"""m and deg."""
DRIFT_FACTORS = (3.0, 6.0, 10.0)
LOST_FRAMES = (5, 15, 40)

Poses = Float[np.ndarray, "n 4 4"]


def jump(inputs: Inputs, n_jumps: int, size: int, rng: np.random.Generator) -> Inputs:
    """At some frames, all poses from there on are moved across the floor and rotated about the vertical."""
    distance_m, angle_deg = JUMPS[size]
    poses = inputs.scan.world_from_cams.copy()
    for frame in spread_frames(len(poses), n_jumps, rng):
        angle = np.deg2rad(angle_deg) * rng.choice([-1, 1])
        moved = _about_vertical(poses[frame, :3, 3], angle, inputs.up_world)
        moved[:3, 3] += distance_m * _level_direction(inputs.up_world, rng)
        poses[frame:] = moved @ poses[frame:]
    return inputs.with_poses(poses)


def spread_frames(n: int, count: int, rng: np.random.Generator) -> Int[np.ndarray, " count"]:
    """Frames at random in the middle eight tenths, one in each of `count` equal stretches of these.

    The outer fifths of each stretch stay free, so that neighbours are some frames apart.
    """
    length = 0.8 * n / count
    begin = 0.1 * n + length * np.arange(count)
    return (begin + length * rng.uniform(0.2, 0.8, count)).astype(int)


def more_drift(inputs: Inputs, size: int, rng: np.random.Generator) -> Inputs:
    """Drift anew, so many times as strong."""
    k = DRIFT_FACTORS[size]
    drift = replace(DRIFT, yaw_deg=k * DRIFT.yaw_deg, translation_m=k * DRIFT.translation_m)
    return inputs.with_poses(drift_poses(inputs.true_world_from_cams, drift, rng, inputs.up_world))


def _lost_range(n: int, size: int, rng: np.random.Generator) -> tuple[int, int]:
    """First frame that is lost, and the first that is not; at most a third of all are."""
    count = min(LOST_FRAMES[size], n // 3)
    first = int(rng.integers(n // 10, n - n // 10 - count))
    return first, first + count


def frozen(inputs: Inputs, size: int, rng: np.random.Generator) -> Inputs:
    """The same pose for a while; then tracking is back where it should be."""
    first, last = _lost_range(len(inputs.scan), size, rng)
    poses = inputs.scan.world_from_cams.copy()
    poses[first:last] = poses[first - 1]
    return inputs.with_poses(poses)


def stuck(inputs: Inputs, size: int, rng: np.random.Generator) -> Inputs:
    """The same pose for a while; then tracking goes on from there, as if nobody had walked."""
    first, last = _lost_range(len(inputs.scan), size, rng)
    poses = inputs.scan.world_from_cams.copy()
    resumed = poses[first - 1] @ se3.inverse(poses[last])
    poses[first:last] = poses[first - 1]
    poses[last:] = resumed @ poses[last:]
    return inputs.with_poses(poses)


def zeros(inputs: Inputs, size: int, rng: np.random.Generator) -> Inputs:
    """For a while the pose is the identity, as some trackers write while they are lost."""
    first, last = _lost_range(len(inputs.scan), size, rng)
    poses = inputs.scan.world_from_cams.copy()
    poses[first:last] = np.eye(4)
    return inputs.with_poses(poses)


def not_numbers(inputs: Inputs, size: int, rng: np.random.Generator) -> Inputs:
    """For a while the pose is NaN: readers leave such frames out."""
    first, last = _lost_range(len(inputs.scan), size, rng)
    return without_frames(inputs, first, last, inputs.scan.world_from_cams)


def without_frames(inputs: Inputs, first: int, last: int, poses: Poses) -> Inputs:
    """The scan without the frames from `first` on, up to `last`, which stays."""
    kept = np.delete(np.arange(len(poses)), np.arange(first, last))
    return replace(
        inputs,
        scan=replace(
            select_frames(inputs.scan, kept, poses[kept]),
            fingerprint=f"{inputs.scan.fingerprint} without {first} to {last}",
        ),
        true_world_from_cams=inputs.true_world_from_cams[kept],
    )


def gap(inputs: Inputs, size: int, rng: np.random.Generator) -> Inputs:
    """Frames are missing for a while, and what was walked meanwhile was tracked 0.5 m and 5 deg off."""
    first, last = _lost_range(len(inputs.scan), size, rng)
    poses = inputs.scan.world_from_cams.copy()
    angle = np.deg2rad(5.0) * rng.choice([-1, 1])
    moved = _about_vertical(poses[last, :3, 3], angle, inputs.up_world)
    moved[:3, 3] += 0.5 * _level_direction(inputs.up_world, rng)
    poses[last:] = moved @ poses[last:]
    return without_frames(inputs, first, last, poses)


def delayed(inputs: Inputs, frames: float) -> Inputs:
    """Each frame has the pose of so many frames before (negative: after); at the ends, that of the end."""
    poses = inputs.scan.world_from_cams
    n = len(poses)
    at = np.clip(np.arange(n) - frames, 0, n - 1)
    low = np.clip(np.floor(at).astype(int), 0, n - 2)
    share = (at - low)[:, None]
    positions = poses[low, :3, 3] * (1 - share) + poses[low + 1, :3, 3] * share
    turn = Slerp(np.arange(n), Rotation.from_matrix(poses[:, :3, :3]))
    return inputs.with_poses(se3.make_transform(turn(at).as_matrix(), positions))


DELAYS = (1.0, 2.0, -1.0)
CLOCK_DELAYS = (0.1, 0.25, 0.5)


def late(inputs: Inputs, size: int, _rng: np.random.Generator) -> Inputs:
    """Whole frames late or early."""
    return delayed(inputs, DELAYS[size])


def clock(inputs: Inputs, size: int, _rng: np.random.Generator) -> Inputs:
    """A part of a frame late."""
    return delayed(inputs, CLOCK_DELAYS[size])


def shuffled(inputs: Inputs, size: int, rng: np.random.Generator) -> Inputs:
    """Poses of other frames: the two halves swapped, blocks of ten frames, every frame by itself."""
    n = len(inputs.scan)
    if size == 0:
        order = np.roll(np.arange(n), n // 2)
    else:
        blocks = np.array_split(np.arange(n), n // 10 if size == 1 else n)
        order = np.concatenate([blocks[i] for i in rng.permutation(len(blocks))])
    return inputs.with_poses(inputs.scan.world_from_cams[order])


def constant(inputs: Inputs, _size: int, _rng: np.random.Generator) -> Inputs:
    """All poses are that of the first frame."""
    return inputs.with_poses(np.repeat(inputs.scan.world_from_cams[:1], len(inputs.scan), axis=0))


# Conventions: each gives the recorded poses as a program of another convention would have written them.


def camera_from_world(poses: Poses) -> Poses:
    return se3.inverse(poses)


def opengl_axes(poses: Poses) -> Poses:
    """Camera axes x right, y up, z backward."""
    return poses @ OPENGL_FROM_OPENCV


def arkit_axes(poses: Poses) -> Poses:
    """Those of the sensor held in landscape, OpenGL's way, while the images are upright: a quarter turn."""
    landscape_from_upright = se3.make_transform(
        Rotation.from_euler("z", 90, degrees=True).as_matrix(), np.zeros(3)
    )
    return poses @ landscape_from_upright @ OPENGL_FROM_OPENCV


def quaternion_order(poses: Poses) -> Poses:
    """Written w first, read w last."""
    x, y, z, w = Rotation.from_matrix(poses[:, :3, :3]).as_quat(canonical=True).T
    read = Rotation.from_quat(np.column_stack([w, x, y, z]))
    return se3.make_transform(read.as_matrix(), poses[:, :3, 3])


def z_up(poses: Poses) -> Poses:
    """The world stands on its side: z up where y was, or the other way round."""
    turned = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    return se3.make_transform(turned, np.zeros(3)) @ poses


def millimetres(poses: Poses) -> Poses:
    return se3.make_transform(poses[:, :3, :3], 1000 * poses[:, :3, 3])


def left_handed(poses: Poses) -> Poses:
    """World z and camera y flipped, as game engines have them; each pose is still a rotation."""
    return np.diag([1.0, 1.0, -1.0, 1.0]) @ poses @ np.diag([1.0, -1.0, 1.0, 1.0])


def _convention(name: str, change: Callable[[Poses], Poses]) -> Fault:
    def spoil(inputs: Inputs, _size: int, _rng: np.random.Generator) -> Inputs:
        return inputs.with_poses(change(inputs.scan.world_from_cams))

    return Fault(name, "convention", ("",), spoil, (name,))


def _jumps(name: str, count: int) -> Fault:
    def spoil(inputs: Inputs, size: int, rng: np.random.Generator) -> Inputs:
        return jump(inputs, count, size, rng)

    return Fault(name, "tracking", tuple(f"{d:g} m, {a:g} deg" for d, a in JUMPS), spoil)


_LOST = tuple(f"{n} frames" for n in LOST_FRAMES)

TRACKING = (
    _jumps("one jump", 1),
    _jumps("two jumps", 2),
    _jumps("three jumps", 3),
    Fault("drift", "tracking", tuple(f"{k:g} times" for k in DRIFT_FACTORS), more_drift),
    Fault("frozen, then back", "tracking", _LOST, frozen),
    Fault("frozen, then on", "tracking", _LOST, stuck),
    Fault("identity poses", "tracking", _LOST, zeros),
    Fault("NaN poses", "tracking", _LOST, not_numbers),
    Fault("gap", "tracking", _LOST, gap),
    Fault(
        "delay",
        "convention",
        ("1 frame late", "2 frames late", "1 frame early"),
        late,
        ("one frame late", "two frames late", "one frame early"),
    ),
    Fault("clock", "tracking", tuple(f"{d:g} frames late" for d in CLOCK_DELAYS), clock),
)

CONVENTIONS = (
    _convention("camera_from_world", camera_from_world),
    _convention("OpenGL axes", opengl_axes),
    _convention("ARKit axes", arkit_axes),
    _convention("quaternion order", quaternion_order),
    _convention("z up", z_up),
    _convention("millimetres", millimetres),
    _convention("left-handed", left_handed),
)

ORDER = (
    Fault("shuffled poses", "order", ("two halves", "blocks of 10", "every frame"), shuffled),
    Fault("constant poses", "order", ("",), constant),
)


def _about_vertical(
    centre: Float[np.ndarray, "3"], angle: float, up_world: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "4 4"]:
    """A rotation about the vertical through a point."""
    rotation = se3.exp_so3(angle * up_world)
    return se3.make_transform(rotation, centre - rotation @ centre)


def _level_direction(
    up_world: Float[np.ndarray, "3"], rng: np.random.Generator
) -> Float[np.ndarray, "3"]:
    """A random unit vector across the vertical."""
    axes = se3.rotation_between(np.array([0.0, 0.0, 1.0]), up_world)
    angle = rng.uniform(-np.pi, np.pi)
    return axes @ np.array([np.cos(angle), np.sin(angle), 0.0])

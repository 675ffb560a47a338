"""What is done to a scan or its plan before planfit gets them: drift of the tracker, or parts left out."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from faults.inputs import Inputs
from jaxtyping import Bool, Float, Int

from planfit.geometry import se3
from planfit.scan.views import select_frames
from planfit.synth import DriftOptions, drift_poses

NOISE = DriftOptions(yaw_deg=0.03, translation_m=0.004)
"""Of each step, beneath every drift: what a good visual-inertial tracker has at half a metre a frame."""
TURN_DEG, SHIFT_M, SHIFT_UP_M = 5.0, 0.4, 0.08
"""Standard deviations of heading, place and height that a slow drift reaches at the end of a walk: as phones
have them after some 100 m."""
JUMP_M, JUMP_DEG = (0.6, 2.0), (5.0, 30.0)
"""A jump of a tracker that lost its way and goes on from there, from and to."""
LEFT_OUT_EVERY = 10
"""One frame, or one metre of wall, in so many is left out."""

Poses = Float[np.ndarray, "n 4 4"]


@dataclass(frozen=True)
class Change:
    """Inputs as one case has them."""

    name: str
    apply: Callable[[Inputs, np.random.Generator], Inputs]
    is_steadiness: bool = False
    """Whether something is left out of the scan as it was recorded: then nothing that matters may change."""
    n_jumps: int = 0


def as_recorded(inputs: Inputs, _rng: np.random.Generator) -> Inputs:
    """With the poses that the scan came with."""
    return inputs


def slow_turn(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    """Heading drifts smoothly, so that what follows turns with it."""
    n, up = len(inputs.scan), inputs.up_world
    turns = np.deg2rad(TURN_DEG) * np.diff(_slow(n, rng))
    poses = _noisy(inputs, rng)
    steps = se3.inverse(poses[:-1]) @ poses[1:]
    walked = [poses[0]]
    for turn, step in zip(turns, steps, strict=True):
        moved = walked[-1] @ step
        moved[:3, :3] = se3.exp_so3(turn * up) @ moved[:3, :3]
        walked.append(moved)
    return inputs.with_poses(_proper(np.array(walked)))


def slow_shift(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    """Places drift smoothly, headings do not."""
    n = len(inputs.scan)
    level = se3.rotation_between(np.array([0.0, 0.0, 1.0]), inputs.up_world)
    sizes_m = (SHIFT_M, SHIFT_M, SHIFT_UP_M)
    shift = np.stack([size * _slow(n, rng) for size in sizes_m], axis=1)
    poses = _noisy(inputs, rng)
    poses[:, :3, 3] += shift @ level.T
    return inputs.with_poses(poses)


def tracker_scale(share: float) -> Callable[[Inputs, np.random.Generator], Inputs]:
    """Recorded motion is too long or too short by a share, while depth is right."""

    def apply(inputs: Inputs, rng: np.random.Generator) -> Inputs:
        poses = _noisy(inputs, rng)
        factor = 1.0 + share * rng.choice([-1.0, 1.0])
        poses[:, :3, 3] = poses[0, :3, 3] + factor * (poses[:, :3, 3] - poses[0, :3, 3])
        return inputs.with_poses(poses)

    return apply


def one_jump(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    """From one frame on, all poses are moved across the floor and turned about the vertical."""
    poses = _noisy(inputs, rng)
    at = jump_frame(len(poses), rng)
    angle = np.deg2rad(rng.uniform(*JUMP_DEG)) * rng.choice([-1.0, 1.0])
    level = se3.rotation_between(np.array([0.0, 0.0, 1.0]), inputs.up_world)
    way = rng.uniform(-np.pi, np.pi)
    direction = level @ np.array([np.cos(way), np.sin(way), 0.0])
    rotation = se3.exp_so3(angle * inputs.up_world)
    centre = poses[at, :3, 3]
    jump = se3.make_transform(rotation, centre - rotation @ centre)
    jump[:3, 3] += rng.uniform(*JUMP_M) * direction
    poses[at:] = jump @ poses[at:]
    return inputs.with_poses(poses)


def jump_frame(n: int, rng: np.random.Generator) -> int:
    """The first frame after the jump, in the middle of the walk."""
    return int(n * rng.uniform(0.2, 0.8))


def frames_left_out(k: int) -> Callable[[Inputs, np.random.Generator], Inputs]:
    """Without frames k, k + 10, k + 20 ... of the scan as it was recorded."""

    def apply(inputs: Inputs, _rng: np.random.Generator) -> Inputs:
        kept = kept_frames(len(inputs.scan), k)
        scan = select_frames(inputs.scan, kept, inputs.scan.world_from_cams[kept])
        scan = replace(scan, fingerprint=f"{inputs.scan.fingerprint} without {k} of ten")
        return replace(inputs, scan=scan, true_world_from_cams=inputs.true_world_from_cams[kept])

    return apply


def kept_frames(n: int, k: int) -> Int[np.ndarray, " m"]:
    """All frames but every tenth, from k on."""
    return np.flatnonzero(np.arange(n) % LEFT_OUT_EVERY != k)


def walls_left_out(k: int) -> Callable[[Inputs, np.random.Generator], Inputs]:
    """Without a tenth of the length of the plan's faces; `k` of five ways."""

    def apply(inputs: Inputs, _rng: np.random.Generator) -> Inputs:
        kept = kept_faces(inputs.floorplan.lengths, k)
        plan = inputs.floorplan
        thickness = None if plan.thickness is None else plan.thickness[kept]
        changed = inputs.with_faces(plan.ends[kept], plan.normals[kept], plan.is_oriented[kept])
        return replace(changed, floorplan=replace(changed.floorplan, thickness=thickness))

    return apply


def kept_faces(lengths_m: Float[np.ndarray, " f"], k: int) -> Bool[np.ndarray, " f"]:
    """Faces that stay where a tenth of the length goes, drawn at random, in another way for each k."""
    order = np.random.default_rng([k, len(lengths_m)]).permutation(len(lengths_m))
    gone = np.cumsum(lengths_m[order]) <= lengths_m.sum() / LEFT_OUT_EVERY
    kept = np.ones(len(lengths_m), dtype=bool)
    kept[order[gone]] = False
    return kept


AS_RECORDED = Change("as recorded", as_recorded)
DRIFTS = (
    Change("slow turn", slow_turn),
    Change("slow shift", slow_shift),
    Change("tracker 1 % off", tracker_scale(0.01)),
    Change("tracker 2 % off", tracker_scale(0.02)),
    Change("one jump", one_jump, n_jumps=1),
)
STEADINESS = (
    *(Change(f"frames left out, {k}", frames_left_out(k), True) for k in range(LEFT_OUT_EVERY)),
    *(Change(f"walls left out, {k}", walls_left_out(k), True) for k in range(5)),
)


def true_jumps(true: Poses, recorded: Poses) -> Int[np.ndarray, " j"]:
    """Frames before which the recorded motion departs from the true one by a jump.

    By the step alone: whatever was done to the poses, and in whatever order.
    """
    off = se3.inverse(se3.inverse(true[:-1]) @ true[1:]) @ (
        se3.inverse(recorded[:-1]) @ recorded[1:]
    )
    is_far = np.linalg.norm(off[:, :3, 3], axis=1) > 0.5 * JUMP_M[0]
    is_turned = np.rad2deg(se3.rotation_angle(off[:, :3, :3])) > 0.8 * JUMP_DEG[0]
    return np.flatnonzero(is_far | is_turned)


def _noisy(inputs: Inputs, rng: np.random.Generator) -> Poses:
    return drift_poses(inputs.true_world_from_cams, NOISE, rng, inputs.up_world)


def _slow(n: int, rng: np.random.Generator) -> Float[np.ndarray, " n"]:
    """A smooth curve from 0, of standard deviation 1 at its end: a random walk's first terms."""
    along = np.linspace(0.0, 1.0, n)
    k = np.arange(1, 5)
    # Karhunen-Loeve: a Wiener process is a sum of sines with these frequencies and independent weights.
    frequencies = (k - 0.5) * np.pi
    weights = rng.standard_normal(len(k)) * np.sqrt(2.0) / frequencies
    return np.sin(along[:, None] * frequencies) @ weights


def _proper(poses: Poses) -> Poses:
    """Products of many rotations, made rotations again."""
    poses[:, :3, :3] = se3.project_to_so3(poses[:, :3, :3])
    return poses

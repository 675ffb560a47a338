"""Keyframes: solve for some frames, let the others follow.

A frame between keyframes is held to its nearest keyframe by the recorded motion, which over a few
decimetres is better than anything else that is known of it. Its matches, floor and wall points stay in
the problem, moved into the keyframe's axes. After the solve, each frame follows its two keyframes.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.measurements import Measurements
from planfit.adjust.terms.control import ControlMarks
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.matching import Matches, SurfacePairs
from planfit.segmentation import LevelPoints, Structure, WallPatches


@dataclass(frozen=True)
class Keyframes:
    """Which frames are keyframes, and which keyframe each frame is held to."""

    frame_idx: Int[np.ndarray, " k"]
    """Increasing; the first and the last frame are among them."""
    nearest: Int[np.ndarray, " n"]
    """Position in frame_idx of the keyframe that a frame is held to."""
    key_from_cam: Poses
    """Recorded motion from each frame to that keyframe."""
    first_from_keys: Float[np.ndarray, "k 4 4"]
    """Recorded poses of keyframes in the axes of the first."""


def hold_to_keyframes(world_from_cams: Poses, frame_idx: Int[np.ndarray, " k"]) -> Keyframes:
    """Hold all frames of a recorded trajectory to keyframes.

    Args:
        frame_idx: keyframes, increasing; the first and the last frame are among them.
    """
    steps = se3.inverse(world_from_cams[:-1]) @ world_from_cams[1:]
    moved = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps[:, :3, 3], axis=1))])
    # Frame i belongs to the keyframe between whose borders, halfway along the path, it lies.
    borders = 0.5 * (moved[frame_idx[:-1]] + moved[frame_idx[1:]])
    nearest = np.searchsorted(borders, moved, side="right").clip(0, len(frame_idx) - 1)
    nearest[frame_idx] = np.arange(len(frame_idx))
    nearest = np.maximum.accumulate(nearest)
    key_from_cam = se3.inverse(world_from_cams[frame_idx[nearest]]) @ world_from_cams
    key_from_cam[frame_idx] = np.eye(4)  # exactly: what keyframes see is then not moved at all
    recorded = world_from_cams[frame_idx]
    return Keyframes(frame_idx, nearest, key_from_cam, se3.inverse(recorded[0]) @ recorded)


def reduce_measurements(measurements: Measurements, keyframes: Keyframes) -> Measurements:
    """The same measurements with keyframes as its only frames."""
    if len(keyframes.frame_idx) == len(keyframes.nearest):
        return measurements
    return Measurements(
        _reduce_matches(measurements.matches, keyframes),
        _reduce_structure(measurements.structure, keyframes),
        measurements.odometry.between(keyframes.frame_idx, keyframes.first_from_keys),
        tuple(measurements.cameras[i] for i in keyframes.frame_idx) if measurements.cameras else (),
        keyframes.frame_idx,
        _reduce_surfaces(measurements.surfaces, keyframes),
        _reduce_control(measurements.control, keyframes),
        None if measurements.by_hand is None else _reduce_matches(measurements.by_hand, keyframes),
    )


def follow_keyframes(target_from_keys: Float[np.ndarray, "k 4 4"], keyframes: Keyframes) -> Poses:
    """Poses of all frames from those of the keyframes.

    A frame between two keyframes is carried along by each, by the recorded motion; the two answers
    are blended on SO(3) x R^3 by how far along it is, so that nothing jumps between keyframes.
    """
    n, key = len(keyframes.nearest), keyframes.frame_idx
    before = np.searchsorted(key, np.arange(n), side="right") - 1
    after = np.minimum(before + 1, len(key) - 1)
    from_before, from_after = (_carried(target_from_keys, keyframes, k) for k in (before, after))
    span = np.maximum(key[after] - key[before], 1)
    share = ((np.arange(n) - key[before]) / span)[:, None]
    blended = se3.retract(from_before, share * se3.difference(from_after, from_before))
    blended[key] = target_from_keys
    return blended


def _carried(target_from_keys: np.ndarray, keyframes: Keyframes, which: np.ndarray) -> np.ndarray:
    """Poses (n, 4, 4) of frames as the keyframes `which` (n,) carry them by the recorded motion."""
    recorded = keyframes.first_from_keys
    which_from_nearest = se3.inverse(recorded[which]) @ recorded[keyframes.nearest]
    return target_from_keys[which] @ which_from_nearest @ keyframes.key_from_cam


def _reduce_matches(matches: Matches, keyframes: Keyframes) -> Matches:
    pairs = keyframes.nearest[matches.pairs]
    keep = pairs[:, 0] != pairs[:, 1]
    of_frames = matches if keep.all() else matches.of_pairs(keep)
    motions, start = keyframes.key_from_cam, of_frames.start
    return replace(
        of_frames,
        pairs=pairs[keep],
        points_a=_move(motions, of_frames.pairs[:, 0], start, of_frames.points_a),
        points_b=_move(motions, of_frames.pairs[:, 1], start, of_frames.points_b),
    )


def _reduce_surfaces(surfaces: SurfacePairs, keyframes: Keyframes) -> SurfacePairs:
    """Pairs of keyframes: T' = X T Y^-1 with the motions X, Y onto the keyframes of both.

    A tangent (w, v) of T = (R, t) turns T' by X w and moves it by X (v + w x R s), s = Y^-1's translation.
    """
    pairs = keyframes.nearest[surfaces.pairs]
    keep = pairs[:, 0] != pairs[:, 1]
    motion, (i, j) = surfaces.a_from_b[keep], surfaces.pairs[keep].T
    first, second = keyframes.key_from_cam[i], se3.inverse(keyframes.key_from_cam[j])
    axes = first[:, :3, :3]
    jacobian = np.zeros((len(motion), 6, 6))
    jacobian[:, :3, :3] = jacobian[:, 3:, 3:] = axes
    arm = (motion[:, :3, :3] @ second[:, :3, 3:])[..., 0]
    jacobian[:, 3:, :3] = -axes @ se3.skew(arm)
    inverse = np.linalg.inv(jacobian)
    information = np.swapaxes(inverse, 1, 2) @ surfaces.information[keep] @ inverse
    moved = first @ motion @ second
    # The earlier keyframe first: keyframes grow with frames, so pairs keep their order.
    of_sensor = jacobian @ surfaces.by_sensor[keep]
    return SurfacePairs(
        pairs[keep],
        moved,
        information,
        surfaces.explained[keep],
        of_sensor,
        surfaces.distance_m[keep],
    )


def _reduce_control(marks: ControlMarks, keyframes: Keyframes) -> ControlMarks:
    """Marks in the axes of keyframes, whichever frames show the points."""
    moved = se3.transform_each(keyframes.key_from_cam[marks.pose_idx], marks.points_cam)
    return replace(marks, points_cam=moved, pose_idx=keyframes.nearest[marks.pose_idx])


def _reduce_structure(structure: Structure, keyframes: Keyframes) -> Structure:
    nearest, move = keyframes.nearest, keyframes.key_from_cam
    unassigned = structure.unassigned_frame_idx
    runs = np.concatenate([np.flatnonzero(np.diff(unassigned, prepend=-1)), [len(unassigned)]])
    return replace(
        structure,
        floor=_reduce_level(structure.floor, keyframes),
        floor_heights_m=structure.floor_heights_m[keyframes.frame_idx],
        walls=_reduce_patches(structure.walls, keyframes),
        unassigned_points_cam=_move(
            move, unassigned[runs[:-1]], runs, structure.unassigned_points_cam
        ),
        unassigned_frame_idx=nearest.astype(np.int32)[unassigned],
        ceiling=_reduce_level(structure.ceiling, keyframes),
        columns=_reduce_patches(structure.columns, keyframes),
        storeys=None if structure.storeys is None else structure.storeys[keyframes.frame_idx],
    )


def _reduce_level(level: LevelPoints, keyframes: Keyframes) -> LevelPoints:
    k, nearest = len(keyframes.frame_idx), keyframes.nearest
    first_frame = np.searchsorted(nearest, np.arange(k + 1)).clip(0, len(nearest))
    every = np.arange(len(level.start) - 1)
    moved = _move(keyframes.key_from_cam, every, level.start, level.points_cam)
    return LevelPoints(moved, level.start[first_frame])


def _reduce_patches(patches: WallPatches, keyframes: Keyframes) -> WallPatches:
    move, frame = keyframes.key_from_cam, patches.frame_idx
    ends = _move(move, frame, 2 * np.arange(len(frame) + 1), patches.ends_cam.reshape(-1, 3))
    return replace(
        patches,
        points_cam=_move(move, frame, patches.start, patches.points_cam),
        frame_idx=keyframes.nearest[frame],
        normals_cam=np.einsum("kij,kj->ki", move[frame, :3, :3], patches.normals_cam),
        ends_cam=ends.reshape(-1, 2, 3),
    )


def _move(
    transforms: np.ndarray, idx: np.ndarray, start: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """Points (m, 3), those of group k (start[k]:start[k + 1]) moved by transform idx[k]; keeps their dtype.

    Where nothing moves, as where all were seen by keyframes, the points are the very same array.
    """
    has_points = np.flatnonzero(np.diff(start))
    if (transforms[idx[has_points]] == np.eye(4)).all():
        return points
    moved = np.zeros_like(points)
    for k in has_points:
        own = slice(start[k], start[k + 1])
        moved[own] = se3.transform(transforms[idx[k]], points[own])
    return moved

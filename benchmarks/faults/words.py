"""What a result says of itself, read in one place: outcome, convention, moved walls, predicted errors.

Parts of a result that a version of planfit does not have yet are read as not said.
"""

import re

import numpy as np
from jaxtyping import Float

from faults.inputs import Inputs
from planfit.pipeline.result import RefineResult

NAMES = {
    "camera_from_world": r"camera_from_world|cam_from_world|inverse|inverted",
    "OpenGL axes": r"opengl",
    "ARKit axes": r"arkit",
    "quaternion order": r"quaternion",
    "z up": r"z[ -]?up|y[ -]?up|up axis|z is up|y is up",
    "millimetres": r"millimet",
    "left-handed": r"left[ -]?handed|mirrored axes",
    "one frame late": r"one frame late|1 frame late|a frame late|late",
    "two frames late": r"two frames late|2 frames late|late",
    "one frame early": r"one frame early|1 frame early|a frame early|early",
}
"""How a convention may be named, in lower case."""

MOVED_WITHIN_M = 0.03


def outcome_of(result: RefineResult) -> tuple[int, str]:
    """Exit code as the command line gives it, and the outcome in words."""
    verdict = getattr(result, "verdict", None)
    if verdict is not None:
        outcome = getattr(verdict.outcome, "value", verdict.outcome)
        return (0 if outcome == "refined" else 1), str(outcome)
    return (0, "refined") if result.is_better else (1, "not better than before")


def recognised(convention: str, heard: str, result: RefineResult | None = None) -> bool | None:
    """Whether a wrong convention was named; of right poses, False where one was claimed, else None.

    Args:
        convention: what the poses are in; empty where they are as they should be.
        heard: all that was said, where no convention is a value of the result.
        result: its `tracking.convention` is asked first.
    """
    tracking = getattr(result, "tracking", None)
    named = getattr(tracking, "convention", None)
    if named is not None:
        named = str(getattr(named, "value", getattr(named, "name", named)))
    if not convention:
        is_claimed = named not in (None, "", "None", "none", "as recorded", "recorded")
        return False if is_claimed else None
    text = named if named not in (None, "", "None") else heard
    return bool(re.search(NAMES[convention], text.lower().replace("_", " ")
                          if convention != "camera_from_world" else text.lower()))  # fmt: skip


def moved_walls_found(inputs: Inputs, result: RefineResult) -> tuple[int, int]:
    """How many moved walls three pieces or more were seen of, and how many of these were named rightly.

    A wall is named rightly where one of its faces has an offset within 3 cm of the true one.
    """
    named = named_offsets_m(result)
    if not inputs.moved_walls or named is None:
        return 0, 0
    n_pieces = pieces_a_face(inputs, result)
    seen = right = 0
    for wall in inputs.moved_walls:
        faces = wall.face_idx[n_pieces[wall.face_idx] > 0]
        if n_pieces[faces].sum() < 3:
            continue
        seen += 1
        true = inputs.floorplan.normals[faces] @ (inputs.given_from_true @ wall.as_built_m)
        right += bool(np.any(np.abs(named[faces] - true) < MOVED_WITHIN_M))
    return seen, right


def named_offsets_m(result: RefineResult) -> Float[np.ndarray, " f"] | None:
    """Offset of each face that was named as moved, along its normal, NaN for others; None if none can be."""
    moved = getattr(result.adjustment, "moved_walls", None)
    if moved is None:
        return None
    offsets = np.full(len(result.floorplan), np.nan)
    for wall in moved:
        offsets[np.atleast_1d(wall.face_idx)] = wall.offset_m
    return offsets


def pieces_a_face(inputs: Inputs, result: RefineResult) -> Float[np.ndarray, " f"]:
    """How many wall patches of the scan lie, from the true poses, on each face where it was built."""
    true_plan_from_cams = inputs.true_plan_from_world @ inputs.true_world_from_cams
    walls = result.structure.walls
    middle_cam = walls.ends_cam.mean(axis=1)
    poses = true_plan_from_cams[walls.frame_idx]
    middle = (np.einsum("kij,kj->ki", poses[:, :3, :3], middle_cam) + poses[:, :3, 3])[:, :2]
    normal = np.einsum("kij,kj->ki", poses[:, :3, :3], walls.normals_cam)[:, :2]
    counts = np.zeros(len(inputs.floorplan))
    for wall in inputs.moved_walls:
        for face in wall.face_idx:
            ends = inputs.floorplan.ends[face] @ np.linalg.inv(inputs.given_from_true).T
            ends = ends + wall.as_built_m
            along = (ends[1] - ends[0]) / max(float(np.linalg.norm(ends[1] - ends[0])), 1e-9)
            off = (middle - ends[0]) @ inputs.floorplan.normals[face]
            at = (middle - ends[0]) @ along
            is_on = (np.abs(off) < 0.05) & (at > 0) & (at < np.linalg.norm(ends[1] - ends[0]))
            counts[face] = np.sum(is_on & (normal @ inputs.floorplan.normals[face] > 0.9))
    return counts


def predicted_errors_m(result: RefineResult) -> Float[np.ndarray, " n"] | None:
    """Error (m) that the run predicts for each frame; None where it predicts none."""
    verdict = getattr(result, "verdict", None)
    predicted = getattr(verdict, "predicted_error_m", getattr(verdict, "predicted_errors_m", None))
    return None if predicted is None else np.asarray(predicted, dtype=float)

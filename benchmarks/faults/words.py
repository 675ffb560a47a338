"""What a result says of itself, read in one place: outcome, convention, moved walls, predicted errors.

Parts of a result that a version of planfit does not have yet are read as not said.
"""

import re

import numpy as np
from jaxtyping import Float

from faults.inputs import Inputs
from planfit.pipeline.result import RefineResult

NAMES = {
    "camera_from_world": ("camera_from_world",),
    "OpenGL axes": ("opengl",),
    "ARKit axes": ("arkit", "arkit_other_way"),
    "quaternion order": ("quaternion_wxyz", "quaternion_xyzw"),
    "z up": ("z_up", "y_up"),
    "millimetres": ("millimetres",),
    "left-handed": ("left_handed",),
    "one frame late": ("one_frame_late",),
    "two frames late": ("two_frames_late",),
    "one frame early": ("one_frame_early",),
}
"""How planfit may name a convention."""
_NAMED = re.compile(r"(?:look like|if they are|taken as|poses-convention) (\w+)")

MOVED_WITHIN_M = 0.03


def outcome_of(result: RefineResult) -> tuple[int, str]:
    """Exit code as the command line gives it, and the outcome in words."""
    return (0 if result.verdict.is_refined else 1), result.verdict.headline


def recognised(convention: str, heard: str, result: RefineResult | None = None) -> bool | None:
    """Whether a wrong convention was named; of right poses, False where one was claimed, else None.

    Args:
        convention: what the poses are in; empty where they are as they should be.
        heard: all that was said: the warnings, or the sentence of an error.
        result: its `tracking.convention` is asked, too.
    """
    named = set(_NAMED.findall(heard))
    named.add(getattr(getattr(result, "tracking", None), "convention", "recorded"))
    if convention:
        return bool(named & set(NAMES[convention]))
    known = {name for names in NAMES.values() for name in names}
    return False if named & known else None


def moved_walls_found(inputs: Inputs, result: RefineResult) -> tuple[int, int]:
    """How many moved walls three pieces or more were seen of, and how many of these were named rightly.

    A wall is named rightly where one of its faces has an offset within 3 cm of the true one.
    """
    if not inputs.moved_walls:
        return 0, 0
    named = named_offsets_m(result)
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


def named_offsets_m(result: RefineResult) -> Float[np.ndarray, " f"]:
    """Offset of each face of the plan that was named as moved, along its normal; NaN for the others."""
    adjustment = result.adjustment
    moved_m = getattr(adjustment.correspondences, "moved_m", None)
    if moved_m is None:
        return np.full(len(adjustment.offsets_m), np.nan)
    return np.where(np.isfinite(moved_m), adjustment.offsets_m, np.nan)


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
    predicted = getattr(verdict, "predicted_error_m", None)
    return None if predicted is None else np.asarray(predicted, dtype=float)

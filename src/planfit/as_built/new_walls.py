"""Walls that the plan lacks: wall patches of no face, in line and near each other."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from planfit.as_built.lines_of_sight import (
    DEPTH_M,
    HEIGHTS_M,
    LinesOfSight,
    Piece,
    are_walls,
    top_of,
)
from planfit.as_built.wall_offsets import PlacedWalls
from planfit.floorplan import Floorplan
from planfit.floorplan.faces import connected_groups
from planfit.priors import SURFACE_TILT_MOST_DEG

SAME_WALL_M = 0.15
"""Patches whose lines are this far apart at most belong to one wall."""
MAX_GAP_M = 0.5
MAX_ANGLE_DEG = SURFACE_TILT_MOST_DEG.value
PARALLEL = 0.97
"""Cosine between normals of faces that are in line with a new wall."""
BIN_M, MIN_POINTS = 0.1, 3
"""A line is looked at in parts of this length, shown by so many points."""
MIN_PATCHES, MIN_LENGTH_M = 3, 0.6
"""Wall patches that a new wall consists of, and its length, m, at least."""


def find_new_walls(
    placed: PlacedWalls, is_open: Bool[np.ndarray, " k"], floorplan: Floorplan, sight: LinesOfSight
) -> list[Piece]:
    """Walls that patches of no face make up, the longest first.

    Args:
        placed: patches in the plan frame.
        is_open: those that no face stands for.
        floorplan: as drawn: where it draws a wall in line, none is new.
        sight: what is seen over is no wall.
    """
    of_patches = placed.storeys_of_patches
    above_m = placed.points[:, 2] - sight.floors_m[placed.point_frame_idx]
    pieces = []
    for storey in np.unique(of_patches[is_open]):
        idx = np.flatnonzero(is_open & (of_patches == storey))
        plan = floorplan if floorplan.storeys is None else floorplan.of_storey(int(storey))
        found = []
        for group in _in_line(placed.normals[idx], placed.ends[idx], placed.lengths[idx]):
            if len(group) >= MIN_PATCHES:
                found += _pieces_of(placed, idx[group], plan, above_m)
        if floorplan.storeys is not None:
            found = [replace(piece, storey=int(storey)) for piece in found]
        pieces += found
    walls = [p for p, ok in zip(pieces, are_walls(pieces, sight), strict=True) if ok]
    return sorted(walls, key=lambda w: (-np.linalg.norm(w.ends[1] - w.ends[0]), *w.ends[0]))


def _pieces_of(
    placed: PlacedWalls,
    patch_idx: Int[np.ndarray, " g"],
    floorplan: Floorplan,
    above_m: Float[np.ndarray, " m"],
) -> list[Piece]:
    """Parts of a line of patches that points show, where no face is drawn in line."""
    length = placed.lengths[patch_idx]
    total = (length[:, None] * placed.normals[patch_idx]).sum(axis=0)
    normal = total / np.linalg.norm(total)  # long patches tell a direction best
    # From right to left of who sees it: the free side is on the left of the way.
    along = np.array([normal[1], -normal[0]])
    across = float(np.median(placed.ends[patch_idx].mean(axis=1) @ normal))
    which = placed.points_of(patch_idx)
    of_patch = np.repeat(patch_idx, np.diff(placed.start)[patch_idx])
    at, above_m = placed.points[which, :2] @ along, above_m[which]
    first = at.min()
    bins = ((at - first) / BIN_M).astype(int)
    is_low = above_m < HEIGHTS_M[1]  # what is above may be the lintel of a door
    shown = np.bincount(bins[is_low], minlength=bins.max() + 1) >= MIN_POINTS
    shown &= ~_is_drawn(first + BIN_M * (np.arange(len(shown)) + 0.5), normal, across, floorplan)
    pieces = []
    for low, high in _runs(shown):
        own = (bins >= low) & (bins <= high)
        patches = np.unique(of_patch[own])
        is_long = (high - low + 1) * BIN_M >= MIN_LENGTH_M
        if is_long and len(patches) >= MIN_PATCHES:
            stands = first + BIN_M * np.array([low, high + 1])
            ends = across * normal + stands[:, None] * along
            behind = _has_wall_behind(ends, normal, floorplan)
            pieces.append(Piece(ends, normal, patches, top_of(above_m[own]), behind))
    return pieces


def _is_drawn(
    at: Float[np.ndarray, " b"], normal: Float[np.ndarray, "2"], across: float, floorplan: Floorplan
) -> Bool[np.ndarray, " b"]:
    """Whether a face is drawn at places along a line that looks the same way."""
    along = np.array([normal[1], -normal[0]])
    off_m = np.abs(floorplan.ends.mean(axis=1) @ normal - across)
    drawn = np.zeros(len(at), dtype=bool)
    for ends in floorplan.ends[_look_alike(normal, floorplan) & (off_m < SAME_WALL_M)] @ along:
        drawn |= (at > ends.min() - BIN_M) & (at < ends.max() + BIN_M)
    return drawn


def _has_wall_behind(
    ends: Float[np.ndarray, "2 2"], normal: Float[np.ndarray, "2"], floorplan: Floorplan
) -> bool:
    """Whether a face that looks the same way is drawn behind the middle of a piece: a cupboard's."""
    behind_m = (ends.mean(axis=0) - floorplan.ends.mean(axis=1)) @ normal
    near = _look_alike(normal, floorplan) & (behind_m > DEPTH_M[0]) & (behind_m < DEPTH_M[1])
    along = np.array([normal[1], -normal[0]])
    at = floorplan.ends[near] @ along - ends.mean(axis=0) @ along
    return bool(
        np.any((at.min(axis=1, initial=np.inf) < 0) & (at.max(axis=1, initial=-np.inf) > 0))
    )


def _look_alike(normal: Float[np.ndarray, "2"], floorplan: Floorplan) -> Bool[np.ndarray, " n"]:
    """Faces that are seen from the side that a normal points to."""
    cosine = floorplan.normals @ normal
    return np.where(floorplan.is_oriented, cosine, np.abs(cosine)) > PARALLEL


def _runs(shown: Bool[np.ndarray, " b"]) -> list[tuple[int, int]]:
    """First and last of runs of parts that are shown, over gaps that a door or a picture may make."""
    idx = np.flatnonzero(shown)
    if len(idx) == 0:
        return []
    breaks = np.flatnonzero(np.diff(idx) * BIN_M > MAX_GAP_M)
    return list(
        zip(idx[np.r_[0, breaks + 1]].tolist(), idx[np.r_[breaks, -1]].tolist(), strict=True)
    )


def _in_line(
    normals: Float[np.ndarray, "k 2"],
    ends: Float[np.ndarray, "k 2 2"],
    length: Float[np.ndarray, " k"],
) -> list[Int[np.ndarray, " g"]]:
    """Groups of patches that are in line, look to one side, and are near."""
    middle = ends.mean(axis=1)
    near = cKDTree(middle).query_pairs(float(length.max()) + MAX_GAP_M, output_type="ndarray")
    i, j = near.T
    between = middle[j] - middle[i]
    along = np.column_stack([-normals[:, 1], normals[:, 0]])
    joined = (
        (np.sum(normals[i] * normals[j], axis=1) > np.cos(np.deg2rad(MAX_ANGLE_DEG)))
        & (np.abs(np.sum(between * normals[i], axis=1)) < SAME_WALL_M)
        & (np.abs(np.sum(between * normals[j], axis=1)) < SAME_WALL_M)
        & (np.abs(np.sum(between * along[i], axis=1)) < (length[i] + length[j]) / 2 + MAX_GAP_M)
    )
    group = connected_groups(i[joined], j[joined], len(ends))
    return [np.flatnonzero(group == k) for k in range(group.max() + 1)]

"""Walls that the plan lacks: wall patches of no face, in line and near each other."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from planfit.as_built.types import AsBuiltOptions
from planfit.as_built.wall_offsets import PlacedWalls
from planfit.floorplan import Floorplan

SAME_WALL_M = 0.15
"""Patches whose lines are this far apart at most belong to one wall."""
MAX_GAP_M = 0.5
MAX_ANGLE_DEG = 15.0
PARALLEL = 0.97
"""Cosine between normals of faces that are in line with a new wall."""
BIN_M, MIN_POINTS, TOP_QUANTILE = 0.1, 3, 0.99
"""A line is looked at in parts of this length, shown by so many points; its top is this quantile of their
heights: single points fly."""


@dataclass(frozen=True)
class NewWall:
    """Patches in one line."""

    ends: Float[np.ndarray, "2 2"]
    """Plan frame, m."""
    normal: Float[np.ndarray, "2"]
    """Unit, towards the side that it was seen from."""
    patch_idx: Int[np.ndarray, " p"]


def find_new_walls(
    placed: PlacedWalls,
    is_open: Bool[np.ndarray, " k"],
    floorplan: Floorplan,
    floors_m: Float[np.ndarray, " k"],
    options: AsBuiltOptions,
) -> list[NewWall]:
    """Walls that patches of no face make up, the longest first.

    Args:
        placed: patches in the plan frame.
        is_open: those that no face stands for.
        floorplan: as drawn: where it draws a wall in line, none is new.
        floors_m: height of the floor under each patch, m.
        options: of how many patches a wall is, how long and how high, at least.
    """
    idx = np.flatnonzero(is_open)
    if len(idx) == 0:
        return []
    walls = []
    for group in _in_line(placed.normals[idx], placed.ends[idx], placed.lengths[idx]):
        if len(group) >= options.min_new_patches:
            walls += _walls_of(placed, idx[group], floorplan, floors_m, options)
    return sorted(walls, key=lambda w: (-np.linalg.norm(w.ends[1] - w.ends[0]), *w.ends[0]))


def _walls_of(
    placed: PlacedWalls,
    patch_idx: Int[np.ndarray, " g"],
    floorplan: Floorplan,
    floors_m: Float[np.ndarray, " k"],
    options: AsBuiltOptions,
) -> list[NewWall]:
    """Parts of a line of patches that points show, high enough, where no face is drawn in line."""
    length = placed.lengths[patch_idx]
    total = (length[:, None] * placed.normals[patch_idx]).sum(axis=0)
    normal = total / np.linalg.norm(total)  # long patches tell a direction best
    # From right to left of who sees it: the free side is on the left of the way.
    along = np.array([normal[1], -normal[0]])
    across = float(np.median(placed.ends[patch_idx].mean(axis=1) @ normal))
    which = np.concatenate([np.arange(placed.start[i], placed.start[i + 1]) for i in patch_idx])
    sizes = np.diff(placed.start)[patch_idx]
    points, of_patch = placed.points[which], np.repeat(patch_idx, sizes)
    above_m = points[:, 2] - floors_m[of_patch]
    at = points[:, :2] @ along
    first = at.min()
    bins = ((at - first) / BIN_M).astype(int)
    is_low = above_m < options.heights_m[1]  # what is above may be the lintel of a door
    shown = np.bincount(bins[is_low], minlength=bins.max() + 1) >= MIN_POINTS
    shown &= ~_is_drawn(first + BIN_M * (np.arange(len(shown)) + 0.5), normal, across, floorplan)
    walls = []
    for low, high in _runs(shown):
        own = (bins >= low) & (bins <= high)
        patches = np.unique(of_patch[own])
        is_long = (high - low + 1) * BIN_M >= options.min_new_length_m
        is_high = np.nanquantile(above_m[own], TOP_QUANTILE) >= options.min_new_top_m
        if is_long and is_high and len(patches) >= options.min_new_patches:
            stands = first + BIN_M * np.array([low, high + 1])
            walls.append(NewWall(across * normal + stands[:, None] * along, normal, patches))
    return walls


def _is_drawn(
    at: Float[np.ndarray, " b"],
    normal: Float[np.ndarray, "2"],
    across: float,
    floorplan: Floorplan,
) -> Bool[np.ndarray, " b"]:
    """Whether a face is drawn at places along a line that looks the same way."""
    along = np.array([normal[1], -normal[0]])
    cosine = floorplan.normals @ normal
    looks_alike = np.where(floorplan.is_oriented, cosine, np.abs(cosine)) > PARALLEL
    in_line = looks_alike & (np.abs(floorplan.ends.mean(axis=1) @ normal - across) < SAME_WALL_M)
    drawn = np.zeros(len(at), dtype=bool)
    for ends in floorplan.ends[in_line] @ along:
        drawn |= (at > ends.min() - BIN_M) & (at < ends.max() + BIN_M)
    return drawn


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
    graph = sparse.coo_array(
        (np.ones(joined.sum()), (i[joined], j[joined])), shape=(len(ends),) * 2
    )
    # Patches that are joined pairwise are one wall: connected components of the graph of pairs.
    n_groups, group = connected_components(graph, directed=False)
    return [np.flatnonzero(group == k) for k in range(n_groups)]

"""Where scan and plan do not meet: walls scanned but not drawn, and drawn but not scanned."""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from planfit.adjust.association import Association, wall_patches_in_plan
from planfit.floorplan import Floorplan
from planfit.report.top_view import Crop
from planfit.report.walls import FEW_PATCHES
from planfit.segmentation import WallPatches

_MIN_LENGTH_M = 0.5
_SAME_WALL_M = 0.15
"""Pieces whose lines are this far apart at most belong to one wall."""
_MAX_GAP_M = 0.5
_MAX_ANGLE_DEG = 15.0


@dataclass(frozen=True)
class UndrawnWall:
    """Scanned pieces in one line that no wall of the plan takes up."""

    middle_xy: tuple[float, float]
    """Plan frame, m."""
    length: float
    """m"""
    n_patches: int


def undrawn_walls(
    patches: WallPatches, association: Association, plan_from_cams: np.ndarray
) -> list[UndrawnWall]:
    """Pieces without a face, joined where they are in line and near; longest first.

    A line of fewer than `FEW_PATCHES` pieces or of less than half a metre is left out.
    """
    normals, ends = wall_patches_in_plan(patches, plan_from_cams)
    alone = association.face_idx < 0
    normals, ends = normals[alone], ends[alone]
    if len(ends) == 0:
        return []
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    middle = ends.mean(axis=1)
    near = cKDTree(middle).query_pairs(float(length.max()) + _MAX_GAP_M, output_type="ndarray")
    i, j = near.T
    between = middle[j] - middle[i]
    along = np.column_stack([-normals[:, 1], normals[:, 0]])
    joined = (
        (np.sum(normals[i] * normals[j], axis=1) > np.cos(np.deg2rad(_MAX_ANGLE_DEG)))
        & (np.abs(np.sum(between * normals[i], axis=1)) < _SAME_WALL_M)
        & (np.abs(np.sum(between * normals[j], axis=1)) < _SAME_WALL_M)
        & (np.abs(np.sum(between * along[i], axis=1)) < (length[i] + length[j]) / 2 + _MAX_GAP_M)
    )
    graph = sparse.coo_array(
        (np.ones(joined.sum()), (i[joined], j[joined])), shape=(len(ends), len(ends))
    )
    _, group = connected_components(graph, directed=False)
    walls = []
    for k in np.flatnonzero(np.bincount(group) >= FEW_PATCHES):
        own = ends[group == k].reshape(-1, 2)
        centre = own.mean(axis=0)
        direction = np.linalg.svd(own - centre, full_matrices=False)[2][0]
        at = (own - centre) @ direction
        extent = float(at.max() - at.min())
        if extent >= _MIN_LENGTH_M:
            x, y = centre + direction * (at.max() + at.min()) / 2
            walls.append(UndrawnWall((float(x), float(y)), extent, int(len(own) // 2)))
    return sorted(walls, key=lambda wall: (-wall.length, wall.middle_xy))


def unseen_faces(floorplan: Floorplan, association: Association, crop: Crop) -> np.ndarray:
    """(k,) faces within a crop, half a metre long or more, that no piece belongs to; longest first."""
    seen = np.isin(np.arange(len(floorplan)), association.face_idx)
    inside = crop.contains(floorplan.ends.mean(axis=1))
    unseen = np.flatnonzero(~seen & inside & (floorplan.lengths >= _MIN_LENGTH_M))
    return unseen[np.argsort(-floorplan.lengths[unseen], kind="stable")]

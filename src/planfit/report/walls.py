"""The walls of the plan against those of the scan: how far each drawn face is from where it was scanned,
what was scanned but not drawn, and what was drawn but not scanned."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from planfit.adjust import PlanAdjustment
from planfit.adjust.association import Association, wall_patches_in_plan
from planfit.floorplan import Floorplan
from planfit.report import formatting
from planfit.report.plots.top_view import Crop
from planfit.segmentation import WallPatches

AGREES_WITHIN_M = 0.05
FEW_PATCHES = 3
"""With fewer wall patches a face's offset may be an accident."""
_MIN_LENGTH_M = 0.5
_SAME_WALL_M = 0.15
"""Patches whose lines are this far apart at most belong to one wall."""
_MAX_GAP_M = 0.5
_MAX_ANGLE_DEG = 15.0


@dataclass(frozen=True)
class SeenFace:
    """A face of the plan with the wall patches of the scan that belong to it."""

    number: int
    """1 for the face with most patches."""
    face_idx: int
    middle_xy: tuple[float, float]
    """Plan frame, m."""
    length: float
    """m"""
    n_patches: int
    offset: float
    """Median of the patches' offsets, m; positive towards the face's normal."""
    mad: float
    """Median absolute deviation from it, m."""
    is_oriented: bool
    solved: tuple[float, float] | None = None
    """Offset that the adjustment gave the face, and its sigma, m, where it gave any."""

    @property
    def agrees(self) -> bool:
        """Whether the scanned wall lies where it is drawn."""
        return abs(self.offset) <= AGREES_WITHIN_M

    @property
    def is_displaced(self) -> bool:
        """Whether enough patches say that it does not."""
        return not self.agrees and self.n_patches >= FEW_PATCHES

    @property
    def verdict(self) -> str:
        """In words."""
        if self.agrees:
            words = f"agrees within {100 * AGREES_WITHIN_M:.0f}{formatting.SPACE}cm"
        else:
            words = f"displaced by {formatting.centimetres(abs(self.offset))}"
            if self.is_oriented:
                words += " into the room" if self.offset > 0 else " into the wall"
        if self.n_patches < FEW_PATCHES:
            words += f" (only {self.n_patches} patch{'es' if self.n_patches > 1 else ''})"
        return words


def seen_faces(floorplan: Floorplan, walls: PlanAdjustment) -> list[SeenFace]:
    """Faces with wall patches, most patches first."""
    association, sigmas_m = walls.association, walls.offset_sigmas_m
    seen, counts = np.unique(association.face_idx[association.face_idx >= 0], return_counts=True)
    faces = []
    for number, k in enumerate(np.lexsort((seen, -counts)), start=1):
        face = int(seen[k])
        offsets = association.distance_m[association.face_idx == face]
        x, y = floorplan.ends[face].mean(axis=0)
        median = float(np.median(offsets))
        faces.append(
            SeenFace(
                number=number,
                face_idx=face,
                middle_xy=(float(x), float(y)),
                length=float(floorplan.lengths[face]),
                n_patches=int(counts[k]),
                offset=median,
                mad=float(np.median(np.abs(offsets - median))),
                is_oriented=bool(floorplan.is_oriented[face]),
                solved=(float(walls.offsets_m[face]), float(sigmas_m[face]))
                if face < len(sigmas_m) and np.isfinite(sigmas_m[face])
                else None,
            )
        )
    return faces


@dataclass(frozen=True)
class UndrawnWall:
    """Scanned patches in one line that no wall of the plan takes up."""

    middle_xy: tuple[float, float]
    """Plan frame, m."""
    length: float
    """m"""
    n_patches: int


def undrawn_walls(
    patches: WallPatches,
    association: Association,
    plan_from_cams: Float[np.ndarray, "n 4 4"],
) -> list[UndrawnWall]:
    """Patches without a face, joined where they are in line and near; longest first.

    A line of fewer than `FEW_PATCHES` patches or of less than half a metre is left out.
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
    # Patches that are joined pairwise are one wall: connected components of the graph of pairs.
    _, group = connected_components(graph, directed=False)
    walls = []
    for k in np.flatnonzero(np.bincount(group) >= FEW_PATCHES):
        own = ends[group == k].reshape(-1, 2)
        centre = own.mean(axis=0)
        # The first right singular vector is the direction in which the ends extend most.
        direction = np.linalg.svd(own - centre, full_matrices=False)[2][0]
        at = (own - centre) @ direction
        extent = float(at.max() - at.min())
        if extent >= _MIN_LENGTH_M:
            x, y = centre + direction * (at.max() + at.min()) / 2
            walls.append(UndrawnWall((float(x), float(y)), extent, int(len(own) // 2)))
    return sorted(walls, key=lambda wall: (-wall.length, wall.middle_xy))


def unseen_faces(
    floorplan: Floorplan, association: Association, crop: Crop
) -> Int[np.ndarray, " k"]:
    """Faces within a crop, half a metre long or more, that no patch belongs to; longest first."""
    seen = np.isin(np.arange(len(floorplan)), association.face_idx)
    inside = crop.contains(floorplan.ends.mean(axis=1))
    unseen = np.flatnonzero(~seen & inside & (floorplan.lengths >= _MIN_LENGTH_M))
    return unseen[np.argsort(-floorplan.lengths[unseen], kind="stable")]

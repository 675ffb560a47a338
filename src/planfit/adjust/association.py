"""Which face of the plan each piece of scanned wall belongs to."""

from dataclasses import dataclass

import numpy as np

from planfit.errors import require_positive, require_share
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.segmentation import WallPatches


@dataclass(frozen=True)
class AssociationOptions:
    """When a piece of wall may belong to a face."""

    max_angle_deg: float = 12.0
    """Largest angle between the piece and the face."""
    min_overlap: float = 0.5
    """Share of the piece that must lie beside the face."""
    end_margin_m: float = 0.3
    """A piece may reach beyond the end of its face by this much and still count as beside it."""
    oriented: bool = True
    """Match a piece only to faces that look to the side it was seen from, where the plan knows that side.
    The paper does not ask."""

    def __post_init__(self) -> None:
        require_positive(self, "max_angle_deg")
        require_share(self, "min_overlap")


@dataclass(frozen=True)
class Association:
    """For each piece its face, or -1."""

    face_idx: np.ndarray  # (k,)
    distance_m: np.ndarray  # (k,) signed, along the face's normal; NaN where there is no face

    @property
    def n_associated(self) -> int:
        """Pieces that have a face."""
        return int(np.sum(self.face_idx >= 0))


def associate(
    patches: WallPatches,
    floorplan: Floorplan,
    plan_from_cams: np.ndarray,
    max_distance_m: float,
    options: AssociationOptions,
) -> Association:
    """Nearest face of each piece that looks the same way and lies beside it, within a distance.

    A face that looks into a room is matched only by wall seen from inside that room: normals must
    agree in sign. Faces whose free side is unknown are matched from either side.
    """
    normals, ends = wall_patches_in_plan(patches, plan_from_cams)
    k = len(patches)
    face_idx, best = np.full(k, -1), np.full(k, np.inf)
    signed = np.full(k, np.nan)
    one_sided = floorplan.is_oriented & options.oriented
    cosine_limit = np.cos(np.deg2rad(options.max_angle_deg))
    for begin in range(0, k, 2048):  # bounds the (pieces x faces) tables
        part = slice(begin, min(begin + 2048, k))
        cosine = normals[part] @ floorplan.normals.T
        looks_alike = np.where(one_sided, cosine, np.abs(cosine)) > cosine_limit
        middle = ends[part].mean(axis=1)
        distance = middle @ floorplan.normals.T - floorplan.offsets
        beside = _share_beside(ends[part], floorplan, options.end_margin_m)
        ok = looks_alike & (np.abs(distance) < max_distance_m) & (beside >= options.min_overlap)
        score = np.where(ok, np.abs(distance), np.inf)
        rows = np.arange(score.shape[0])
        nearest = np.argmin(score, axis=1)
        best[part] = score[rows, nearest]
        found = np.isfinite(best[part])
        face_idx[part] = np.where(found, nearest, -1)
        signed[part] = np.where(found, distance[rows, nearest], np.nan)
    return Association(face_idx, signed)


def wall_patches_in_plan(
    patches: WallPatches, plan_from_cams: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Normals (k, 2), unit, and ends (k, 2, 2) m of upright pieces, plan frame, seen from above."""
    poses = plan_from_cams[patches.frame_idx]
    normals = np.einsum("kab,kb->ka", poses[:, :2, :3], patches.normals_cam)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    ends = se3.transform(poses, patches.ends_cam)[..., :2]
    return normals, ends


def _share_beside(ends: np.ndarray, floorplan: Floorplan, margin_m: float) -> np.ndarray:
    """Share (k, n) of each piece (k, 2, 2) that lies beside each face, ends widened by a margin."""
    along = (floorplan.ends[:, 1] - floorplan.ends[:, 0]) / floorplan.lengths[:, None]
    at = (
        np.einsum("kei,ni->kne", ends, along)
        - np.einsum("ni,ni->n", floorplan.ends[:, 0], along)[:, None]
    )
    low, high = at.min(axis=2), at.max(axis=2)
    shared = np.minimum(high, floorplan.lengths + margin_m) - np.maximum(low, -margin_m)
    return shared / np.maximum(high - low, 1e-9)

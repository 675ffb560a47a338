"""Which face of the plan each piece of scanned wall belongs to."""

from dataclasses import dataclass

import numpy as np

from planfit.errors import require_positive, require_share
from planfit.floorplan import Floorplan
from planfit.floorplan.nearest_faces import END_MARGIN_M, nearest_of_segments
from planfit.geometry import se3
from planfit.segmentation import WallPatches


@dataclass(frozen=True)
class AssociationOptions:
    """When a piece of wall may belong to a face."""

    max_angle_deg: float = 12.0
    """Largest angle between the piece and the face."""
    min_overlap: float = 0.5
    """Share of the piece that must lie beside the face."""
    end_margin_m: float = END_MARGIN_M
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
    signed, face_idx = nearest_of_segments(
        ends,
        normals,
        floorplan,
        max_distance_m,
        options.max_angle_deg,
        options.min_overlap,
        options.end_margin_m,
        options.oriented,
    )
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

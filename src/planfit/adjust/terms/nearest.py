"""Walls term, nearest point and iterative nearest wall (paper, Sec. III-E, Eq. L_walls^NP, L_walls^INW).

For each wall point the nearest point of the plan is searched again at every reweighting, among the
faces themselves and not among samples of them. Seen from above, since walls are upright and the paper's
3D plan reaches as high as the scan:

- nearest point: the point is held to that point, an end of the face where it lies beyond;
- iterative nearest wall: the point is held to the line of that face, and may slide along it.

The nearest point found anew is never further than the old one, so nearest-point rounds never raise the
cost. The line of a new face may be further, so iterative nearest wall has no such promise.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float

from planfit.adjust.association import wall_patches_in_plan
from planfit.adjust.terms.nearest_kernels import (
    correspondence_cost,
    correspondence_weights,
    squared_distances,
    sum_correspondences,
)
from planfit.adjust.terms.observation_models import ObservationModel
from planfit.errors import OptionError, require_choice, require_positive
from planfit.floorplan import Floorplan
from planfit.floorplan.nearest_faces import FaceGrid, make_face_grid
from planfit.geometry.se3 import Poses
from planfit.lsq.blocks import NormalBlocks
from planfit.lsq.robust import loss_value
from planfit.segmentation import WallPatches


@dataclass(frozen=True)
class NearestTerm:
    """Sum over wall points of rho(distance to the nearest face's nearest point, or its line / sigma)."""

    patches: WallPatches
    floorplan: Floorplan
    model: ObservationModel
    to: Literal["point", "line"] = "line"
    """`point`: nearest point; `line`: iterative nearest wall."""
    max_distance_m: float = 1.0
    """A point further than this from every face is not held, and costs as much as at this distance.
    The paper knows no limit: give one longer than the plan."""
    oriented: bool = True
    """Hold a point only to faces that look to the side it was seen from, where the plan knows that
    side. The paper does not ask; a point may then be held to the far face of a thick wall."""
    name: str = "walls"

    def __post_init__(self) -> None:
        require_positive(self, "max_distance_m")
        require_choice(self, "to", "point", "line")
        if not np.isfinite(self.max_distance_m):
            raise OptionError(
                f"NearestTerm.max_distance_m: expected a finite number, found {self.max_distance_m}"
            )

    @cached_property
    def grid(self) -> FaceGrid:
        """The faces, sorted for the search."""
        return make_face_grid(self.floorplan, self.max_distance_m, self.oriented)

    def reweight(self, target_from_cams: Poses) -> tuple["NearestPointCorrespondences", float]:
        """Nearest faces and weights at plan_from_cams."""
        model, patches = self.model, self.patches
        points, start = patches.points_cam, patches.start
        poses = target_from_cams[patches.frame_idx]
        patch_normals, _ = wall_patches_in_plan(patches, target_from_cams)
        face_idx, feet, gaps = self.grid.nearest(points, start, poses, patch_normals)
        normals, to_line = np.ascontiguousarray(self.floorplan.normals), self.to == "line"
        squared = squared_distances(face_idx, gaps, normals, to_line, self.max_distance_m)
        squared /= model.sigma**2
        rho, weight = loss_value(squared, model.loss)
        counts = np.diff(start)
        information = model.weight * model.weight_per_point(counts)
        per_m2 = information / model.sigma**2
        matrices = correspondence_weights(face_idx, normals, to_line, start, per_m2, weight)
        cost = 0.5 * float(np.repeat(information, counts) @ rho)
        return NearestPointCorrespondences(patches, feet, matrices), cost


@dataclass(frozen=True)
class NearestPointCorrespondences:
    """Wall points with the points of the plan they are held to, weights frozen."""

    patches: WallPatches
    feet: Float[np.ndarray, "m 2"]
    """Metres, plan frame."""
    information: Float[np.ndarray, "m 3"]
    """1/m^2: xx, xy and yy of each point's 2x2 weight."""

    def cost(self, target_from_cams: Poses) -> float:
        """Half the weighted sum of squares."""
        s = self.patches
        poses = target_from_cams[s.frame_idx]
        return float(correspondence_cost(s.points_cam, s.start, poses, self.feet, self.information))

    def normal_blocks(self, target_from_cams: Poses) -> NormalBlocks:
        """Gauss-Newton blocks of each frame."""
        s, n = self.patches, len(target_from_cams)
        poses = target_from_cams[s.frame_idx]
        blocks, gradient = np.zeros((n, 6, 6)), np.zeros((n, 6))
        args = (s.points_cam, s.start, s.frame_idx, poses)
        sum_correspondences(*args, self.feet, self.information, blocks, gradient)
        idx = np.arange(n)
        return NormalBlocks(idx, idx, blocks, gradient)

"""Walls term, fixed nearest wall (paper, Eq. L_walls^FNW): wall points lie on the plan's wall planes.

The association is made once from the current poses (`planfit.adjust.association`) and kept while the
poses are solved for. The paper's formula writes the same letter for the scan's plane and the plan's;
the plan's is meant, else nothing would hold the scan to the plan.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.association import Association
from planfit.adjust.terms.groups import PlaneGroups
from planfit.adjust.terms.observation_models import ObservationModel
from planfit.floorplan import Floorplan
from planfit.geometry.se3 import Poses
from planfit.lsq.moments import PlaneMoments
from planfit.lsq.torch_moments import GroupedPoints
from planfit.segmentation import WallPatches


@dataclass(frozen=True)
class WallTerm:
    """Sum over associated wall points of rho(dist(T_i p, face) / sigma)."""

    patches: WallPatches
    floorplan: Floorplan
    association: Association
    model: ObservationModel
    name: str = "walls"
    offsets_m: Float[np.ndarray, " f"] | None = None
    """Of each face along its normal from where it is drawn; None: as drawn."""
    device: str = "cpu"
    """Where the points are reweighted; "cuda" asks for PyTorch."""
    widths: Float[np.ndarray, " k"] | None = None
    """Factor on the scale of each patch's loss, 1 or more: how much further the patch reaches (graduated
    non-convexity, patch by patch). None: the loss as it stands. On the CPU only."""

    @cached_property
    def _on_device(self) -> GroupedPoints:
        return GroupedPoints(self.device, self.patches.start, self.patches.points_cam)

    @property
    def groups(self) -> PlaneGroups:
        """The wall points of each patch on the plane of its face, the loss as it stands."""
        patches, face = self.patches, self.association.face_idx
        planes = face_planes(self.floorplan, face)
        if self.offsets_m is not None:
            planes[:, 3] -= self.offsets_m[face]
        information = self.model.weight_per_point(np.diff(patches.start))
        return PlaneGroups(
            patches.points_cam,
            patches.start,
            patches.frame_idx,
            planes,
            self.model.weight * np.where(face >= 0, information, 0.0),
            self.model.sigma,
            self.model.loss,
        )

    def reweight(self, target_from_cams: Poses) -> tuple[PlaneMoments, float]:
        """One pass over the wall points; see `planfit.lsq.moments`."""
        if self.widths is not None:
            return self._widened(self.widths, target_from_cams)
        return self.groups.moments(
            target_from_cams, None if self.device == "cpu" else self._on_device
        )

    def _widened(
        self, by: Float[np.ndarray, " k"], target_from_cams: Poses
    ) -> tuple[PlaneMoments, float]:
        """The same, each loss at its own width.

        A loss of scale w c is w^2 times that of scale c at a distance w times as small. The weights of the
        points then are those of the small distance, so the factor w^2 is taken out of the moments again.
        """
        groups = self.groups
        smaller = replace(
            groups,
            planes=groups.planes / by[:, None],
            weight_per_point=groups.weight_per_point * by**2,
        )
        found, cost = smaller.moments(target_from_cams)
        moments = found.moments / (by**2)[:, None, None]
        return PlaneMoments(found.pose_idx, groups.planes, moments), cost


def observations_of(patches: WallPatches, model: ObservationModel) -> Float[np.ndarray, " k"]:
    """Effective observations that each patch is worth, times the term's weight."""
    n_points = np.diff(patches.start)
    return model.weight * model.weight_per_point(n_points) * n_points


def face_planes(floorplan: Floorplan, face_idx: Int[np.ndarray, " k"]) -> Float[np.ndarray, "k 4"]:
    """Planes (normal, -offset) in the plan frame, of faces; of -1, any plane."""
    planes = np.zeros((len(face_idx), 4))
    planes[:, :2] = floorplan.normals[face_idx]
    planes[:, 3] = -floorplan.offsets[face_idx]
    return planes

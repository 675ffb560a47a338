"""Walls term, fixed nearest wall (paper, Eq. L_walls^FNW): wall points lie on the plan's wall planes.

The association is made once from the current poses (`planfit.adjust.association`) and kept while the
poses are solved for. The paper's formula writes the same letter for the scan's plane and the plan's;
the plan's is meant, else nothing would hold the scan to the plan.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.association import Association
from planfit.adjust.terms.effective_observations import Weighting
from planfit.adjust.terms.groups import PlaneGroups
from planfit.errors import require_positive
from planfit.floorplan import Floorplan
from planfit.lsq.moments import PlaneMoments
from planfit.lsq.robust import Loss, LossKind
from planfit.lsq.torch_moments import GroupedPoints
from planfit.segmentation import WallPatches


@dataclass(frozen=True)
class WallOptions:
    """Weight, sigma and loss of the walls term."""

    weight: float = 1.0
    """Factor on the term; 0 switches it off."""
    sigma_m: float = 0.05
    """Sigma of wall points about the drawn wall: as drawn, as built, as measured."""
    loss: Loss = field(default_factory=lambda: Loss(LossKind.GEMAN_MCCLURE, 0.8))
    """Robust loss of the distance in sigmas. It levels off, because a wall that is drawn decimetres
    off is seen by many frames, which must not act together: with 30 % of walls drawn 0.1 to 0.5 m off,
    20 runs err by 0.0084 m in the median, 0.04 m at worst (benchmarks/robustness.py); with a Cauchy loss of
    scale 2 by several times that. A scale of 0.7 lets go of right walls where no loop is closed and costs
    4 % of accuracy on an 80-frame scan with a right plan."""
    max_observations: float = 4.0
    """Effective observations that a wall patch is worth at most."""
    points_per_observation: float = 60.0
    """Wall points that make one observation."""
    offset_sigma_m: float = 0.0
    """Sigma of faces about where they are drawn, one unknown offset a face; 0: faces are as drawn. Worth
    it where the whole plan is a few centimetres off: with 3 cm, a sigma of 2 cm brings the error from
    0.022 to 0.017 m; but from 0.007 to 0.008 m on a right plan, and where some walls are decimetres off
    it lets them act (0.013 to 0.08 m), so it is off by default."""

    def __post_init__(self) -> None:
        require_positive(self, "sigma_m", "max_observations", "points_per_observation")


@dataclass(frozen=True)
class WallTerm:
    """Sum over associated wall points of rho(dist(T_i p, face) / sigma)."""

    patches: WallPatches
    floorplan: Floorplan
    association: Association
    options: WallOptions
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
        weighting = Weighting(self.options.max_observations, self.options.points_per_observation)
        information = weighting.weight_per_point(np.diff(patches.start))
        return PlaneGroups(
            patches.points_cam,
            patches.start,
            patches.frame_idx,
            planes,
            self.options.weight * np.where(face >= 0, information, 0.0),
            self.options.sigma_m,
            self.options.loss,
        )

    def reweight(self, target_from_cams: Float[np.ndarray, "n 4 4"]) -> tuple[PlaneMoments, float]:
        """One pass over the wall points; see `planfit.lsq.moments`."""
        if self.widths is not None:
            return self._widened(self.widths, target_from_cams)
        return self.groups.moments(
            target_from_cams, None if self.device == "cpu" else self._on_device
        )

    def _widened(
        self, by: Float[np.ndarray, " k"], target_from_cams: Float[np.ndarray, "n 4 4"]
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


def observations_of(patches: WallPatches, options: WallOptions) -> Float[np.ndarray, " k"]:
    """Effective observations that each patch is worth, times the term's weight."""
    n_points = np.diff(patches.start)
    weighting = Weighting(options.max_observations, options.points_per_observation)
    return options.weight * weighting.weight_per_point(n_points) * n_points


def face_planes(floorplan: Floorplan, face_idx: Int[np.ndarray, " k"]) -> Float[np.ndarray, "k 4"]:
    """Planes (normal, -offset) in the plan frame, of faces; of -1, any plane."""
    planes = np.zeros((len(face_idx), 4))
    planes[:, :2] = floorplan.normals[face_idx]
    planes[:, 3] = -floorplan.offsets[face_idx]
    return planes

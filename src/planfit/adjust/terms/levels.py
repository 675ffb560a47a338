"""Floor term (paper, Eq. L_floor), and the same for ceilings: points lie on level planes that are fixed.

The paper fits one plane to the whole floor. Here each storey has its own, and so has each height of
ceiling: the ceiling term is that of the method's successor for building models, which names floor,
ceiling, walls and columns alike.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from planfit.adjust.terms.groups import PlaneGroups
from planfit.adjust.terms.observation_models import ObservationModel
from planfit.geometry.se3 import Poses
from planfit.lsq.moments import PlaneMoments
from planfit.lsq.torch_moments import GroupedPoints
from planfit.segmentation import LevelPoints, Structure

FLOOR_PLANE = np.array([0.0, 0.0, 1.0, 0.0])
"""z = 0 of the level and the plan frame."""


@dataclass(frozen=True)
class LevelTerm:
    """Sum over points of rho((z of T_i p - height of the frame's plane) / sigma)."""

    points: LevelPoints
    heights_m: Float[np.ndarray, " n"]
    """Height of the plane that each frame's points belong on, target frame; NaN: on none."""
    model: ObservationModel
    name: str
    device: str = "cpu"
    """Where the points are reweighted; "cuda" asks for PyTorch."""

    @cached_property
    def _on_device(self) -> GroupedPoints:
        return GroupedPoints(self.device, self.points.start, self.points.points_cam)

    @property
    def groups(self) -> PlaneGroups:
        """The points of each frame on its plane."""
        start = self.points.start
        information = self.model.weight * self.model.weight_per_point(np.diff(start))
        return PlaneGroups(
            self.points.points_cam,
            start,
            np.arange(len(start) - 1),
            level_planes(self.heights_m),
            np.where(np.isfinite(self.heights_m), information, 0.0),
            self.model.sigma,
            self.model.loss,
        )

    def reweight(self, target_from_cams: Poses) -> tuple[PlaneMoments, float]:
        """One pass over the points; see `planfit.lsq.moments`."""
        return self.groups.moments(
            target_from_cams, None if self.device == "cpu" else self._on_device
        )


def floor_term(structure: Structure, model: ObservationModel, device: str = "cpu") -> LevelTerm:
    """The floor: z = 0, or the height of the storey that a frame stands on."""
    return LevelTerm(structure.floor, structure.floor_heights_m, model, "floor", device)


def level_planes(heights_m: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 4"]:
    """Planes (normal, -offset) at heights (m); at z = 0 where there is no height."""
    planes = np.tile(FLOOR_PLANE, (len(heights_m), 1))
    planes[:, 3] = -np.nan_to_num(heights_m)
    return planes

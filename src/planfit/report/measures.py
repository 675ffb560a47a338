"""The scan before and after, placed once for all plots; its metrics are those of `planfit.evaluation`."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.evaluation import (
    FloorHeights,
    WallDistances,
    floor_heights,
    wall_distances,
    wall_points,
)
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.pipeline.result import RefineResult
from planfit.segmentation import Structure

_MAX_DRAWN = 600_000
"""Points that plots take, evenly thinned, which bounds memory: more dots than a picture has pixels show
nothing new. Metrics are taken of all points."""


@dataclass(frozen=True)
class Measures:
    """The scan at one set of poses, in the plan frame."""

    trajectory: Float[np.ndarray, "n 3"]
    """Camera centres, m."""
    walls: WallDistances | None
    """Of all wall points; None where no wall was seen."""
    floor: FloorHeights | None
    """Of all floor points; None where no floor was seen."""
    wall_xy: Float[np.ndarray, "w 2"]
    """Wall points from above, m; thinned for plots."""
    wall_distances_m: Float[np.ndarray, " w"]
    """Distance of these to the nearest face of the plan."""
    floor_points: Float[np.ndarray, "f 3"]
    """Floor points, m, heights above the floor of their storey; thinned for plots."""


@dataclass(frozen=True)
class BeforeAfter:
    """Measures before and after; points correspond one to one."""

    before: Measures
    after: Measures
    is_aligned: bool
    """Whether the scan was aligned with the plan by its walls; else distances to it mean nothing."""
    correction: Float[np.ndarray, "n 6"]
    """[rad, m] of each frame, from before to after: rotation and translation of the camera."""

    @property
    def has_walls(self) -> bool:
        """Whether there are wall points whose distances to the plan mean something."""
        return self.is_aligned and self.before.walls is not None

    @property
    def has_floor(self) -> bool:
        """Whether floor was seen."""
        return self.before.floor is not None


def measure(floorplan: Floorplan, result: RefineResult) -> BeforeAfter:
    """Place walls, floor and cameras of a result at its poses before and after."""
    poses = (result.initial_plan_from_cams, result.plan_from_cams)
    before, after = (_measure_at(floorplan, result.structure, p) for p in poses)
    return BeforeAfter(
        before, after, result.alignment is not None, se3.difference(poses[1], poses[0])
    )


def _measure_at(
    floorplan: Floorplan, structure: Structure, plan_from_cams: Float[np.ndarray, "n 4 4"]
) -> Measures:
    walls = wall_distances(structure, floorplan, plan_from_cams)
    floor = floor_heights(structure, plan_from_cams)
    floor_points = np.zeros((0, 3)) if floor is None else floor.points
    return Measures(
        trajectory=plan_from_cams[:, :3, 3],
        walls=walls,
        floor=floor,
        wall_xy=_thinned(wall_points(structure, plan_from_cams)[:, :2]),
        wall_distances_m=np.zeros(0) if walls is None else _thinned(walls.nearest_m),
        floor_points=_thinned(floor_points),
    )


def _thinned(points: Float[np.ndarray, "m ..."]) -> Float[np.ndarray, "w ..."]:
    return points[:: max(1, len(points) // _MAX_DRAWN)]

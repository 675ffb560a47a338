"""Walls and floor of a scan against the plan, before and after: computed once for all pictures."""

from dataclasses import dataclass

import numpy as np

from planfit.floorplan import Floorplan, nearest_faces
from planfit.geometry import se3
from planfit.pipeline import validation as checks
from planfit.pipeline.refine import RefineResult

_MAX_DISTANCES = 60_000  # as checks.wall_distances, so that both give the same numbers
_MAX_DRAWN = 600_000  # bounds memory; more dots than a picture has pixels show nothing new


@dataclass(frozen=True)
class Measures:
    """The scan at one set of poses, in the plan frame."""

    trajectory: np.ndarray  # (n, 3) m, camera centres
    wall_xy: (
        np.ndarray
    )  # (w, 2) m, wall points from above; evenly thinned where there are very many
    sample_xy: np.ndarray  # (m, 2) m, wall points, thinned further
    sample_distances: np.ndarray  # (m,) m, of those to the nearest segment of the plan
    floor_xy: np.ndarray  # (f, 2) m
    floor_heights: np.ndarray  # (f,) m, above the floor plane

    @property
    def nsd(self) -> float | None:
        """Mean distance (m) of wall points to the nearest plan segment (paper, Sec. IV-B)."""
        return float(self.sample_distances.mean()) if len(self.sample_distances) else None

    @property
    def near_share(self) -> float | None:
        """Share of wall points within `checks.NEAR_FACE_M` of the plan."""
        if len(self.sample_distances) == 0:
            return None
        return float(np.mean(self.sample_distances < checks.NEAR_FACE_M))

    @property
    def floor_rms(self) -> float | None:
        """Root mean square (m) of floor heights about their mean."""
        return float(np.std(self.floor_heights)) if len(self.floor_heights) else None

    @property
    def floor_median(self) -> float | None:
        """Height (m) off the floor plane within which half of the floor points lie."""
        heights = np.abs(self.floor_heights)
        return float(np.median(heights)) if len(heights) else None


@dataclass(frozen=True)
class BeforeAfter:
    """Measures before and after; points correspond one to one."""

    before: Measures
    after: Measures
    is_placed: bool
    """Whether the scan was placed on the plan by its walls; else distances to it mean nothing."""
    correction: np.ndarray
    """(n, 6) [rad, m] of each frame, from before to after: turn and shift of the camera."""

    @property
    def has_walls(self) -> bool:
        """Whether there are wall points whose distances to the plan mean something."""
        return self.is_placed and len(self.before.sample_distances) > 0

    @property
    def has_floor(self) -> bool:
        """Whether floor was seen."""
        return len(self.before.floor_heights) > 0


def measure(floorplan: Floorplan, result: RefineResult) -> BeforeAfter:
    """Place walls, floor and cameras of a result at its poses before and after."""
    poses = (result.initial_plan_from_cams, result.plan_from_cams)
    before, after = (_measure_at(floorplan, result, plan_from_cams) for plan_from_cams in poses)
    return BeforeAfter(
        before, after, result.alignment is not None, se3.difference(poses[1], poses[0])
    )


def _measure_at(floorplan: Floorplan, result: RefineResult, plan_from_cams: np.ndarray) -> Measures:
    structure = result.structure
    wall = checks.wall_points_plan(structure, plan_from_cams, _MAX_DRAWN)
    sample = checks.wall_points_plan(structure, plan_from_cams, _MAX_DISTANCES)
    floor = checks.floor_points(structure, plan_from_cams, _MAX_DRAWN)
    return Measures(
        trajectory=plan_from_cams[:, :3, 3],
        wall_xy=wall[:, :2],
        sample_xy=sample[:, :2],
        sample_distances=nearest_faces.nearest_distance(sample[:, :2], floorplan.ends),
        floor_xy=floor[:, :2],
        floor_heights=floor[:, 2],
    )

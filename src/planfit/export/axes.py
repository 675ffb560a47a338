"""The axes of a plan's own file, and those of the map it lies on, with heights: for poses and points that
other programs hold beside the plan."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from planfit.errors import OutputError
from planfit.floorplan.formats.georeference import SAME_SCALE
from planfit.floorplan.types import PlanSource
from planfit.geometry import se3

PoseFrame = Literal["world", "plan", "file", "map"]
"""Axes of what is exported: the scan's own, the plan's (m, z up, floor at 0), those of the plan's file in its
unit, or eastings, northings and heights (m)."""
METRES_ALONE = ("g2o", "cloud", "colmap", "nerfstudio", "rosbag")
"""Forms that hold other lengths beside poses, or are in metres by convention (REP 103 of ROS)."""
_LONGEST_UNIT_M = 1000.0
"""Coordinates that count more are degrees."""


@dataclass(frozen=True)
class PlanAxes:
    """Other axes than those of the plan frame: uneven scales stretch positions, and turn nothing."""

    target_from_plan: Float[np.ndarray, "4 4"]
    """Affine, of lengths in m; it keeps the sense of rotations: where y runs down, z does."""

    @property
    def metres_per_unit(self) -> float:
        """Of the target's coordinates."""
        return float(abs(np.linalg.det(self.target_from_plan[:3, :3])) ** (-1 / 3))

    @property
    def words(self) -> str:
        """What is not as usual, for people."""
        unit = self.metres_per_unit
        told = [] if abs(unit - 1) < SAME_SCALE else [f"lengths in {unit:.6g} m"]
        return ", ".join([*told, *(["z down"] if self.target_from_plan[2, 2] < 0 else [])])

    def points(self, points_plan: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """Points of the plan frame (m) in these axes."""
        return se3.transform(self.target_from_plan, points_plan)

    def poses(self, plan_from_cams: Float[np.ndarray, "n 4 4"]) -> Float[np.ndarray, "n 4 4"]:
        """Poses of cameras in these axes, positions in their unit."""
        turn = se3.project_to_so3(self.target_from_plan[:3, :3] * self.metres_per_unit)
        places = self.points(plan_from_cams[:, :3, 3])
        return se3.make_transform(turn @ plan_from_cams[:, :3, :3], places)


def file_axes(source: PlanSource) -> PlanAxes | None:
    """Of the plan's own file, heights from its own zero; None where it has none, or they are degrees."""
    if source.file_from_plan is None:
        return None
    up = np.eye(4)
    up[2, 3] = source.elevation_m
    return _checked(_raised(source.file_from_plan) @ up)


def map_axes(source: PlanSource) -> PlanAxes | None:
    """Of the map, m; None where the file does not tell where on one it lies, or that is in degrees."""
    own = file_axes(source)
    if own is None or source.map_from_file is None:
        return None
    target_from_plan = _raised(source.map_from_file) @ own.target_from_plan
    target_from_plan[2, 3] += source.map_height_m
    return _checked(target_from_plan)


AXES = {"file": file_axes, "map": map_axes}
"""By the name of the frame."""


def axes_record(source: PlanSource | None) -> dict[str, list[list[float]] | None]:
    """Both as plain values, for `run.json`."""
    found = {name: None if source is None else of(source) for name, of in AXES.items()}
    return {
        f"{name}_from_plan": None if axes is None else axes.target_from_plan.tolist()
        for name, axes in found.items()
    }


def require_axes(frame: str, axes: PlanAxes | None, to: str, where: str) -> PlanAxes:
    """The axes, if a form (`to`) can be written in them.

    Raises:
        OutputError: there are none, or the form needs metres; it begins with `where`.
    """
    if axes is None:
        needed = "coordinates of its own" if frame == "file" else "a map conversion or a world file"
        others = ", ".join(name for name in get_args(PoseFrame) if name != frame)
        raise OutputError(
            f"{where}: expected a run on a plan with {needed}, in lengths, not degrees, for frame {frame}, "
            f"found none; take one of {others}, or refine again if the run is of an older version"
        )
    if to in METRES_ALONE and abs(axes.metres_per_unit - 1) > SAME_SCALE:
        raise OutputError(
            f"{where}: expected axes in metres for {to}, found lengths in {axes.metres_per_unit:.6g} m of "
            f"frame {frame}; take frame map or plan, or another form"
        )
    return axes


def _raised(affine: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4 4"]:
    """An affine map of the plane with heights at its mean scale, downwards where it mirrors."""
    found = np.eye(4)
    found[np.ix_([0, 1], [0, 1, 3])] = affine[:2]
    determinant = float(np.linalg.det(affine[:2, :2]))
    found[2, 2] = np.sign(determinant) * np.sqrt(abs(determinant))
    return found


def _checked(target_from_plan: Float[np.ndarray, "4 4"]) -> PlanAxes | None:
    """None where a metre is not as long to all sides, or too short, as in degrees."""
    least, *_, most = np.sort(np.linalg.svd(target_from_plan[:3, :3], compute_uv=False))
    if most > least * (1 + SAME_SCALE) or most * _LONGEST_UNIT_M < 1 - SAME_SCALE:
        return None
    return PlanAxes(target_from_plan)

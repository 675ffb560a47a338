"""What a surveyor gives, and what the scan sees of it."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import OptionError
from planfit.findings import some_ids
from planfit.geometry.calibration import SensorCalibration
from planfit.priors import SURVEYED_POINT_SIGMA_M
from planfit.runtime import short_repr

SurveyAxes = Literal["plan", "file", "map", "site"]
"""Whose axes the points are in: `plan`, x and y as at the rim of `planfit plan PLAN -o plan.png`, z above the
floor; `file`, the plan file's own; `map`, those that the plan's georeference leads to; `site`, others that
have nothing to do with a plan."""
DEFAULT_SIGMA_M = SURVEYED_POINT_SIGMA_M.value
"""Of a point whose file tells none: what a total station or a good GNSS receiver reaches on a site."""


@dataclass(frozen=True)
class SurveyPoint:
    """A point whose coordinates are known."""

    id: str
    xyz: Float[np.ndarray, "3"]
    """As given, in the axes of the survey; z is NaN where the height is not known."""
    sigma_m: float = DEFAULT_SIGMA_M
    """Standard deviation of each coordinate."""
    is_check: bool = False
    """Whether it judges the result and takes no part in it."""


@dataclass(frozen=True)
class Mark:
    """A point seen in a frame."""

    frame_idx: int
    point_id: str
    uv: tuple[float, float] | None = None
    """Column and row of the pixel, integers being pixel centres; None: the camera itself stood at the
    point."""


@dataclass(frozen=True)
class Survey:
    """Points, and where they were seen.

    Raises:
        OptionError: two points share an id, no points, a mark names a point that is not there.
    """

    points: tuple[SurveyPoint, ...]
    marks: tuple[Mark, ...] = ()
    axes: SurveyAxes = "plan"
    tags: str = ""
    """Family of tags to look for in the images, whose ids are ids of points; empty: none."""
    tag_size_m: float | None = None
    """Side of the black square of a tag: gives its distance where depth is missing."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if not self.points:
            raise OptionError("the survey: expected points, found none; give --control-points FILE")
        ids = [point.id for point in self.points]
        for k, name in enumerate(ids):
            if name in ids[:k]:
                raise OptionError(
                    f"the survey: expected each point once, found {name!r} twice; a point is either a "
                    "control point or a check point: leave it out of one of the files"
                )
        for mark in self.marks:
            if mark.point_id not in ids:
                raise OptionError(
                    f"the survey: expected marks of points that are given, found {mark.point_id!r} in frame "
                    f"{mark.frame_idx}, which is none of {some_ids(ids)}; mend the id, or add the point"
                )

    @property
    def is_check(self) -> np.ndarray:
        """Of each point."""
        return np.array([point.is_check for point in self.points])

    @property
    def sigmas_m(self) -> Float[np.ndarray, " p"]:
        """Of each point."""
        return np.array([point.sigma_m for point in self.points])


@dataclass(frozen=True)
class LiftedMarks:
    """Points of a survey as cameras see them; m marks."""

    points_cam: Float[np.ndarray, "m 3"]
    """m, axes of the frame's camera."""
    sigma_m: Float[np.ndarray, " m"]
    """Standard deviation of each coordinate, by depth alone."""
    frame_idx: Int[np.ndarray, " m"]
    point_idx: Int[np.ndarray, " m"]
    """Index among the survey's points."""

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.frame_idx)

    def __getitem__(self, which: np.ndarray) -> "LiftedMarks":
        """Some of them."""
        return LiftedMarks(
            self.points_cam[which],
            self.sigma_m[which],
            self.frame_idx[which],
            self.point_idx[which],
        )

    def corrected(self, sensor: SensorCalibration) -> "LiftedMarks":
        """As the corrected sensor sees them."""
        if sensor.is_nominal or len(self) == 0:
            return self
        is_camera = (self.points_cam == 0).all(axis=1)
        points = np.where(is_camera[:, None], 0.0, sensor.points(self.points_cam))
        return replace(self, points_cam=points)

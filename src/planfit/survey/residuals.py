"""How far surveyed points end from where a result puts them: control and check points apart."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from planfit.geometry import se3
from planfit.runtime import short_repr
from planfit.survey.types import LiftedMarks, Survey, SurveyAxes

SWAPPED_SHARE = 0.25
"""Of the way between two points, as near to each other's place as the rest puts two that are swapped."""


@dataclass(frozen=True)
class PointResidual:
    """One point: surveyed, and as the result has it."""

    id: str
    is_check: bool
    given: Float[np.ndarray, "3"]
    """As in its file; z is NaN where it is not known."""
    surveyed: Float[np.ndarray, "3"]
    """m, plan frame."""
    found: Float[np.ndarray, "3"]
    """Mean over its marks, weighted, m, plan frame."""
    n_marks: int
    sigma_m: float
    """Standard deviation of the difference, each coordinate: of the point and of depth."""
    left_out_m: Float[np.ndarray, "3"] | None = None
    """Of a control point: the residual where it takes no part. None of check points, which never do, and
    where nothing else tells where it is."""
    left_out_sigma_m: float = np.nan
    """Standard deviation of where the rest puts it, each coordinate; NaN where that is not known."""
    left_out_sigmas: float = np.nan
    """How far that is from where it was surveyed, in standard deviations of both."""
    is_contradicted: bool = False
    """Whether the rest contradicts it."""
    is_used: bool = True
    """Whether a control point took part: not if those beside it contradict it by more than drift can."""
    swapped_with: str = ""
    """Point in whose place the rest puts it, and which it puts in its own."""

    @property
    def residual_m(self) -> Float[np.ndarray, "3"]:
        """Found less surveyed; NaN in z where the height is not known."""
        return self.found - self.surveyed

    @property
    def horizontal_m(self) -> float:
        """Length seen from above."""
        return float(np.linalg.norm(self.residual_m[:2]))

    @property
    def left_out_length_m(self) -> float:
        """Length of the residual where it takes no part; NaN where that is not known."""
        if self.left_out_m is None:
            return np.nan
        return float(np.linalg.norm(np.nan_to_num(self.left_out_m)))

    @property
    def length_m(self) -> float:
        """Length; seen from above where the height is not known."""
        return float(np.linalg.norm(np.nan_to_num(self.residual_m)))


@dataclass(frozen=True)
class RoleResiduals:
    """Of all control points, or of all check points."""

    count: int
    rms_m: float
    """Root mean square of the lengths."""
    rms_horizontal_m: float
    rms_height_m: float | None
    """None where no height is known."""
    worst_m: float
    worst_id: str


@dataclass(frozen=True)
class SurveyResiduals:
    """Residuals of a survey after a refinement."""

    points: tuple[PointResidual, ...]
    """Those with marks, in the order of the survey."""
    unseen: tuple[str, ...]
    """Points without a mark."""
    axes: SurveyAxes
    height_datum_m: float | None
    """Height of the floor in heights of the survey, by the control points; None where heights count from the
    floor, or none is known."""
    site_from_plan: Float[np.ndarray, "4 4"] | None = None
    """To the survey's axes less `site_origin`, without a plan; None with one, whose axes are the survey's."""
    site_origin: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """To be added, apart, so that large numbers keep their digits."""

    __repr__ = short_repr

    @property
    def control(self) -> RoleResiduals | None:
        """Of control points: how well the result keeps to what held it, not how right it is."""
        return summarise([point for point in self.points if not point.is_check])

    @property
    def left_out(self) -> RoleResiduals | None:
        """Of control points, each where it takes no part."""
        told = [point for point in self.points if point.left_out_m is not None]
        return summarise([replace(p, found=p.surveyed + np.asarray(p.left_out_m)) for p in told])

    @property
    def check(self) -> RoleResiduals | None:
        """Of check points, which had no say: how right the result is there."""
        return summarise([point for point in self.points if point.is_check])


def summarise(points: Sequence[PointResidual]) -> RoleResiduals | None:
    """RMS and worst of some points; None of none."""
    if not points:
        return None
    lengths = np.array([point.length_m for point in points])
    residuals = np.array([point.residual_m for point in points])
    heights = residuals[np.isfinite(residuals[:, 2]), 2]
    worst = int(np.argmax(lengths))
    return RoleResiduals(
        len(points),
        _rms(lengths),
        _rms(np.linalg.norm(residuals[:, :2], axis=1)),
        _rms(heights) if len(heights) else None,
        float(lengths[worst]),
        points[worst].id,
    )


def with_swaps(points: Sequence[PointResidual]) -> tuple[PointResidual, ...]:
    """The same, those told that look swapped: control points that the rest contradicts, of which it puts each
    nearer to the other's place than `SWAPPED_SHARE` of the way between."""
    told = {
        k: (point.surveyed + np.asarray(point.left_out_m))[:2]
        for k, point in enumerate(points)
        if point.left_out_m is not None and (point.is_contradicted or not point.is_used)
    }

    def is_there(k: int, other: int) -> bool:
        way_m = np.linalg.norm(points[k].surveyed[:2] - points[other].surveyed[:2])
        off_m = np.linalg.norm(told[k] - points[other].surveyed[:2])
        return bool(off_m < SWAPPED_SHARE * way_m)

    pairs = {k: o for k in told for o in told if k != o and is_there(k, o) and is_there(o, k)}
    return tuple(
        replace(point, swapped_with=points[pairs[k]].id) if k in pairs else point
        for k, point in enumerate(points)
    )


def measure_residuals(
    survey: Survey,
    marks: LiftedMarks,
    surveyed: Float[np.ndarray, "p 3"],
    plan_from_cams: Float[np.ndarray, "n 4 4"],
) -> tuple[PointResidual, ...]:
    """Residuals of all points that have marks.

    Args:
        survey: points.
        marks: of them, lifted, with the sensor corrected as for the poses.
        surveyed: all points, plan frame, m.
        plan_from_cams: of all frames.
    """
    seen = se3.transform_each(plan_from_cams[marks.frame_idx], marks.points_cam)
    sigmas = np.hypot(survey.sigmas_m[marks.point_idx], marks.sigma_m)
    residuals = []
    for k in np.unique(marks.point_idx):
        own, point = marks.point_idx == k, survey.points[k]
        weights = sigmas[own] ** -2.0
        mean = weights @ seen[own] / weights.sum()
        of_depth = np.sqrt(np.sum((weights * marks.sigma_m[own]) ** 2)) / weights.sum()
        residuals.append(
            PointResidual(
                point.id,
                point.is_check,
                point.xyz,
                surveyed[k],
                mean,
                int(own.sum()),
                float(np.hypot(point.sigma_m, of_depth)),
            )
        )
    return tuple(residuals)


def _rms(values: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(values**2)))

"""How far surveyed points end from where a result puts them: control and check points apart; and control
points that cannot be where they were written, told before any of them pulls."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float

from planfit.errors import OptionError
from planfit.geometry import se3
from planfit.priors import DRIFT_SHARE
from planfit.runtime import short_repr
from planfit.survey.fit import (
    BETTER,
    DISTINCT_M,
    EXPECTED,
    UNITS,
    are_apart,
    fit_rigid_2d,
    other_axes,
)
from planfit.survey.read import LiftedMarks, Survey, SurveyAxes

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
    """Residuals of all points that have marks, lifted with the sensor corrected as for the poses of all
    frames."""
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


MAX_DRIFT_SHARE = DRIFT_SHARE.value
"""And by this share of the path between: no tracker loses as much."""
NEIGHBOURS = 4
"""Points that predict one, the nearest along the path: the further, the more drift explains."""
MAX_SUSPECTS = 12
"""Points of which pairs are tried for swapped ids, those that contradict most."""
FEWEST = 4
"""Of fewer points that contradict each other, nothing tells which is wrong."""


def find_blunders(
    level: Float[np.ndarray, "p 3"],
    site: Float[np.ndarray, "p 3"],
    walked_m: Float[np.ndarray, " p"],
) -> Bool[np.ndarray, " p"]:
    """Points that contradict their neighbours, the worst first, until none does.

    Args:
        level: points as the scan has them, z up.
        site: the same as surveyed, z up, m; z may be NaN.
        walked_m: how far the camera had walked where it saw each.

    Raises:
        OptionError: one mistake in all of them explains it (axes, unit), or so few contradict each other that
            nothing tells which is wrong.
    """
    is_bad = np.zeros(len(level), dtype=bool)
    off = _excesses(level, site, walked_m)
    if len(level) >= FEWEST and off.max() > 1.0:
        _require_no_mistake(level, site, walked_m, off)
        swapped = _swapped(level, site, walked_m, off)
        if swapped is not None:
            is_bad[list(swapped)] = True
            return is_bad
    while True:
        left = np.flatnonzero(~is_bad)
        off = _excesses(level[left], site[left], walked_m[left])
        if len(left) < 2 or off.max() <= 1.0:
            return is_bad
        if len(left) < FEWEST:
            raise OptionError(
                f"{EXPECTED}, found {len(left)} that contradict each other by more than drift can; check "
                "their coordinates and marks, or mark more points"
            )
        is_bad[left[np.argmax(off)]] = True


def _require_no_mistake(
    level: Float[np.ndarray, "p 3"],
    site: Float[np.ndarray, "p 3"],
    walked_m: Float[np.ndarray, " p"],
    off: Float[np.ndarray, " p"],
) -> None:
    """Raise where points contradict each other and, as one mistake would have them, all agree.

    The median of the fit can hide it: of seven points with y and z swapped, four that stood in a row of 3 m
    fitted within drift, and the other three were left out as wrong.
    """
    named = [(f"with {remedy}", changed) for remedy, changed in other_axes(site)]
    for unit, metres in UNITS.items():
        named.append((f"as {unit}: multiply x, y and z by {metres:g}", site * metres))
    for remedy, changed in named:
        if _excesses(level, changed, walked_m).max() <= min(1.0, BETTER * float(off.max())):
            raise OptionError(
                f"{EXPECTED}, found {np.sum(off > 1.0)} of {len(off)} that contradict those beside them by "
                f"more than drift can; they fit {remedy}"
            )


def _swapped(
    level: Float[np.ndarray, "p 3"],
    site: Float[np.ndarray, "p 3"],
    walked_m: Float[np.ndarray, " p"],
    off: Float[np.ndarray, " p"],
) -> tuple[int, int] | None:
    """The one pair of points with which, once their ids are swapped, nothing contradicts anything; None where
    no pair alone explains it. Two wrong points among few are else a riddle."""
    suspects = np.argsort(-off)[:MAX_SUSPECTS]
    found = []
    for first, second in combinations(suspects.tolist(), 2):
        order = np.arange(len(level))
        order[[first, second]] = second, first
        if _excesses(level, site[order], walked_m).max() <= 1.0:
            found.append((first, second))
    return found[0] if len(found) == 1 else None


def _excesses(
    level: Float[np.ndarray, "p 3"],
    site: Float[np.ndarray, "p 3"],
    walked_m: Float[np.ndarray, " p"],
) -> Float[np.ndarray, " p"]:
    """Of each point, as of `_excess`."""
    return np.array([_excess(level, site, walked_m, k) for k in range(len(level))])


def _excess(
    level: Float[np.ndarray, "p 3"],
    site: Float[np.ndarray, "p 3"],
    walked_m: Float[np.ndarray, " p"],
    k: int,
) -> float:
    """How far a point is from where its neighbours predict it, by what drift explains."""
    path_m = np.abs(walked_m - walked_m[k])
    path_m[k] = np.inf
    near = np.argsort(path_m, kind="stable")[: min(NEIGHBOURS, len(level) - 1)]
    if len(near) == 0:
        return 0.0
    allowed = max(DISTINCT_M, MAX_DRIFT_SHARE * float(path_m[near].mean()))
    z = level[:, 2] - site[:, 2]
    known = near[np.isfinite(z[near])]
    up = abs(z[k] - np.median(z[known])) if len(known) and np.isfinite(z[k]) else 0.0
    if are_apart(level[near]):
        factor, shift = fit_rigid_2d(site[near], level[near])
        at = factor * complex(*site[k, :2]) + shift
        across = abs(at - complex(*level[k, :2]))
    else:  # a distance is all that points at one place tell
        middle = level[near, :2].mean(axis=0), site[near, :2].mean(axis=0)
        lengths = [np.linalg.norm(p[k, :2] - m) for p, m in zip((level, site), middle, strict=True)]
        across = abs(lengths[0] - lengths[1])
    return float(max(across, up)) / allowed

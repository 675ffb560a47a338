"""What a user may choose and knows of an alignment: options, control points, and a rough start."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from planfit.errors import OptionError, require_choice, require_positive, require_share
from planfit.findings import Finding, SurveyKind
from planfit.floorplan import Floorplan
from planfit.survey.fit import OUTSIDE_SHARE

RecordedAxes = Literal["auto", "plan", "own"]
"""Whose axes the recorded poses are in."""


@dataclass(frozen=True)
class AlignOptions:
    """How the plan is searched for the scan."""

    method: Literal["search", "paper"] = "search"
    """`search` tries every alignment; `paper` matches extents and centres, which needs a scan of the whole
    plan and nothing else."""
    candidate: int = 1
    """Which of the alignments found is taken, 1 the best; for those who know better than the score."""
    metres_per_unit: float = 0.0
    """Length of one unit of a plan without unit, where it is known; 0: it is searched."""
    scale_tolerance: float = 0.0
    """Share by which `metres_per_unit` may be off; 0 takes it as exact."""
    metric_scale_tolerance: float = 0.0
    """Share by which a plan in metres may be off: another scale within it is taken where the walls and all
    measurements surely ask for one. 0 takes the plan as drawn, and where it fits clearly better at another
    scale, says so and ends with exit code 1."""
    two_scales: bool = False
    """Look for a scale along each axis of the plan: drawings that were stretched."""
    control_points: tuple[str, ...] = ()
    """Known pairs "x,y,z=X,Y": a point of the scan in its own axes (m) and the same point on the plan, in the
    coordinates at the rim of `planfit plan PLAN -o plan.png`: pixels of a picture (v down), else the plan
    frame, in metres where its unit is known. "x,y,z=file:X,Y": in the file's own coordinates."""
    control_point_tolerance_m: float = 1.0
    """How far off a control point may end."""
    start: str = ""
    """Rough alignment "x,y,yaw": plan point (m) of the level frame's origin, and yaw (deg); the search
    keeps to 5 m and 20 degrees of it."""
    recorded_axes: RecordedAxes = "auto"
    """Whose axes the recorded poses are in: `plan`, those of the plan; `own`, others; `auto`, the plan's
    where the scan's format says so and the plan is the one in the scan's folder."""

    def __post_init__(self) -> None:
        if self.method not in ("search", "paper"):
            raise OptionError(f"align.method: expected search or paper, found {self.method!r}")
        require_choice(self, "recorded_axes", "auto", "plan", "own")
        require_positive(self, "candidate", "control_point_tolerance_m")
        require_share(self, "scale_tolerance", "metric_scale_tolerance")
        for text in self.control_points:
            parse_control_point(text)
        if self.start:
            parse_start(self.start)


@dataclass(frozen=True)
class ControlPoint:
    """A point of the scan whose location on the plan is known, both seen from above."""

    level_xy: Float[np.ndarray, " 2"]
    """Metres, level frame."""
    plan_xy: Float[np.ndarray, " 2"]
    """Plan frame, in the plan's unit."""


OF_FILE = "file:"
"""Before a point of the plan that is given in the file's own coordinates."""


def parse_control_point(text: str) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 2"], bool]:
    """World point (m), plan point, and whether that is in the file's own coordinates, of "x,y,z=X,Y" or
    "x,y,z=file:X,Y".

    Raises:
        OptionError: it is not of this form.
    """
    scan, separator, plan = text.partition("=")
    is_of_file = plan.strip().startswith(OF_FILE)
    world, on_plan = _numbers(scan), _numbers(plan.strip().removeprefix(OF_FILE))
    if not separator or world is None or on_plan is None or (len(world), len(on_plan)) != (3, 2):
        raise OptionError(
            f"align.control-points: expected x,y,z=u,v (a point of the scan = the same point on the plan), "
            f"found {text!r}"
        )
    return np.array(world), np.array(on_plan), is_of_file


def parse_start(text: str) -> tuple[Float[np.ndarray, " 2"], float]:
    """Plan point (m) of the level frame's origin and yaw (rad) of "x,y,yaw_deg".

    Raises:
        OptionError: it is not of this form.
    """
    values = _numbers(text)
    if values is None or len(values) != 3:
        raise OptionError(
            f"align.start: expected x,y,yaw (metres, metres, degrees), found {text!r}"
        )
    return np.array(values[:2]), float(np.deg2rad(values[2]))


def read_control_points(
    texts: tuple[str, ...], level_from_world: Float[np.ndarray, "4 4"], floorplan: Floorplan
) -> tuple[ControlPoint, ...]:
    """Control points of texts: the scan's side levelled, the plan's side in the plan frame.

    Raises:
        OptionError: a point lies far outside of the plan, as one in other axes does.
    """
    source = floorplan.source
    plan_from_rim = np.linalg.inv(source.rim_from_plan)
    plan_from_file = plan_from_rim
    if source.file_from_plan is not None:
        plan_from_file = np.linalg.inv(source.file_from_plan)
    control_points = []
    for text in texts:
        world, given, is_of_file = parse_control_point(text)
        level = level_from_world[:3, :3] @ world + level_from_world[:3, 3]
        on_plan = _moved(given, plan_from_file if is_of_file else plan_from_rim)
        if not _is_near(on_plan, floorplan):
            is_in_file = not is_of_file and _is_near(_moved(given, plan_from_file), floorplan)
            raise OptionError(_outside_words(text, given, floorplan, is_in_file))
        control_points.append(ControlPoint(level[:2], on_plan))
    return tuple(control_points)


def _moved(
    point: Float[np.ndarray, " 2"], there_from_here: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, " 2"]:
    there = there_from_here @ np.array([*point, 1.0])
    return there[:2] / there[2]


def _is_near(point: Float[np.ndarray, " 2"], floorplan: Floorplan) -> bool:
    corners = floorplan.ends.reshape(-1, 2)
    margin = OUTSIDE_SHARE * max(floorplan.size)
    low, high = corners.min(axis=0) - margin, corners.max(axis=0) + margin
    return bool(((point >= low) & (point <= high)).all())


def _outside_words(
    text: str, given: Float[np.ndarray, " 2"], floorplan: Floorplan, is_in_file: bool
) -> str:
    """Where the plan lies, and what to write."""
    rim = floorplan.source.rim_from_plan
    corners = floorplan.ends.reshape(-1, 2) @ rim[:2, :2].T + rim[:2, 2]
    (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
    unit = (
        "px, v down" if floorplan.source.is_picture else "m" if floorplan.is_metric else "its units"
    )
    advice = "read it off the rim of `planfit plan FILE -o plan.png`"
    if is_in_file:
        scan = text.partition("=")[0]
        advice = f"if it is in the file's own coordinates, write {scan}={OF_FILE}{given[0]:g},{given[1]:g}"
    return (
        f"align.control-points: expected points on the plan, which spans {x0:.5g} to {x1:.5g} by {y0:.5g} to "
        f"{y1:.5g} ({unit}), found ({given[0]:g}, {given[1]:g}) in {text!r}; {advice}"
    )


def fit_control_points(
    control_points: Sequence[ControlPoint], metres_per_unit: float | None, tolerance_m: float
) -> tuple[float, Float[np.ndarray, " 2"], float]:
    """Yaw (rad), translation (m) and metres per unit that bring two control points or more together.

    Args:
        control_points: at least two.
        metres_per_unit: where the scale is known; None fits it (Umeyama 1991).
        tolerance_m: how far off a control point may end.

    Raises:
        OptionError: the points are one point, or they disagree.
    """
    scan = np.array([point.level_xy for point in control_points])
    plan = np.array([point.plan_xy for point in control_points])
    scan_middle, plan_middle = scan.mean(axis=0), plan.mean(axis=0)
    a, b = scan - scan_middle, plan - plan_middle
    scatter, plan_scatter = float(np.sum(a**2)), float(np.sum(b**2))
    if scatter < 1e-6 or plan_scatter < 1e-12:
        raise OptionError("align.control-points: expected different points, found all at one")
    # As complex numbers: b = z a / scale rotates and scales at once.
    z = np.sum(np.conj(a[:, 0] + 1j * a[:, 1]) * (b[:, 0] + 1j * b[:, 1]))
    yaw = float(np.angle(z))
    scale = float(scatter / max(abs(z), 1e-30)) if metres_per_unit is None else metres_per_unit
    c, s = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[c, -s], [s, c]])
    translation = scale * plan_middle - rotation @ scan_middle
    off_m = np.linalg.norm(scan @ rotation.T + translation - scale * plan, axis=1)
    if off_m.max() > tolerance_m:
        words = _disagreement_words(control_points, metres_per_unit, tolerance_m)
        raise OptionError(
            f"align.control-points: expected points that agree within {tolerance_m:g} m, found {words}"
        )
    return yaw, translation, scale


def _disagreement_words(
    control_points: Sequence[ControlPoint], metres_per_unit: float | None, tolerance_m: float
) -> str:
    """Which point the others do not agree with, where they tell; and what to do."""
    numbers = range(len(control_points))
    off_m = []
    for k in numbers:
        others = [*control_points[:k], *control_points[k + 1 :]]
        agree = _largest_off_m(others, metres_per_unit) <= tolerance_m
        own = _offs_m([control_points[k]], others, metres_per_unit)[0]
        off_m.append(float(own) if agree else np.nan)
    told = [k for k in numbers if off_m[k] > tolerance_m]
    hint = disagreement_hint(control_points, metres_per_unit, tolerance_m)
    if len(told) == 1 and hint is None:
        (k,) = told
        found, whose = f"number {k + 1} {off_m[k]:.2f} m from where the others put it", "its"
    else:
        largest_m = _largest_off_m(control_points, metres_per_unit)
        found, whose = f"{len(off_m)} that are off by up to {largest_m:.2f} m", "their"
        found += "" if hint is None else f"; {hint.sentence}"
    return f"{found}; check {whose} points, which axis goes up, and that the plan is not mirrored"


def worst_control_point(
    control_points: Sequence[ControlPoint], metres_per_unit: float | None, tolerance_m: float
) -> tuple[int, float] | None:
    """Index of the point without which the others agree best, and how far off these put it (m).

    None where all agree within the tolerance; also where they are all at one point, which
    `fit_control_points` refuses.
    """
    if len(control_points) < 2 or _largest_off_m(control_points, metres_per_unit) <= tolerance_m:
        return None
    left = [
        _largest_off_m([*control_points[:k], *control_points[k + 1 :]], metres_per_unit)
        for k in range(len(control_points))
    ]
    # Of two, nothing tells which is wrong: the later one.
    worst = len(left) - 1 - int(np.argmin(left[::-1]))
    return worst, _largest_off_m(control_points, metres_per_unit)


def disagreement_hint(
    control_points: Sequence[ControlPoint], metres_per_unit: float | None, tolerance_m: float
) -> Finding | None:
    """What would make points agree that do not: a mirrored plan, another scale."""
    if len(control_points) == 2:
        a, b = control_points
        scan_m = float(np.linalg.norm(a.level_xy - b.level_xy))
        on_plan_m = float(np.linalg.norm(a.plan_xy - b.plan_xy)) * (metres_per_unit or 1.0)
        return Finding(SurveyKind.TWO_POINTS_APART, {"scan_m": scan_m, "plan_m": on_plan_m})
    mirrored = [ControlPoint(p.level_xy * (1.0, -1.0), p.plan_xy) for p in control_points]
    if _largest_off_m(mirrored, metres_per_unit) <= tolerance_m:
        return Finding(SurveyKind.POINTS_AGREE_MIRRORED)
    if metres_per_unit is not None and _largest_off_m(control_points, None) <= tolerance_m:
        scale = fit_control_points(control_points, None, np.inf)[2] / metres_per_unit
        return Finding(SurveyKind.POINTS_AGREE_SCALED, {"scale_ratio": scale})
    return None


def _largest_off_m(control_points: Sequence[ControlPoint], metres_per_unit: float | None) -> float:
    """How far off (m) the worst ends, once they are brought together as well as they can be."""
    return float(_offs_m(control_points, control_points, metres_per_unit).max(initial=0.0))


def _offs_m(
    points: Sequence[ControlPoint], fitted: Sequence[ControlPoint], metres_per_unit: float | None
) -> Float[np.ndarray, " p"]:
    """How far off (m) points end where others are brought together as well as they can be; 0 where these tell
    nothing."""
    if len(fitted) < 2:
        return np.zeros(len(points))
    try:
        fit = fit_control_points(fitted, metres_per_unit, np.inf)
    except OptionError:  # all at one point
        return np.zeros(len(points))
    yaw, translation, scale = fit
    c, s = np.cos(yaw), np.sin(yaw)
    scan = np.array([point.level_xy for point in points])
    plan = np.array([point.plan_xy for point in points])
    off = scan @ np.array([[c, -s], [s, c]]).T + translation - scale * plan
    return np.linalg.norm(off, axis=1)


def _numbers(text: str) -> list[float] | None:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        return None
    return values if np.isfinite(values).all() else None

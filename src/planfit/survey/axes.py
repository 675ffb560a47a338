"""From the axes of a survey to the plan frame, without losing digits: large numbers are subtracted first."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from planfit.errors import OptionError
from planfit.findings import some_ids
from planfit.floorplan import Floorplan
from planfit.priors import FLOOR_LEVEL_MOST_M
from planfit.survey.types import Survey, SurveyAxes
from planfit.units import FOOT_M, INCH_M

OUTSIDE_SHARE = 0.5
"""A point may lie so far outside of the plan's faces, as a share of their extent: control points stand in
gardens and on pavements."""
MAX_FLOOR_HEIGHT_M = FLOOR_LEVEL_MOST_M.value
"""Heights above the floor are smaller; of a datum of their own, most are larger."""
UNITS = {
    "millimetres": 1e-3,
    "centimetres": 1e-2,
    "feet": FOOT_M,
    "inches": INCH_M,
    "kilometres": 1e3,
}
"""Metres of one unit that points may be in by mistake."""


@dataclass(frozen=True)
class PlacedPoints:
    """Points of a survey in axes near the scan's: the plan frame, or for `site` less an origin."""

    xyz: Float[np.ndarray, "p 3"]
    """x and y in units of the plan, z in metres as given; z is NaN where it is not known."""
    has_own_datum: bool
    """Whether heights count from somewhere else than the floor."""
    origin: Float[np.ndarray, "3"]
    """Subtracted from what was given; zero but for `site`."""


def place_points(survey: Survey, floorplan: Floorplan | None) -> PlacedPoints:
    """All points of a survey on the plan as it was read.

    Raises:
        OptionError: the plan has no such axes, or the points lie elsewhere than the plan.
    """
    given = np.array([point.xyz for point in survey.points], dtype=float)
    _require_axes(survey.axes, floorplan)
    if floorplan is None or survey.axes == "site":
        low = np.nan_to_num(np.nanmin(np.where(np.isnan(given), np.inf, given), axis=0), posinf=0.0)
        origin = np.floor(low)
        return PlacedPoints(given - origin, True, origin)
    xy = plan_from_axes(survey.axes, floorplan)(given[:, :2])
    if not _is_near(xy, floorplan).all():
        raise OptionError(_elsewhere(survey, floorplan, given, xy))
    _require_floor_heights(survey, given[:, 2])
    placed = np.column_stack([xy, given[:, 2]])
    return PlacedPoints(placed, survey.axes != "plan", np.zeros(3))


def plan_from_axes(
    axes: SurveyAxes, floorplan: Floorplan
) -> Callable[[Float[np.ndarray, "p 2"]], Float[np.ndarray, "p 2"]]:
    """The map from x and y of these axes to the plan frame."""
    source = floorplan.source
    file_from_plan = source.file_from_plan if source.file_from_plan is not None else np.eye(3)
    steps = {
        "plan": [source.rim_from_plan],
        "file": [file_from_plan],
        "map": [source.map_from_file, file_from_plan],
    }[axes]

    def to_plan(xy: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "p 2"]:
        for affine in steps:
            # Subtracted before anything is multiplied: exact where numbers are alike.
            xy = np.linalg.solve(affine[:2, :2], (xy - affine[:2, 2]).T).T
        return xy

    return to_plan


def _require_axes(axes: SurveyAxes, floorplan: Floorplan | None) -> None:
    if floorplan is None:
        if axes != "site":
            raise OptionError(
                f"--survey-axes {axes}: expected a plan, found none; without a plan points are in axes of "
                "their own: give --survey-axes site"
            )
        return
    source = floorplan.source
    advice = "bring the points into the axes of the plan, or refine with --no-plan"
    if axes == "site":
        raise OptionError(
            f"--survey-axes site: expected no plan, found {floorplan.name}: nothing tells where on it the "
            f"site's axes lie; {advice}"
        )
    if axes == "map" and (source.map_from_file is None or source.file_from_plan is None):
        raise OptionError(
            f"--survey-axes map: expected a plan with a map conversion (IFC) or a world file, found none in "
            f"{floorplan.name}; {advice}"
        )
    if axes == "file" and source.file_from_plan is None:
        raise OptionError(
            f"--survey-axes file: expected a plan with coordinates of its own, found {floorplan.name}; use "
            "--survey-axes plan"
        )


def _require_floor_heights(survey: Survey, heights: Float[np.ndarray, " p"]) -> None:
    known = heights[np.isfinite(heights)]
    if survey.axes != "plan" or not len(known) or np.abs(np.median(known)) < MAX_FLOOR_HEIGHT_M:
        return
    raise OptionError(
        f"the survey: expected heights above the floor (m) beside coordinates of the plan, found "
        f"{np.median(known):.4g} in the median; subtract the floor's height, leave z empty, or use "
        "--survey-axes file or map, whose heights may count from anywhere"
    )


def _is_near(xy: Float[np.ndarray, "p 2"], floorplan: Floorplan) -> Bool[np.ndarray, " p"]:
    corners = floorplan.ends.reshape(-1, 2)
    margin = OUTSIDE_SHARE * max(floorplan.size)
    low, high = corners.min(axis=0) - margin, corners.max(axis=0) + margin
    return ((xy >= low) & (xy <= high)).all(axis=1)


def _elsewhere(
    survey: Survey,
    floorplan: Floorplan,
    given: Float[np.ndarray, "p 3"],
    xy: Float[np.ndarray, "p 2"],
) -> str:
    """Which points lie off the plan, where it lies, and what would bring them onto it."""
    outside = np.flatnonzero(~_is_near(xy, floorplan))
    first = int(outside[0])
    corners = floorplan.ends.reshape(-1, 2)
    (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
    ids = [survey.points[k].id for k in outside]
    return (
        f"the survey: expected points on {floorplan.name}, which spans {x0:.5g} to {x1:.5g} by {y0:.5g} to "
        f"{y1:.5g}, found {some_ids(ids)} outside, the first at ({xy[first, 0]:.7g}, {xy[first, 1]:.7g}) of "
        f"the plan; {_remedy(survey.axes, floorplan, given)}"
    )


def _remedy(axes: SurveyAxes, floorplan: Floorplan, given: Float[np.ndarray, "p 3"]) -> str:
    """What brings all points onto the plan: other axes, another unit, or swapped columns."""

    def fits(tried: SurveyAxes, xy: Float[np.ndarray, "p 2"]) -> bool:
        try:
            _require_axes(tried, floorplan)
        except OptionError:
            return False
        return bool(_is_near(plan_from_axes(tried, floorplan)(xy), floorplan).all())

    tried: tuple[SurveyAxes, ...] = ("plan", "file", "map")
    for other in tried:
        if other != axes and fits(other, given[:, :2]):
            return f"they lie on it in other axes: give --survey-axes {other}"
    if fits(axes, given[:, 1::-1]):
        return "they lie on it with x and y swapped: x is the easting; swap the columns"
    extent = np.ptp(given[:, :2], axis=0).max()
    for name, metres in UNITS.items():
        in_metres = given[:, :2] * metres
        # Any cloud of points shrunk to nothing lies on a plan about the origin.
        is_of_size = len(given) == 1 or extent * metres > 0.05 * max(floorplan.size)
        if is_of_size and fits(axes, in_metres):
            return f"they lie on it as {name}: multiply them by {metres:g}"
    return "check their axes, unit and order of columns"

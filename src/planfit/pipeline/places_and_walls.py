"""Known points against walls: where the walls alone would put a scan that points of it hold elsewhere.

Points that agree with each other are taken, wherever they put the scan: in a symmetric building nothing else
tells. So the scan is aligned once more without them. Only where its walls then fit clearly better, at another
place, is something wrong with the points; where both fit alike, the points decide.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Float

from planfit.alignment import Alignment, is_clearly_better, read_control_points
from planfit.alignment.options import ControlPoint
from planfit.alignment.selection import SameWithin
from planfit.errors import FloorplanError
from planfit.floorplan import Floorplan
from planfit.pipeline.align import find_alignment, wall_samples
from planfit.pipeline.on_plan import PointsAgainstWalls, ScanOnPlan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import PreparedScan


@dataclass(frozen=True)
class PlacedByWalls:
    """A scan on its plan by what it saw alone, and how far points are off there."""

    alignment: Alignment
    off_m: Float[np.ndarray, " p"]
    """Of each point, m."""


def placed_by_walls(
    prepared: PreparedScan,
    floorplan: Floorplan,
    options: RefineOptions,
    claimed: Float[np.ndarray, "4 4"] | None,
    points: tuple[ControlPoint, ...],
) -> PlacedByWalls | None:
    """Align without control points; None where the walls tell nothing."""
    alone = replace(options, align=replace(options.align, control_points=()))
    try:
        found = find_alignment(prepared, floorplan.used(), alone, claimed)
    except FloorplanError:  # in the unit that the points hold it to, the walls fit nowhere else
        return None
    return None if found is None else PlacedByWalls(found, _off_m(found, points))


def against_walls(
    on_plan: ScanOnPlan,
    prepared: PreparedScan,
    floorplan: Floorplan,
    options: RefineOptions,
    surveyed: Mapping[str, ControlPoint] = MappingProxyType({}),
) -> ScanOnPlan:
    """Where the scan stands by its control points, doubted where walls clearly put it elsewhere.

    Args:
        on_plan: aligned with the points of the options and of the survey.
        surveyed: control points of a survey, by id. Without any, and without points of the options, there is
            nothing to compare.
    """
    taken = on_plan.alignment
    given = options.align.control_points
    if taken is None or not (given or surveyed):
        return on_plan
    points = read_control_points(given, prepared.level_from_world, floorplan)
    names = [*surveyed, *(f"number {k}" for k in range(1, len(points) + 1))]
    points = (*surveyed.values(), *points)
    alone = placed_by_walls(prepared, floorplan, options, on_plan.claimed_plan_from_level, points)
    if alone is None:
        return on_plan
    walls = wall_samples(prepared.measurements.structure, prepared.level_from_keys)
    apart = is_clearly_better(alone.alignment, taken, walls)
    if apart is None:
        return on_plan
    least_m = SameWithin.surveyed().translation_m
    most_m = least_m if surveyed else options.align.control_point_tolerance_m
    found = PointsAgainstWalls(alone.off_m, *apart, alone.alignment.score, taken.score)
    # As a candidate it is asked about again once the walls were adjusted to where the points want them.
    best = alone.alignment.candidates[:1]
    doubted = replace(
        taken,
        is_sure=False,
        candidates=(*taken.candidates, *best),
        findings=(*taken.findings, found.finding(names, most_m)),
    )
    return replace(on_plan, alignment=doubted, against_points=found)


def _off_m(alignment: Alignment, points: tuple[ControlPoint, ...]) -> Float[np.ndarray, " p"]:
    """How far from its place on the plan an alignment puts each point."""
    there = np.array([point.level_xy for point in points]).reshape(-1, 2)
    there = there @ alignment.plan_from_level[:2, :2].T + alignment.plan_from_level[:2, 3]
    given = np.array([point.plan_xy for point in points]).reshape(-1, 2)
    return np.linalg.norm(there - given * alignment.scale_xy, axis=1)

"""Which scales a plan without unit may have, from what buildings and scans are like."""

from dataclasses import replace

import numpy as np

from planfit.align.refine import scaled_faces
from planfit.align.wall_samples import WallSamples
from planfit.floorplan import Floorplan
from planfit.geometry import segments

THICKNESS_M = (0.05, 0.6)
"""Walls of buildings."""
SCAN_TO_PLAN = (1 / 12, 1.6)
"""Diagonal of the scan over that of the plan: from one room of a floor to a scan that leaves the plan."""
MAX_SIZE_M = 2000.0
"""A building is smaller than a town."""


def scale_range(walls: WallSamples, floorplan: Floorplan) -> tuple[float, float]:
    """Smallest and largest metres per unit that are worth a try."""
    plan = float(np.hypot(*floorplan.size))
    low = walls.extent_m / plan / SCAN_TO_PLAN[1]
    high = min(walls.extent_m / plan / SCAN_TO_PLAN[0], MAX_SIZE_M / plan)
    thickness = wall_thickness(floorplan)
    if len(thickness) >= 4:
        thin, thick = np.percentile(thickness, [25, 75])
        by_walls = THICKNESS_M[0] / thick, THICKNESS_M[1] / thin
        # Drawings may show only one side of most walls, or symbols for walls; then the sizes decide.
        if by_walls[0] < high and by_walls[1] > low:
            low, high = max(low, by_walls[0]), min(high, by_walls[1])
    return low, max(high, low)


def metric_plan(floorplan: Floorplan, scale_xy: tuple[float, float]) -> Floorplan:
    """The plan in metres, one unit being `scale_xy` long along its x and its y."""
    x, y = scale_xy
    even = floorplan.scaled(float(np.sqrt(x * y)))
    if x == y:
        return even
    ends, normals = scaled_faces(floorplan, np.array(scale_xy))
    openings = None if floorplan.openings is None else floorplan.openings * np.array(scale_xy)
    source = floorplan.source
    if source.file_from_plan is not None:
        unscale = np.diag([1 / x, 1 / y, 1.0])
        source = replace(source, file_from_plan=source.file_from_plan @ unscale)
    return replace(even, ends=ends, normals=normals, openings=openings, source=source)


def wall_thickness(floorplan: Floorplan) -> np.ndarray:
    """Thicknesses (k,) of the walls that have any, unit of the plan.

    Where the reader gave none, the gap to the nearest face that looks the other way, behind each face.
    """
    if floorplan.thickness is not None:
        known = floorplan.thickness[np.isfinite(floorplan.thickness) & (floorplan.thickness > 0)]
        if len(known):
            return known
    sure = np.flatnonzero(floorplan.is_oriented)[:2000]
    ends, normals = floorplan.ends[sure], floorplan.normals[sure]
    along, length = segments.directions(ends), segments.lengths(ends)
    middle = ends.mean(axis=1)
    gaps = []
    for i in range(len(sure)):
        behind = -(middle - middle[i]) @ normals[i]
        at = (ends - ends[i, 0]) @ along[i]
        low, high = at.min(axis=1), at.max(axis=1)
        overlap = np.minimum(high, length[i]) - np.maximum(low, 0.0)
        is_partner = (normals @ normals[i] < -0.99) & (behind > 0) & (overlap > 0.3 * length[i])
        if is_partner.any():
            gaps.append(behind[is_partner].min())
    return np.array(gaps)


def scale_steps(low: float, high: float, step: float) -> np.ndarray:
    """Scales (k,) from `low` to `high`, evenly in their logarithm, at most `step` apart as a share."""
    count = int(np.ceil(np.log(high / low) / np.log1p(step))) + 1
    return np.geomspace(low, high, count) if high > low else np.array([low])

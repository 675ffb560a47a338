"""Which yaws, and which scales of a plan without unit, are worth a search."""

import numpy as np
from jaxtyping import Float

from planfit.alignment.wall_samples import WallSamples
from planfit.floorplan import Floorplan
from planfit.geometry import segments
from planfit.priors import BUILDING_SIZE_M, WALL_FACES_APART_M, WALL_THIN_QUARTER_MOST_M

MIN_AGREEMENT = 0.35
"""Yaws that agree less than this share of the best are not tried: most buildings have four that do, and
the others only take time."""

MAX_YAWS = 8
"""Most yaws that are tried, best agreement of wall directions first."""
SCAN_TO_PLAN = (1 / 12, 1.6)
"""Diagonal of the scan over that of the plan: from one room of a floor to a scan that leaves the plan."""


def candidate_yaws(walls: WallSamples, floorplan: Floorplan) -> Float[np.ndarray, " t"]:
    """Yaws (rad), plan from level, at which wall directions agree, best first.

    Circular correlation of the two length-weighted histograms of normals, one-degree bins; fewer than
    `MAX_YAWS` where the others agree far less. A face whose free side is unknown counts half for
    either side.
    """
    of_scan = _direction_histogram(walls.normals, np.ones(len(walls.normals)))
    weight = floorplan.lengths * np.where(floorplan.is_oriented, 1.0, 0.5)
    of_plan = _direction_histogram(floorplan.normals, weight)
    of_plan += _direction_histogram(
        -floorplan.normals, np.where(floorplan.is_oriented, 0.0, weight)
    )
    agreement = np.fft.irfft(np.fft.rfft(of_plan) * np.conj(np.fft.rfft(of_scan)), 360)
    yaws: list[int] = []
    for degree in np.argsort(-agreement):
        if all(min((degree - t) % 360, (t - degree) % 360) >= 8 for t in yaws):
            yaws.append(int(degree))
        if len(yaws) == MAX_YAWS or agreement[degree] < MIN_AGREEMENT * agreement.max():
            break
    return np.deg2rad(yaws)


def _direction_histogram(
    normals: Float[np.ndarray, "n 2"], weight: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " 360"]:
    """Weight by direction, one-degree bins, smoothed round the circle by a Gaussian of 2 degrees."""
    degree = np.rad2deg(np.arctan2(normals[:, 1], normals[:, 0])) % 360
    counts = np.bincount(np.round(degree).astype(int) % 360, weight, minlength=360)
    kernel = np.exp(-0.5 * (np.arange(-180, 180) / 2.0) ** 2)
    return np.fft.irfft(np.fft.rfft(counts) * np.fft.rfft(np.fft.ifftshift(kernel)), 360)


def scale_range(walls: WallSamples, floorplan: Floorplan) -> tuple[float, float]:
    """Smallest and largest metres per unit that are worth a try."""
    plan = float(np.hypot(*floorplan.size))
    low = walls.extent_m / plan / SCAN_TO_PLAN[1]
    high = min(walls.extent_m / plan / SCAN_TO_PLAN[0], BUILDING_SIZE_M.high / plan)
    thickness = wall_thickness(floorplan)
    if len(thickness) >= 4:
        thin, thick = np.percentile(thickness, [25, 75])
        by_walls = WALL_FACES_APART_M.low / thick, WALL_THIN_QUARTER_MOST_M.value / thin
        # Drawings may show only one side of most walls, or symbols for walls; then the sizes decide.
        if by_walls[0] < high and by_walls[1] > low:
            low, high = max(low, by_walls[0]), min(high, by_walls[1])
    return low, max(high, low)


def wall_thickness(floorplan: Floorplan) -> Float[np.ndarray, " k"]:
    """Thicknesses of the walls that have any, unit of the plan.

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


def scale_steps(low: float, high: float, step: float) -> Float[np.ndarray, " k"]:
    """Scales from `low` to `high`, evenly in their logarithm, at most `step` apart as a share."""
    count = int(np.ceil(np.log(high / low) / np.log1p(step))) + 1
    return np.geomspace(low, high, count) if high > low else np.array([low])

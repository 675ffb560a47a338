"""Coarse search: every scale, yaw and translation of the scan on the plan, by FFT."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.alignment.likelihood_field import TranslationSearch, make_likelihood_field
from planfit.alignment.refine import START_SIGMA_M, AlignmentHypothesis, rotation_2d
from planfit.alignment.selection import DISTINCT_TRANSLATION_M, SameWithin, keep_distinct
from planfit.alignment.wall_samples import WallSamples
from planfit.floorplan import Floorplan
from planfit.geometry import segments
from planfit.priors import BUILDING_SIZE_M, WALL_FACES_APART_M, WALL_THIN_QUARTER_MOST_M

CELL_M = 0.2
"""Finest cell of the coarse search; it grows with the size of scan and plan."""
MAX_CANDIDATES = 48
"""Hypotheses of the coarse search that are refined."""
CELLS_ACROSS = 100
"""The scan's extent in cells of the coarse search: more cells cost time, fewer lose rooms."""
OCTAVE = 1.4
"""Scales within this factor share the plan's fields, at a cell that fits their middle."""
PEAKS = 4
"""Translations kept of one scale and yaw."""
SAME_YAW_DEG, SAME_SCALE = 4.0, 0.05
"""Hypotheses nearer than this are repetitions: neighbouring scales find the same alignment again."""
_MIN_AGREEMENT = 0.35
"""Yaws that agree less than this share of the best are not tried: most buildings have four that do, and
the others only take time."""

MAX_YAWS = 8
"""Most yaws that are tried, best agreement of wall directions first."""
_SCAN_TO_PLAN = (1 / 12, 1.6)
"""Diagonal of the scan over that of the plan: from one room of a floor to a scan that leaves the plan."""


@dataclass(frozen=True)
class Region:
    """Where the search is allowed to look: around a known point."""

    level_xy: Float[np.ndarray, " 2"]
    """Metres, a point of the scan."""
    plan_xy: Float[np.ndarray, " 2"]
    """Where it must come to lie, in the plan's unit."""
    radius_m: float


def search_hypotheses(
    walls: WallSamples,
    floorplan: Floorplan,
    scales: tuple[float, float],
    yaws: Float[np.ndarray, " t"],
    regions: tuple[Region, ...] = (),
) -> list[AlignmentHypothesis]:
    """Best hypotheses of the coarse search, best first, with their coarse score; not more than asked for.

    Args:
        floorplan: in its own unit.
        scales: smallest and largest metres per unit; equal where it is known.
        yaws: rad, to try.
        regions: hypotheses out of any of these are left out.
    """
    cell_m = max(CELL_M, walls.extent_m / CELLS_ACROSS)
    free_xy = free_space(walls, cell_m)
    all_scales = scale_steps(*scales, step=4.0 * cell_m / max(walls.extent_m, 1.0))
    everything = np.concatenate([walls.xy, free_xy])
    reach_m = float(np.linalg.norm(np.ptp(everything, axis=0)))
    found: list[AlignmentHypothesis] = []
    for group in _octaves(all_scales):
        middle = float(np.sqrt(group[0] * group[-1]))
        fields = make_likelihood_field(
            floorplan.scaled(middle), cell_m, START_SIGMA_M, 2.0, walls.extent_m
        )
        search = TranslationSearch(fields, reach_m * middle / group[0])
        for scale in group:
            # The plan stays at the middle scale of the group; the scan shrinks or grows instead.
            ratio = middle / scale
            for yaw in yaws:
                rotation = rotation_2d(yaw)
                table, first = search.scores(
                    ratio * walls.xy @ rotation.T,
                    walls.normals @ rotation.T,
                    ratio * free_xy @ rotation.T,
                )
                grid = _Grid(table, first, fields.cell_m, float(ratio))
                grid.keep_to(regions, rotation, float(scale))
                found += grid.peaks(float(yaw), float(scale), DISTINCT_TRANSLATION_M)
    found.sort(key=lambda hypothesis: -hypothesis.score)
    within = SameWithin(DISTINCT_TRANSLATION_M, SAME_YAW_DEG, SAME_SCALE)
    return keep_distinct(found, walls, within, MAX_CANDIDATES)


def free_space(walls: WallSamples, cell_m: float) -> Float[np.ndarray, "k 2"]:
    """Points (m), one a cell, that lines of sight passed well before they met a wall."""
    if walls.seen_from is None:
        return np.zeros((0, 2))
    way = walls.xy - walls.seen_from
    length = np.linalg.norm(way, axis=1)
    keep_off_m = 1.5 * cell_m + 0.3
    points = [np.zeros((0, 2))]
    for begin in range(0, len(way), 4096):  # bounds the table of points along the lines
        part = slice(begin, begin + 4096)
        steps = np.arange(0.0, max(float(length[part].max()), cell_m), 0.7 * cell_m)
        inside = steps < length[part, None] - keep_off_m
        t = steps / np.maximum(length[part, None], 1e-9)
        xy = walls.seen_from[part, None] + t[..., None] * way[part, None]
        cells = np.unique(np.floor(xy[inside] / cell_m).astype(int), axis=0)
        points.append(cells)
    cells = np.unique(np.concatenate(points).astype(int), axis=0)
    # Space near any seen wall says nothing: its own face is there.
    around = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2)
    taken = np.floor(walls.xy / cell_m).astype(int)
    taken = np.unique((taken[:, None] + around).reshape(-1, 2), axis=0)
    if len(cells) == 0:
        return np.zeros((0, 2))
    low = np.minimum(cells.min(axis=0), taken.min(axis=0))
    width = int(max(cells[:, 0].max(), taken[:, 0].max()) - low[0]) + 1
    # One number a cell, so that whole cells can be looked up.
    keys, taken_keys = ((c - low) @ np.array([1, width]) for c in (cells, taken))
    return (cells[~np.isin(keys, taken_keys)] + 0.5) * cell_m


@dataclass(frozen=True)
class _Grid:
    """Scores of all translations of one yaw and scale."""

    table: Float[np.ndarray, "rows columns"]
    first: Float[np.ndarray, " 2"]
    """Metres at the middle scale, translation of cell (0, 0)."""
    cell_m: float
    ratio: float
    """Middle scale over this one."""

    def translation(self, row: int, column: int) -> Float[np.ndarray, " 2"]:
        """Metres at this scale."""
        return (self.first + self.cell_m * np.array([column, row])) / self.ratio

    def keep_to(
        self, regions: tuple[Region, ...], rotation: Float[np.ndarray, "2 2"], scale: float
    ) -> None:
        """Mark translations that leave a region as never to be taken."""
        for region in regions:
            wanted = scale * region.plan_xy - rotation @ region.level_xy
            rows, columns = (np.arange(n) for n in self.table.shape)
            x = (self.first[0] + self.cell_m * columns) / self.ratio - wanted[0]
            y = (self.first[1] + self.cell_m * rows) / self.ratio - wanted[1]
            radius = max(region.radius_m, self.cell_m)
            self.table[np.hypot(x[None, :], y[:, None]) > radius] = -np.inf

    def peaks(self, yaw: float, scale: float, distinct_m: float) -> list[AlignmentHypothesis]:
        """The best translations, apart by `distinct_m` (non-maximum suppression)."""
        radius = int(np.ceil(distinct_m * self.ratio / self.cell_m))
        table, found = self.table.copy(), []
        for _ in range(PEAKS):
            row, column = np.unravel_index(int(np.argmax(table)), table.shape)
            score = float(table[row, column])
            if not np.isfinite(score):
                break
            translation = self.translation(int(row), int(column))
            found.append(AlignmentHypothesis(yaw, translation, score, (scale, scale)))
            rows = slice(max(row - radius, 0), row + radius + 1)
            columns = slice(max(column - radius, 0), column + radius + 1)
            table[rows, columns] = -np.inf
        return found


def _octaves(scales: Float[np.ndarray, " s"]) -> list[np.ndarray]:
    """Runs of scales, each within a factor of `OCTAVE`."""
    number = np.floor(np.log(scales / scales[0]) / np.log(OCTAVE) + 1e-9).astype(int)
    return [scales[number == k] for k in np.unique(number)]


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
        if len(yaws) == MAX_YAWS or agreement[degree] < _MIN_AGREEMENT * agreement.max():
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
    low = walls.extent_m / plan / _SCAN_TO_PLAN[1]
    high = min(walls.extent_m / plan / _SCAN_TO_PLAN[0], BUILDING_SIZE_M.high / plan)
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

    Where the reader gave none, the gap to the nearest face that looks the other way, behind each face; none
    where fewer than half have one, as where rooms were outlined from inside and gaps are what lies between.
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
    return np.array(gaps if 2 * len(gaps) >= len(sure) else [])


def scale_steps(low: float, high: float, step: float) -> Float[np.ndarray, " k"]:
    """Scales from `low` to `high`, evenly in their logarithm, at most `step` apart as a share."""
    count = int(np.ceil(np.log(high / low) / np.log1p(step))) + 1
    return np.geomspace(low, high, count) if high > low else np.array([low])

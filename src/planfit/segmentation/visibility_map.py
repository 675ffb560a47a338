"""What a stretch of a scan shows of its surroundings: heights of floor and ceiling, and what is wall.

Furniture is told from walls by what is seen over it. Cameras see past the top of a cupboard, however tall,
to the wall behind; nothing is ever seen over a wall, also where only its foot is in view. So the map of a
stretch keeps, for each place, the highest upright surface and the highest line of sight. Poses drift, so
a stretch is short.
"""

from dataclasses import dataclass

import numba
import numpy as np
from scipy.ndimage import minimum_filter

CELL_M = 0.06
BIN_M = 0.1
_N_BINS = 60
_BELOW_M = 3.0
"""The map reaches from this far below the mean camera to the same above."""
_REACH_M = 8.0
_STOP_M = 0.06
"""A line of sight counts up to this far before what it meets."""


@dataclass(frozen=True)
class Glance:
    """Few points of one frame, in the world turned upright."""

    centre: np.ndarray  # (3,) m, the camera
    points: np.ndarray  # (n, 3) float32 m
    normal_z: np.ndarray  # (n,) float32, upward part of the normals; NaN where unsure


@dataclass(frozen=True)
class Stretch:
    """What some consecutive frames show of their surroundings, in the world turned upright."""

    low_xy: np.ndarray  # (2,) m, corner of the map
    is_wall: (
        np.ndarray
    )  # (nx, ceil(ny / 8)) uint8, a bit for each cell whose upright surfaces are wall
    n_y: int
    """Cells along y."""
    floor_m: float
    """Height of the floor; NaN where none is seen."""
    ceilings_m: np.ndarray  # (k,) heights of ceilings, most seen first

    def wall_at(self, xy: np.ndarray) -> np.ndarray:
        """Whether upright surfaces at places (..., 2) m are wall; False off the map and at NaN."""
        flat = np.asarray(xy, dtype=float).reshape(-1, 2)
        return _walls_at(flat, self.low_xy, self.is_wall, self.n_y).reshape(xy.shape[:-1])


@numba.njit(cache=True, nogil=True)
def _walls_at(xy: np.ndarray, low_xy: np.ndarray, is_wall: np.ndarray, n_y: int) -> np.ndarray:
    found = np.zeros(len(xy), dtype=np.bool_)
    for k in range(len(xy)):
        i, j = np.floor((xy[k, 0] - low_xy[0]) / CELL_M), np.floor((xy[k, 1] - low_xy[1]) / CELL_M)
        if i >= 0 and j >= 0 and i < len(is_wall) and j < n_y:  # never of NaN
            row, column = int(i), int(j)
            found[k] = (is_wall[row, column >> 3] >> (7 - (column & 7))) & 1 == 1
    return found


def map_stretch(
    glances: list[Glance], tilt_sine: float, free_above_m: float, min_rise_m: float
) -> Stretch:
    """What glances of consecutive frames show.

    Args:
        glances: at least one.
        tilt_sine: surfaces whose normals lie within this (sine) of level are upright.
        free_above_m: what is seen over by more than this is no wall.
        min_rise_m: walls are seen over at least this range of heights.
    """
    centres = np.array([g.centre for g in glances])
    middle_z = float(centres[:, 2].mean())
    low = np.array([*(centres[:, :2].min(axis=0) - _REACH_M), middle_z - _BELOW_M])
    size = centres[:, :2].max(axis=0) + _REACH_M - low[:2]
    shape = (*np.ceil(size / CELL_M).astype(int), _N_BINS)
    hits = np.zeros(shape, dtype=np.uint8)
    sight = np.full(shape[:2], -1, dtype=np.int16)
    for g in glances:
        with np.errstate(invalid="ignore"):
            is_upright = np.abs(g.normal_z) < tilt_sine
        _mark(g.centre, g.points.astype(float), is_upright, low, hits, sight)
    bottom, top = _extents(hits)
    # A line of sight along a wall passes the cells before it, but none behind.
    over = minimum_filter(sight, size=3)
    is_wall = (top - bottom + 1) * BIN_M >= min_rise_m
    is_wall &= (over - top) * BIN_M <= free_above_m
    floor_m, ceilings_m = _levels(glances)
    return Stretch(low[:2], np.packbits(is_wall, axis=1), is_wall.shape[1], floor_m, ceilings_m)


def _levels(glances: list[Glance]) -> tuple[float, np.ndarray]:
    """Height of the floor, and heights of ceilings, as level surfaces that many points lie on."""
    points_z = np.concatenate([g.points[:, 2] for g in glances]).astype(float)
    above = np.concatenate([g.points[:, 2] - g.centre[2] for g in glances])
    facing = np.concatenate([g.normal_z for g in glances])
    with np.errstate(invalid="ignore"):
        floor_like = points_z[(facing > 0.96) & (above < -0.3) & (above > -_BELOW_M)]
        ceiling_like = points_z[(facing < -0.96) & (above > 0.3)]
    floors = level_peaks(floor_like, 1 / 3)
    ceilings = level_peaks(ceiling_like, 1 / 4)
    if len(floors) == 0:
        return np.nan, ceilings
    # The lowest of the large ones: a long table may outnumber the floor. What lies below it is no reason
    # for doubt: LiDAR sees points below true floors, in open shafts and by mirrors, as many as a quarter
    # of those on it, and a stretch without its floor cost the ConSLAM scan 0.02 to 0.05 m.
    return float(floors.min()), ceilings


def level_peaks(heights_m: np.ndarray, min_share: float, min_count: int = 40) -> np.ndarray:
    """Heights (k,) m on which many of (n,) lie, most first: at least `min_share` of the first's count."""
    found: list[float] = []
    if len(heights_m) == 0:
        return np.zeros(0)
    low = heights_m.min() - 0.1
    counts = np.bincount(((heights_m - low) / 0.05).astype(int), minlength=8).astype(float)
    wide = np.convolve(counts, np.ones(5), mode="same")
    least = max(min_share * wide.max(), min_count)
    while wide.max() >= least:
        k = int(np.argmax(wide))
        near = heights_m[np.abs(heights_m - (low + (k + 0.5) * 0.05)) < 0.15]
        found.append(float(np.median(near)))
        wide[max(k - 6, 0) : k + 7] = 0
    return np.array(found)


@numba.njit(cache=True, nogil=True)
def _mark(
    centre: np.ndarray,
    points: np.ndarray,
    is_upright: np.ndarray,
    low: np.ndarray,
    hits: np.ndarray,
    sight: np.ndarray,
) -> None:
    """Count upright points in and beside cells `hits` (nx, ny, nz); raise `sight` (nx, ny) to each line
    of sight."""
    nx, ny, nz = hits.shape
    for k in range(len(points)):
        dx, dy, dz = (
            points[k, 0] - centre[0],
            points[k, 1] - centre[1],
            points[k, 2] - centre[2],
        )
        length = np.sqrt(dx * dx + dy * dy)
        if not length < 40.0:  # NaN too
            continue
        if is_upright[k]:
            i = int(np.floor((points[k, 0] - low[0]) / CELL_M))
            j = int(np.floor((points[k, 1] - low[1]) / CELL_M))
            b = int(np.floor((points[k, 2] - low[2]) / BIN_M))
            if 0 < i < nx - 1 and 0 < j < ny - 1 and 0 <= b < nz:
                for di in range(-1, 2):
                    for dj in range(-1, 2):
                        if hits[i + di, j + dj, b] < 250:
                            hits[i + di, j + dj, b] += 1
        n_steps = int((length - _STOP_M) / (0.5 * CELL_M))
        for s in range(n_steps):
            t = (s + 0.5) * 0.5 * CELL_M / length
            i = int(np.floor((centre[0] + t * dx - low[0]) / CELL_M))
            j = int(np.floor((centre[1] + t * dy - low[1]) / CELL_M))
            if i < 0 or j < 0 or i >= nx or j >= ny:
                break
            b = int(np.floor((centre[2] + t * dz - low[2]) / BIN_M))
            if b > sight[i, j]:
                sight[i, j] = min(b, nz - 1)


@numba.njit(cache=True, nogil=True)
def _extents(hits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest bin (nx, ny) with two upright points or more; nz and -1 where there is none."""
    nx, ny, nz = hits.shape
    bottom = np.full((nx, ny), nz, dtype=np.int16)
    top = np.full((nx, ny), -1, dtype=np.int16)
    for i in range(nx):
        for j in range(ny):
            for b in range(nz):
                if hits[i, j, b] >= 2:
                    top[i, j] = b
                    bottom[i, j] = min(bottom[i, j], b)
    return bottom, top

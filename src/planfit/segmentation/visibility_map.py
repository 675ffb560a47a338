"""What a submap of a scan shows of its surroundings: heights of floor and ceiling, and what is wall.

Furniture is told from walls by what is seen over it. Cameras see past the top of a cupboard, however tall,
to the wall behind; nothing is ever seen over a wall, also where only its foot is in view. So the visibility
map of a submap keeps, for each cell, the highest upright surface and the highest line of sight. Poses
drift, so a submap is short.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8
from scipy.ndimage import minimum_filter

from planfit.priors import CAMERA_HEIGHT_M, CAMERA_HEIGHT_SIGMA_SHARE, DEPTH_REACH_M
from planfit.segmentation.label_kernels import (
    BIN_M,
    CELL_M,
    trace_rays,
    upright_extents,
    wall_cells_at,
)

_N_BINS = 60
_BELOW_M = 3.0
"""The map reaches from this far below the mean camera to the same above."""
_REACH_M = DEPTH_REACH_M.value
_EVEN_SHARE, _LEAST_SHARE = 1 / 3, 1 / 30
"""Of the points on the largest level, so many on a lower one are as often of the floor as not; and least."""
_APART_M = 0.3
"""Levels that are not one, and the camera from any."""
_WORTH = 0.5
"""Of the logarithm of a share beside that of a probability: points of one surface are seen together."""


@dataclass(frozen=True)
class FrameSample:
    """Few points of one frame, in the world turned upright."""

    centre: Float[np.ndarray, "3"]
    """m, of the camera."""
    points: Float32[np.ndarray, "n 3"]
    """m."""
    normal_z: Float[np.ndarray, " n"]
    """Upward part of the normals; NaN where unsure."""


@dataclass(frozen=True)
class Submap:
    """What some consecutive frames show of their surroundings, in the world turned upright."""

    low_xy: Float[np.ndarray, "2"]
    """m, corner of the map."""
    is_wall: UInt8[np.ndarray, "nx bytes"]
    """A bit for each cell whose upright surfaces are wall, eight along y a byte (`np.packbits`)."""
    n_y: int
    """Cells along y."""
    floor_m: float
    """Height of the floor; NaN where none is seen."""
    ceilings_m: Float[np.ndarray, " k"]
    """Heights of ceilings, most seen first."""

    def wall_at(self, xy: Float[np.ndarray, "*batch 2"]) -> Bool[np.ndarray, "*batch"]:
        """Whether upright surfaces at places (m) are wall; False off the map and at NaN."""
        flat = np.asarray(xy, dtype=float).reshape(-1, 2)
        return wall_cells_at(flat, self.low_xy, self.is_wall, self.n_y).reshape(xy.shape[:-1])


def build_submap(
    samples: Sequence[FrameSample], tilt_sine: float, free_above_m: float, min_rise_m: float
) -> Submap:
    """What samples of consecutive frames show.

    Args:
        tilt_sine: surfaces whose normals lie within this (sine) of level are upright.
        free_above_m: what is seen over by more than this is no wall.
        min_rise_m: walls are seen over at least this range of heights.
    """
    centres = np.array([s.centre for s in samples])
    middle_z = float(centres[:, 2].mean())
    low = np.array([*(centres[:, :2].min(axis=0) - _REACH_M), middle_z - _BELOW_M])
    size = centres[:, :2].max(axis=0) + _REACH_M - low[:2]
    shape = (*np.ceil(size / CELL_M).astype(int), _N_BINS)
    hits = np.zeros(shape, dtype=np.uint8)
    highest_ray = np.full(shape[:2], -1, dtype=np.int16)
    for s in samples:
        with np.errstate(invalid="ignore"):
            is_upright = np.abs(s.normal_z) < tilt_sine
        trace_rays(s.centre, s.points.astype(float), is_upright, low, hits, highest_ray)
    bottom, top = upright_extents(hits)
    # A line of sight along a wall passes the cells before it, but none behind.
    seen_over = minimum_filter(highest_ray, size=3)
    is_wall = (top - bottom + 1) * BIN_M >= min_rise_m
    is_wall &= (seen_over - top) * BIN_M <= free_above_m
    floor_m, ceilings_m = _level_heights(samples, tilt_sine)
    return Submap(low[:2], np.packbits(is_wall, axis=1), is_wall.shape[1], floor_m, ceilings_m)


def _level_heights(samples: Sequence[FrameSample], tilt_sine: float) -> tuple[float, np.ndarray]:
    """Height of the floor, and heights of ceilings, as level surfaces that many points lie on."""
    points_z = np.concatenate([s.points[:, 2] for s in samples]).astype(float)
    above = np.concatenate([s.points[:, 2] - s.centre[2] for s in samples])
    facing = np.concatenate([s.normal_z for s in samples])
    with np.errstate(invalid="ignore"):
        is_near = above > -_BELOW_M
        floor_like = points_z[(facing > 0.96) & (above < -_APART_M) & is_near]
        ceiling_like = points_z[(facing < -0.96) & (above > _APART_M)]
        upright_z = points_z[(np.abs(facing) < tilt_sine) & is_near]
    camera_m = float(np.mean([s.centre[2] for s in samples]))
    floor_m = _floor_height(*level_peaks(floor_like, _LEAST_SHARE), camera_m, upright_z)
    return floor_m, level_peaks(ceiling_like, 1 / 4)[0]


def _floor_height(
    levels_m: Float[np.ndarray, " k"],
    counts: Float[np.ndarray, " k"],
    camera_m: float,
    upright_z: Float[np.ndarray, " n"],
) -> float:
    """Which of the level surfaces seen from above is the floor; NaN where there is none.

    A long table may outnumber the floor beneath it. LiDAR sees points below true floors, in open shafts and
    by mirrors, as many as a quarter of those on it, and a submap without its floor cost the ConSLAM scan
    0.02 to 0.05 m. So a lower level is the floor by the odds of its share and of the camera's height then; or
    one that is not seen, by those of the upright surfaces below, such as the fronts beneath a worktop.
    """
    if len(levels_m) == 0:
        return np.nan
    off = _height_sigmas(camera_m - levels_m)
    floor = 0
    for k in np.argsort(-levels_m):
        is_lower = levels_m[k] < levels_m[floor]
        of_share = _WORTH * np.log(counts[k] / (_EVEN_SHARE * counts[0]))
        log_odds = of_share + (off[floor] ** 2 - off[k] ** 2) / 2
        floor = int(k) if is_lower and log_odds > 0.0 else floor
    below = upright_z[upright_z < levels_m[floor] - _APART_M]
    if len(below) < _LEAST_SHARE * counts[0]:
        return float(levels_m[floor])
    # A floor that is not seen lies where the upright surfaces end.
    of_share = _WORTH * np.log(len(below) / (_EVEN_SHARE * counts[0]))
    off_hidden = _height_sigmas(camera_m - np.percentile(below, [5]))[0]
    is_hidden = of_share + (off[floor] ** 2 - off_hidden**2) / 2 > 0.0
    return np.nan if is_hidden else float(levels_m[floor])


def _height_sigmas(height_m: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """How far a camera's height over a floor is from the usual one."""
    return np.log(height_m / CAMERA_HEIGHT_M.value) / CAMERA_HEIGHT_SIGMA_SHARE.value


def level_peaks(
    heights_m: Float[np.ndarray, " n"], min_share: float, min_count: int = 40
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Heights (m) on which many of the given ones lie, most first, and how many.

    Each has at least `min_share` of the first's count, and `min_count`. A histogram of 5 cm bins, summed over
    five of them, so that a level that lies on a border of bins counts whole.
    """
    found: list[tuple[float, float]] = []
    if len(heights_m) == 0:
        return np.zeros(0), np.zeros(0)
    low = heights_m.min() - 0.1
    counts = np.bincount(((heights_m - low) / 0.05).astype(int), minlength=8).astype(float)
    wide = np.convolve(counts, np.ones(5), mode="same")
    least = max(min_share * wide.max(), min_count)
    while wide.max() >= least:
        k = int(np.argmax(wide))
        near = heights_m[np.abs(heights_m - (low + (k + 0.5) * 0.05)) < 0.15]
        found.append((float(np.median(near)), float(wide[k])))
        wide[max(k - 6, 0) : k + 7] = 0  # non-maximum suppression, 0.3 m to both sides
    levels, sizes = np.array(found).reshape(-1, 2).T
    return levels, sizes

"""Straight wall faces among points of upright surfaces seen from above."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from planfit.priors import PATCH_TURN_MOST_DEG

HALF_WIDTH_M = 0.03
"""Points of a line are as near to it, and votes for its offset are counted in steps of this."""
MAX_ANGLE_DEG = PATCH_TURN_MOST_DEG.value
"""Between the normals of a line and of its points."""
MAX_GAP_M = 0.30
"""A line is cut where its points leave more than this."""
MIN_LENGTH_M = 0.40
MIN_SHARE = 2e-4
"""Of all points, on the weakest line."""
_ANGLE_STEP_DEG = 1.0


@dataclass(frozen=True)
class WallLines:
    """Faces found among points, strongest line first."""

    ends: Float[np.ndarray, "n 2 2"]
    """M; the free side is on the left where normals tell it."""
    normals: Float[np.ndarray, "n 2"]
    n_left: int
    """Points on no face."""


def wall_lines(
    xy: Float[np.ndarray, "n 2"], normals: Float[np.ndarray, "n 2"], is_oriented: bool
) -> WallLines:
    """Lines through points, m, with normals, the strongest first, each cut at gaps.

    A line is the peak of the points' own votes for its direction and offset, refined by the middle of
    the points within its width. Where `is_oriented`, the two faces of a thin wall are apart by
    the sign of their normals.
    """
    length = np.linalg.norm(normals, axis=1)
    keep = length > 1e-6
    xy, normals = xy[keep], normals[keep] / length[keep, None]
    period = 360.0 if is_oriented else 180.0
    free = np.arange(len(xy))
    ends, chosen = [], []
    min_votes = max(20.0, MIN_SHARE * len(xy))
    for _ in range(2000):
        if len(free) < min_votes:
            break
        normal, offset, votes = _strongest(xy[free], normals[free], period)
        if votes < min_votes:
            break
        normal, offset = _refined(xy[free], normals[free], normal, offset, is_oriented)
        on = _on_line(xy[free], normals[free], normal, offset, is_oriented)
        if not on.any():
            break
        along = np.array([normal[1], -normal[0]])  # the free side is on its left
        at = np.sort(xy[free[on]] @ along)
        for low, high in _runs(at):
            if high - low >= MIN_LENGTH_M:
                ends.append(offset * normal + np.outer([low, high], along))
                chosen.append(normal)
        free = free[~on]
    return WallLines(np.array(ends).reshape(-1, 2, 2), np.array(chosen).reshape(-1, 2), len(free))


def _strongest(
    xy: Float[np.ndarray, "n 2"], normals: Float[np.ndarray, "n 2"], period: float
) -> tuple[Float[np.ndarray, "2"], float, float]:
    angle = np.rad2deg(np.arctan2(normals[:, 1], normals[:, 0])) % period
    counts = np.bincount((angle / _ANGLE_STEP_DEG).astype(int), minlength=int(period))[
        : int(period)
    ]
    # Directions are few; the best one by its best line, among the five with most points.
    smooth = counts + np.roll(counts, 1) + np.roll(counts, -1)
    best = (np.array([1.0, 0.0]), 0.0, 0.0)
    for step in np.argsort(-smooth)[:5]:
        direction = np.deg2rad((step + 0.5) * _ANGLE_STEP_DEG)
        normal = np.array([np.cos(direction), np.sin(direction)])
        away = np.abs((angle - (step + 0.5) + period / 2) % period - period / 2)
        offset = (xy @ normal)[away < MAX_ANGLE_DEG]
        if len(offset) == 0:
            continue
        low = offset.min()
        votes = np.bincount(((offset - low) / HALF_WIDTH_M).astype(int))
        if votes.max() > best[2]:
            best = (normal, float(low + (votes.argmax() + 0.5) * HALF_WIDTH_M), float(votes.max()))
    return best


def _refined(
    xy: Float[np.ndarray, "n 2"],
    normals: Float[np.ndarray, "n 2"],
    normal: Float[np.ndarray, "2"],
    offset: float,
    is_oriented: bool,
) -> tuple[Float[np.ndarray, "2"], float]:
    for _ in range(5):
        on = _on_line(xy, normals, normal, offset, is_oriented)
        if on.sum() < 3:
            break
        middle = xy[on].mean(axis=0)
        _, vectors = np.linalg.eigh(np.cov((xy[on] - middle).T))
        across = vectors[:, 0] * (1.0 if vectors[:, 0] @ normal > 0 else -1.0)
        if across @ normal < np.cos(np.deg2rad(MAX_ANGLE_DEG)):
            break
        normal, offset = across, float(middle @ across)
    return normal, offset


def _on_line(
    xy: Float[np.ndarray, "n 2"],
    normals: Float[np.ndarray, "n 2"],
    normal: Float[np.ndarray, "2"],
    offset: float,
    is_oriented: bool,
) -> Bool[np.ndarray, " n"]:
    facing = normals @ normal
    facing = facing if is_oriented else np.abs(facing)
    is_near = np.abs(xy @ normal - offset) < HALF_WIDTH_M
    return is_near & (facing > np.cos(np.deg2rad(MAX_ANGLE_DEG)))


def _runs(at: Float[np.ndarray, " n"]) -> list[tuple[float, float]]:
    """Intervals of sorted coordinates without a gap of more than `MAX_GAP_M`."""
    breaks = np.flatnonzero(np.diff(at) > MAX_GAP_M)
    starts = np.concatenate([[0], breaks + 1])
    stops = np.concatenate([breaks, [len(at) - 1]])
    return [(float(at[a]), float(at[b])) for a, b in zip(starts, stops, strict=True)]

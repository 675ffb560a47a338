"""Ceilings: which one each frame sees, and whether two heights are one ceiling under drift.

Where cameras look level, floor is seldom seen and ceilings alone hold heights. Poses that drifted by half a
metre show one ceiling at two heights, and held there each, the drift stays. Frames on the way from one height
to the other tell: between two ceilings there is none, between two ends of a drift there are all heights. So
both are solved, without the plan, and the one that costs less stands.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from planfit.adjust.competition import RIVAL_COST
from planfit.adjust.measurements import Measurements
from planfit.adjust.options import AdjustOptions
from planfit.adjust.problem import build_problem, ceiling_term
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.lsq.robust import loss_value
from planfit.runtime import let_go
from planfit.segmentation import LevelPoints, Structure
from planfit.segmentation.storeys import MAX_DRIFT_M
from planfit.tracking.types import MIN_WITNESSES

TOLERANCE_M = 0.1
"""A frame belongs to a ceiling when the middle of its ceiling points is within this of it."""
_MIN_SHARE = 0.1
"""Share of the frames with ceiling that a height needs."""
_MIN_GAIN = RIVAL_COST
"""Cost that is saved where they are one, at least: errors of frames of one ceiling are not independent."""


def find_ceilings(structure: Structure, level_from_cams: Poses) -> Float[np.ndarray, " n"]:
    """Height (m) of the ceiling that each frame sees, level frame; NaN where it is none of the common.

    Args:
        level_from_cams: poses with loops closed: heights must agree to a few centimetres.
    """
    middles = level_middles(structure.ceiling, level_from_cams)
    found, seen = np.full(len(level_from_cams), np.nan), np.flatnonzero(np.isfinite(middles))
    middle = middles[seen]
    if len(seen) == 0:
        return found
    for height in _common_heights(middle):
        is_near = np.abs(middle - height) < TOLERANCE_M
        is_near &= ~np.isfinite(found[seen])
        found[seen[is_near]] = np.median(middle[is_near])
    return found


def level_middles(level: LevelPoints, level_from_cams: Poses) -> Float[np.ndarray, " n"]:
    """Height (m) of the middle of each frame's points of a floor or ceiling; NaN where it has none."""
    start = level.start
    middles = np.full(len(level_from_cams), np.nan)
    for i in np.flatnonzero(np.diff(start)):
        own = level.points_cam[start[i] : start[i + 1]]
        middles[i] = np.median(se3.transform(level_from_cams[i], own)[:, 2])
        let_go(own)
    return middles


def _common_heights(middle: np.ndarray) -> list[float]:
    """Heights m that many frames see, most frames first, apart by more than twice the tolerance."""
    left, heights = np.sort(middle), []
    while len(left):
        ends = (np.searchsorted(left, left + by_m) for by_m in (TOLERANCE_M, -TOLERANCE_M))
        counts = np.subtract(*ends)
        if counts.max() < max(_MIN_SHARE * len(middle), MIN_WITNESSES):
            break
        off_m = np.abs(left - left[np.argmax(counts)])
        heights.append(float(np.median(left[off_m <= TOLERANCE_M])))
        left = left[off_m >= 2 * TOLERANCE_M]
    return heights


def settle_ceilings(
    measurements: Measurements, plan_from_cams: Poses, options: AdjustOptions
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Height (m) of the ceiling that each frame sees, NaN where it is none of the common; and the heights
    (m) of the cameras to begin with, which differ from those given where two ceilings were found to be one.

    Args:
        plan_from_cams: level, loops closed.
    """
    structure, cameras_m = measurements.structure, plan_from_cams[:, 2, 3]
    found = find_ceilings(structure, plan_from_cams)
    heights = np.unique(found[np.isfinite(found)])
    if options.ceiling.weight <= 0 or len(heights) < 2:
        return found, cameras_m
    middles = level_middles(structure.ceiling, plan_from_cams)
    sees_floor = np.diff(structure.floor.start) > 0
    cost = _cost(measurements, plan_from_cams, found, options)
    for low, high in pairwise(heights):
        if high - low > MAX_DRIFT_M:
            continue
        is_one = (middles > low - TOLERANCE_M) & (middles < high + TOLERANCE_M)
        # The floor holds the heights of those that see it; where none does, most are right.
        n_low, n_high = (
            (np.sum(sees_floor & (found == height)), np.sum(found == height))
            for height in (low, high)
        )
        merged = np.where(is_one, low if n_low > n_high else high, found)
        poses = _solved(measurements, plan_from_cams, merged, options)
        again = find_ceilings(structure, poses)
        cost_again = _cost(measurements, poses, again, options)
        if cost_again < cost - _MIN_GAIN:
            found, cost, cameras_m = again, cost_again, poses[:, 2, 3]
    return found, cameras_m


def _solved(
    measurements: Measurements,
    plan_from_cams: Poses,
    heights_m: Float[np.ndarray, " n"],
    options: AdjustOptions,
) -> Poses:
    """Poses of a solve without the plan, ceilings at given heights."""
    problem = build_problem(measurements, options, plan_from_cams)
    problem = replace(problem, ceiling=ceiling_term(measurements, heights_m, options))
    return problem.solve().target_from_cams[: len(plan_from_cams)]


def _cost(
    measurements: Measurements,
    plan_from_cams: Poses,
    heights_m: Float[np.ndarray, " n"],
    options: AdjustOptions,
) -> float:
    """Robust cost of all terms solved with ceilings at these heights; a frame whose ceiling is at none costs
    as much as one at the tolerance, or letting go of ceilings would pay."""
    poses = _solved(measurements, plan_from_cams, heights_m, options)
    others = build_problem(measurements, options, poses).costs(poses)
    model, points = options.model("ceiling"), measurements.structure.ceiling
    middles = level_middles(points, poses)
    is_seen = np.isfinite(middles)
    off_m = np.nan_to_num(np.abs(middles - heights_m)[is_seen], nan=TOLERANCE_M)
    each, _ = loss_value((np.minimum(off_m, TOLERANCE_M) / model.sigma) ** 2, model.loss)
    n_points = np.diff(points.start)[is_seen]
    worth = model.weight * n_points * model.weight_per_point(n_points)
    return sum(others.values()) + 0.5 * float(each @ worth)

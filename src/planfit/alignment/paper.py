"""The alignment of the paper (Sec. IV-C), sentence by sentence, with its assumptions checked.

It matches extents and centres, so it needs a scan of the whole plan and of nothing else. `align` is the
default; this is for comparison (`align.method = "paper"`). Three things the paper leaves open are read in
its favour: extents are taken along the plan's axes after the rotation, each of the four rotations is
scaled and translated before its distance is measured, and a plan in metres keeps its scale.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from planfit.alignment.align import Alignment, require_walls
from planfit.alignment.refine import AlignmentHypothesis, explained, metric_plan, rotation_2d
from planfit.alignment.selection import MIN_SCORE
from planfit.alignment.wall_samples import WallSamples, thin
from planfit.errors import ScanError
from planfit.findings import Finding, PlanKind
from planfit.floorplan import Floorplan
from planfit.priors import SURFACE_TILT_MOST_DEG

FLOOR_BIN_M, FLOOR_CLEAR_M = 0.05, 0.2
"""Bins of the height histogram, and how far above its peak points still count as floor."""
N_POINTS, N_NEIGHBOURS = 20_000, 20
"""Points of scan and plan that are compared; neighbours that make a normal or an outlier."""
MAX_RATIO_GAP = 0.05
"""Extents that differ by more than this share show that the scan does not cover the plan."""
MIN_ORTHOGONAL_SHARE = 0.6
"""Share of normals near the two main directions; less is no building of right angles."""


@dataclass(frozen=True)
class PaperHypothesis:
    """One of the four rotations."""

    hypothesis: AlignmentHypothesis
    distance_m: float
    """Mean distance from the boundary scan to the 3D floorplan."""


def align_paper(
    points_level: Float[np.ndarray, "n 3"],
    walls: WallSamples,
    floorplan: Floorplan,
    rng: np.random.Generator,
) -> Alignment:
    """The alignment by the paper's method.

    Args:
        points_level: metres, the whole scan, level frame: floor, walls, furniture.
        walls: the same walls that `align` is given; they only score the result.
        floorplan: in metres, or in a unit of its own.

    Raises:
        ScanError: no boundary is left of the scan.
        FloorplanError: the plan has too few faces.
    """
    require_walls(walls, floorplan)
    boundary = boundary_scan(points_level)
    if len(boundary) < 10 * N_NEIGHBOURS:
        raise ScanError(
            f"the scan: expected walls above the floor, found {len(boundary)} points; scan more of them"
        )
    boundary = boundary[rng.permutation(len(boundary))[:N_POINTS]]
    normals = horizontal_normals(boundary)
    main, share = main_direction(normals)
    of_plan = _plan_direction(floorplan)
    tried = [_try_yaw(boundary, floorplan, of_plan - main + k * np.pi / 2, rng) for k in range(4)]
    tried.sort(key=lambda each: each.distance_m)
    findings = _broken_assumptions(tried, boundary, floorplan, share)
    samples = thin(walls)
    hypotheses = []
    for each in tried:
        score, occluded_share = explained(samples, floorplan, each.hypothesis)
        hypotheses.append(replace(each.hypothesis, score=score, occluded_share=occluded_share))
    best = hypotheses[0]
    if best.score < MIN_SCORE:
        shares = {"wall_share": best.score, "min_wall_share": MIN_SCORE}
        findings.append(Finding(PlanKind.LITTLE_WALL_BY_PAPER, shares))
    return Alignment(
        best.plan_from_level,
        best.score,
        hypotheses[1],
        is_sure=not findings,
        findings=tuple(findings),
        scale_xy=best.scale_xy,
        candidates=tuple(hypotheses),
    )


def boundary_scan(points_level: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "k 3"]:
    """Points without floor and furniture.

    "The peak value of the histogram corresponds to the floor plane, so we remove the points located
    below a given threshold. Filtering out the points whose horizontal projections are statistical
    outliers allows us to remove the furniture."
    """
    height = points_level[:, 2]
    levels, counts = np.unique(np.floor(height / FLOOR_BIN_M), return_counts=True)
    floor = FLOOR_BIN_M * (levels[np.argmax(counts)] + 0.5)
    above = points_level[height > floor + FLOOR_CLEAR_M]
    if len(above) <= N_NEIGHBOURS:
        return above
    near = np.asarray(cKDTree(above[:, :2]).query(above[:, :2], N_NEIGHBOURS + 1)[0])
    distance = near[:, 1:].mean(axis=1)
    return above[distance < distance.mean() + 2 * distance.std()]


def floorplan_3d(
    floorplan: Floorplan, low: float, high: float, rng: np.random.Generator
) -> Float[np.ndarray, "n 3"]:
    """Points (m), random and uniform on a rectangle above each segment, from `low` to `high`."""
    share = floorplan.lengths / floorplan.lengths.sum()
    face = rng.choice(len(floorplan), N_POINTS, p=share)
    t = rng.random((N_POINTS, 1))
    xy = floorplan.ends[face, 0] * (1 - t) + floorplan.ends[face, 1] * t
    return np.column_stack([xy, rng.uniform(low, high, N_POINTS)])


def horizontal_normals(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "k 2"]:
    """Unit normals of points on vertical surfaces, from their neighbours, either sign."""
    _, idx = cKDTree(points).query(points, N_NEIGHBOURS)
    near = points[idx] - points[idx].mean(axis=1, keepdims=True)
    _, vectors = np.linalg.eigh(np.einsum("nka,nkb->nab", near, near))
    normals = vectors[:, :, 0]
    level = normals[np.abs(normals[:, 2]) < 0.3, :2]
    return level / np.linalg.norm(level, axis=1, keepdims=True)


def main_direction(normals: Float[np.ndarray, "n 2"]) -> tuple[float, float]:
    """Angle (rad) of the most frequent pair of orthogonal directions, and the share of normals near it."""
    angle = np.rad2deg(np.arctan2(normals[:, 1], normals[:, 0])) % 90.0
    bins = np.bincount(np.round(angle).astype(int) % 90, minlength=90)
    smooth = np.sum([np.roll(bins, k) for k in range(-2, 3)], axis=0)
    peak = int(np.argmax(smooth))
    off = (angle - peak + 45.0) % 90.0 - 45.0
    near = np.abs(off) < 3.0
    fine = peak + (float(off[near].mean()) if near.any() else 0.0)
    return float(np.deg2rad(fine)), float(np.mean(np.abs(off) < SURFACE_TILT_MOST_DEG.value))


def _plan_direction(floorplan: Floorplan) -> float:
    """Angle (rad) of the most common normal of the plan, by length."""
    angle = np.rad2deg(np.arctan2(floorplan.normals[:, 1], floorplan.normals[:, 0])) % 180.0
    bins = np.bincount(np.round(angle).astype(int) % 180, floorplan.lengths, minlength=180)
    peak = int(np.argmax(bins))
    off = (angle - peak + 90.0) % 180.0 - 90.0
    near = np.abs(off) < 1.0
    return float(np.deg2rad(peak + np.average(off[near], weights=floorplan.lengths[near])))


def _try_yaw(
    boundary: Float[np.ndarray, "n 3"], floorplan: Floorplan, yaw: float, rng: np.random.Generator
) -> PaperHypothesis:
    """Scale from the ratio of extents, translation from the centres, and the mean distance."""
    xy = boundary[:, :2] @ rotation_2d(yaw).T
    low, high = xy.min(axis=0), xy.max(axis=0)
    plan_xy = floorplan.ends.reshape(-1, 2)
    plan_low, plan_high = plan_xy.min(axis=0), plan_xy.max(axis=0)
    ratio = np.ones(2)
    if not floorplan.is_metric:
        ratio = (high - low) / np.maximum(plan_high - plan_low, 1e-12)
    scale_xy = float(ratio[0]), float(ratio[1])
    translation = (plan_low + plan_high) / 2 * ratio - (low + high) / 2
    heights = float(boundary[:, 2].min()), float(boundary[:, 2].max())
    model = floorplan_3d(metric_plan(floorplan, scale_xy), *heights, rng)
    aligned = np.column_stack([xy + translation, boundary[:, 2]])
    distance = float(np.mean(cKDTree(model).query(aligned)[0]))
    return PaperHypothesis(AlignmentHypothesis(yaw, translation, 0.0, scale_xy), distance)


def _broken_assumptions(
    tried: list[PaperHypothesis],
    boundary: Float[np.ndarray, "n 3"],
    floorplan: Floorplan,
    share: float,
) -> list[Finding]:
    """What the paper takes for granted and does not hold here."""
    found = []
    best = tried[0].hypothesis
    xy = boundary[:, :2] @ rotation_2d(best.yaw).T
    ratio = np.ptp(xy, axis=0) / np.maximum(floorplan.size, 1e-12)
    expected = 1.0 if floorplan.is_metric else float(np.sqrt(ratio.prod()))
    if np.abs(np.log(ratio / expected)).max() > MAX_RATIO_GAP:
        ratios = {"x_ratio": float(ratio[0]), "y_ratio": float(ratio[1])}
        found.append(Finding(PlanKind.EXTENTS_DIFFER, ratios))
    if share < MIN_ORTHOGONAL_SHARE:
        found.append(Finding(PlanKind.FEW_RIGHT_ANGLES, {"orthogonal_share": share}))
    if tried[1].distance_m < 1.1 * tried[0].distance_m:
        both = {"distance_m": tried[0].distance_m, "other_distance_m": tried[1].distance_m}
        found.append(Finding(PlanKind.ROTATIONS_ALIKE, both))
    return found

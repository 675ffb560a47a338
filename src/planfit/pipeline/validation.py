"""Never make it worse: held-out matches, wall on the plan, and misfit, before and after the solve."""

from dataclasses import dataclass, replace

import numpy as np

from planfit.floorplan import Floorplan, nearest_faces
from planfit.geometry import se3
from planfit.matching import Matches
from planfit.segmentation import Structure

NEAR_FACE_M = 0.10
"""A wall point this near to a face of the plan counts as supported."""


MAX_INCONSISTENCY = 1.25
"""Cost of matches, floor and trajectory with the walls' pull over that without. Measured on synthetic
scans and ConSLAM: right plans 1.00 to 1.05, plans of other buildings mostly 1.1 to 1.9."""


@dataclass(frozen=True)
class Check:
    """One number that should not get worse."""

    name: str
    before: float
    after: float
    unit: str
    is_worse: bool
    advice: str = "do not use these poses without looking at the report"
    """What to do where it got worse."""


def hold_out(matches: Matches, share: float, rng: np.random.Generator) -> tuple[Matches, Matches]:
    """Split matches at random, within every pair: those to solve with, and those held out."""
    held = rng.random(matches.n_matches) < share
    return _keep(matches, ~held), _keep(matches, held)


def match_check(
    held_out: Matches, before_from_cams: np.ndarray, after_from_cams: np.ndarray
) -> Check | None:
    """Median distance between held-out matched points; None where there are too few to tell."""
    if held_out.n_matches < 30:
        return None
    before, after = (
        match_distances(held_out, poses) for poses in (before_from_cams, after_from_cams)
    )
    first, last = float(np.median(before)), float(np.median(after))
    return Check("held-out matches, median distance", first, last, "m", last > 1.02 * first)


def wall_check(
    structure: Structure,
    floorplan: Floorplan,
    before_from_cams: np.ndarray,
    after_from_cams: np.ndarray,
) -> Check | None:
    """Share of wall points near a face of the plan; None where no wall was seen."""
    if not structure.has_walls:
        return None
    first, last = (
        float(np.mean(wall_distances(structure, floorplan, poses) < NEAR_FACE_M))
        for poses in (before_from_cams, after_from_cams)
    )
    name = f"wall points within {NEAR_FACE_M:g} m of the plan"
    return Check(name, first, last, "share", last < first - 0.01)


def consistency_check(cost_without: float, cost_with: float, n_frames: int) -> Check | None:
    """Whether plan and scan pull apart; None where they do not.

    Args:
        cost_without: cost of the terms that need no plan, loops closed, before the walls pull.
        cost_with: the same after.
        n_frames: at least three a frame are allowed for `cost_without`, which is what correcting
            drift by walls costs a trajectory that nothing else corrects.
    """
    tension = cost_with / max(cost_without, 3.0 * n_frames)
    if tension <= MAX_INCONSISTENCY:
        return None
    return Check(
        "misfit of matches and trajectory, without and with the walls' pull,",
        1.0,
        tension,
        "times",
        is_worse=True,
        advice="the plan may differ from the building where the report shows large distances, or "
        "be of another place",
    )


def match_distances(matches: Matches, target_from_cams: np.ndarray) -> np.ndarray:
    """Distances (m,) m between matched points at poses (n, 4, 4)."""
    pair = np.repeat(np.arange(len(matches.pairs)), np.diff(matches.start))
    first, second = matches.pairs[pair].T
    a = se3.transform_each(target_from_cams[first], matches.points_a)
    b = se3.transform_each(target_from_cams[second], matches.points_b)
    return np.linalg.norm(a - b, axis=1)


def wall_points_plan(
    structure: Structure, plan_from_cams: np.ndarray, max_points: int | None = None
) -> np.ndarray:
    """Wall points (n, 3) m of the scan, the paper's P_W, in the plan frame; evenly thinned."""
    frame_idx = np.concatenate([structure.walls.point_frame_idx, structure.unassigned_frame_idx])
    points_cam = np.concatenate([structure.walls.points_cam, structure.unassigned_points_cam])
    keep = _thinned(len(points_cam), max_points)
    return se3.transform_each(plan_from_cams[frame_idx[keep]], points_cam[keep])


def wall_distances(
    structure: Structure, floorplan: Floorplan, plan_from_cams: np.ndarray, max_points: int = 60000
) -> np.ndarray:
    """Distances (m,) m of wall points to the nearest segment of the plan; evenly thinned."""
    points = wall_points_plan(structure, plan_from_cams, max_points)
    return nearest_faces.nearest_distance(points[:, :2], floorplan.ends)


def floor_heights(
    structure: Structure, target_from_cams: np.ndarray, max_points: int = 200_000
) -> np.ndarray:
    """Heights (m,) m of floor points above the floor plane; evenly thinned."""
    return floor_points(structure, target_from_cams, max_points)[:, 2]


def floor_points(
    structure: Structure, target_from_cams: np.ndarray, max_points: int | None = None
) -> np.ndarray:
    """Floor points (n, 3) m of the scan, the paper's P_F, in the target frame; evenly thinned."""
    keep = _thinned(len(structure.floor.points_cam), max_points)
    poses = target_from_cams[structure.floor.frame_idx[keep]]
    return se3.transform_each(poses, structure.floor.points_cam[keep])


def surface_metrics(
    structure: Structure, floorplan: Floorplan, plan_from_cams: np.ndarray
) -> dict[str, float]:
    """How well walls and floor agree with the plan; a figure is absent where nothing was seen.

    `nsd_m`: mean distance of wall points to the nearest plan segment (paper, Sec. IV-B).
    `near_plan_share`: share of them within `NEAR_FACE_M`. `floor_rms_m`: RMS height of floor points
    about their mean. `floor_median_m`: half of the floor points lie within this of the floor plane,
    which what merely lies on the floor moves less.
    """
    metrics = {}
    if structure.n_wall_points:
        distances = wall_distances(structure, floorplan, plan_from_cams)
        metrics["nsd_m"] = float(distances.mean())
        metrics["near_plan_share"] = float(np.mean(distances < NEAR_FACE_M))
    if structure.has_floor:
        heights = floor_heights(structure, plan_from_cams)
        metrics["floor_rms_m"] = float(np.std(heights))
        metrics["floor_median_m"] = float(np.median(np.abs(heights)))
    return metrics


def _thinned(n_points: int, max_points: int | None) -> slice:
    """Evenly thinned to about `max_points`: each point takes a transform of its own, 128 bytes."""
    return slice(None, None, max(1, n_points // max_points) if max_points else 1)


def _keep(matches: Matches, keep: np.ndarray) -> Matches:
    sizes = np.add.reduceat(keep.astype(int), matches.start[:-1]) if len(matches.pairs) else []
    some = np.asarray(sizes, dtype=int) > 0
    return replace(
        matches,
        pairs=matches.pairs[some],
        start=np.cumsum([0, *np.asarray(sizes, dtype=int)[some]]),
        points_a=matches.points_a[keep],
        points_b=matches.points_b[keep],
        sigma=matches.sigma[keep],
    )

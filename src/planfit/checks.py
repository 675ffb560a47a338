"""Never make it worse: evidence that took no part in the solve, before and after."""

from dataclasses import dataclass, replace

import numpy as np

from planfit.floorplan import Floorplan
from planfit.geometry import se3, segments
from planfit.matching import Matches
from planfit.structure import Structure

NEAR_FACE_M = 0.10
"""A wall point this near to a face of the plan counts as supported."""


@dataclass(frozen=True)
class Check:
    """One number that should not get worse."""

    name: str
    before: float
    after: float
    unit: str
    is_worse: bool


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
    if structure.n_patches == 0:
        return None
    first, last = (
        float(np.mean(wall_distances(structure, floorplan, poses) < NEAR_FACE_M))
        for poses in (before_from_cams, after_from_cams)
    )
    name = f"wall points within {NEAR_FACE_M:g} m of the plan"
    return Check(name, first, last, "share", last < first - 0.01)


def match_distances(matches: Matches, target_from_cams: np.ndarray) -> np.ndarray:
    """Distances (m,) m between matched points at poses (n, 4, 4)."""
    pair = np.repeat(np.arange(len(matches.pairs)), np.diff(matches.start))
    first, second = matches.pairs[pair].T
    a = _transform_each(target_from_cams[first], matches.points_a)
    b = _transform_each(target_from_cams[second], matches.points_b)
    return np.linalg.norm(a - b, axis=1)


def wall_points_plan(structure: Structure, plan_from_cams: np.ndarray) -> np.ndarray:
    """All wall points (n, 3) m of the scan, the paper's P_W, in the plan frame."""
    return np.concatenate(
        [
            _transform_each(plan_from_cams[structure.wall_frame_idx], structure.wall_points_cam),
            _transform_each(plan_from_cams[structure.loose_frame_idx], structure.loose_points_cam),
        ]
    )


def wall_distances(
    structure: Structure, floorplan: Floorplan, plan_from_cams: np.ndarray, max_points: int = 60000
) -> np.ndarray:
    """Distances (m,) m of wall points to the nearest segment of the plan; evenly thinned."""
    points = wall_points_plan(structure, plan_from_cams)
    step = max(1, len(points) // max_points)
    return segments.nearest_distance(points[::step, :2], floorplan.ends)


def floor_heights(structure: Structure, target_from_cams: np.ndarray) -> np.ndarray:
    """Heights (f,) m of floor points above the floor plane."""
    poses = target_from_cams[structure.floor_frame_idx]
    return _transform_each(poses, structure.floor_points_cam)[:, 2]


def _transform_each(target_from_cams: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Each point (n, 3) by its own transform (n, 4, 4)."""
    return se3.transform(target_from_cams, points[:, None])[:, 0]


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

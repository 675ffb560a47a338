"""Walls of a whole scan and planes of its plan that are mutually nearest: the paper's rule (Sec. III-E).

The paper clusters wall points by their normals, fits vertical planes, and takes such a plane and one of the
plan for the same wall where they are parallel and each is the nearest to the other. Here:

- *walls* are the patches of all frames that look the same way and lie on one plane, without a gap wider than
  a door: two laps of a drifted scan make two walls of one, and so do the two sides of a partition;
- *plan planes* are the faces that lie on one line, as a wall is drawn in pieces between its doors;
- a wall's plane is that with the least mean distance from its patches, among those that it lies beside;
- a wall is nearest to a plane place by place: it is compared with the walls that stand over the same stretch
  of that plane. Walls of neighbouring rooms along one plane do not exclude each other.

So of a wall that drift has doubled, the layer nearer to the plan is held to it; the other follows by matches.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.floorplan import Floorplan
from planfit.floorplan.nearest_faces import BesideRule, distances_of_segments
from planfit.geometry import segments
from planfit.priors import DOOR_GAP_M, DRAWING_ROUNDING_M

WALL_TOLERANCE_M = 0.1
"""Patches whose ends lie within this of a wall's plane belong to it; half the thickness of a partition."""
MAX_GAP_M = DOOR_GAP_M.value
"""Patches of one plane further apart than this along it are two walls; a door is narrower."""
PLAN_TOLERANCE_M = DRAWING_ROUNDING_M.value
"""Faces of the plan within this of one line are one plane."""
_PART = 2048
"""Patches at a time: bounds the (patches x faces) tables."""


def mutually_nearest(
    ends: Float[np.ndarray, "k 2 2"],
    normals: Float[np.ndarray, "k 2"],
    n_points: Int[np.ndarray, " k"],
    floorplan: Floorplan,
    rule: BesideRule,
) -> tuple[Float[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Signed distance (m) of each patch to the face of its wall's mutually nearest plane, and the face.

    NaN and -1 where there is none.

    Args:
        ends: of the patches of all frames, plan frame, seen from above, metres.
        normals: unit, towards where each patch was seen from.
        n_points: of each patch; walls are made of the largest patches first, and means go by points.
    """
    if len(ends) == 0 or len(floorplan) == 0:
        return np.full(len(ends), np.nan), np.full(len(ends), -1)
    walls = group_by_plane(ends, normals, n_points, WALL_TOLERANCE_M, rule.max_angle_deg, MAX_GAP_M)
    # Free sides of collinear faces do not matter here: the rule looks at them face by face.
    planes = group_by_plane(
        floorplan.ends, floorplan.normals, floorplan.lengths, PLAN_TOLERANCE_M, 0.5, np.inf
    )
    patches = _Patches(ends, normals, n_points, walls, floorplan, planes, rule)
    wall_to_plane_m = patches.wall_distances()
    plane_idx, face_idx, signed_m = patches.choose(wall_to_plane_m)
    is_mutual = patches.is_nearest_there(wall_to_plane_m, plane_idx, face_idx)
    return np.where(is_mutual, signed_m, np.nan), np.where(is_mutual, face_idx, -1)


def group_by_plane(
    ends: Float[np.ndarray, "k 2 2"],
    normals: Float[np.ndarray, "k 2"],
    weights: Float[np.ndarray, " k"] | Int[np.ndarray, " k"],
    tolerance_m: float,
    max_angle_deg: float,
    max_gap_m: float,
) -> Int[np.ndarray, " k"]:
    """Number of the upright plane that each segment lies on; numbers have no gaps.

    Greedy: the heaviest segment that is left takes all that look its way and lie within the tolerance of its
    line, the line is fitted to them once more, and the run around the segment without a gap is a plane.
    """
    group, n_groups = np.full(len(ends), -1), 0
    cosine_limit = np.cos(np.deg2rad(max_angle_deg))
    for seed in np.argsort(-np.asarray(weights, dtype=float), kind="stable"):
        if group[seed] >= 0:
            continue
        normal, centre = normals[seed], ends[seed].mean(axis=0)
        members = np.array([seed])
        for _ in range(2):
            off_m = np.abs((ends - centre) @ normal).max(axis=1)
            is_near = (group < 0) & (off_m < tolerance_m) & (normals @ normal > cosine_limit)
            is_near[seed] = True
            members = _run_around(seed, np.flatnonzero(is_near), ends, normal, max_gap_m)
            normal, centre = _fit_line(ends[members], np.asarray(weights)[members], normals[seed])
        group[members] = n_groups
        n_groups += 1
    return group


def _run_around(
    seed: int, candidates: np.ndarray, ends: np.ndarray, normal: np.ndarray, max_gap_m: float
) -> np.ndarray:
    """Those candidates (c,) that hang together with the seed along the line."""
    at = ends[candidates] @ np.array([-normal[1], normal[0]])
    low, high = at.min(axis=1), at.max(axis=1)
    order = np.argsort(low, kind="stable")
    reached = np.maximum.accumulate(high[order])
    run = np.concatenate([[0], np.cumsum(low[order][1:] > reached[:-1] + max_gap_m)])
    of_seed = run[np.flatnonzero(candidates[order] == seed)[0]]
    return candidates[order[run == of_seed]]


def _fit_line(
    ends: np.ndarray, weights: np.ndarray, towards: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Unit normal (2,), to the side of `towards`, and centre (2,) of the line through segments (m, 2, 2)."""
    points, w = ends.reshape(-1, 2), np.repeat(weights, 2) / (2 * np.sum(weights))
    centre = w @ points
    _, vectors = np.linalg.eigh((points - centre).T @ ((points - centre) * w[:, None]))
    normal = vectors[:, 0]  # eigenvalues rise: least scatter
    return (normal if normal @ towards > 0 else -normal), centre


@dataclass(frozen=True)
class _Patches:
    """Patches (k,), the wall of each, and the plane of each face (f,)."""

    ends: np.ndarray
    normals: np.ndarray
    n_points: np.ndarray
    walls: np.ndarray
    floorplan: Floorplan
    planes: np.ndarray
    rule: BesideRule

    def to_planes(self) -> Iterator[tuple[slice, np.ndarray, np.ndarray, np.ndarray]]:
        """Parts of the patches: distance (m) to each plane (part, planes), and to each face, signed; the
        faces' order by plane. Infinite and NaN where the patch does not lie beside."""
        by_plane = np.argsort(self.planes, kind="stable")
        first = np.searchsorted(self.planes[by_plane], np.arange(self.planes.max() + 1))
        for begin in range(0, len(self.ends), _PART):
            part = slice(begin, min(begin + _PART, len(self.ends)))
            own = (self.ends[part], self.normals[part])
            signed = distances_of_segments(*own, self.floorplan, self.rule.of(part))
            distance = np.where(np.isnan(signed), np.inf, np.abs(signed))
            yield part, np.minimum.reduceat(distance[:, by_plane], first, axis=1), distance, signed

    def wall_distances(self) -> np.ndarray:
        """Mean distance (m) from the points of each wall to each plane (walls, planes).

        Infinite where less of the wall than `min_overlap`, by points, lies beside the plane's faces.
        """
        walls, shape = self.walls, (self.walls.max() + 1, self.planes.max() + 1)
        total, beside = np.zeros(shape), np.zeros(shape)
        for part, to_plane, _, _ in self.to_planes():
            is_beside = np.isfinite(to_plane)
            weight = is_beside * self.n_points[part, None]
            np.add.at(total, walls[part], np.where(is_beside, to_plane, 0.0) * weight)
            np.add.at(beside, walls[part], weight)
        share = beside / np.bincount(walls, weights=self.n_points)[:, None]
        is_enough = (share >= self.rule.min_overlap) & (beside > 0)
        return np.where(is_enough, total / np.maximum(beside, 1), np.inf)

    def choose(self, wall_to_plane_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of each patch (k,) the plane nearest to its wall (-1: none), the face of it that the patch lies
        beside (-1: none), and the distance along the face's normal (NaN without a face)."""
        nearest = np.argmin(wall_to_plane_m, axis=1)
        has_any = np.isfinite(wall_to_plane_m[np.arange(len(nearest)), nearest])
        plane_idx = np.where(has_any, nearest, -1)[self.walls]
        face_idx, signed_m = np.full(len(self.ends), -1), np.full(len(self.ends), np.nan)
        for part, _, distance, signed in self.to_planes():
            of_plane = np.where(self.planes[None] == plane_idx[part, None], distance, np.inf)
            rows, face = np.arange(len(of_plane)), np.argmin(of_plane, axis=1)
            found = np.isfinite(of_plane[rows, face])
            face_idx[part] = np.where(found, face, -1)
            signed_m[part] = np.where(found, signed[rows, face], np.nan)
        return plane_idx, face_idx, signed_m

    def is_nearest_there(
        self, wall_to_plane_m: np.ndarray, plane_idx: np.ndarray, face_idx: np.ndarray
    ) -> Bool[np.ndarray, " k"]:
        """Whether no other wall over a patch's middle is nearer to the plane than the patch's own."""
        is_nearest = np.zeros(len(self.ends), dtype=bool)
        for plane in np.unique(plane_idx[face_idx >= 0]):
            patches = np.flatnonzero((plane_idx == plane) & (face_idx >= 0))
            rivals = np.flatnonzero(np.isfinite(wall_to_plane_m[:, plane]))
            along = segments.directions(self.floorplan.ends[self.planes == plane][:1])[0]
            low, high = _extents(self.ends @ along, self.walls, rivals)
            middle = self.ends[patches].mean(axis=1) @ along
            is_over = (low <= middle[:, None]) & (middle[:, None] <= high)
            least = np.where(is_over, wall_to_plane_m[rivals, plane], np.inf).min(axis=1)
            is_nearest[patches] = wall_to_plane_m[self.walls[patches], plane] <= least
        return is_nearest


def _extents(
    at: np.ndarray, walls: np.ndarray, of_walls: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where walls (w,) begin and end, of the positions (k, 2) of their patches' ends."""
    low, high = np.full(walls.max() + 1, np.inf), np.full(walls.max() + 1, -np.inf)
    np.minimum.at(low, walls, at.min(axis=1))
    np.maximum.at(high, walls, at.max(axis=1))
    return low[of_walls], high[of_walls]

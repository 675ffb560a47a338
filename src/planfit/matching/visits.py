"""Visits: pairs of frames that say the same of two stretches of the walk, and stand or fall together."""

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from planfit.geometry import se3
from planfit.matching.cycles import by_way_of, is_near
from planfit.matching.pairs import RECENT_M
from planfit.matching.types import Matches, RelativePoses
from planfit.runtime import let_go
from planfit.scan.odometry import Odometry

LINK_M = 1.5
"""Pairs whose ends are both within this much of way are linked where their motions agree."""


def relative_poses_of(matches: Matches) -> RelativePoses:
    """The motion that the matches of each pair agree on best, all pairs at once (Kabsch 1976)."""
    size = np.diff(matches.start)
    if len(size) == 0:
        return RelativePoses(matches.pairs, np.zeros((0, 4, 4)), size, matches.explained)
    motion = np.concatenate(
        [_motions(matches, part.start, part.stop) for part in se3.groups_in_parts(matches.start)]
    )
    return RelativePoses(matches.pairs, motion, size, matches.explained)


def _motions(matches: Matches, first: int, last: int) -> Float[np.ndarray, "k 4 4"]:
    """Of pairs first..last - 1, each of which has matches."""
    of = slice(matches.start[first], matches.start[last])
    size = np.diff(matches.start[first : last + 1])
    begin = matches.start[first:last] - matches.start[first]
    points_a, points_b = (p[of].astype(float) for p in (matches.points_a, matches.points_b))
    let_go(matches.points_a[of])
    let_go(matches.points_b[of])
    weight = 1.0 / matches.sigma[of, None].astype(float) ** 2
    total = np.add.reduceat(weight, begin)
    mean_a, mean_b = (
        np.add.reduceat(weight * points, begin) / total for points in (points_a, points_b)
    )
    off_a = points_a - np.repeat(mean_a, size, axis=0)
    off_b = points_b - np.repeat(mean_b, size, axis=0)
    # Weighted sums of a b^T over the matches of each pair; the nearest rotation to it is the best.
    covariance = np.add.reduceat(weight[:, :, None] * off_a[:, :, None] * off_b[:, None, :], begin)
    rotation = se3.project_to_so3(covariance)
    return se3.make_transform(rotation, mean_a - (rotation @ mean_b[..., None])[..., 0])


def group_visits(
    relative_poses: RelativePoses,
    world_from_cams: Float[np.ndarray, "n 4 4"],
    odometry: Odometry,
) -> Int[np.ndarray, " p"]:
    """Number of the visit that each pair belongs to; -1 where its frames are neighbours on the walk.

    Two pairs are of one visit where going from one end to the other's, over its motion and back, gives its
    motion, within what the recorded steps allow; and so are pairs that others link.
    """
    visit = np.full(len(relative_poses), -1)
    walked = odometry.walked_m[relative_poses.pairs]
    far = np.flatnonzero(np.abs(walked[:, 1] - walked[:, 0]) > RECENT_M)
    if len(far) == 0:
        return visit
    links = cKDTree(walked[far]).query_pairs(LINK_M, p=np.inf, output_type="ndarray")
    one, other = relative_poses[far[links[:, 0]]], relative_poses[far[links[:, 1]]]
    predicted = by_way_of(other, one.pairs, world_from_cams)
    (i, j), (k, m) = one.pairs.T, other.pairs.T
    first, second = odometry.sigma_between(i, k), odometry.sigma_between(m, j)
    sigmas = (np.hypot(first[0], second[0]), np.hypot(first[1], second[1]))
    a, b = links[is_near(one.a_from_b, predicted, sigmas)].T
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(len(far), len(far)))
    visit[far] = connected_components(graph, directed=False)[1]
    return visit

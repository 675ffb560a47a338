"""Visits: pairs of frames that say the same of two stretches of the walk, and whether images misled them.

Where the same picture hangs four times on a wall, or on the next wall, keypoints of one agree with those of
the other: a motion a metre or a quarter turn off, with as many matches as the right one. It is doubted only
where measured and recorded motion contradict each other. Where the recorded motion has the two views overlap,
the rest of the views tells which of both is right. Where it does not, the recorded steps tell: who jumps does
so in one step, and a jump of that size among usual steps is long.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.matching.cycles import is_near, spans_any, told_by
from planfit.matching.pairs import RECENT_M
from planfit.matching.relative_motions import NeighbourMotions, match_sigmas
from planfit.matching.types import Matches, RelativePoses
from planfit.matching.view_agreement import MAX_CONTRADICTED, compare
from planfit.runtime import let_go
from planfit.scan.odometry import LONG, Odometry, times_usual, usual_step

LINK_M = 1.5
"""Pairs whose ends are both within this much of way are linked where their motions agree."""
_MIN_SHARED = 0.05
"""Share of the views that both could see by a motion, from which on they tell of it."""
_CLEARLY = 0.1
"""A motion explains clearly more of two views than another by this share."""
MAX_USUAL = 1000
"""Of pairs whose motions agree, so many say what is usual. A walk of 25,000 frames has 38,000 of them, which
took a minute."""


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
    relative_poses: RelativePoses, world_from_cams: Poses, odometry: Odometry
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
    told = told_by(other, one.pairs, world_from_cams, odometry)
    a, b = links[is_near(one.a_from_b, *told)].T
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(len(far), len(far)))
    visit[far] = connected_components(graph, directed=False)[1]
    return visit


def without_misled(
    known: NeighbourMotions, world_from_cams: Poses, odometry: Odometry
) -> NeighbourMotions:
    """Leave out verified pairs where the recorded motion is the better explanation of both views.

    Args:
        known: neighbours that keypoints brought together.
    """
    verified = known.verified
    pairs, measured = verified.relative_poses.pairs, verified.relative_poses.a_from_b
    recorded = se3.inverse(world_from_cams[pairs[:, 0]]) @ world_from_cams[pairs[:, 1]]
    sigmas = odometry.sigma_between(*pairs.T)
    agrees = is_near(measured, recorded, sigmas)
    if agrees.all():
        return known
    is_asked = ~agrees
    usual = np.flatnonzero(agrees)
    is_asked[usual[:: max(1, -(-len(usual) // MAX_USUAL))]] = True
    asked = verified.where(is_asked)
    rest = match_sigmas(asked), known.keypoints.grids
    by_measured, by_recorded = (
        compare(
            replace(asked.relative_poses, a_from_b=motions[is_asked]),
            *(asked.points_a, asked.points_b),
            *rest,
        )
        for motions in (measured, recorded)
    )
    measured_share, recorded_share = (
        views.rest_explained(agrees[is_asked], MAX_CONTRADICTED)
        for views in (by_measured, by_recorded)
    )
    # By the views, where they share enough by the recorded motion; else, or where that is as good, by steps.
    tells = by_recorded.shared >= _MIN_SHARED
    is_won = tells & (measured_share > recorded_share + _CLEARLY)
    is_lost = tells & (recorded_share > measured_share)
    is_misled = is_lost | ~(is_won | _spans_long_step(pairs[is_asked], odometry))
    is_kept = agrees.copy()
    is_kept[is_asked] |= ~is_misled
    return replace(known, verified=verified.where(is_kept))


def _spans_long_step(pairs: Int[np.ndarray, "p 2"], odometry: Odometry) -> Bool[np.ndarray, " p"]:
    steps = odometry.cam_from_next
    return spans_any(pairs, times_usual(steps, usual_step(steps)) > LONG)

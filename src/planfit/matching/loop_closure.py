"""Loop closures: which relative poses are accepted, and which pairs are worth a look because of them.

Cycle consistency: a loop closure is accepted only if the cycle it closes does close. Drift may be large
between two frames far apart in time, and then a look-alike room within its reach passes the gate of the
recorded motion alone. But the scan knows more: other loop closures connect the two frames by a shorter,
more certain path. So relative poses are decided in the order of how surely the motion between their ends
is known, and of how much of both views they explain; each that is accepted becomes an edge for the next
(compare Mangelson et al. 2018, who look for the largest set of loop closures that agree in pairs).

Guided proposals: around a loop closure that was accepted there are more. Recorded poses that have drifted
by a metre tell little of which frames are covisible. Once one pair of two visits is verified, it does: the
motion of its neighbours follows from it and a few recorded steps.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Int

from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.matching.covisibility import CHUNK, ViewSamples
from planfit.matching.cycles import (
    CERTAIN_SIGMA_M,
    MAX_SIGMAS,
    SIGMA_ROTATION_DEG,
    SIGMA_TRANSLATION_M,
    TRANSLATION_SLACK_M,
    by_way_of,
    is_certain,
    is_near,
    spans_any,
    told_by,
)
from planfit.matching.disputes import Disputes, find_disputes
from planfit.matching.pairs import PairOptions, in_order_of_visits, within_budget
from planfit.matching.pose_graph import LEVER_M, LoopGraph
from planfit.matching.types import RelativePoses
from planfit.scan.odometry import Odometry

REACH = 3
"""Views before and after each end of an accepted loop closure that are looked at."""
_MIN_COVISIBILITY = 0.25
"""Pairs that should share less are not tried."""
_CERTAIN_DEG = 5.0
"""A path whose rotation is known less well than this, and its translation as little as rooms allow, is not
looked for among those that are certain."""
_GAP_TIMES_USUAL = 10.0
"""A step whose sigma is this many times the median of the walk is a gap: tracking broke there."""
MAX_UNCERTAIN_SIGMAS = 4.0
"""Largest departure, in sigmas, where sigma is not small against a building: there, another room may lie
within `MAX_SIGMAS`."""
CLUSTER_M = 1.0
"""Relative poses whose two ends lie within this much of way, m, from another's stand or fall together if they
agree: one of them is checked."""
STRONG_SHARE = 0.1
"""Revisits that explain this share of both views are decided first. What explains less may be a poster, and
is held to the drift that those show."""
MAX_DRIFTS, MAX_WEAK_DRIFTS = 6.0, 3.0
"""Largest departure of a strong revisit, and of the others, in sigmas of the drift that strong revisits
show."""
GUIDED_PER_FRAME = 6
"""Pairs that a frame may take part in because a pair nearby was verified."""
_PRIOR_REVISITS = 2
"""How many revisits the sigmas of the odometry weigh as, when the tracker's own drift is looked at."""


def cycle_consistent(
    relative_poses: RelativePoses,
    world_from_cams: Poses,
    odometry: Odometry,
    certain: RelativePoses | None = None,
) -> Bool[np.ndarray, " p"]:
    """Which relative poses agree with the recorded motion and with those accepted before them.

    Where views were compared, revisits that explain nothing of them are refused, and those that explain more
    come first. Those that contradict each other are not both accepted (`planfit.matching.disputes`).

    Args:
        relative_poses: verified pairs of any distance in time.
        certain: loops that are right, as a person says: all others are held to them.
    """
    is_accepted = np.zeros(len(relative_poses), dtype=bool)
    if len(relative_poses) == 0:
        return is_accepted
    edges = _Edges(relative_poses, world_from_cams, odometry)
    pairs, motions = relative_poses.pairs, relative_poses.a_from_b
    sigmas = odometry.sigma_between(*pairs.T)
    is_sure = is_certain(sigmas[1])
    explained = relative_poses.explained
    is_possible = np.full(len(pairs), True) if explained is None else explained > 0
    recorded = se3.inverse(world_from_cams[pairs[:, 0]]) @ world_from_cams[pairs[:, 1]]
    is_accepted[is_sure] = is_near(motions, recorded, sigmas)[is_sure]

    known = np.zeros((0, 2), dtype=int) if certain is None else certain.pairs
    graph = LoopGraph(world_from_cams, odometry, np.concatenate([pairs, known]))
    if certain is not None:
        graph.add(certain.pairs, certain.a_from_b, SIGMA_ROTATION_DEG, SIGMA_TRANSLATION_M)
    pending, new = np.flatnonzero(~is_sure & is_possible), np.flatnonzero(is_accepted)
    speaker = edges.speakers(pending)
    compared = np.unique(speaker)
    over_gap = edges.spans_gap[compared]
    disputes = find_disputes(relative_poses, compared, world_from_cams, odometry, over_gap)
    waits = np.zeros(len(relative_poses), dtype=bool)
    waits[pending] = disputes.waits[np.searchsorted(compared, speaker)]
    narrowing = edges.narrowing(pending[~waits[pending]], recorded)
    while len(pending):
        graph.add(pairs[new], motions[new], SIGMA_ROTATION_DEG, SIGMA_TRANSLATION_M)
        heads = edges.heads(pending, waits)
        decided, holds = _decide(graph, relative_poses, heads, waits, disputes, narrowing)
        if len(decided) == 0:
            break
        follows = edges.followed(pending, decided)
        # By relative pose, so that followers (-1: of none, masked out) look up what their head came to.
        head_holds = np.zeros(len(relative_poses), dtype=bool)
        head_holds[decided] = holds
        new = pending[(follows >= 0) & head_holds[follows]]
        is_accepted[new] = True
        pending = pending[follows < 0]
    return is_accepted


def propose_loop_closures(
    accepted: RelativePoses,
    tried: Int[np.ndarray, "t 2"],
    view_idx: Int[np.ndarray, " v"],
    world_from_cams: Poses,
    samples: ViewSamples,
    options: PairOptions,
) -> Int[np.ndarray, "p 2"]:
    """Pairs of frames to try next, first < second, sorted; none of them tried before.

    Args:
        accepted: relative poses, between frames of `view_idx` or any others.
        tried: pairs, first < second.
        view_idx: frames that stand for their like, increasing.
        options: `neighbours` are no loop closures.
    """
    loops = accepted[accepted.pairs[:, 1] - accepted.pairs[:, 0] > options.neighbours]
    if len(loops) == 0 or GUIDED_PER_FRAME == 0:
        return np.zeros((0, 2), dtype=int)
    found, source = _pairs_around(loops.pairs, view_idx, options.neighbours)
    # A pair as one number, i n + j, so that a set of pairs is a set of numbers.
    n = len(world_from_cams)
    is_new = ~np.isin(found @ (n, 1), tried @ (n, 1))
    found, source = found[is_new], source[is_new]
    covisibility = np.zeros(len(found))
    for first in range(0, len(found), CHUNK):
        part = slice(first, first + CHUNK)
        motion = by_way_of(loops[source[part]], found[part], world_from_cams)
        covisibility[part] = samples.covisibility_by_motion(found[part], motion)
    is_covisible = covisibility > _MIN_COVISIBILITY
    found, covisibility = found[is_covisible], covisibility[is_covisible]
    order = in_order_of_visits(found, -covisibility)
    return np.unique(within_budget(found[order], GUIDED_PER_FRAME), axis=0)


def _decide(
    graph: LoopGraph,
    relative_poses: RelativePoses,
    heads: np.ndarray,
    waits: np.ndarray,
    disputes: Disputes,
    narrowing: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Those of `heads` that are decided now (d,), and whether each agrees with the graph (d,).

    None where all that are left wait (`waits`, (p,)) for what will not come. `narrowing` (p,) is a factor on
    the sigma of the translation to each, where nothing is certain.
    """
    # Most rounds decide what has become certain: short paths, a tenth of the time of all.
    within_m = np.hypot(CERTAIN_SIGMA_M, LEVER_M * np.deg2rad(_CERTAIN_DEG))
    pairs = relative_poses.pairs[heads]
    predicted, sigma_rotation, sigma_translation = graph.most_certain_path(pairs, within_m)
    is_now = is_certain(sigma_translation)
    most = MAX_SIGMAS
    if not is_now.any():
        predicted, sigma_rotation, sigma_translation = graph.most_certain_path(pairs)
        # Nothing is certain: the tenth goes next that is the most certain for what it explains of the views,
        # held to narrower gates.
        doubt = sigma_translation
        if relative_poses.explained is not None:
            doubt = sigma_translation / relative_poses.explained[heads]
        free = np.flatnonzero(~waits[heads])
        tenth = free[np.argsort(doubt[free], kind="stable")[: len(free) // 10 + 1]]
        is_now[tenth[disputes.first_of_rivals(heads[tenth])]] = True
        most = MAX_UNCERTAIN_SIGMAS
        sigma_translation = sigma_translation * narrowing[heads]
    decided = heads[is_now]
    sigmas = (sigma_rotation[is_now], sigma_translation[is_now])
    return decided, is_near(relative_poses.a_from_b[decided], predicted[is_now], sigmas, most)


@dataclass(frozen=True)
class _Edges:
    """Relative poses (p,), in clusters of those whose ends lie in the same cells of way."""

    relative_poses: RelativePoses
    world_from_cams: np.ndarray
    odometry: Odometry

    @cached_property
    def cluster(self) -> np.ndarray:
        """Number (p,) of the cell of way that both ends lie in."""
        walked_m = self.odometry.walked_m[self.relative_poses.pairs]
        cells = np.floor(walked_m / CLUSTER_M).astype(np.int64)
        return np.unique(cells, axis=0, return_inverse=True)[1].ravel()

    @cached_property
    def spans_gap(self) -> np.ndarray:
        """Whether a step of which little is known lies between the frames of each (p,): that is no drift."""
        sigma = self.odometry.sigma_translation
        return spans_any(self.relative_poses.pairs, sigma > _GAP_TIMES_USUAL * np.median(sigma))

    def narrowing(self, pending: np.ndarray, recorded: np.ndarray) -> np.ndarray:
        """Factor (p,), at most 1, on the sigma of the recorded translation over the ends of each.

        Sigmas are made for the worst of trackers. How far this one drifted, the strong revisits tell: most of
        them are right, so the median of their departures is that of the drift.
        """
        edges, explained = self.relative_poses, self.relative_poses.explained
        if explained is None:
            return np.ones(len(edges))
        is_strong = explained >= STRONG_SHARE
        strong = self.heads(pending[is_strong[pending]])
        strong = strong[~self.spans_gap[strong]]
        if len(strong) == 0:
            return np.ones(len(edges))
        off = edges.a_from_b[strong, :3, 3] - recorded[strong, :3, 3]
        _, sigma_translation = self.odometry.sigma_between(*edges.pairs[strong].T)
        sigmas = np.linalg.norm(off, axis=1) / np.hypot(sigma_translation, TRANSLATION_SLACK_M)
        # Of a vector of three standard normal numbers the length has the median 1.538. Few revisits say
        # little: as if _PRIOR_REVISITS more had said what the sigmas say.
        share_sq, n = (np.median(sigmas) / 1.538) ** 2, len(strong)
        drift = np.sqrt((n * share_sq + _PRIOR_REVISITS) / (n + _PRIOR_REVISITS))
        own = np.where(is_strong, MAX_DRIFTS, MAX_WEAK_DRIFTS) * drift
        return np.where(self.spans_gap, 1.0, np.minimum(own / MAX_UNCERTAIN_SIGMAS, 1.0))

    def heads(self, pending: np.ndarray, waits: np.ndarray | None = None) -> np.ndarray:
        """Of each cluster the pending one that explains most, or has the most inliers; the first of equals.

        One that waits (p,) only where all of its cluster do.
        """
        best = self.relative_poses.explained
        if best is None:
            best = self.relative_poses.n_inliers
        is_last = np.zeros(len(pending), dtype=bool) if waits is None else waits[pending]
        order = pending[np.lexsort((pending, -best[pending], is_last))]
        _, first = np.unique(self.cluster[order], return_index=True)
        return order[first]

    def speakers(self, pending: np.ndarray) -> np.ndarray:
        """For each pending one (q,) that of its cluster that says the same and explains most."""
        speaker, left = pending.copy(), np.arange(len(pending))
        while len(left):
            follows = self.followed(pending[left], self.heads(pending[left]))
            is_spoken_for = follows >= 0
            speaker[left[is_spoken_for]] = follows[is_spoken_for]
            left = left[~is_spoken_for]
        return speaker

    def followed(self, pending: np.ndarray, decided: np.ndarray) -> np.ndarray:
        """For each pending one (q,) the decided one of its cluster that it agrees with, or -1.

        Both say the same if going from one end to the other's, over its motion and back, gives its motion.
        """
        # At most one of a cluster is decided at a time: a table by cluster finds it. It follows itself.
        head_of = np.full(int(self.cluster.max()) + 1, -1)
        head_of[self.cluster[decided]] = decided
        head = head_of[self.cluster[pending]]
        follows = np.where(head == pending, pending, -1)
        other = np.flatnonzero((head >= 0) & (head != pending))
        own, heads = self.relative_poses[pending[other]], self.relative_poses[head[other]]
        # The head's motion is taken for exact.
        told = told_by(heads, own.pairs, self.world_from_cams, self.odometry)
        agrees = is_near(own.a_from_b, *told)
        follows[other[agrees]] = head[other][agrees]
        return follows


def _pairs_around(
    pairs: np.ndarray, view_idx: np.ndarray, neighbours: int
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs (q, 2) of views up to `REACH` from both ends of given ones, and of which each (q,); sorted."""
    # Ends as places in the list of views (the next view, where a frame is none itself).
    at = np.searchsorted(view_idx, pairs).clip(0, len(view_idx) - 1)
    steps = np.stack(np.meshgrid(*[np.arange(-REACH, REACH + 1)] * 2), axis=-1).reshape(-1, 2)
    steps = steps[np.argsort(np.abs(steps).sum(axis=1), kind="stable")]
    found, source = np.zeros((0, 2), dtype=int), np.zeros(0, dtype=int)
    for step in steps:  # the nearest first: they say best what to expect
        near = at + step
        inside = ((near >= 0) & (near < len(view_idx))).all(axis=1)
        new = view_idx[near[inside]]
        apart = new[:, 1] - new[:, 0] > neighbours
        found = np.concatenate([found, new[apart]])
        source = np.concatenate([source, np.flatnonzero(inside)[apart]])
        # Of equal pairs unique keeps the first, so one found from nearer keeps its source.
        found, first = np.unique(found, axis=0, return_index=True)
        source = source[first]
    return found, source

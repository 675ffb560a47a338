"""Cycle consistency: a loop is believed only if the cycle it closes does close.

Drift may be large between two frames far apart in time, and then a look-alike room within its reach
passes the gate of the recorded motion alone. But the scan knows more: other loops tie the two frames
together by a shorter, surer way. So loops are taken in the order of how surely the motion between
their ends is known; each that is believed becomes a way for the next (compare Mangelson et al. 2018,
who look for the largest set of loops that agree in pairs).
"""

from dataclasses import dataclass

import numpy as np

from planfit.errors import require_positive
from planfit.geometry import se3
from planfit.matching.pose_graph import PoseGraph
from planfit.scan.odometry import Odometry


@dataclass(frozen=True)
class CycleOptions:
    """When a loop agrees with all else that is known."""

    max_sigmas: float = 6.0
    """Largest departure, in spreads, where the spread is small against a building."""
    max_unsure_sigmas: float = 4.0
    """Largest departure where it is not: there, another room may lie within six spreads."""
    sure_m: float = 1.2
    """Loops whose ends are known to better than this (`max_sigmas` spreads and the slack) are sure:
    rooms are further apart."""
    slack_deg: float = 3.0
    """Departure in turn that is always allowed: the error of the verification itself."""
    slack_m: float = 0.3
    """Departure in shift that is always allowed."""
    loop_sigma_deg: float = 0.5
    """Spread of a verified motion's turn, each axis, where a way leads over it."""
    loop_sigma_m: float = 0.03
    """Spread of its shift."""
    cluster_m: float = 1.0
    """Loops whose two ends lie within this much of way from another's stand or fall together if they
    agree: one of them is checked."""

    def __post_init__(self) -> None:
        require_positive(self, "loop_sigma_deg", "loop_sigma_m", "cluster_m")


@dataclass(frozen=True)
class RelativePoses:
    """Verified motions between frames."""

    pairs: np.ndarray  # (p, 2) frame indices
    a_from_b: np.ndarray  # (p, 4, 4)
    n_inliers: np.ndarray  # (p,)

    def __getitem__(self, idx: np.ndarray) -> "RelativePoses":
        return RelativePoses(self.pairs[idx], self.a_from_b[idx], self.n_inliers[idx])


def agree_with_cycles(
    loops: RelativePoses, world_from_cams: np.ndarray, odometry: Odometry, options: CycleOptions
) -> np.ndarray:
    """Which loops (p,) bool agree with the recorded motion and with the loops believed before them.

    Args:
        loops: verified pairs of any distance in time.
        world_from_cams: (n, 4, 4) recorded poses.
        odometry: how far the recorded motion may be off.
        options: see there.
    """
    is_believed = np.zeros(len(loops.pairs), dtype=bool)
    if len(loops.pairs) == 0:
        return is_believed
    first, last = loops.pairs.T
    turn, shift = odometry.sigma_between(first, last)
    is_sure = options.max_sigmas * shift + options.slack_m < options.sure_m
    recorded = se3.inverse(world_from_cams[first]) @ world_from_cams[last]
    is_believed[is_sure] = _close(loops.a_from_b, recorded, turn, shift, options)[is_sure]

    ways = PoseGraph(world_from_cams, odometry, loops.pairs)
    cluster = _clusters(loops, odometry, options.cluster_m)
    pending = np.flatnonzero(~is_sure)
    new = np.flatnonzero(is_believed)
    while len(pending):
        ways.add(
            loops.pairs[new], loops.a_from_b[new], options.loop_sigma_deg, options.loop_sigma_m
        )
        heads = _heads(pending, cluster, loops.n_inliers)
        predicted, turn, shift = ways.between(loops.pairs[heads])
        is_now = options.max_sigmas * shift + options.slack_m < options.sure_m
        sigmas = options.max_sigmas
        if not is_now.any():
            # Nothing is sure: the surest tenth goes next, held to a narrower gate.
            is_now = shift <= np.partition(shift, len(heads) // 10)[len(heads) // 10]
            sigmas = options.max_unsure_sigmas
        decided = heads[is_now]
        holds = _close(
            loops.a_from_b[decided], predicted[is_now], turn[is_now], shift[is_now], options, sigmas
        )
        follows = _follow(loops, pending, decided, cluster, world_from_cams, odometry, options)
        verdict = np.zeros(len(loops.pairs), dtype=bool)
        verdict[decided] = holds
        new = pending[(follows >= 0) & verdict[follows]]
        is_believed[new] = True
        pending = pending[follows < 0]
    return is_believed


def _close(
    motion: np.ndarray,
    predicted: np.ndarray,
    sigma_rotation: np.ndarray,
    sigma_translation: np.ndarray,
    options: CycleOptions,
    sigmas: float | None = None,
) -> np.ndarray:
    """Whether motions (p, 4, 4) depart from the predicted ones by no more than their spread allows."""
    sigmas = options.max_sigmas if sigmas is None else sigmas
    turn = se3.rotation_angle(np.swapaxes(predicted[:, :3, :3], 1, 2) @ motion[:, :3, :3])
    shift = np.linalg.norm(predicted[:, :3, 3] - motion[:, :3, 3], axis=1)
    return (turn < sigmas * sigma_rotation + np.deg2rad(options.slack_deg)) & (
        shift < sigmas * sigma_translation + options.slack_m
    )


def _clusters(loops: RelativePoses, odometry: Odometry, size_m: float) -> np.ndarray:
    """Number (p,) of the cell of way that both ends lie in."""
    cells = np.floor(odometry.walked_m[loops.pairs] / size_m).astype(np.int64)
    return np.unique(cells, axis=0, return_inverse=True)[1].ravel()


def _heads(pending: np.ndarray, cluster: np.ndarray, n_inliers: np.ndarray) -> np.ndarray:
    """Of each cluster the pending loop with the most inliers."""
    order = pending[np.lexsort((pending, -n_inliers[pending]))]
    _, first = np.unique(cluster[order], return_index=True)
    return order[first]


def _follow(
    loops: RelativePoses,
    pending: np.ndarray,
    decided: np.ndarray,
    cluster: np.ndarray,
    world_from_cams: np.ndarray,
    odometry: Odometry,
    options: CycleOptions,
) -> np.ndarray:
    """For each pending loop the decided one of its cluster that it agrees with, or -1.

    Both say the same if going from one end to the other's, over its loop and back, gives its motion.
    """
    head_of = np.full(int(cluster.max()) + 1, -1)
    head_of[cluster[decided]] = decided
    head = head_of[cluster[pending]]
    follows = np.where(head == pending, pending, -1)
    other = np.flatnonzero((head >= 0) & (head != pending))
    (i, j), (k, m) = loops.pairs[pending[other]].T, loops.pairs[head[other]].T
    i_from_k = se3.inverse(world_from_cams[i]) @ world_from_cams[k]
    m_from_j = se3.inverse(world_from_cams[m]) @ world_from_cams[j]
    predicted = i_from_k @ loops.a_from_b[head[other]] @ m_from_j
    (turn_a, shift_a), (turn_b, shift_b) = (
        odometry.sigma_between(i, k),
        odometry.sigma_between(m, j),
    )
    agrees = _close(
        loops.a_from_b[pending[other]],
        predicted,
        np.hypot(turn_a, turn_b),
        np.hypot(shift_a, shift_b),
        options,
    )
    follows[other[agrees]] = head[other[agrees]]
    return follows

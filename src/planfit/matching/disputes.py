"""Disputes: revisits that contradict one another where the recorded motion could explain either.

Two rooms that look alike give two sets of revisits, each of which agrees within itself. What tells them
apart is not how many there are or how much of the views they explain, as a look-alike room explains as much
as the right one, but which of them asks for less drift. Revisits that lose, and those that agree with them,
wait until what was accepted before makes the motion between their ends certain (compare Mangelson et al.
2018, who look for the largest set of loop closures that agree in pairs; that may be the wrong room's).
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.matching.cycles import TRANSLATION_SLACK_M, by_way_of, is_certain, is_near
from planfit.matching.types import RelativePoses
from planfit.scan.odometry import Odometry

CLEARLY = 2.0
"""Two contradict each other where they are this many times as far apart as two that agree may be: a verified
motion may itself be 5 deg off."""
MIN_ADVANTAGE = 1.0
"""Of two revisits that contradict each other, the one that asks for less drift is right if the squares of
both, in sigmas of the recorded motion, differ by this; else neither is used."""
RIVAL_SHARE = 0.33
"""A revisit is no rival of one that explains more than its own share of the views by this factor."""


@dataclass(frozen=True)
class Disputes:
    """Which of some relative poses contradict each other."""

    idx: Int[np.ndarray, " h"]
    """The relative poses that were compared, sorted."""
    contradicts: sparse.csr_array
    """(h, h), symmetric: the recorded steps between their ends are certain, and the cycle does not close."""
    waits: Bool[np.ndarray, " h"]
    """Whether each is to wait until the motion between its ends is certain."""

    def first_of_rivals(self, idx: Int[np.ndarray, " k"]) -> Bool[np.ndarray, " k"]:
        """Of some relative poses, in the order given, those that contradict none taken before them."""
        place = np.searchsorted(self.idx, idx).clip(0, len(self.idx) - 1)
        is_known = self.idx[place] == idx
        is_barred, is_taken = np.zeros(len(self.idx), dtype=bool), np.ones(len(idx), dtype=bool)
        for k in np.flatnonzero(is_known):
            row = place[k]
            is_taken[k] = not is_barred[row]
            if is_taken[k]:
                begin, end = self.contradicts.indptr[row : row + 2]
                is_barred[self.contradicts.indices[begin:end]] = True
        return is_taken


def find_disputes(
    relative_poses: RelativePoses,
    idx: Int[np.ndarray, " h"],
    world_from_cams: Poses,
    odometry: Odometry,
    is_undecided_left: Bool[np.ndarray, " h"],
) -> Disputes:
    """Compare relative poses whose ends lie close enough to each other for the recorded motion to judge.

    Args:
        idx: those to compare, sorted: of those that say the same, one.
        is_undecided_left: those that go on where drift does not decide: over a gap, it never does.
    """
    own = relative_poses[idx]
    agrees, contradicts = _compare(own, world_from_cams, odometry)
    strength, drift_sq = _support(own, agrees, world_from_cams, odometry)
    a, b = contradicts.nonzero()
    # What explains far less of its views, such as a poster, is no rival of a room.
    is_rival = strength[b] >= RIVAL_SHARE * strength[a]
    a, b = a[is_rival], b[is_rival]
    wins = drift_sq[a] + MIN_ADVANTAGE < drift_sq[b]
    loses = drift_sq[b] + MIN_ADVANTAGE < drift_sq[a]
    has_rival, has_lost, is_open = (np.zeros(len(idx), dtype=bool) for _ in range(3))
    has_rival[a], has_lost[a[loses]], is_open[a[~wins & ~loses]] = True, True, True
    # A visit goes on where its frames meet no rival: all that agree stand or fall together.
    _, visit = connected_components(agrees, directed=False)
    n_lost, n_rivals = (np.bincount(visit, mark) for mark in (has_lost, has_rival))
    waits = has_lost | (n_lost > 0.5 * n_rivals)[visit] | (is_open & ~is_undecided_left)
    return Disputes(idx, contradicts, waits)


def _compare(
    own: RelativePoses, world_from_cams: Poses, odometry: Odometry
) -> tuple[sparse.csr_array, sparse.csr_array]:
    """Which agree and which contradict each other, (h, h); of others the recorded motion cannot say."""
    h = len(own)
    first, last = own.pairs.T
    agreeing, contradicting = [np.tile(np.arange(h), (2, 1))], []
    for k in range(h):
        rotation_i, translation_i = odometry.sigma_between(first[k : k + 1], first[k + 1 :])
        rotation_j, translation_j = odometry.sigma_between(last[k : k + 1], last[k + 1 :])
        translation = np.hypot(translation_i, translation_j)
        close = np.flatnonzero(is_certain(translation))
        if len(close) == 0:
            continue
        others = k + 1 + close
        predicted = by_way_of(own[others], np.tile(own.pairs[k], (len(others), 1)), world_from_cams)
        motions = np.broadcast_to(own.a_from_b[k], predicted.shape)
        sigmas = np.hypot(rotation_i, rotation_j)[close], translation[close]
        for pairs, is_such in (
            (agreeing, is_near(motions, predicted, sigmas)),
            (contradicting, ~is_near(motions, predicted, sigmas, times=CLEARLY)),
        ):
            pairs.append(np.stack([np.full(is_such.sum(), k), others[is_such]]))
    return _symmetric(agreeing, h), _symmetric(contradicting, h)


def _symmetric(upper: list[np.ndarray], h: int) -> sparse.csr_array:
    rows, columns = np.concatenate([np.zeros((2, 0), dtype=int), *upper], axis=1)
    matrix = sparse.coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(h, h))
    return sparse.csr_array((matrix + matrix.T).astype(bool))


def _support(
    own: RelativePoses, agrees: sparse.csr_array, world_from_cams: Poses, odometry: Odometry
) -> tuple[Float[np.ndarray, " h"], Float[np.ndarray, " h"]]:
    """Of each with those that agree with it: the largest share of views explained, and the squared drift, in
    sigmas, that half of them ask for."""
    first, last = own.pairs.T
    recorded = se3.inverse(world_from_cams[first]) @ world_from_cams[last]
    _, sigma = odometry.sigma_between(first, last)
    off = np.linalg.norm(own.a_from_b[:, :3, 3] - recorded[:, :3, 3], axis=1)
    drift = off / np.hypot(sigma, TRANSLATION_SLACK_M)
    explained = np.ones(len(own)) if own.explained is None else own.explained
    groups = [agrees.indices[a:b] for a, b in pairwise(agrees.indptr)]
    strength = np.array([explained[group].max() for group in groups])
    return strength, np.array([np.median(drift[group]) for group in groups]) ** 2

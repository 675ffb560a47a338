"""The surest way between two frames: along the recorded motion and over loops that are believed."""

import heapq

import numba
import numpy as np

from planfit.geometry import se3
from planfit.scan.odometry import Odometry

LEVER_M = 3.0
"""A turn's spread counts as much as the shift it makes at this distance, where ways are compared."""


class PoseGraph:
    """A graph of frames; each edge has a motion and its spread. Only frames of loops are kept."""

    def __init__(self, world_from_cams: np.ndarray, odometry: Odometry, pairs: np.ndarray) -> None:
        self._stations = np.unique(pairs)
        before, after = self._stations[:-1], self._stations[1:]
        # Variances of the steps alone: what an early turn swings is counted once, over the whole way.
        walked = odometry.walked_m
        turn_sq, shift_sq = (
            np.concatenate([[0.0], np.cumsum(sigma**2)])
            for sigma in (odometry.sigma_rotation, odometry.sigma_translation)
        )
        recorded = se3.inverse(world_from_cams[before]) @ world_from_cams[after]
        at = np.arange(len(before))
        self._ends = np.column_stack([at, at + 1])
        self._motion = recorded
        self._spread = np.column_stack([s[after] - s[before] for s in (turn_sq, shift_sq, walked)])

    def add(self, pairs: np.ndarray, a_from_b: np.ndarray, turn_deg: float, shift_m: float) -> None:
        """Add loops (p, 2) with their motion (p, 4, 4) and its spread."""
        spread = np.zeros((len(pairs), 3))
        spread[:, 0], spread[:, 1] = np.deg2rad(turn_deg) ** 2, shift_m**2
        spread[:, 2] = np.linalg.norm(a_from_b[:, :3, 3], axis=1)
        self._ends = np.concatenate([self._ends, np.searchsorted(self._stations, pairs)])
        self._motion = np.concatenate([self._motion, a_from_b])
        self._spread = np.concatenate([self._spread, spread])

    def between(self, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Motion a_from_b (p, 4, 4) along the surest way, and its spread: turn (p,) rad, shift (p,) m."""
        ends = np.searchsorted(self._stations, pairs)
        order = np.lexsort((ends[:, 1], ends[:, 0]))
        both = np.concatenate([self._ends, self._ends[:, ::-1]])
        out = np.argsort(both[:, 0], kind="stable")
        begin = np.searchsorted(both[out, 0], np.arange(len(self._stations) + 1))
        weight = self._spread[:, 0] * LEVER_M**2 + self._spread[:, 1]
        found = _surest(
            begin,
            both[out, 1],
            out % len(self._ends),
            out >= len(self._ends),
            weight,
            self._motion,
            se3.inverse(self._motion),
            self._spread,
            ends[order],
        )
        motion, spread = np.zeros_like(found[0]), np.zeros_like(found[1])
        motion[order], spread[order] = found
        turn_sq, shift_sq, length = spread.T
        return motion, np.sqrt(turn_sq), np.sqrt(shift_sq + turn_sq * length**2 / 3)


@numba.njit(cache=True, nogil=True)
def _surest(
    begin: np.ndarray, to: np.ndarray, edge: np.ndarray, is_back: np.ndarray, weight: np.ndarray,
    forth: np.ndarray, back: np.ndarray, spread: np.ndarray, ends: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Dijkstra from each source until its targets are reached; `ends` (p, 2) are sorted by source."""
    motions = np.zeros((len(ends), 4, 4))
    spreads = np.zeros((len(ends), 3))
    n = len(begin) - 1
    k = 0
    while k < len(ends):
        source = ends[k, 0]
        last = k
        while last < len(ends) and ends[last, 0] == source:
            last += 1
        cost = np.full(n, np.inf)
        via = np.full(n, -1)
        is_done = np.zeros(n, dtype=np.bool_)
        is_target = np.zeros(n, dtype=np.bool_)
        n_left = 0
        for t in range(k, last):
            if not is_target[ends[t, 1]]:
                is_target[ends[t, 1]] = True
                n_left += 1
        cost[source] = 0.0
        heap = [(0.0, source)]
        before = np.full(n, -1)
        while len(heap) > 0 and n_left > 0:
            here_cost, here = heapq.heappop(heap)
            if is_done[here]:
                continue
            is_done[here] = True
            if is_target[here]:
                n_left -= 1
            for e in range(begin[here], begin[here + 1]):
                new = here_cost + weight[edge[e]]
                if new < cost[to[e]]:
                    cost[to[e]] = new
                    via[to[e]] = e
                    before[to[e]] = here
                    heapq.heappush(heap, (new, to[e]))  # type: ignore[arg-type]
        for t in range(k, last):
            motion = np.eye(4)
            node = ends[t, 1]
            while node != source:
                e = via[node]
                step = back[edge[e]] if is_back[e] else forth[edge[e]]
                motion = step @ motion
                spreads[t] += spread[edge[e]]
                node = before[node]
            motions[t] = motion
        k = last
    return motions, spreads

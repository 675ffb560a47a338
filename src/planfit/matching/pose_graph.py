"""The pose graph: frames, recorded motions between them, and the loop closures accepted so far.

Between two frames it gives the most certain path, that whose motion has the smallest variance.
"""

import numpy as np
from jaxtyping import Float, Int

from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.matching.pair_kernels import most_certain_paths
from planfit.priors import VIEW_DISTANCE_M
from planfit.runtime import in_threads
from planfit.scan.odometry import Odometry

LEVER_M = VIEW_DISTANCE_M.value
"""A rotation's sigma counts as much as the translation it makes at this distance, where paths are
compared."""

_PATHS_AT_A_TIME = 64
"""Searched for in one thread: of 9,600 keyframes a search takes 4 ms."""
_MIN_TIMES_SURER = 3.0
"""A verified motion that is not this many times surer than the recorded one, in rotation or translation, is
no edge: errors of neighbouring frames are alike (lens, depth), so that a chain of them bends the way. On
ConSLAM chains turned by 20 deg where the recorded motion had turned by 6, and true revisits were refused."""


class LoopGraph:
    """A graph of frames; each edge has a motion and its variance. Only frames of loop closures are nodes."""

    def __init__(
        self, world_from_cams: Poses, odometry: Odometry, pairs: Int[np.ndarray, "p 2"]
    ) -> None:
        """Begin with the recorded motion from each frame of `pairs` to the next of them."""
        self._frame_idx = np.unique(pairs)
        before, after = self._frame_idx[:-1], self._frame_idx[1:]
        # Variances of the steps alone: what an early rotation swings is counted once, over the whole path.
        # The third number of an edge is its length, m, for that.
        rotation_sq, translation_sq = (
            np.concatenate([[0.0], np.cumsum(sigma**2)])
            for sigma in (odometry.sigma_rotation, odometry.sigma_translation)
        )
        sums = (rotation_sq, translation_sq, odometry.walked_m)
        self._odometry = odometry
        node = np.arange(len(before))
        self._edges = np.column_stack([node, node + 1])
        self._motion = se3.inverse(world_from_cams[before]) @ world_from_cams[after]
        self._variance = np.column_stack([s[after] - s[before] for s in sums])

    def add(
        self,
        pairs: Int[np.ndarray, "p 2"],
        a_from_b: Float[np.ndarray, "p 4 4"],
        sigma_rotation_deg: float | Float[np.ndarray, " p"],
        sigma_translation_m: float | Float[np.ndarray, " p"],
    ) -> None:
        """Add edges between frames of the graph, with their motion and its standard deviation, each axis; one
        for all, or for each. What tells little more than the recorded motion is left out."""
        recorded = self._odometry.sigma_between(*pairs.T)
        own = np.zeros((2, len(pairs)))
        own[0], own[1] = np.deg2rad(sigma_rotation_deg), sigma_translation_m
        tells = np.any(np.stack(recorded) > _MIN_TIMES_SURER * own, axis=0)
        pairs, a_from_b, own = pairs[tells], a_from_b[tells], own[:, tells]
        length_m = np.linalg.norm(a_from_b[:, :3, 3], axis=1)
        variance = np.column_stack([*np.square(own), length_m])
        # Frame indices to nodes: the frames are sorted, so the place of each is found by bisection.
        self._edges = np.concatenate([self._edges, np.searchsorted(self._frame_idx, pairs)])
        self._motion = np.concatenate([self._motion, a_from_b])
        self._variance = np.concatenate([self._variance, variance])

    def most_certain_path(
        self, pairs: Int[np.ndarray, "p 2"], max_sigma_m: float = np.inf
    ) -> tuple[Float[np.ndarray, "p 4 4"], Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
        """Motion a_from_b along the most certain path between frames; sigma of its rotation (rad) and
        translation (m), each axis.

        A search within `max_sigma_m`, of the translation and of `LEVER_M` times the rotation together, is the
        shorter the smaller that is; where the path is less certain, both sigmas are infinite.
        """
        ends = np.searchsorted(self._frame_idx, pairs)
        order = np.lexsort((ends[:, 1], ends[:, 0]))  # by source: one search serves all its targets
        # Each edge is two half-edges, e forth and e + n_edges back. Sorted by the node that they leave,
        # those of a node lie together: where they begin is found by bisection (compressed rows).
        n_edges = len(self._edges)
        half_edges = np.concatenate([self._edges, self._edges[:, ::-1]])
        out = np.argsort(half_edges[:, 0], kind="stable")
        begin = np.searchsorted(half_edges[out, 0], np.arange(len(self._frame_idx) + 1))
        graph = (
            begin,
            half_edges[out, 1],
            out % n_edges,
            out >= n_edges,
            self._variance[:, 0] * LEVER_M**2 + self._variance[:, 1],
            self._motion,
            se3.inverse(self._motion),
            self._variance,
        )
        # In parts, each in a thread; those of one source may come into two, and are then searched for twice.
        parts = [order[k : k + _PATHS_AT_A_TIME] for k in range(0, len(order), _PATHS_AT_A_TIME)]
        most = float(max_sigma_m) ** 2
        found = in_threads(lambda part: most_certain_paths(*graph, ends[part], most), parts)
        motion, variance = np.zeros((len(order), 4, 4)), np.zeros((len(order), 3))
        for part, (its_motion, its_variance) in zip(parts, found, strict=True):
            motion[part], variance[part] = its_motion, its_variance
        rotation_sq, translation_sq, length = variance.T
        # As in `Odometry.sigma_between`: rotations along a path swing what follows, a third on average.
        sigma_translation = np.sqrt(translation_sq + rotation_sq * length**2 / 3)
        return motion, np.sqrt(rotation_sq), sigma_translation

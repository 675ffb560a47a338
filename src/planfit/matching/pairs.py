"""Which frames are worth matching: neighbours in time, and places that were visited again.

Revisits are sought among distinct views (`views.py`), so that a camera that lingers does not spend the
budget on itself, and among a bounded number of the nearest views of each, so that time and memory
grow with the number of frames and not with its square.
"""

from dataclasses import dataclass

import numba
import numpy as np
from scipy.spatial import cKDTree

from planfit.errors import require_positive
from planfit.matching.covisibility import ViewSamples
from planfit.matching.retrieval import most_similar, similarity_of
from planfit.matching.views import Views, distinct_views
from planfit.scan.odometry import Odometry


@dataclass(frozen=True)
class PairOptions:
    """Which pairs of frames are tried."""

    neighbours: int = 4
    """Each frame is tried with this many that follow it."""
    loops_per_frame: int = 8
    """Pairs a frame may take part in as a revisit: of each visit the nearest views first."""
    expanded_per_frame: int = 6
    """Pairs a frame may take part in besides, because a pair nearby was verified."""
    base_distance_m: float = 2.5
    """Cameras of a revisit are at most this far apart, plus what drift may add."""
    max_distance_m: float = 8.0
    """Largest distance between cameras, drift included, where nothing but the poses is known."""
    max_angle_deg: float = 65.0
    """Largest angle between the viewing directions of a revisit."""
    view_distance_m: float = 4.0
    """Views are compared at this distance in front of the camera: two cameras that look at one spot
    from different places are nearer than two that stand together and look apart."""
    retrieved_per_frame: int = 4
    """Pairs of each frame that are proposed because they look alike, wherever drift may have put them."""
    max_drift_sigmas: float = 6.0
    """Look-alikes are proposed only where drift of at most this many spreads can explain them."""

    def __post_init__(self) -> None:
        require_positive(self, "neighbours", "max_distance_m", "max_angle_deg")


@dataclass(frozen=True)
class FrameDescriptors:
    """What is known of frames besides their poses."""

    appearance: np.ndarray  # (n, d) unit descriptions of whole frames (`retrieval.py`)
    sharpness: np.ndarray  # (n,)
    samples: ViewSamples


def choose_pairs(
    world_from_cams: np.ndarray,
    odometry: Odometry,
    options: PairOptions,
    looks: FrameDescriptors | None = None,
) -> np.ndarray:
    """Pairs (p, 2) of frame indices, first < second, sorted.

    Args:
        world_from_cams: (n, 4, 4) recorded poses.
        odometry: how far they may be off between two frames.
        options: how many, and how far apart.
        looks: what frames show; without it, pairs are chosen by poses alone.
    """
    n = len(world_from_cams)
    near = [
        np.column_stack([np.arange(n - k), np.arange(k, n)])
        for k in range(1, min(options.neighbours, n - 1) + 1)
    ]
    if options.loops_per_frame > 0:
        near.append(_revisits(world_from_cams, odometry, options, looks))
    return np.unique(np.concatenate([np.zeros((0, 2), dtype=int), *near]), axis=0)


def _revisits(
    world_from_cams: np.ndarray,
    odometry: Odometry,
    options: PairOptions,
    looks: FrameDescriptors | None,
) -> np.ndarray:
    walked = odometry.walked_m
    views = distinct_views(world_from_cams, walked, looks.sharpness if looks else None)
    pairs, gap = _near_views(views, odometry, options)
    retrieved = np.zeros((0, 2), dtype=int)
    if looks is not None:
        # By what they show: the gap between views knows neither walls nor the width of the image.
        alike = similarity_of(looks.appearance, pairs)
        # Drift of a metre moves views of rooms so far that only looks can tell.
        _, drift = odometry.sigma_between(*pairs.T)
        gap = -looks.samples.overlap(world_from_cams, pairs) / (1.0 + drift / DRIFT_M) - 2 * alike
        retrieved, similarity = _look_alikes(views, odometry, options, looks.appearance)
        order = in_order_of_visits(retrieved, -similarity)
        retrieved = within_budget(retrieved[order], options.retrieved_per_frame)
    # What the camera saw a moment ago is always the most alike, and tells the least about drift.
    is_recent = np.abs(walked[pairs[:, 1]] - walked[pairs[:, 0]]) < RECENT_M
    old, recent = (pairs[m][in_order_of_visits(pairs[m], gap[m])] for m in (~is_recent, is_recent))
    recent = within_budget(recent, max(1, options.loops_per_frame // 3))
    every = np.concatenate([retrieved, old, recent])
    _, first = np.unique(every, axis=0, return_index=True)
    return within_budget(every[np.sort(first)], options.loops_per_frame)


DRIFT_M = 0.5
"""At this much drift, the overlap of recorded poses counts half."""
RECENT_M = 2.5
"""Frames with less way between them are no revisit; they share a third of the budget."""
N_NEAREST = 64
"""Views looked at about each view; many visits of one place fit in."""


def _near_views(
    views: Views, odometry: Odometry, options: PairOptions
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs (p, 2) of frames within the gate that drift allows, and how far apart the views are (p,)."""
    ahead = views.centres + options.view_distance_m * views.forward
    place = np.hstack([views.centres, ahead])
    k = min(N_NEAREST, len(place))
    reach = np.hypot(options.max_distance_m, options.max_distance_m + 2 * options.view_distance_m)
    _, found = cKDTree(place).query(place, k=k, distance_upper_bound=reach)
    a = np.repeat(np.arange(len(place)), k)
    b = found.reshape(-1)
    exists = (b < len(place)) & (b != a)
    a, b = np.minimum(a[exists], b[exists]), np.maximum(a[exists], b[exists])
    a, b = np.unique(np.column_stack([a, b]), axis=0).T
    i, j = views.frame_idx[a], views.frame_idx[b]
    _, drift = odometry.sigma_between(i, j)
    distance = np.linalg.norm(views.centres[a] - views.centres[b], axis=1)
    ok = (
        (j - i > options.neighbours)
        & (distance < np.minimum(options.base_distance_m + 2 * drift, options.max_distance_m))
        & (_cosine(views, a, b) > np.cos(np.deg2rad(options.max_angle_deg)))
    )
    gap = np.linalg.norm(ahead[a] - ahead[b], axis=1) + distance
    return np.column_stack([i, j])[ok], gap[ok]


def _look_alikes(
    views: Views, odometry: Odometry, options: PairOptions, appearance: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs (p, 2) of frames that look most alike among those that drift could explain, and how alike."""

    def possible(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        i, j = views.frame_idx[a], views.frame_idx[b]
        turn, shift = odometry.sigma_between(i, j)
        distance = np.linalg.norm(views.centres[a] - views.centres[b], axis=-1)
        angle = np.deg2rad(options.max_angle_deg) + options.max_drift_sigmas * turn
        return (
            (np.abs(j - i) > options.neighbours)
            & (distance < options.base_distance_m + options.max_drift_sigmas * shift)
            & (_cosine(views, a, b) > np.cos(np.minimum(angle, np.pi)))
        )

    pairs, similarity = most_similar(
        appearance[views.frame_idx], 2 * options.retrieved_per_frame, possible
    )
    return views.frame_idx[pairs], similarity


def _cosine(views: Views, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.sum(views.forward[a] * views.forward[b], axis=-1)


def in_order_of_visits(pairs: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """Order (p,) in which pairs are taken: the best of every visit, then the second best, and so on.

    Without visits in between, the many views of the visit just before would take every place.
    """
    if len(pairs) == 0:
        return np.zeros(0, dtype=int)
    visit = pairs // VISIT_FRAMES
    by_visit = np.lexsort((pairs[:, 1], pairs[:, 0], gap, visit[:, 1], visit[:, 0]))
    sorted_visit = visit[by_visit]
    is_new = np.concatenate([[True], (np.diff(sorted_visit, axis=0) != 0).any(axis=1)])
    begin = np.maximum.accumulate(np.where(is_new, np.arange(len(pairs)), 0))
    rank = np.zeros(len(pairs), dtype=int)
    rank[by_visit] = np.arange(len(pairs)) - begin
    return np.lexsort((pairs[:, 1], pairs[:, 0], gap, rank))


VISIT_FRAMES = 8
"""Pairs between the same two stretches of this many frames are of one visit."""


def within_budget(pairs: np.ndarray, most: int) -> np.ndarray:
    """Pairs (p, 2) taken in their order as long as neither frame has `most` already."""
    if len(pairs) == 0 or most == 0:
        return np.zeros((0, 2), dtype=int)
    return pairs[_take(pairs, most, np.zeros(int(pairs.max()) + 1, dtype=np.int64))]


@numba.njit(cache=True, nogil=True)
def _take(pairs: np.ndarray, most: int, used: np.ndarray) -> np.ndarray:
    taken = np.zeros(len(pairs), dtype=np.bool_)
    for k in range(len(pairs)):
        a, b = pairs[k, 0], pairs[k, 1]
        if used[a] < most and used[b] < most:
            used[a] += 1
            used[b] += 1
            taken[k] = True
    return taken

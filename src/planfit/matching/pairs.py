"""Which frames are worth matching: neighbours in time, and places that were visited again.

Revisits are sought among distinct views, so that a camera that lingers does not spend the budget on
itself, and among a bounded number of the nearest views of each, so that time and memory grow with the
number of frames and not with its square.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from planfit.errors import require_positive
from planfit.geometry.se3 import Poses
from planfit.matching.covisibility import ViewSamples
from planfit.matching.pair_kernels import take_within_budget
from planfit.matching.retrieval import N_LOOKED_AT, most_similar, similarity_of
from planfit.priors import SAME_MOTION_SIGMAS
from planfit.scan.odometry import Odometry

_DRIFT_M = 0.5
"""At this much drift, the covisibility of recorded poses counts half."""
RECENT_M = 2.5
"""Frames with less way between them are no revisit; they share a third of the budget."""
VISIT_FRAMES = 8
"""Pairs between the same two runs of this many frames are of one visit."""
CELL_M = 0.25
_CELL_FORWARD = 0.18
"""Views in one cell of this size (a rotation by 10 degrees) and of `CELL_M` are one."""
_VISIT_WALKED_M = 3.0
"""Views in one cell are another visit once the camera has walked this much further."""

BASE_DISTANCE_M = 2.5
"""Cameras of a revisit are at most this far apart, m, plus what drift may add."""
MAX_DISTANCE_M = 8.0
"""Largest distance between cameras, m, drift included, where nothing but the poses is known."""
MAX_ANGLE_DEG = 65.0
"""Largest angle between the viewing directions of a revisit."""
VIEW_DISTANCE_M = 4.0
"""Views are compared at this distance, m, in front of the camera: two cameras that look at one spot from
different places are nearer than two that stand together and look apart."""
RETRIEVED_PER_FRAME = 4
"""Pairs of each frame that are proposed by retrieval: their frame descriptors are alike, wherever drift may
have put them."""
MAX_DRIFT_SIGMAS = SAME_MOTION_SIGMAS.value
"""Retrieved pairs are proposed only where drift of at most this many sigmas can explain them."""


@dataclass(frozen=True)
class PairOptions:
    """Which pairs of frames are tried."""

    neighbours: int = 4
    """Each frame is tried with this many that follow it."""
    loops_per_frame: int = 8
    """Pairs a frame may take part in as a revisit: of each visit the nearest views first."""

    def __post_init__(self) -> None:
        require_positive(self, "neighbours")


@dataclass(frozen=True)
class FrameDescriptors:
    """What is known of frames besides their poses."""

    vectors: Float[np.ndarray, "n d"]
    """Unit descriptors of whole frames (`retrieval.py`)."""
    sharpness: Float[np.ndarray, " n"]
    samples: ViewSamples


@dataclass(frozen=True)
class Views:
    """One frame for each view of each visit."""

    frame_idx: Int[np.ndarray, " v"]
    """Increasing."""
    centres: Float[np.ndarray, "v 3"]
    """m, world."""
    forward: Float[np.ndarray, "v 3"]
    """Unit, viewing direction."""


def choose_pairs(
    world_from_cams: Poses,
    odometry: Odometry,
    options: PairOptions,
    descriptors: FrameDescriptors | None = None,
) -> Int[np.ndarray, "p 2"]:
    """Pairs of frame indices, first < second, sorted.

    Args:
        options: how many, and how far apart.
        descriptors: what frames show; without it, pairs are chosen by poses alone.
    """
    n = len(world_from_cams)
    near = [
        np.column_stack([np.arange(n - k), np.arange(k, n)])
        for k in range(1, min(options.neighbours, n - 1) + 1)
    ]
    if options.loops_per_frame > 0:
        near.append(_revisits(world_from_cams, odometry, options, descriptors))
    return np.unique(np.concatenate([np.zeros((0, 2), dtype=int), *near]), axis=0)


def distinct_views(
    world_from_cams: Poses,
    walked_m: Float[np.ndarray, " n"],
    sharpness: Float[np.ndarray, " n"] | None = None,
) -> Views:
    """Frames that stand for their like, the sharpest of them where `sharpness` is known.

    Frames of one cell of position and direction, within `_VISIT_WALKED_M` of way, are alike: however
    long the camera stands there, one of them tells where it was.
    """
    n = len(world_from_cams)
    centres, forward = world_from_cams[:, :3, 3], world_from_cams[:, :3, 2]
    cells = np.column_stack(
        [
            np.floor(centres / CELL_M),
            np.floor(forward / _CELL_FORWARD),
            np.floor(walked_m / _VISIT_WALKED_M),
        ]
    ).astype(np.int64)
    _, group = np.unique(cells, axis=0, return_inverse=True)
    # unique gives the first of each group: with the sharpest (then the earliest) frames in front, those.
    best_first = np.lexsort((np.arange(n), np.zeros(n) if sharpness is None else -sharpness))
    _, first = np.unique(group.ravel()[best_first], return_index=True)
    frame_idx = np.sort(best_first[first])
    return Views(frame_idx, centres[frame_idx], forward[frame_idx])


def in_order_of_visits(
    pairs: Int[np.ndarray, "p 2"], gap: Float[np.ndarray, " p"]
) -> Int[np.ndarray, " p"]:
    """Order in which pairs are taken: the best (least `gap`) of every visit, then the second best, and so on.

    Without visits in between, the many views of the visit just before would take every place.
    """
    if len(pairs) == 0:
        return np.zeros(0, dtype=int)
    visit = pairs // VISIT_FRAMES
    # Sorted by visit, and by gap within it (lexsort's last key comes first), the pairs of a visit lie
    # together. A pair's rank is its place in that order less the place where its visit begins: the running
    # maximum of the begins. Sorting by rank and gap then takes one of each visit in turn; the frames
    # themselves come last, so that equal gaps are in an order of their own.
    by_visit = np.lexsort((pairs[:, 1], pairs[:, 0], gap, visit[:, 1], visit[:, 0]))
    sorted_visit = visit[by_visit]
    is_new = np.concatenate([[True], (np.diff(sorted_visit, axis=0) != 0).any(axis=1)])
    begin = np.maximum.accumulate(np.where(is_new, np.arange(len(pairs)), 0))
    rank = np.zeros(len(pairs), dtype=int)
    rank[by_visit] = np.arange(len(pairs)) - begin
    return np.lexsort((pairs[:, 1], pairs[:, 0], gap, rank))


def within_budget(pairs: Int[np.ndarray, "p 2"], most: int) -> Int[np.ndarray, "q 2"]:
    """Pairs taken in their order as long as neither frame has `most` already."""
    if len(pairs) == 0 or most == 0:
        return np.zeros((0, 2), dtype=int)
    n_used = np.zeros(int(pairs.max()) + 1, dtype=np.int64)
    return pairs[take_within_budget(pairs, most, n_used)]


def _revisits(
    world_from_cams: np.ndarray,
    odometry: Odometry,
    options: PairOptions,
    descriptors: FrameDescriptors | None,
) -> np.ndarray:
    """Pairs (p, 2) of frames that may show one place again, within the budget of each frame."""
    walked = odometry.walked_m
    sharpness = descriptors.sharpness if descriptors else None
    views = distinct_views(world_from_cams, walked, sharpness)
    pairs, gap = _near_views(views, odometry, options)
    retrieved = np.zeros((0, 2), dtype=int)
    if descriptors is not None:
        # By what they show: the gap between views knows neither walls nor the width of the image.
        similarity = similarity_of(descriptors.vectors, pairs)
        # Drift of a metre moves views of rooms so far that only the images can tell.
        _, drift = odometry.sigma_between(*pairs.T)
        covisibility = descriptors.samples.covisibility(world_from_cams, pairs)
        gap = -covisibility / (1.0 + drift / _DRIFT_M) - 2 * similarity
        retrieved, similarity = _retrieved(views, odometry, options, descriptors.vectors)
        order = in_order_of_visits(retrieved, -similarity)
        retrieved = within_budget(retrieved[order], RETRIEVED_PER_FRAME)
    # What the camera saw a moment ago is always the most alike, and tells the least about drift.
    is_recent = np.abs(walked[pairs[:, 1]] - walked[pairs[:, 0]]) < RECENT_M
    old, recent = (pairs[m][in_order_of_visits(pairs[m], gap[m])] for m in (~is_recent, is_recent))
    recent = within_budget(recent, max(1, options.loops_per_frame // 3))
    every = np.concatenate([retrieved, old, recent])
    # Each pair once, where it comes first: unique sorts, so the sorted first places restore the order.
    _, first = np.unique(every, axis=0, return_index=True)
    return within_budget(every[np.sort(first)], options.loops_per_frame)


def _near_views(
    views: Views, odometry: Odometry, options: PairOptions
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs (p, 2) of frames within the gate that drift allows, and how far apart the views are (p,)."""
    ahead = views.centres + VIEW_DISTANCE_M * views.forward
    # Nearest in six numbers, of the centre and of the spot ahead; beyond `reach` no pair passes the gate.
    location = np.hstack([views.centres, ahead])
    k = min(N_LOOKED_AT, len(location))
    reach = np.hypot(MAX_DISTANCE_M, MAX_DISTANCE_M + 2 * VIEW_DISTANCE_M)
    _, found = cKDTree(location).query(location, k=k, distance_upper_bound=reach)
    a = np.repeat(np.arange(len(location)), k)
    b = found.reshape(-1)
    exists = (b < len(location)) & (b != a)  # the tree gives its own length where there are fewer
    a, b = np.minimum(a[exists], b[exists]), np.maximum(a[exists], b[exists])
    a, b = np.unique(np.column_stack([a, b]), axis=0).T
    i, j = views.frame_idx[a], views.frame_idx[b]
    _, drift = odometry.sigma_between(i, j)
    distance = np.linalg.norm(views.centres[a] - views.centres[b], axis=1)
    ok = (
        (j - i > options.neighbours)
        & (distance < np.minimum(BASE_DISTANCE_M + 2 * drift, MAX_DISTANCE_M))
        & (_cosine(views, a, b) > np.cos(np.deg2rad(MAX_ANGLE_DEG)))
    )
    gap = np.linalg.norm(ahead[a] - ahead[b], axis=1) + distance
    return np.column_stack([i, j])[ok], gap[ok]


def _retrieved(
    views: Views, odometry: Odometry, options: PairOptions, vectors: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs (p, 2) of frames with the most similar descriptors that drift could explain; similarity (p,)."""

    def possible(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        i, j = views.frame_idx[a], views.frame_idx[b]
        sigma_rotation, sigma_translation = odometry.sigma_between(i, j)
        distance = np.linalg.norm(views.centres[a] - views.centres[b], axis=-1)
        angle = np.deg2rad(MAX_ANGLE_DEG) + MAX_DRIFT_SIGMAS * sigma_rotation
        reach = BASE_DISTANCE_M + MAX_DRIFT_SIGMAS * sigma_translation
        return (
            (np.abs(j - i) > options.neighbours)
            & (distance < reach)
            & (_cosine(views, a, b) > np.cos(np.minimum(angle, np.pi)))
        )

    # Twice the budget: half of them are taken by frames that have theirs already.
    pairs, similarity = most_similar(vectors[views.frame_idx], 2 * RETRIEVED_PER_FRAME, possible)
    return views.frame_idx[pairs], similarity


def _cosine(views: Views, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Between the viewing directions of views, of any shape."""
    return np.sum(views.forward[a] * views.forward[b], axis=-1)

"""Around a loop that was verified there are more: its neighbours, chosen by the motion that it gave.

Recorded poses that have drifted by a metre tell little of which views overlap. Once one pair of two visits
is verified, it does: the motion of its neighbours follows from it and a few recorded steps.
"""

import numpy as np

from planfit.geometry import se3
from planfit.matching.covisibility import ViewSamples
from planfit.matching.loop_closure import RelativePoses
from planfit.matching.pairs import PairOptions, in_order_of_visits, within_budget

REACH = 3
"""Views before and after each end of a verified loop that are looked at."""
MIN_OVERLAP = 0.25
"""Pairs that should share less are not tried."""
CHUNK = 100_000


def around_loops(
    loops: RelativePoses,
    tried: np.ndarray,
    view_idx: np.ndarray,
    world_from_cams: np.ndarray,
    samples: ViewSamples,
    options: PairOptions,
) -> np.ndarray:
    """Pairs (p, 2) of frames to try next, first < second, sorted; none of them tried before.

    Args:
        loops: what was verified and believed, between frames of `view_idx` or any others.
        tried: (t, 2) pairs, first < second.
        view_idx: (v,) frames that stand for their like, increasing.
        world_from_cams: (n, 4, 4) recorded poses.
        samples: what each frame shows.
        options: `expanded_per_frame` bounds the pairs of a frame.
    """
    none = np.zeros((0, 2), dtype=int)
    far = loops.pairs[:, 1] - loops.pairs[:, 0] > options.neighbours
    loops = loops[far]
    if len(loops.pairs) == 0 or options.expanded_per_frame == 0:
        return none
    at = np.searchsorted(view_idx, loops.pairs).clip(0, len(view_idx) - 1)
    steps = np.stack(np.meshgrid(*[np.arange(-REACH, REACH + 1)] * 2), axis=-1).reshape(-1, 2)
    steps = steps[np.argsort(np.abs(steps).sum(axis=1), kind="stable")]
    found, source = none, np.zeros(0, dtype=int)
    for step in steps:  # the nearest first: they say best what to expect
        near = at + step
        inside = ((near >= 0) & (near < len(view_idx))).all(axis=1)
        new = view_idx[near[inside]]
        apart = new[:, 1] - new[:, 0] > options.neighbours
        found = np.concatenate([found, new[apart]])
        source = np.concatenate([source, np.flatnonzero(inside)[apart]])
        found, first = np.unique(found, axis=0, return_index=True)
        source = source[first]
    n = len(world_from_cams)
    fresh = ~np.isin(found @ (n, 1), tried @ (n, 1))
    found, source = found[fresh], source[fresh]
    overlap = np.zeros(len(found))
    for first in range(0, len(found), CHUNK):
        part = slice(first, first + CHUNK)
        motion = _expected(found[part], loops[source[part]], world_from_cams)
        overlap[part] = samples.overlap_of(found[part], motion)
    found, overlap = found[overlap > MIN_OVERLAP], overlap[overlap > MIN_OVERLAP]
    order = in_order_of_visits(found, -overlap)
    return np.unique(within_budget(found[order], options.expanded_per_frame), axis=0)


def _expected(pairs: np.ndarray, loops: RelativePoses, world_from_cams: np.ndarray) -> np.ndarray:
    """Motion (p, 4, 4) between frames by way of a loop nearby."""
    (i, j), (k, m) = pairs.T, loops.pairs.T
    i_from_k = se3.inverse(world_from_cams[i]) @ world_from_cams[k]
    m_from_j = se3.inverse(world_from_cams[m]) @ world_from_cams[j]
    return i_from_k @ loops.a_from_b @ m_from_j

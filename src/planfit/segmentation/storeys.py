"""Which storey each frame stands on, by the heights of the floor it sees."""

import numpy as np
from jaxtyping import Float, Int

from planfit.priors import STOREY_HEIGHT_M, WORKTOP_HEIGHT_M
from planfit.segmentation.label_kernels import BIN_M
from planfit.segmentation.types import NO_STOREY

_MAX_WORKTOP_M = WORKTOP_HEIGHT_M.value
_WITHIN_M = 0.2
"""Floors of one storey lie within this of each other, up and down, where poses drift a little."""
_STEP_M = 0.25
"""The floor drifts by less than this from one submap to the next."""
_MIN_STOREY_M = STOREY_HEIGHT_M.low
"""Storeys are at least this far apart; a smaller range of heights is drift, or steps within one."""
MAX_DRIFT_M = 0.7
"""A frame belongs to a storey whose floor is within this of the floor that it sees."""
_MIN_SHARE = 0.05
"""Share of the frames with floor that a storey needs; fewer are a landing."""


def find_storeys(
    height_m: Float[np.ndarray, " m"], start: Int[np.ndarray, " n_plus_1"]
) -> tuple[float, Float[np.ndarray, " n"]]:
    """Height of the main storey's floor, and that of each frame's storey above it, m.

    The paper fits one plane to all floor points, once. With up known only its height is free, and the
    median is the fit that wrong labels move least. Here it is fitted to each storey. The main one is
    that with most floor points. Without floor: NaN, and zeros.

    Args:
        height_m: of floor points in the levelled world, sorted by frame.
        start: frame i has the points start[i]:start[i + 1].
    """
    n = len(start) - 1
    counts = np.diff(start)
    if len(height_m) == 0:
        return float("nan"), np.zeros(n)
    seen = np.flatnonzero(counts)
    of_frame = np.array([np.median(height_m[start[i] : start[i + 1]]) for i in seen])
    levels = _peaks(of_frame)
    if len(levels) < 2:
        return float(np.median(height_m)), np.zeros(n)
    # A frame that sees no floor stands where the last one stood: interpolation between the frames that do,
    # rounded down, is the last of them (the first, before it).
    known = np.interp(np.arange(n), seen, np.arange(len(seen))).astype(int)
    nearest = np.argmin(np.abs(of_frame[:, None] - levels), axis=1)
    is_on = np.abs(of_frame - levels[nearest]) < MAX_DRIFT_M
    # From frames to their points, to fit each storey's height to all points of its frames.
    point_level = np.full(n, -1)
    point_level[seen] = np.where(is_on, nearest, -1)
    per_point = np.repeat(point_level, counts)
    fitted = np.array([np.median(height_m[per_point == k]) for k in range(len(levels))])
    main = int(np.argmax(np.bincount(per_point[per_point >= 0], minlength=len(levels))))
    above = np.where(is_on, fitted[nearest] - fitted[main], np.nan)
    return float(fitted[main]), above[known]


def number_storeys(
    floor_heights_m: Float[np.ndarray, " n"], camera_heights_m: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " k"], Int[np.ndarray, " n"]]:
    """Floors (m) of the storeys that were walked, from the lowest, and which of them each frame stands on.

    From stairs one sees the floor that one comes from or goes to, but is higher or lower over it than a
    person who stands on it: such frames have `NO_STOREY`.

    Args:
        floor_heights_m: of the storey whose floor each frame sees, as `find_storeys` gives them.
        camera_heights_m: in the same frame, loops closed.
    """
    is_known = np.isfinite(floor_heights_m)
    floors_m, of_known = np.unique(floor_heights_m[is_known], return_inverse=True)
    above_m = camera_heights_m - floor_heights_m
    off_m = np.abs(above_m - np.median(above_m[is_known])) if is_known.any() else above_m
    of_frames = np.full(len(floor_heights_m), NO_STOREY)
    of_frames[is_known] = of_known
    with np.errstate(invalid="ignore"):
        of_frames[off_m > MAX_DRIFT_M] = NO_STOREY
    return floors_m, of_frames


def storey_heights(floors_m: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Floors (m) found in submaps of a scan, with those mended that are no floor; NaN for none.

    A submap that saw a worktop for the floor, or none, has the floor of the nearest submap that knows it:
    a worktop is up to 1.2 m over a floor that other submaps saw. Between storeys, on stairs, there is none.
    """
    n = len(floors_m)
    is_known = np.zeros(n, dtype=bool)
    least = max(1.0, _MIN_SHARE * np.isfinite(floors_m).sum())
    above_m = -np.inf
    for floor_m in np.sort(floors_m[np.isfinite(floors_m)]):
        with np.errstate(invalid="ignore"):
            alike = (floors_m >= floor_m) & (floors_m <= floor_m + 2 * _WITHIN_M)
        if floor_m >= above_m and alike.sum() >= least:
            is_known |= alike
            above_m = floor_m + _MIN_STOREY_M
    if not is_known.any():
        return floors_m
    # Heights drift over a long scan, but little from one submap to the next: what is known spreads to the
    # end, then back to the start.
    for order in (range(1, n), range(n - 2, -1, -1)):
        for k in order:
            before = k - 1 if order.step > 0 else k + 1
            is_known[k] |= is_known[before] and abs(floors_m[k] - floors_m[before]) < _STEP_M
    known = np.flatnonzero(is_known)
    below = floors_m[known[np.argmin(np.abs(np.arange(n)[:, None] - known), axis=1)]]
    with np.errstate(invalid="ignore"):
        is_top = (floors_m > below) & (floors_m - below < _MAX_WORKTOP_M)
    mended = np.where(np.isnan(floors_m) | is_top, below, np.nan)
    mended[known] = floors_m[known]
    return mended


def _peaks(of_frame: np.ndarray) -> np.ndarray:
    """Heights (k,) m at which many frames see their floor, at least a storey apart, highest count first."""
    low = of_frame.min() - BIN_M
    edges = np.arange(low, of_frame.max() + 2 * BIN_M, BIN_M)
    counts, _ = np.histogram(of_frame, edges)
    wide = np.convolve(counts, np.ones(7))[3:-3]
    centres = 0.5 * (edges[:-1] + edges[1:])
    # The highest bin, then the highest at least a storey away (non-maximum suppression), and so on.
    peaks: list[float] = []
    while wide.max() >= max(_MIN_SHARE * len(of_frame), 1):
        k = int(np.argmax(wide))
        peaks.append(float(centres[k]))
        wide[np.abs(centres - centres[k]) < _MIN_STOREY_M] = 0
    return np.array(peaks)

"""Faults of drawings taken out before walls are looked for, and curves in short segments told as curves."""

from dataclasses import replace

import numpy as np
import shapely
from jaxtyping import Bool, Int

from planfit.floorplan.vector.arcs import arc_segments, joints
from planfit.floorplan.vector.drawing import ABSURD, SAME, Lines, VectorDrawing
from planfit.floorplan.vector.layer_names import counted
from planfit.floorplan.vector.line_work import usual_extent
from planfit.geometry import segments

MOST_ALIKE = 4.0
"""A segment of a curve is at most so many times as long as the longer one of its neighbours."""

MOST_TIMES = 50
"""Of a line drawn so many times at one place, more are left out: no wall has as many outlines, and every pair
of equal lines is looked at."""


def cleaned(drawing: VectorDrawing) -> tuple[VectorDrawing, tuple[str, ...]]:
    """The drawing without lines that no plan has, and a sentence on each kind left out."""
    lines, notes = drawing.lines, []
    with np.errstate(invalid="ignore"):
        is_absurd = np.asarray(~(np.abs(lines.ends) < ABSURD).all(axis=(1, 2)))
    if is_absurd.any():
        lines_are = counted(is_absurd.sum(), "line")
        notes.append(f"{lines_are} with coordinates that are no numbers or beyond 1e9")
        lines = lines.take(~is_absurd)
    if len(lines):
        extent = usual_extent(lines.ends.reshape(-1, 2))
        is_point = segments.lengths(lines.ends) <= 1e-7 * extent
        if is_point.any():
            notes.append(f"{counted(is_point.sum(), 'line')} without length")
            lines = lines.take(~is_point)
        unit = max(1e-6 * extent, 1e-12)
        keys = np.round(lines.ends / unit).astype(np.int64).reshape(-1, 4)
        is_reversed = (keys[:, 0] > keys[:, 2]) | (
            (keys[:, 0] == keys[:, 2]) & (keys[:, 1] > keys[:, 3])
        )
        keys[is_reversed] = keys[is_reversed][:, [2, 3, 0, 1]]
        _, of = np.unique(np.column_stack([keys, lines.layer]), axis=0, return_inverse=True)
        # They stay: outlines of neighbours share sides, and each is needed whole to be closed. Lines on
        # one another are one wall in `merge_collinear`.
        n_twice = len(lines) - int(of.max(initial=-1)) - 1
        if n_twice:
            notes.append(f"{counted(n_twice, 'line')} drawn twice")
        lines = lines.take(_rank_among_equal(of.ravel()) < MOST_TIMES)
    lines = _simplified(lines)
    lines = lines.take(segments.lengths(lines.ends) > 0)
    lines = replace(lines, is_curved=lines.is_curved | curve_segments(lines) | arc_segments(lines))
    return replace(drawing, lines=lines), tuple(notes)


def _rank_among_equal(of: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """How many with the same number come before each."""
    order = np.argsort(of, kind="stable")
    is_first = np.diff(of[order], prepend=-1) != 0
    places = np.arange(len(of))
    rank = np.zeros(len(of), dtype=int)
    rank[order] = places - np.maximum.accumulate(np.where(is_first, places, 0))
    return rank


def _simplified(lines: Lines) -> Lines:
    """Paths with fewer corners, none off by more than 3e-5 of the drawing (a millimetre in a
    building of 30 m): some files hold curves as tens of thousands of segments."""
    n = len(lines)
    if n < 4:
        return lines
    extent = usual_extent(lines.ends.reshape(-1, 2))
    joined = (
        (lines.path[:-1] == lines.path[1:])
        & (lines.is_curved[:-1] == lines.is_curved[1:])
        & (np.abs(lines.ends[:-1, 1] - lines.ends[1:, 0]).max(axis=1) <= 1e-9 * extent)
    )
    # Runs of joined segments: where each begins, the run of each segment, where each run ends.
    first = np.flatnonzero(np.concatenate([[True], ~joined]))
    run = np.repeat(np.arange(len(first)), np.diff(np.append(first, n)))
    last = np.append(first[1:], n) - 1
    # A run has a point more than segments: the first ends of all, and the second end of its last, sorted in
    # behind them by run (the sort is stable).
    points = np.concatenate([lines.ends[:, 0], lines.ends[last, 1]])
    owner = np.concatenate([run, np.arange(len(first))])
    order = np.argsort(owner, kind="stable")
    paths = shapely.linestrings(points[order], indices=owner[order])
    simple, of = shapely.get_coordinates(
        shapely.simplify(paths, SAME * extent, preserve_topology=False), return_index=True
    )
    # Two points in sequence are a segment where they are of one run.
    same = of[:-1] == of[1:]
    taken = lines.take(first[of[:-1][same]])
    return replace(taken, ends=np.stack([simple[:-1][same], simple[1:][same]], axis=1))


def curve_segments(lines: Lines) -> Bool[np.ndarray, " n"]:
    """Which segments are of curves that a file holds as short straight segments.

    A segment is of a curve where it turns by 2 to 40 degrees to the same side at both ends, or follows
    such a segment that turns so.
    """
    n = len(lines)
    if n < 3:
        return np.zeros(n, dtype=bool)
    length, (bend, joined) = segments.lengths(lines.ends), joints(lines)
    side = np.where(
        joined & (np.abs(bend) > np.deg2rad(2)) & (np.abs(bend) < np.deg2rad(40)),
        np.sign(bend),
        0.0,
    )
    before, after = np.concatenate([[0.0], side]), np.concatenate([side, [0.0]])
    # The side of a box with rounded corners turns at both ends too, and is far longer than the rest.
    beside = np.maximum(np.append(length[1:], 0.0), np.append(0.0, length[:-1]))
    is_curved = (before * after > 0) & (length < MOST_ALIKE * beside)
    follows = (before != 0) & np.concatenate([[False], is_curved[:-1]])
    leads = (after != 0) & np.concatenate([is_curved[1:], [False]])
    return is_curved | ((follows | leads) & (length < MOST_ALIKE * beside))

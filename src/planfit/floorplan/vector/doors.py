"""Leaves of doors: drawn open, as a line or a thin box from the hinge to the tip of a quarter circle, or,
where they swing both ways, from end to end of a half circle."""

import numpy as np
import scipy.spatial

from planfit.floorplan.vector.drawing import Lines
from planfit.geometry import segments

TOLERANCE = 0.12
"""Of a leaf's length: leaves are up to 6 cm thick, and arcs are drawn to either edge."""


def arcs_of_lines(lines: Lines) -> tuple[np.ndarray, np.ndarray]:
    """The two ends (n, 2, 2) of each run of pieces of a curve, in the order of the file, and its length (n,).

    A run goes on from one path to the next where it keeps its course: some programs write one arc as
    several splines. The arcs of a double door meet at a point, but turn back there.
    """
    if not lines.is_curved.any():
        return np.zeros((0, 2, 2)), np.zeros(0)
    at = np.flatnonzero(lines.is_curved)
    ends, along = lines.ends[at], segments.directions(lines.ends[at])
    gap = np.linalg.norm(ends[1:, 0] - ends[:-1, 1], axis=1)
    joined = (
        (np.diff(at) == 1)
        & (gap <= 1e-3 * segments.lengths(ends)[1:])
        & (np.einsum("ni,ni->n", along[1:], along[:-1]) > 0.5)
    )
    is_first, is_last = np.concatenate([[True], ~joined]), np.concatenate([~joined, [True]])
    length = np.bincount(np.cumsum(is_first) - 1, segments.lengths(ends))
    return np.stack([ends[is_first, 0], ends[is_last, 1]], axis=1), length


def is_door_leaf(ends: np.ndarray, arcs: np.ndarray, arc_lengths: np.ndarray) -> np.ndarray:
    """Which lines (n, 2, 2) reach from the centre of a quarter circle to one of its ends, or join those of a
    half circle.

    Args:
        ends: (n, 2, 2).
        arcs: (k, 2, 2) ends of curves of any kind.
        arc_lengths: (k,)
    """
    found = np.zeros(len(ends), dtype=bool)
    if len(ends) == 0:
        return found
    length = segments.lengths(ends)
    # Ends of all lines, the first ends first: a drawing has thousands of arcs and of lines.
    tree = scipy.spatial.cKDTree(np.concatenate([ends[:, 0], ends[:, 1]]))
    chords = segments.lengths(arcs)
    is_half = np.abs(arc_lengths - np.pi / 2 * chords) < 0.1 * chords
    both_ways = np.concatenate([arcs, arcs[:, ::-1]])
    for (tip, latch), chord, half in zip(
        both_ways, np.tile(chords, 2), np.tile(is_half, 2), strict=True
    ):
        if chord == 0:
            continue
        radius = chord / np.sqrt(2)
        near = TOLERANCE * radius
        at_tip = np.array(tree.query_ball_point(tip, near), dtype=int)
        line, other = at_tip % len(ends), 1 - at_tip // len(ends)
        from_latch = np.linalg.norm(ends[line, other] - latch, axis=1)
        if half:
            is_leaf = from_latch < near
        else:
            is_leaf = (np.abs(length[line] - radius) < near) & (np.abs(from_latch - radius) < near)
        found[line[is_leaf]] = True
    return found

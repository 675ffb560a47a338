"""From bare segments to faces: which side of each segment is free.

Plans draw a wall as two parallel lines with the wall between them. So the free side of a line is
the one away from its partner: the nearest parallel line that overlaps it within a wall's thickness.
A line that has partners on both sides equally near, or none, stays unoriented.
"""

import numpy as np

from planfit.geometry import segments

_PARALLEL_SINE = np.sin(np.deg2rad(5.0))


def orient_faces(
    ends: np.ndarray, max_thickness_m: float = 0.6, min_thickness_m: float = 0.02
) -> tuple[np.ndarray, np.ndarray]:
    """Normals (n, 2) towards the free side, and whether that side is known (n,) bool.

    Args:
        ends: (n, 2, 2) m.
        max_thickness_m: parallel lines further apart than this are two walls, not one.
        min_thickness_m: lines nearer than this are the same line drawn twice.
    """
    normals = segments.left_normals(ends)
    gap_left, overlap_left = _nearest_partner(ends, normals, max_thickness_m, min_thickness_m)
    gap_right, overlap_right = _nearest_partner(ends, -normals, max_thickness_m, min_thickness_m)
    # The wall is on the side where most of the line has a partner; where both sides have one
    # (a thin cavity between two walls), the nearer partner is the wall.
    wall_is_left = (overlap_left > 0.3) & ((overlap_right <= 0.3) | (gap_left < 0.7 * gap_right))
    wall_is_right = (overlap_right > 0.3) & ((overlap_left <= 0.3) | (gap_right < 0.7 * gap_left))
    is_oriented = wall_is_left ^ wall_is_right
    return np.where(wall_is_left[:, None], -normals, normals), is_oriented


def _nearest_partner(
    ends: np.ndarray, sides: np.ndarray, max_thickness_m: float, min_thickness_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Gap (n,) m to the nearest partner on the side that `sides` (n, 2) points to, and the share of
    each line (n,) that has any partner there."""
    along = segments.directions(ends)
    length = segments.lengths(ends)
    gaps, shares = np.full(len(ends), np.inf), np.zeros(len(ends))
    for i in range(len(ends)):
        relative = ends - ends[i, 0]
        gap = relative @ sides[i]
        at = relative @ along[i]
        low, high = np.clip(np.sort(at, axis=1), 0.0, length[i]).T
        is_partner = (
            (np.abs(along @ sides[i]) < _PARALLEL_SINE)
            & (gap.min(axis=1) > min_thickness_m)
            & (gap.max(axis=1) < max_thickness_m)
            & (high - low > max_thickness_m / 12)
        )
        if is_partner.any():
            gaps[i] = gap[is_partner].min()
            shares[i] = _covered(low[is_partner], high[is_partner]) / length[i]
    return gaps, shares


def _covered(low: np.ndarray, high: np.ndarray) -> float:
    """Length of the union of intervals."""
    total, reached = 0.0, -np.inf
    for i in np.argsort(low):
        total += max(0.0, float(high[i] - max(low[i], reached)))
        reached = max(reached, float(high[i]))
    return total


def usual_gap(ends: np.ndarray) -> float:
    """Gap between a line and its nearest parallel neighbour, of the median length of line; infinite
    where most have none. Says how thick walls are in a plan whose scale is unknown."""
    extent = float(np.ptp(ends.reshape(-1, 2), axis=0).max())
    normals = segments.left_normals(ends)
    gaps = [_nearest_partner(ends, side, extent, 1e-4 * extent)[0] for side in (normals, -normals)]
    nearest = np.minimum(*gaps)
    order = np.argsort(nearest)
    length = np.cumsum(segments.lengths(ends)[order])
    return float(nearest[order][np.searchsorted(length, length[-1] / 2)])

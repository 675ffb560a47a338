"""Lines that lie on one another, or continue one another, become one."""

import numpy as np
import scipy.sparse
import shapely

from planfit.floorplan.faces import line_strings
from planfit.geometry import segments


def merge_collinear(ends: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Lines (m, 2, 2) that cover the same ground, and for each of (n, 2, 2) the one it went into.

    Only lines that touch within `tolerance` and stay as near to the line of the longer one are
    joined: a door between two pieces of wall stays open.
    """
    if len(ends) == 0:
        return ends, np.zeros(0, dtype=int)
    lines = line_strings(ends)
    a, b = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=tolerance)
    length = segments.lengths(ends)
    shorter = (length[b] < length[a]) | ((length[b] == length[a]) & (a < b))
    a, b = a[shorter], b[shorter]  # a: the longer
    across = np.einsum("pei,pi->pe", ends[b] - ends[a, :1], segments.left_normals(ends)[a])
    is_one = np.abs(across).max(axis=1) < tolerance
    n = len(ends)
    graph = scipy.sparse.coo_matrix((np.ones(is_one.sum()), (a[is_one], b[is_one])), shape=(n, n))
    count, group = scipy.sparse.csgraph.connected_components(graph, directed=False)
    # The longest of each group gives the line, all of it the extent.
    order = np.lexsort((-length, group))
    first = order[np.searchsorted(group[order], np.arange(count))]
    origin, along = ends[first, 0], segments.directions(ends)[first]
    at = np.einsum("nei,ni->ne", ends - origin[group][:, None], along[group])
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, group, at.min(axis=1))
    np.maximum.at(high, group, at.max(axis=1))
    merged = origin[:, None] + np.stack([low, high], axis=1)[:, :, None] * along[:, None]
    return merged, group

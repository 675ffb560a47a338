"""Columns among walls drawn as lines: small closed outlines that nothing else of their layer touches."""

import numpy as np
import scipy.sparse
import scipy.spatial
import shapely
from jaxtyping import Bool, Float, Int, Shaped

from planfit.floorplan.faces import line_strings

LEAST = 0.24
"""Of the largest column, 0.22 m of 0.93: smaller ones are mullions and posts of railings."""
_SLIM = 2.0
_FILLED, _ROUND = 0.93, 0.03
"""A column fills its box, up to chamfers, or is a circle up to this share; pans and basins are neither."""
_ALIKE, _MANY = 0.1, 3
"""Elsewhere than among walls, columns are at least so many of one size, up to this share of it."""


def find_column_rings(
    ends: Float[np.ndarray, "n 2 2"], most: float, is_wall_layer: bool = True
) -> Shaped[np.ndarray, " k"]:
    """Outlines of columns, as polygons, among the lines of a layer, curves included.

    Columns are compact, rectangles or circles, and nothing of the layer is in them, as in shafts, frames and
    furniture.

    Args:
        ends: of the layer's lines.
        most: largest side of a column.
        is_wall_layer: whether the layer is called wall; elsewhere columns are asked to be several alike.
    """
    areas = _rings(ends, LEAST * most, most)
    if len(areas) == 0:
        return areas
    found = areas[_have_form(areas)]
    if len(found) == 0:
        return found
    strings = line_strings(ends)
    inner = shapely.buffer(found, -0.01 * most)
    column, _ = shapely.STRtree(strings).query(inner, predicate="intersects")
    found = found[~np.isin(np.arange(len(found)), column)]
    if is_wall_layer or len(found) == 0:
        return found
    size = np.sqrt(shapely.area(found))
    alike = np.abs(size[:, None] / size[None] - 1) < _ALIKE
    return found[alike.sum(axis=1) >= _MANY]


def _have_form(areas: Shaped[np.ndarray, " k"]) -> Bool[np.ndarray, " k"]:
    """Which areas are compact rectangles or circles."""
    boxes = np.array([shapely.oriented_envelope(area) for area in areas], dtype=object)
    corners = np.stack([shapely.get_coordinates(box)[:3] for box in boxes])
    sides = np.sort(np.linalg.norm(np.diff(corners, axis=1), axis=2), axis=1)
    area = shapely.area(areas)
    is_rectangle = area > _FILLED * shapely.area(boxes)
    perimeter = shapely.length(areas)
    is_circle = np.abs(4 * np.pi * area / perimeter**2 - 1) < _ROUND
    return (sides[:, 1] < _SLIM * sides[:, 0]) & (is_rectangle | is_circle)


def _rings(ends: Float[np.ndarray, "n 2 2"], least: float, most: float) -> Shaped[np.ndarray, " k"]:
    """Areas within segments that close, end to end, and that no other touches; the sides of their boxes from
    `least` to `most`."""
    n = len(ends)
    tips = ends.reshape(-1, 2)
    pairs = scipy.spatial.cKDTree(tips).query_pairs(1e-3 * most, output_type="ndarray")
    corner = _groups(pairs, 2 * n)
    meeting = np.bincount(corner)
    ring = _groups(np.stack([corner[::2], corner[1::2]], axis=1), int(corner.max()) + 1)[
        corner[::2]
    ]
    count = int(ring.max()) + 1
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, np.repeat(ring, 2), tips)
    np.maximum.at(high, np.repeat(ring, 2), tips)
    fits = ((high - low).min(axis=1) >= least) & ((high - low).max(axis=1) <= most)
    fits &= np.bincount(np.repeat(ring, 2), meeting[corner] != 2, minlength=count) == 0
    found = []
    for each in np.flatnonzero(fits):
        own = np.flatnonzero(ring == each)
        snapped = tips[np.unique(corner, return_index=True)[1]][corner.reshape(-1, 2)[own]]
        area = shapely.get_parts(shapely.polygonize(line_strings(snapped)))
        found += [*area] if len(area) == 1 else []
    return np.array(found, dtype=object)


def _groups(pairs: Int[np.ndarray, "p 2"], n: int) -> Int[np.ndarray, " n"]:
    """Number of the connected group of each of `n`."""
    graph = scipy.sparse.coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return scipy.sparse.csgraph.connected_components(graph, directed=False)[1]

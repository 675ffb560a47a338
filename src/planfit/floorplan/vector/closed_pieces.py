"""Walls and columns drawn piece by piece as closed outlines, on layers that are called so."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse
import scipy.spatial
import shapely
from jaxtyping import Float, Int
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.vector.drawing import Lines
from planfit.floorplan.vector.layer_names import Role
from planfit.geometry import segments

MIN_SHARE = 0.6
"""Of the length of a layer that closed pieces make, where it draws its walls so. Elsewhere a slim closed
outline may be a shaft, and the room in it."""
_COLUMN = 1.5
"""What is no longer than so many times the thickest wall is a column, which may be round."""
_LEAST_COLUMN = 0.35
"""Of the thickest wall, 0.22 m: smaller ones are mullions and posts of railings."""
_SLIM, _CONVEX = 2.0, 0.95


@dataclass(frozen=True)
class ClosedPieces:
    """Solid pieces, in the drawing's unit."""

    areas: list[BaseGeometry]
    layer: Int[np.ndarray, " k"]
    """Layers that they are on, ascending."""
    column_size: float
    """What is joined and still no larger stands alone, a column."""


def closed_pieces(lines: Lines, roles: list[Role], most: float) -> ClosedPieces:
    """Closed paths nowhere wider than walls may be, of the layers called wall that hold little else.

    Args:
        lines: of layers that may hold walls, in the order of the file.
        roles: of the layers.
        most: how thick walls may be, in the unit of the lines.
    """
    found: list[BaseGeometry] = []
    used = []
    length = segments.lengths(lines.ends)
    for layer, role in enumerate(roles):
        at = np.flatnonzero(lines.layer == layer) if role == Role.WALL else np.zeros(0, dtype=int)
        if len(at) == 0:
            continue
        areas = _closed_areas(lines.take(at))
        slim = areas[[area.buffer(-most / 2).is_empty for area in areas]] if len(areas) else areas
        if shapely.length(slim).sum() < MIN_SHARE * length[at].sum():
            slim = _columns(lines.take(at), most)
        if len(slim) == 0:
            continue
        used.append(layer)
        found += [*slim]
    return ClosedPieces(found, np.array(used, dtype=int), _COLUMN * most)


def _columns(lines: Lines, most: float) -> np.ndarray:
    """Rings among walls drawn as lines that are columns: compact, about as thick as walls may be, with nothing
    of the layer in them, as shafts, frames and boxes of furniture have."""
    areas = _rings(lines.ends, _LEAST_COLUMN * most, _COLUMN * most)
    if len(areas) == 0:
        return areas
    side = np.ptp(shapely.bounds(areas).reshape(-1, 2, 2), axis=1)
    fits = side.max(axis=1) < _SLIM * side.min(axis=1)
    fits &= shapely.area(areas) > _CONVEX * shapely.area(shapely.convex_hull(areas))
    found = areas[fits]
    if len(found) == 0:
        return found
    strings = shapely.linestrings(lines.ends)
    inner = shapely.buffer(found, -0.02 * most)
    column, _ = shapely.STRtree(strings).query(inner, predicate="intersects")
    return found[~np.isin(np.arange(len(found)), column)]


def _rings(ends: Float[np.ndarray, "n 2 2"], least: float, most: float) -> np.ndarray:
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
        area = shapely.get_parts(shapely.polygonize(list(shapely.linestrings(snapped))))
        found += [*area] if len(area) == 1 else []
    return np.array(found, dtype=object)


def _groups(pairs: Int[np.ndarray, "p 2"], n: int) -> Int[np.ndarray, " n"]:
    """Number of the connected group of each of `n`."""
    graph = scipy.sparse.coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return scipy.sparse.csgraph.connected_components(graph, directed=False)[1]


def joined(pieces: list[BaseGeometry], seam: float) -> BaseGeometry:
    """One area; pieces that meet up to rounding are one wall."""
    grown = shapely.union_all([piece.buffer(seam, join_style="mitre") for piece in pieces])
    return grown.buffer(-seam, join_style="mitre")


def _closed_areas(lines: Lines) -> np.ndarray:
    """Areas of paths that end where they begin and do not cross themselves."""
    order = np.argsort(lines.path, kind="stable")
    ends, path = lines.ends[order], lines.path[order]
    starts = np.flatnonzero(np.diff(path, prepend=-1))
    stops = np.append(starts[1:], len(path))
    found = []
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        if stop - start < 3:
            continue
        ring = np.concatenate([ends[start:stop, 0], ends[stop - 1 : stop, 1]])
        near = 1e-3 * float(np.ptp(ring, axis=0).max())
        steps = np.abs(ends[start + 1 : stop, 0] - ends[start : stop - 1, 1]).max()
        if max(np.abs(ring[0] - ring[-1]).max(), steps) > near:
            continue
        area = shapely.Polygon(ring)
        if area.is_valid and area.area > 0:
            found.append(area)
    return np.array(found, dtype=object)

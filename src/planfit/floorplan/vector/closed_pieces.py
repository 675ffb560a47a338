"""Walls and columns drawn piece by piece as closed outlines, on layers that are called so."""

from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Int
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.vector.column_rings import find_column_rings
from planfit.floorplan.vector.drawing import Lines
from planfit.floorplan.vector.layer_names import Role
from planfit.geometry import segments

MIN_SHARE = 0.6
"""Of the length of a layer that closed pieces make, where it draws its walls so. Elsewhere a slim closed
outline may be a shaft, and the room in it."""
_COLUMN = 1.5
"""What is no longer than so many times the thickest wall is a column, which may be round."""


@dataclass(frozen=True)
class ClosedPieces:
    """Solid pieces, in the drawing's unit."""

    areas: list[BaseGeometry]
    layer: Int[np.ndarray, " k"]
    """Layers that they are on, ascending."""
    column_size: float
    """What is joined and still no larger stands alone, a column."""


def closed_pieces(lines: Lines, roles: list[Role], most: float) -> ClosedPieces:
    """Closed paths nowhere wider than walls may be, of the layers called wall that hold little else; of the
    others, columns.

    Args:
        lines: of layers that may hold walls, in the order of the file.
        roles: of the layers.
        most: how thick walls may be, in the unit of the lines.
    """
    found: list[BaseGeometry] = []
    used = []
    length = segments.lengths(lines.ends)
    for layer, role in enumerate(roles):
        at = np.flatnonzero(lines.layer == layer)
        if len(at) == 0 or role not in (Role.WALL, Role.OPENING):
            continue
        if role == Role.OPENING:
            columns = find_column_rings(lines.ends[at], _COLUMN * most, is_wall_layer=False)
            found, used = [*found, *columns], [*used, *[layer][: len(columns)]]
            continue
        areas = _closed_areas(lines.take(at))
        slim = areas[[area.buffer(-most / 2).is_empty for area in areas]] if len(areas) else areas
        if shapely.length(slim).sum() < MIN_SHARE * length[at].sum():
            slim = find_column_rings(lines.ends[at], _COLUMN * most)
        if len(slim) == 0:
            continue
        used.append(layer)
        found += [*slim]
    return ClosedPieces(found, np.array(used, dtype=int), _COLUMN * most)


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

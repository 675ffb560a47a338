"""From solid wall, seen from above, to its faces: what readers of pictures, drawings and models share."""

from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from planfit.geometry import segments


@dataclass(frozen=True)
class RegionFaces:
    """Boundary of solid wall; lengths in the unit of the regions."""

    ends: np.ndarray  # (n, 2, 2)
    normals: np.ndarray  # (n, 2) unit, out of the wall
    thickness: np.ndarray  # (n,) wall behind each face


def faces_of_regions(walls: BaseGeometry, tolerance: float, min_length: float) -> RegionFaces:
    """Straight faces around solid wall.

    Args:
        walls: polygons of solid wall, x-y seen from above; where they overlap they are one wall.
        tolerance: corners nearer than this to the line between their neighbours are straightened
            (Douglas and Peucker 1973).
        min_length: shorter faces are left out: ends of thin walls and jambs of openings, which carry no
            wall that a scan could be held to.
    """
    solid = shapely.simplify(shapely.union_all(shapely.get_parts(walls)), tolerance)
    rings = [
        # The wall to the left of every ring: outlines counter-clockwise, holes clockwise.
        np.asarray(ring.coords)[:, :2]
        for part in shapely.get_parts(solid)
        if part.geom_type == "Polygon" and not part.is_empty
        for polygon in [orient(part)]
        for ring in (polygon.exterior, *polygon.interiors)
    ]
    if not rings:
        return RegionFaces(np.zeros((0, 2, 2)), np.zeros((0, 2)), np.zeros(0))
    ends = np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings])
    ends = ends[segments.lengths(ends) >= max(min_length, 1e-9)]
    if len(ends) == 0:
        return RegionFaces(ends, np.zeros((0, 2)), np.zeros(0))
    normals = -segments.left_normals(ends)
    return RegionFaces(ends, normals, _thickness(solid, ends, normals))


def _thickness(solid: BaseGeometry, ends: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Median length (n,) of the wall behind three points of each face, straight through."""
    reach = float(np.ptp(ends.reshape(-1, 2), axis=0).max())
    lengths = []
    for share in (0.25, 0.5, 0.75):
        at = (1 - share) * ends[:, 0] + share * ends[:, 1]
        skin = 1e-6 * reach
        through = shapely.linestrings(np.stack([at - skin * normals, at - reach * normals], axis=1))
        pieces, face = shapely.get_parts(shapely.intersection(through, solid), return_index=True)
        # The piece that begins at the face; others belong to walls beyond the room behind.
        begins = shapely.distance(pieces, shapely.points(at[face])) < 10 * skin
        length = (shapely.length(pieces) + skin) * begins
        lengths.append(np.bincount(face, length, minlength=len(ends)))
    return np.median(np.array(lengths), axis=0)

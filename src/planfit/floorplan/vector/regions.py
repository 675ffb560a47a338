"""Solid wall seen from above: cut from triangles of a building model, and its faces.

What readers of pictures, drawings and models share.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from jaxtyping import Float, Int, Shaped
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import LineWorkTooDense, check_crossings, in_blocks, line_strings
from planfit.floorplan.vector.line_work import WallFaces, edges_of_areas, outlines
from planfit.geometry import segments
from planfit.priors import COORDINATE_MOST_M

_SHORT_SHARE = 0.02
"""Of the extent of a plan: further than walls are thick."""
_MANY_CORNERS = 200
"""Of a wall that hangs together: with more, pieces of it are cut for each face, not the whole."""
TOLERANCE_M = 0.005
"""How far corners of faces may be off, of files in metres."""
MIN_FACE_M = 0.02
"""What is shorter is no face there."""
MAX_COORDINATE = COORDINATE_MOST_M.value
MAX_SELF_CROSSINGS = 4000
"""Of the outlines of all areas of a file; those of real drawings cross themselves a few times."""


class SelfCrossings:
    """Makes areas of a file valid, whose outlines may cross themselves, as long as they do so less often than
    any plan's: shapely takes 1 s for 1,000 crossings of one outline, and 9 s for 4,000."""

    def __init__(self) -> None:
        self._n = 0

    def valid(self, area: BaseGeometry) -> BaseGeometry:
        """The area as a valid one: what is inside an odd number of times.

        Raises:
            LineWorkTooDense: areas cross themselves too often, this one or all up to it.
        """
        if shapely.is_valid(area):
            return area
        ends = outlines([area])
        lines = line_strings(ends)
        for line, other in in_blocks(lines, shapely.STRtree(lines)):
            # Each pair once, and none of a line and the next.
            self._n += int((other > line + 1).sum())
            if self._n > MAX_SELF_CROSSINGS:
                found = f"around areas that cross themselves over {MAX_SELF_CROSSINGS} times"
                raise LineWorkTooDense(len(ends), found)
        return shapely.make_valid(area)


def without_seams(
    pieces: Sequence[BaseGeometry] | Shaped[np.ndarray, " n"], seam: float
) -> BaseGeometry:
    """One area of pieces that meet up to twice a seam, as those of one wall do up to rounding."""
    grown = shapely.union_all(
        shapely.buffer(np.array(pieces, dtype=object), seam, join_style="mitre")
    )
    return shapely.buffer(grown, -seam, join_style="mitre")


def faces_of_regions(walls: BaseGeometry, tolerance: float, min_length: float) -> WallFaces:
    """Straight faces around solid wall.

    Args:
        walls: polygons of solid wall, x-y seen from above; where they overlap they are one wall.
        tolerance: corners nearer than this to the line between their neighbours are straightened
            (Douglas and Peucker 1973).
        min_length: shorter faces are left out: ends of thin walls and jambs of openings, which carry no
            wall that a scan could be held to.

    Raises:
        ValueError: coordinates are beyond what any building has in any unit; polygons so far apart in
            size keep GEOS busy for ever.
        LineWorkTooDense: outlines cross more often than in any plan.
    """
    bounds = shapely.bounds(walls)
    if not walls.is_empty and not np.abs(bounds).max() < MAX_COORDINATE:
        raise ValueError(f"coordinates of up to {np.abs(bounds).max():.3g}")
    parts = shapely.get_parts(walls)
    check_crossings(outlines([walls]))
    solid = shapely.simplify(shapely.union_all(parts), tolerance)
    ends = edges_of_areas([solid])
    ends = ends[segments.lengths(ends) >= max(min_length, 1e-9)]
    if len(ends) == 0:
        return WallFaces.of_parts([])
    normals = -segments.left_normals(ends)
    return WallFaces.oriented(ends, normals, _thickness(solid, ends, normals))


def _thickness(
    solid: BaseGeometry, ends: Float[np.ndarray, "n 2 2"], normals: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, " n"]:
    """Median length of the wall behind three points of each face, straight through."""
    reach = float(np.ptp(ends.reshape(-1, 2), axis=0).max())
    middle = ends.mean(axis=1) - 1e-6 * reach * normals
    parts = shapely.get_parts(solid)
    # Only its own part can be behind a face: a plan of many parts is not cut as a whole each time.
    part_of = shapely.STRtree(parts).nearest(shapely.points(middle))
    own = parts[part_of]
    skin = 1e-6 * reach
    lengths = []
    for share in (0.25, 0.5, 0.75):
        at = (1 - share) * ends[:, 0] + share * ends[:, 1]
        # Most walls are thin, and GEOS looks at that of a part which the box around the cut meets: the whole
        # way through the plan is for those that are not done sooner.
        short = _SHORT_SHARE * reach
        length = _length_behind(at, normals, _clipped(parts, part_of, at, short), skin, short)
        rest = np.flatnonzero(length > 0.99 * short)
        length[rest] = _length_behind(at[rest], normals[rest], own[rest], skin, reach)
        lengths.append(length)
    return np.median(np.array(lengths), axis=0)


def _clipped(
    parts: Shaped[np.ndarray, " p"],
    part_of: Int[np.ndarray, " n"],
    at: Float[np.ndarray, "n 2"],
    reach: float,
) -> Shaped[np.ndarray, " n"]:
    """For each point what of its part is within reach, and more: a wall of thousands of corners, which hangs
    together, is not cut as a whole for each of its faces."""
    own = parts[part_of]
    cell = 4.0 * reach
    cells = np.floor(at / cell).astype(int)
    large = np.flatnonzero((shapely.get_num_coordinates(parts) > _MANY_CORNERS)[part_of])
    keys = np.column_stack([part_of[large], cells[large]])
    places, place_of = np.unique(keys, axis=0, return_inverse=True)
    for k, (part, u, v) in enumerate(places):
        low, high = (np.array([u, v]) - 0.3) * cell, (np.array([u, v]) + 1.3) * cell
        piece = shapely.clip_by_rect(parts[part], *low, *high)
        if shapely.is_valid(piece):  # clipping leaves some that only touch themselves
            own[large[place_of.ravel() == k]] = piece
    return own


def _length_behind(
    at: Float[np.ndarray, "n 2"],
    normals: Float[np.ndarray, "n 2"],
    own: Shaped[np.ndarray, " n"],
    skin: float,
    reach: float,
) -> Float[np.ndarray, " n"]:
    """Length of the wall behind points of faces, `reach` at most; each point's part of the wall is `own`."""
    through = shapely.linestrings(np.stack([at - skin * normals, at - reach * normals], axis=1))
    parts, face = shapely.get_parts(shapely.intersection(through, own), return_index=True)
    # The part that begins at the face; others belong to walls beyond the room behind.
    begins = shapely.distance(parts, shapely.points(at[face])) < 10 * skin
    lengths = (shapely.length(parts) + skin) * begins
    # Of none, bincount counts in integers.
    return np.bincount(face, lengths, minlength=len(at)).astype(float)


def section_segments(
    corners: Float[np.ndarray, "k 3"], triangles: Int[np.ndarray, "m 3"], height: float
) -> Float[np.ndarray, "n 2 2"]:
    """Segments in x-y where a level plane meets triangles over corners.

    Corners at the very height count as above, so that each triangle gives one segment or none.
    """
    at = corners[triangles]
    above = at[..., 2] >= height
    is_cut = above.any(axis=1) & ~above.all(axis=1)
    at, above = at[is_cut], above[is_cut]
    # Corners rolled so that 0 is alone on its side: the cut meets the two edges from it.
    alone = np.where(above.sum(axis=1) == 1, np.argmax(above, axis=1), np.argmin(above, axis=1))
    order = (alone[:, None] + np.arange(3)) % 3
    at = np.take_along_axis(at, order[..., None], axis=1)
    ends = []
    for other in (1, 2):
        rise = at[:, other, 2] - at[:, 0, 2]
        t = ((height - at[:, 0, 2]) / rise)[:, None]
        ends.append(at[:, 0, :2] * (1 - t) + at[:, other, :2] * t)
    return np.stack(ends, axis=1)


def section_area(
    corners: Float[np.ndarray, "k 3"], triangles: Int[np.ndarray, "m 3"], height: float
) -> BaseGeometry:
    """Area of the solid inside a closed surface at a height; empty where the surface is open there.

    Rings within rings are holes, as in a hollow pillar.
    """
    # Triangles that share an edge compute its point alike up to rounding.
    segments = np.round(section_segments(corners, triangles, height), 6)
    segments = segments[np.abs(segments[:, 0] - segments[:, 1]).max(axis=1) > 0]
    if len(segments) == 0:
        return shapely.Polygon()
    return shapely.build_area(shapely.node(shapely.MultiLineString(list(segments))))

"""Whether faces look like those of a floorplan: rooms that one can enter, walls along few directions."""

from collections.abc import Sequence

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import Ends
from planfit.floorplan.plans_on_sheet import MOST_STOREYS
from planfit.floorplan.vector.arcs import nearest_circle
from planfit.geometry import segments

COMPARE = "compare the overlay (-o FILE.png) with the drawing"
CLOSED, LARGEST = 0.5, 0.6
"""Of the ground within the walls, what rings of wall without a gap close in: 0.55 to 0.98 of sections and
elevations; 0.38 at most of plans, one room (0.21 of a round house). And of that, the largest room."""
LEAST_ALIGNED = 0.8
"""Of the length of faces, what runs along the two main pairs of directions: plans with slanted and round
walls have 0.90 and more (two real sites 0.97), a sketch by hand 0.72."""
_SAME_DEG = 1.5
_CURVE_FACES, _CURVE_PX, _CURVE_DEG = 6, 2.0, 45.0
"""So many faces in a row that turn to one side, by 45 degrees at most each, with corners this near to one
circle are a round wall: curves are traced to 1.6 px. The line of a shaking hand turns to both sides."""
_KINK_DEG, _KINKED, _LEAST_FACES = (1.0, 15.0), 0.25, 20
"""Of the faces, those that go on where they end by a turn of so few degrees: 0.43 to 0.80 of sketches by
hand, 0.12 at most of drawings, scanned ones too."""
_OPEN = 0.05
"""Of the ground within the walls, what is closed in: nothing of a chart of bars."""
_FEW_GROUPS = 3
"""More groups of walls than there are plans on most sheets, none of which has an opening, are houses of a
site plan."""


def closed_shares(walls: Sequence[BaseGeometry]) -> Float[np.ndarray, " k"]:
    """Areas enclosed by rings of wall, largest first, of the convex hull of all.

    `walls`: polygons, no two on one another.
    """
    holes = [shapely.Polygon(ring).area for wall in walls for ring in shapely.get_rings(wall)[1:]]
    hull = shapely.convex_hull(shapely.GeometryCollection(list(walls))).area
    return np.sort(np.array(holes, dtype=float))[::-1] / max(hull, 1e-9)


def are_closed_rooms(shares: Float[np.ndarray, " k"]) -> bool:
    """Whether several rooms without a way in are most of the ground: of a plan whose outer doors alone are
    closed, one is."""
    total = float(shares.sum())
    return total > CLOSED and float(shares[:1].sum()) < LARGEST * total


def closed_words(shares: Float[np.ndarray, " k"]) -> str:
    """A doubt about rooms without a way in."""
    share = min(float(shares.sum()), 1.0)  # rooms in one another count twice
    return (
        f"walls without a gap for a door close in {100 * share:.0f} % of the ground: is it a "
        f"section or an elevation, or are doors drawn closed? {COMPARE}"
    )


def sketch_words(ends: Ends) -> str:
    """A doubt where faces look like the lines of a sketch by hand, else empty.

    `ends`: faces, in units of which a drawing is some 1000 wide (px).
    """
    aligned, kinked = aligned_share(ends), kinked_share(ends)
    if aligned < LEAST_ALIGNED:
        what = f"only {100 * aligned:.0f} % of the length of walls runs along common directions"
    elif len(ends) >= _LEAST_FACES and kinked > _KINKED:
        what = f"{100 * kinked:.0f} % of the faces go on at an angle of a few degrees"
    else:
        return ""
    return f"{what}: faces of a sketch by hand are no more exact than its lines; {COMPARE}"


def kinked_share(ends: Ends) -> float:
    """Share of faces, px, where another one begins that turns a little, but for round walls."""
    after, goes_on, turn_deg = _next_faces(ends)
    is_kink = goes_on & (np.abs(turn_deg) > _KINK_DEG[0]) & (np.abs(turn_deg) < _KINK_DEG[1])
    return float((is_kink & ~are_round(ends)).sum()) / max(len(after), 1)


def _next_faces(
    ends: Ends,
) -> tuple[Int[np.ndarray, " n"], Bool[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Of each face the one that begins nearest to its end, whether that is there, and by how much it turns to
    the left, in degrees."""
    apart, after = (np.atleast_1d(found) for found in cKDTree(ends[:, 0]).query(ends[:, 1]))
    along = segments.directions(ends)
    turn = segments.turns(along, along[after])
    return after, (apart < _CURVE_PX) & (after != np.arange(len(ends))), np.rad2deg(turn)


def are_round(ends: Ends) -> Bool[np.ndarray, " n"]:
    """Which faces, px, are of round walls: rows of them along one circle."""
    n = len(ends)
    result = np.zeros(n, dtype=bool)
    if n < _CURVE_FACES:
        return result
    after, goes_on, turn = _next_faces(ends)
    goes_on &= np.abs(turn) < _CURVE_DEG
    for i in range(n):
        row = [i]
        while len(row) < _CURVE_FACES and goes_on[row[-1]] and turn[row[-1]] * turn[i] > 0:
            row.append(int(after[row[-1]]))
        points = ends[row].reshape(-1, 2)
        circle = nearest_circle(points) if len(row) == _CURVE_FACES else None
        if circle is not None and circle.apart(points) < _CURVE_PX:
            result[row] = True
    return result


def aligned_share(ends: Ends) -> float:
    """Share of the length of segments along the two most frequent directions and across them, or of round
    walls."""
    along = ends[:, 1] - ends[:, 0]
    angle = np.rad2deg(np.arctan2(along[:, 1], along[:, 0])) % 90.0
    length = segments.lengths(ends)
    left, total = length.copy(), float(length.sum())
    for _ in range(2):
        off = np.abs((angle[:, None] - np.arange(0.0, 90.0, 0.5)[None] + 45.0) % 90.0 - 45.0)
        reached = ((off < _SAME_DEG) * left[:, None]).sum(axis=0)
        left[off[:, int(np.argmax(reached))] < _SAME_DEG] = 0.0
    left[are_round(ends)] = 0.0
    return 1.0 - float(left.sum()) / max(total, 1e-9)


def find_doubts(
    ends: Ends,
    openings: Float[np.ndarray, "k 2 2"],
    walls: tuple[shapely.Polygon, ...],
    n_groups: int,
) -> tuple[str, ...]:
    """What speaks against a floorplan, a sentence each.

    Args:
        ends: faces.
        openings: doors and windows.
        walls: regions.
        n_groups: groups of walls that stand apart from each other on the sheet.
    """
    result = []
    has_openings = len(openings) > 0
    if n_groups > MOST_STOREYS or (n_groups > _FEW_GROUPS and not has_openings):
        result.append(
            f"{n_groups} groups of marks stand apart from each other, as windows of a facade or houses of a "
            f"site plan do: this is probably no floorplan; {COMPARE}"
        )
    shares = closed_shares(walls)
    closed = float(shares.sum())
    if are_closed_rooms(shares) or (closed > CLOSED and not has_openings):
        result.append(closed_words(shares))
    elif closed < _OPEN and not has_openings:
        result.append(
            "no wall has a gap for a door or window, and none closes in a room: this is probably no "
            f"floorplan; {COMPARE}"
        )
    sketch = sketch_words(ends)
    return (*result, sketch) if sketch else tuple(result)

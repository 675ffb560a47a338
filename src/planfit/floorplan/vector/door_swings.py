"""Swings of doors as they are drawn: an arc, with the leaf as a line, or leaf and swing as one area."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from jaxtyping import Float, Int
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.vector.arcs import ROUND, curve_runs, fit_circle
from planfit.floorplan.vector.drawing import Fill, Lines
from planfit.priors import BUILDING_LIKELY_SIZE_M, DOOR_LEAF_WIDTH_M

TOLERANCE = 0.12
"""Of a leaf's length: leaves are up to 6 cm thick, and arcs are drawn to either edge."""
RADIUS_THICKNESSES = (2.5, 25.0)
"""Of leaves where the unit is unknown, in thicknesses of the usual wall."""
LIKE_ARC = 2.5
"""A leaf is as long as the radius of its arc, up to this factor where the arc is short and rough."""
SWEEP_DEG, HALF_DEG = (65.0, 115.0), (160.0, 200.0)
"""Of the leaf: one way, and both ways."""

SECTOR_DEG = (55.0, 125.0)
"""Of leaf and swing as one area: doors are drawn open by 60 to 120 degrees."""


@dataclass(frozen=True)
class DoorSwing:
    """The arc of a leaf, in the drawing's unit."""

    leaves: Float[np.ndarray, "2 2 2"]
    """Where the closed leaf may lie. Of an arc from its centre to either end; of a half circle from its
    centre to its middle (a leaf that swings both ways), or from end to end (the arc of two leaves)."""
    radius: float
    has_leaf: tuple[bool, bool]
    """Whether a line is drawn along each: the leaf, open."""
    leaf_lines: Int[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0, dtype=int))
    """Lines of the drawing, by index, that are drawn along either."""
    is_ajar: bool = False
    """Whether only the drawn leaf, the first of `leaves`, tells that the arc is a door's: it is neither about
    a quarter nor half of a circle."""
    is_area: bool = False
    """Whether leaf and swing are one filled area."""

    @property
    def is_one_leaf(self) -> bool:
        """Whether it is known which of `leaves` is the open one."""
        return self.has_leaf[0] != self.has_leaf[1]


def door_radii(
    metres_per_unit: float | None, usual_thickness: float | None, extent: float
) -> tuple[float, float]:
    """Least and greatest width of a leaf, in the drawing's unit.

    Args:
        metres_per_unit: None where it is unknown.
        usual_thickness: of its walls, which tells where the unit is unknown; None where it is unknown too.
        extent: of the drawing, which is a building of likely size where nothing else is known.
    """
    if metres_per_unit is not None:
        return DOOR_LEAF_WIDTH_M.low / metres_per_unit, DOOR_LEAF_WIDTH_M.high / metres_per_unit
    if usual_thickness is not None:
        return RADIUS_THICKNESSES[0] * usual_thickness, RADIUS_THICKNESSES[1] * usual_thickness
    size = BUILDING_LIKELY_SIZE_M
    return DOOR_LEAF_WIDTH_M.low / size.high * extent, DOOR_LEAF_WIDTH_M.high / size.low * extent


def find_door_swings(lines: Lines, radii: tuple[float, float]) -> list[DoorSwing]:
    """Arcs of about a quarter or half circle, or of any angle at whose end a leaf is drawn, as long as doors
    are.

    `lines`: of the drawing, in the order of the file; `radii`: least and greatest, see `door_radii`.
    """
    at, run = curve_runs(lines)
    if len(at) == 0:
        return []
    straight = np.flatnonzero(~lines.is_curved)
    # First ends, then second ends: a site's contours are thousands of curves, and of straight pieces.
    tips = cKDTree(np.concatenate([lines.ends[straight, 0], lines.ends[straight, 1]]))
    found = []
    for own in np.split(at, np.flatnonzero(np.diff(run)) + 1):
        ends = lines.ends[own]
        points = np.concatenate([ends[:, 0], ends[-1:, 1]])
        swing = _swing_of(points, tips, straight, radii) or _ajar(points, tips, straight, radii)
        if swing is not None:
            found.append(swing)
    return found


def _swing_of(
    points: Float[np.ndarray, "n 2"],
    tips: cKDTree,
    straight: Int[np.ndarray, " s"],
    radii: tuple[float, float],
) -> DoorSwing | None:
    """The circle through points, where they are a quarter or half of one with a radius between two; leaves
    are among the straight lines, of which `tips` are all first ends and then all second ones."""
    if len(points) < 4:
        return None
    circle = fit_circle(points)
    if circle is None or not radii[0] < circle.radius < radii[1]:
        return None
    ends = points[[0, -1]]
    spokes = (ends - circle.centre) / circle.radius
    apart = np.rad2deg(np.arccos(np.clip(spokes[0] @ spokes[1], -1.0, 1.0)))
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    sweep = np.rad2deg(steps.sum() / circle.radius)  # of rough polylines less exact than the ends
    if SWEEP_DEG[0] < apart < SWEEP_DEG[1] and sweep < HALF_DEG[0]:
        leaves = np.stack([np.stack([circle.centre, end]) for end in ends])
    elif apart > HALF_DEG[0] and HALF_DEG[0] < sweep < HALF_DEG[1]:
        along = np.array([ends[0, 1] - ends[1, 1], ends[1, 0] - ends[0, 0]])
        across = along * (circle.radius / np.linalg.norm(along))
        is_ahead = (points[len(points) // 2] - circle.centre) @ across > 0
        middle = circle.centre + (across if is_ahead else -across)
        leaves = np.stack([np.stack([circle.centre, middle]), ends])
    else:
        return None
    one, other = (straight[_lines_along(leaf, tips, TOLERANCE * circle.radius)] for leaf in leaves)
    if len(one) and len(other):
        # The side of a narrow room beside the doorway, or the leaf.
        exact = [straight[_lines_along(leaf, tips, ROUND * circle.radius)] for leaf in leaves]
        if (len(exact[0]) > 0) != (len(exact[1]) > 0):
            one, other = exact
    has_leaf = (len(one) > 0, len(other) > 0)
    return DoorSwing(leaves, circle.radius, has_leaf, np.concatenate([one, other]))


def _ajar(
    points: Float[np.ndarray, "n 2"],
    tips: cKDTree,
    straight: Int[np.ndarray, " s"],
    radii: tuple[float, float],
) -> DoorSwing | None:
    """A leaf open at any angle, from whose hinge all points of an arc are as far away as its own tip, which
    is at one end of the arc. The arc itself may be rough, and its centre beside the hinge."""
    chord = float(np.linalg.norm(points[-1] - points[0]))
    if chord == 0.0:
        return None
    # Seen from the far end of the wall beside the door, too, all of a short arc is about as far away.
    circle = fit_circle(points)
    widest = radii[1] if circle is None else min(radii[1], LIKE_ARC * circle.radius)
    found: list[tuple[float, DoorSwing]] = []
    for tip, latch in (points[[0, -1]], points[[-1, 0]]):
        at = np.array(tips.query_ball_point(tip, 0.5 * chord), dtype=int)
        hinges = tips.data[(at + tips.n // 2) % tips.n]
        width = np.linalg.norm(tips.data[at] - hinges, axis=1)
        apart = np.linalg.norm(points[None] - hinges[:, None], axis=2)
        off = np.linalg.norm(tips.data[at] - tip, axis=1)
        uneven = np.abs(apart - width[:, None]).max(axis=1)
        is_leaf = (width > radii[0]) & (width < widest)
        is_leaf &= (off < 2.0 * TOLERANCE * width) & (uneven < TOLERANCE * width)
        is_leaf &= chord > TOLERANCE * width  # else the leaf is on its wall
        if is_leaf.any():
            best = int(np.argmin(np.where(is_leaf, off, np.inf)))
            hinge = hinges[best]
            leaves = np.stack([np.stack([hinge, tips.data[at[best]]]), np.stack([hinge, latch])])
            drawn = straight[at[is_leaf] % len(straight)]
            swing = DoorSwing(leaves, float(width[best]), (True, False), drawn, is_ajar=True)
            found.append((float(uneven[best] / width[best]), swing))
    return min(found, key=lambda each: each[0])[1] if found else None


def _lines_along(
    leaf: Float[np.ndarray, "2 2"], tips: cKDTree, near: float
) -> Int[np.ndarray, " k"]:
    """Lines that go from one end of a leaf to the other, either way, by their place among `tips`."""
    at = np.array(tips.query_ball_point(leaf[0], near), dtype=int)
    other = (at + tips.n // 2) % tips.n
    return at[np.linalg.norm(tips.data[other] - leaf[1], axis=1) < near] % (tips.n // 2)


def sector_swing(area: BaseGeometry, radii: tuple[float, float]) -> DoorSwing | None:
    """The swing that an area is, from the hinge along leaf, arc and doorway; None of other areas."""
    if area.geom_type != "Polygon" or shapely.get_num_interior_rings(area):
        return None
    ring = shapely.get_coordinates(shapely.get_exterior_ring(area))[:-1]
    n = len(ring)
    if n < 5:
        return None
    before, after = np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0)
    sides = np.linalg.norm(np.stack([before, after]) - ring, axis=2)
    # The hinge: its sides are the longest.
    k = int(np.argmax(sides.min(axis=0)))
    radius = float(sides[:, k].mean())
    apart = np.linalg.norm(np.delete(ring, k, axis=0) - ring[k], axis=1)
    if not radii[0] < radius < radii[1] or np.abs(apart - radius).max() > ROUND * radius:
        return None
    sweep_deg = np.rad2deg(2.0 * area.area / radius**2)
    if not SECTOR_DEG[0] < sweep_deg < SECTOR_DEG[1]:
        return None
    leaves = np.stack([np.stack([ring[k], before[k]]), np.stack([ring[k], after[k]])])
    return DoorSwing(leaves, radius, (True, True), is_area=True)


def without_sectors(
    fills: Sequence[Fill], radii: tuple[float, float]
) -> tuple[tuple[Fill, ...], list[DoorSwing]]:
    """Fills without those that are doors, leaf and swing as one area, and without leaves beside such; and the
    swings."""
    told = [sector_swing(fill.polygon, radii) for fill in fills]
    rest = [fill for fill, swing in zip(fills, told, strict=True) if swing is None]
    is_leaf, swings = np.zeros(len(rest), dtype=bool), []
    for swing in told:
        if swing is None:
            continue
        along = np.array([[_is_along(fill, swing, k) for k in (0, 1)] for fill in rest])
        along = along.reshape(-1, 2)
        is_leaf |= along.any(axis=1)
        one, other = bool(along[:, 0].any()), bool(along[:, 1].any())
        swings.append(replace(swing, has_leaf=(one, other)) if one != other else swing)
    return tuple(fill for fill, leaf in zip(rest, is_leaf, strict=True) if not leaf), swings


def _is_along(fill: Fill, swing: DoorSwing, side: int) -> bool:
    """Whether an area is slim and lies along one of the two sides of a sector, all of it."""
    leaf, near = swing.leaves[side], TOLERANCE * swing.radius
    along = shapely.get_coordinates(fill.polygon) @ (leaf[1] - leaf[0]) / swing.radius
    if len(along) == 0 or np.ptp(along) < (1.0 - TOLERANCE) * swing.radius:
        return False
    return bool(shapely.buffer(shapely.LineString(leaf), near).covers(fill.polygon))

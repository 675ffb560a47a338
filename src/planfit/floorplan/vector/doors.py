"""Doors drawn as a quarter or half circle in a wall whose lines run on: outlines of rooms, thresholds."""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from jaxtyping import Float
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.vector.arcs import fit_circle
from planfit.floorplan.vector.double_lines import LineFaces
from planfit.floorplan.vector.drawing import Lines
from planfit.floorplan.vector.openings import TOLERANCE, curve_runs
from planfit.geometry import segments
from planfit.priors import DOOR_LEAF_WIDTH_M

RADIUS_M = DOOR_LEAF_WIDTH_M.both
RADIUS_THICKNESSES = (2.5, 25.0)
"""Of leaves where the unit is unknown, in thicknesses of the usual wall."""
SWEEP_DEG, HALF_DEG = (65.0, 115.0), (160.0, 200.0)
"""Of the leaf: one way, and both ways."""
BESIDE = 0.15
"""A closed leaf lies in its wall, or beside a face by this share of its length: arcs begin at either edge."""
IN_WALL_SHARE = 0.6
MARGIN = 0.04
"""Of a leaf's length, at both ends of its opening: frames."""


@dataclass(frozen=True)
class DoorSwing:
    """The arc of a leaf, in the drawing's unit."""

    leaves: Float[np.ndarray, "2 2 2"]
    """Where the closed leaf may lie. Of a quarter circle from its centre to either end; of a half circle from
    its centre to its middle (a leaf that swings both ways), or from end to end (the arc of two leaves)."""
    radius: float
    has_leaf: tuple[bool, bool]
    """Whether a line is drawn along each: the leaf, open."""


@dataclass(frozen=True)
class OpenedDoors:
    """Faces without those that ran through doors."""

    faces: LineFaces
    openings: Float[np.ndarray, "k 2 2"]
    """What was cut from them."""
    n_doors: int


def find_door_swings(
    lines: Lines, metres_per_unit: float | None, usual_thickness: float
) -> list[DoorSwing]:
    """Arcs of about a quarter or half circle as long as doors are.

    Args:
        lines: of the drawing, in the order of the file.
        metres_per_unit: None where it is unknown.
        usual_thickness: of its walls, in its unit; it tells how long doors may be where the unit is unknown.
    """
    least, most = np.array(RADIUS_THICKNESSES) * usual_thickness
    if metres_per_unit is not None:
        least, most = np.array(RADIUS_M) / metres_per_unit
    at, run = curve_runs(lines)
    straight = lines.ends[~lines.is_curved]
    # First ends, then second ends: a site's contours are thousands of curves, and of straight pieces.
    tips = cKDTree(np.concatenate([straight[:, 0], straight[:, 1]]))
    starts = np.flatnonzero(np.diff(run, prepend=-1))
    found = []
    for start, stop in zip(starts, np.append(starts[1:], len(run)), strict=True):
        ends = lines.ends[at[start:stop]]
        points = np.concatenate([ends[:, 0], ends[-1:, 1]])
        swing = _swing_of(points, tips, (float(least), float(most)))
        if swing is not None:
            found.append(swing)
    return found


def _swing_of(
    points: Float[np.ndarray, "n 2"], tips: cKDTree, radii: tuple[float, float]
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
    near = TOLERANCE * circle.radius
    has_leaf = [_is_drawn(leaf, tips, near) for leaf in leaves]
    return DoorSwing(leaves, circle.radius, (has_leaf[0], has_leaf[1]))


def _is_drawn(leaf: Float[np.ndarray, "2 2"], tips: cKDTree, near: float) -> bool:
    """Whether a line goes from one end of a leaf to the other, either way."""
    at = np.array(tips.query_ball_point(leaf[0], near), dtype=int)
    other = (at + tips.n // 2) % tips.n
    return bool((np.linalg.norm(tips.data[other] - leaf[1], axis=1) < near).any())


def open_doors(
    faces: LineFaces, swings: list[DoorSwing], body: BaseGeometry, most: float
) -> OpenedDoors:
    """Cut faces where a closed leaf lies in their wall.

    Args:
        faces: found among the lines of the drawing.
        swings: of its doors.
        body: walls behind the faces.
        most: how thick walls may be.
    """
    shapely.prepare(body)
    cuts: dict[int, list[tuple[float, float]]] = {}
    n_doors = 0
    length, along = segments.lengths(faces.ends), segments.directions(faces.ends)
    left = segments.left_normals(faces.ends)
    for swing in swings:
        leaf = _closed_leaf(swing, body)
        if leaf is None:
            continue
        across = np.einsum("nij,nj->ni", leaf[None] - faces.ends[:, :1], left)
        at = np.sort(np.einsum("nij,nj->ni", leaf[None] - faces.ends[:, :1], along), axis=1)
        is_parallel = np.abs(across[:, 1] - across[:, 0]) < 0.1 * swing.radius
        depth = np.where(np.isfinite(faces.thickness), faces.thickness, 0.0)
        reach = np.minimum(depth, most) + BESIDE * swing.radius
        margin = MARGIN * swing.radius
        low, high = at[:, 0] + margin, at[:, 1] - margin
        overlap = np.minimum(high, length) - np.maximum(low, 0.0)
        is_cut = is_parallel & (np.abs(across).max(axis=1) < reach) & (overlap > 0.3 * swing.radius)
        if is_cut.any():
            n_doors += 1
        for i in np.flatnonzero(is_cut):
            cuts.setdefault(int(i), []).append((float(low[i]), float(high[i])))
    if not cuts:
        return OpenedDoors(faces, np.zeros((0, 2, 2)), 0)
    return cut_faces(faces, cuts, n_doors)


def _closed_leaf(swing: DoorSwing, body: BaseGeometry) -> Float[np.ndarray, "2 2"] | None:
    """The leaf that lies in a wall; None where neither does. Where both do, by a corner, the one that is not
    drawn; None where that does not tell."""
    shares = np.linspace(0.2, 0.8, 9)[:, None]
    inside = [
        _share_in(body, (1 - shares) * leaf[0] + shares * leaf[1], 0.5 * BESIDE * swing.radius)
        for leaf in swing.leaves
    ]
    best = int(np.argmax(inside))
    if inside[best] < IN_WALL_SHARE:
        return None
    if inside[best] > inside[1 - best] + 0.3:
        return swing.leaves[best]
    if swing.has_leaf[0] == swing.has_leaf[1]:
        return None
    return swing.leaves[int(swing.has_leaf[0])]


def _share_in(body: BaseGeometry, points: Float[np.ndarray, "n 2"], near: float) -> float:
    return float(np.mean(shapely.dwithin(body, shapely.points(points), near)))


def cut_faces(
    faces: LineFaces, cuts: dict[int, list[tuple[float, float]]], n_doors: int
) -> OpenedDoors:
    """Faces without some parts of them.

    Args:
        faces: of walls.
        cuts: of each face, by index, begin and end of every part, from its first end.
        n_doors: how many doors these are.
    """
    whole = np.ones(len(faces.ends), dtype=bool)
    whole[list(cuts)] = False
    kept, openings, source = [], [], []
    for i, gaps in cuts.items():
        start, direction = faces.ends[i, 0], segments.directions(faces.ends[i][None])[0]
        length = float(segments.lengths(faces.ends[i][None])[0])
        least = 0.02 * length
        at = 0.0
        for low, high in [*sorted(gaps), (length, length)]:
            low, high = float(np.clip(low, 0, length)), float(np.clip(high, 0, length))
            if low - at > least:
                kept.append(start + np.outer([at, low], direction))
                source.append(i)
            if high > low:
                openings.append(start + np.outer([low, high], direction))
            at = max(at, high)
    parts = faces.take(np.array(source, dtype=int))
    parts = replace(parts, ends=np.array(kept).reshape(-1, 2, 2))
    both = LineFaces.together([faces.take(whole), parts])
    return OpenedDoors(both, np.array(openings).reshape(-1, 2, 2), n_doors)

"""Doors drawn with their swing in a wall whose lines run on: outlines of rooms, thresholds."""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.vector.door_swings import DoorSwing
from planfit.floorplan.vector.double_lines import LineFaces
from planfit.geometry import segments

BESIDE = 0.15
"""A closed leaf lies in its wall, or beside a face by this share of its length: arcs begin at either edge."""
IN_WALL_SHARE = 0.6
MARGIN = 0.04
"""Of a leaf's length, at both ends of its opening: frames."""


@dataclass(frozen=True)
class OpenedDoors:
    """Faces without those that ran through doors."""

    faces: LineFaces
    openings: Float[np.ndarray, "k 2 2"]
    """What was cut from them."""
    n_doors: int


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
    n_doors, doorways = 0, []
    length, along = segments.lengths(faces.ends), segments.directions(faces.ends)
    left = segments.left_normals(faces.ends)
    for swing in swings:
        gaps = _doorways(swing, body) if swing.is_one_leaf or swing.is_area else []
        leaf = None if gaps else _closed_leaf(swing, body)
        if leaf is None:
            doorways += gaps if swing.is_area else []
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
    opened = OpenedDoors(faces, np.zeros((0, 2, 2)), 0)
    if cuts:
        opened = cut_faces(faces, cuts, n_doors)
    openings = np.concatenate([opened.openings, np.reshape(doorways, (-1, 2, 2))])
    return replace(opened, openings=openings, n_doors=n_doors + len(doorways))


def _doorways(swing: DoorSwing, body: BaseGeometry) -> list[Float[np.ndarray, "2 2"]]:
    """The leaf that closes a gap of the walls, as the wall is open there already; none where neither does."""
    near = BESIDE * swing.radius
    return [
        leaf
        for leaf, is_drawn in zip(swing.leaves, swing.has_leaf, strict=True)
        if not (is_drawn and swing.is_one_leaf)
        and _share_in(body, leaf, near) == 1.0
        and _share_in(body, leaf[0] + np.outer([0.3, 0.5, 0.7], leaf[1] - leaf[0]), near) == 0.0
    ][:1]


def _closed_leaf(swing: DoorSwing, body: BaseGeometry) -> Float[np.ndarray, "2 2"] | None:
    """The leaf that lies in a wall; None where neither does. Where both do, by a corner, the one that is not
    drawn; None where that does not tell."""
    shares = np.linspace(0.2, 0.8, 9)[:, None]
    inside = [
        _share_in(body, (1 - shares) * leaf[0] + shares * leaf[1], 0.5 * BESIDE * swing.radius)
        for leaf in swing.leaves
    ]
    if swing.is_area and swing.is_one_leaf:
        inside[int(swing.has_leaf[1])] = 0.0
    best = int(np.argmax(inside))
    if inside[best] < IN_WALL_SHARE or (swing.is_ajar and best == 0):
        return None
    if inside[best] > inside[1 - best] + 0.3:
        return swing.leaves[best]
    return swing.leaves[int(swing.has_leaf[0])] if swing.is_one_leaf else None


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

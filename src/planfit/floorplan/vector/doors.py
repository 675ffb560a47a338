"""Doors drawn with their swing in a wall whose lines run on: outlines of rooms, thresholds.

Doors may be drawn as two jambs alone, in a wall whose lines run on, where other doors of the drawing show how
jambs are drawn and how far apart they are.
"""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import ends_that_meet, line_strings
from planfit.floorplan.vector.door_swings import DoorSwing
from planfit.floorplan.vector.line_work import WallFaces
from planfit.geometry import segments

BESIDE = 0.15
"""A closed leaf lies in its wall, or beside a face by this share of its length: arcs begin at either edge."""
IN_WALL_SHARE = 0.6
MARGIN = 0.04
"""Of a leaf's length, at both ends of its opening: frames."""
_LEAST_KNOWN, _WITH_JAMBS = 8, 0.5
"""Doors with swings that a drawing has, and the share of them with jambs at both ends: else lines across a
wall are ends of its pieces. Two floors of a university have .86 and .79."""
_ACROSS_SINE = 0.98
_THICK = (0.75, 1.3)
"""Length of a jamb, in thicknesses of its wall."""
_FRAME = 0.12
"""Of a door's width: lines so near to one another are of one jamb, as one so near to the end of an opening is
of that."""
_WIDTH = 0.2
"""Doors without swings are as wide as those with them, by so much of their median."""


@dataclass(frozen=True)
class OpenedDoors:
    """Faces without those that ran through doors."""

    faces: WallFaces
    openings: Float[np.ndarray, "k 2 2"]
    """What was cut from them."""
    n_doors: int


def open_doors(
    faces: WallFaces, swings: list[DoorSwing], body: BaseGeometry, most: float
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
    opened, openings = _cut_faces(faces, cuts)
    openings = np.concatenate([openings, np.reshape(doorways, (-1, 2, 2))])
    return OpenedDoors(opened, openings, n_doors + len(doorways))


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


def _cut_faces(
    faces: WallFaces, cuts: dict[int, list[tuple[float, float]]]
) -> tuple[WallFaces, Float[np.ndarray, "k 2 2"]]:
    """Faces without some parts of them, and these parts.

    `cuts`: of each face, by index, begin and end of every part, from its first end.
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
    both = WallFaces.of_parts([faces.take(whole), parts])
    return both, np.array(openings).reshape(-1, 2, 2)


def open_jambs(
    opened: OpenedDoors, lines: Float[np.ndarray, "n 2 2"], extent: float
) -> tuple[WallFaces, Float[np.ndarray, "k 2 2"]]:
    """Cut faces between pairs of jambs, as far apart as those of doors with swings, where most of these have
    jambs; and what was cut, which may be doors, windows or passages.

    `opened`: faces with the doors that have swings cut out; `lines`: straight ones of the drawing, in no
    rows.
    """
    faces, none = opened.faces, np.zeros((0, 2, 2))
    if opened.n_doors < _LEAST_KNOWN or len(lines) == 0:
        return faces, none
    width = float(np.median(segments.lengths(opened.openings)))
    jambs = _jambs(faces, lines, 4e-4 * extent)
    if _share_with_jambs(opened.openings, jambs, _FRAME * width) < _WITH_JAMBS:
        return faces, none
    ticks = shapely.STRtree(shapely.points(jambs.mean(axis=1)))
    cuts: dict[int, list[tuple[float, float]]] = {}
    strings, along = line_strings(faces.ends), segments.directions(faces.ends)
    for i in np.flatnonzero(np.isfinite(faces.thickness)):
        near = ticks.query(strings[i], "dwithin", distance=0.8 * faces.thickness[i])
        if len(near) < 2:
            continue
        is_across = np.abs(segments.directions(jambs[near]) @ along[i]) < 1.0 - _ACROSS_SINE
        length = segments.lengths(jambs[near]) / faces.thickness[i]
        fits = is_across & (length > _THICK[0]) & (length < _THICK[1])
        at = np.sort((jambs[near[fits]].mean(axis=1) - faces.ends[i, 0]) @ along[i])
        gaps = _doors_between(at, width)
        if gaps:
            cuts[int(i)] = gaps
    return _cut_faces(faces, _through_walls(faces, cuts, _FRAME * width))


def _through_walls(
    faces: WallFaces, cuts: dict[int, list[tuple[float, float]]], near: float
) -> dict[int, list[tuple[float, float]]]:
    """Cuts that the other face of the wall has too, at the same place."""
    of = np.array([i for i, gaps in cuts.items() for _ in gaps], dtype=int)
    if len(of) == 0:
        return {}
    gaps = np.array([gap for own in cuts.values() for gap in own])
    middles = faces.ends[of, 0] + gaps.mean(axis=1)[:, None] * segments.directions(faces.ends[of])
    behind = middles - faces.thickness[of, None] * faces.normals[of]
    places = np.asarray(shapely.points(middles), dtype=object)
    a, b = shapely.STRtree(places).query(shapely.points(behind), "dwithin", distance=near)
    is_other = np.einsum("pi,pi->p", faces.normals[of[a]], faces.normals[of[b]]) < -_ACROSS_SINE
    kept: dict[int, list[tuple[float, float]]] = {}
    for k in np.unique(a[is_other]):
        kept.setdefault(int(of[k]), []).append((float(gaps[k, 0]), float(gaps[k, 1])))
    return kept


def _jambs(
    faces: WallFaces, lines: Float[np.ndarray, "n 2 2"], tolerance: float
) -> Float[np.ndarray, "k 2 2"]:
    """Lines as long as walls are thick, both of whose ends lie on faces."""
    known = faces.thickness[np.isfinite(faces.thickness)]
    if len(known) == 0:
        return lines[:0]
    length = segments.lengths(lines)
    short = lines[(length > _THICK[0] * known.min()) & (length < _THICK[1] * known.max())]
    meets = ends_that_meet(short, np.full(len(short), -1), line_strings(faces.ends), tolerance)
    return short[meets.all(axis=1)]


def _share_with_jambs(
    openings: Float[np.ndarray, "k 2 2"], jambs: Float[np.ndarray, "j 2 2"], near: float
) -> float:
    """Of the openings, those with a jamb at both ends."""
    if len(jambs) == 0:
        return 0.0
    has = ends_that_meet(openings, np.full(len(openings), -1), line_strings(jambs), near)
    return float(has.all(axis=1).mean())


def _doors_between(at: Float[np.ndarray, " k"], width: float) -> list[tuple[float, float]]:
    """Pairs of jambs, by their places along a face, that are as far apart as doors are wide."""
    starts = np.flatnonzero(np.diff(at, prepend=-np.inf) > _FRAME * width)
    stops = np.append(starts[1:], len(at)) - 1
    gaps, k = [], 0
    while k + 1 < len(starts):
        low, high = float(at[stops[k]]), float(at[starts[k + 1]])
        is_door = abs(high - low - width) < _WIDTH * width
        if is_door:
            gaps.append((low, high))
        k += 2 if is_door else 1
    return gaps

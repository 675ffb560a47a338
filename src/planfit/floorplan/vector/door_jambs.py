"""Doors drawn as two jambs alone, in a wall whose lines run on, where other doors of the drawing show how
jambs are drawn and how far apart they are."""

import numpy as np
import shapely
from jaxtyping import Float

from planfit.floorplan.faces import line_strings
from planfit.floorplan.vector.doors import OpenedDoors, cut_faces
from planfit.floorplan.vector.double_lines import LineFaces
from planfit.geometry import segments

LEAST_KNOWN, WITH_JAMBS = 8, 0.5
"""Doors with swings that a drawing has, and the share of them with jambs at both ends: else lines across a
wall are ends of its pieces. Two floors of a university have .86 and .79."""
ACROSS_SINE = 0.98
THICK = (0.75, 1.3)
"""Length of a jamb, in thicknesses of its wall."""
FRAME = 0.12
"""Of a door's width: lines so near to one another are of one jamb, as one so near to the end of an opening is
of that."""
WIDTH = 0.2
"""Doors without swings are as wide as those with them, by so much of their median."""


def open_jambs(
    opened: OpenedDoors, lines: Float[np.ndarray, "n 2 2"], extent: float
) -> OpenedDoors:
    """Cut faces between pairs of jambs, as far apart as those of doors with swings, where most of these have
    jambs. What was cut may be doors, windows or passages.

    Args:
        opened: faces with the doors that have swings cut out.
        lines: straight ones of the drawing, in no rows.
        extent: of the drawing.
    """
    none = OpenedDoors(opened.faces, np.zeros((0, 2, 2)), 0)
    if opened.n_doors < LEAST_KNOWN or len(lines) == 0:
        return none
    width = float(np.median(segments.lengths(opened.openings)))
    jambs = _jambs(opened.faces, lines, 4e-4 * extent)
    if _share_with_jambs(opened.openings, jambs, FRAME * width) < WITH_JAMBS:
        return none
    faces = opened.faces
    ticks = shapely.STRtree(shapely.points(jambs.mean(axis=1)))
    cuts: dict[int, list[tuple[float, float]]] = {}
    strings, along = line_strings(faces.ends), segments.directions(faces.ends)
    for i in np.flatnonzero(np.isfinite(faces.thickness)):
        near = ticks.query(strings[i], "dwithin", distance=0.8 * faces.thickness[i])
        if len(near) < 2:
            continue
        is_across = np.abs(segments.directions(jambs[near]) @ along[i]) < 1.0 - ACROSS_SINE
        length = segments.lengths(jambs[near]) / faces.thickness[i]
        fits = is_across & (length > THICK[0]) & (length < THICK[1])
        at = np.sort((jambs[near[fits]].mean(axis=1) - faces.ends[i, 0]) @ along[i])
        gaps = _doors_between(at, width)
        if gaps:
            cuts[int(i)] = gaps
    cuts = _through_walls(faces, cuts, FRAME * width)
    return cut_faces(faces, cuts, 0) if cuts else none


def _through_walls(
    faces: LineFaces, cuts: dict[int, list[tuple[float, float]]], near: float
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
    is_other = np.einsum("pi,pi->p", faces.normals[of[a]], faces.normals[of[b]]) < -ACROSS_SINE
    kept: dict[int, list[tuple[float, float]]] = {}
    for k in np.unique(a[is_other]):
        kept.setdefault(int(of[k]), []).append((float(gaps[k, 0]), float(gaps[k, 1])))
    return kept


def _jambs(
    faces: LineFaces, lines: Float[np.ndarray, "n 2 2"], tolerance: float
) -> Float[np.ndarray, "k 2 2"]:
    """Lines as long as walls are thick, both of whose ends lie on faces."""
    known = faces.thickness[np.isfinite(faces.thickness)]
    if len(known) == 0:
        return lines[:0]
    length = segments.lengths(lines)
    short = lines[(length > THICK[0] * known.min()) & (length < THICK[1] * known.max())]
    tips = np.asarray(shapely.points(short.reshape(-1, 2)), dtype=object)
    tip, _ = shapely.STRtree(line_strings(faces.ends)).query(tips, "dwithin", distance=tolerance)
    meets = np.zeros(len(tips), dtype=bool)
    meets[tip] = True
    return short[meets.reshape(-1, 2).all(axis=1)]


def _share_with_jambs(
    openings: Float[np.ndarray, "k 2 2"], jambs: Float[np.ndarray, "j 2 2"], near: float
) -> float:
    """Of the openings, those with a jamb at both ends."""
    if len(jambs) == 0:
        return 0.0
    tips = np.asarray(shapely.points(openings.reshape(-1, 2)), dtype=object)
    tip, _ = shapely.STRtree(line_strings(jambs)).query(tips, "dwithin", distance=near)
    has = np.zeros(len(tips), dtype=bool)
    has[tip] = True
    return float(has.reshape(-1, 2).all(axis=1).mean())


def _doors_between(at: Float[np.ndarray, " k"], width: float) -> list[tuple[float, float]]:
    """Pairs of jambs, by their places along a face, that are as far apart as doors are wide."""
    starts = np.flatnonzero(np.diff(at, prepend=-np.inf) > FRAME * width)
    stops = np.append(starts[1:], len(at)) - 1
    gaps, k = [], 0
    while k + 1 < len(starts):
        low, high = float(at[stops[k]]), float(at[starts[k + 1]])
        is_door = abs(high - low - width) < WIDTH * width
        if is_door:
            gaps.append((low, high))
        k += 2 if is_door else 1
    return gaps

"""What filled and hatched areas mean: solid wall, or the floors of rooms with the walls left out between."""

from dataclasses import replace

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int, Shaped
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import Ends, connected_groups, in_blocks, line_strings, weighted_median
from planfit.floorplan.plausible import COMPARE
from planfit.floorplan.vector.drawing import LIGHT, Fill, is_dark
from planfit.floorplan.vector.layer_names import Role
from planfit.floorplan.vector.line_work import cut_out, path_rings
from planfit.floorplan.vector.regions import SelfCrossings
from planfit.floorplan.vector.sheet import LONGEST_TICK, WHOLE
from planfit.floorplan.vector.strokes import LEAST_SLIM, MOST_COVERED, slimness

ROOMS_COVER, ROOMS_REACH = 0.3, 0.1
"""Rooms cover this share of the ground that they enclose, and enclose this share of that of the whole
drawing: filled pieces of furniture do not, or are a kitchen. Floors of real drawings cover 0.6 to 0.9."""
ROOM_SIZED, MUCH_LEFT_OUT = 0.25, 0.1
"""Of the usual room's area, what may be a room; and of the area of all rooms, what is worth a word."""
ALL_ON, MORE_ON = 0.9, 2.0
"""The ground carries so much of the outline of all other areas, which is so many times as long as its own:
furniture of one room is not all that is filled, and columns of a hall have less outline than it."""
HIDDEN = 0.1
"""Of a floor, what shows where others are laid over it all: nothing of a plot under eleven rooms."""
OUTLINE_SAMPLES = 50
"""Places on an outline that are looked at, to see whether it is drawn."""


def sort_fills(
    fills: tuple[Fill, ...],
    roles: list[Role],
    extent: float,
    ends: Ends,
    is_paper_white: bool = True,
) -> tuple[list[BaseGeometry], list[BaseGeometry]]:
    """Walls and rooms among fills by what their colour and shape say; specks say nothing, nor do white ones
    on white paper.

    Fills of one layer and colour mean one thing. Walls are dark or grey (or on a layer of that name),
    slim, and cover little of the ground they enclose. Rooms are wide and cover most of it.

    `is_paper_white`: where white fills are paper.
    """
    groups: dict[object, list[BaseGeometry]] = {}
    for fill in fills:
        role = roles[fill.layer]
        is_blank = is_paper_white and _is_white(fill.colour)
        if role in (Role.NO_WALL, Role.OPENING) or (is_blank and role != Role.WALL):
            continue
        groups.setdefault((fill.layer, fill.colour), []).append(fill.polygon)
    walls: list[BaseGeometry] = []
    rooms: list[BaseGeometry] = []
    for key, polygons in groups.items():
        layer, colour = key  # type: ignore[misc]
        # As one area: a wall is often filled piece by piece, triangle by triangle.
        area = shapely.union_all([p.buffer(1e-6 * extent, join_style="mitre") for p in polygons])
        # Rooms of one colour that touch are one, unless white is what they all are on a tinted page, or each
        # has its own outline.
        are_apart = _is_white(colour) or _have_outlines(polygons, ends, extent)
        parts = shapely.get_parts(np.array(polygons) if are_apart else area)
        parts = parts[~_are_arrowheads(parts, extent)]
        sizes, forms = shapely.area(parts), np.array([slimness(part) for part in parts])
        parts = parts[sizes > (1e-3 * extent) ** 2]
        if len(parts) == 0:
            continue
        slim = weighted_median(forms, sizes)
        coverage = sizes.sum() / max(shapely.convex_hull(area).area, 1e-300)
        looks_like_wall = slim > LEAST_SLIM and coverage < MOST_COVERED
        # A group `walls` may hold rooms as pale rectangles, whose outlines are the walls.
        is_floor = not looks_like_wall and colour is not None and min(colour) >= LIGHT
        is_called_wall = roles[layer] == Role.WALL and not is_floor
        # Text drawn as outlines is dark and slim too, but small.
        reach = max(np.ptp(np.array(area.bounds).reshape(2, 2), axis=0))
        stands_out = is_dark(colour) or (_is_white(colour) and not is_paper_white)
        if is_called_wall or (looks_like_wall and stands_out and _is_large(parts, extent)):
            walls.extend(parts)
        elif reach > 0.02 * extent and not looks_like_wall:
            rooms.extend(parts)
        elif looks_like_wall and not is_dark(colour):
            rooms.extend(parts)  # corridors
    return walls, rooms


def _have_outlines(polygons: list[BaseGeometry], ends: Ends, extent: float) -> bool:
    """Whether lines are drawn all around most of some areas, as around rooms; not around the pieces that a
    program cuts one into."""
    return len(polygons) > 1 and bool(
        (drawn_shares(np.array(polygons), ends, extent) > WHOLE).mean() > WHOLE
    )


def without_surroundings(
    rooms: list[BaseGeometry], ends: Ends, extent: float
) -> list[BaseGeometry]:
    """Rooms but for areas along whose edge nothing is drawn, where most have an outline: streets, lawns and
    neighbours' houses.

    `rooms`: filled areas.
    """
    if not rooms:
        return rooms
    drawn, area = drawn_shares(np.array(rooms), ends, extent), shapely.area(np.array(rooms))
    if 2 * area[drawn > WHOLE].sum() < area.sum():
        return rooms
    return [room for room, share in zip(rooms, drawn, strict=True) if share > 1 - WHOLE]


def drawn_shares(
    shapes: Shaped[np.ndarray, " k"], ends: Ends, extent: float
) -> Float[np.ndarray, " k"]:
    """Share of the outline of each area, or of each line, along which lines are drawn."""
    if len(ends) == 0:
        return np.zeros(len(shapes))
    is_area = shapely.get_dimensions(shapes) == 2
    edges = np.where(is_area, shapely.boundary(shapes), shapes)
    rings, of = shapely.get_parts(edges, return_index=True)
    lengths = shapely.length(rings)
    shares = (np.arange(OUTLINE_SAMPLES) + 0.5) / OUTLINE_SAMPLES
    places = shapely.line_interpolate_point(rings[:, None], lengths[:, None] * shares).ravel()
    is_near = np.zeros(len(places), dtype=bool)
    lines = shapely.STRtree(line_strings(ends))
    for place, _ in in_blocks(places, lines, 4e-4 * extent):
        is_near[place] = True
    near = is_near.reshape(len(rings), -1).mean(axis=1)
    drawn, whole = (np.bincount(of, w) for w in (near * lengths, lengths))
    return drawn / np.maximum(whole, 1e-300)


def are_outlined(
    rooms: list[BaseGeometry], called_wall: Float[np.ndarray, "n 2 2"], extent: float
) -> bool:
    """Whether lines on layers that are called wall go along most of the edges of rooms: where each stands for
    a wall, they say where its doors are, and the floors between them no more."""
    areas = np.array(rooms)
    shares, lengths = drawn_shares(areas, called_wall, extent), shapely.length(areas)
    return bool(2 * (shares * lengths).sum() > lengths.sum())


def _is_large(parts: Shaped[np.ndarray, " n"], extent: float) -> bool:
    reach = np.ptp(shapely.bounds(parts).reshape(-1, 2, 2), axis=1).max()
    return bool(reach > 0.1 * extent)


def _is_white(colour: tuple[int, int, int] | None) -> bool:
    return colour is not None and min(colour) > 245


def _are_arrowheads(parts: Shaped[np.ndarray, " n"], extent: float) -> Bool[np.ndarray, " n"]:
    """Small triangles that touch no other area: marks of sections, of entrances, and of north."""
    rings = shapely.simplify(shapely.get_exterior_ring(parts), 1e-3 * extent)
    reach = np.ptp(shapely.bounds(parts).reshape(-1, 2, 2), axis=1).max(axis=1)
    return (shapely.get_num_coordinates(rings) == 4) & (reach < LONGEST_TICK * extent)


def without_paper(
    fills: tuple[Fill, ...], ends: Ends, extent: float
) -> tuple[tuple[Fill, ...], bool]:
    """Fills but for rectangles in which all else lies and along whose edge nothing is drawn, as a page in a
    pale colour is no room; and whether the paper is white."""
    if len(fills) < 2:
        return fills, True
    lines = shapely.MultiLineString(list(ends))
    polygons = np.array([fill.polygon for fill in fills], dtype=object)
    boxes, points = shapely.bounds(polygons), ends.reshape(-1, 2)
    low = np.concatenate([boxes[:, :2], points]).min(axis=0)
    high = np.concatenate([boxes[:, 2:], points]).max(axis=0)
    whole, tolerance = shapely.box(*low, *high), 1e-3 * extent
    is_all = np.abs(boxes - np.concatenate([low, high])).max(axis=1) < tolerance
    # White walls that lie on a dark page are cut out of it; a ring of walls is less than half of its box.
    filled = shapely.area([_without_holes(polygon) for polygon in polygons])
    is_all &= (filled > 0.99 * whole.area) & (shapely.area(polygons) > whole.area / 2)
    if not is_all.any() or shapely.dwithin(whole.exterior, lines, tolerance):
        return fills, True
    kept = tuple(fill for fill, is_paper in zip(fills, is_all, strict=True) if not is_paper)
    return kept, _is_white(fills[np.flatnonzero(is_all)[-1]].colour)


def uppermost(fills: tuple[Fill, ...]) -> tuple[Fill, ...]:
    """Fills, of floors without what tinted ones laid over their edge later hide of them, and without those of
    which next to nothing shows, whose colour white ones that lie on them take: they are no paper. What else
    lies within one may be furniture that stands on it."""
    polygons = np.array([fill.polygon for fill in fills], dtype=object)
    is_floor = np.array([not is_dark(fill.colour) for fill in fills], dtype=bool)
    upper = np.flatnonzero(is_floor & np.array([fill.is_opaque for fill in fills], dtype=bool))
    under, over = shapely.STRtree(polygons[upper]).query(polygons, predicate="intersects")
    over = upper[over]
    is_under = is_floor[under] & (under < over)
    order = np.argsort(under[is_under], kind="stable")
    floors, begin = np.unique(under[is_under][order], return_index=True)
    # Of no floors there is one part, empty.
    parts = np.split(over[is_under][order], begin[1:])
    over_of = dict(zip(floors.tolist(), parts, strict=False))
    rest_of, is_hidden = {}, np.zeros(len(fills), dtype=bool)
    # From the top down: what is hidden whole hides nothing more, so that of a pile few are joined.
    for k in reversed(over_of):
        on_it = over_of[k][~is_hidden[over_of[k]]]
        rest_of[k] = shapely.difference(polygons[k], shapely.union_all(polygons[on_it]))
        is_hidden[k] = rest_of[k].is_empty
    shown = list(fills)
    for k, on_it in over_of.items():
        rest = rest_of[k]
        if shapely.area(rest) > HIDDEN * shapely.area(polygons[k]):
            tinted = [i for i in on_it if not _is_white(fills[i].colour)]
            over_edge = polygons[tinted][~shapely.covers(polygons[k], polygons[tinted])]
            rest = shapely.difference(polygons[k], shapely.union_all(over_edge))
        else:
            rest = shapely.Polygon()
            for white in (i for i in on_it if _is_white(fills[i].colour)):
                shown[white] = replace(shown[white], colour=fills[k].colour)
        shown[k] = replace(shown[k], polygon=rest)
    return tuple(fill for fill in shown if not fill.polygon.is_empty)


def without_ground(
    rooms: list[BaseGeometry], walls: list[BaseGeometry], extent: float
) -> list[BaseGeometry]:
    """Rooms but for what lies under the whole plan: the grounds of a building, or its slab where walls are
    drawn on it. Its edge is that of a lawn, or before the wall's own.

    `rooms`: filled areas; `walls`: solid ones.
    """
    areas = np.array([*rooms, *walls], dtype=object)
    outline = shapely.length(areas)
    kept = []
    for k, room in enumerate(rooms):
        reach = shapely.buffer(room, 1e-3 * extent)
        shapely.prepare(reach)
        is_on = np.asarray(shapely.covers(reach, areas))
        is_on[k] = False
        on_it = float(outline[is_on].sum())
        others = float(outline.sum() - outline[k])
        if not (on_it > ALL_ON * others and on_it > MORE_ON * room.length):
            kept.append(room)
    return kept


def _without_holes(area: BaseGeometry) -> BaseGeometry:
    return shapely.union_all(shapely.polygons(shapely.get_exterior_ring(shapely.get_parts(area))))


def main_rooms(rooms: list[BaseGeometry], extent: float, drawn: BaseGeometry) -> list[BaseGeometry]:
    """Rooms of the largest group of near neighbours, each once, and of groups among them: the samples of a
    legend stand apart, or are small.

    None where there are fewer than three, or they cover little: one or two filled areas and furniture are no
    plan of rooms.

    `drawn`: convex hull of its lines and areas.
    """
    if len(rooms) < 3:
        return []
    rooms = _each_once(rooms)
    a, b = shapely.STRtree(rooms).query(rooms, predicate="dwithin", distance=0.03 * extent)
    group = connected_groups(a, b, len(rooms))
    areas, polygons = shapely.area(np.array(rooms)), np.array(rooms, dtype=object)
    size = np.bincount(group, areas)
    is_main = group == size.argmax()
    ground = shapely.convex_hull(shapely.GeometryCollection(list(polygons[is_main])))
    is_among = np.bincount(group, ~shapely.covers(ground, polygons)) == 0
    is_among &= size > ROOM_SIZED * np.median(areas[is_main])
    chosen = list(polygons[is_main | is_among[group]])
    enclosed = shapely.convex_hull(shapely.GeometryCollection(chosen)).area
    covered = shapely.union_all(chosen).area
    is_plan = covered > ROOMS_COVER * enclosed and enclosed > ROOMS_REACH * drawn.area
    return chosen if len(chosen) >= 3 and is_plan else []


def left_out_rooms(rooms: list[BaseGeometry], chosen: list[BaseGeometry]) -> str:
    """A sentence on areas as large as rooms that stand apart from the `chosen` ones, as another wing may;
    empty where there are none. Samples of a legend are smaller."""
    if not chosen:
        return ""
    areas, taken = shapely.area(np.array(rooms)), shapely.area(np.array(chosen))
    near = shapely.intersection(np.array(rooms), shapely.union_all(chosen))
    is_left = (areas >= ROOM_SIZED * np.median(taken)) & (shapely.area(near) < 0.5 * areas)
    share = areas[is_left].sum() / (areas[is_left].sum() + taken.sum())
    if share < MUCH_LEFT_OUT:
        return ""
    return (
        f"{int(is_left.sum())} filled areas as large as rooms stand apart from the {len(chosen)} that were "
        f"read as rooms, and were left out, {share:.0%} of both: {COMPARE}"
    )


def plot_words(chosen: list[BaseGeometry]) -> str:
    """A sentence where most of the ground of the `chosen` areas is one that holds several others, as the plot
    of a house does; empty where not."""
    if not chosen:
        return ""
    areas = np.array(chosen, dtype=object)
    size = shapely.area(areas)
    largest = areas[size.argmax()]
    n_held = int(shapely.covers(largest, areas).sum()) - 1
    if 2 * size.max() < shapely.union_all(areas).area or n_held < 2:
        return ""
    return (
        f"one filled area that holds {n_held} others is most of the ground: its edge was read as walls, and "
        f"lines inside it were not: is it the plot of the building? {COMPARE}"
    )


def _each_once(rooms: list[BaseGeometry]) -> list[BaseGeometry]:
    """Without those that lie half or more in a smaller one kept before: fill and hatch of one room."""
    tree = shapely.STRtree(rooms)
    area = shapely.area(np.array(rooms))
    is_kept = np.zeros(len(rooms), dtype=bool)
    for i in np.argsort(area, kind="stable"):
        others = [j for j in tree.query(rooms[i], "intersects") if is_kept[j]]
        shared = sum(rooms[i].intersection(rooms[j]).area for j in others)
        is_kept[i] = shared < 0.5 * area[i]
    return [room for room, keep in zip(rooms, is_kept, strict=True) if keep]


def hatched_areas(
    ends: Ends, path: Int[np.ndarray, " n"], is_hatch: Bool[np.ndarray, " n"], extent: float
) -> list[BaseGeometry]:
    """Areas whose outline is a closed path and whose inside is covered by hatch lines.

    Args:
        ends: all lines, in the order of the file.
        path: the path of each.
        is_hatch: lines in rows at equal distance.
        extent: of the drawing, to tell what counts as closed.
    """
    middles = shapely.points(ends[is_hatch].mean(axis=1))
    if len(middles) == 0:
        return []
    tree = shapely.STRtree(middles)
    hatches = ends[is_hatch]
    areas: list[BaseGeometry] = []
    crossings = SelfCrossings()
    for _, ring, gaps in path_rings(ends, path):
        if np.linalg.norm(gaps, axis=1).max() > 1e-4 * extent:
            continue
        area = crossings.valid(shapely.Polygon(ring))
        if area.area < (5e-3 * extent) ** 2:
            continue
        inside = tree.query(area, predicate="contains")
        if len(inside) >= 3 and _covers(hatches[inside], area):
            areas.append(area)
    return areas


def _covers(hatches: Ends, area: BaseGeometry) -> bool:
    """Whether lines, each as wide as they are apart, cover most of an area: a flight of stairs
    in a room does not."""
    along = hatches[:, 1] - hatches[:, 0]
    longest = along[np.argmax(np.linalg.norm(along, axis=1))]
    across = np.array([-longest[1], longest[0]]) / np.linalg.norm(longest)
    steps = np.diff(np.sort(hatches.mean(axis=1) @ across))
    # Lines in one row, and parts of one line, are no step.
    steps = steps[steps > 0.2 * steps.max()] if len(steps) else steps
    if len(steps) == 0:
        return False
    # Hatches of two strokes have two distances: the wider one counts.
    reach = 0.6 * float(np.percentile(np.asarray(steps, dtype=float), 75))
    bands = shapely.buffer(shapely.linestrings(hatches), reach, cap_style="square")
    return shapely.intersection(shapely.union_all(bands), area).area > 0.6 * area.area


def outside_rooms(
    ends: Ends, rooms: list[BaseGeometry], tolerance: float
) -> tuple[Float[np.ndarray, "m 2 2"], Int[np.ndarray, " m"]]:
    """The parts of lines that lie in no room nor along its edge, and the line that each
    is of: what is drawn inside a room is furniture, stairs and text."""
    area = shapely.buffer(shapely.union_all(rooms), tolerance)
    return cut_out(ends, area, 3 * tolerance)

"""Drawn floors of furnished rooms, all line work on one layer: walls of two thicknesses cut at doors and
windows, furniture along walls and in rooms. Shares no code with the readers."""

import itertools
from dataclasses import dataclass
from pathlib import Path

import ezdxf
import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

LEAST_ROOM_M = 2.6
"""Shorter side of a room, about."""


@dataclass(frozen=True)
class FurnishedFloor:
    """Metres, y up."""

    walls: BaseGeometry
    windows: list[BaseGeometry]
    lines: list[np.ndarray]
    """Open or closed paths (k, 2) of everything else: panes, furniture."""
    arcs: list[tuple[np.ndarray, float, float]]
    """Doors: hinge, radius, angle of the leaf in degrees; they open by 90 from there."""


def make_floor(seed: int) -> FurnishedFloor:
    """A rectangle of 9 to 16 m cut into rooms, or an L of two; outer walls of 0.2 to 0.5 m."""
    rng = np.random.default_rng(seed)
    outer, inner = rng.choice([0.2, 0.25, 0.3, 0.365, 0.49]), rng.choice([0.1, 0.115, 0.15, 0.175])
    size = rng.uniform([9.0, 8.0], [16.0, 12.0])
    outline = shapely.box(0.0, 0.0, *size)
    rooms = _split(rng, np.array([outer, outer, *(size - outer)]), inner)
    if rng.random() < 0.4:  # an L: one corner's room is outside
        corner = max(rooms, key=lambda r: r[2] + r[3])
        rooms.remove(corner)
        outline = outline.difference(
            shapely.box(corner[0] - inner + outer, corner[1] - inner + outer, 99, 99)
        )
    solid = outline.difference(shapely.union_all([shapely.box(*r) for r in rooms]))
    doors, arcs = _doors(rng, rooms, inner)
    windows, panes = _windows(rng, rooms, outline, outer, doors)
    walls = solid.difference(shapely.union_all([*doors, *windows]))
    lines = list(panes)
    blocked = [door.buffer(0.95) for door in doors]
    for room in rooms:
        lines += _furniture(rng, room, blocked)
    return FurnishedFloor(walls, windows, lines, arcs)


def _split(rng: np.random.Generator, room: np.ndarray, gap: float) -> list[tuple[float, ...]]:
    """Rooms x0, y0, x1, y1 with walls of `gap` between them."""
    sides = room[2:] - room[:2]
    axis = int(sides[1] > sides[0])
    if sides[axis] < 2 * LEAST_ROOM_M + gap or (sides.max() < 4.8 and rng.random() < 0.4):
        return [tuple(room.tolist())]
    at = room[axis] + rng.uniform(LEAST_ROOM_M, sides[axis] - LEAST_ROOM_M - gap)
    low, high = room.copy(), room.copy()
    low[axis + 2], high[axis] = at, at + gap
    return [*_split(rng, low, gap), *_split(rng, high, gap)]


def _doors(rng, rooms, gap) -> tuple[list[BaseGeometry], list[tuple[np.ndarray, float, float]]]:
    """One between rooms that share a wall long enough, with its swing."""
    doors, arcs = [], []
    for i, a in enumerate(rooms):
        for b in rooms[i + 1 :]:
            for axis in (0, 1):
                other = 1 - axis
                first, second = (a, b) if a[axis] < b[axis] else (b, a)
                if abs(second[axis] - first[axis + 2] - gap) > 1e-6:
                    continue
                low = max(a[other], b[other]) + 0.15
                high = min(a[other + 2], b[other + 2]) - 1.05
                if high < low:
                    continue
                at, wide = rng.uniform(low, high), rng.choice([0.76, 0.885])
                box = np.zeros(4)
                box[[axis, axis + 2]] = first[axis + 2], second[axis]
                box[[other, other + 2]] = at, at + wide
                doors.append(shapely.box(*box))
                hinge = np.zeros(2)
                hinge[axis], hinge[other] = second[axis], at
                arcs.append((hinge, float(wide), 0.0))
    return doors, arcs


def _windows(rng, rooms, outline, outer, doors):
    """Openings in outer walls, and their lines: sills at both faces and panes between."""
    windows, lines = [], []
    for room in rooms:
        for axis in (0, 1):
            for at, out in ((room[axis] - outer, -1), (room[axis + 2], 1)):
                other = 1 - axis
                length = room[other + 2] - room[other]
                box = np.zeros(4)
                box[[axis, axis + 2]] = at, at + outer
                wide = min(rng.uniform(0.9, 2.2), length - 0.8)
                start = room[other] + 0.4 + rng.random() * (length - 0.8 - wide)
                box[[other, other + 2]] = start, start + wide
                piece = shapely.box(*box)
                step = np.zeros(2)
                step[axis] = out * 0.05
                beyond = shapely.affinity.translate(piece, *step)
                if rng.random() < 0.25 or not outline.contains(piece.buffer(-1e-6)):
                    continue
                if beyond.difference(outline).area < 0.04 * wide:
                    continue  # an inner wall
                windows.append(piece)
                for share in (0.0, 0.4, 0.6, 1.0) if rng.random() < 0.5 else (0.0, 0.5, 1.0):
                    ends = np.zeros((2, 2))
                    ends[:, axis] = at + share * outer
                    ends[:, other] = start, start + wide
                    lines.append(ends)
    return windows, lines


def _box(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])


def _piece(rng: np.random.Generator) -> tuple[float, float, list[np.ndarray]]:
    """Width, gap to the wall and lines of a piece whose back is along y = 0."""
    kind = rng.integers(7)
    if kind == 0:  # a bed, its head at the wall
        w, d = rng.choice([0.9, 1.4, 1.6, 1.8]), 2.0
        pillow = [_box(0.1, 0.1, w / 2 - 0.05, 0.5), _box(w / 2 + 0.05, 0.1, w - 0.1, 0.5)]
        return w, 0.0, [_box(0, 0, w, d), *pillow, np.array([[0, 0.7], [w, 0.7]])]
    if kind == 1:  # a wardrobe
        w, d = rng.uniform(1.2, 2.6), rng.choice([0.55, 0.6])
        return w, rng.choice([0.0, 0.03]), [_box(0, 0, w, d), np.array([[0, 0], [w, d]])]
    if kind == 2:  # a sofa
        w, d = rng.uniform(1.6, 2.4), 0.9
        arms = [_box(0, 0, 0.18, d), _box(w - 0.18, 0, w, d), np.array([[0, 0.22], [w, 0.22]])]
        return w, rng.choice([0.0, 0.1]), [_box(0, 0, w, d), *arms]
    if kind == 3:  # a worktop with a hob
        w, d = rng.uniform(1.8, 3.2), 0.6
        return w, 0.0, [_box(0, 0, w, d), _box(0.6, 0.08, 1.2, 0.52)]
    if kind == 4:  # shelves
        w, d = rng.uniform(0.8, 2.0), rng.choice([0.3, 0.35, 0.4])
        return w, 0.0, [_box(0, 0, w, d)]
    if kind == 5:  # a desk with a chair
        return 1.4, 0.02, [_box(0, 0, 1.4, 0.75), _box(0.48, 0.8, 0.92, 1.25)]
    return 1.7, 0.0, [_box(0, 0, 1.7, 0.75), _box(0.08, 0.08, 1.62, 0.67)]  # a bath


def _furniture(
    rng: np.random.Generator, room: tuple[float, ...], blocked: list[BaseGeometry]
) -> list[np.ndarray]:
    """Pieces at the walls of a room that leave one another and its doors free, and a table in a large one."""
    x0, y0, x1, y1 = room
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    taken, lines = list(blocked), []
    for k in rng.permutation(4):
        a, b = corners[k], corners[(k + 1) % 4]
        along = (b - a) / np.linalg.norm(b - a)
        inward = np.array([-along[1], along[0]])
        w, gap, piece = _piece(rng)
        spare = float(np.linalg.norm(b - a)) - w
        if spare < 0.05 or rng.random() < 0.25:
            continue
        start = 0.0 if rng.random() < 0.4 else rng.uniform(0.0, spare)
        place = np.array([along, inward])
        moved = [a + gap * inward + (p + np.array([start, 0.0])) @ place for p in piece]
        space = shapely.MultiLineString(moved).envelope.buffer(0.05)
        if any(space.intersects(other) for other in taken):
            continue
        taken.append(space)
        lines += moved
    middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
    table = [_box(-0.8, -0.45, 0.8, 0.45) + middle]
    chairs = [_box(x, y, x + 0.44, y + 0.4) for x in (-0.6, 0.15) for y in (-0.9, 0.5)]
    if min(x1 - x0, y1 - y0) > 4.0:
        space = shapely.MultiLineString([*table, *(c + middle for c in chairs)]).envelope
        if not any(space.intersects(other) for other in taken):
            lines += [*table, *(c + middle for c in chairs)]
    return lines


def write_floor(path: Path, floor: FurnishedFloor) -> Path:
    """As DXF in metres, all on layer 0."""
    document = ezdxf.new()
    document.header["$INSUNITS"] = 6
    space = document.modelspace()
    for part in shapely.get_parts(floor.walls):
        for ring in (part.exterior, *part.interiors):
            space.add_lwpolyline(np.array(ring.coords))
    for line in floor.lines:
        space.add_lwpolyline(line)
    for hinge, radius, angle in floor.arcs:
        space.add_arc(tuple(hinge), radius, angle, angle + 90)
        turn = np.deg2rad(angle)
        tip = hinge + radius * np.array([np.cos(turn), np.sin(turn)])
        space.add_line(tuple(hinge), tuple(tip))
    document.saveas(path)
    return path


def shares(floor: FurnishedFloor, ends: np.ndarray, near_m: float = 0.03) -> tuple[float, float]:
    """Recall and precision of the length of walls' sides of 0.6 m and more (jambs are shorter); glass counts
    neither way."""
    sides = []
    for part in shapely.get_parts(floor.walls):
        for ring in (part.exterior, *part.interiors):
            corners = np.array(ring.simplify(1e-6).coords)
            sides += [np.array(s) for s in itertools.pairwise(corners)]
    long = [s for s in sides if np.linalg.norm(s[1] - s[0]) >= 0.6]
    true, found = shapely.MultiLineString(long), shapely.MultiLineString(list(ends))
    glass = shapely.union_all([w.buffer(near_m) for w in floor.windows])
    counted = found.difference(glass)
    recall = true.intersection(found.buffer(near_m)).length / true.length
    near = counted.intersection(floor.walls.boundary.buffer(near_m)).length
    return recall, near / counted.length

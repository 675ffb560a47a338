"""From the synthetic building, or a storey built after a plan, to rectangles with labels and materials, and
to lamps."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planfit.geometry import segments
from planfit.scan.types import Label
from planfit.synth.building import OUTSIDE, Building, Part, copied_rooms
from planfit.synth.furniture import Piece, add_hangings
from planfit.synth.lookalikes import Poster, turn_to
from planfit.synth.options import OUTER_WALL_M
from planfit.synth.plan_building import PlanBuilding
from planfit.synth.plan_walls import MAX_WALL_M, look_up
from planfit.synth.quads import (
    FLOORS,
    WALL_COLORS,
    WHITE,
    WOOD_COLORS,
    Box,
    Collector,
    Lights,
    Material,
    Quads,
    Z,
    add_box,
)

LAMP_SPACING_M = 3.5
_BEYOND_M = 5.0
"""Floor and ceiling reach so far out of the building: what is seen through its outer doors."""
_UNLIT = OUTSIDE
"""Light does not depend on the room: rooms of a plan have any shape, so that lamps would shine through
walls. Walls of different directions differ a little in brightness, so that corners show."""


def make_quads(building: Building, rng: np.random.Generator) -> Quads:
    """Every surface of the building, plan frame."""
    collector = Collector()
    _add_floors_and_ceilings(building, collector)
    _add_walls(building, collector)
    _add_doorways(building, collector)
    _add_wall_hangings(building, collector, rng)
    _add_lamps(building, collector)
    for piece in building.furniture:
        add_piece(piece, collector)
    add_posters(building.posters, collector)
    quads = collector.quads(rng)
    if building.options.same_rooms:
        quads = _with_same_rooms(quads, building)
    return quads.turned(building.plan_from_building[:3, :3])


def make_lights(building: Building) -> Lights:
    """Lamps and footprints of the furniture, plan frame."""
    rotation = building.plan_from_building[:3, :3]
    spots = _lamp_spots(building)
    height = building.options.height_m - 0.1
    lamps = np.array([(x, y, height) for _, (x, y) in spots])
    feet = [
        [*(rotation[:2, :2] @ piece.footprint.centre), *piece.footprint.half,
         piece.footprint.yaw + np.deg2rad(building.options.yaw_deg)]
        for piece in building.furniture
    ]  # fmt: skip
    return Lights(
        lamps @ rotation.T,
        np.array([room for room, _ in spots]),
        np.array(feet).reshape(-1, 5),
        np.array([piece.room for piece in building.furniture], dtype=int),
    )


def _add_floors_and_ceilings(building: Building, collector: Collector) -> None:
    height = building.options.height_m
    for i, room in enumerate(building.layout.rooms):
        material, color = FLOORS[i % len(FLOORS)]
        collector.add_level(room, 0.0, 1.0, Label.FLOOR, material, color, i)
        collector.add_level(room, height, -1.0, Label.CEILING, Material.CEILING, WHITE, i)


def _add_walls(building: Building, collector: Collector) -> None:
    options, faces = building.options, building.faces
    door, ceiling = options.door_height_m, options.height_m
    z_range = {Part.FULL: (0.0, ceiling), Part.LINTEL: (door, ceiling), Part.JAMB: (0.0, door)}
    for i, part in enumerate(faces.parts):
        label = Label.COLUMN if faces.is_column[i] else Label.WALL
        room = int(faces.rooms[i])
        color = WALL_COLORS[room % len(WALL_COLORS)] if room >= 0 else WHITE
        collector.add_upright(faces.ends[i], z_range[Part(part)], color, max(room, -1), label)


def _add_doorways(building: Building, collector: Collector) -> None:
    """Floor and top of each opening, and a flat frame around it on both walls."""
    top = building.options.door_height_m
    width, depth = 0.07, 0.015
    for door in building.layout.doors:
        # A threshold is of one room; of rooms that look alike, none has one.
        corridor = building.layout.corridor
        rect = door.rect
        room = corridor if building.options.same_rooms and corridor is not None else door.rooms[0]
        collector.add_level(rect, 0.0, 1.0, Label.FLOOR, Material.PLANKS, WOOD_COLORS[1], room)
        collector.add_level(rect, top, -1.0, Label.OTHER, Material.PAINT, WHITE, room)
        half = (rect.size[1] if door.is_across_x else rect.size[0]) / 2
        frame = [
            Box((-half - width, 0.0, 0.0), (-half, depth, top + width), Material.PAINT, WHITE),
            Box((half, 0.0, 0.0), (half + width, depth, top + width), Material.PAINT, WHITE),
            Box((-half, 0.0, top), (half, depth, top + width), Material.PAINT, WHITE),
        ]
        x, y = rect.centre
        if door.is_across_x:
            places = (((rect.x0, y), np.pi / 2), ((rect.x1, y), -np.pi / 2))
        else:
            places = (((x, rect.y0), np.pi), ((x, rect.y1), 0.0))
        for (place, yaw), side in zip(places, door.rooms, strict=True):
            for box in frame:
                add_box(box, place, yaw, side, collector)


def _add_wall_hangings(building: Building, collector: Collector, rng: np.random.Generator) -> None:
    ends, rooms = building.walls_of_rooms
    reach = OUTER_WALL_M + 0.05
    behind = ends.mean(axis=1) - segments.left_normals(ends) * reach
    is_outer = ~np.any([room.contains(behind) for room in building.layout.rooms], axis=0)
    add_hangings(ends, rooms, is_outer, building.options, collector, rng)


def _lamp_spots(building: Building) -> list[tuple[int, tuple[float, float]]]:
    spots = []
    for i, room in enumerate(building.layout.rooms):
        nx, ny = (max(1, round(float(s) / LAMP_SPACING_M)) for s in room.size)
        for kx in range(nx):
            for ky in range(ny):
                x = room.x0 + room.size[0] * (kx + 0.5) / nx
                y = room.y0 + room.size[1] * (ky + 0.5) / ny
                spots.append((i, (float(x), float(y))))
    return spots


def _add_lamps(building: Building, collector: Collector) -> None:
    for room, spot in _lamp_spots(building):
        add_lamp(spot, building.options.height_m, room, collector)


def add_lamp(xy: tuple[float, float], height_m: float, room: int, collector: Collector) -> None:
    """Hang a lamp at a place, m, under the ceiling."""
    lamp = Box((-0.3, -0.15, height_m - 0.07), (0.3, 0.15, height_m), Material.LAMP, WHITE)
    add_box(lamp, xy, 0.0, room, collector)


def add_piece(piece: Piece, collector: Collector) -> None:
    """All its boxes."""
    for box in piece.boxes:
        add_box(box, piece.footprint.centre, piece.footprint.yaw, piece.room, collector, piece.seed)


def add_posters(posters: Sequence[Poster], collector: Collector) -> None:
    """Each with the picture of its seed."""
    for poster in posters:
        add_box(poster.box, poster.place, poster.yaw, poster.room, collector, poster.seed)


def _with_same_rooms(quads: Quads, building: Building) -> Quads:
    """All rooms off the corridor with the surfaces of the first, but for posters, the last to be added."""
    n_posters = 6 * len(building.posters)  # sides of a box
    index = np.arange(len(quads))
    is_own = index >= len(quads) - n_posters
    original = np.flatnonzero((quads.room == 0) & ~is_own)
    copied = copied_rooms(building.layout)
    kept = quads.take(np.flatnonzero(~np.isin(quads.room, copied) | is_own))
    centre = np.array([*building.layout.rooms[0].centre, 0.0])
    rooms = []
    for room in copied:
        is_turned, to = turn_to(building.layout, room)
        turn = np.diag([-1.0, -1.0, 1.0]) if is_turned else np.eye(3)
        copy = replace(quads.take(original), room=np.full(len(original), room))
        copy = replace(copy, origin=copy.origin - centre).turned(turn)
        rooms.append(replace(copy, origin=copy.origin + np.array([*to, 0.0])))
    return Quads.together([kept, *rooms])


def make_plan_quads(building: PlanBuilding, rng: np.random.Generator) -> Quads:
    """Every surface of the storey."""
    collector = Collector()
    _add_plan_floor_and_ceiling(building, collector, rng)
    _add_plan_walls(building, collector)
    _add_plan_lintels(building, collector)
    _add_plan_lamps(building, collector)
    ends, _ = building.faces_of_rooms
    behind = ends.mean(axis=1) - (MAX_WALL_M + 0.1) * segments.left_normals(ends)
    is_outer = building.clearance(behind) == 0
    add_hangings(ends, np.full(len(ends), _UNLIT), is_outer, building.options, collector, rng)
    for piece in building.furniture:
        add_piece(piece, collector)
    add_posters([replace(poster, room=_UNLIT) for poster in building.posters], collector)
    quads = collector.quads(rng)
    angle = np.arctan2(quads.normal[:, 1], quads.normal[:, 0])
    shade = np.where(quads.label == Label.WALL, 0.9 - 0.1 * np.sin(angle + 0.5), 1.0)
    return replace(quads, color=quads.color * shade[:, None])


def no_lights() -> Lights:
    """What shades a storey whose light does not depend on the room."""
    none = np.zeros(0, dtype=int)
    return Lights(np.zeros((0, 3)), none, np.zeros((0, 5)), none)


def _add_plan_floor_and_ceiling(
    building: PlanBuilding, collector: Collector, rng: np.random.Generator
) -> None:
    rect = building.bounds.grown(_BEYOND_M)
    height, floor = building.options.height_m, FLOORS[int(rng.integers(len(FLOORS)))]
    collector.add_level(rect, 0.0, 1.0, Label.FLOOR, *floor, _UNLIT)
    collector.add_level(rect, height, -1.0, Label.CEILING, Material.CEILING, WHITE, _UNLIT)


def _add_plan_walls(building: PlanBuilding, collector: Collector) -> None:
    ends = building.walls.ends
    front = ends.mean(axis=1) + 0.3 * segments.left_normals(ends)
    rooms = look_up(building.cells.room, building.cells.low, front, -1)
    for pair, room in zip(ends, rooms, strict=True):
        color = WALL_COLORS[int(room) % len(WALL_COLORS)] if room >= 0 else WHITE
        collector.add_upright(pair, (0.0, building.options.height_m), color, _UNLIT)


def _add_plan_lintels(building: PlanBuilding, collector: Collector) -> None:
    """Above openings that the plan marks, walls go on."""
    walls, options = building.walls, building.options
    for pair in walls.lintels:
        collector.add_upright(pair, (options.door_height_m, options.height_m), WHITE, _UNLIT)
    along, left = segments.directions(walls.soffits), segments.left_normals(walls.soffits)
    lengths = segments.lengths(walls.soffits)
    for i, depth in enumerate(walls.soffit_depths):
        v = np.sign(depth) * left[i]
        axes = np.array([(*walls.soffits[i, 0], options.door_height_m), (*along[i], 0.0),
                         (*v, 0.0), -Z])  # fmt: skip
        size = (float(lengths[i]), abs(float(depth)))
        collector.add(axes, size, Label.OTHER, Material.PAINT, WHITE, _UNLIT)


def _add_plan_lamps(building: PlanBuilding, collector: Collector) -> None:
    bounds = building.bounds
    x = np.arange(bounds.x0 + LAMP_SPACING_M / 2, bounds.x1, LAMP_SPACING_M)
    y = np.arange(bounds.y0 + LAMP_SPACING_M / 2, bounds.y1, LAMP_SPACING_M)
    spots = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    for x, y in spots[building.clearance(spots) > 0.4].tolist():
        add_lamp((x, y), building.options.height_m, _UNLIT, collector)

"""From a storey built after a plan to rectangles with labels and materials."""

from dataclasses import replace

import numpy as np

from planfit.geometry import segments
from planfit.scan.types import Label
from planfit.synth.furniture import add_hangings
from planfit.synth.mesh import LAMP_SPACING_M, add_lamp, add_piece, add_posters
from planfit.synth.plan_building import PlanBuilding
from planfit.synth.plan_space import look_up
from planfit.synth.plan_walls import MAX_WALL_M
from planfit.synth.quads import (
    FLOORS,
    WALL_COLORS,
    WHITE,
    Collector,
    Lights,
    Material,
    Quads,
    Z,
)

_BEYOND_M = 5.0
"""Floor and ceiling reach so far out of the building: what is seen through its outer doors."""
_UNLIT = -1
"""Light does not depend on the room: rooms of a plan have any shape, so that lamps would shine through
walls. Walls of different directions differ a little in brightness, so that corners show."""


def make_plan_quads(building: PlanBuilding, rng: np.random.Generator) -> Quads:
    """Every surface of the storey."""
    collector = Collector()
    _add_floor_and_ceiling(building, collector, rng)
    _add_walls(building, collector)
    _add_lintels(building, collector)
    _add_lamps(building, collector)
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


def _add_floor_and_ceiling(
    building: PlanBuilding, collector: Collector, rng: np.random.Generator
) -> None:
    rect = building.bounds.grown(_BEYOND_M)
    height, floor = building.options.height_m, FLOORS[int(rng.integers(len(FLOORS)))]
    collector.add_level(rect, 0.0, 1.0, Label.FLOOR, *floor, _UNLIT)
    collector.add_level(rect, height, -1.0, Label.CEILING, Material.CEILING, WHITE, _UNLIT)


def _add_walls(building: PlanBuilding, collector: Collector) -> None:
    ends = building.walls.ends
    front = ends.mean(axis=1) + 0.3 * segments.left_normals(ends)
    rooms = look_up(building.cells.room, building.cells.low, front, -1)
    for pair, room in zip(ends, rooms, strict=True):
        color = WALL_COLORS[int(room) % len(WALL_COLORS)] if room >= 0 else WHITE
        collector.add_upright(pair, (0.0, building.options.height_m), color, _UNLIT)


def _add_lintels(building: PlanBuilding, collector: Collector) -> None:
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


def _add_lamps(building: PlanBuilding, collector: Collector) -> None:
    bounds = building.bounds
    x = np.arange(bounds.x0 + LAMP_SPACING_M / 2, bounds.x1, LAMP_SPACING_M)
    y = np.arange(bounds.y0 + LAMP_SPACING_M / 2, bounds.y1, LAMP_SPACING_M)
    spots = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    for x, y in spots[building.clearance(spots) > 0.4].tolist():
        add_lamp((x, y), building.options.height_m, _UNLIT, collector)

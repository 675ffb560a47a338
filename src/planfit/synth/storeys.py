"""A building of several storeys: one layout a storey, stairs between, and a walk through all of it."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from planfit.floorplan import Floorplan
from planfit.floorplan.faces import Rows
from planfit.scan.types import Label
from planfit.synth.building import Building, make_storey
from planfit.synth.layout import Stairs
from planfit.synth.mesh import make_lights, make_quads
from planfit.synth.options import BuildingOptions, WalkOptions
from planfit.synth.quads import (
    WALL_COLORS,
    WHITE,
    WOOD_COLORS,
    Collector,
    Lights,
    Material,
    Quads,
    X,
    Y,
    Z,
    add_box,
)
from planfit.synth.route import find_route
from planfit.synth.walk import evenly_moving, heading, inwards_of, look_ahead, resample, walk_ahead

ON_STAIRS = -1
"""Storey of frames between two."""


@dataclass(frozen=True)
class StoreyedBuilding:
    """Storeys over each other, in one building frame: z up, the lowest floor at z = 0, m."""

    storeys: tuple[Building, ...]
    """From the lowest; each in a frame of its own with z = 0 at its floor."""
    stairs: Stairs

    @property
    def plan_from_building(self) -> Float[np.ndarray, "4 4"]:
        """Rotation about z, the same for all storeys."""
        return self.storeys[0].plan_from_building

    @property
    def floors_z(self) -> tuple[float, ...]:
        """Height of each floor, m."""
        return tuple(self.stairs.rise_m * k for k in range(len(self.storeys)))

    @property
    def floorplan(self) -> Floorplan:
        """Of the lowest storey."""
        return self.storeys[0].floorplan


def make_storeys(options: BuildingOptions, rng: np.random.Generator) -> StoreyedBuilding:
    """Make a building of `options.n_storeys` storeys, each of a layout of its own.

    Raises:
        OptionError: as `make_building`.
    """
    storeys = tuple(make_storey(options, rng) for _ in range(options.n_storeys))
    stairs = storeys[0].layout.stairs
    assert stairs is not None
    return StoreyedBuilding(storeys, stairs)


def make_storeyed_quads(building: StoreyedBuilding, rng: np.random.Generator) -> Quads:
    """Every surface, plan frame; rooms count on from storey to storey."""
    parts = []
    n_rooms, top = 0, len(building.storeys) - 1
    for k, (storey, z) in enumerate(zip(building.storeys, building.floors_z, strict=True)):
        quads = make_quads(storey, rng)
        well = len(storey.layout.rooms) - 1
        is_floor = (quads.label == Label.FLOOR) & (k > 0)
        is_top = ((quads.label == Label.CEILING) | (quads.material == Material.LAMP)) & (k < top)
        quads = quads.take(np.flatnonzero((quads.room != well) | ~(is_floor | is_top)))
        room = np.where(quads.room >= 0, quads.room + n_rooms, quads.room)
        parts.append(replace(quads, origin=quads.origin + np.array([0.0, 0.0, z]), room=room))
        if k < top:
            parts.append(_stairs(building, k, well + n_rooms, rng))
        n_rooms += len(storey.layout.rooms)
    return Quads.together(parts)


def _stairs(building: StoreyedBuilding, k: int, room: int, rng: np.random.Generator) -> Quads:
    """Steps from storey k to the next, the landing above, and the walls beside the slab between."""
    collector = Collector()
    stairs, options = building.stairs, building.storeys[k].options
    floor = building.floors_z[k]
    ceiling, above = floor + options.height_m, building.floors_z[k + 1]
    for box in stairs.boxes():
        low, high = ((x, y, floor + z) for x, y, z in (box.low, box.high))
        add_box(replace(box, low=low, high=high), (0.0, 0.0), 0.0, room, collector)
    landing, well = stairs.landing, stairs.well
    planks = (Material.PLANKS, WOOD_COLORS[0])
    collector.add_level(landing, above, 1.0, Label.FLOOR, *planks, room)
    collector.add_level(landing, ceiling, -1.0, Label.CEILING, Material.CEILING, WHITE, room)
    edge = np.array([(landing.x0, landing.y1, ceiling), X, Z, Y])
    size = (float(landing.size[0]), above - ceiling)
    collector.add(edge, size, Label.OTHER, Material.PAINT, WHITE, room)
    corners = [(well.x0, well.y0), (well.x1, well.y0), (well.x1, well.y1), (well.x0, well.y1)]
    for i, ends in enumerate(zip(corners, (*corners[1:], corners[0]), strict=True)):
        color = WALL_COLORS[i % len(WALL_COLORS)]
        collector.add_upright(np.array(ends), (ceiling, above), color, room)
    return collector.quads(rng).turned(building.plan_from_building[:3, :3])


def make_storeyed_lights(building: StoreyedBuilding) -> Lights:
    """Lamps and footprints of all storeys, by the same rooms as `make_storeyed_quads`."""
    lights = [make_lights(storey) for storey in building.storeys]
    counts = np.cumsum([0, *(len(storey.layout.rooms) for storey in building.storeys)])
    return Lights(
        np.concatenate([one.lamps + np.array([0.0, 0.0, z])
                        for one, z in zip(lights, building.floors_z, strict=True)]),
        np.concatenate([one.lamp_room + n for one, n in zip(lights, counts, strict=False)]),
        np.concatenate([one.footprints for one in lights]),
        np.concatenate([one.footprint_room + n for one, n in zip(lights, counts, strict=False)]),
    )  # fmt: skip


@dataclass(frozen=True)
class _Leg(Rows):
    """Part of the way, in dense points."""

    walked: Float[np.ndarray, "n 2"]
    floor_z: Float[np.ndarray, " n"]
    inwards: Float[np.ndarray, "n 2"]
    storeys: Int[np.ndarray, " n"]


def walk_through_storeys(
    building: StoreyedBuilding, options: WalkOptions, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "n 4 4"], Int[np.ndarray, " n"]]:
    """A walk that calls at every room, storey by storey, up the stairs; loops come down again.

    Returns:
        Poses plan_from_cam, and the index of the storey of each frame; `ON_STAIRS` between two.

    Raises:
        OptionError: some room cannot be entered with this clearance.
    """
    legs: list[_Leg] = []
    top = len(building.storeys) - 1
    for k, storey in enumerate(building.storeys):
        if k > 0:
            legs.append(_on_stairs(building, k - 1, is_up=True))
        start = building.stairs.foot if k == 0 else building.stairs.head
        comes_back = k < top or options.is_loop
        round_trip = replace(options, is_loop=comes_back)
        route = find_route(storey, round_trip, rng, start)
        if 0 < k < top:
            route = np.concatenate([route, building.stairs.foot[None]])
        walked = walk_ahead(route, storey, round_trip, rng)
        legs.append(_on_floor(building, k, walked, inwards_of(walked, storey)))
    if options.is_loop:
        for k in range(top - 1, -1, -1):
            legs.append(_on_stairs(building, k, is_up=False))
            if k > 0:
                across = resample(np.stack([building.stairs.foot, building.stairs.head]))
                legs.append(_on_floor(building, k, across, np.zeros_like(across)))
    way = _Leg.together(legs)
    yaw = heading(way.walked, way.inwards, options.is_loop)
    poses = look_ahead(way.walked, way.floor_z, yaw, options, rng)
    picked = evenly_moving(poses, options.n_frames)
    return building.plan_from_building @ poses[picked], way.storeys[picked]


def _on_floor(
    building: StoreyedBuilding,
    k: int,
    walked: Float[np.ndarray, "n 2"],
    inwards: Float[np.ndarray, "n 2"],
) -> _Leg:
    n = len(walked)
    return _Leg(walked, np.full(n, building.floors_z[k]), inwards, np.full(n, k))


def _on_stairs(building: StoreyedBuilding, k: int, is_up: bool) -> _Leg:
    """Between storeys k and k + 1; both landings are of their storeys."""
    way = resample(building.stairs.way_up)
    way = way if is_up else way[::-1]
    z, rise = way[:, 2], building.stairs.rise_m
    storeys = np.where(z <= 0, k, np.where(z >= rise, k + 1, ON_STAIRS))
    return _Leg(way[:, :2], z + building.floors_z[k], np.zeros((len(way), 2)), storeys)

"""Buildings that no option of `planfit.synth` gives: offices all alike, a long corridor, a hall, niches."""

import hashlib
from dataclasses import replace

import numpy as np

from faults.inputs import Inputs, Rendered
from planfit.geometry import se3
from planfit.scan import Scan
from planfit.scan.formats.facap import PLAN_FROM_WORLD, UP_WORLD
from planfit.synth import (
    Building,
    Renderer,
    SynthOptions,
    make_camera,
    make_lights,
    make_quads,
    walk_through,
)
from planfit.synth.building import wall_faces
from planfit.synth.furniture import Footprint, Piece, furnish
from planfit.synth.layout import BuildingLayout, Door, Rect, make_layout
from planfit.synth.mesh import Quads
from planfit.synth.options import OUTER_WALL_M
from planfit.synth.scan import SynthFiles, frame_name

WALL_M = 0.15


def same_rooms(options: SynthOptions) -> tuple[BuildingLayout, SynthOptions]:
    """Six offices of one size along a corridor, their doors at the same place."""
    width, depth, height = 3.6, 4.2, 1.9
    rooms = [Rect(0.0, 0.0, 6 * width + 5 * WALL_M, height)]
    doors = []
    for k in range(6):
        x = k * (width + WALL_M)
        rooms.append(Rect(x, height + WALL_M, x + width, height + WALL_M + depth))
        doors.append(Door(Rect(x + 0.7, height, x + 1.7, height + WALL_M), False, (0, k + 1)))
    return BuildingLayout(tuple(rooms), tuple(doors), (), 0), options


def corridor(options: SynthOptions) -> tuple[BuildingLayout, SynthOptions]:
    """60 m long and 2.2 m wide, with a small room at either end; doors and pictures on the way."""
    length, width = 60.0, 2.2
    rooms = (
        Rect(0.0, 0.0, length, width),
        Rect(-3.6 - WALL_M, -0.7, -WALL_M, 2.9),
        Rect(length + WALL_M, -0.7, length + WALL_M + 3.6, 2.9),
    )
    doors = (
        Door(Rect(-WALL_M, 0.6, 0.0, 1.6), True, (0, 1)),
        Door(Rect(length, 0.6, length + WALL_M, 1.6), True, (0, 2)),
    )
    walk = replace(options.walk, area_per_stop_m2=60.0)
    building = replace(options.building, furniture_per_room=2)
    return BuildingLayout(rooms, doors, (), 0), replace(options, walk=walk, building=building)


def hall(options: SynthOptions) -> tuple[BuildingLayout, SynthOptions]:
    """20 x 14 m with six columns: most walls are out of the sensor's range most of the time."""
    columns = [Rect(x - 0.2, y - 0.2, x + 0.2, y + 0.2) for x in (5, 10, 15) for y in (4.5, 9.5)]
    walk = replace(options.walk, area_per_stop_m2=35.0)
    building = replace(options.building, height_m=3.4, furniture_per_room=1)
    layout = BuildingLayout((Rect(0.0, 0.0, 20.0, 14.0),), (), tuple(columns), None)
    return layout, replace(options, walk=walk, building=building)


def niches(options: SynthOptions) -> tuple[BuildingLayout, SynthOptions]:
    """A flat with layers of wall 10 to 20 cm before others: a scan a decimetre off finds faces as well."""
    rng = np.random.default_rng([options.seed, 9])
    layout = make_layout(options.building, rng)
    layers = []
    for room in layout.rooms:
        for side in range(4):
            length, depth = rng.uniform(0.9, 1.9), rng.uniform(0.1, 0.2)
            axis = side % 2  # along x, along y
            low, high = np.array([room.x0, room.y0]), np.array([room.x1, room.y1])
            if high[axis] - low[axis] < length + 0.8:
                continue
            begin = rng.uniform(low[axis] + 0.3, high[axis] - 0.3 - length)
            first, last = low.copy(), high.copy()
            first[axis], last[axis] = begin, begin + length
            if side < 2:
                last[1 - axis] = low[1 - axis] + depth
            else:
                first[1 - axis] = high[1 - axis] - depth
            layer = Rect(*(float(v) for v in (*first, *last)))
            if not any(layer.grown(0.4).overlaps(door.rect) for door in layout.doors):
                layers.append(layer)
    return replace(layout, columns=tuple(layers)), options


def scan_of_layout(
    layout: BuildingLayout,
    options: SynthOptions,
    has_same_rooms: bool = False,
    columns_are_walls: bool = False,
) -> Inputs:
    """A walk through a layout, with true poses as recorded ones.

    Args:
        layout: rooms, doors, columns.
        options: of the rest; those of the layout have no effect.
        has_same_rooms: rooms of one size are furnished, hung and painted alike.
        columns_are_walls: columns stand at walls and are wall themselves.
    """
    rngs = [np.random.default_rng([options.seed, stream]) for stream in range(3)]
    faces = wall_faces(layout, OUTER_WALL_M)
    furnished = layout
    if columns_are_walls:
        faces = replace(faces, is_column=np.zeros(len(faces.ends), dtype=bool))
        furnished = replace(layout, columns=())
    pieces = tuple(furnish(furnished, options.building, rngs[0]))
    if has_same_rooms:
        pieces = _furnished_alike(layout, pieces)
    building = Building(options.building, layout, faces, pieces)
    quads = make_quads(building, rngs[1])
    if has_same_rooms:
        quads = _hung_alike(layout, quads)
    renderer = Renderer(quads, make_lights(building))
    plan_from_cams = walk_through(building, options.walk, rngs[2])
    world_from_cams = se3.inverse(PLAN_FROM_WORLD) @ plan_from_cams
    world_from_cams[:, :3, :3] = se3.project_to_so3(world_from_cams[:, :3, :3])
    n, camera = len(plan_from_cams), make_camera(options.camera)
    content = repr((options, layout, has_same_rooms, columns_are_walls)).encode()
    digest = hashlib.sha256(content).hexdigest()[:16]
    scan = Scan(
        name=f"synthetic scan, seed {options.seed}",
        frame_ids=tuple(frame_name(i) for i in range(n)),
        timestamps=np.arange(1.0, n + 1.0),
        cameras=(camera,) * n,
        world_from_cams=world_from_cams,
        files=SynthFiles(renderer, camera, plan_from_cams, options),
        has_labels=options.has_labels,
        up_world=UP_WORLD,
        plan_from_world_axes=PLAN_FROM_WORLD,
        fingerprint=digest,
    )
    floorplan = replace(building.floorplan, fingerprint=digest)
    rendered = Rendered(building, renderer, plan_from_cams, options)
    return Inputs(scan, floorplan, world_from_cams, PLAN_FROM_WORLD, rendered=rendered)


def _alike(layout: BuildingLayout) -> list[tuple[int, np.ndarray]]:
    """Rooms as large as room 1, and where each lies of it, m."""
    first = layout.rooms[1]
    return [
        (i, np.array([room.x0 - first.x0, room.y0 - first.y0]))
        for i, room in enumerate(layout.rooms)
        if i > 1 and np.allclose(room.size, first.size)
    ]


def _furnished_alike(layout: BuildingLayout, pieces: tuple[Piece, ...]) -> tuple[Piece, ...]:
    """Pieces of room 1 in all rooms as large as it."""
    alike = _alike(layout)
    copied = [piece for piece in pieces if piece.room not in [i for i, _ in alike]]
    for piece in [piece for piece in pieces if piece.room == 1]:
        foot = piece.footprint
        for i, (dx, dy) in alike:
            centre = (foot.centre[0] + float(dx), foot.centre[1] + float(dy))
            copied.append(Piece(Footprint(centre, foot.half, foot.yaw), piece.boxes, i))
    return tuple(copied)


def _hung_alike(layout: BuildingLayout, quads: Quads) -> Quads:
    """Surfaces of room 1, pictures and paint among them, in all rooms as large as it."""
    own = np.flatnonzero(quads.room == 1)
    parts = [np.flatnonzero(~np.isin(quads.room, [i for i, _ in _alike(layout)]))]
    origins, rooms = [quads.origin[parts[0]]], [quads.room[parts[0]]]
    for i, (dx, dy) in _alike(layout):
        parts.append(own)
        origins.append(quads.origin[own] + [dx, dy, 0.0])
        rooms.append(np.full(len(own), i))
    chosen = np.concatenate(parts)
    return Quads(
        origin=np.concatenate(origins),
        u_axis=quads.u_axis[chosen],
        v_axis=quads.v_axis[chosen],
        size=quads.size[chosen],
        normal=quads.normal[chosen],
        label=quads.label[chosen],
        material=quads.material[chosen],
        color=quads.color[chosen],
        room=np.concatenate(rooms),
        seed=quads.seed[chosen],
    )

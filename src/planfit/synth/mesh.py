"""From the building to rectangles with labels and materials, and to triangles for ray casting."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import trimesh
from jaxtyping import Float, Int, Integer, UInt8

from planfit.geometry import segments
from planfit.scan.types import Label
from planfit.synth.building import Building
from planfit.synth.furniture import Box, Piece
from planfit.synth.layout import Rect
from planfit.synth.materials import (
    CARDBOARD,
    FABRIC_COLORS,
    FLOORS,
    WALL_COLORS,
    WHITE,
    WOOD_COLORS,
    Color,
    Material,
)
from planfit.synth.walls import Part

LAMP_SPACING_M = 3.5


@dataclass(frozen=True)
class Quads:
    """Rectangles, plan frame: `origin + u * u_axis + v * v_axis`, u and v from 0 to `size`."""

    origin: Float[np.ndarray, "n 3"]
    """Corner where u and v are 0, m."""
    u_axis: Float[np.ndarray, "n 3"]
    """Unit vectors."""
    v_axis: Float[np.ndarray, "n 3"]
    """Unit vectors."""
    size: Float[np.ndarray, "n 2"]
    """Width and height, m."""
    normal: Float[np.ndarray, "n 3"]
    """Unit vectors, towards the side one sees."""
    label: UInt8[np.ndarray, " n"]
    """Values of `Label`."""
    material: Int[np.ndarray, " n"]
    """Values of `Material`."""
    color: Float[np.ndarray, "n 3"]
    """Base colour, 0 to 1."""
    room: Int[np.ndarray, " n"]
    """Index of the room; -1 for the outside."""
    seed: Integer[np.ndarray, " n"]
    """So that no two surfaces look alike."""

    def __len__(self) -> int:
        return len(self.origin)

    def triangles(self) -> trimesh.Trimesh:
        """Two triangles each, in order: triangle t belongs to rectangle t // 2."""
        u = self.u_axis * self.size[:, :1]
        v = self.v_axis * self.size[:, 1:]
        corners = np.stack([self.origin, self.origin + u, self.origin + u + v, self.origin + v], 1)
        first = 4 * np.arange(len(self))[:, None]
        faces = (first + np.array([0, 1, 2, 0, 2, 3])).reshape(-1, 3)
        return trimesh.Trimesh(corners.reshape(-1, 3), faces, process=False)


@dataclass(frozen=True)
class Lights:
    """What shades the rectangles: lamps and the floor under furniture, sorted by room."""

    lamps: Float[np.ndarray, "n 3"]
    """Where lamps hang, m, plan frame."""
    lamp_room: Int[np.ndarray, " n"]
    """Index of the room of each lamp, ascending."""
    footprints: Float[np.ndarray, "m 5"]
    """Centre x y, half size x y (m), yaw (rad), plan frame."""
    footprint_room: Int[np.ndarray, " m"]
    """Index of the room of each, ascending."""


def make_quads(building: Building, rng: np.random.Generator) -> Quads:
    """Every surface of the building, plan frame."""
    collector = _Collector()
    _add_floors_and_ceilings(building, collector)
    _add_walls(building, collector)
    _add_doorways(building, collector)
    _add_wall_hangings(building, collector, rng)
    _add_lamps(building, collector)
    for piece in building.furniture:
        _add_piece(piece, collector)
    quads = collector.quads(rng)
    rotation = building.plan_from_building[:3, :3]
    return replace(
        quads,
        origin=quads.origin @ rotation.T,
        u_axis=quads.u_axis @ rotation.T,
        v_axis=quads.v_axis @ rotation.T,
        normal=quads.normal @ rotation.T,
    )


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


class _Collector:
    """Gathers rectangles one at a time."""

    def __init__(self) -> None:
        self.axes: list[np.ndarray] = []
        self.size: list[tuple[float, float]] = []
        self.kind: list[tuple[int, int, int]] = []
        self.color: list[Color] = []

    def add(
        self,
        axes: Float[np.ndarray, "4 3"],
        size: tuple[float, float],
        label: Label,
        material: Material,
        color: Color,
        room: int,
    ) -> None:
        """Add one; the rows of `axes` are origin, u, v, normal."""
        if min(size) <= 1e-9:
            return
        self.axes.append(axes)
        self.size.append(size)
        self.kind.append((label, material, room))
        self.color.append(color)

    def quads(self, rng: np.random.Generator) -> Quads:
        axes, kind = np.array(self.axes, dtype=float), np.array(self.kind)
        return Quads(
            origin=axes[:, 0],
            u_axis=axes[:, 1],
            v_axis=axes[:, 2],
            size=np.array(self.size, dtype=float),
            normal=axes[:, 3],
            label=kind[:, 0].astype(np.uint8),
            material=kind[:, 1],
            color=np.array(self.color, dtype=float),
            room=kind[:, 2],
            seed=rng.integers(2**63, size=len(axes), dtype=np.uint64),
        )


X, Y, Z = np.eye(3)


def _flat(rect: Rect, z: float, normal_z: float) -> Float[np.ndarray, "4 3"]:
    return np.array([(rect.x0, rect.y0, z), X, Y, normal_z * Z])


def _flat_size(rect: Rect) -> tuple[float, float]:
    return float(rect.size[0]), float(rect.size[1])


def _add_floors_and_ceilings(building: Building, collector: _Collector) -> None:
    height = building.options.height_m
    for i, room in enumerate(building.layout.rooms):
        material, color = FLOORS[i % len(FLOORS)]
        size = _flat_size(room)
        collector.add(_flat(room, 0.0, 1.0), size, Label.FLOOR, material, color, i)
        collector.add(_flat(room, height, -1.0), size, Label.CEILING, Material.CEILING, WHITE, i)


def _add_walls(building: Building, collector: _Collector) -> None:
    options, faces = building.options, building.faces
    along = segments.directions(faces.ends)
    normals = segments.left_normals(faces.ends)
    lengths = segments.lengths(faces.ends)
    door, ceiling = options.door_height_m, options.height_m
    z_range = {Part.FULL: (0.0, ceiling), Part.LINTEL: (door, ceiling), Part.JAMB: (0.0, door)}
    for i, part in enumerate(faces.parts):
        low, high = z_range[Part(part)]
        axes = np.array([(*faces.ends[i, 0], low), (*along[i], 0.0), Z, (*normals[i], 0.0)])
        label = Label.COLUMN if faces.is_column[i] else Label.WALL
        room = int(faces.rooms[i])
        color = WALL_COLORS[room % len(WALL_COLORS)] if room >= 0 else WHITE
        size = (float(lengths[i]), high - low)
        collector.add(axes, size, label, Material.PLASTER, color, max(room, -1))


def _add_doorways(building: Building, collector: _Collector) -> None:
    """Floor and top of each opening, and a flat frame around it on both walls."""
    top = building.options.door_height_m
    width, depth = 0.07, 0.015
    for door in building.layout.doors:
        rect, room = door.rect, door.rooms[0]
        size = _flat_size(rect)
        floor, soffit = _flat(rect, 0.0, 1.0), _flat(rect, top, -1.0)
        collector.add(floor, size, Label.FLOOR, Material.PLANKS, WOOD_COLORS[1], room)
        collector.add(soffit, size, Label.OTHER, Material.PAINT, WHITE, room)
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
                _add_box(box, place, yaw, side, collector)


def _add_wall_hangings(building: Building, collector: _Collector, rng: np.random.Generator) -> None:
    """Pictures, notices, sockets and, on outer walls, windows: thin boxes in front of the wall."""
    options, faces = building.options, building.faces
    lengths = segments.lengths(faces.ends)
    normals = segments.left_normals(faces.ends)
    is_wall = (faces.parts == Part.FULL) & (faces.rooms >= 0) & ~faces.is_column
    for i in np.flatnonzero(is_wall):
        room = int(faces.rooms[i])
        yaw = float(np.arctan2(-normals[i, 0], normals[i, 1]))
        behind = faces.ends[i].mean(axis=0) - normals[i] * (options.outer_wall_thickness_m + 0.05)
        is_outer = not any(r.contains(behind[None])[0] for r in building.layout.rooms)
        count = rng.poisson(options.pictures_per_wall * lengths[i] / 4.0)
        slots = np.linspace(0.12, lengths[i] - 0.12, count + 1)
        for low, high in pairwise(slots):
            boxes = _hanging(is_outer, options.door_height_m, rng)
            half = boxes[0].high[0]
            if high - low < 2 * half + 0.1:
                continue
            at = rng.uniform(low + half, high - half) / lengths[i]
            place = faces.ends[i, 0] * (1 - at) + faces.ends[i, 1] * at
            for box in boxes:
                _add_box(box, (float(place[0]), float(place[1])), yaw, room, collector)


def _hanging(is_outer: bool, top: float, rng: np.random.Generator) -> list[Box]:
    kind = rng.random()
    if is_outer and kind < 0.35:
        return _window(top, rng)
    if kind < 0.55:
        low = 0.3 if rng.random() < 0.6 else 1.05
        return [Box((-0.075, 0.0, low), (0.075, 0.012, low + 0.08), Material.PAINT, WHITE)]
    half, height = rng.uniform(0.18, 0.5), rng.uniform(0.35, 0.75)
    low = rng.uniform(1.0, 1.4)
    front = Material.NOTES if rng.random() < 0.35 else Material.PICTURE
    color = FABRIC_COLORS[int(rng.integers(len(FABRIC_COLORS)))]
    return [Box((-half, 0.0, low), (half, 0.02, low + height), Material.PAINT, color, front)]


def _window(top: float, rng: np.random.Generator) -> list[Box]:
    half = rng.uniform(0.45, 0.75)
    low = rng.uniform(0.85, 1.0)
    sill = Box((-half - 0.05, 0.0, low - 0.03), (half + 0.05, 0.1, low), Material.PAINT, WHITE)
    return [sill, Box((-half, 0.0, low), (half, 0.02, top), Material.PAINT, WHITE, Material.WINDOW)]


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


def _add_lamps(building: Building, collector: _Collector) -> None:
    height = building.options.height_m
    lamp = Box((-0.3, -0.15, height - 0.07), (0.3, 0.15, height), Material.LAMP, WHITE)
    for room, spot in _lamp_spots(building):
        _add_box(lamp, spot, 0.0, room, collector)


def _add_piece(piece: Piece, collector: _Collector) -> None:
    for box in piece.boxes:
        _add_box(box, piece.footprint.centre, piece.footprint.yaw, piece.room, collector)


def _add_box(
    box: Box, centre: tuple[float, float], yaw: float, room: int, collector: _Collector
) -> None:
    """The sides of a box that one can see: not the one it stands on, when that is the floor."""
    c, s = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    low, high = np.array(box.low), np.array(box.high)
    for axis in range(3):
        for facing in (-1, 1):
            if axis == 2 and facing < 0 and low[2] <= 0.0:
                continue
            u, v = ((1, 2), (0, 2), (0, 1))[axis]
            origin = low.copy()
            if facing > 0:
                origin[axis] = high[axis]
            normal = np.zeros(3)
            normal[axis] = facing
            is_front = axis == 1 and facing > 0 and box.front is not None
            material = box.front if is_front and box.front is not None else box.material
            axes = np.array([origin, np.eye(3)[u], np.eye(3)[v], normal]) @ rotation.T
            axes[0, :2] += centre
            size = (float(high[u] - low[u]), float(high[v] - low[v]))
            color = CARDBOARD if material == Material.CARDBOARD else box.color
            collector.add(axes, size, Label.OTHER, material, color, room)

"""Furniture made of boxes, placed so that one can still walk through every room."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from planfit.geometry import segments
from planfit.synth.layout import BuildingLayout, Door
from planfit.synth.options import WALKWAY_M, BuildingOptions
from planfit.synth.quads import (
    CARDBOARD,
    DARK,
    FABRIC_COLORS,
    METAL,
    WHITE,
    WOOD_COLORS,
    Box,
    Collector,
    Color,
    Material,
    Rect,
    add_box,
)


@dataclass(frozen=True)
class Footprint:
    """The floor that a piece takes, building frame."""

    centre: tuple[float, float]
    half: tuple[float, float]
    """Half the size along the piece's own x and y, m."""
    yaw: float
    """rad"""

    def distance(self, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Distances, m, from points; 0 inside."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        local = np.abs((xy - self.centre) @ np.array([[c, -s], [s, c]])) - self.half
        return np.linalg.norm(np.maximum(local, 0.0), axis=-1)

    def bounds(self) -> Rect:
        """The upright rectangle around it."""
        c, s = abs(np.cos(self.yaw)), abs(np.sin(self.yaw))
        dx, dy = c * self.half[0] + s * self.half[1], s * self.half[0] + c * self.half[1]
        x, y = self.centre
        return Rect(x - dx, y - dy, x + dx, y + dy)


@dataclass(frozen=True)
class Piece:
    """One piece of furniture, standing on the floor of a room."""

    footprint: Footprint
    boxes: tuple[Box, ...]
    room: int
    seed: int | None = None
    """Of the textures of all its sides; without, each side has its own."""


DOOR_ZONE_M = 0.9
"""Nothing stands this near in front of a door."""
GAP_M = 0.03


def furnish(
    layout: BuildingLayout, options: BuildingOptions, rng: np.random.Generator
) -> list[Piece]:
    """Place furniture in every room."""
    pieces: list[Piece] = []
    for i, room in enumerate(layout.rooms):
        if layout.stairs is not None and room == layout.stairs.well:
            continue
        n_pieces = round(options.furniture_per_room * max(room.area / 16.0, 0.5))
        doors = [door for door in layout.doors if i in door.rooms]
        columns = [standing(column) for column in layout.columns if room.overlaps(column)]
        placed: list[Footprint] = []
        for k in range(n_pieces):
            is_central = k % 7 == 1 and i != layout.corridor
            makers = _CENTRAL if is_central else _AT_WALL
            boxes = makers[int(rng.integers(len(makers)))](rng)
            for _ in range(12):
                footprint = _random_place(room, _size(boxes), is_central, rng)
                if _fits(footprint, placed, columns, room, doors):
                    placed.append(footprint)
                    pieces.append(Piece(footprint, tuple(boxes), i))
                    break
    return pieces


def standing(column: Rect) -> Footprint:
    """The floor that an upright rectangle takes."""
    centre, half = column.centre, column.size / 2
    return Footprint((float(centre[0]), float(centre[1])), (float(half[0]), float(half[1])), 0.0)


def _size(boxes: list[Box]) -> Float[np.ndarray, "2"]:
    """Extent in x and y, m; pieces are made around the origin."""
    return 2 * np.max([np.abs([b.low[:2], b.high[:2]]).max(axis=0) for b in boxes], axis=0)


def _random_place(
    room: Rect, size: Float[np.ndarray, "2"], is_central: bool, rng: np.random.Generator
) -> Footprint:
    half = (float(size[0] / 2), float(size[1] / 2))
    if is_central:
        reach = np.maximum(room.size / 2 - 1.8, 0.4)
        x, y = room.centre + rng.uniform(-reach, reach)
        yaw = rng.choice([0.0, np.pi / 2]) + rng.normal(0.0, np.deg2rad(8.0))
        return Footprint((float(x), float(y)), half, float(yaw))
    side = int(rng.integers(4))
    # Turned so that +y points into the room: back to the south, east, north or west wall.
    yaw = side * np.pi / 2
    length = room.size[side % 2]
    along = rng.uniform(half[0], max(length - half[0], half[0] + 1e-6))
    inwards = half[1] + GAP_M
    x, y = (
        (room.x0 + along, room.y0 + inwards),
        (room.x1 - inwards, room.y0 + along),
        (room.x1 - along, room.y1 - inwards),
        (room.x0 + inwards, room.y1 - along),
    )[side]
    return Footprint((float(x), float(y)), half, float(yaw))


def _fits(
    footprint: Footprint,
    placed: list[Footprint],
    columns: list[Footprint],
    room: Rect,
    doors: list[Door],
) -> bool:
    bounds = footprint.bounds()
    inner = room.grown(-GAP_M / 2)
    if bounds.x0 < inner.x0 or bounds.y0 < inner.y0 or bounds.x1 > inner.x1 or bounds.y1 > inner.y1:
        return False
    others = [*placed, *columns]
    if any(bounds.grown(GAP_M).overlaps(other.bounds()) for other in others):
        return False
    if any(bounds.overlaps(door.rect.grown(DOOR_ZONE_M)) for door in doors):
        return False
    return _is_walkable([footprint, *others], room, doors)


def _is_walkable(obstacles: list[Footprint], room: Rect, doors: list[Door]) -> bool:
    """Whether one way of `WALKWAY_M` joins all doors and the larger part of what is left free."""
    step = 0.1
    inner = room.grown(-WALKWAY_M / 2)
    x, y = np.arange(inner.x0, inner.x1, step), np.arange(inner.y0, inner.y1, step)
    if len(x) == 0 or len(y) == 0:
        return False
    xy = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    clear = np.min([obstacle.distance(xy) for obstacle in obstacles], axis=0)
    is_free = (clear >= WALKWAY_M / 2).reshape(len(x), len(y))
    if is_free.mean() < 0.25:
        return False
    parts, _ = ndimage.label(is_free)
    main = int(np.argmax(np.bincount(parts.ravel(), weights=is_free.ravel())))
    for door in doors:
        nearest = int(np.argmin(np.linalg.norm(xy - door.rect.centre, axis=1)))
        if parts.ravel()[nearest] != main:
            return False
    return True


def _pick(colors: tuple[Color, ...], rng: np.random.Generator) -> Color:
    return colors[int(rng.integers(len(colors)))]


def _legs(half_x: float, half_y: float, height: float, color: Color) -> list[Box]:
    inset, width = 0.03, 0.05
    return [
        Box(
            (sx * (half_x - inset) - width / 2, sy * (half_y - inset) - width / 2, 0.0),
            (sx * (half_x - inset) + width / 2, sy * (half_y - inset) + width / 2, height),
            Material.PAINT,
            color,
        )
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]


def _things_on(
    half_x: float, half_y: float, top: float, count: int, rng: np.random.Generator
) -> list[Box]:
    """Small boxes side by side on a surface: books, a carton, a tin."""
    slots = np.linspace(-half_x + 0.02, half_x - 0.02, count + 1)
    boxes = []
    for low, high in pairwise(slots):
        if rng.random() < 0.3 or high - low < 0.1:
            continue
        width = min(rng.uniform(0.1, 0.3), high - low - 0.02)
        depth = rng.uniform(0.1, min(0.3, 2 * half_y - 0.04))
        x, y = rng.uniform(low, high - width), rng.uniform(-half_y + 0.02, half_y - 0.02 - depth)
        height = rng.uniform(0.04, 0.32)
        material = (Material.PICTURE, Material.NOTES, Material.CARDBOARD)[int(rng.integers(3))]
        color = CARDBOARD if material == Material.CARDBOARD else _pick(FABRIC_COLORS, rng)
        boxes.append(Box((x, y, top), (x + width, y + depth, top + height), material, color))
    return boxes


def _table(rng: np.random.Generator) -> list[Box]:
    hx, hy, top = rng.uniform(0.55, 0.8), rng.uniform(0.38, 0.48), rng.uniform(0.72, 0.77)
    wood = _pick(WOOD_COLORS, rng)
    board = Box((-hx, -hy, top - 0.04), (hx, hy, top), Material.WOOD, wood)
    things = _things_on(hx, hy, top, 4, rng)
    return [board, *_legs(hx, hy, top - 0.04, _pick((wood, METAL, DARK), rng)), *things]


def _low_table(rng: np.random.Generator) -> list[Box]:
    hx, hy, top = rng.uniform(0.4, 0.6), rng.uniform(0.28, 0.38), rng.uniform(0.4, 0.48)
    wood = _pick(WOOD_COLORS, rng)
    board = Box((-hx, -hy, top - 0.06), (hx, hy, top), Material.WOOD, wood)
    return [board, *_legs(hx, hy, top - 0.06, wood), *_things_on(hx, hy, top, 3, rng)]


def _desk(rng: np.random.Generator) -> list[Box]:
    hx, hy, top = rng.uniform(0.6, 0.85), 0.36, 0.74
    wood = _pick(WOOD_COLORS, rng)
    x = rng.uniform(-hx + 0.35, hx - 0.35)
    return [
        Box((-hx, -hy, top - 0.03), (hx, hy, top), Material.WOOD, wood),
        *_legs(hx, hy, top - 0.03, METAL),
        Box((hx - 0.42, -hy + 0.02, 0.1), (hx - 0.07, hy - 0.04, 0.62), Material.WOOD, wood,
            Material.CABINET),
        Box((x - 0.04, -0.2, top), (x + 0.04, -0.16, top + 0.16), Material.PAINT, DARK),
        Box((x - 0.3, -0.18, top + 0.1), (x + 0.3, -0.14, top + 0.45), Material.PAINT, DARK,
            Material.NOTES),
        Box((x - 0.22, 0.05, top), (x + 0.22, 0.2, top + 0.02), Material.NOTES, METAL),
    ]  # fmt: skip


def _cabinet(rng: np.random.Generator) -> list[Box]:
    hx, hy, top = rng.uniform(0.4, 0.7), rng.uniform(0.2, 0.28), rng.uniform(0.75, 1.1)
    wood = _pick(WOOD_COLORS, rng)
    body = Box((-hx, -hy, 0.06), (hx, hy, top), Material.WOOD, wood, Material.CABINET)
    foot = Box((-hx + 0.03, -hy + 0.03, 0.0), (hx - 0.03, hy - 0.03, 0.06), Material.PAINT, DARK)
    return [body, foot, *_things_on(hx, hy, top, 4, rng)]


def _wardrobe(rng: np.random.Generator) -> list[Box]:
    hx, hy, top = rng.uniform(0.5, 0.8), 0.29, rng.uniform(1.9, 2.15)
    wood = _pick(WOOD_COLORS, rng)
    return [Box((-hx, -hy, 0.0), (hx, hy, top), Material.WOOD, wood, Material.CABINET)]


def _shelf(rng: np.random.Generator) -> list[Box]:
    hx, hy, top = rng.uniform(0.4, 0.6), 0.15, rng.uniform(1.6, 2.1)
    return [Box((-hx, -hy, 0.0), (hx, hy, top), Material.WOOD, _pick(WOOD_COLORS, rng),
                Material.BOOKS)]  # fmt: skip


def _sofa(rng: np.random.Generator) -> list[Box]:
    hx, hy = rng.uniform(0.7, 0.95), 0.42
    color = _pick(FABRIC_COLORS, rng)
    cushion = _pick(FABRIC_COLORS, rng)
    return [
        Box((-hx, -hy, 0.06), (hx, hy, 0.43), Material.FABRIC, color),
        Box((-hx, -hy, 0.43), (hx, -hy + 0.2, 0.82), Material.FABRIC, color),
        Box((-hx, -hy + 0.2, 0.43), (-hx + 0.16, hy, 0.6), Material.FABRIC, color),
        Box((hx - 0.16, -hy + 0.2, 0.43), (hx, hy, 0.6), Material.FABRIC, color),
        Box((-hx + 0.22, -hy + 0.2, 0.43), (-hx + 0.62, -hy + 0.34, 0.74), Material.PICTURE,
            cushion),
    ]  # fmt: skip


def _bed(rng: np.random.Generator) -> list[Box]:
    hx, hy = rng.uniform(0.45, 0.6), 1.0
    wood = _pick(WOOD_COLORS, rng)
    return [
        Box((-hx, -hy, 0.0), (hx, hy, 0.3), Material.WOOD, wood),
        Box((-hx + 0.02, -hy + 0.06, 0.3), (hx - 0.02, hy - 0.02, 0.5), Material.FABRIC,
            _pick(FABRIC_COLORS, rng)),
        Box((-hx, -hy, 0.3), (hx, -hy + 0.06, 0.95), Material.WOOD, wood),
        Box((-0.3, -hy + 0.1, 0.5), (0.3, -hy + 0.5, 0.6), Material.PICTURE, WHITE),
    ]  # fmt: skip


def _chair(rng: np.random.Generator) -> list[Box]:
    half = 0.22
    wood = _pick(WOOD_COLORS, rng)
    return [
        *_legs(half, half, 0.44, wood),
        Box((-half, -half, 0.44), (half, half, 0.48), Material.FABRIC, _pick(FABRIC_COLORS, rng)),
        Box((-half, -half, 0.48), (half, -half + 0.04, 0.92), Material.WOOD, wood),
    ]


def _cartons(rng: np.random.Generator) -> list[Box]:
    boxes, top, half = [], 0.0, 0.3
    for _ in range(int(rng.integers(1, 4))):
        size = (rng.uniform(0.18, half), rng.uniform(0.16, 0.25))
        height = rng.uniform(0.22, 0.4)
        low, high = (-size[0], -size[1], top), (size[0], size[1], top + height)
        boxes.append(Box(low, high, Material.CARDBOARD, CARDBOARD))
        top, half = top + height, size[0]
    return boxes


_AT_WALL: tuple[Callable[[np.random.Generator], list[Box]], ...] = (
    _cabinet, _shelf, _sofa, _desk, _wardrobe, _bed, _chair, _cartons, _shelf, _cabinet, _chair,
)  # fmt: skip
_CENTRAL: tuple[Callable[[np.random.Generator], list[Box]], ...] = (_table, _low_table)


def add_hangings(
    ends: Float[np.ndarray, "n 2 2"],
    rooms: Int[np.ndarray, " n"],
    is_outer: Bool[np.ndarray, " n"],
    options: BuildingOptions,
    collector: Collector,
    rng: np.random.Generator,
) -> None:
    """Thin boxes in front of faces of walls (m, the free side on the left of the way from the first end to
    the second), none over another; windows where nothing but the outside is behind."""
    lengths = segments.lengths(ends)
    normals = segments.left_normals(ends)
    for i in range(len(ends)):
        yaw = float(np.arctan2(-normals[i, 0], normals[i, 1]))
        count = rng.poisson(options.pictures_per_wall * lengths[i] / 4.0)
        slots = np.linspace(0.12, lengths[i] - 0.12, count + 1)
        for low, high in pairwise(slots):
            boxes = _hanging(bool(is_outer[i]), options.door_height_m, rng)
            half = boxes[0].high[0]
            if high - low < 2 * half + 0.1:
                continue
            at = rng.uniform(low + half, high - half) / lengths[i]
            place = ends[i, 0] * (1 - at) + ends[i, 1] * at
            for box in boxes:
                add_box(box, (float(place[0]), float(place[1])), yaw, int(rooms[i]), collector)


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

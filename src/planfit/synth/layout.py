"""Where the rooms are, and which doors join them."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from planfit.priors import SLAB_THICKNESS_M, STAIR_WIDTH_M
from planfit.synth.options import WALKWAY_M, BuildingOptions
from planfit.synth.quads import METAL, WHITE, Box, Color, Material, Rect

LANDING_M = 1.6
"""Depth of the landing that the door to the storey is on."""
HALF_LANDING_M = 1.2
FLIGHT_M = STAIR_WIDTH_M.value
GAP_M = 0.1
"""Width of a flight, and between the two."""
N_TREADS, TREAD_M = 8, 0.27
"""Of each flight; the last step up is onto a landing."""
_SLAB_M = SLAB_THICKNESS_M.low


@dataclass(frozen=True)
class Stairs:
    """Where the stairs are, building frame, m. The first flight goes up on the left of the landing."""

    well: Rect
    """The whole stairwell."""
    rise_m: float
    """From storey to storey."""

    @property
    def landing(self) -> Rect:
        """At the height of each storey."""
        return replace(self.well, y1=self.well.y0 + LANDING_M)

    @property
    def steps(self) -> Rect:
        """What is not the landing."""
        return replace(self.well, y0=self.well.y0 + LANDING_M)

    @property
    def foot(self) -> Float[np.ndarray, "2"]:
        """Where one stands to go up."""
        return np.array([self.well.x0 + FLIGHT_M / 2, self.well.y0 + LANDING_M / 2])

    @property
    def head(self) -> Float[np.ndarray, "2"]:
        """Where one arrives from below."""
        return np.array([self.well.x1 - FLIGHT_M / 2, self.well.y0 + LANDING_M / 2])

    @property
    def way_up(self) -> Float[np.ndarray, "8 3"]:
        """Corners of the way from the foot to the head on the storey above, the floor below being 0."""
        near = self.steps.y0
        far = near + N_TREADS * TREAD_M
        turn = far + HALF_LANDING_M / 2
        (x0, y0), (x1, y1) = self.foot, self.head
        half, full = self.rise_m / 2, self.rise_m
        return np.array([(x0, y0, 0), (x0, near, 0), (x0, far, half), (x0, turn, half), (x1, turn, half),
                         (x1, far, half), (x1, near, full), (x1, y1, full)])  # fmt: skip

    def boxes(self) -> list[Box]:
        """Steps and half-landing from a storey to the next, the floor below being 0."""
        riser = self.rise_m / 2 / (N_TREADS + 1)
        near, far = self.steps.y0, self.steps.y0 + N_TREADS * TREAD_M
        boxes = []
        for k in range(N_TREADS):
            top, color = (k + 1) * riser, _COLORS[k % 2]
            y = near + k * TREAD_M
            low = max(0.0, top - riser - _SLAB_M)
            boxes.append(Box((self.well.x0, y, low), (self.well.x0 + FLIGHT_M, y + TREAD_M, top),
                             Material.TILES, color))  # fmt: skip
            y, top = far - (k + 1) * TREAD_M, top + self.rise_m / 2
            boxes.append(Box((self.well.x1 - FLIGHT_M, y, top - riser - _SLAB_M),
                             (self.well.x1, y + TREAD_M, top), Material.TILES, color))  # fmt: skip
        half = self.rise_m / 2
        boxes.append(Box((self.well.x0, far, half - _SLAB_M), (self.well.x1, self.well.y1, half),
                         Material.TILES, METAL))  # fmt: skip
        return boxes


_COLORS: tuple[Color, Color] = (METAL, WHITE)


def make_stairs(x1: float, y0: float, rise_m: float) -> Stairs:
    """Stairs whose well ends at x1 and begins at y0, m, building frame."""
    width = 2 * FLIGHT_M + GAP_M
    depth = LANDING_M + N_TREADS * TREAD_M + HALF_LANDING_M
    return Stairs(Rect(x1 - width, y0, x1, y0 + depth), rise_m)


@dataclass(frozen=True)
class Door:
    """An opening through a wall."""

    rect: Rect
    """The hole in the wall, seen from above."""
    is_across_x: bool
    """Whether one walks through it along x."""
    rooms: tuple[int, int]


@dataclass(frozen=True)
class BuildingLayout:
    """Rooms, doors and columns, seen from above, building frame."""

    rooms: tuple[Rect, ...]
    doors: tuple[Door, ...]
    columns: tuple[Rect, ...]
    corridor: int | None
    """Which room is the corridor."""
    stairs: Stairs | None = None
    """In the last room, which is the stairwell."""


DOOR_TO_CORNER_M = 0.25
SLAB_M = SLAB_THICKNESS_M.high
"""Thickness of the floors between storeys, m."""
EXTRA_DOOR_SHARE = 0.35
"""Share of the neighbouring rooms, not needed to reach every room, that get a door too. From 4 rooms on there
is at least one such door, so that walks can go in circles."""


def make_layout(options: BuildingOptions, rng: np.random.Generator) -> BuildingLayout:
    """Rows of rooms with ragged ends, about a corridor where there is one."""
    corridor = None
    if options.is_open_plan:
        rooms = [_open_plan(options, rng)]
    elif options.same_rooms:
        return _same_rooms(options, rng)
    else:
        rooms, corridor = _rows_of_rooms(options, rng)
    doors = _make_doors(rooms, corridor, options, rng)
    return BuildingLayout(
        tuple(rooms), tuple(doors), tuple(_make_columns(rooms, doors, options, rng)), corridor
    )


def _open_plan(options: BuildingOptions, rng: np.random.Generator) -> Rect:
    if options.open_plan_size_m is not None:
        return Rect(0.0, 0.0, *options.open_plan_size_m)
    side = float(np.mean(options.room_size_m)) * np.sqrt(options.n_rooms)
    aspect = np.sqrt(rng.uniform(1.0, 1.6))
    return Rect(0.0, 0.0, side * aspect, side / aspect)


def _rows_of_rooms(
    options: BuildingOptions, rng: np.random.Generator
) -> tuple[list[Rect], int | None]:
    has_corridor = options.has_corridor and options.n_rooms >= 4
    n_plain = options.n_rooms - has_corridor
    n_rows = 2 if has_corridor else max(1, round(np.sqrt(n_plain) / 1.2))
    counts = [len(part) for part in np.array_split(np.arange(n_plain), n_rows)]
    rooms: list[Rect] = []
    corridor, corridor_y, y = None, 0.0, 0.0
    for row, count in enumerate(counts):
        depth = rng.uniform(*options.room_size_m)
        x = 0.0
        for _ in range(count):
            width = rng.uniform(*options.room_size_m)
            rooms.append(Rect(x, y, x + width, y + depth))
            x += width + rng.uniform(*options.wall_thickness_m)
        y += depth + rng.uniform(*options.wall_thickness_m)
        if has_corridor and row == 0:
            corridor, corridor_y = len(rooms), y
            rooms.append(Rect(0.0, y, 0.0, y + options.corridor_width_m))  # length follows below
            y += options.corridor_width_m + rng.uniform(*options.wall_thickness_m)
    if corridor is not None:
        end = max(room.x1 for room in rooms)
        rooms[corridor] = Rect(0.0, corridor_y, end, corridor_y + options.corridor_width_m)
    return rooms, corridor


def _same_rooms(options: BuildingOptions, rng: np.random.Generator) -> BuildingLayout:
    """Two rows of equal rooms with their doors to the corridor between; one row is the other, turned."""
    width, depth = (float(v) for v in rng.uniform(*options.room_size_m, size=2))
    wall = float(rng.uniform(*options.wall_thickness_m))
    margin = options.door_width_m / 2 + DOOR_TO_CORNER_M
    at = float(rng.uniform(margin, width - margin))
    half = options.door_width_m / 2
    n_low = options.n_rooms // 2
    n_high = options.n_rooms - 1 - n_low
    corridor_y = depth + wall
    high_y = corridor_y + options.corridor_width_m + wall
    rooms, doors = [], []
    for k in range(n_low):
        x = k * (width + wall)
        rooms.append(Rect(x, 0.0, x + width, depth))
        doors.append(Door(Rect(x + at - half, depth, x + at + half, corridor_y), False, (k, n_low)))
    end = max(n_low, n_high) * (width + wall) - wall
    rooms.append(Rect(0.0, corridor_y, end, corridor_y + options.corridor_width_m))
    for k in range(n_high):
        x = k * (width + wall)
        rooms.append(Rect(x, high_y, x + width, high_y + depth))
        hole = Rect(x + width - at - half, high_y - wall, x + width - at + half, high_y)
        doors.append(Door(hole, False, (n_low, n_low + 1 + k)))
    return BuildingLayout(tuple(rooms), tuple(doors), (), n_low)


def with_stairwell(layout: BuildingLayout, options: BuildingOptions) -> BuildingLayout:
    """The layout with a stairwell beside room 0, and a door between."""
    wall = float(np.mean(options.wall_thickness_m))
    corner = layout.rooms[0]
    stairs = make_stairs(corner.x0 - wall, corner.y0, options.height_m + SLAB_M)
    at, half = float(stairs.foot[1]), options.door_width_m / 2
    hole = Rect(stairs.well.x1, at - half, corner.x0, at + half)
    door = Door(hole, True, (0, len(layout.rooms)))
    return replace(
        layout,
        rooms=(*layout.rooms, stairs.well),
        doors=(*layout.doors, door),
        stairs=stairs,
    )


def _make_doors(
    rooms: list[Rect], corridor: int | None, options: BuildingOptions, rng: np.random.Generator
) -> list[Door]:
    """A tree of doors to reach every room, and some more so that there are circles."""
    candidates = []
    for a in range(len(rooms)):
        for b in range(a + 1, len(rooms)):
            door = _door_between(rooms, (a, b), options, rng)
            if door is not None:
                candidates.append(door)
    # Doors to the corridor come first into the tree: rooms open onto it where they can.
    order = rng.permutation(len(candidates))
    order = sorted(order, key=lambda i: corridor not in candidates[i].rooms)
    group = list(range(len(rooms)))
    doors, spare = [], []
    for i in order:
        a, b = (group[r] for r in candidates[i].rooms)
        if a == b:
            spare.append(candidates[i])
        else:
            doors.append(candidates[i])
            group = [a if g == b else g for g in group]
    n_extra = round(EXTRA_DOOR_SHARE * len(spare))
    if len(rooms) >= 4:
        n_extra = max(n_extra, 1)
    return doors + spare[:n_extra]


def _door_between(
    rooms: list[Rect], pair: tuple[int, int], options: BuildingOptions, rng: np.random.Generator
) -> Door | None:
    """A door through the wall between two rooms, or none where they do not share enough wall."""
    a, b = rooms[pair[0]], rooms[pair[1]]
    thickest = options.wall_thickness_m[1] + 1e-9
    half = options.door_width_m / 2
    margin = half + DOOR_TO_CORNER_M
    if 0 < b.x0 - a.x1 <= thickest:
        low, high = max(a.y0, b.y0) + margin, min(a.y1, b.y1) - margin
        if low > high:
            return None
        at = rng.uniform(low, high)
        return Door(Rect(a.x1, at - half, b.x0, at + half), True, pair)
    if 0 < b.y0 - a.y1 <= thickest:
        low, high = max(a.x0, b.x0) + margin, min(a.x1, b.x1) - margin
        if low > high:
            return None
        at = rng.uniform(low, high)
        return Door(Rect(at - half, a.y1, at + half, b.y0), False, pair)
    return None


def _make_columns(
    rooms: list[Rect], doors: list[Door], options: BuildingOptions, rng: np.random.Generator
) -> list[Rect]:
    room = max(rooms, key=lambda r: r.area)
    columns: list[Rect] = []
    half = 0.2
    for _ in range(options.n_columns):
        for _ in range(50):
            room_to_wall = half + WALKWAY_M
            low = np.array([room.x0, room.y0]) + room_to_wall
            high = np.array([room.x1, room.y1]) - room_to_wall
            if (low >= high).any():
                break
            x, y = rng.uniform(low, high)
            column = Rect(x - half, y - half, x + half, y + half)
            blocked = [*columns, *(door.rect for door in doors)]
            if not any(column.grown(WALKWAY_M).overlaps(other) for other in blocked):
                columns.append(column)
                break
    return columns

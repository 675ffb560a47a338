"""The synthetic building: walls, openings and furniture, all made from options and a generator."""

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.errors import OptionError
from planfit.floorplan import Floorplan, nearest_faces
from planfit.geometry import se3, segments
from planfit.synth.furniture import Piece, furnish, standing
from planfit.synth.layout import BuildingLayout, make_layout, with_stairwell
from planfit.synth.lookalikes import Poster, copy_room, leaves_of_layout, place_posters
from planfit.synth.options import OUTER_WALL_M, BuildingOptions
from planfit.synth.quads import Rect


class Part(IntEnum):
    """How high a face reaches."""

    FULL = 0
    """Floor to ceiling."""
    LINTEL = 1
    """Top of a door to the ceiling; not in the plan."""
    JAMB = 2
    """Floor to the top of a door: the inside of the opening."""


@dataclass(frozen=True)
class WallFaces:
    """Faces in the building frame; columns have faces like walls."""

    ends: Float[np.ndarray, "n 2 2"]
    """M, the free side is on the left of the way from the first end to the second."""
    parts: Int[np.ndarray, " n"]
    """Values of `Part`."""
    rooms: Int[np.ndarray, " n"]
    """Room that the face looks into; -1 for the outside, -2 for a door opening."""
    is_column: Bool[np.ndarray, " n"]
    """Whether the face is of a column."""


OUTSIDE, OPENING, _SOLID = -1, -2, -3


def wall_faces(layout: BuildingLayout, outer_thickness: float) -> WallFaces:
    """Everything within `outer_thickness` m of a room, and in no room, is wall."""
    rects = [*layout.rooms, *layout.columns, *(d.rect for d in layout.doors)]
    grown = [room.grown(outer_thickness) for room in layout.rooms]
    x = _cuts([v for r in [*rects, *grown] for v in (r.x0, r.x1)], outer_thickness)
    y = _cuts([v for r in [*rects, *grown] for v in (r.y0, r.y1)], outer_thickness)
    space, is_column = _classify(layout, grown, x, y)
    runs: dict[tuple[int, ...], list[tuple[float, float]]] = {}
    for axis in (0, 1):
        for facing in (1, -1):
            _collect(runs, space, is_column, (x, y), axis, facing)
    ends, keys = [], []
    for key, intervals in sorted(runs.items()):
        for low, high in _joined(intervals):
            ends.append(_ends(key, low, high, (x, y)))
            keys.append(key[3:])
    table = np.array(keys)
    return WallFaces(np.array(ends), table[:, 0], table[:, 1], table[:, 2].astype(bool))


_SAME_M = 1e-9


def _cuts(values: list[float], margin: float) -> Float[np.ndarray, " n"]:
    """Sorted distinct coordinates, with a border of free cells around; those that only rounding parts are
    one, as faces between them would have no length."""
    inner = np.unique(values)
    inner = inner[np.diff(inner, prepend=-np.inf) > _SAME_M]
    return np.concatenate([[inner[0] - margin], inner, [inner[-1] + margin]])


def _classify(
    layout: BuildingLayout,
    grown: list[Rect],
    x: Float[np.ndarray, " a"],
    y: Float[np.ndarray, " b"],
) -> tuple[Int[np.ndarray, "nx ny"], Bool[np.ndarray, "nx ny"]]:
    """What each cell is at the height of doors, and whether it is a column."""
    cx, cy = (x[:-1] + x[1:]) / 2, (y[:-1] + y[1:]) / 2
    centres = np.stack(np.meshgrid(cx, cy, indexing="ij"), axis=-1).reshape(-1, 2)
    space = np.full(len(centres), OUTSIDE)
    is_column = np.zeros(len(centres), dtype=bool)
    for rect in grown:
        space[rect.contains(centres)] = _SOLID
    for i, room in enumerate(layout.rooms):
        space[room.contains(centres)] = i
    for door in layout.doors:
        space[door.rect.contains(centres)] = OPENING
    for column in layout.columns:
        inside = column.contains(centres)
        space[inside], is_column[inside] = _SOLID, True
    shape = (len(cx), len(cy))
    return space.reshape(shape), is_column.reshape(shape)


def _collect(
    runs: dict[tuple[int, ...], list[tuple[float, float]]],
    space: Int[np.ndarray, "nx ny"],
    is_column: Bool[np.ndarray, "nx ny"],
    cuts: tuple[Float[np.ndarray, " a"], Float[np.ndarray, " b"]],
    axis: int,
    facing: int,
) -> None:
    """Add parts of faces with the normal `facing` along `axis`, keyed by the line they lie on."""
    cells, column = (space, is_column) if axis == 0 else (space.T, is_column.T)
    along = cuts[1 - axis]
    behind, front = (cells[:-1], cells[1:]) if facing > 0 else (cells[1:], cells[:-1])
    column_behind = column[:-1] if facing > 0 else column[1:]
    is_face, is_lintel = (behind == _SOLID) & (front != _SOLID), (behind == OPENING) & (front >= 0)
    part = np.where(is_lintel, Part.LINTEL, np.where(front == OPENING, Part.JAMB, Part.FULL))
    for line, j in np.argwhere(is_face | is_lintel):
        of = (part[line, j], front[line, j], column_behind[line, j])
        key = tuple(int(k) for k in (axis, facing, line + 1, *of))
        runs.setdefault(key, []).append((float(along[j]), float(along[j + 1])))


def _joined(intervals: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Intervals that touch become one."""
    result: list[tuple[float, float]] = []
    for low, high in sorted(intervals):
        if result and low <= result[-1][1]:
            result[-1] = (result[-1][0], high)
        else:
            result.append((low, high))
    return result


def _ends(
    key: tuple[int, ...],
    low: float,
    high: float,
    cuts: tuple[Float[np.ndarray, " a"], Float[np.ndarray, " b"]],
) -> list[list[float]]:
    axis, facing, line = key[:3]
    at = float(cuts[axis][line])
    # Left of the way +y is -x, and left of +x is +y.
    goes_up = (facing < 0) if axis == 0 else (facing > 0)
    first, second = (low, high) if goes_up else (high, low)
    return [[at, first], [at, second]] if axis == 0 else [[first, at], [second, at]]


@dataclass(frozen=True)
class Building:
    """A one-storey building, or one storey, in its own frame: walls along x and y, z up, floor at z = 0, m.

    The plan frame is this one rotated by `BuildingOptions.yaw_deg` about z.
    """

    options: BuildingOptions
    layout: BuildingLayout
    faces: WallFaces
    furniture: tuple[Piece, ...]
    """Doors that stand open, too."""
    posters: tuple[Poster, ...] = ()

    @cached_property
    def plan_from_building(self) -> Float[np.ndarray, "4 4"]:
        """Rotation about z."""
        return se3.yaw_transform(np.deg2rad(self.options.yaw_deg))

    @cached_property
    def floorplan(self) -> Floorplan:
        """The true plan: faces with gaps at doors, the insides of door openings, columns."""
        is_drawn = self.faces.parts != Part.LINTEL
        rotation = self.plan_from_building[:2, :2]
        ends = self.faces.ends[is_drawn] @ rotation.T
        return Floorplan(
            "synthetic plan", ends, segments.left_normals(ends), np.ones(len(ends), dtype=bool)
        )

    @property
    def rooms(self) -> tuple[Rect, ...]:
        """Clear of walls."""
        return self.layout.rooms

    @property
    def bounds(self) -> Rect:
        """Around all rooms."""
        rooms = self.layout.rooms
        return Rect(
            min(r.x0 for r in rooms),
            min(r.y0 for r in rooms),
            max(r.x1 for r in rooms),
            max(r.y1 for r in rooms),
        )

    @property
    def walls_of_rooms(self) -> tuple[Float[np.ndarray, "n 2 2"], Int[np.ndarray, " n"]]:
        """Faces that things hang on, and the room of each; none of a stairwell: steps would hide them, or cut
        them in two."""
        faces = self.faces
        is_wall = (faces.parts == Part.FULL) & (faces.rooms >= 0) & ~faces.is_column
        if self.layout.stairs is not None:
            is_wall &= faces.rooms != len(self.layout.rooms) - 1
        return faces.ends[is_wall], faces.rooms[is_wall]

    def inwards(self, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Directions towards the middle of the room, shorter near it; 0 in doors."""
        result = np.zeros_like(xy)
        for room in self.layout.rooms:
            away = room.centre - xy
            distance = np.linalg.norm(away, axis=1, keepdims=True)
            inside = room.contains(xy)
            result[inside] = (away / np.maximum(distance, 0.8))[inside]
        return result

    def clearance(self, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Distances, m, from points, building frame, to walls, columns and furniture.

        0 in walls, furniture and outside the building.
        """
        is_low = self.faces.parts != Part.LINTEL
        distance = nearest_faces.nearest_distance(xy, self.faces.ends[is_low])
        for piece in self.furniture:
            distance = np.minimum(distance, piece.footprint.distance(xy))
        free = np.zeros(len(xy), dtype=bool)
        # Doors reach into both rooms by a hair, so that their thresholds are inside.
        for rect in (*self.layout.rooms, *(d.rect.grown(1e-6) for d in self.layout.doors)):
            free |= rect.contains(xy)
        if self.layout.stairs is not None:
            steps = standing(self.layout.stairs.steps)
            distance = np.minimum(distance, steps.distance(xy))
        for column in self.layout.columns:
            free &= ~column.contains(xy)
        return np.where(free, distance, 0.0)


def make_building(options: BuildingOptions, rng: np.random.Generator) -> Building:
    """Make a building of one storey; the same options and generator state give the same one.

    Raises:
        OptionError: no layout with these sizes has doors to every room, or it has more storeys.
    """
    if options.n_storeys > 1:
        raise OptionError(
            f"n_storeys: expected a building of one storey here, found {options.n_storeys}; "
            "use make_storeys or make_scan"
        )
    return make_storey(options, rng)


def make_storey(options: BuildingOptions, rng: np.random.Generator) -> Building:
    """Make one storey, with a stairwell where the building has more.

    Raises:
        OptionError: no layout with these sizes has doors to every room.
    """
    for _ in range(20):
        layout = make_layout(options, rng)
        if _all_reachable(layout):
            break
    else:
        raise OptionError(
            "room_size_m: expected rooms that share enough wall for a door with their neighbours, "
            f"found none in 20 layouts of {options.n_rooms} rooms; raise the smallest size "
            f"({options.room_size_m[0]:g} m) or make doors narrower ({options.door_width_m:g} m)"
        )
    if options.n_storeys > 1:
        layout = with_stairwell(layout, options)
    faces = wall_faces(layout, OUTER_WALL_M)
    furniture = tuple(furnish(layout, options, rng))
    if options.refurnished:
        # From a stream of its own: what is drawn after the furniture stays as it was.
        anew = rng.spawn(options.refurnished)[-1]
        furniture = tuple(furnish(layout, options, anew))
    if options.same_doors:
        furniture += leaves_of_layout(layout, options.door_height_m, rng)
    if options.same_rooms:
        own = tuple(piece for piece in furniture if piece.room in (0, layout.corridor))
        furniture = own
        for room in copied_rooms(layout):
            furniture += copy_room(own, layout, room)
    building = Building(options, layout, faces, furniture)
    posters = place_posters(options.same_posters, *building.walls_of_rooms, building.clearance, rng)
    return replace(building, posters=posters)


def copied_rooms(layout: BuildingLayout) -> list[int]:
    """Rooms that look like room 0 where all rooms look alike."""
    return [room for room in range(1, len(layout.rooms)) if room != layout.corridor]


def _all_reachable(layout: BuildingLayout) -> bool:
    reached = {0}
    for _ in layout.rooms:
        for door in layout.doors:
            if reached & set(door.rooms):
                reached |= set(door.rooms)
    return len(reached) == len(layout.rooms)


def facap_segments(floorplan: Floorplan) -> Float[np.ndarray, "n 4"]:
    """Bare segments, m, for `floorplan.npy` (FACaP layout): plan (x, y) becomes (x, -y)."""
    return (floorplan.ends * (1.0, -1.0)).reshape(-1, 4)

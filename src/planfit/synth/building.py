"""The synthetic building: walls, openings and furniture, all made from options and a generator."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import OptionError
from planfit.floorplan import Floorplan, nearest_faces
from planfit.geometry import se3, segments
from planfit.synth.furniture import Piece, furnish, standing
from planfit.synth.layout import BuildingLayout, make_layout, with_stairwell
from planfit.synth.lookalikes import Poster, copy_room, leaves_of_layout, place_posters
from planfit.synth.options import OUTER_WALL_M, BuildingOptions
from planfit.synth.quads import Rect
from planfit.synth.walls import Part, WallFaces, wall_faces


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

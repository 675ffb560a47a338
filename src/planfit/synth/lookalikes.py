"""What looks alike in several places: posters, doors, whole rooms. Places where matching goes wrong."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import OptionError
from planfit.geometry import segments
from planfit.priors import DOOR_LEAF_THICKNESS_M
from planfit.synth.furniture import Footprint, Piece
from planfit.synth.layout import BuildingLayout
from planfit.synth.quads import FABRIC_COLORS, WHITE, WOOD_COLORS, Box, Material

NEAREST_M, FURTHEST_M = 5.0, 20.0
"""Two posters are further apart than the first, and each is nearer than the second to another."""
POSTER_SIZE_M = (0.9, 0.7)
LEAF_THICKNESS_M = DOOR_LEAF_THICKNESS_M.low

Clearance = Callable[[Float[np.ndarray, "n 2"]], Float[np.ndarray, " n"]]
"""Distances, m, from points to all that stands in the way."""


@dataclass(frozen=True)
class Poster:
    """A poster on a wall, building frame."""

    place: tuple[float, float]
    """Middle of its lower edge, m."""
    yaw: float
    """Of the way along the wall, the room on the left, rad."""
    room: int
    """Index of the room."""
    seed: int
    """Of its picture: posters of one seed are the same picture."""

    @property
    def box(self) -> Box:
        """In the frame of the poster: x along the wall, y into the room."""
        half, height = POSTER_SIZE_M[0] / 2, POSTER_SIZE_M[1]
        # Thicker than pictures, so that it covers what it hangs over.
        return Box((-half, 0.0, 1.1), (half, 0.03, 1.1 + height), Material.PAINT,
                   FABRIC_COLORS[1], Material.PICTURE)  # fmt: skip


def place_posters(
    count: int,
    ends: Float[np.ndarray, "n 2 2"],
    rooms: Int[np.ndarray, " n"],
    clearance: Clearance,
    rng: np.random.Generator,
) -> tuple[Poster, ...]:
    """Hang the same poster at so many places on faces of walls (m, the free side on the left), not behind
    furniture.

    Raises:
        OptionError: the building has not so many places 5 to 20 m apart.
    """
    if count == 0:
        return ()
    places, face = segments.sample(ends, 0.5)
    along, left = segments.directions(ends)[face], segments.left_normals(ends)[face]
    to_ends = np.linalg.norm(ends[face] - places[:, None], axis=-1).min(axis=1)
    is_seen = (to_ends > POSTER_SIZE_M[0] / 2 + 0.1) & (clearance(places + 0.6 * left) > 0.3)
    order = np.flatnonzero(is_seen)[rng.permutation(int(is_seen.sum()))]
    chosen: list[int] = []
    for _ in range(count):
        # The first in random order that is far enough from all, and not too far from the nearest.
        gaps = [np.linalg.norm(places[order] - places[c], axis=1) for c in chosen]
        nearest = np.min(gaps, axis=0) if chosen else np.full(len(order), NEAREST_M)
        fits = np.flatnonzero((nearest >= NEAREST_M) & (nearest <= FURTHEST_M))
        if len(fits) == 0:
            raise OptionError(
                f"same_posters: expected {count} free places on walls, {NEAREST_M:g} m or more apart, "
                f"found {len(chosen)}; ask for fewer posters, or for a larger building"
            )
        chosen.append(int(order[fits[0]]))
    seed = int(rng.integers(2**63))
    yaws = np.arctan2(along[:, 1], along[:, 0])
    return tuple(
        Poster(
            (float(places[c, 0]), float(places[c, 1])), float(yaws[c]), int(rooms[face[c]]), seed
        )
        for c in chosen
    )


def door_leaf(
    hinge: Float[np.ndarray, "2"],
    into: Float[np.ndarray, "2"],
    width_m: float,
    height_m: float,
    room: int,
    seed: int,
) -> Piece:
    """A door that stands open at a right angle to its wall, with a notice on both sides.

    It hangs at `hinge` (m, building frame) and reaches into the room along the unit vector `into`."""
    half, thick = width_m / 2, LEAF_THICKNESS_M / 2
    wood = WOOD_COLORS[2]
    leaf = Box(
        (-half, -thick, 0.01), (half, thick, height_m), Material.WOOD, wood, Material.CABINET
    )
    notices = [
        Box((-0.2, *y), (0.2, *z), Material.NOTES, WHITE)
        for y, z in (((thick, 1.15), (thick + 0.01, 1.7)), ((-thick - 0.01, 1.15), (-thick, 1.7)))
    ]
    centre = hinge + half * into
    yaw = float(np.arctan2(into[1], into[0]))
    footprint = Footprint((float(centre[0]), float(centre[1])), (half, thick + 0.01), yaw)
    return Piece(footprint, (leaf, *notices), room, seed)


def leaves_of_layout(
    layout: BuildingLayout, height_m: float, rng: np.random.Generator
) -> tuple[Piece, ...]:
    """The same leaf at every door; doors of a corridor open into the rooms."""
    seed = int(rng.integers(2**63))
    leaves = []
    for door in layout.doors:
        rect, axis = door.rect, 0 if door.is_across_x else 1
        room = max(door.rooms) if door.rooms[0] == layout.corridor else min(door.rooms)
        into = np.eye(2)[axis] * np.sign(layout.rooms[room].centre - rect.centre)[axis]
        width = rect.size[1 - axis]
        wall = rect.centre + rect.size[axis] / 2 * into
        # Hung on the left, seen from the room, a hair out of the way through the door.
        left = np.array([into[1], -into[0]])
        hinge = wall + (width / 2 + LEAF_THICKNESS_M) * left + 0.02 * into
        leaves.append(door_leaf(hinge, into, width - 0.1, height_m - 0.02, room, seed))
    return tuple(leaves)


def copy_room(pieces: tuple[Piece, ...], layout: BuildingLayout, copy: int) -> tuple[Piece, ...]:
    """The furniture of room 0 as it stands in another of the same size, see `turn_to`."""
    turned, (x, y) = turn_to(layout, copy)
    sign = -1.0 if turned else 1.0
    here = layout.rooms[0].centre
    copies = []
    for piece in pieces:
        if piece.room == 0:
            cx, cy = sign * (np.array(piece.footprint.centre) - here)
            footprint = replace(
                piece.footprint,
                centre=(float(x + cx), float(y + cy)),
                yaw=piece.footprint.yaw + (np.pi if turned else 0.0),
            )
            copies.append(replace(piece, footprint=footprint, room=copy))
    return tuple(copies)


def turn_to(layout: BuildingLayout, copy: int) -> tuple[bool, Float[np.ndarray, "2"]]:
    """Whether a room is turned by half a turn against room 0, which is like it, as the door to the corridor
    must be on the other side, and where its centre is, m."""
    assert layout.corridor is not None
    corridor = layout.rooms[layout.corridor].centre[1]
    side, other = (layout.rooms[room].centre[1] < corridor for room in (0, copy))
    return bool(side != other), layout.rooms[copy].centre

"""Doors of a plan, by its faces alone: gaps in walls that one can walk through."""

import numpy as np
from jaxtyping import Float

from planfit.floorplan.gaps import gaps_in_line
from planfit.geometry import segments
from planfit.priors import DOOR_LEAF_USUAL_WIDTH_M, DOOR_OPENING_M
from planfit.synth.furniture import Piece
from planfit.synth.lookalikes import LEAF_THICKNESS_M, Clearance, door_leaf
from planfit.synth.plan_walls import MAX_WALL_M, PlanWalls

DOOR_M = DOOR_OPENING_M.both
"""Narrowest and widest gap that is a door."""
_LEAF_M = DOOR_LEAF_USUAL_WIDTH_M.value
"""All leaves have one width, so that they look alike."""


def find_doors(walls: PlanWalls, clearance: Clearance) -> Float[np.ndarray, "n 2 2"]:
    """Ends of the gaps, m, along one face of their wall, whose free side is on the left.

    A gap is a door where both faces beside it lie on one line and look the same way, or where the plan marks
    an opening, and where there is free space on both sides.
    """
    faces = walls.ends[: walls.n_drawn]
    faces = faces[segments.lengths(faces) > 0.1]
    before, after = gaps_in_line(faces, DOOR_M)
    gaps = np.stack([faces[before, 1], faces[after, 0]], axis=1)
    width = segments.lengths(walls.lintels)
    marked = walls.lintels[(width > DOOR_M[0]) & (width < DOOR_M[1])]
    candidates = np.concatenate([gaps, marked, marked[:, ::-1]])
    doors: list[Float[np.ndarray, "2 2"]] = []
    for door in candidates:
        middle, normal = door.mean(axis=0), segments.left_normals(door[None])[0]
        depths = np.array([0.0, 0.4, -0.3, -0.3 - MAX_WALL_M])
        is_free = (clearance(middle + depths[:, None] * normal) > 0.25).all()
        is_new = all(np.linalg.norm(middle - d.mean(axis=0)) > MAX_WALL_M for d in doors)
        if is_free and is_new:
            doors.append(door)
    return np.array(doors).reshape(-1, 2, 2)


def hang_doors(
    walls: PlanWalls, clearance: Clearance, height_m: float, rng: np.random.Generator
) -> tuple[Piece, ...]:
    """The same leaf, open, at every door of the plan where it has room on one side."""
    seed = int(rng.integers(2**63))
    leaves = []
    for door in find_doors(walls, clearance):
        along, into = segments.directions(door[None])[0], segments.left_normals(door[None])[0]
        for hinge, aside in ((door[0], -along), (door[1], along)):
            at = hinge + LEAF_THICKNESS_M * aside + 0.02 * into
            points = at + np.linspace(0.1, _LEAF_M, 8)[:, None] * into
            if (clearance(points) > 0.05).all():
                leaves.append(door_leaf(at, into, _LEAF_M, height_m, -1, seed))
                break
    return tuple(leaves)

"""Where else a whole scan fits the plan: if other walls were moved than those taken for it, or on the other
copy of a plan that is drawn twice, as two states of a building that lie over each other on a sheet.

A scan that shows two parallel walls, one of them moved, fits the plan in two places: with either wall as
drawn and the other elsewhere. No cost of patches tells which, as all patches of a wall err alike. What tells
is how many walls stand as drawn in either place: one wall, one vote. A vote counts for less the more walls of
the plan were moved anyway.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import betaln

from planfit.adjust.association import PatchesOnPlan
from planfit.adjust.moved_walls import (
    MAX_OFFSET_M,
    MIN_OFFSET_M,
    WITHIN_M,
    wall_numbers,
)
from planfit.adjust.voting import beside_faces
from planfit.priors import WALL_MOVED_SHARE
from planfit.tracking.types import MIN_WITNESSES

SAME_SHIFT_M = 2 * WITHIN_M
"""Shifts that differ by less are one: a patch may agree with both."""
MAX_SHIFTS = 64
"""So many are tried, those that most wall patches ask for first."""
MOST_TWINS = 8
"""Distances between parallel faces that are tried, those of most patches: two of a plan drawn twice."""
TWICE_SHARE = 0.6
"""A plan is drawn twice for a scan that finds this share of its wall on faces elsewhere, too: from 0.74 on of
flats drawn twice, at most 0.44 of seven real and rendered buildings."""
ACROSS = 0.5
"""Two shifts are combined where the cosine between them is below this."""
USUALLY_MOVED, USUALLY_STANDING = 1.0, 1.0 / WALL_MOVED_SHARE.value - 1.0
"""Walls that count as seen beforehand, one of them moved."""


@dataclass(frozen=True)
class Shift:
    """The whole scan elsewhere on the plan."""

    by_m: Float[np.ndarray, " 2"]
    """How far, plan axes."""
    n_for: int
    """Walls that stand as drawn there, and do not where the scan was put."""
    n_against: int
    """Walls that stand as drawn where the scan was put, and do not there."""
    unlikeliness: float
    """Natural logarithm of the odds for where the scan was put against there, by the walls moved in each."""


def other_places(seen: PatchesOnPlan, moved_m: Float[np.ndarray, " f"]) -> tuple[Shift, ...]:
    """Shifts under which walls that were taken for moved stand as drawn, the best supported first.

    Args:
        seen: patches of wall where the adjustment ended, on the plan as drawn.
        moved_m: offset (m) of each face that was taken for moved, NaN for those as drawn.
    """
    floorplan = seen.floorplan
    moved = np.flatnonzero(np.isfinite(moved_m))
    if len(moved) == 0 or len(seen.patches) == 0:
        return ()
    patch, face, distance_m = beside_faces(seen, 1.5 * MAX_OFFSET_M)
    shifts = _tried(-moved_m[moved, None] * floorplan.normals[moved])
    held = _held(patch, face, distance_m, shifts, floorplan.normals)
    as_drawn = np.stack([np.bincount(f[f >= 0], minlength=len(floorplan)) for f in held])
    as_drawn = as_drawn >= MIN_WITNESSES
    is_moved = np.isfinite(moved_m)
    faces = np.flatnonzero(as_drawn.any(axis=0) | is_moved)
    wall_of_face = wall_numbers(faces, floorplan)
    # A wall stands as drawn where a face of it does and none is seen elsewhere: one side of what stands
    # behind a pane may come to lie on a face of it, but not both.
    off_m = np.where(is_moved, moved_m, np.where(as_drawn[0], 0.0, np.nan))
    is_off = np.abs(off_m + shifts @ floorplan.normals.T) >= MIN_OFFSET_M
    on, off = (
        np.stack([_any_face(row[faces], wall_of_face) for row in rows])
        for rows in (as_drawn, is_off)
    )
    stand = on & ~off
    # A wall that the shift runs along stands as drawn before and after: nothing of it is seen across.
    here = stand[0]
    n_moved = int((_any_face(is_moved[faces], wall_of_face) & ~here).sum())
    n_walls = n_moved + int(here.sum())
    found = []
    for by_m, there in zip(shifts[1:], stand[1:], strict=True):
        n_for, n_against = int((there & ~here).sum()), int((here & ~there).sum())
        if n_for == 0:
            continue
        n_moved_there = max(n_moved + n_against - n_for, 0)
        odds = _log_odds(n_moved, n_moved_there, n_walls)
        found.append(Shift(by_m, n_for, n_against, odds))
    return tuple(sorted(found, key=lambda shift: (shift.n_against - shift.n_for, *abs(shift.by_m))))


def on_other_copy(seen: PatchesOnPlan) -> Float[np.ndarray, " 2"] | None:
    """The shift (m) under which a scan finds nearly as much of its wall drawn again; None for none.

    Args:
        seen: patches of wall where the adjustment ended, on the plan as drawn.
    """
    if len(seen.patches) == 0:
        return None
    normals = seen.floorplan.normals
    patch, face, distance_m = beside_faces(seen, 1.5 * MAX_OFFSET_M)
    is_apart = np.abs(distance_m) >= SAME_SHIFT_M
    wanted = -distance_m[is_apart, None] * normals[face[is_apart]]
    cells = np.round(wanted / WITHIN_M)
    _, of, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    most = np.argsort(-counts, kind="stable")[:MOST_TWINS]
    shifts = _tried(np.array([np.median(wanted[of == one], axis=0) for one in most]).reshape(-1, 2))
    here, *there = _held(patch, face, distance_m, shifts, normals)
    n_found = np.zeros(len(shifts), dtype=int)
    for k, held in enumerate(there, start=1):
        # What a shift runs along is found before and after.
        is_moved = (here >= 0) & (np.abs(normals[here] @ shifts[k]) > SAME_SHIFT_M / 2)
        n, n_again = int(is_moved.sum()), int((is_moved & (held >= 0)).sum())
        if n >= MIN_WITNESSES and n_again >= TWICE_SHARE * n:
            n_found[k] = n_again
    return shifts[np.argmax(n_found)] if n_found.any() else None


def _log_odds(n_moved: int, n_moved_there: int, n_walls: int) -> float:
    """Logarithm of how much likelier it is that so many of the walls seen were moved than so many others.

    The share of walls that were moved is not known, but that it is of a beta distribution; integrated over.
    """
    moved = np.array([n_moved, n_moved_there])
    here, there = betaln(USUALLY_MOVED + moved, USUALLY_STANDING + n_walls - moved)
    return float(here - there)


def _tried(wanted: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "s 2"]:
    """None first, then distinct ones that moved walls ask for, and of two that stand across each other."""
    single = _distinct(wanted)
    both = [
        a + b
        for a, b in combinations(single, 2)
        if abs(a @ b) < ACROSS * np.linalg.norm(a) * np.linalg.norm(b)
    ]
    return np.stack([np.zeros(2), *_distinct([*single, *both])[:MAX_SHIFTS]])


def _distinct(shifts: Iterable[Float[np.ndarray, " 2"]]) -> list[Float[np.ndarray, " 2"]]:
    kept: list[np.ndarray] = []
    for shift in shifts:
        if all(np.linalg.norm(shift - other) > SAME_SHIFT_M for other in kept):
            kept.append(shift)
    return kept


def _held(
    patch: Int[np.ndarray, " c"],
    face: Int[np.ndarray, " c"],
    distance_m: Float[np.ndarray, " c"],
    shifts: Float[np.ndarray, "s 2"],
    normals: Float[np.ndarray, "f 2"],
) -> Int[np.ndarray, "s k"]:
    """The face that each patch lies on after each shift, the nearest; -1 where it lies on none."""
    found = np.full((len(shifts), patch.max(initial=-1) + 1), -1)
    for k, shift in enumerate(shifts):
        off_m = np.abs(distance_m + normals[face] @ shift)
        order = np.lexsort((off_m, patch))
        nearest = order[np.unique(patch[order], return_index=True)[1]]
        nearest = nearest[off_m[nearest] < WITHIN_M]
        found[k, patch[nearest]] = face[nearest]
    return found


def _any_face(is_on: Bool[np.ndarray, " k"], wall: Int[np.ndarray, " k"]) -> Bool[np.ndarray, " w"]:
    """Whether any face of each wall stands as drawn."""
    return np.bincount(wall[is_on], minlength=wall.max(initial=-1) + 1) > 0

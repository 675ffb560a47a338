"""Walls that stand elsewhere than drawn: found once poses are consistent, named with how far, and let go of.

A face stands as drawn (within centimetres), or it was moved (an offset of its own, decimetres). Its wall
patches decide which: those that no face as drawn explains, where they agree on one offset and outnumber those
that lie where the face is drawn. A robust loss alone would forget the wall, or be pulled by it where others
are few.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.adjust.association import Association, PatchesOnPlan, wall_patches_in_plan
from planfit.findings import Finding, ResultKind
from planfit.floorplan import Floorplan
from planfit.floorplan.faces import connected_groups
from planfit.floorplan.nearest_faces import distances_of_segments, share_beside
from planfit.priors import (
    DOOR_GAP_M,
    SURE_SIGMAS,
    WALL_AS_BUILT_SIGMA_M,
    WALL_AS_DRAWN_M,
    WALL_FACES_APART_M,
    WALL_MOVED_MOST_M,
    WALL_MOVED_SHARE,
    WALL_SPREAD_M,
)
from planfit.tracking.types import MIN_WITNESSES

STEP_M = 0.01
"""Offsets are tried this far apart."""
PARALLEL, SAME_MOTION_M = 0.99, 0.08
MAX_THICKNESS_M, MAX_GAP_M = WALL_FACES_APART_M.high, DOOR_GAP_M.value
"""Two faces are of one wall: cosine between their normals, how alike they were moved, how far they lie apart
across, and along (a door may be between)."""
OVERHANG_M = 0.1
"""A patch may reach beyond the end of its face by this much and still lie wholly beside it."""


MAX_OFFSET_M = WALL_MOVED_MOST_M.value
"""Wall further off its face as drawn is another wall."""
MIN_OFFSET_M = WALL_AS_DRAWN_M.value
"""A wall less far off is as drawn."""
MIN_SHARE = 0.6
"""Share of the wall seen near a face, as drawn or not, that must agree on it."""
MIN_SIGMAS = SURE_SIGMAS.value
"""An offset counts from this many of its standard deviations on: where little holds the poses that saw a
wall, they may be off as well."""
MOVED_SIGMA_M = 0.3
"""Sigma of the offset of a wall that was moved: decimetres."""
PRICE = -float(np.log(WALL_MOVED_SHARE.value * WALL_AS_BUILT_SIGMA_M.value / MOVED_SIGMA_M))
"""Cost of calling a wall moved: how seldom walls are, and how much less is known of them."""
WITHIN_M = WALL_SPREAD_M.value
"""Wall patches agree on an offset within this."""


@dataclass(frozen=True)
class MovedWall:
    """A face of the plan that stands elsewhere than drawn."""

    face_idx: int
    offset_m: float
    """Along the face's normal, which looks into the room."""
    sigma_m: float
    """Standard deviation of that."""
    n_patches: int
    """Wall patches that agree on it."""


def find_moved(
    seen: PatchesOnPlan, as_drawn: Association, known: Sequence[int] = ()
) -> Float[np.ndarray, " f"]:
    """Offset (m) of each face that was moved, NaN for those as drawn.

    Args:
        seen: patches of wall where the adjustment ended, on the plan as drawn.
        as_drawn: face of each patch among those as drawn.
        known: faces that other evidence says were moved: some of their patches that agree are enough, and
            they say nothing against the poses.
    """
    n_faces = len(seen.floorplan)
    moved_m = np.full(n_faces, np.nan)
    if len(seen.patches) == 0:
        return moved_m
    is_drawn = np.abs(np.nan_to_num(as_drawn.distance_m, nan=np.inf)) < MIN_OFFSET_M
    nearest, off = nearest_unexplained(seen, ~is_drawn)
    n_drawn = np.bincount(as_drawn.face_idx[is_drawn], minlength=n_faces)
    n_moved = 0
    grid = np.arange(-MAX_OFFSET_M, MAX_OFFSET_M + STEP_M, STEP_M)
    for face in np.unique(nearest[nearest >= 0]):
        beside = off[nearest == face]
        agree = np.abs(beside[:, None] - grid) < WITHIN_M
        at = int(np.argmax(agree.sum(axis=0)))
        mine = beside[agree[:, at]]
        offset = float(np.median(mine))
        enough = len(mine) >= MIN_WITNESSES
        most = len(mine) >= MIN_SHARE * (len(beside) + n_drawn[face])
        if enough and (most or face in known) and abs(offset) >= MIN_OFFSET_M:
            moved_m[face] = offset
            n_moved += 0 if face in known else len(mine)
    if n_moved > is_drawn.sum():  # the poses are off, not the walls
        moved_m[~np.isin(np.arange(len(moved_m)), known)] = np.nan
    return moved_m


def nearest_unexplained(
    seen: PatchesOnPlan, is_open: Bool[np.ndarray, " k"]
) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Face that each patch lies beside which none as drawn explains, and the signed distance (m) from it."""
    floorplan, reach_m, n_patches = seen.floorplan, MAX_OFFSET_M, len(seen.patches)
    normals, ends = wall_patches_in_plan(seen.patches, seen.plan_from_cams)
    nearest, off = np.full(n_patches, -1), np.full(n_patches, np.nan)
    open_idx = np.flatnonzero(is_open)
    rule = seen.rule(reach_m, open_idx)
    distance = distances_of_segments(ends[open_idx], normals[open_idx], floorplan, rule)
    # A pilaster that moved lies nearer to the line of the wall beside it; but it ends where it is drawn.
    overhang = 1.0 - np.clip(share_beside(ends[open_idx], floorplan, OVERHANG_M), 0.0, 1.0)
    score = np.where(np.isfinite(distance), np.abs(distance) + reach_m * overhang, np.inf)
    best = np.argmin(score, axis=1)
    rows = np.arange(len(open_idx))
    found = np.isfinite(score[rows, best])
    nearest[open_idx] = np.where(found, best, -1)
    off[open_idx] = np.where(found, distance[rows, best], np.nan)
    return nearest, off


def moved_wall_findings(moved: Sequence[MovedWall], floorplan: Floorplan) -> tuple[Finding, ...]:
    """Each moved wall, in the order given: where it is drawn, how far it stands off and which way.

    Both faces of a wall, and faces that go on in its line, are one wall if they were moved alike; it is named
    by the face that most patches saw.
    """
    groups: list[list[MovedWall]] = []
    for each in moved:
        own = [group for group in groups if any(_is_one(each, other, floorplan) for other in group)]
        groups = [group for group in groups if not any(group is one for one in own)]
        groups.append([*(wall for group in own for wall in group), each])
    order = {each.face_idx: k for k, each in enumerate(moved)}
    groups.sort(key=lambda group: min(order[each.face_idx] for each in group))
    return tuple(
        _finding(max(group, key=lambda each: each.n_patches), floorplan) for group in groups
    )


def _is_one(first: MovedWall, second: MovedWall, floorplan: Floorplan) -> bool:
    """Whether two faces are of one wall that was moved as a whole."""
    a, b = first.face_idx, second.face_idx
    motion = first.offset_m * floorplan.normals[a] - second.offset_m * floorplan.normals[b]
    return bool(np.linalg.norm(motion) <= SAME_MOTION_M) and is_one_wall(a, b, floorplan)


def is_one_wall(face: int, other: int, floorplan: Floorplan) -> bool:
    """Whether two faces are of one wall: its two sides, or pieces in one line with a door between."""
    normal, ends = floorplan.normals[face], floorplan.ends
    if abs(normal @ floorplan.normals[other]) < PARALLEL:
        return False
    if abs((ends[other].mean(axis=0) - ends[face, 0]) @ normal) > MAX_THICKNESS_M:
        return False
    along = np.array([-normal[1], normal[0]])
    at = np.sort((ends[[face, other]] - ends[face, 0]) @ along, axis=1)
    return bool(at[:, 0].max() - at[:, 1].min() < MAX_GAP_M)


def wall_numbers(faces: Int[np.ndarray, " k"], floorplan: Floorplan) -> Int[np.ndarray, " k"]:
    """Number of the wall that each of some faces is of, from 0."""
    alike = [
        (i, j)
        for i, j in combinations(range(len(faces)), 2)
        if is_one_wall(int(faces[i]), int(faces[j]), floorplan)
    ]
    first, second = np.array(alike, dtype=int).reshape(-1, 2).T
    return connected_groups(first, second, len(faces))


def _finding(wall: MovedWall, floorplan: Floorplan) -> Finding:
    start, end = (tuple(xy.tolist()) for xy in floorplan.ends[wall.face_idx])
    normal = tuple(floorplan.normals[wall.face_idx].tolist())
    facts = {"from_xy_m": start, "to_xy_m": end, "normal": normal, "patch_count": wall.n_patches}
    facts |= {"offset_m": wall.offset_m, "sigma_m": wall.sigma_m}
    return Finding(ResultKind.WALL_MOVED, facts, faces=(wall.face_idx,))

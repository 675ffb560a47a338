"""Openings one by one: those that the plan draws, and those of walls that it draws without."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planfit.as_built.lines_of_sight import (
    BIN_M,
    DEPTH_M,
    END_M,
    HEIGHTS_M,
    MIN_FRAMES,
    LinesOfSight,
    frames_through,
)
from planfit.as_built.look_at_opening import look_at
from planfit.as_built.new_walls import MAX_GAP_M
from planfit.as_built.openings import AsBuiltOpening
from planfit.as_built.types import AsBuilt, AsBuiltWall
from planfit.as_built.wall_offsets import PlacedWalls
from planfit.floorplan import Floorplan
from planfit.floorplan.elements import opening_element
from planfit.floorplan.gaps import (
    ASKEW_M,
    MAX_WALL_M,
    PARALLEL,
    Gap,
    find_gaps,
    gap_between,
    sides_of_gaps,
)
from planfit.geometry import segments
from planfit.pipeline.on_plan import frame_runs
from planfit.priors import DOOR_PASSED_LEAST_M

BESIDE_M = MAX_GAP_M
"""Walls that end so near to an opening, in its line, are the wall that it is in."""
MIN_NEW_M = DOOR_PASSED_LEAST_M.value
"""Width, m, that cameras look through of an opening that the plan lacks: that of the narrowest doors."""


def find_openings(
    as_built: AsBuilt, floorplan: Floorplan, placed: PlacedWalls, sight: LinesOfSight
) -> tuple[AsBuiltOpening, ...]:
    """Openings of the plan in its order, then those of walls that are drawn without.

    Args:
        as_built: verdicts on the walls: an opening moves along with its wall.
        floorplan: as drawn, m.
        placed: points of wall.
        sight: what is looked through.
    """
    drawn = find_gaps(floorplan, as_built.options.opening_widths_m)
    found = [_seen(gap, True, as_built, floorplan, placed, sight) for gap in drawn]
    for gap in _undrawn(as_built, floorplan, sight):
        if not any(_is_one_place(gap, other) for other in drawn):
            found.append(_seen(gap, False, as_built, floorplan, placed, sight))
    return tuple(found)


def _undrawn(as_built: AsBuilt, floorplan: Floorplan, sight: LinesOfSight) -> list[Gap]:
    """Parts of walls that stand, which cameras look through though no opening is drawn.

    Not of walls that are further off than cupboards are deep: a row of these may have been taken for one, and
    beside it the wall itself is seen.
    """
    walls = [
        wall
        for wall in as_built.walls
        if wall.face_idx >= 0
        and wall.is_standing
        and not wall.is_glass
        and abs(wall.offset_m) <= DEPTH_M[0]
    ]
    if not walls:
        return []
    faces = np.array([wall.face_idx for wall in walls])
    built = np.stack([wall.built_ends for wall in walls])
    normals = np.stack([wall.normal for wall in walls])
    is_turned = np.einsum("ni,ni->n", segments.left_normals(built), normals) < 0
    ends = np.where(is_turned[:, None, None], built[:, ::-1], built)
    storeys = None if floorplan.storeys is None else floorplan.storeys[faces]
    standing = Floorplan(
        "walls as built",
        ends,
        segments.left_normals(ends),
        np.ones(len(ends), dtype=bool),
        storeys=storeys,
    )
    counts = frames_through(sight, standing, HEIGHTS_M)
    sides, of_wall = [], []
    for k, n_frames in enumerate(counts):
        for low, high in frame_runs(n_frames >= MIN_FRAMES):
            at = END_M + BIN_M * np.array([low, high + 1.0])
            if at[1] - at[0] >= MIN_NEW_M - 1e-9:
                along = segments.directions(ends[k][None])[0]
                sides.append(ends[k, 0] + at[:, None] * along)
                of_wall.append(k)
    stacked = np.array(sides).reshape(-1, 2, 2)
    is_oriented = np.array([walls[k].is_oriented for k in of_wall], dtype=bool)
    # What is looked through of one face is cut off by what stands before the other: widths differ.
    differ = np.ones(len(sides), dtype=bool)
    gaps = []
    for own in sides_of_gaps(stacked, is_oriented, differ):
        storey = None if storeys is None else int(storeys[of_wall[own[0]]])
        gap, of_one = gap_between(stacked[own], storey), len(own) == 1
        gaps.append(_with_back(gap, floorplan) if of_one and is_oriented[own[0]] else gap)
    return gaps


def _with_back(gap: Gap, floorplan: Floorplan) -> Gap:
    """A gap that one face of a wall shows, to whose free side its normal points, in the middle of the wall
    whose other face is drawn behind; as it is where none is."""
    own = (
        np.arange(len(floorplan)) if floorplan.storeys is None else floorplan.storeys == gap.storey
    )
    ends, normals = floorplan.ends[own], floorplan.normals[own]
    behind_m = -(ends.mean(axis=1) - gap.ends.mean(axis=0)) @ gap.normal
    along = (gap.ends[1] - gap.ends[0]) / gap.width_m
    at = np.sort((ends - gap.ends.mean(axis=0)) @ along, axis=1)
    is_back = (normals @ gap.normal < -PARALLEL) & (at[:, 0] < 0) & (at[:, 1] > 0)
    is_back &= (behind_m > 0) & (behind_m < MAX_WALL_M)
    if not is_back.any():
        return gap
    thickness_m = float(behind_m[is_back].min())
    middle = gap.ends - thickness_m / 2 * gap.normal
    return replace(gap, ends=middle, thickness_m=thickness_m)


def _is_one_place(gap: Gap, other: Gap) -> bool:
    """Whether two gaps of one wall share some width."""
    along = (gap.ends[1] - gap.ends[0]) / gap.width_m
    across = (other.ends.mean(axis=0) - gap.ends[0]) @ gap.normal
    at = np.sort((other.ends - gap.ends[0]) @ along)
    shared = min(at[1], gap.width_m) - max(at[0], 0.0)
    return gap.storey == other.storey and abs(across) < MAX_WALL_M and shared > 0


def _seen(
    gap: Gap,
    is_drawn: bool,
    as_built: AsBuilt,
    floorplan: Floorplan,
    placed: PlacedWalls,
    sight: LinesOfSight,
) -> AsBuiltOpening:
    """What the scan says of one opening."""
    beside = [wall for wall in as_built.walls if _is_beside(wall, gap, floorplan)]
    # One that is not drawn was looked for where its wall stands.
    stands = replace(gap, ends=gap.ends + _offset_m(beside, gap) * gap.normal) if is_drawn else gap
    seen = look_at(stands, placed, sight)
    kind, element_id = opening_element(floorplan, gap) if is_drawn else ("", "")
    of_wall = next((wall.element_id for wall in beside if wall.element_id), "")
    named = element_id or of_wall
    return replace(seen, is_drawn=is_drawn, ends=gap.ends, kind=kind, element_id=named)


def _is_beside(wall: AsBuiltWall, gap: Gap, floorplan: Floorplan) -> bool:
    """Whether a face of the plan is of the wall that a gap is in."""
    if wall.face_idx < 0 or abs(wall.normal @ gap.normal) < PARALLEL:
        return False
    if floorplan.storeys is not None and floorplan.storeys[wall.face_idx] != gap.storey:
        return False
    if abs((wall.ends.mean(axis=0) - gap.ends[0]) @ gap.normal) > gap.thickness_m / 2 + ASKEW_M:
        return False
    at = np.sort((wall.ends - gap.ends[0]) @ (gap.ends[1] - gap.ends[0]) / gap.width_m)
    return bool(at[0] < gap.width_m + BESIDE_M and at[1] > -BESIDE_M)


def _offset_m(beside: Sequence[AsBuiltWall], gap: Gap) -> float:
    """How far the wall of a gap stands off where it is drawn, along the gap's normal."""
    off_m = [wall.offset_m * float(wall.normal @ gap.normal) for wall in beside if wall.is_standing]
    return float(np.median(off_m)) if off_m else 0.0

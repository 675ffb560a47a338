"""Faces of walls and door openings, from the cells that the rooms' edges cut the plan into."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.synth.layout import BuildingLayout
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


OUTSIDE, OPENING = -1, -2


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


_SOLID = -3
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

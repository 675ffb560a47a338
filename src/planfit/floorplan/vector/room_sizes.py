"""Sizes written in rooms (`3.60 x 4.20`, `18'8" x 11'`) against the rooms that they stand in: where several
agree, they tell how long a unit is.

A room is measured from its text to the nearest face each way. Sizes are rounded, and a chimney or a recess
may be left out of them, so single rooms are off by some per cent: the median of those that agree counts.
"""

import re
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.floorplan.vector.drawing import Text
from planfit.floorplan.vector.units import DimensionScale, count_apart, length_of_text

SIZES_AGREE = 0.06
"""Scales of a room by its two sides, and of rooms by each other, differ by less; of recesses, by 5 %."""
MIN_ROOMS, MOST_ROOMS = 3, 0.6
"""Rooms that must agree, and of those whose text has a room around it, the share that does."""
_RAYS = np.linspace(-3.0, 3.0, 7)
"""Heights of the text, beside its middle, at which a room is measured: less than half lead through a door."""
_LENGTH = (
    r"((?:\d{1,3}(?:\.\d{1,2})?) *['′’](?: *-? *\d{1,2}(?: +\d{1,2}/\d{1,2})? *(?:\"|″|''|”))?"
    r"|\d{1,5}(?:[.,]\d{1,3})?) *(mm|cm|m|мм|см|м)?"
)
_SIZE = re.compile(rf"(?<![\w.,]){_LENGTH}\s*[x×х*]\s*{_LENGTH}(?![^\W_])", re.IGNORECASE)
"""Two lengths with a cross between, the Cyrillic letter too; what stands before or behind does not count."""


@dataclass(frozen=True)
class RoomSize:
    """Size of a room as it is written."""

    sides_m: tuple[float, float]
    """As if numbers without a unit were metres."""
    has_unit: bool
    words: str


def size_of_room(text: str) -> RoomSize | None:
    """The size of a room that a text names, if it does.

    A unit behind the second length is that of both: `3.60 x 4.20 m`.
    """
    found = _SIZE.search(text)
    if found is None:
        return None
    first, unit, second, last_unit = found.groups()
    sides = [length_of_text(f"{number} {unit or last_unit or ''}") for number in (first, second)]
    if sides[0] is None or sides[1] is None or sides[0][1] != sides[1][1]:
        return None
    return RoomSize((sides[0][0], sides[1][0]), sides[0][1], found.group())


def scale_of_rooms(
    ends: Float[np.ndarray, "n 2 2"], texts: tuple[Text, ...]
) -> DimensionScale | None:
    """Metres of one unit of the drawing, by sizes of rooms that agree with the faces around their texts.

    Args:
        ends: of wall faces, in the drawing's unit.
        texts: of the drawing.
    """
    scales: list[float] = []
    sizes: list[RoomSize] = []
    n_rooms = 0
    for text in texts:
        size = size_of_room(text.text)
        room = None if size is None else _room_around(text, ends)
        if size is None or room is None or room.min() <= 0:
            continue
        n_rooms += 1
        # Along x and y, or the other way about.
        along, across = (
            np.log(np.array(sides) / room) for sides in (size.sides_m, size.sides_m[::-1])
        )
        logs = min(along, across, key=lambda pair: abs(pair[0] - pair[1]))
        if abs(logs[0] - logs[1]) < SIZES_AGREE:
            scales.append(float(logs.mean()))
            sizes.append(size)
    if len(scales) < MIN_ROOMS:
        return None
    apart = np.abs(np.array(scales)[:, None] - np.array(scales))
    of = np.flatnonzero(apart[int((apart < SIZES_AGREE).sum(axis=1).argmax())] < SIZES_AGREE)
    agreeing = [sizes[k] for k in of]
    lengths = [length for size in agreeing for length in size.sides_m]
    if min(len(of), count_apart(lengths)) < MIN_ROOMS or len(of) < MOST_ROOMS * n_rooms:
        return None
    return DimensionScale(
        float(np.exp(np.median(np.array(scales)[of]))),
        all(size.has_unit for size in agreeing),
        agreeing[0].words,
        len(of),
        float(np.median(lengths)),
    )


def _room_around(text: Text, ends: Float[np.ndarray, "n 2 2"]) -> Float[np.ndarray, "2"] | None:
    """Width and height of the room about a text, along x and y; None where a side has no wall."""
    size = np.zeros(2)
    for axis in (0, 1):
        # Rays along the axis, a few heights of the text apart, and where each meets each face.
        at = text.xy[1 - axis] + _RAYS[:, None] * text.height
        begin, end = ends[:, 0], ends[:, 1]
        across = end[:, 1 - axis] - begin[:, 1 - axis]
        share = (at - begin[:, 1 - axis]) / np.where(across == 0.0, 1.0, across)
        off = begin[:, axis] + share * (end[:, axis] - begin[:, axis]) - text.xy[axis]
        is_met = (across != 0.0) & (share >= 0.0) & (share <= 1.0)
        for sign in (-1.0, 1.0):
            nearest = np.where(is_met & (sign * off > 0.0), sign * off, np.inf).min(axis=1)
            size[axis] += float(np.median(nearest))
    return size if np.isfinite(size).all() else None

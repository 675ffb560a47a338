"""How long one unit of a drawing is: from the user, the file, its dimension texts, sizes written in rooms, or
not at all.

A room (`3.60 x 4.20`, `18'8" x 11'`) is measured from its text to the nearest face each way. Sizes are
rounded, and a chimney or a recess may be left out of them, so single rooms are off by some per cent: the
median of those that agree counts.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from planfit.errors import FloorplanError
from planfit.floorplan.faces import Ends
from planfit.floorplan.options import (
    MAX_SIZE_M,
    METRES_PER_UNIT,
    MIN_SIZE_M,
    PlanOptions,
    PlanUnit,
    choose_unit,
    units_that_fit,
)
from planfit.floorplan.vector.drawing import Text, VectorDrawing
from planfit.floorplan.vector.scale_bars import ScaleBar
from planfit.geometry import segments
from planfit.priors import BUILDING_LIKELY_SIZE_M, ROOM_SIDE_M, WALL_THICKNESS_M

MIN_AGREEING = 3
AGREEMENT, DIFFERENT = 0.01, 0.03
"""Scales that differ by at most the one agree; lengths that differ by more than the other are two."""
SAME_UNIT, ROUNDED = 0.02, 0.1
"""A header is right that differs by less from dimensions and bars, or from sizes of rooms."""
DIMENSIONS, ROOM_SIZES = "dimension texts", "sizes of rooms"
_NUMBER = re.compile(
    r"^\s*(\d{1,6}(?:[.,]\d{1,3})?)\s*(?:(mm|cm|m|мм|см|м)(?:\s+[^\W\d][^\d]{0,40})?)?\s*$",
    re.IGNORECASE,
)
"""Units in Latin and Cyrillic letters; after one, words may say of what: `8.8 m roof`."""
_LATIN = str.maketrans("мс", "mc")
_FEET = re.compile(
    r"^\s*(?:(\d{1,4}(?:\.\d{1,2})?)\s*['′’]\s*-?\s*)?(?:(\d{1,2})(?:\s+(\d{1,2})/(\d{1,2}))?\s*(?:\"|″|''|”))?\s*$"
)
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
class DimensionScale:
    """What dimension texts say."""

    metres_per_unit: float
    """As if numbers without a unit were metres."""
    has_unit: bool
    """Whether the texts name their unit."""
    example: str
    count: int
    usual: float = 0.0
    """Median of the lengths told, as if numbers without a unit were metres."""


def unit_of_drawing(
    drawing: VectorDrawing,
    path: Path,
    options: PlanOptions,
    size: float,
    usual_thickness: float | None,
    bars: Sequence[ScaleBar] = (),
    rooms: DimensionScale | None = None,
) -> PlanUnit:
    """Decide on a unit; the user's word first, then the file's, the dimension texts', a scale bar's, that of
    sizes written in rooms, a guess.

    Args:
        drawing: what the file says itself.
        options: `unit` and `metres_per_unit`.
        size: larger extent of the walls, in the drawing's unit.
        usual_thickness: of its walls, in the same; None where unknown.
        bars: scale bars of the sheet.
        rooms: what sizes written in rooms say.

    Raises:
        FloorplanError: the user's unit makes a building of an absurd size.
    """
    if options.unit != "auto" or options.metres_per_unit is not None:
        told = choose_unit(options.unit, options.metres_per_unit)
        if told.metres is not None:
            extent = size * told.metres
            if not MIN_SIZE_M <= extent <= MAX_SIZE_M:
                raise FloorplanError(
                    f"{path}: expected a building of {MIN_SIZE_M:g} to {MAX_SIZE_M:g} m, found "
                    f"{extent:.4g} m with {told.known_from}; {units_that_fit(size)}, or leave its "
                    "scale to the alignment with --unit unknown"
                )
        return told
    warnings: tuple[str, ...] = ()
    claimed = drawing.metres_per_unit
    straight = drawing.lines.ends[~drawing.lines.is_curved]
    by_lines = scale_of_dimensions(straight, drawing.texts)
    by_dimensions = (
        _told_by_texts(by_lines, DIMENSIONS, size, usual_thickness)
        or _told_by_bars(bars, size, usual_thickness)
        or _told_by_rooms(rooms, claimed, size, usual_thickness)
    )
    if claimed is not None:
        extent = size * claimed
        if MIN_SIZE_M <= extent <= MAX_SIZE_M:
            if by_dimensions is None or abs(claimed / by_dimensions.scale - 1) < SAME_UNIT:
                return PlanUnit(drawing.unit, "the file's header", claimed)
            warnings = (
                f"the file says its unit is {drawing.unit}, but by {by_dimensions.known_from} it "
                f"is {by_dimensions.scale:.4g} m: these were used",
            )
        else:
            warnings = (
                f"the file says its unit is {drawing.unit}, which makes a building of "
                f"{extent:.3g} m: not used",
            )
    if by_dimensions is not None:
        return replace(by_dimensions, warnings=warnings)
    if drawing.unit == "paper" or claimed is not None:
        return PlanUnit("unknown", "", None, warnings)
    return _guess(size, usual_thickness)


def _told_by_texts(
    found: DimensionScale | None, words: str, size: float, usual_thickness: float | None
) -> PlanUnit | None:
    """What texts say that stand for `words`; without a unit, in the one that makes a likely building and
    rooms of usual size, as these are written in feet, too."""
    if found is None:
        return None
    name = f"{found.count} {words} such as {found.example!r}"
    if found.has_unit:
        return PlanUnit(f"of {words}", name, found.metres_per_unit)
    sides = (0.0, np.inf) if words == DIMENSIONS else ROOM_SIDE_M.both
    fitting = [
        scale for scale in (1.0, 0.01, 0.001)
        if _is_likely(size, usual_thickness, found.metres_per_unit * scale)
        and sides[0] <= found.usual * scale <= sides[1]
    ]  # fmt: skip
    if len(fitting) != 1:
        return None
    return PlanUnit(f"of {words}", name, found.metres_per_unit * fitting[0])


def _told_by_rooms(
    rooms: DimensionScale | None, claimed: float | None, size: float, usual_thickness: float | None
) -> PlanUnit | None:
    """What sizes of rooms say. They are rounded: a header's unit (m) that they contradict gives way to one
    that files are drawn in, and holds where numbers without a unit agree with it in any, as in feet."""
    found = _told_by_texts(rooms, ROOM_SIZES, size, usual_thickness)
    if found is None or rooms is None or claimed is None:
        return found
    units = np.array(list(METRES_PER_UNIT.values()))
    read_as = np.ones(1) if rooms.has_unit else units
    if (np.abs(claimed / rooms.metres_per_unit / read_as - 1) < ROUNDED).any():
        return None
    off = np.abs(found.scale / units - 1)
    name, metres = list(METRES_PER_UNIT.items())[int(off.argmin())]
    return replace(found, name=name, metres=metres) if off.min() < ROUNDED else None


def _told_by_bars(
    bars: Sequence[ScaleBar], size: float, usual_thickness: float | None
) -> PlanUnit | None:
    """What scale bars say; nothing where they disagree, as on a sheet with plans of several scales, or make
    no likely building."""
    telling = [bar for bar in bars if bar.has_unit] or bars
    scales = [bar.metres_per_unit for bar in telling]
    if not scales or max(scales) > (1 + DIFFERENT) * min(scales):
        return None
    if not _is_likely(size, usual_thickness, scales[0]):
        return None
    return PlanUnit("of a scale bar", f"the scale bar {bars[0].words!r}", scales[0])


def _guess(size: float, usual_thickness: float | None) -> PlanUnit:
    """The one unit that makes a building with walls of likely size; unknown where several do, or where walls
    have no thickness: a sheet in millimetres of paper has the size of a building in feet."""
    fitting = [
        unit for unit, scale in METRES_PER_UNIT.items() if _is_likely(size, usual_thickness, scale)
    ]
    if len(fitting) == 1 and usual_thickness is not None:
        unit = fitting[0]
        return PlanUnit(
            unit,
            "the size of the building and its walls",
            METRES_PER_UNIT[unit],
            (f"the file does not say its unit; only {unit} makes a building of likely size",),
        )
    wording = f"could be {' or '.join(fitting)}" if fitting else "fits no likely building"
    return PlanUnit("unknown", "", None, (f"the file does not say its unit; it {wording}",))


def _is_likely(size: float, usual_thickness: float | None, scale: float) -> bool:
    """Whether a scale makes a building of likely size, and walls, where their thickness is known."""
    thickness = WALL_THICKNESS_M.low if usual_thickness is None else usual_thickness * scale
    return (
        BUILDING_LIKELY_SIZE_M.low <= size * scale <= BUILDING_LIKELY_SIZE_M.high
        and WALL_THICKNESS_M.low <= thickness <= WALL_THICKNESS_M.high
    )


def length_of_text(text: str) -> tuple[float, bool] | None:
    """Metres that a text means and whether it names its unit; None where it is no length.

    A number without a unit is taken as it stands: `4.20` gives 4.2.
    """
    number = _NUMBER.match(text)
    if number:
        value = float(number.group(1).replace(",", "."))
        unit = (number.group(2) or "").lower().translate(_LATIN)
        return (value * METRES_PER_UNIT.get(unit, 1.0), bool(unit)) if value > 0 else None
    feet = _FEET.match(text)
    if feet and (feet.group(1) or feet.group(2)):
        inches = 12.0 * float(feet.group(1) or 0) + float(feet.group(2) or 0)
        if feet.group(3) and float(feet.group(4)):
            inches += float(feet.group(3)) / float(feet.group(4))
        return (inches * METRES_PER_UNIT["in"], True) if inches > 0 else None
    return None


def count_apart(values: list[float]) -> int:
    """How many values differ from one another by more than those that agree may: the numbers of neighbouring
    rooms (2.01, 2.02, 2.03) agree with any lines of one length, as of equal desks."""
    count, last = 0, 0.0
    for value in sorted(values):
        if value > (1 + DIFFERENT) * last:
            count, last = count + 1, value
    return count


def scale_of_dimensions(ends: Ends, texts: tuple[Text, ...]) -> DimensionScale | None:
    """Metres of one unit of the drawing, where at least three texts of clearly different lengths agree
    within 1 % with the lines they stand at the middle of, and they are most of the
    texts that have such a line.
    """
    candidates: list[tuple[float, float, bool, int]] = []
    n_with_line = 0
    middles, lengths = ends.mean(axis=1), segments.lengths(ends)
    along = segments.directions(ends) if len(ends) else np.zeros((0, 2))
    for k, text in enumerate(texts):
        value = length_of_text(text.text)
        if value is None or len(ends) == 0 or text.height <= 0:
            continue
        offset = text.xy - middles
        across = np.abs(along[:, 0] * offset[:, 1] - along[:, 1] * offset[:, 0])
        at = np.abs(np.einsum("ni,ni->n", offset, along))
        near = np.flatnonzero(
            (across < 2.0 * text.height) & (at < 0.1 * lengths) & (lengths > 1.5 * text.height)
        )
        n_with_line += len(near) > 0
        candidates += [(value[0] / lengths[i], value[0], value[1], k) for i in near]
    if not candidates:
        return None
    ratios = np.array([c[0] for c in candidates])
    agreeing = np.abs(ratios[:, None] / ratios[None] - 1) < AGREEMENT
    best = int(agreeing.sum(axis=1).argmax())
    chosen = [candidates[i] for i in np.flatnonzero(agreeing[best])]
    n_values = count_apart([c[1] for c in chosen])
    n_texts = len({c[3] for c in chosen})
    if n_values < MIN_AGREEING or n_texts < 0.6 * n_with_line:
        return None
    ratio, has_unit = float(np.median([c[0] for c in chosen])), all(c[2] for c in chosen)
    return DimensionScale(ratio, has_unit, texts[chosen[0][3]].text.strip(), n_texts)


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


def scale_of_rooms(ends: Ends, texts: tuple[Text, ...]) -> DimensionScale | None:
    """Metres of one unit of the drawing, by sizes of rooms that agree with the faces around their texts.

    `ends`: of wall faces, in the drawing's unit.
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
        both = [np.log(np.array(sides) / room) for sides in (size.sides_m, size.sides_m[::-1])]
        logs = min(both, key=lambda pair: abs(pair[0] - pair[1]))
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


def _room_around(text: Text, ends: Ends) -> Float[np.ndarray, "2"] | None:
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

"""Scale bars: numbers from zero on beside a line or boxes as long. They tell how long a unit is, however a
sheet was shrunk, and are no wall."""

import re
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from planfit.floorplan.options import METRES_PER_UNIT
from planfit.floorplan.vector.drawing import Text, VectorDrawing
from planfit.floorplan.vector.layer_names import Role, folded
from planfit.floorplan.vector.line_work import usual_extent

LAYER = "scale bar"
_NUMBER = re.compile(r"^\s*(\d{1,4}(?:[.,]\d{1,2})?)\s*([^\W\d_]*)\.?\s*$")
_WORDS = {
    "m": "m meter meters metre metres mtr metri metros mètres metry м",
    "cm": "cm",
    "mm": "mm",
    "ft": "ft feet foot",
}
_UNITS = {folded(word): unit for unit, words in _WORDS.items() for word in words.split()}
_EVEN = 0.05
"""Of a distance, what a number stands off its place: it is set left, right or in the middle of its mark."""
_AT_ENDS = 0.03
"""Of the bar, likewise what its ends are off zero and the last number."""
_BESIDE = 4.0
"""Heights of the numbers, between them and the bar."""
_MOST_OF_DRAWING = 0.6
"""Numbers along most of a drawing are a grid of a map, or names of axes."""


@dataclass(frozen=True)
class ScaleBar:
    """A bar of a sheet, in the drawing's unit."""

    metres_per_unit: float
    """As if numbers without a unit were metres."""
    has_unit: bool
    """Whether its unit is written at it."""
    words: str
    """As it is written."""
    box: Float[np.ndarray, "2 2"]
    """Lowest and highest corner of the bar, without its numbers."""


@dataclass(frozen=True)
class _Number:
    value: float
    unit: str
    text: Text


def find_scale_bars(drawing: VectorDrawing) -> list[ScaleBar]:
    """Rows of numbers that start at zero, grow evenly, and have lines or boxes beside them that begin at zero
    and end at the last number."""
    numbers = [found for text in drawing.texts if (found := _number(text))]
    boxes = _boxes(drawing)
    if len(numbers) < 3 or len(boxes) == 0:
        return []
    extent = usual_extent(boxes.reshape(-1, 2))
    rows = [
        (row, axis)
        for zero in numbers if zero.value == 0
        for axis in (0, 1)
        for sign in (1, -1)
        if len(row := _row(zero, numbers, axis, sign)) >= 3
    ]  # fmt: skip
    found = [_bar(row, axis, boxes, drawing.texts, extent) for row, axis in rows]
    return [bar for bar in found if bar is not None]


def without_scale_bars(
    drawing: VectorDrawing, roles: list[Role], bars: list[ScaleBar]
) -> tuple[VectorDrawing, list[Role]]:
    """The drawing with what scale bars are drawn with on a layer that holds no walls."""
    if not bars:
        return drawing, roles
    layer = drawing.lines.layer.copy()
    ends = drawing.lines.ends
    new, fills = len(drawing.layers), list(drawing.fills)
    for bar in bars:
        layer[((ends >= bar.box[0]) & (ends <= bar.box[1])).all(axis=(1, 2))] = new
        for k, fill in enumerate(fills):
            low, high = np.array(fill.polygon.bounds).reshape(2, 2)
            if (low >= bar.box[0]).all() and (high <= bar.box[1]).all():
                fills[k] = replace(fill, layer=new)
    lines = replace(drawing.lines, layer=layer)
    layers = (*drawing.layers, LAYER)
    return replace(drawing, lines=lines, fills=tuple(fills), layers=layers), [*roles, Role.NO_WALL]


def _number(text: Text) -> _Number | None:
    """A number, alone or with a unit of length."""
    match = _NUMBER.match(text.text)
    if match is None or text.height <= 0:
        return None
    word = folded(match.group(2))
    if word and word not in _UNITS:
        return None
    return _Number(float(match.group(1).replace(",", ".")), _UNITS.get(word, ""), text)


def _boxes(drawing: VectorDrawing) -> Float[np.ndarray, "n 2 2"]:
    """Lowest and highest corner of each line and fill."""
    ends = drawing.lines.ends
    of_lines = np.stack([ends.min(axis=1), ends.max(axis=1)], axis=1)
    of_fills = np.array([fill.polygon.bounds for fill in drawing.fills]).reshape(-1, 2, 2)
    return np.concatenate([of_lines, of_fills])


def _row(zero: _Number, numbers: list[_Number], axis: int, sign: int) -> list[_Number]:
    """Numbers beside a zero, on one side of it along an axis, whose distances are as their values."""
    at, height = zero.text.xy, zero.text.height
    ahead = [
        (sign * (one.text.xy[axis] - at[axis]), one)
        for one in numbers
        if abs(one.text.xy[1 - axis] - at[1 - axis]) < height and one.value > 0
    ]
    ahead = sorted(((d, one) for d, one in ahead if d > 0), key=lambda pair: pair[0])
    row, step = [zero], 0.0
    for distance, one in ahead:
        if len(row) == 1:
            step = distance / one.value
        elif one.value <= row[-1].value or abs(distance - step * one.value) > _EVEN * distance:
            break
        else:
            step = distance / one.value
        row.append(one)
    return row


def _bar(
    row: list[_Number],
    axis: int,
    boxes: Float[np.ndarray, "n 2 2"],
    texts: tuple[Text, ...],
    extent: float,
) -> ScaleBar | None:
    """The bar beside a row of numbers; None where nothing as long is drawn there."""
    first, last = row[0].text, row[-1].text
    low, high = sorted((float(first.xy[axis]), float(last.xy[axis])))
    length, across = high - low, float(first.xy[1 - axis])
    reach = _BESIDE * max(one.text.height for one in row)
    if length > _MOST_OF_DRAWING * extent:
        return None
    margin = _AT_ENDS * length
    is_here = (boxes[:, 0, axis] > low - margin) & (boxes[:, 1, axis] < high + margin)
    is_here &= (np.abs(boxes[:, :, 1 - axis] - across) < reach).all(axis=1)
    here = boxes[is_here]
    if len(here) == 0:
        return None
    box = np.stack([here[:, 0].min(axis=0), here[:, 1].max(axis=0)])
    # Of a bar's edges, those as far apart as the numbers: areas of strokes reach half a pen beyond it.
    begins, ends = here[:, 0, axis], here[:, 1, axis]
    begins, ends = begins[begins < low + margin], ends[ends > high - margin]
    spans = np.subtract.outer(ends, begins).ravel()
    if len(spans) == 0:
        return None
    drawn = float(spans[np.argmin(np.abs(spans - length))])
    if abs(drawn - length) > 2 * margin:
        return None
    # The unit stands at a number, or by itself beside the row.
    middle = (first.xy + last.xy) / 2
    beside = [
        _UNITS[folded(text.text.strip().rstrip("."))]
        for text in texts
        if folded(text.text.strip().rstrip(".")) in _UNITS
        and abs(text.xy[axis] - middle[axis]) < 0.75 * length
        and abs(text.xy[1 - axis] - across) < reach
    ]
    units = {*beside, *(one.unit for one in row if one.unit)}
    if len(units) > 1:
        return None
    unit = next(iter(units), "")
    metres = row[-1].value * METRES_PER_UNIT[unit or "m"]
    words = " ".join([*(f"{one.value:g}" for one in row), unit]).strip()
    grown = box + np.array([[-1.0], [1.0]]) * 1e-6 * extent
    return ScaleBar(metres / drawn, bool(unit), words, grown)

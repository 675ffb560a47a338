"""Values of properties as style sheets write them, in the words that svgelements understands: of others it
takes the first number, or black. And what the fill and the stroke of a shape look like then: colours on paper
or on dark ground, what hides, what has gaps."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
import shapely
import tinycss2
from svgelements import SVG, Color, Rect, Shape
from tinycss2.color4 import parse_color

from planfit.floorplan.formats import MAX_DEPTH
from planfit.floorplan.formats.svg.rules import SVG_NAMESPACE, split
from planfit.floorplan.vector.drawing import LIGHT

PX = {
    "px": 1.0, "pt": 4.0 / 3.0, "pc": 16.0, "in": 96.0, "cm": 96.0 / 2.54, "mm": 9.6 / 2.54,
    "q": 2.4 / 2.54, "rem": 16.0,
}  # fmt: skip
_EMS = {"em": 1.0, "ex": 0.5, "ch": 0.5}
_LONGEST = 200
"""Characters of a length or of a variable: those of real drawings are tens, and a variable may name two."""
_COLOUR_FUNCTIONS = {"rgb", "rgba", "hsl", "hsla", "hwb"}
"""Others have no red, green and blue without the colours of a screen."""
_OF_COLOURS = {"light-dark": 0, "color-mix": 1}
"""Which part is taken of functions of colours: what is on paper, and what something is mixed into."""
_TILED = "#404040"
"""Of areas filled with a pattern: their shape tells what they are."""
_PART = r"[^()]{0,80}"  # bounded: of a name that is never closed, all ends would be tried
_VARIABLE = re.compile(rf"var\(\s*(--[^\s,()]+)\s*(?:,\s*({_PART}(?:\({_PART}\))?{_PART}))?\)")

WHITE = 245
"""Of 255, of every colour: paper that is not tinted."""
DARK_GROUND, GROUND_SHARE, ROOMS_SHARE = 110, 0.9, 0.5
"""Every colour of dark ground is below the first, of 255; it reaches over this share of all that is drawn,
and less than the last of it is light areas: of a slab with rooms on it the rest is walls."""


_Quantity: TypeAlias = tuple[float, int]
"""A value, and of how many lengths it is a product: 0 of a number."""


class _NotUnderstood(Exception):
    """A length that depends on more than the file, or is none."""


def length_px(text: str, em_px: float, whole_px: float) -> float | None:
    """A length in units of the drawing; None where it is not understood.

    Args:
        text: a number with or without a unit, or a calculation (`calc`, `min`, `max`, `clamp`).
        em_px: size of the letters there.
        whole_px: what a percentage is of.
    """
    if len(text) > _LONGEST:
        return None
    try:
        value, n_lengths = _sum(_tokens(text), em_px, whole_px)
    except (_NotUnderstood, ZeroDivisionError):
        return None
    return value if n_lengths <= 1 else None


@lru_cache(maxsize=4096)  # the elements of a drawing share few values
def _tokens(text: str) -> tuple[Any, ...]:
    found = tinycss2.parse_component_value_list(text, skip_comments=True)
    return tuple(token for token in found if token.type != "whitespace")


def _sum(tokens: Sequence[Any], em: float, whole: float) -> _Quantity:
    total, n_lengths = 0.0, 0
    for mark, part in split(tokens, "+-"):
        value, n = _product(part, em, whole)
        total, n_lengths = total + value if mark == "+" else total - value, max(n, n_lengths)
    return total, n_lengths


def _product(tokens: Sequence[Any], em: float, whole: float) -> _Quantity:
    result, n_lengths = 1.0, 0
    for mark, part in split(tokens, "*/"):
        solid = [token for token in part if token.type != "whitespace"]
        if len(solid) != 1:
            raise _NotUnderstood
        value, n = _single(solid[0], em, whole)
        if mark == "*":
            result, n_lengths = result * value, n_lengths + n
        else:
            result, n_lengths = result / value, n_lengths - n
    return result, n_lengths


def _single(token: Any, em: float, whole: float) -> _Quantity:
    if token.type == "number":
        return token.value, 0
    if token.type == "percentage":
        return token.value * (whole / 100.0), 1
    if token.type == "dimension" and token.lower_unit in _EMS:
        return token.value * (em * _EMS[token.lower_unit]), 1
    if token.type == "dimension" and token.lower_unit in PX:
        return token.value * PX[token.lower_unit], 1
    if token.type == "() block":
        return _sum(token.content, em, whole)
    if token.type != "function":
        raise _NotUnderstood
    found = [_sum(part, em, whole) for _, part in split(token.arguments, ",")]
    values, n_lengths = [value for value, _ in found], found[-1][1]
    if token.lower_name in ("min", "max"):
        return (min if token.lower_name == "min" else max)(values), n_lengths
    if token.lower_name == "clamp" and len(values) == 3:
        return max(values[0], min(values[1], values[2])), n_lengths
    if token.lower_name == "calc" and len(values) == 1:
        return values[0], n_lengths
    raise _NotUnderstood


def plain_colour(text: str, by_id: Mapping[str, ET.Element]) -> str | None:
    """A colour, or the absence of one, as svgelements reads it; None where it is not understood.

    Of a gradient its middle colour is taken.

    `text`: of `fill` or `stroke`; `by_id`: elements of the drawing, whose styles are in their attributes.
    """
    tokens = _tokens(text)
    server = _url(tokens[0]) if tokens else ""
    if server:
        tokens = tokens[1:] or _tokens(_colour_of_server(server, by_id))
    if len(tokens) != 1:
        return None
    [token] = tokens
    if token.type == "ident" and token.lower_value in ("none", "inherit"):
        return token.lower_value
    if token.type == "function" and token.lower_name in _OF_COLOURS:
        parts = dict(enumerate(part for _, part in split(token.arguments, ",")))
        taken = parts.get(_OF_COLOURS[token.lower_name], [])
        solid = [one for one in taken if one.type not in ("whitespace", "percentage")]
        return plain_colour(tinycss2.serialize(solid), by_id)
    if token.type == "function" and token.lower_name not in _COLOUR_FUNCTIONS:
        return None
    colour: Any = parse_color(token)
    if isinstance(colour, str | None):
        return "currentColor" if colour == "currentcolor" else None
    if None in colour.coordinates:
        return None
    parts = [*colour.to("srgb").coordinates, colour.alpha]
    bytes_ = [min(max(round(255.0 * part), 0), 255) for part in parts]
    return "#" + bytes(bytes_[:3] if bytes_[3] == 255 else bytes_).hex()


def _url(token: Any) -> str:
    """The id that a token names; empty where it is no link within the file."""
    if token.type == "function" and token.lower_name == "url":
        token = next((one for one in token.arguments if one.type == "string"), token)
    is_link = token.type in ("url", "string") and token.value.startswith("#")
    return token.value[1:] if is_link else ""


def _colour_of_server(name: str, by_id: Mapping[str, ET.Element]) -> str:
    """Colour of what a fill names: of a gradient in its middle, of a pattern a grey, else none."""
    for _ in range(MAX_DEPTH):
        element = by_id.get(name)
        if element is None:
            return "none"
        if element.tag == f"{SVG_NAMESPACE}pattern":
            return _TILED
        stops = [stop.get("stop-color") or "black" for stop in element.iter(f"{SVG_NAMESPACE}stop")]
        if stops:
            return stops[len(stops) // 2]
        links = element.get("href") or element.get("{http://www.w3.org/1999/xlink}href") or ""
        name = links.removeprefix("#")
    return "none"


def resolved_variables(values: Mapping[str, str]) -> dict[str, str]:
    """Values of variables that name no other variables; those that stay unknown are left out."""
    for _ in range(MAX_DEPTH):
        values = {
            name: with_variables(value, values)
            for name, value in values.items()
            if len(value) <= _LONGEST
        }
    return {name: value for name, value in values.items() if "var(" not in value}


def with_variables(text: str, values: Mapping[str, str]) -> str:
    """The same text with the values of variables in the place of their names; where one has none, what the
    text says for that, or the name as it is."""
    return _VARIABLE.sub(lambda found: values.get(found[1], found[2] or found[0]), text)


def dark_ground(
    svg: SVG, own: dict[str, str], shapes: Sequence[Shape]
) -> tuple[int, int, int] | None:
    """Colour of the dark ground that a drawing is on, by its page's `own` attributes or a first box which
    reaches over nearly all; None on paper."""
    told = plain_colour(own.get("background-color") or own.get("background") or "none", {})
    paint = None if told in (None, "none") else Color(told)
    filled = [shape for shape in shapes if is_drawn(shape.fill)]
    if paint is None and filled and isinstance(filled[0], Rect) and is_opaque(filled[0]):
        light = [s for s in filled[1:] if s.fill.alpha == 255 and lightness(s.fill) >= LIGHT]
        page, first, *rooms = (_box(each) for each in (svg, filled[0], *light))
        is_slab = shapely.union_all(np.array(rooms)).area > ROOMS_SHARE * first.area
        is_ground = page.intersection(first).area >= GROUND_SHARE * page.area > 0.0
        paint = filled[0].fill if is_ground and not is_slab else None
    if paint is None or paint.alpha != 255 or max(rgb_of(paint)) >= DARK_GROUND:
        return None
    # Dark lines would not show on it: they are on light areas.
    strokes = [shape for shape in shapes if is_drawn(shape.stroke)]
    around = [_box(shape).length for shape in strokes]
    is_dark = [max(rgb_of(shape.stroke)) < DARK_GROUND for shape in strokes]
    if np.dot(around, is_dark) > 0.5 * sum(around):
        return None
    return rgb_of(paint)


def _box(element: SVG | Shape) -> shapely.Polygon:
    x0, y0, x1, y1 = element.bbox() or (0.0, 0.0, 0.0, 0.0)
    return shapely.box(x0, y0, x1, y1)


def negative(paint: Color, ground: tuple[int, int, int]) -> Color:
    """White for the ground and black for white: a drawing on dark ground is read as its negative."""
    if not is_drawn(paint):
        return paint
    parts = zip((paint.red, paint.green, paint.blue), ground, strict=True)
    return Color(
        *(min(255 - (part or 0) + dark, 255) for part, dark in parts), opacity=paint.opacity
    )


def covers(shape: Shape) -> bool:
    """Whether a shape is a patch that hides what is under it: opaque, light, without an outline. What is dark
    is wall over the lines of its faces."""
    fill, values = shape.fill, shape.values or {}
    if fill is None or not is_drawn(fill) or is_drawn(shape.stroke) or (fill.alpha or 0) < 255:
        return False
    return is_opaque(shape) and "mix-blend-mode" not in values and lightness(fill) >= LIGHT


def is_opaque(shape: Shape) -> bool:
    """Whether nothing shows through a shape but for what its paint lets through."""
    return str((shape.values or {}).get("opacity") or "1").strip() in ("1", "1.0", "100%")


def is_dashed(shape: Shape) -> bool:
    """Whether a stroke has gaps: of dashes and gaps in turn, the same again where their number is odd. Not
    where one dash is as long as all (pages draw lines little by little so), nor where gaps are finer than the
    stroke."""
    values = shape.values or {}
    words = re.split(r"[\s,]+", str(values.get("stroke-dasharray") or "").strip())
    try:
        dashes = [float(word.removesuffix("px")) for word in words]
        whole = float(values.get("pathLength") or 0.0) or _box(shape).length / 2
    except (TypeError, ValueError):
        return False
    gaps = (dashes * 2)[1::2]
    return max(gaps) > 0.5 * float(shape.stroke_width or 1.0) and max(dashes[::2]) < whole


def is_drawn(paint) -> bool:
    """Whether a paint shows."""
    return paint is not None and paint.value is not None and paint.alpha > 0


def is_white(paint) -> bool:
    """Whether a line of this paint is paper on paper."""
    return paint.alpha == 255 and lightness(paint) >= WHITE


def lightness(paint) -> int:
    """Of the darkest of its colours."""
    return min(rgb_of(paint))


def rgb_of(paint) -> tuple[int, int, int]:
    """Colour of a paint, or of as much of it as there is on white paper."""
    share = paint.alpha / 255.0
    red, green, blue = (
        round(255 - share * (255 - (part or 0))) for part in (paint.red, paint.green, paint.blue)
    )
    return red, green, blue

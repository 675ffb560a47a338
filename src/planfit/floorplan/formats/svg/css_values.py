"""Values of properties as style sheets write them, in the words that svgelements understands: of others it
takes the first number, or black."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, TypeAlias

import tinycss2
from tinycss2.color4 import parse_color

from planfit.floorplan.formats.svg.rules import SVG_NAMESPACE, split

_PX = {
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
_MAX_STEPS = 8
"""A gradient may take its colours from another one, and a variable its value, so deep."""
_PART = r"[^()]{0,80}"  # bounded: of a name that is never closed, all ends would be tried
_VARIABLE = re.compile(rf"var\(\s*(--[^\s,()]+)\s*(?:,\s*({_PART}(?:\({_PART}\))?{_PART}))?\)")

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
    if token.type == "dimension" and token.lower_unit in _PX:
        return token.value * _PX[token.lower_unit], 1
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

    Args:
        text: of `fill` or `stroke`.
        by_id: elements of the drawing, whose styles are in their attributes.
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
        part = [part for _, part in split(token.arguments, ",")][_OF_COLOURS[token.lower_name] :][
            :1
        ]
        solid = [
            one for each in part for one in each if one.type not in ("whitespace", "percentage")
        ]
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
    for _ in range(_MAX_STEPS):
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
    for _ in range(_MAX_STEPS):
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

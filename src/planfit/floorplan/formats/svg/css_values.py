"""Lengths and colours as style sheets write them, in the words that svgelements understands: of others it
takes the first number, or black."""

import re
import xml.etree.ElementTree as ET

from svgelements import Color

from planfit.floorplan.formats.svg.rules import SVG_NAMESPACE

_PX = {
    "": 1.0, "px": 1.0, "pt": 4.0 / 3.0, "pc": 16.0, "in": 96.0, "cm": 96.0 / 2.54,
    "mm": 9.6 / 2.54, "q": 2.4 / 2.54, "rem": 16.0,
}  # fmt: skip
_TOKEN = re.compile(
    r"\s*(?:(\d+\.?\d*(?:e[-+]?\d+)?|\.\d+(?:e[-+]?\d+)?)(%|[a-z]*)|(calc|min|max|clamp)?(\()|([-+*/,)]))",
    re.IGNORECASE,
)
_LONGEST = 200
"""Characters; those of real drawings are tens."""
_URL = re.compile(r"url\(\s*['\"]?#([^)'\"]+)['\"]?\s*\)")
_HEX = re.compile(r"#([\da-f]{3,4}|[\da-f]{6}|[\da-f]{8})")
_CALL = re.compile(r"(rgb|hsl)a?\(([^()]*)\)")
_TILED = "#404040"
"""Of areas filled with a pattern: their shape tells what they are."""
_MOST_STEPS = 8
"""A gradient may take its colours from another one, so deep."""


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
        value, n_lengths, rest = _sum(_tokens(text), em_px, whole_px)
    except (_NotUnderstood, ZeroDivisionError, IndexError):
        return None
    return value if not rest and n_lengths <= 1 else None


def _tokens(text: str) -> list[tuple[str, ...]]:
    result, at = [], 0
    text = text.strip()
    while at < len(text):
        found = _TOKEN.match(text, at)
        if found is None:
            raise _NotUnderstood
        result.append(tuple(part or "" for part in found.groups()))
        at = found.end()
    return result


def _sum(tokens: list, em: float, whole: float) -> tuple[float, int, list]:
    """Value, of how many lengths it is a product (a number is of none), and the tokens left."""
    value, kind, tokens = _product(tokens, em, whole)
    while tokens and tokens[0][4] in ("+", "-"):
        other, other_kind, rest = _product(tokens[1:], em, whole)
        value = value + other if tokens[0][4] == "+" else value - other
        kind, tokens = max(kind, other_kind), rest
    return value, kind, tokens


def _product(tokens: list, em: float, whole: float) -> tuple[float, int, list]:
    value, kind, tokens = _factor(tokens, em, whole)
    while tokens and tokens[0][4] in ("*", "/"):
        other, other_kind, rest = _factor(tokens[1:], em, whole)
        is_product = tokens[0][4] == "*"
        value = value * other if is_product else value / other
        kind = kind + other_kind if is_product else kind - other_kind
        tokens = rest
    return value, kind, tokens


def _factor(tokens: list, em: float, whole: float) -> tuple[float, int, list]:
    number, unit, call, bracket, sign = tokens[0]
    if sign in ("+", "-"):
        value, kind, rest = _factor(tokens[1:], em, whole)
        return (value if sign == "+" else -value), kind, rest
    if number:
        relative = {"%": whole / 100.0, "em": em, "ex": em / 2.0, "ch": em / 2.0}
        size = relative.get(unit.lower(), _PX.get(unit.lower()))
        if size is None:
            raise _NotUnderstood
        return float(number) * size, int(bool(unit)), tokens[1:]
    if not bracket:
        raise _NotUnderstood
    values, kind, rest = [], 0, [("", "", "", "", ","), *tokens[1:]]
    while rest[0][4] == ",":
        value, kind, rest = _sum(rest[1:], em, whole)
        values.append(value)
    if rest[0][4] != ")":
        raise _NotUnderstood
    return _called(call.lower(), values), kind, rest[1:]


def _called(name: str, values: list[float]) -> float:
    if name == "min":
        return min(values)
    if name == "max":
        return max(values)
    if name == "clamp" and len(values) == 3:
        return max(values[0], min(values[1], values[2]))
    if name in ("", "calc") and len(values) == 1:
        return values[0]
    raise _NotUnderstood


def plain_colour(text: str, by_id: dict[str, ET.Element]) -> str | None:
    """A colour, or the absence of one, as svgelements reads it; None where it is not understood.

    Of a gradient its middle colour is taken.

    Args:
        text: of `fill` or `stroke`.
        by_id: elements of the drawing, whose styles are in their attributes.
    """
    words = text.strip()
    named = _URL.match(words)
    if named is not None:
        words = words[named.end() :].strip() or _of_server(named[1], by_id)
    lower = words.lower()
    if lower in ("none", "transparent", "inherit") or _HEX.fullmatch(lower):
        return lower
    if lower == "currentcolor":
        return "currentColor"
    call = _CALL.fullmatch(lower)
    if call is not None:
        return f"{call[1]}{'a' * (call[2].replace('/', ' ').count(',') == 3)}({call[2]})" if (
            "," in call[2]
        ) else _with_commas(call[1], call[2])  # fmt: skip
    is_known = lower == "black" or Color(lower).value != Color("black").value
    return lower if is_known else None


def _with_commas(name: str, inside: str) -> str | None:
    """rgb(1 2 3 / 50%) as rgba(1,2,3,0.5)."""
    parts, _, alpha = inside.partition("/")
    values = parts.replace("deg", "").split()
    if len(values) != 3 or "none" in values:
        return None
    alpha = alpha.strip()
    try:
        share = float(alpha[:-1]) / 100.0 if alpha.endswith("%") else float(alpha or 1.0)
    except ValueError:
        return None
    return f"{name}a({','.join(values)},{share})" if alpha else f"{name}({','.join(values)})"


def _of_server(name: str, by_id: dict[str, ET.Element]) -> str:
    """Colour of what a fill names: of a gradient in its middle, of a pattern a grey, else none."""
    for _ in range(_MOST_STEPS):
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

"""Style sheets of an SVG put into the elements that they are of.

svgelements knows selectors of one word alone, in no order but that of their kind, and takes every width and
colour that it does not know for 1 and black: rooms without a fill would be black areas.
"""

import math
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

from planfit.errors import FloorplanError
from planfit.floorplan.formats.svg.css_values import length_px, plain_colour
from planfit.floorplan.formats.svg.rules import (
    STYLE,
    SVG_NAMESPACE,
    Selector,
    is_dynamic,
    parse_selector,
    split_declarations,
    split_rules,
)

_INHERITED = {
    "fill", "stroke", "stroke-width", "stroke-opacity", "fill-opacity", "visibility", "color", "font-size",
    "text-anchor", "font", "stroke-dasharray",
}  # fmt: skip
_DRAWN = _INHERITED | {
    "display", "opacity", "transform", "clip-path", "vector-effect", "mix-blend-mode", "stop-color",
    "x", "y", "width", "height", "cx", "cy", "r", "rx", "ry",
}  # fmt: skip
"""Properties that decide what is drawn where."""
_MOST_TRIALS, _PATH_TRIALS = 1_000_000, 5
"""Rules tried on elements; those that ask for elements around them take longer and count so often. Of a real
drawing of 20,000 paths and 60 rules 0.1 million."""
_EM_PX = 16.0
"""Font size of browsers where none is set: `medium`, 16 px."""
_PLAIN = re.compile(r"[-+]?[\d.]+(e[-+]?\d+)?(px)?")


@dataclass(frozen=True)
class _Styled:
    """A rule, ready to be tried."""

    selector: Selector
    declarations: tuple[tuple[str, str], ...]
    order: tuple[tuple[int, int, int], int]


@dataclass
class _Sheet:
    """Rules by the id, class or name that an element must have, and what was not understood."""

    by_key: dict[str, list[_Styled]] = field(default_factory=dict)
    unknown: Counter[str] = field(default_factory=Counter)

    def of(self, element: ET.Element) -> Iterator[_Styled]:
        """Rules that may be of an element."""
        keys = ["*", element.tag, f"#{element.get('id', '')}"]
        keys += [f".{name}" for name in dict.fromkeys((element.get("class") or "").split())]
        for key in keys:
            yield from self.by_key.get(key, ())


def with_styles(data: bytes) -> tuple[bytes, tuple[str, ...]]:
    """The same SVG with what its style sheets say in the `style` of each element, and what was not
    understood of them, a sentence each.

    Args:
        data: well-formed XML, known to declare no entities, without variables.

    Raises:
        FloorplanError: of more rules and elements than any drawing has.
    """
    root = ET.fromstring(data)
    sheet = _sheet_of(root)
    parents = [(root, [root])]
    n_trials = 0
    while parents:
        element, path = parents.pop()
        matched = []
        for rule in sheet.of(element):
            n_trials += 1 if len(rule.selector.compounds) == 1 else _PATH_TRIALS
            if rule.selector.matches(path):
                matched.append(rule)
        if n_trials > _MOST_TRIALS:
            raise FloorplanError(
                "expected style sheets of a drawing, found too many pairs of rules and "
                "elements; save it again as plain SVG"
            )
        _put(element, _cascade(element, matched))
        parents += [(child, [*path, child]) for child in element if isinstance(child.tag, str)]
    for element in root.iter(STYLE):
        element.text = ""
    _put_values(root, sheet.unknown)
    return ET.tostring(root, encoding="utf-8"), _words(sheet.unknown)


def _sheet_of(root: ET.Element) -> _Sheet:
    sheet = _Sheet()
    n = 0
    for element in root.iter(STYLE):
        if "@import" in (element.text or ""):
            sheet.unknown["style sheet in another file"] += 1
        for rule in split_rules(element.text or ""):
            own = tuple((a.lower(), b) for a, b in rule.declarations if a.lower() in _DRAWN)
            selector = parse_selector(rule.selector)
            if own and selector is not None:
                n += 1
                key = _key_of(selector)
                styled = _Styled(selector, own, (selector.specificity, n))
                sheet.by_key.setdefault(key, []).append(styled)
            elif own and not is_dynamic(rule.selector):
                sheet.unknown[f"rule of '{_short(rule.selector)}'"] += 1
    return sheet


def _key_of(selector: Selector) -> str:
    last = selector.compounds[-1]
    if last.id:
        return f"#{last.id}"
    if last.classes:
        return f".{min(last.classes)}"
    return SVG_NAMESPACE + last.tag if last.tag else "*"


def _cascade(element: ET.Element, matched: list[_Styled]) -> dict[str, str]:
    """What holds of an element: rules by how special they are, its own style, what is important."""
    found: list[tuple[bool, int, tuple, str, str]] = []
    for rule in matched:
        for name, value in rule.declarations:
            found.append((_is_important(value), 0, rule.order, name, value))
    for name, value in split_declarations(element.get("style") or ""):
        found.append((_is_important(value), 1, (), name.lower(), value))
    result: dict[str, str] = {}
    for *_, name, value in sorted(found, key=lambda each: each[:3]):
        result[name] = value.replace("!important", "").strip()
    return result


def _is_important(value: str) -> bool:
    return "!important" in value


def _put(element: ET.Element, style: dict[str, str]) -> None:
    """Into the attributes: those that are inherited as they are around it are none of its own."""
    element.attrib.pop("style", None)
    for name, value in style.items():
        if name in _INHERITED and value.lower() in ("inherit", "unset"):
            element.attrib.pop(name, None)
        elif name in _DRAWN:
            element.set(name, value)


def _put_values(root: ET.Element, unknown: Counter[str]) -> None:
    """Widths in units of the drawing, and colours that svgelements knows."""
    by_id = {e.get("id", ""): e for e in root.iter() if e.get("id")}
    whole = _percent_base(root)
    stack = [(root, _EM_PX)]
    while stack:
        element, em = stack.pop()
        em = _put_length(element, "font-size", em, em, Counter()) or em
        _put_length(element, "stroke-width", em, whole, unknown)
        for name in ("fill", "stroke"):
            text = element.get(name)
            if text is None:
                continue
            colour = plain_colour(text, by_id)
            if colour is None:
                unknown[f"{name} '{_short(text)}', taken for black"] += 1
            else:
                element.set(name, colour)
        stack += [(child, em) for child in element if isinstance(child.tag, str)]


def _put_length(
    element: ET.Element, name: str, em: float, whole: float, unknown: Counter[str]
) -> float | None:
    text = (element.get(name) or "").strip()
    if not text:
        return None
    value = length_px(text, em, whole)
    if value is None:
        unknown[f"{name} '{_short(text)}'"] += 1
    elif _PLAIN.fullmatch(text.lower()) is None:
        element.set(name, repr(value))
    return value


def _percent_base(root: ET.Element) -> float:
    """Of a width in percent: the diagonal of the drawing over the root of two."""
    try:
        box = [float(part) for part in re.split(r"[\s,]+", (root.get("viewBox") or "").strip())]
        width, height = box[2:4]
    except ValueError:
        width, height = (
            length_px(root.get(k) or "0", _EM_PX, 0.0) or 0.0 for k in ("width", "height")
        )
    return math.hypot(width, height) / math.sqrt(2.0)


def _short(text: str) -> str:
    return text if len(text) <= 40 else text[:37] + "..."


def _words(unknown: Counter[str]) -> tuple[str, ...]:
    if not unknown:
        return ()
    named = list(unknown)[:3]
    more = f" and {len(unknown) - 3} more" if len(unknown) > 3 else ""
    return (
        f"styles that were not understood: {'; '.join(named)}{more}: compare the overlay (-o FILE.png) with "
        "the drawing",
    )

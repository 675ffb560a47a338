"""Style sheets of an SVG put into the elements that they are of.

svgelements knows selectors of one word alone, in no order but that of their kind, and takes every width and
colour that it does not know for 1 and black: rooms without a fill would be black areas.
"""

import math
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from planfit.errors import FloorplanError
from planfit.floorplan.formats.svg.css_values import (
    PX,
    length_px,
    plain_colour,
    resolved_variables,
    with_variables,
)
from planfit.floorplan.formats.svg.rules import (
    STYLE,
    SVG_NAMESPACE,
    Declaration,
    Rule,
    Selector,
    facts_of,
    parse_declarations,
    parse_rules,
    parse_selector,
)
from planfit.floorplan.plausible import COMPARE

_INHERITED = {
    "fill", "stroke", "stroke-width", "stroke-opacity", "fill-opacity", "visibility", "color", "font-size",
    "text-anchor", "font", "stroke-dasharray",
}  # fmt: skip
_DRAWN = _INHERITED | {
    "display", "opacity", "transform", "clip-path", "vector-effect", "mix-blend-mode", "stop-color",
    "x", "y", "width", "height", "cx", "cy", "r", "rx", "ry", "background", "background-color",
}  # fmt: skip
"""Properties that decide what is drawn where."""
_MOST_TRIALS, _PATH_TRIALS = 1_000_000, 5
"""Rules tried on elements; those that ask for elements around them take longer and count so often. Of a real
drawing of 20,000 paths and 60 rules 0.1 million."""
_EM_PX = PX["rem"]
"""Font size of browsers where none is set."""
_CLASS = re.compile(r"\.([-\w]+)")
_SHAPES = {
    f"{SVG_NAMESPACE}{name}"
    for name in ("path", "rect", "circle", "ellipse", "line", "polyline", "polygon")
}
_PLAIN = re.compile(r"[-+]?[\d.]+(e[-+]?\d+)?(px)?")


@dataclass(frozen=True)
class _Ready:
    """A rule, ready to be tried."""

    order: tuple[tuple[int, int, int], int]
    """The later one holds: specificity, and the number in the file."""
    selector: Selector
    declarations: tuple[Declaration, ...]


def apply_styles(root: ET.Element) -> tuple[str, ...]:
    """Put what the style sheets of an SVG say, and the `style` of each element, into its attributes.

    Returns what was not understood of them, a sentence each.

    Raises:
        FloorplanError: there are more rules and elements than in any drawing.
    """
    texts = [element.text or "" for element in root.iter(STYLE)]
    rules = [rule for text in texts for rule in parse_rules(text)]
    variables = _variables(root, rules)
    unknown = Counter({"style sheet in another file": sum("@import" in text for text in texts)})
    _apply_rules(root, _ready(rules, unknown))
    styled = {name for rule in rules for name in _CLASS.findall(rule.words)}
    _outline_unstyled(root, styled, unknown)
    for element in root.iter():
        if element.tag == STYLE:
            element.text = ""
        for name, text in element.attrib.items():
            if "var(" in text:
                element.set(name, with_variables(text, variables))
    _put_values(root, unknown)
    return _words(+unknown)


def _variables(root: ET.Element, rules: Sequence[Rule]) -> dict[str, str]:
    """Variables of the whole drawing, of its rules, of single elements.

    Those that hold for a dark screen or for print (in `@media`) are not taken, and of several rules the
    first, as themes follow what they change.
    """
    found = list(parse_declarations(root.get("style", "")))
    found += [each for rule in rules for each in rule.declarations]
    found += [each for e in root.iter() for each in parse_declarations(e.get("style", ""))]
    values: dict[str, str] = {}
    for each in found:
        if each.name.startswith("--"):
            values.setdefault(each.name, each.value)
    return resolved_variables(values)


def _ready(rules: Sequence[Rule], unknown: Counter[str]) -> dict[str, list[_Ready]]:
    """Rules by a fact that an element must have; those of unknown kinds are counted."""
    result: dict[str, list[_Ready]] = {}
    for number, rule in enumerate(rules):
        declarations = tuple(each for each in rule.declarations if each.name in _DRAWN)
        selector = parse_selector(rule.words) if declarations else None
        if selector is not None:
            ready = _Ready((selector.specificity, number), selector, declarations)
            result.setdefault(selector.key, []).append(ready)
        elif declarations and not rule.is_dynamic:
            unknown[f"rule of '{_short(rule.words)}'"] += 1
    return result


def _apply_rules(root: ET.Element, by_fact: Mapping[str, Sequence[_Ready]]) -> None:
    stack = [(root, [facts_of(root, is_root=True)])]
    n_trials = 0
    while stack:
        element, path = stack.pop()
        tried = [rule for fact in ("", *path[-1]) for rule in by_fact.get(fact, ())]
        n_trials += sum(1 if len(r.selector.compounds) == 1 else _PATH_TRIALS for r in tried)
        if n_trials > _MOST_TRIALS:
            raise FloorplanError(
                "expected style sheets of a drawing, found too many pairs of rules and "
                "elements; save it again as plain SVG"
            )
        matched = [rule for rule in tried if rule.selector.matches(path)]
        inner = [child for child in element if isinstance(child.tag, str)]
        stack += [(child, [*path, facts_of(child, is_root=False)]) for child in inner]
        _put(element, _cascade(element, matched))


def _outline_unstyled(root: ET.Element, styled: set[str], unknown: Counter[str]) -> None:
    """Give shapes an outline alone whose classes have their style in another file, as of a page of the web:
    without it a browser draws them black, rooms and walls alike."""
    stack = [(root, "")]
    while stack:
        element, lacking = stack.pop()
        if element.get("fill") is not None or element.get("stroke") is not None:
            continue
        classes = (element.get("class") or "").split()
        if classes and styled.isdisjoint(classes):
            lacking = " ".join(classes)
        stack += [(child, lacking) for child in element if isinstance(child.tag, str)]
        if lacking and element.tag in _SHAPES:
            element.set("fill", "none")
            element.set("stroke", "black")
            unknown[f"class '{_short(lacking)}', drawn as outlines"] += 1


def _cascade(element: ET.Element, matched: Sequence[_Ready]) -> dict[str, str]:
    """Properties of an element: of rules by their specificity, of its own style, of what is important."""
    ordered = sorted(matched, key=lambda rule: rule.order)
    found = [each for rule in ordered for each in rule.declarations]
    found += parse_declarations(element.attrib.pop("style", ""))
    return {each.name: each.value for each in sorted(found, key=lambda each: each.is_important)}


def _put(element: ET.Element, style: dict[str, str]) -> None:
    """Into the attributes: those that are inherited as they are around it are none of its own."""
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
    return (f"styles that were not understood: {'; '.join(named)}{more}: {COMPARE}",)

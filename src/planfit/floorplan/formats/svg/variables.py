"""Variables of CSS in an SVG, by which drawings of web pages name their colours and widths."""

import re
import xml.etree.ElementTree as ET

from planfit.floorplan.formats.svg.rules import STYLE, split_declarations, split_rules

_PART = r"[^()]{0,80}"  # bounded: of a name that is never closed, all ends would be tried
_VARIABLE = re.compile(rf"var\(\s*(--[^\s,()]+)\s*(?:,\s*({_PART}(?:\({_PART}\))?{_PART}))?\)")
_MOST_STEPS, _LONGEST = 8, 200
"""A variable may name others, so deep; values of colours and widths are no longer, in characters: each may
name two more."""


def with_values(data: bytes) -> bytes:
    """The same SVG with the values of variables in the place of their names: svgelements takes what it does
    not know for black.

    Those that hold for a dark screen or for print (in `@media`) are not taken, and of several rules the
    first, as themes follow what they change. What is nowhere set stays as it is.

    Args:
        data: well-formed XML, known to declare no entities.
    """
    if b"var(" not in data:
        return data
    root = ET.fromstring(data)
    values = _resolved(_declared(root))
    for element in root.iter():
        for name, text in element.attrib.items():
            if "var(" in text:
                element.set(name, _put(text, values))
        if element.tag == STYLE and element.text and "var(" in element.text:
            element.text = _put(element.text, values)
    return ET.tostring(root, encoding="utf-8")


def _declared(root: ET.Element) -> dict[str, str]:
    """Variables as they are written: of the whole drawing, of its rules, of single elements."""
    found = list(split_declarations(root.get("style", "")))
    for element in root.iter(STYLE):
        for rule in split_rules(element.text or ""):
            found += rule.declarations
    for element in root.iter():
        found += split_declarations(element.get("style", ""))
    values: dict[str, str] = {}
    for name, value in found:
        if name.startswith("--"):
            values.setdefault(name, value.replace("!important", "").strip())
    return values


def _resolved(values: dict[str, str]) -> dict[str, str]:
    """Values that name no other variables."""
    for _ in range(_MOST_STEPS):
        values = {
            name: _put(value, values) for name, value in values.items() if len(value) <= _LONGEST
        }
    return {name: value for name, value in values.items() if "var(" not in value}


def _put(text: str, values: dict[str, str]) -> str:
    """Values in the place of variables; where none is set, what the text says for that, or the name."""
    return _VARIABLE.sub(lambda found: values.get(found[1], found[2] or found[0]), text)

"""Variables of CSS in an SVG, by which drawings of web pages name their colours and widths."""

import re
import xml.etree.ElementTree as ET

_STYLE = "{http://www.w3.org/2000/svg}style"
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
        if element.tag == _STYLE and element.text and "var(" in element.text:
            element.text = _put(element.text, values)
    return ET.tostring(root, encoding="utf-8")


def _declared(root: ET.Element) -> dict[str, str]:
    """Variables as they are written: of the whole drawing, of its rules, of single elements."""
    rules = [element.text or "" for element in root.iter() if element.tag == _STYLE]
    own = [f"{{{element.get('style', '')}}}" for element in root.iter() if element.get("style")]
    whole = [f"{{{root.get('style', '')}}}"]
    values: dict[str, str] = {}
    for text in (*whole, *rules, *own):
        for name, value in _of_rules(text):
            values.setdefault(name, value)
    return values


def _of_rules(text: str) -> list[tuple[str, str]]:
    """Variables of rules that no condition holds in."""
    text = "".join(part.partition("/*")[0] for part in text.split("*/"))
    found, are_conditions, begun = [], [], ""
    n_conditions = 0
    for piece in re.split(r"([{};])", text):
        if piece == "{":
            are_conditions.append(begun.startswith("@"))
            n_conditions += are_conditions[-1]
        elif piece == "}":
            n_conditions -= are_conditions.pop() if are_conditions else 0
        elif piece != ";":
            begun = piece.strip()
            name, colon, value = begun.partition(":")
            if name.startswith("--") and colon and are_conditions and n_conditions == 0:
                found.append((name.strip(), value.replace("!important", "").strip()))
    return found


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

"""What an SVG draws by `use`: how large it becomes by that, and symbols, which are drawn by that alone."""

import math
import xml.etree.ElementTree as ET

_SVG = "{http://www.w3.org/2000/svg}"
_USE = f"{_SVG}use"
_HREFS = ("href", "{http://www.w3.org/1999/xlink}href")


def elements_when_expanded(root: ET.Element) -> float:
    """Number of elements with each `use` replaced by what it names; infinite where one names itself.

    Each element is counted once and remembered, so that ten levels of ten uses take no time.
    """
    by_id = {e.get("id"): e for e in root.iter() if e.get("id")}
    size: dict[ET.Element, float] = {}
    begun: set[ET.Element] = set()
    stack = [root]
    while stack:
        element = stack[-1]
        parts = list(element)
        if element.tag == _USE:
            name = next((element.get(key, "") for key in _HREFS if element.get(key)), "")
            target = by_id.get(name.removeprefix("#")) if name.startswith("#") else None
            parts += [] if target is None else [target]
        if element in size:
            stack.pop()
        elif element in begun:
            size[element] = 1.0 + sum(size.get(part, math.inf) for part in parts)
            stack.pop()
        elif any(part in begun and part not in size for part in parts):
            return math.inf  # it names one that it is in
        else:
            begun.add(element)
            stack.extend(part for part in parts if part not in size)
    return size[root]


def with_symbols_apart(data: bytes) -> bytes:
    """The same SVG with each symbol in a `defs` of its own: svgelements draws them where they are defined.

    Args:
        data: well-formed XML, known to declare no entities.
    """
    root = ET.fromstring(data)
    found = [
        (parent, k, child)
        for parent in root.iter()
        for k, child in enumerate(parent)
        if child.tag == f"{_SVG}symbol"
    ]
    for parent, k, symbol in found:
        definitions = ET.Element(f"{_SVG}defs")
        definitions.append(symbol)
        parent[k] = definitions
    return ET.tostring(root, encoding="utf-8") if found else data

"""What of an IFC model's walls is glass, which depth cameras look through.

A model says so by its materials, else by the names of its elements and their types. What a curtain wall has
no material for is glass, but for its posts and rails.
"""

import re
from typing import Any

_GLASS = re.compile(
    r"glas(?!ur)|glaz|vitr|verre|vidr|vetr|szk[lł]|lasi\b|стекл|זכוכית|玻璃|ガラス", re.IGNORECASE
)
"""Glass in English, German, Dutch, Nordic, French, Spanish, Portuguese, Italian, Polish, Finnish, Russian,
Hebrew, Chinese, Japanese."""
_NO_GLASS = re.compile(
    r"wool|wolle|watte|wol\b|fib|faser|vlies|vezel|laine|lana|wata|lasivill|glasull|вата|волок|block|brick|baustein|mosai|foam|schaum|"
    r"gewebe|tile|fliese|azulejo|carrel|cellular|zellul|ceram|keram|vitrif",
    re.IGNORECASE,
)
"""Insulation, glass blocks, tiles: opaque."""
_NOTHING = re.compile(r"\bair\b|luft|argon|krypton|lucht|lame d.air|cavity", re.IGNORECASE)
"""Between panes."""

MAX_DEPTH = 10
"""Of wholes of wholes: in a damaged file they go round in circles."""


def is_glass_element(element: Any, util_element: Any) -> bool:
    """Whether a wall, or a part of one, is of glass.

    Args:
        element: with geometry of its own.
        util_element: the module of the package that knows materials and types.
    """
    materials = [str(each.Name or "") for each in util_element.get_materials(element) or ()]
    materials = [name for name in materials if name and not _NOTHING.search(name)]
    if materials:
        return sum(map(_is_called_glass, materials)) > len(materials) / 2
    if element.is_a("IfcMember") or element.is_a("IfcColumn"):
        return False
    kind = util_element.get_type(element)
    names = (element.Name, element.ObjectType, kind.Name if kind is not None else None)
    if any(_is_called_glass(str(name)) for name in names if name):
        return True
    return element.is_a("IfcCurtainWall") or _is_panel(element, util_element)


def _is_called_glass(name: str) -> bool:
    return bool(_GLASS.search(name)) and not _NO_GLASS.search(name)


def _is_panel(element: Any, util_element: Any) -> bool:
    """Whether a plate is of a curtain wall, at any depth."""
    whole, steps = util_element.get_aggregate(element), 0
    while whole is not None and not whole.is_a("IfcCurtainWall") and steps < MAX_DEPTH:
        whole, steps = util_element.get_aggregate(whole), steps + 1
    is_part = whole is not None and whole.is_a("IfcCurtainWall")
    return element.is_a("IfcPlate") and is_part

"""Doors and windows of an IFC model: where walls would go on without them, and what fills them.

What is glass, which depth cameras look through, a model says by its materials, else by the names of its
elements and their types. What a curtain wall has no material for is glass, but for its posts and rails.
"""

import re
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.formats import MAX_DEPTH
from planfit.floorplan.vector.layer_names import counted
from planfit.floorplan.vector.regions import section_area
from planfit.geometry import segments

MIN_SIDE_M = 0.15
"""Narrower openings are shafts and pipes."""
_SKIN_M = 0.004
_NEAR_M = 0.6
"""A door or window stands within so much of the middle of its opening, or on it."""
_KINDS = (("IfcDoor", "door"), ("IfcWindow", "window"))
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


@dataclass(frozen=True)
class Openings:
    """At the height of a cut, m."""

    sides: Float[np.ndarray, "k 2 2"]
    """Along the faces that they interrupt."""
    kinds: tuple[str, ...]
    """Counted, in words: "5 doors"."""
    kind_of_side: tuple[str, ...] = ()
    """"door", "window" or "opening", of each side."""
    id_of_side: tuple[str, ...] = ()
    """GlobalId of the door or window that each side is of; empty where nothing fills the opening."""


class LevelCut:
    """Cuts elements of a model at a height, m."""

    def __init__(self, ifcopenshell: Any, height_m: float, with_openings: bool = True) -> None:
        self._geom, self._height_m = ifcopenshell.geom, height_m
        self._settings = ifcopenshell.geom.settings()
        self._settings.set("use-world-coords", True)
        self._settings.set("disable-opening-subtractions", not with_openings)

    def area_of(self, element: Any) -> BaseGeometry | None:
        """Area of solid there, m; None where the element has no geometry that can be made."""
        try:
            shape = self._geom.create_shape(self._settings, element)
        except RuntimeError:
            return None
        corners = np.array(shape.geometry.verts, dtype=float).reshape(-1, 3)
        triangles = np.array(shape.geometry.faces, dtype=int).reshape(-1, 3)
        return section_area(corners, triangles, self._height_m)


def find_openings(
    ifcopenshell: Any, walls: list[Any], solid: BaseGeometry, height_m: float, unit_scale: float
) -> Openings:
    """What walls with openings are cut to without them, less what stands.

    `solid`: area of all walls at the height, m, openings left out.
    """
    whole, voids = [], []
    cut = LevelCut(ifcopenshell, height_m, with_openings=False)
    for wall in walls:
        if not getattr(wall, "HasOpenings", ()) or wall.Representation is None:
            continue
        area = cut.area_of(wall)
        # What has no geometry has none with openings either, which is told.
        if area is not None and not area.is_empty:
            whole.append(area)
            gone = area.difference(solid.buffer(_SKIN_M, join_style="mitre"))
            voids += [v for v in shapely.get_parts(gone) if v.area > 0]
    if not voids:
        return Openings(np.zeros((0, 2, 2)), ())
    sides, kinds, of_sides = [], Counter(), []
    fillings = _fillings(ifcopenshell, walls, unit_scale)
    uncut = shapely.boundary(shapely.union_all(whole))
    near = uncut.buffer(_SKIN_M)
    for void in voids:
        found = _sides_of(void, near)
        if len(found):
            sides.append(found)
            filling = _filling_of(void, fillings, height_m)
            kinds[filling[0]] += 1
            of_sides += [filling] * len(found)
    listed = (counted(kinds[word], word) for word in ("door", "window", "opening"))
    return Openings(
        np.concatenate([*sides, np.zeros((0, 2, 2))]),
        tuple(filter(None, listed)),
        tuple(kind for kind, _ in of_sides),
        tuple(element_id for _, element_id in of_sides),
    )


def _sides_of(void: BaseGeometry, near_face: BaseGeometry) -> Float[np.ndarray, "k 2 2"]:
    """Edges of a void that lie on faces of the wall."""
    outline = shapely.simplify(shapely.get_exterior_ring(void), 2 * _SKIN_M)
    points = shapely.get_coordinates(outline)
    edges = np.stack([points[:-1], points[1:]], axis=1)
    edges = edges[segments.lengths(edges) > MIN_SIDE_M]
    lines = shapely.linestrings(edges)
    on_face = shapely.length(shapely.intersection(lines, near_face)) > 0.9 * shapely.length(lines)
    return edges[on_face]


def _fillings(
    ifcopenshell: Any, walls: list[Any], unit_scale: float
) -> list[tuple[str, str, Float[np.ndarray, "3"]]]:
    """Doors and windows in the openings of walls: their kind, their GlobalId, and where they stand, m."""
    result = []
    for wall in walls:
        for relation in getattr(wall, "HasOpenings", ()) or ():
            for filled in getattr(relation.RelatedOpeningElement, "HasFillings", ()) or ():
                element = filled.RelatedBuildingElement
                kind = next((word for name, word in _KINDS if element.is_a(name)), "opening")
                place = ifcopenshell.util.placement.get_local_placement(element.ObjectPlacement)
                result.append((kind, str(element.GlobalId), place[:3, 3] * unit_scale))
    return result


def _filling_of(
    void: BaseGeometry, fillings: list[tuple[str, str, Float[np.ndarray, "3"]]], height_m: float
) -> tuple[str, str]:
    """Kind and GlobalId of the nearest door or window that begins below the cut, on this storey."""
    nearest, filling = _NEAR_M, ("opening", "")
    for word, element_id, at in fillings:
        if height_m - 2.5 < at[2] <= height_m:
            distance = void.distance(shapely.Point(at[:2]))
            if distance < nearest:
                nearest, filling = distance, (word, element_id)
    return filling


def is_glass_element(element: Any, util_element: Any) -> bool:
    """Whether a wall, or a part of one, is of glass.

    `element`: with geometry of its own; `util_element`: the module of the package that knows materials and
    types.
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

"""Where on a map an IFC model lies: IfcMapConversion of IFC4, property sets of that name in IFC2X3."""

import math
from collections.abc import Mapping
from typing import Any

FARTHEST_M = 1.2e7
"""Coordinates of projected systems on Earth are smaller: beyond, they are in another unit than claimed."""


def map_words(model: Any, unit_scale: float) -> str:
    """Place of the model's origin and its turn, in words; empty where the model has none.

    Eastings and northings are in the unit of the projected system, or of the project; where the one that is
    claimed leads off the Earth, the other is meant.
    """
    conversion = _conversion(model)
    if not conversion:
        return ""
    east, north = (_number(conversion.get(name)) for name in ("Eastings", "Northings"))
    if east is None or north is None:
        return ""
    crs = _reference_system(model)
    metres = 1.0 if max(abs(east), abs(north)) < FARTHEST_M else unit_scale
    along = _number(conversion.get("XAxisAbscissa")), _number(conversion.get("XAxisOrdinate"))
    turn = math.degrees(math.atan2(along[1], along[0])) if None not in along else 0.0  # type: ignore[arg-type]
    scale = _number(conversion.get("Scale")) or 1.0
    words = f"origin at ({east * metres:.3f}, {north * metres:.3f}) m"
    if crs:
        words += f" in {crs}"
    words += f", x turned by {turn:.3f} deg"
    return words + (f", lengths times {scale:g}" if scale not in (1.0, unit_scale) else "")


def _conversion(model: Any) -> Mapping[str, Any]:
    if model.schema != "IFC2X3":
        for entity in model.by_type("IfcMapConversion"):
            return entity.get_info()
    return _property_set(model, "mapconversion")


def _reference_system(model: Any) -> str:
    """Name of the projected coordinate system."""
    if model.schema != "IFC2X3":
        for entity in model.by_type("IfcProjectedCRS"):
            return str(entity.Name or "")
    return str(_property_set(model, "projectedcrs").get("Name") or "")


def _property_set(model: Any, name: str) -> Mapping[str, Any]:
    """Of the site, the project or the building: ePSet_MapConversion, in any spelling."""
    import ifcopenshell.util.element

    for kind in ("IfcSite", "IfcProject", "IfcBuilding"):
        for element in model.by_type(kind):
            try:
                sets = ifcopenshell.util.element.get_psets(element)
            except (AttributeError, RuntimeError):
                continue
            for title, values in sets.items():
                if title.lower().replace("_", "").removeprefix("epset") == name:
                    return values
    return {}


def _number(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None

"""Where on a map an IFC model lies: IfcMapConversion of IFC4, property sets of that name in IFC2X3."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

FARTHEST_M = 1.2e7
"""Coordinates of projected systems on Earth are smaller (UTM northings end at 10,000 km): beyond, they are in
another unit than claimed."""


SAME_SCALE = 0.01
"""Scales of a conversion this near to each other, as a share, differ by the projection, not by the unit."""


@dataclass(frozen=True)
class MapConversion:
    """Where a model's origin lies on a map, and how it is turned there."""

    east_m: float
    north_m: float
    turn_rad: float
    """Of the model's x from the easting, counter-clockwise."""
    scale: float
    """As the file has it."""
    unit_scale: float
    """Metres of one unit of the model."""
    system: str
    """Name of the projected system; empty where the file has none."""

    @property
    def words(self) -> str:
        """For people."""
        words = f"origin at ({self.east_m:.3f}, {self.north_m:.3f}) m"
        if self.system:
            words += f" in {self.system}"
        words += f", x turned by {math.degrees(self.turn_rad):.3f} deg"
        is_plain = self.scale in (1.0, self.unit_scale)
        return words + ("" if is_plain else f", lengths times {self.scale:g}")

    @property
    def map_from_file(self) -> Float[np.ndarray, "3 3"] | None:
        """From the model's coordinates, in its unit, to the map, m; None where the scale makes no sense.

        The scale of the standard turns units into those of the map; files have the projection's alone, too.
        """
        lengths = [
            by for by in (self.scale / self.unit_scale, self.scale) if abs(by - 1) < SAME_SCALE
        ]
        if not lengths:
            return None
        metres = self.unit_scale * lengths[0]
        c, s = metres * math.cos(self.turn_rad), metres * math.sin(self.turn_rad)
        return np.array([[c, -s, self.east_m], [s, c, self.north_m], [0.0, 0.0, 1.0]])


def map_conversion(model: Any, unit_scale: float) -> MapConversion | None:
    """Place of the model's origin and its turn; None where the model has none.

    Eastings and northings are in the unit of the projected system, or of the project; where the one that is
    claimed leads off the Earth, the other is meant.
    """
    conversion = _conversion(model)
    if not conversion:
        return None
    east, north = (_number(conversion.get(name)) for name in ("Eastings", "Northings"))
    if east is None or north is None:
        return None
    metres = 1.0 if max(abs(east), abs(north)) < FARTHEST_M else unit_scale
    x, y = _number(conversion.get("XAxisAbscissa")), _number(conversion.get("XAxisOrdinate"))
    turn = 0.0 if x is None or y is None else math.atan2(y, x)
    scale = _number(conversion.get("Scale")) or 1.0
    system = _reference_system(model)
    return MapConversion(east * metres, north * metres, turn, scale, unit_scale, system)


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

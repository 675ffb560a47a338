"""Storeys of GeoJSON: told by whatever property keeps rooms apart that lie on one another.

Exporters call it level, floorId, etage, baseHeight or anything else. What storeys are, geometry knows: two
rooms of one storey share no ground. So the property of which no value holds two such rooms tells them.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from jaxtyping import Bool, Int
from shapely.geometry.base import BaseGeometry

from planfit.errors import FloorplanError
from planfit.floorplan.faces import at_most, in_blocks
from planfit.floorplan.vector.layer_names import words_of
from planfit.runtime import whole_number

Properties = Mapping[str, str | float]
"""Of one feature: those that are texts or numbers."""

STANDARD = ("level_id", "level")
"""Of IMDF, and of indoor maps in OpenStreetMap."""
_RANGE = re.compile(r"(-?\d{1,3})-(-?\d{1,3})")
"""Of levels in OpenStreetMap; lists have semicolons."""
_MOST_LEVELS = 200
"""Of a range: the tallest building has 163. A file may have a range for each of its features."""
_STOREY_NAMES = """
    level floor storey story etage niveau geschoss stockwerk planta piso andar piano livello
    verdieping bouwlaag plan vaning kerros pietro kat
"""
_STOREY_WORDS = frozenset(_STOREY_NAMES.split())
_NEARLY_ALL = 0.95
"""Of a smaller area that lies in another, as a cupboard in its room: neighbours that are drawn to the middle
of their wall share less than the rest of it. And of the pairs that lie on one another, those that are kept
apart: some shafts and galleries are drawn on two storeys."""

MAX_MEETING = 2_000_000
"""Areas that meet, each pair counted from either: what they share takes 20 s. A tower of 50 storeys with 40
rooms each has half as many."""


@dataclass(frozen=True)
class ToldStoreys:
    """Storeys of each feature, as shafts and stairs have several, and how they are known."""

    of_feature: tuple[tuple[str, ...], ...]
    """As the file calls them; none where a feature tells none, as it is on all."""
    order: tuple[str, ...]
    """From the lowest on."""
    warnings: tuple[str, ...] = ()


def told_storeys(
    properties: Sequence[Properties],
    rooms: Sequence[int],
    areas: Sequence[BaseGeometry],
    is_wall: Bool[np.ndarray, " n"],
) -> ToldStoreys:
    """By the standard properties, else by one that keeps `rooms` apart, else by the order in the file.

    Args:
        properties: of all features.
        rooms: which of them bound the plan.
        areas: of all features, any unit.
        is_wall: of all features: rooms may reach under the walls around them.
    """
    standard = [
        next((_as_told(each[key]) for key in STANDARD if key in each), "") for each in properties
    ]
    pairs, are_crossing = _lying_on_one_another([areas[i] for i in rooms])
    of_walls = is_wall[list(rooms)]
    n_walls = of_walls[pairs].sum(axis=1)
    # Walls of one storey cross one another; where there are rooms, these tell whether there are several.
    is_one_storey = not of_walls.all() and not (n_walls == 0).any()
    is_telling = (n_walls != 1) & (not is_one_storey)
    pairs, are_crossing = pairs[is_telling], are_crossing[is_telling]
    if any(standard) or not len(pairs):
        return _as_listed(standard, properties)
    of_rooms = [properties[i] for i in rooms]
    keys = list(dict.fromkeys(key for each in of_rooms for key in each))
    named = [key for key in keys if words_of(key) & _STOREY_WORDS]
    found = [key for key in named if _keeps_apart(of_rooms, key, pairs)]
    pairs = pairs[are_crossing]
    if not found and len(pairs):
        everywhere = [key for key in keys if all(key in each for each in of_rooms)]
        found = [key for key in everywhere if _keeps_apart(of_rooms, key, pairs)]
        found.sort(key=lambda key: len({each[key] for each in of_rooms}))
        found = found if found and len({each[found[0]] for each in of_rooms}) < len(rooms) else []
    if found:
        return _as_listed([_as_told(each.get(found[0], "")) for each in properties], properties)
    if not len(pairs):
        return ToldStoreys(((),) * len(properties), ())
    return _by_order_of_file(len(properties), rooms, pairs)


def _as_listed(told: Sequence[str], properties: Sequence[Properties]) -> ToldStoreys:
    """By what each feature tells: one storey, or in the words of OpenStreetMap several, "0;1" or "-1-2"."""
    of_feature = tuple(tuple(dict.fromkeys(_listed(value))) for value in told)
    alone = [each[0] if len(each) == 1 else "" for each in of_feature]
    order = _in_order(alone, properties)
    more = sorted({level for each in of_feature for level in each} - set(order))
    if more:
        order = _in_order([*order, *more], ({},) * (len(order) + len(more)))
    return ToldStoreys(of_feature, order)


def _listed(value: str) -> list[str]:
    levels = []
    for part in filter(None, (part.strip() for part in value.split(";"))):
        ends = _RANGE.fullmatch(part)
        if ends is not None and 0 <= int(ends[2]) - int(ends[1]) < _MOST_LEVELS:
            levels += [str(level) for level in range(int(ends[1]), int(ends[2]) + 1)]
        else:
            levels.append(part)
    return levels


def _lying_on_one_another(
    areas: Sequence[BaseGeometry],
) -> tuple[Int[np.ndarray, "k 2"], Bool[np.ndarray, " k"]]:
    """Pairs of areas that share ground, and which of these are not one within a larger one."""
    size = shapely.area(np.array(areas, dtype=object))
    solid = np.flatnonzero(size)  # lines share none
    shapes, size = np.array(areas, dtype=object)[solid], size[solid]
    meeting = in_blocks(shapes, shapely.STRtree(shapes))
    found = f"around areas of which {MAX_MEETING} pairs meet"
    blocks = map(np.stack, at_most(MAX_MEETING, meeting, len(shapes), found))
    i, j = np.concatenate([np.zeros((2, 0), dtype=int), *blocks], axis=1)
    i, j = i[i < j], j[i < j]
    shared = shapely.area(shapely.intersection(shapes[i], shapes[j]))
    smaller, larger = np.minimum(size[i], size[j]), np.maximum(size[i], size[j])
    is_lying = shared > (1 - _NEARLY_ALL) * smaller
    is_within = (shared > _NEARLY_ALL * smaller) & (smaller < _NEARLY_ALL * larger)
    return solid[np.stack([i, j], axis=1)[is_lying]], ~is_within[is_lying]


def _keeps_apart(rooms: Sequence[Properties], key: str, pairs: Int[np.ndarray, "k 2"]) -> bool:
    values = [each.get(key) for each in rooms]
    return sum(values[i] != values[j] for i, j in pairs) >= _NEARLY_ALL * len(pairs)


def _in_order(told: Sequence[str], properties: Sequence[Properties]) -> tuple[str, ...]:
    """Values that are told, by their number; else by a number that each feature has, one on each storey, as
    a height above ground; else as text."""
    values = sorted({value for value in told if value})
    if all(_is_number(value) for value in values):
        return tuple(sorted(values, key=float))
    here = [(value, each) for value, each in zip(told, properties, strict=True) if value]
    for key in here[0][1]:
        heights: dict[str, set[str | float | None]] = {}
        for value, each in here:
            heights.setdefault(value, set()).add(each.get(key))
        told_by = {value: next(iter(seen)) for value, seen in heights.items() if len(seen) == 1}
        numbers = {value: seen for value, seen in told_by.items() if isinstance(seen, float)}
        if len(set(numbers.values())) == len(values):
            return tuple(sorted(values, key=numbers.__getitem__))
    return tuple(values)


def _as_told(value: str | float | None) -> str:
    """Whole numbers without a decimal point, as files have them."""
    return str(int(value)) if isinstance(value, float) and value.is_integer() else str(value)


def _is_number(value: str) -> bool:
    try:
        return bool(np.isfinite(float(value)))
    except ValueError:
        return False


def _by_order_of_file(
    n_features: int, rooms: Sequence[int], pairs: Int[np.ndarray, "k 2"]
) -> ToldStoreys:
    """Files list storey by storey: one begins where a room lies on one of the storey before."""
    under: dict[int, list[int]] = {}
    for i, j in pairs:
        under.setdefault(int(j), []).append(int(i))
    told: list[tuple[str, ...]] = [()] * n_features
    storey, first = 0, 0
    for number, feature in enumerate(rooms):
        if any(other >= first for other in under.get(number, [])):
            storey, first = storey + 1, number
        told[feature] = (str(storey),)
    warning = (
        f"rooms lie on one another and no property tells their storeys: taken as {storey + 1} storeys in the "
        "order of the file; check the overlay (-o FILE.png)"
    )
    return ToldStoreys(tuple(told), tuple(str(k) for k in range(storey + 1)), (warning,))


def level_names(collections: Sequence[tuple[str, Any]], used: Sequence[str]) -> dict[str, str]:
    """Names of levels by what features call them, from the lowest on; those without a name by that itself.

    Two of one name, as the ground floors of two buildings, are told apart by a number.

    `collections`: pairs of (name of the part, parsed JSON); `used`: levels that features are on, from the
    lowest on as far as is known.
    """
    found: dict[str, tuple[float, str]] = {}
    for kind, data in collections:
        features = data.get("features") if isinstance(data, dict) else None
        for feature in features if isinstance(features, list) else []:
            if not isinstance(feature, dict):
                continue
            if "level" not in (kind, feature.get("feature_type")) or not feature.get("id"):
                continue
            properties = feature.get("properties")
            properties = properties if isinstance(properties, dict) else {}
            ordinal = properties.get("ordinal")
            order = float(ordinal) if isinstance(ordinal, int | float) else 0.0
            found[str(feature["id"])] = (order, _words(properties))
    names: dict[str, str] = {}
    listed = sorted(found, key=lambda level: (found[level][0], level))
    for level in [*listed, *(level for level in used if level not in found)]:
        name = (found[level][1] if level in found else "") or level
        n_alike = sum(n == name or n.startswith(f"{name} (") for n in names.values())
        names[level] = f"{name} ({n_alike + 1})" if n_alike else name
    return names


def _words(properties: dict[str, Any]) -> str:
    """The name, in English where the file has it in several languages."""
    for key in ("name", "short_name"):
        value = properties.get(key)
        if isinstance(value, dict):
            value = value.get("en") or next(iter(value.values()), "")
        if isinstance(value, str) and value.strip():
            return value.strip()
    return ""


def chosen_level(path: object, wanted: str, names: dict[str, str], used: Sequence[str]) -> str:
    """The level that is asked for by name, number from 0 or what features call it; where none is, the lowest
    with features.

    Raises:
        FloorplanError: there is no such level.
    """
    if not wanted:
        return next((level for level in names if level in used), "")
    levels = list(names)
    if wanted in levels:
        return wanted
    for level, name in names.items():
        if name.casefold() == wanted.casefold():
            return level
    number = whole_number(wanted)
    if number is not None and number < len(levels):
        return levels[number]
    raise FloorplanError(
        f"{path}: expected a storey {wanted!r}, found {', '.join(names.values()) or 'none'}; "
        "pass one of them"
    )

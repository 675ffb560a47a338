"""Levels of IMDF and GeoJSON: what the file calls them, in the order of the building."""

from collections.abc import Sequence
from typing import Any

from planfit.errors import FloorplanError
from planfit.runtime import whole_number


def level_names(collections: Sequence[tuple[str, Any]], used: Sequence[str]) -> dict[str, str]:
    """Names of levels by what features call them, from the lowest on; those without a name by that itself.

    Two of one name, as the ground floors of two buildings, are told apart by a number.

    Args:
        collections: pairs of (name of the part, parsed JSON).
        used: levels that features are on, from the lowest on as far as is known.
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
        name = found[level][1] if level in found else ""
        name = name or level
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

"""JSON: planfit's own plans, and rooms captured by Apple's RoomPlan."""

import json
from pathlib import Path

from planfit.errors import FloorplanError
from planfit.floorplan.formats.own_formats import read_json as read_own
from planfit.floorplan.formats.room_plan import is_room_plan, plan_of_rooms
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.types import Floorplan


def read_json(path: Path, options: PlanOptions) -> Floorplan:
    """Wall faces of a plan in JSON, of either kind.

    Raises:
        FloorplanError: it is of neither, or damaged.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError):
        return read_own(path, options)  # says what is wrong with it
    if is_room_plan(content):
        return plan_of_rooms(content, path, options)
    other = _of_another_kind(content)
    if other:
        raise FloorplanError(
            f"{path}: expected a plan in planfit's own JSON or of RoomPlan, found {other}"
        )
    return read_own(path, options)


def _of_another_kind(content: object) -> str:
    """What JSON of a kind that is not read here is, and what to do with it; empty where nothing tells."""
    if not isinstance(content, dict):
        return ""
    if content.get("type") == "CityJSON":
        return (
            f"a CityJSON model of {len(content.get('CityObjects') or ())} objects, which is not read; "
            "export it as IFC or OBJ, or its rooms as GeoJSON"
        )
    if content.get("type") in ("FeatureCollection", "Feature"):
        return "GeoJSON; rename it to .geojson"
    return ""

"""JSON: planfit's own plans, and rooms captured by Apple's RoomPlan."""

import json
from pathlib import Path

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
    return read_own(path, options)

"""Four kinds of plan, made of the faces of a synthetic building."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from ezdxf.filemanagement import new

from planfit.floorplan import Floorplan, read_floorplan
from planfit.geometry import segments

UNITS_PER_M = 40.0
"""Of the drawing without a unit; no unit that drawings have, so nothing but the scan tells it."""
_LAYER = "A-WALL"
"""As architects call it; planfit's own names would be read as they were written."""
_THICKEST_M, _THINNEST_M, _SHORTEST_M = 0.4, 0.02, 0.5
"""Of walls that are drawn by their centre lines."""


def faces(plan: Floorplan) -> Floorplan:
    """Both faces of each wall, exactly, in metres."""
    return plan


def centre_lines(plan: Floorplan) -> Floorplan:
    """A line in the middle of each wall, its free side unknown, in metres."""
    along, lines = segments.directions(plan.ends), []
    for i in range(len(plan)):
        for j in range(i):
            behind = float((plan.ends[j, 0] - plan.ends[i, 0]) @ plan.normals[i])
            is_back = plan.normals[i] @ plan.normals[j] < -0.99
            if not (is_back and -_THICKEST_M < behind < -_THINNEST_M):
                continue
            at = np.sort((plan.ends[j] - plan.ends[i, 0]) @ along[i])
            first, last = max(at[0], 0.0), min(at[1], plan.lengths[i])
            if last - first > _SHORTEST_M:
                middle = plan.ends[i, 0] + 0.5 * behind * plan.normals[i]
                lines.append(middle + np.array([first, last])[:, None] * along[i])
    return Floorplan.from_segments(
        lines, np.full((len(lines), 2), np.nan), name="golden centre lines"
    )


def drawing(plan: Floorplan) -> Floorplan:
    """What is read from a DXF file of lines, in a unit that it does not state."""
    document = new(units=0)
    document.layers.add(_LAYER)
    for first, last in UNITS_PER_M * plan.ends:
        document.modelspace().add_line(tuple(first), tuple(last), dxfattribs={"layer": _LAYER})
    with TemporaryDirectory() as folder:
        path = Path(folder) / "golden.dxf"
        document.saveas(path)
        return read_floorplan(path)


def no_plan(_plan: Floorplan) -> None:
    """The scan has to agree with itself."""


PLANS: dict[str, Callable[[Floorplan], Floorplan | None]] = {
    "faces": faces,
    "centre lines": centre_lines,
    "drawing": drawing,
    "no plan": no_plan,
}
"""By name."""

"""Outer walls as two nested outlines, thick beside the lines of furniture, in a drawing without a unit."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from planfit.floorplan import read_floorplan
from planfit.floorplan.vector.closed_pieces import outer_wall
from planfit.floorplan.vector.drawing import DrawingBuilder

CORNERS = [
    (216, 60, 346, 100), (900, 60, 1300, 120), (70, 300, 150, 420), (930, 70, 1270, 78),
    (1300, 400, 1500, 403), (500, 500, 690, 503),
]  # fmt: skip
FURNITURE = [shapely.box(*corners) for corners in CORNERS]


def written(path: Path, thickness: float) -> Path:
    outer = shapely.box(0, 0, 1600, 800)
    inner = outer.buffer(-thickness, join_style="mitre")
    # What stands along the wall begins at it.
    low = 60.0 - thickness
    areas = [outer, inner, *(shapely.transform(f, lambda xy: xy - (0.0, low)) for f in FURNITURE)]
    lines = ["M" + " L".join(f"{x},{y}" for x, y in area.exterior.coords) + "Z" for area in areas]
    lines += [f"M{x},{thickness} V{800 - thickness}" for x in (700, 712)]
    paths = "".join(f'<path d="{line}"/>' for line in lines)
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="1700" height="900" viewBox="-50 -50 1700 900">'
        f'<g fill="none" stroke="black">{paths}</g></svg>'
    )
    return path


@pytest.mark.parametrize("thickness", [14, 30, 46, 60])
def test_thick_outer_walls_are_read_in_a_furnished_room(tmp_path: Path, thickness: float) -> None:
    plan = read_floorplan(written(tmp_path / "a.svg", thickness))
    ends = plan.ends.reshape(-1, 2)
    np.testing.assert_allclose(np.ptp(ends, axis=0), [1600, 800], atol=1.0)
    box = shapely.box(*ends.min(axis=0), *ends.max(axis=0))
    for ring in (box.exterior, box.buffer(-thickness, join_style="mitre").exterior):
        faces = shapely.buffer(shapely.multilinestrings(plan.ends), 2.0)
        assert ring.intersection(faces).length > 0.9 * ring.length


@pytest.mark.parametrize("is_frame", [True, False])
def test_two_frames_around_a_sheet_are_no_wall(is_frame: bool) -> None:
    """In a frame nothing ends."""
    builder = DrawingBuilder()
    outer = shapely.box(0, 0, 1600, 800)
    away = 50.0 if is_frame else 0.0
    for area in (outer, outer.buffer(-46, join_style="mitre")):
        points = shapely.get_coordinates(area)
        builder.add_polyline(points, np.zeros(4, dtype=bool), "", "")
    for x in (300, 312, 700, 712):
        ends = np.array([[x, 46.0 + away], [x, 754.0 - away]])
        builder.add_polyline(ends, np.zeros(1, dtype=bool), "", "")
    assert outer_wall(builder.build().lines, 64.0, 1600.0).is_empty == is_frame

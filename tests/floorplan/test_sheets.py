"""What a sheet has around its plan: broken trims, frames, tables and marks of sections are no walls."""

import numpy as np
import pytest
import shapely

from planfit.floorplan.vector.areas import sort_fills
from planfit.floorplan.vector.drawing import DrawingBuilder, Fill, Lines
from planfit.floorplan.vector.layer_names import Role
from planfit.floorplan.vector.sheet import lines_of_frame, lines_of_tables

HOUSE = shapely.box(300, 200, 1000, 700)


def a_sheet() -> Lines:
    """A house in a frame, in a trim of which one side ends half way, with marks for folding across both."""
    builder = DrawingBuilder()

    def add(*points: tuple[float, float], is_curved: bool = False) -> None:
        n = len(points) - 1
        builder.add_polyline(np.array(points, float), np.full(n, is_curved), "", "")

    add((0, 600), (0, 0), (1600, 0), (1600, 900), (0, 900))
    add(*shapely.get_coordinates(shapely.box(60, 15, 1585, 885)))
    for u in (400, 800, 1200):
        add((u, 0), (u, 100))
    for v in (300, 600):
        add((0, v), (120, v))
    for inset in (0, 12):
        # A wide opening: an outline without one is a frame too.
        add(*shapely.get_coordinates(HOUSE.buffer(-inset, join_style="mitre"))[:-1])
    for u in (600, 610, 700, 710, 800, 810):
        add((u, 212), (u, 688))
    turned = np.linspace(0, np.pi / 2, 9)
    add(*np.stack([500 + 60 * np.cos(turned), 212 + 60 * np.sin(turned)], 1), is_curved=True)
    return builder.build().lines


def test_a_frame_in_a_broken_trim_is_found() -> None:
    lines = a_sheet()
    found = lines_of_frame(lines)
    in_house = shapely.covers(HOUSE.buffer(1), shapely.linestrings(lines.ends))
    assert not found[in_house].any()
    on_frame = shapely.covers(
        shapely.box(60, 15, 1585, 885).exterior.buffer(1), shapely.linestrings(lines.ends)
    )
    assert found[on_frame].all()


@pytest.mark.parametrize("gaps", [(20, 20), (12, 28)])
def test_rules_of_tables_meet_nothing_and_treads_meet_their_walls(gaps: tuple[int, int]) -> None:
    v = np.cumsum(np.tile(gaps, 6)).astype(float)
    rules = np.stack([np.stack([0 * v + 1200, v], 1), np.stack([0 * v + 1450, v], 1)], axis=1)
    treads = rules - (800.0, 0.0)
    walls = np.array([[[400.0, 0.0], [400.0, 300.0]], [[650.0, 0.0], [650.0, 300.0]]])
    builder = DrawingBuilder()
    for ends in np.concatenate([rules, treads, walls]):
        builder.add_polyline(ends, np.zeros(1, dtype=bool), "", "")
    found = lines_of_tables(builder.build().lines, 1600.0)
    assert found[: len(v)].all()
    assert not found[len(v) :].any()


def test_triangles_beside_filled_walls_are_marks() -> None:
    wall = shapely.difference(HOUSE, HOUSE.buffer(-12, join_style="mitre"))
    # Walls are filled triangle by triangle, too.
    pieces = [*shapely.get_parts(shapely.delaunay_triangles(wall))]
    pieces = [piece for piece in pieces if shapely.contains(wall, piece.centroid)]
    mark = shapely.Polygon([(280, 450), (300 - 4, 440), (300 - 4, 460)])
    fills = tuple(Fill(polygon, 0, (0, 0, 0)) for polygon in [*pieces, mark])
    for role in (Role.UNKNOWN, Role.WALL):
        walls, _ = sort_fills(fills, [role], 1600.0, np.zeros((0, 2, 2)))
        difference = shapely.symmetric_difference(shapely.union_all(walls), wall)
        assert difference.area < 1e-3 * wall.area

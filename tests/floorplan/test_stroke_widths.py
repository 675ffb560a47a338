"""Strokes of a picture by their width: walls down to partitions, without what a pen drew."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import shapely
from drawn_plans.site_masks import as_picture, flat

from planfit.floorplan import read_floorplan
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.raster import plan_of_picture
from planfit.floorplan.raster.stroke_widths import kinds_of_strokes, least_wall_width

EXTENT = 800.0


@pytest.mark.parametrize("partition_px", [5, 7, 9])
@pytest.mark.parametrize("pen_px", [1, 2])
def test_partitions_are_walls_and_swings_of_doors_are_none(partition_px: int, pen_px: int) -> None:
    found = least_wall_width(flat(partition_px=partition_px, pen_px=pen_px), EXTENT)
    assert pen_px < found.least_px <= partition_px
    assert found.is_all == (pen_px == 1)  # what is thinner than two pixels is not looked at


def test_all_is_wall_where_no_pen_drew() -> None:
    found = least_wall_width(flat(), EXTENT)
    assert found.is_all
    assert 0 < found.least_px <= 6
    assert found.unsure_px == 0


def test_walls_drawn_as_single_strokes_are_walls() -> None:
    found = least_wall_width(flat(outer_px=2, partition_px=2), EXTENT)
    assert found.is_all
    assert found.least_px == 2


def test_two_lines_a_wall_are_no_solid_walls() -> None:
    ink = flat(outer_px=20, partition_px=14)
    lines = ink - cv2.erode(ink, np.ones((7, 7), np.uint8))
    assert least_wall_width(lines, EXTENT).least_px == 0


def test_nothing_has_no_walls() -> None:
    assert least_wall_width(np.zeros((50, 50), np.uint8), 50.0).least_px == 0


def test_kinds_go_from_thick_to_thin_and_hold_all_that_is_drawn() -> None:
    ink = flat(pen_px=2)
    kinds = list(kinds_of_strokes(ink, EXTENT))
    assert [kind.is_base for kind in kinds] == [True, False, False]
    widths = [kind.least_px for kind in kinds]
    assert widths == sorted(widths, reverse=True)
    assert [round(kind.thickness_px) for kind in kinds] == pytest.approx([14, 6, 2], abs=1)
    area = sum(region.area for kind in kinds for region in kind.regions)
    assert area == pytest.approx(ink.sum(), rel=0.1)
    partitions, pen = kinds[1:]
    assert partitions.log_odds > 0 > pen.log_odds


def test_faces_of_a_flat_with_swings_are_those_of_its_walls() -> None:
    with_pen, without = flat(pen_px=2), flat()
    read = [plan_of_picture(as_picture(ink), "flat.png", "", PlanOptions(), "picture")
            for ink in (with_pen, without)]  # fmt: skip
    length = [np.linalg.norm(np.diff(plan.ends, axis=1), axis=2).sum() for plan in read]
    assert length[0] == pytest.approx(length[1], rel=0.03)


def test_what_may_be_walls_or_a_pen_s_is_told() -> None:
    # A fifth as thick as the outer walls: as likely thin partitions.
    ink = flat(pen_px=3)
    assert 3 <= least_wall_width(ink, EXTENT).unsure_px < 5
    assert least_wall_width(flat(pen_px=1), EXTENT).unsure_px == 0
    warnings = plan_of_picture(
        as_picture(ink), "flat.png", "", PlanOptions(), "picture"
    ).source.warnings
    assert any("4 px thick" in words for words in warnings)


@pytest.mark.parametrize("line_px", [1, 2, 3, 4])
@pytest.mark.parametrize("thickness_px", [14, 30])
def test_two_lines_of_a_wall_are_no_walls_however_thick_and_far_apart(
    tmp_path: Path, line_px: int, thickness_px: int
) -> None:
    """Lines of 3 px about an outer wall of 30 px are too far apart to be told by that."""
    rooms = [shapely.box(100, 100, 700, 600), shapely.box(700, 100, 1500, 600)]
    rooms += [shapely.box(100, 600, 900, 1100), shapely.box(900, 600, 1500, 1100)]
    edges = shapely.union_all([room.exterior for room in rooms])
    inner = shapely.buffer(edges, 7, cap_style="square", join_style="mitre")
    shell = shapely.box(100, 100, 1500, 1100).exterior
    walls = inner | shapely.buffer(shell, thickness_px / 2, join_style="mitre")
    for u, v in ((700, 300), (400, 600), (1200, 600), (900, 850)):
        walls -= shapely.box(u - 45, v - 45, u + 45, v + 45)
    picture = np.full((1200, 1600), 255, np.uint8)
    for ring in (r for part in shapely.get_parts(walls) for r in (part.exterior, *part.interiors)):
        corners = np.round(shapely.get_coordinates(ring)).astype(np.int32)
        cv2.polylines(picture, [corners], True, 0, line_px)
    cv2.imwrite(str(tmp_path / "plan.png"), picture)
    plan = read_floorplan(tmp_path / "plan.png")
    assert plan.source.kind.startswith("raster picture, walls double lines")
    assert plan.lengths.sum() == pytest.approx(walls.length, rel=0.05)

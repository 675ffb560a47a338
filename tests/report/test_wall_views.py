"""Walls by their scanned points: which show a wall, how far they are from it, cut across and in front."""

from dataclasses import replace

import numpy as np
import pytest

from planfit.as_built import compare_as_built
from planfit.report.html.page import make_report
from planfit.report.plots.drawing import Cells
from planfit.report.plots.maps import RANGE_M
from planfit.report.plots.wall_views import (
    draw_front,
    furthest_off,
    most_changed,
    scanned_walls,
)
from report.scenes import room_plan
from test_report import OFFSET, make_result

OFFSETS = (0.0, 0.1, 0.0, -0.14)
"""m, of the walls at y = 0, x = 8, y = 6 and x = 0, seen from inside."""


@pytest.fixture(scope="module")
def seen():
    result = replace(make_result(n_frames=12, wall_offsets=OFFSETS), floorplan=room_plan())
    return result, compare_as_built(result)


def test_cross_sections_show_distance_and_height(seen):
    walls = {one.wall.face_idx: one for one in scanned_walls(*seen)}
    assert set(walls) == {0, 1, 2, 3}
    # Recorded poses are off along x: walls 1 and 3 stand across that.
    assert {one.wall.face_idx for one in most_changed(list(walls.values()))} == {1, 3}
    assert_close = np.testing.assert_allclose
    assert_close(walls[1].after[:, 1], 0.1, atol=1e-9)
    assert_close(walls[1].before[:, 1], 0.1 - OFFSET[0], atol=1e-9)
    assert_close(walls[3].before[:, 1], OFFSET[0] - 0.14, atol=1e-9)
    heights = walls[3].after[:, 2]
    assert heights.min() > 0.5 - 1e-9
    assert heights.max() < 2.5 + 1e-9


def test_a_wall_is_seen_from_its_room_from_left_to_right(seen):
    """Who looks from inside at the wall y = 0 of 8 m has larger x on the left; points lie at x of 2 to 4."""
    below, above = (
        next(one for one in scanned_walls(*seen) if one.wall.face_idx == face) for face in (0, 2)
    )
    assert (below.after[:, 0].min(), below.after[:, 0].max()) == pytest.approx((4.0, 6.0))
    assert (above.after[:, 0].min(), above.after[:, 0].max()) == pytest.approx((2.0, 4.0))


def test_walls_that_stand_elsewhere_are_shown_first_and_cell_by_cell(seen):
    result, as_built = seen
    moved = furthest_off(scanned_walls(result, as_built))
    assert [one.wall.face_idx for one in moved] == [3, 1]
    (cells,) = (item for item in draw_front(moved[0]).items[:1] if isinstance(item, Cells))
    used = cells.idx > 0
    # Columns of 0.1 m over 6 m: wall is seen from 2 to 4 m, at the same distance everywhere.
    assert cells.idx.shape[1] == 60
    assert np.flatnonzero(used.any(axis=0)).tolist() == list(range(20, 41))
    assert np.unique(cells.idx[used]).tolist() == [1 + round(254 * (0.5 - 0.5 * 0.14 / RANGE_M))]
    # Where none stands elsewhere, the longest that was seen.
    none = replace(make_result(n_frames=12), floorplan=room_plan())
    (longest,) = furthest_off(scanned_walls(none, compare_as_built(none)))
    assert longest.wall.length_m == 8.0


def test_walls_of_a_plan_that_the_scan_saw_nothing_of_have_no_picture(seen):
    result, as_built = seen
    unseen = replace(as_built, walls=tuple(replace(w, offset_m=np.nan) for w in as_built.walls))
    assert scanned_walls(result, unseen) == []
    page = make_report("scan", result.floorplan, result, "", as_built=unseen)
    assert "Walls from the front" not in page
    assert "Walls from the front" in make_report(
        "scan", result.floorplan, result, "", as_built=as_built
    )

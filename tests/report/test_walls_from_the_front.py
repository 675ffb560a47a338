"""Walls from the front: which points show a wall, from left to right, and how far they are from it."""

from dataclasses import replace

import numpy as np
import pytest

from planfit.as_built import compare_as_built
from planfit.findings.finding import FEW_NAMED
from planfit.report.html.page import make_report
from planfit.report.plots.drawing import Cells
from planfit.report.plots.maps import RANGE_M, wall_front, walls_to_show
from report.scenes import room_plan
from test_report import make_result

OFFSETS = (0.06, 0.1, -0.08, -0.14)
"""m, of the walls at y = 0, x = 8, y = 6 and x = 0, seen from inside."""


def seen(offsets_m=OFFSETS, n_frames=16):
    result = replace(make_result(n_frames, offsets_m), floorplan=room_plan())
    return result, compare_as_built(result)


def test_walls_that_stand_elsewhere_are_shown_and_the_furthest_first():
    shown = walls_to_show(*seen())
    assert len(shown) == FEW_NAMED
    assert [one.wall.face_idx for one in shown] == [3, 1, 2]
    for one in shown:
        np.testing.assert_allclose(one.points[:, 1], OFFSETS[one.wall.face_idx], atol=1e-9)
        assert one.points[:, 2].min() > 0.5 - 1e-9
        assert one.points[:, 2].max() < 2.5 + 1e-9
        assert one.number == one.wall.face_idx + 1


@pytest.mark.parametrize(("face", "ends_m"), [(0, (4.0, 6.0)), (2, (2.0, 4.0))])
def test_a_wall_is_seen_from_its_room_from_left_to_right(face, ends_m):
    """Who looks from inside at the wall y = 0 of 8 m has larger x on the left; points lie at x of 2 to 4."""
    offsets_m = tuple(0.1 * (k == face) for k in range(4))
    (shown,) = walls_to_show(*seen(offsets_m))
    assert shown.wall.face_idx == face
    along = shown.points[:, 0]
    assert (along.min(), along.max()) == pytest.approx(ends_m)


def test_a_wall_is_coloured_cell_by_cell():
    shown = walls_to_show(*seen((0.0, 0.0, 0.0, -0.14)))[0]
    cells = wall_front(shown).items[0]
    assert isinstance(cells, Cells)
    used = cells.idx > 0
    # Columns of 0.1 m over 6 m: wall is seen from 2 to 4 m, at the same distance everywhere.
    assert cells.idx.shape[1] == 60
    columns = set(np.flatnonzero(used.any(axis=0)).tolist())
    assert set(range(20, 40)) <= columns <= set(range(19, 41))
    assert np.unique(cells.idx[used]).tolist() == [1 + round(254 * (0.5 - 0.5 * 0.14 / RANGE_M))]


def test_where_no_wall_stands_elsewhere_the_longest_is_shown_and_where_none_was_seen_none():
    result, as_built = seen((0.0,) * 4)
    (longest,) = walls_to_show(result, as_built)
    assert longest.wall.length_m == 8.0
    page = make_report("scan", result.floorplan, result, "", as_built=as_built)
    assert "Walls from the front" in page
    unseen = replace(as_built, walls=tuple(replace(w, offset_m=np.nan) for w in as_built.walls))
    assert walls_to_show(result, unseen) == []
    page = make_report("scan", result.floorplan, result, "", as_built=unseen)
    assert "Walls from the front" not in page

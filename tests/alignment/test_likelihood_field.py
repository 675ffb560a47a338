"""Fields of closeness, and all translations at once against one translation at a time."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import room_plan
from planfit.alignment.likelihood_field import (
    N_SECTORS,
    TranslationSearch,
    make_likelihood_field,
    sector_angle,
)
from planfit.floorplan import Floorplan


@pytest.fixture
def fields():
    return make_likelihood_field(room_plan(), cell_m=0.25, reach_m=0.4, margin_m=1.0)


def at(fields, sector, x, y):
    column, row = np.round((np.array([x, y]) - fields.origin) / fields.cell_m).astype(int)
    return fields.fields[sector, row, column]


def test_one_on_a_face_and_falling_off(fields):
    up = 2  # 90 degrees: the lower wall looks up into the room
    assert sector_angle(up) == pytest.approx(np.pi / 2)
    assert at(fields, up, 3, 0) == pytest.approx(1.0)
    assert at(fields, up, 3, 0.5) == pytest.approx(np.exp(-0.5 * (0.5 / 0.4) ** 2), rel=1e-4)
    assert at(fields, up, 3, 4) < 1e-6


def test_neighbouring_sectors_overlap_and_opposite_ones_do_not(fields):
    on_lower_wall = [at(fields, sector, 3, 0) for sector in range(N_SECTORS)]
    assert_allclose(np.array(on_lower_wall)[[2]], 1.0)
    assert on_lower_wall[6] < 1e-6
    assert on_lower_wall[0] < 1e-6


def test_a_face_of_unknown_side_is_in_both_sectors():
    plan = Floorplan.from_segments([[[0, 0], [5, 0]]], name="stroke")
    fields = make_likelihood_field(plan, 0.25, 0.4, 1.0)
    assert at(fields, 2, 2.5, 0) == pytest.approx(1.0)
    assert at(fields, 6, 2.5, 0) == pytest.approx(1.0)


def test_all_translations_at_once_equal_one_translation_at_a_time(fields, rng):
    cell = fields.cell_m
    xy = np.round(rng.uniform(-3, 3, (40, 2)) / cell) * cell
    angle = rng.integers(0, 8, 40) * np.pi / 4
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    extent_m = float(np.linalg.norm(np.ptp(xy, axis=0)))
    table, first = TranslationSearch(fields, extent_m).scores(xy, normals)
    sector = np.round(angle / (np.pi / 4)).astype(int) % 8
    rows, columns = fields.fields.shape[1:]
    # Cells from left of the plan to right of it, below to above.
    for row in range(0, rows + int(extent_m / cell), 5):
        for column in range(0, columns + int(extent_m / cell), 5):
            translation = first + cell * np.array([column, row])
            cells = np.round((xy + translation - fields.origin) / cell).astype(int)
            inside = np.all((cells >= 0) & (cells < [columns, rows]), axis=1)
            value = fields.fields[sector[inside], cells[inside, 1], cells[inside, 0]].sum() / 40
            assert table[row, column] == pytest.approx(value, abs=1e-4)


def test_translations_that_put_the_scan_partly_left_of_the_plan_are_in_the_table(fields):
    # Only the right end of a long wall lies on the plan.
    xy = np.column_stack([np.arange(0, 20, 0.25), np.zeros(80)])
    normals = np.tile([0.0, 1.0], (80, 1))
    table, first = TranslationSearch(fields, 20.0).scores(xy, normals)
    columns = np.arange(table.shape[1])
    assert (first + fields.cell_m * np.array([columns[0], 0]))[0] <= -19.0
    row, column = np.unravel_index(np.argmax(table), table.shape)
    assert (first + fields.cell_m * np.array([column, row]))[1] == pytest.approx(0.0, abs=0.13)

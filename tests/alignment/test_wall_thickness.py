"""How thick walls are that a plan draws by their centre lines."""

from dataclasses import replace

import numpy as np
import pytest

from builders import faces_plan, moved_plan
from planfit.alignment import (
    AlignOptions,
    align,
    find_half_thickness,
    sample_walls,
    thickness_finding,
)
from planfit.floorplan import Floorplan
from planfit.geometry import se3

ROOMS = [(0, 0, 6, 4), (6.2, 0, 5, 4), (11.4, 0, 3, 7), (0, 4.2, 4, 6.3), (4.2, 4.2, 7, 2.8),
         (4.2, 7.2, 2.5, 3.3), (11.4, 7.2, 8, 5)]  # fmt: skip
PLAN_FROM_LEVEL = se3.yaw_transform(0.3, np.array([20.0, -7.0, 0.0]))


@pytest.fixture(scope="module")
def office():
    """Rooms with walls 0.2 m thick between them."""
    plans = [faces_plan([[x, y], [x + w, y], [x + w, y + d], [x, y + d]]) for x, y, w, d in ROOMS]
    ends = np.concatenate([plan.ends for plan in plans])
    normals = np.concatenate([plan.normals for plan in plans])
    return Floorplan("office", ends, normals, np.ones(len(ends), dtype=bool))


@pytest.fixture(scope="module")
def scan(office):
    eyes = np.array([[x + w / 2, y + d / 2] for x, y, w, d in ROOMS])
    return sample_walls(office.normals, office.ends, seen_from=np.repeat(eyes, 4, axis=0))


SCALED = AlignOptions(metric_scale_tolerance=0.12)
"""A plan in metres may be taken at another scale."""


def behind(office, half_m):
    """Each face as a line this far behind it: of 0.1 m, both faces of a wall are one line."""
    lines = office.ends - half_m * office.normals[:, None]
    plan = replace(office, ends=lines, is_oriented=np.zeros(len(office), dtype=bool))
    return moved_plan(plan, PLAN_FROM_LEVEL)


def found_of(scan, plan, options=None):
    chosen = options or AlignOptions()
    return find_half_thickness(scan, plan, align(scan, plan, chosen), chosen)


@pytest.mark.parametrize("half_m", [0.06, 0.1, 0.17])
def test_half_the_thickness_is_found(scan, office, half_m):
    found = found_of(scan, behind(office, half_m))
    assert found is not None
    assert found.half_m == pytest.approx(half_m, abs=0.005)
    assert abs(found.half_m - half_m) < max(3 * found.sigma_m, 0.003)
    assert found.score > 0.95


def test_without_a_unit_thickness_and_scale_are_found_together(scan, office):
    plan = replace(behind(office, 0.1).scaled(40.0), is_metric=False)
    found = found_of(scan, plan)
    assert found is not None
    assert found.half_m == pytest.approx(0.1, abs=0.01)


@pytest.mark.parametrize("factor", [0.96, 1.03])
def test_of_a_plan_in_metres_that_is_off_in_scale_too(scan, office, factor):
    """Thickness alone would make up for a part of it: 0.05 and 0.16 m for 0.1."""
    found = found_of(scan, behind(office, 0.1).scaled(factor), SCALED)
    assert found is not None
    assert found.half_m == pytest.approx(0.1, abs=0.01)
    assert found.metres_per_unit == pytest.approx(1 / factor, rel=0.004)


@pytest.mark.parametrize("options", [AlignOptions(), SCALED])
def test_a_plan_in_metres_keeps_its_scale_where_that_may_be(scan, office, options):
    factor = 0.96 if options.metric_scale_tolerance == 0 else 1.0
    found = found_of(scan, behind(office, 0.1).scaled(factor), options)
    assert found is not None
    assert found.metres_per_unit == 1.0


def test_no_walls_are_so_thick_as_to_make_up_for_a_large_plan():
    """Of one room thickness and scale look the same: walls of 0.5 m are not built, a plan 4 % large is."""
    room = faces_plan([[0, 0], [8, 0], [8, 7], [0, 7]])
    room = replace(room, is_oriented=np.ones(4, dtype=bool))
    seen = sample_walls(room.normals, room.ends, seen_from=np.full((4, 2), 3.5))
    found = found_of(seen, behind(room, 0.1).scaled(1.04))
    assert found is None or found.half_m < 0.22


@pytest.mark.parametrize("off_m", [0.0, 0.02])
def test_lines_on_the_faces_are_left_as_lines(scan, office, off_m):
    assert found_of(scan, behind(office, off_m)) is None


def test_a_plan_with_both_faces_has_no_lines(scan, office):
    plan = moved_plan(office, PLAN_FROM_LEVEL)
    assert found_of(scan, plan) is None


def test_a_plan_that_is_too_large_is_not_thick_walled(scan, office):
    """Rooms that are 4 % too large, each face a line: smaller rooms would be less off."""
    found = found_of(scan, behind(office, 0.0).scaled(1.04))
    assert found is None or found.score < 0.8


@pytest.mark.parametrize("drawn_m", [0.03, 0.09])
def test_strokes_are_as_thick_as_the_walls_that_were_seen(scan, office, drawn_m):
    """Walls of 0.2 m drawn by strokes about their middles."""
    back = (0.1 - drawn_m / 2) * office.normals[:, None]
    thin = replace(office, ends=office.ends - back, thickness=np.full(len(office), drawn_m))
    found = found_of(scan, moved_plan(thin, PLAN_FROM_LEVEL))
    assert found is not None
    assert found.half_m == pytest.approx(0.1, abs=0.005)
    assert found.drawn_m == pytest.approx(drawn_m / 2)
    assert thickness_finding(found).facts["drawn_thickness_m"] == pytest.approx(drawn_m)


@pytest.mark.parametrize("off_m", [0.0, 0.03])
def test_thin_walls_that_are_thin_stay_as_drawn(scan, office, off_m):
    """As seen, and with depth 3 cm short, which looks alike."""
    behind_m = office.ends - off_m * office.normals[:, None]
    thin = replace(office, ends=behind_m, thickness=np.full(len(office), 0.08))
    assert found_of(scan, moved_plan(thin, PLAN_FROM_LEVEL)) is None


def test_thick_walls_are_no_strokes(scan, office):
    ends = office.ends - 0.06 * office.normals[:, None]
    plan = replace(office, ends=ends, thickness=np.full(len(office), 0.2))
    assert found_of(scan, moved_plan(plan, PLAN_FROM_LEVEL)) is None


def test_the_whole_thickness_is_found(scan, office):
    found = found_of(scan, behind(office, 0.1))
    assert found is not None
    assert thickness_finding(found).facts["thickness_m"] == pytest.approx(0.2, abs=0.01)

"""Faces of walls that a plan draws by their centre lines, held against outlines grown by shapely."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose

from planfit.alignment import metric_plan
from planfit.floorplan import Floorplan
from planfit.floorplan.centre_lines import are_strokes, with_offsets, with_thickness
from planfit.geometry import se3, segments

HALF = 0.1
PLACED = se3.yaw_transform(0.3, np.array([2.0, -1.0, 0.0]))
L_SHAPE = [(0, 0), (6, 0), (6, 3), (2.5, 3), (2.5, 5), (0, 5)]
TRIANGLE = [(0, 0), (4, 0), (0, 4)]


def lines_plan(ends, **changes):
    ends = np.array(ends, dtype=float)
    plan = Floorplan.from_segments(ends, np.full((len(ends), 2), np.nan), name="lines")
    return replace(plan, **changes)


def outline(corners):
    corners = np.array(corners, dtype=float)
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def as_set(ends):
    """Segments without regard to their order and direction."""
    return {tuple(sorted(map(tuple, np.round(each, 6) + 0.0))) for each in ends.reshape(-1, 2, 2)}


def sides_of(polygon):
    at = np.array(polygon.exterior.coords)
    return np.stack([at[:-1], at[1:]], axis=1)


@pytest.mark.parametrize("corners", [L_SHAPE, TRIANGLE])
def test_a_room_has_the_faces_of_its_outline_grown_and_shrunk(corners):
    thick = with_thickness(lines_plan(outline(corners)), HALF)
    room = shapely.Polygon(corners)
    expected = [sides_of(shapely.buffer(room, by, join_style="mitre")) for by in (HALF, -HALF)]
    assert as_set(thick.ends) == as_set(np.concatenate(expected))
    assert thick.is_oriented.all()
    assert_allclose(thick.thickness, 2 * HALF)
    # Normals look away from the line, which lies as far behind.
    assert_allclose(thick.before_line, HALF)
    middle = shapely.points((thick.ends - HALF * thick.normals[:, None]).mean(axis=1))
    assert_allclose(shapely.distance(room.exterior, middle), 0.0, atol=1e-9)
    # Each knows the line of the file that it was made of.
    assert as_set(thick.drawn_ends) == as_set(outline(corners))


def test_a_wall_that_ends_on_another_stops_at_its_face_on_both_sides():
    room = outline([(0, 0), (4, 0), (4, 3), (0, 3)])
    thick = with_thickness(lines_plan([*room, [[2, 0], [2, 3]]]), HALF)
    ends = as_set(thick.ends)
    assert ((1.9, 0.1), (1.9, 2.9)) in ends
    assert ((2.1, 0.1), (2.1, 2.9)) in ends


def test_a_free_end_and_a_wall_that_goes_on_stay_as_long_as_drawn():
    thick = with_thickness(lines_plan([[[0, 0], [2, 0]], [[2, 0], [5, 0]]]), HALF)
    assert_allclose(sorted(segments.lengths(thick.ends)), [2, 2, 3, 3])


def test_faces_with_a_known_side_stay_as_drawn():
    plan = lines_plan(outline(L_SHAPE))
    mixed = replace(plan, is_oriented=np.arange(6) < 2, thickness=np.full(6, 0.3))
    thick = with_thickness(mixed, HALF)
    assert_allclose(thick.ends[:2], plan.ends[:2])
    assert_allclose(thick.before_line, [0.0, 0.0, *[HALF] * 8])
    assert_allclose(thick.thickness, [0.3, 0.3, *[2 * HALF] * 8])
    assert with_thickness(thick, HALF) is thick  # no line is left


def test_what_each_line_carries_goes_with_both_of_its_faces():
    plan = lines_plan(
        outline(L_SHAPE), storeys=np.arange(6), is_unused=np.arange(6) == 4, fingerprint="a"
    )
    thick = with_thickness(plan, HALF)
    assert_allclose(np.sort(thick.storeys), np.repeat(np.arange(6), 2))
    assert_allclose(thick.storeys[thick.is_unused], [4, 4])
    assert thick.fingerprint != plan.fingerprint
    assert_allclose(thick.used().before_line, np.full(10, HALF))
    assert_allclose(thick.of_storey(3).before_line, [HALF, HALF])
    assert_allclose(thick.scaled(2.0).before_line, 2 * HALF)
    for moved in (Floorplan.mirrored, partial(Floorplan.placed, target_from_plan=PLACED)):
        assert_allclose(moved(thick).drawn_ends, with_thickness(moved(plan), HALF).drawn_ends)
    uneven = metric_plan(thick, (2.0, 3.0))
    assert_allclose(uneven.drawn_ends, thick.drawn_ends * (2.0, 3.0))


def test_a_short_wall_between_thick_ones_is_left_out():
    room = [[[0, 0], [4, 0]], [[0, 0.25], [4, 0.25]], [[2, 0], [2, 0.25]]]
    thick = with_thickness(lines_plan(room), HALF)
    assert len(thick) == 4


def test_a_round_wall_of_short_lines_is_kept_whole():
    angles = np.linspace(0, np.pi, 61)
    arc = 2.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    thick = with_thickness(lines_plan(np.stack([arc[:-1], arc[1:]], axis=1)), 0.15)
    assert len(thick) == 120
    middles = np.linalg.norm(thick.ends.mean(axis=1), axis=1)
    assert_allclose(np.abs(middles - 2.0), 0.15, atol=0.002)


def test_rooms_smaller_than_walls_are_thick_still():
    """At a scale that is tried and wrong: nothing is said, as another scale fits better."""
    thick = with_thickness(lines_plan(outline(0.02 * np.array(L_SHAPE))), HALF)
    assert len(thick) > 0


def test_both_faces_of_a_stroke_move_apart():
    """Drawn 0.04 thick; the wall of 0.3 beside it is drawn to scale."""
    ends = np.array([[[0, 0.02], [4, 0.02]], [[4, -0.02], [0, -0.02]], [[0, 3], [4, 3]]])
    normals = np.array([[0, 1.0], [0, -1], [0, -1]])
    plan = Floorplan("strokes", ends, normals, np.ones(3, dtype=bool))
    plan = replace(plan, thickness=np.array([0.04, 0.04, 0.3]))
    assert_allclose(are_strokes(plan, 0.1), [True, True, False])
    thick = with_thickness(plan, HALF, 0.1)
    assert_allclose(thick.ends[:, 0, 1], [HALF, -HALF, 3.0])
    assert_allclose(thick.before_line, [HALF, HALF, 0.0])
    assert_allclose(thick.drawn_ends, ends)
    assert_allclose(thick.thickness, [2 * HALF, 2 * HALF, 0.3])
    assert with_thickness(plan, HALF, 0.01) is plan


def test_strokes_and_lines_of_one_plan_are_thickened_together():
    plan = lines_plan([[[0, 0], [4, 0]], [[0, 3.02], [4, 3.02]], [[4, 2.98], [0, 2.98]]])
    mixed = replace(
        plan,
        normals=np.array([[0, 1.0], [0, 1], [0, -1]]),
        is_oriented=np.array([False, True, True]),
        thickness=np.array([np.nan, 0.04, 0.04]),
    )
    thick = with_thickness(mixed, HALF, 0.1)
    assert len(thick) == 4
    assert_allclose(thick.before_line, HALF)
    assert_allclose(np.sort(thick.ends[:, 0, 1]), [-HALF, HALF, 3 - HALF, 3 + HALF])


def test_offsets_move_faces_of_lines_alone():
    plan = replace(lines_plan(outline(L_SHAPE)), is_oriented=np.arange(6) < 1)
    thick = with_thickness(plan, HALF)
    moved = with_offsets(thick, np.full(len(thick), 0.02))
    assert_allclose(moved.ends[0], thick.ends[0])
    assert_allclose(moved.offsets[1:], thick.offsets[1:] + 0.02)
    assert_allclose(moved.before_line, [0.0, *[HALF + 0.02] * 10])
    assert_allclose(moved.drawn_ends, thick.drawn_ends)


def test_lines_of_a_large_plan_are_taken_in_parts():
    """More ends than are compared at once."""
    ends = [[[0, y], [5, y]] for y in range(300)] + [[[0, y], [0, y + 1]] for y in range(299)]
    thick = with_thickness(lines_plan(ends), HALF)
    assert len(thick) == 2 * len(ends)
    of_right = thick.ends[(np.abs(thick.normals[:, 0] - 1) < 1e-9)]
    # Between two walls the face is shorter by both halves; the first and last end at corners.
    assert_allclose(segments.lengths(of_right), 1 - 2 * HALF)

"""Which side of a line is free."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.floorplan.faces import orient_faces
from planfit.geometry import se3


def horizontal(y, x0=0.0, x1=5.0):
    return [[x0, y], [x1, y]]


def oriented(*lines, **options):
    return orient_faces(np.array(lines, dtype=float), **options)


def test_the_two_lines_of_a_wall_look_away_from_each_other():
    normals, is_oriented = oriented(horizontal(0), horizontal(0.2))
    assert is_oriented.all()
    assert_allclose(normals, [[0, -1], [0, 1]], atol=1e-12)


@pytest.mark.parametrize("yaw_deg", [0, 17, 90, 133, 270])
@pytest.mark.parametrize("swap", [(), (0,), (1,), (0, 1)])
def test_neither_turning_nor_the_order_of_the_ends_matters(yaw_deg, swap):
    ends = np.array([horizontal(0), horizontal(0.2)], dtype=float)
    for i in swap:
        ends[i] = ends[i, ::-1]
    rotation = se3.yaw_transform(np.deg2rad(yaw_deg))[:2, :2]
    normals, is_oriented = orient_faces(ends @ rotation.T + [30.0, -7.0])
    assert is_oriented.all()
    assert_allclose(normals @ rotation, [[0, -1], [0, 1]], atol=1e-9)


def test_a_single_line_is_not_oriented():
    _, is_oriented = oriented(horizontal(0))
    assert not is_oriented.any()


def test_lines_too_far_apart_are_two_walls():
    _, is_oriented = oriented(horizontal(0), horizontal(0.7))
    assert not is_oriented.any()
    _, is_oriented = oriented(horizontal(0), horizontal(0.7), max_thickness_m=0.8)
    assert is_oriented.all()


def test_a_line_drawn_twice_is_no_wall():
    _, is_oriented = oriented(horizontal(0), horizontal(0.01))
    assert not is_oriented.any()
    _, is_oriented = oriented(horizontal(0), horizontal(0.01), min_thickness_m=0.005)
    assert is_oriented.all()


def test_lines_across_or_askew_are_no_partners():
    _, is_oriented = oriented(horizontal(0), [[2, 0.1], [2, 3]])
    assert not is_oriented.any()
    _, is_oriented = oriented(horizontal(0, 0, 2), [[0, 0.1], [2, 0.45]])
    assert not is_oriented.any()


def test_a_partner_must_lie_beside_most_of_a_line():
    _, is_oriented = oriented(horizontal(0), horizontal(0.2, 4.0, 9.0))
    assert not is_oriented.any()
    # Pieces of the other face, between doors, add up.
    pieces = [horizontal(0.2, 0, 1), horizontal(0.2, 2, 3), horizontal(0.2, 4, 5)]
    normals, is_oriented = oriented(horizontal(0), *pieces)
    assert is_oriented.all()
    assert_allclose(normals[0], [0, -1], atol=1e-12)


def test_a_thin_cavity_between_two_walls():
    # Two walls 0.2 m thick, 0.4 m apart: the inner lines look into the cavity.
    normals, is_oriented = oriented(*(horizontal(y) for y in (0, 0.2, 0.6, 0.8)))
    assert is_oriented.all()
    assert_allclose(normals[:, 1], [-1, 1, -1, 1])


def test_equal_gaps_on_both_sides_stay_open():
    _, is_oriented = oriented(horizontal(0), horizontal(0.25), horizontal(0.5))
    assert_array_equal(is_oriented, [True, False, True])


def test_a_room_with_thick_walls_looks_in_from_inside_and_out_from_outside():
    inner = np.array([[0, 0], [6, 0], [6, 4], [0, 4]], dtype=float)
    outer = np.array([[-0.3, -0.3], [6.3, -0.3], [6.3, 4.3], [-0.3, 4.3]])
    ends = np.concatenate([np.stack([c, np.roll(c, -1, axis=0)], axis=1) for c in (inner, outer)])
    normals, is_oriented = orient_faces(ends)
    assert is_oriented.all()
    towards_middle = np.sum(normals * ([3, 2] - ends.mean(axis=1)), axis=1)
    assert np.all(towards_middle[:4] > 0)
    assert np.all(towards_middle[4:] < 0)

"""Pins and starts: from text to points, and what they say together."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import room_plan
from planfit.alignment import AlignOptions, ControlPoint, read_control_points
from planfit.alignment.options import fit_control_points, parse_start
from planfit.errors import OptionError
from planfit.floorplan import PlanSource
from planfit.geometry import se3


def test_a_control_point_is_levelled_and_on_the_plan_frame():
    level_from_world = se3.make_transform(np.eye(3), np.array([1.0, 2.0, 3.0]))
    file_from_plan = np.array([[2.0, 0, 10], [0, -2.0, 20], [0, 0, 1]])
    plan = replace(room_plan(), source=PlanSource(file_from_plan=file_from_plan))
    texts = ("5,6,7=2,3", "5,6,7=file:14,14")
    for point in read_control_points(texts, level_from_world, plan):
        assert_allclose(point.level_xy, [6, 8])
        assert_allclose(point.plan_xy, [2, 3])
    picture = replace(plan, source=replace(plan.source, is_picture=True))
    (point,) = read_control_points(("5,6,7=14,14",), level_from_world, picture)
    assert_allclose(point.plan_xy, [2, 3])


def test_a_point_in_other_axes_is_refused_with_what_to_write():
    """A plan far from where its file has it: the two systems cannot be mixed up."""
    file_from_plan = np.array([[1.0, 0, 1000], [0, 1, 2000], [0, 0, 1]])
    plan = replace(room_plan(), source=PlanSource(file_from_plan=file_from_plan))
    with pytest.raises(OptionError) as error:
        read_control_points(("5,6,7=1002,2003",), np.eye(4), plan)
    assert str(error.value) == (
        "align.control-points: expected points on the plan, which spans 0 to 6 by 0 to 4 (m), found "
        "(1002, 2003) in '5,6,7=1002,2003'; if it is in the file's own coordinates, write "
        "5,6,7=file:1002,2003"
    )
    with pytest.raises(OptionError, match="read it off the rim of `planfit plan"):
        read_control_points(("5,6,7=-50,3",), np.eye(4), plan)
    (garden,) = read_control_points(("5,6,7=-2,3",), np.eye(4), plan)
    assert_allclose(garden.plan_xy, [-2, 3])


def control_points_of(yaw, scale, translation, points):
    rotation = se3.yaw_transform(yaw)[:2, :2]
    return tuple(
        ControlPoint(p, (rotation @ p + translation) / scale)
        for p in np.asarray(points, dtype=float)
    )


@pytest.mark.parametrize("yaw", [0.0, 1.0, -3.0])
def test_control_points_give_yaw_translation_and_scale(yaw):
    control_points = control_points_of(yaw, 0.04, [5.0, -7.0], [[0, 0], [4, 1], [2, 8]])
    found_yaw, translation, scale = fit_control_points(control_points, None, 0.1)
    assert np.cos(found_yaw - yaw) == pytest.approx(1.0)
    assert scale == pytest.approx(0.04)
    assert_allclose(translation, [5, -7], atol=1e-9)


def test_control_points_with_a_known_scale_keep_it():
    _, _, scale = fit_control_points(
        control_points_of(0.5, 0.04, [0, 0], [[0, 0], [4, 1]]), 0.0401, 0.1
    )
    assert scale == 0.0401


def test_control_points_that_disagree_are_named():
    control_points = control_points_of(0.5, 1.0, [0, 0], [[0, 0], [9, 1], [5, 5], [0, 9]])
    wrong = (
        *control_points[:2],
        ControlPoint(control_points[2].level_xy, control_points[2].plan_xy + np.array([6.0, 0])),
        control_points[3],
    )
    words = (
        r"^align\.control-points: expected points that agree within 1 m, found number 3 6\.00 m from where "
        "the others put it; check its points"
    )
    for metres_per_unit in (1.0, None):
        with pytest.raises(OptionError, match=words):
            fit_control_points(wrong, metres_per_unit, 1.0)


def test_of_points_too_few_to_tell_none_is_blamed():
    """Without a scale any two of three agree; of a mirrored plan each is as wrong."""
    good = control_points_of(0.5, 1.0, [0, 0], [[0, 0], [9, 1], [5, 5], [0, 9]])
    moved = ControlPoint(good[2].level_xy, good[2].plan_xy + np.array([6.0, 0]))
    with pytest.raises(
        OptionError, match=r"found 3 that are off by up to .* m; check their points"
    ):
        fit_control_points((*good[:2], moved), None, 1.0)
    with pytest.raises(
        OptionError, match=r"found 2 .*; the two are 9.06 m apart in the scan and 11"
    ):
        fit_control_points((good[0], replace(good[1], plan_xy=1.3 * good[1].plan_xy)), 1.0, 1.0)
    mirrored = [replace(each, plan_xy=each.plan_xy * (1, -1)) for each in good]
    with pytest.raises(OptionError, match="with left and right swapped they agree"):
        fit_control_points(mirrored, 1.0, 1.0)


def test_control_points_at_one_point_are_refused():
    with pytest.raises(OptionError, match="expected different points, found all at one"):
        fit_control_points(control_points_of(0.0, 1.0, [0, 0], [[1, 1], [1, 1]]), None, 1.0)


@pytest.mark.parametrize(
    "text", ["1,2,3", "1,2=3,4", "1,2,3=4,5,6", "a,b,c=d,e", "1,2,nan=3,4", ""]
)
def test_a_control_point_of_another_form_is_refused(text):
    with pytest.raises(OptionError) as error:
        AlignOptions(control_points=(text,))
    assert str(error.value) == (
        "align.control-points: expected x,y,z=u,v (a point of the scan = the same point on the plan), "
        f"found {text!r}"
    )


def test_a_start_is_metres_and_degrees():
    translation, yaw = parse_start("1.5,-2,90")
    assert_allclose(translation, [1.5, -2.0])
    assert yaw == pytest.approx(np.pi / 2)
    with pytest.raises(
        OptionError, match=r"^align\.start: expected x,y,yaw \(metres, metres, degrees\), "
    ):
        AlignOptions(start="1,2")

"""Plans without unit, plans that fit twice or mirrored, and what a user can say to narrow the search."""

from dataclasses import replace

import numpy as np
import pytest

from builders import faces_plan, moved_plan, room_plan
from planfit.alignment import (
    AlignOptions,
    ControlPoint,
    align,
    find_unit,
    metric_plan,
    sample_walls,
)
from planfit.alignment.search import scale_range, scale_steps, wall_thickness
from planfit.alignment.selection import select_hypothesis
from planfit.errors import FloorplanError, OptionError, ScanError
from planfit.findings import PlanKind
from planfit.floorplan import Floorplan
from planfit.geometry import se3

ROOMS = [(0, 0, 6, 4), (6.2, 0, 5, 4), (11.4, 0, 3, 7), (0, 4.2, 4, 6.3), (4.2, 4.2, 7, 2.8),
         (4.2, 7.2, 2.5, 3.3), (11.4, 7.2, 8, 5)]  # fmt: skip


def joined(plans, name="plan"):
    ends = np.concatenate([plan.ends for plan in plans])
    normals = np.concatenate([plan.normals for plan in plans])
    return Floorplan(name, ends, normals, np.ones(len(ends), dtype=bool))


def box(x, y, w, d):
    return faces_plan([[x, y], [x + w, y], [x + w, y + d], [x, y + d]])


@pytest.fixture(scope="module")
def office():
    """Seven rooms, inner faces only; no symmetry."""
    return joined([box(*room) for room in ROOMS], "office")


@pytest.fixture(scope="module")
def scan(office):
    """What cameras in the middles of three rooms see, level frame = the office's frame."""
    faces = np.arange(12)
    eyes = np.repeat([[3.0, 2.0], [8.7, 2.0], [12.9, 3.5]], 4, axis=0)
    return sample_walls(office.normals[faces], office.ends[faces], seen_from=eyes)


def unitless(plan, yaw, metres_per_unit, translation):
    """The plan rotated, moved (m), and in units of `metres_per_unit`."""
    moved = moved_plan(plan, se3.yaw_transform(yaw, np.array([*translation, 0.0])))
    return replace(moved, ends=moved.ends / metres_per_unit, is_metric=False)


def assert_found(found, yaw, metres_per_unit, translation, tolerance=0.02):
    assert found.metres_per_unit == pytest.approx(metres_per_unit, rel=2e-3)
    truth = se3.yaw_transform(yaw, np.array([*translation, 0.0]))
    middle = np.array([6.0, 2.5, 0.0, 1.0])
    at = (found.plan_from_level @ middle)[:2] / found.metres_per_unit * metres_per_unit
    assert np.linalg.norm(at - (truth @ middle)[:2]) < tolerance
    off = found.plan_from_level[:3, :3] @ truth[:3, :3].T
    assert np.rad2deg(se3.rotation_angle(off)) < 0.2


@pytest.mark.parametrize(
    ("yaw", "metres_per_unit", "translation"),
    [(0.4, 0.01, (30, -5)), (-2.7, 100.0, (-800, 90)), (1.6, 0.3048, (0, 0))],
)
def test_yaw_translation_and_scale_of_the_drawing_do_not_matter(
    office, scan, yaw, metres_per_unit, translation
):
    found = align(scan, unitless(office, yaw, metres_per_unit, translation), AlignOptions())
    assert_found(found, yaw, metres_per_unit, translation)
    assert found.is_sure
    assert found.warnings == ()
    assert 0 < found.scale_sigma < 0.01


def test_moving_the_scan_moves_the_answer_against_it(office, scan):
    move = se3.yaw_transform(1.1, np.array([7.0, -3.0, 0.0]))
    rotation, translation = move[:2, :2], move[:2, 3]
    moved = replace(
        scan,
        xy=scan.xy @ rotation.T + translation,
        normals=scan.normals @ rotation.T,
        seen_from=scan.seen_from @ rotation.T + translation,
    )
    found = align(moved, office, AlignOptions())
    off = found.plan_from_level @ move
    assert np.linalg.norm(off[:2, 3]) < 0.02
    assert np.rad2deg(se3.rotation_angle(off[:3, :3])) < 0.2


def test_a_plan_in_its_unit_is_metric_at_the_scale_found(office):
    plan = unitless(office, 0.0, 0.25, (0, 0))
    metric = metric_plan(plan, (0.25, 0.25))
    assert metric.is_metric
    np.testing.assert_allclose(metric.ends, office.ends)
    stretched = metric_plan(plan, (0.25, 0.5))
    np.testing.assert_allclose(stretched.ends, office.ends * [1, 2])
    np.testing.assert_allclose(stretched.normals, office.normals, atol=1e-12)


# Two places, none, or the mirror.


def twins():
    """Two equal L-shaped rooms, one of them with a wall across its middle."""
    shape = np.array([[0, 0], [9, 0], [9, 4], [5, 4], [5, 7], [0, 7]], dtype=float)
    across = [[14.0, 0.6], [14.0, 3.4]], [[14.2, 3.4], [14.2, 0.6]]
    left, right = faces_plan(shape), faces_plan(shape + np.array([10.0, 0.0]))
    ends = np.concatenate([left.ends, right.ends, np.array(across)])
    normals = np.concatenate([left.normals, right.normals, [[-1.0, 0.0], [1.0, 0.0]]])
    return Floorplan("twins", ends, normals, np.ones(len(ends), dtype=bool))


def test_free_space_breaks_a_tie():
    plan = twins()
    blind = sample_walls(plan.normals[:6], plan.ends[:6])
    both = align(blind, plan, AlignOptions())
    assert not both.is_sure
    assert any(each.kind is PlanKind.AMBIGUOUS_PLACE for each in both.findings)
    # Seen from one end of the room: the wall across the other one would have hidden half of it.
    eyes = np.tile([1.0, 2.0], (6, 1))
    seeing = sample_walls(plan.normals[:6], plan.ends[:6], seen_from=eyes)
    found = align(seeing, plan, AlignOptions())
    assert found.is_sure
    assert np.linalg.norm(found.plan_from_level[:2, 3]) < 0.02


def test_candidate_2_is_the_other_hypothesis():
    plan = twins()
    blind = sample_walls(plan.normals[:6], plan.ends[:6])
    first, second = (align(blind, plan, AlignOptions(candidate=k)) for k in (1, 2))
    assert not first.is_sure
    assert second.is_sure
    gap = first.plan_from_level[0, 3] - second.plan_from_level[0, 3]
    assert abs(gap) == pytest.approx(10.0, abs=0.02)
    assert len(first.candidates) >= 2
    (other,) = second.findings
    assert other.kind is PlanKind.OTHER_PLACE_THAN_ASKED


def test_a_candidate_that_is_not_there_is_refused(office, scan):
    with pytest.raises(OptionError, match=r"align\.candidate: expected 1 to \d, the alignments"):
        align(scan, office, AlignOptions(candidate=9))


def test_a_square_room_is_ambiguous():
    plan = room_plan(5.0, 5.0)
    found = align(sample_walls(plan.normals, plan.ends), plan, AlignOptions())
    assert not found.is_sure
    (rival,) = (each for each in found.findings if each.kind is PlanKind.AMBIGUOUS_PLACE)
    assert rival.facts["apart_deg"] % 90 == pytest.approx(0, abs=0.5)


def test_a_bare_corridor_leaves_its_length_open():
    plan = room_plan(40.0, 2.0)
    ends = np.array([[[10.0, 0.0], [20.0, 0.0]], [[20.0, 2.0], [10.0, 2.0]]])
    walls = sample_walls(plan.normals[[0, 2]], ends)
    found = align(walls, plan, AlignOptions())
    assert not found.is_sure
    assert any(each.kind is PlanKind.DIRECTION_OPEN for each in found.findings)


@pytest.mark.parametrize("metres_per_unit", [1.0, 0.02])
def test_a_mirrored_plan_is_said_to_be_one(office, scan, metres_per_unit):
    plan = replace(
        office,
        ends=office.ends * [-1, 1] / metres_per_unit,
        normals=office.normals * [-1, 1],
        is_metric=metres_per_unit == 1.0,
    )
    found = align(scan, plan, AlignOptions())
    assert found.is_mirrored
    assert not found.is_sure
    (mirrored,) = (each for each in found.findings if each.kind is PlanKind.PLAN_MIRRORED)
    assert mirrored.advice == "run again with --mirror"
    assert not align(scan, office, AlignOptions()).is_mirrored


def test_a_mirrored_plan_of_a_nearly_symmetric_building_is_said_to_be_one():
    """As drawn it explains 0.8 of the wall, twice as much as any other place: that used to be enough."""
    rooms = [(0, 0, 8, 5), (8.2, 0.8, 3, 3.4), (11.4, 1.5, 4, 2), (0, 5.2, 3.2, 2.5)]
    plan = joined([box(*room) for room in rooms])
    eyes = np.repeat([(x + w / 2, y + d / 2) for x, y, w, d in rooms], 4, axis=0)
    walls = sample_walls(plan.normals, plan.ends, seen_from=eyes)
    found = align(walls, plan.mirrored(), AlignOptions())
    assert found.score > 0.75
    assert found.margin > 0.3
    assert found.is_mirrored
    assert not found.is_sure
    assert not align(walls, plan, AlignOptions()).is_mirrored


@pytest.mark.parametrize(("score", "is_mirrored"), [(0.85, False), (0.99, True)])
def test_a_worse_candidate_makes_no_plan_mirrored(office, scan, score, is_mirrored):
    """Left and right swapped is compared with the best as drawn, not with the second that is asked for."""
    best, other = align(scan, office, AlignOptions()).candidates[:2]
    best, other = replace(best, score=0.9), replace(other, score=0.499)
    found = select_hypothesis(
        scan, [best, other], None, replace(other, score=score), office, AlignOptions(candidate=2)
    )
    assert found.taken is other
    assert found.is_mirrored == is_mirrored
    kinds = [each.kind for each in found.findings]
    assert (PlanKind.PLAN_MIRRORED in kinds) == is_mirrored
    if not is_mirrored:
        assert kinds[0] is PlanKind.OTHER_PLACE_BETTER
        assert found.findings[0].facts["other_wall_share"] == 0.9
        assert PlanKind.LITTLE_WALL_ON_PLAN not in kinds


def test_a_plan_mirrored_for_nothing_is_said_to_be_one(office, scan):
    found = align(scan, office.mirrored(), AlignOptions())
    assert found.is_mirrored
    (mirrored,) = (each for each in found.findings if each.kind is PlanKind.PLAN_MIRRORED)
    assert mirrored.advice == "run again without --mirror"


@pytest.mark.parametrize("metres_per_unit", [1.0, 0.02])
def test_a_mirrored_plan_is_aligned_once_it_is_swapped(office, scan, metres_per_unit):
    drawn = replace(
        office,
        ends=office.ends * [-1, 1] / metres_per_unit,
        normals=office.normals * [-1, 1],
        is_metric=metres_per_unit == 1.0,
    )
    found = align(scan, drawn.mirrored(), AlignOptions())
    assert found.is_sure
    assert not found.is_mirrored
    assert_found(found, 0.0, metres_per_unit, (0.0, 0.0))


def test_another_building_is_not_sure(office, scan):
    rng = np.random.default_rng(3)
    rooms = [box(*rng.uniform(0, 30, 2), *rng.uniform(2, 9, 2)) for _ in range(9)]
    found = align(scan, replace(joined(rooms), is_metric=False), AlignOptions())
    assert not found.is_sure


# What a user knows.


def test_a_known_scale_is_taken_as_it_is(office, scan):
    plan = unitless(office, 0.3, 0.02, (5, 5))
    found = align(scan, plan, AlignOptions(metres_per_unit=0.02))
    assert found.scale_xy == (0.02, 0.02)
    assert found.scale_sigma == 0.0
    assert_found(found, 0.3, 0.02, (5, 5))
    wrong = align(scan, plan, AlignOptions(metres_per_unit=0.024))
    assert wrong.scale_xy == (0.024, 0.024)
    assert not wrong.is_sure


def test_scale_tolerance_searches_around_the_known_scale(office, scan):
    plan = unitless(office, 0.3, 0.02, (5, 5))
    found = align(scan, plan, AlignOptions(metres_per_unit=0.0215, scale_tolerance=0.1))
    assert_found(found, 0.3, 0.02, (5, 5))


def test_two_scales_undo_a_stretch(office, scan):
    plan = replace(office, ends=office.ends / [0.05, 0.053], is_metric=False)
    found = align(scan, plan, AlignOptions(two_scales=True))
    assert found.scale_xy == pytest.approx((0.05, 0.053), rel=2e-3)
    assert found.is_sure
    one = align(scan, plan, AlignOptions())
    assert one.scale_xy[0] == one.scale_xy[1]
    assert one.score < found.score


def test_one_control_point_chooses_between_two_hypotheses():
    plan = twins()
    blind = sample_walls(plan.normals[:6], plan.ends[:6])
    point = ControlPoint(np.array([1.0, 1.0]), np.array([11.2, 1.1]))
    found = align(blind, plan, AlignOptions(), control_points=(point,))
    assert found.is_sure
    assert found.plan_from_level[0, 3] == pytest.approx(10.0, abs=0.02)


def test_two_control_points_give_scale_and_yaw(office, scan):
    yaw, scale, translation = 2.0, 0.05, (3.0, 4.0)
    plan = unitless(office, yaw, scale, translation)
    truth = se3.yaw_transform(yaw, np.array([*translation, 0.0]))
    points = np.array([[0.0, 0.0], [14.4, 7.0]])
    on_plan = (points @ truth[:2, :2].T + truth[:2, 3] + [[0.2, 0.0], [0.0, -0.2]]) / scale
    control_points = tuple(ControlPoint(a, b) for a, b in zip(points, on_plan, strict=True))
    assert_found(
        align(scan, plan, AlignOptions(), control_points=control_points), yaw, scale, translation
    )


def test_control_point_tolerance_m_says_how_far_one_may_be_off(office, scan):
    off = ControlPoint(np.array([1.0, 1.0]), np.array([1.0, 4.0]))
    strict = align(scan, office, AlignOptions(), control_points=(off,))
    assert abs(strict.plan_from_level[1, 3] - 3.0) < 1.6
    tolerant = align(
        scan, office, AlignOptions(control_point_tolerance_m=4.0), control_points=(off,)
    )
    assert np.linalg.norm(tolerant.plan_from_level[:2, 3]) < 0.02


def test_a_start_keeps_the_search_near_it():
    plan = twins()
    blind = sample_walls(plan.normals[:6], plan.ends[:6])
    found = align(blind, plan, AlignOptions(start="11,0.5,4"))
    assert found.plan_from_level[0, 3] == pytest.approx(10.0, abs=0.02)
    near = align(blind, plan, AlignOptions(start="-1,0.5,-4"))
    assert near.plan_from_level[0, 3] == pytest.approx(0.0, abs=0.02)


# Scales worth a try.


def test_scale_range_holds_the_true_scale_and_walls_narrow_it(office, scan):
    plan = unitless(office, 0.0, 0.02, (0, 0))
    low, high = scale_range(scan, plan)
    assert low < 0.02 < high
    thick = replace(plan, thickness=np.full(len(plan), 0.2 / 0.02))
    narrow = scale_range(scan, thick)
    assert low <= narrow[0] < 0.02 < narrow[1] <= high
    assert narrow[1] / narrow[0] <= 12.01


def test_thickness_is_measured_where_the_reader_gave_none():
    inner, outer = box(0, 0, 6, 4), box(-0.3, -0.3, 6.6, 4.6)
    outer = replace(outer, normals=-outer.normals)
    np.testing.assert_allclose(wall_thickness(joined([inner, outer])), 0.3)


def test_courts_between_wings_that_were_outlined_from_inside_are_no_walls():
    wings = [(0, 0), (22, 0), (22, 10), (18, 10), (18, 3), (13, 3)]
    wings += [(13, 10), (9, 10), (9, 3), (4, 3), (4, 10), (0, 10)]
    plan = unitless(faces_plan(wings), 0.0, 0.02, (0, 0))
    assert len(wall_thickness(plan)) == 0
    low, high = scale_range(sample_walls(plan.normals, 0.02 * plan.ends), plan)
    assert low < 0.02 < high


def test_scale_steps_are_even_and_close_enough():
    scales = scale_steps(0.5, 4.0, 0.05)
    ratio = scales[1:] / scales[:-1]
    assert scales[0] == pytest.approx(0.5)
    assert scales[-1] == pytest.approx(4.0)
    np.testing.assert_allclose(ratio, ratio[0])
    assert ratio[0] <= 1.0501
    assert scale_steps(2.0, 2.0, 0.05).tolist() == [2.0]


@pytest.mark.parametrize(
    ("metres", "name"),
    [
        (0.3048, "feet"),
        pytest.param(0.001, "millimetres", marks=pytest.mark.slow),
        pytest.param(0.0123, "units of 0.0123 m", marks=pytest.mark.slow),
    ],
)
def test_a_plan_that_claims_metres_is_questioned_in_its_own_unit(office, scan, metres, name):
    plan = replace(office, ends=office.ends / metres)
    found = find_unit(scan, plan, align(scan, plan, AlignOptions()), AlignOptions())
    assert found is not None
    assert found[0] == name
    assert found[1] == pytest.approx(metres, rel=2e-3)


def test_a_plan_that_fits_elsewhere_than_the_control_points_say_is_not_questioned(office, scan):
    """No factor near 1 is another unit: the points are wrong, or of other axes."""
    misled = replace(align(scan, office, AlignOptions()), score=0.1)
    assert find_unit(scan, office, misled, AlignOptions()) is None
    stretched = replace(office, ends=office.ends * 1.05)
    assert find_unit(scan, stretched, misled, AlignOptions()) is None


def test_a_plan_in_metres_is_not_questioned(office, scan):
    assert find_unit(scan, office, align(scan, office, AlignOptions()), AlignOptions()) is None


# Bad input, in words.


def test_no_wall_is_refused(office):
    nothing = sample_walls(np.zeros((0, 2)), np.zeros((0, 2, 2)))
    with pytest.raises(
        ScanError, match=r"^the scan: expected wall patches to align it by, found none; "
    ):
        align(nothing, office, AlignOptions())


def test_a_plan_with_a_single_wall_is_refused(scan):
    plan = Floorplan(
        "one.svg", np.array([[[0.0, 0], [5, 0]]]), np.array([[0.0, 1]]), np.array([True])
    )
    words = r"^one\.svg: expected at least 3 wall faces to align a scan with, found 1; is it the right layer"
    with pytest.raises(FloorplanError, match=words):
        align(scan, plan, AlignOptions())


def test_a_start_on_a_plan_without_unit_asks_for_the_scale(office, scan):
    plan = replace(office, is_metric=False)
    with pytest.raises(OptionError, match=r"align\.start: .*give align\.metres-per-unit too"):
        align(scan, plan, AlignOptions(start="0,0,0"))

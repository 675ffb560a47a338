"""Where on the plan the scan is: exact when it can be known, honest when it cannot."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import faces_plan, moved_plan, room_plan
from planfit.alignment import (
    SETTLED_BY_POINTS,
    AlignOptions,
    align,
    sample_walls,
    search,
    selection,
)
from planfit.alignment.search import candidate_yaws
from planfit.alignment.selection import MIN_MARGIN, MIN_SCORE
from planfit.findings import PlanKind
from planfit.floorplan import Floorplan
from planfit.geometry import se3

ROOMS = [(0, 0, 6, 4), (6.2, 0, 5, 4), (11.4, 0, 3, 7), (0, 4.2, 4, 6.3), (4.2, 4.2, 7, 2.8),
         (4.2, 7.2, 2.5, 3.3), (11.4, 7.2, 8, 5)]  # fmt: skip


@pytest.fixture(scope="module")
def office():
    """Seven rooms, inner faces only; no symmetry."""
    rooms = [faces_plan([[x, y], [x + w, y], [x + w, y + d], [x, y + d]]) for x, y, w, d in ROOMS]
    ends = np.concatenate([room.ends for room in rooms])
    normals = np.concatenate([room.normals for room in rooms])
    return Floorplan("office", ends, normals, np.ones(len(ends), dtype=bool))


def seen(floorplan, faces, plan_from_level, noise_m=0.0, rng=None):
    """Wall samples of some faces, in the level frame."""
    level_from_plan = se3.inverse(plan_from_level)
    rotation, translation = level_from_plan[:2, :2], level_from_plan[:2, 3]
    walls = sample_walls(
        floorplan.normals[faces] @ rotation.T, floorplan.ends[faces] @ rotation.T + translation
    )
    if noise_m:
        walls = replace(walls, xy=walls.xy + rng.normal(0, noise_m, walls.xy.shape))
    return walls


def assert_at(
    alignment, plan_from_level, translation_m=0.02, rotation_deg=0.1, middle=(0.0, 0.0, 0.0)
):
    off = alignment.plan_from_level @ se3.inverse(plan_from_level)
    assert np.rad2deg(se3.rotation_angle(off[:3, :3])) < rotation_deg
    level = se3.inverse(plan_from_level) @ [*middle, 1.0]
    gap = (alignment.plan_from_level - plan_from_level) @ level
    assert np.linalg.norm(gap) < translation_m


@pytest.mark.parametrize("seed", range(6))
def test_a_partial_scan_is_found_anywhere(office, seed):
    rng = np.random.default_rng(seed)
    truth = se3.yaw_transform(rng.uniform(-np.pi, np.pi), np.array([*rng.uniform(-40, 40, 2), 0.0]))
    faces = np.array([0, 1, 2, 3, 4, 5, 6, 9, 10])  # two rooms and a corner of a third
    found = align(seen(office, faces, truth, 0.03, rng), office, AlignOptions())
    assert_at(found, truth, middle=(6, 2, 0))
    assert found.warnings == ()
    assert found.score > 0.9
    assert found.margin > MIN_MARGIN


@pytest.mark.parametrize("quadrant", range(4))
def test_each_quadrant(office, quadrant):
    truth = se3.yaw_transform(quadrant * np.pi / 2 + 0.004, np.array([3.0, -8.0, 0.0]))
    found = align(seen(office, np.arange(12), truth), office, AlignOptions())
    assert_at(found, truth, middle=(6, 2, 0))


def test_furniture_and_leftover_drift_do_not_mislead(office, rng):
    truth = se3.yaw_transform(2.2, np.array([5.0, 9.0, 0.0]))
    walls = seen(office, np.arange(12), truth, 0.06, rng)
    clutter = rng.uniform(walls.xy.min(axis=0), walls.xy.max(axis=0), (len(walls.xy) // 3, 2))
    angle = rng.uniform(0, 2 * np.pi, len(clutter))
    walls = replace(
        walls,
        xy=np.concatenate([walls.xy, clutter]),
        normals=np.concatenate([walls.normals, np.stack([np.cos(angle), np.sin(angle)], axis=1)]),
    )
    found = align(walls, office, AlignOptions())
    assert_at(found, truth, translation_m=0.04, rotation_deg=0.3, middle=(6, 2, 0))


def test_the_result_moves_with_the_plan(office):
    walls = seen(office, np.arange(12), np.eye(4))
    move = se3.yaw_transform(0.8, np.array([100.0, -50.0, 0.0]))
    found = align(walls, moved_plan(office, move), AlignOptions())
    assert_at(found, move, middle=move[:3, :3] @ [6, 2, 0] + move[:3, 3])


def test_it_only_rotates_about_the_vertical_and_moves_in_the_level(office):
    truth = se3.yaw_transform(1.0, np.array([5.0, 9.0, 0.0]))
    transform = align(seen(office, np.arange(8), truth), office, AlignOptions()).plan_from_level
    assert_allclose(transform[2], [0, 0, 1, 0])
    assert_allclose(transform[:2, 2], 0)
    assert_allclose(np.linalg.det(transform[:2, :2]), 1.0)


def test_outer_faces_are_not_taken_for_inner_ones(office):
    # The same lines, seen from the other side, do not fit where the lines are.
    walls = seen(office, np.arange(4), np.eye(4))
    outside = replace(walls, normals=-walls.normals)
    assert align(walls, office, AlignOptions()).score > 0.95
    assert align(outside, office, AlignOptions()).score < 0.6


def test_faces_of_unknown_side_are_enough(office):
    plan = replace(office, is_oriented=np.zeros(len(office), dtype=bool))
    truth = se3.yaw_transform(1.7, np.array([5.0, 9.0, 0.0]))
    assert_at(align(seen(office, np.arange(12), truth), plan, AlignOptions()), truth)


def test_a_rectangle_is_ambiguous_by_half_a_turn():
    found = align(seen(room_plan(), np.arange(4), np.eye(4)), room_plan(), AlignOptions())
    assert found.margin < 0.01
    (ambiguous,) = found.findings
    assert ambiguous.kind is PlanKind.AMBIGUOUS_PLACE
    assert ambiguous.kind in SETTLED_BY_POINTS
    assert ambiguous.facts["apart_deg"] == pytest.approx(180, abs=0.5)
    assert found.runner_up is not None


def test_a_building_of_two_equal_rooms_is_ambiguous():
    left, right = room_plan(), room_plan()
    right = replace(right, ends=right.ends + np.array([10.0, 0.0]))
    plan = Floorplan(
        "twins",
        np.concatenate([left.ends, right.ends]),
        np.concatenate([left.normals, right.normals]),
        np.ones(8, dtype=bool),
    )
    found = align(seen(plan, np.arange(3), np.eye(4)), plan, AlignOptions())
    assert any(each.kind is PlanKind.AMBIGUOUS_PLACE for each in found.findings)


def test_a_wrong_plan_is_said_to_be_one(office, rng):
    walls = seen(office, np.arange(12), np.eye(4))
    small = room_plan(2.0, 2.0)
    found = align(walls, small, AlignOptions())
    assert found.score < MIN_SCORE
    assert any(each.kind is PlanKind.LITTLE_WALL_ON_PLAN for each in found.findings)


# The place that the scan's format claims.


@pytest.mark.parametrize("off_m", [0.0, 1.0])
def test_a_claimed_alignment_that_fits_resolves_an_ambiguity(off_m):
    truth = se3.yaw_transform(np.pi, np.array([6.0, 4.0, 0.0]))  # the other of the two
    claimed = truth.copy()
    claimed[0, 3] += off_m
    walls = seen(room_plan(), np.arange(4), truth)
    found = align(walls, room_plan(), AlignOptions(), claimed)
    assert found.is_as_recorded
    assert found.is_sure
    (other,) = found.findings
    assert other.kind is PlanKind.OTHER_PLACE_THAN_RECORDED
    assert_at(found, truth)


def test_a_claimed_alignment_far_from_the_one_found_is_rejected_with_a_warning(office):
    claimed = se3.yaw_transform(0.0, np.array([20.0, 0.0, 0.0]))
    found = align(seen(office, np.arange(12), np.eye(4)), office, AlignOptions(), claimed)
    assert not found.is_as_recorded
    assert_at(found, np.eye(4))
    (elsewhere,) = (e for e in found.findings if e.kind is PlanKind.NOT_AS_RECORDED)
    assert elsewhere.facts["apart_m"] == pytest.approx(20.0, abs=0.05)


def test_a_claimed_half_turn_about_the_middle_of_the_scan_is_rejected(office):
    # It is near by the middle of the scan, but the walls disagree with it.
    walls = seen(office, np.arange(12), np.eye(4))
    middle = np.array([*walls.xy.mean(axis=0), 0.0])
    rotation = se3.yaw_transform(np.pi)
    rotation[:3, 3] = middle - rotation[:3, :3] @ middle
    found = align(walls, office, AlignOptions(), rotation)
    assert_at(found, np.eye(4))
    assert not found.is_as_recorded
    (turned,) = (e for e in found.findings if e.kind is PlanKind.NOT_AS_RECORDED)
    assert turned.facts["apart_deg"] == pytest.approx(180, abs=0.5)


def test_without_a_claim_nothing_is_as_recorded(office):
    assert not align(seen(office, np.arange(12), np.eye(4)), office, AlignOptions()).is_as_recorded


# Options.


def test_prior_translation_m(office):
    claimed = se3.yaw_transform(0.0, np.array([2.0, 0.0, 0.0]))
    walls = seen(office, np.arange(12), np.eye(4))
    assert align(walls, office, AlignOptions(), claimed).is_as_recorded
    far = se3.yaw_transform(0.0, np.array([9.0, 0.0, 0.0]))
    with patch.object(selection, "PRIOR_TRANSLATION_M", 0.001):
        assert not align(walls, office, AlignOptions(), far).is_as_recorded


def test_prior_yaw_deg(office):
    claimed = se3.yaw_transform(np.deg2rad(6.0))
    walls = seen(office, np.arange(12), np.eye(4))
    assert align(walls, office, AlignOptions(), claimed).is_as_recorded
    # The claim itself is tried as a start and ends at the truth, six degrees from what it claims.
    with patch.object(selection, "PRIOR_YAW_DEG", 5.0):
        assert not align(walls, office, AlignOptions(), claimed).is_as_recorded


def test_min_score_and_min_margin():
    walls = seen(room_plan(), np.arange(4), np.eye(4))
    with patch.object(selection, "MIN_SCORE", 1.01):
        picky = align(walls, room_plan(), AlignOptions())
    assert any(each.kind is PlanKind.LITTLE_WALL_ON_PLAN for each in picky.findings)
    with patch.object(selection, "MIN_MARGIN", -1.0):
        assert align(walls, room_plan(), AlignOptions()).findings == ()


def test_what_is_within_the_distance_of_another_alignment_is_the_same_one(monkeypatch):
    anywhere = selection.SameWithin(100.0, 181.0, 0.03)
    monkeypatch.setattr(selection.SameWithin, "distinct", lambda: anywhere)
    walls = seen(room_plan(), np.arange(4), np.eye(4))
    one = align(walls, room_plan(), AlignOptions())
    assert one.runner_up is None
    assert one.margin == one.score


def test_max_yaws_and_candidates(office):
    walls = seen(office, np.arange(12), se3.yaw_transform(0.5))
    with patch.object(search, "MAX_YAWS", 3):
        assert len(candidate_yaws(walls, office)) == 3
    with (
        patch.object(search, "MAX_YAWS", 1),
        patch.object(search, "MAX_CANDIDATES", 1),
    ):
        only = align(walls, office, AlignOptions())
    assert only.runner_up is None


def test_candidate_yaws_begin_with_the_true_one(office, rng):
    for _ in range(10):
        yaw = rng.uniform(-np.pi, np.pi)
        yaws = candidate_yaws(seen(office, np.arange(12), se3.yaw_transform(yaw)), office)
        off = (yaws - yaw + np.pi) % (2 * np.pi) - np.pi
        assert np.rad2deg(np.abs(off)).min() < 1.0  # four quarters agree equally well
        apart = np.abs((yaws[:, None] - yaws + np.pi) % (2 * np.pi) - np.pi)
        assert np.rad2deg(apart[~np.eye(len(yaws), dtype=bool)]).min() > 7.9


@pytest.mark.parametrize(
    "changed", [{"CELL_M": 0.1}, {"CELL_M": 0.4}, {"START_SIGMA_M": 0.2}, {"START_SIGMA_M": 0.8}]
)
def test_cell_and_reach_change_the_search_and_not_the_answer(office, changed):
    truth = se3.yaw_transform(-0.6, np.array([5.0, 9.0, 0.0]))
    with patch.multiple(search, **changed):
        found = align(seen(office, np.arange(12), truth), office, AlignOptions())
    assert_at(found, truth, middle=(6, 2, 0))


def test_samples_are_evenly_spaced_and_keep_their_normals():
    walls = sample_walls(np.array([[0.0, 1.0]]), np.array([[[0, 0], [2.0, 0]]]), spacing_m=0.5)
    assert_allclose(walls.xy, [[0.25, 0], [0.75, 0], [1.25, 0], [1.75, 0]])
    assert_allclose(walls.normals, np.tile([0, 1], (4, 1)))

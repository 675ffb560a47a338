"""A plan in metres that was drawn too large or too small: whether it is noticed, and what is said."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import faces_plan, moved_plan
from planfit.alignment import (
    AlignOptions,
    align,
    find_plan_scale,
    is_clearly_likelier,
    is_off,
    may_be_rescaled,
    sample_walls,
)
from planfit.findings import PlanKind
from planfit.floorplan import Floorplan
from planfit.geometry import se3

ROOMS = [(0, 0, 6, 4), (6.2, 0, 5, 4), (11.4, 0, 3, 7), (0, 4.2, 4, 6.3), (4.2, 4.2, 7, 2.8),
         (4.2, 7.2, 2.5, 3.3), (11.4, 7.2, 8, 5)]  # fmt: skip
PLAN_FROM_LEVEL = se3.yaw_transform(0.3, np.array([20.0, -7.0, 0.0]))
MIDDLE_LEVEL = np.array([6.0, 2.5, 0.0, 1.0])


def rooms_plan(rooms):
    plans = [faces_plan([[x, y], [x + w, y], [x + w, y + d], [x, y + d]]) for x, y, w, d in rooms]
    ends = np.concatenate([plan.ends for plan in plans])
    normals = np.concatenate([plan.normals for plan in plans])
    return Floorplan("office", ends, normals, np.ones(len(ends), dtype=bool))


@pytest.fixture(scope="module")
def office():
    return rooms_plan(ROOMS)


@pytest.fixture(scope="module")
def scan(office):
    """What cameras in the middles of three rooms see."""
    eyes = np.repeat([[3.0, 2.0], [8.7, 2.0], [12.9, 3.5]], 4, axis=0)
    return sample_walls(office.normals[:12], office.ends[:12], seen_from=eyes)


def found_in(scan, plan, options=None, recorded=None, slack=0.12):
    options = options or AlignOptions()
    drawn = align(scan, plan, options, recorded)
    return drawn, find_plan_scale(scan, plan, drawn, options, slack, recorded)


@pytest.mark.parametrize("drawn_at", [0.9, 0.99, 1.05])
def test_the_scale_of_a_plan_in_metres_is_found(office, scan, drawn_at):
    plan = moved_plan(office, PLAN_FROM_LEVEL).scaled(drawn_at)
    _, found = found_in(scan, plan)
    assert found is not None
    assert found.metres_per_unit == pytest.approx(1 / drawn_at, rel=2e-3)
    assert is_off(found)
    # Poses come out in metres of the plan once its coordinates are multiplied.
    assert_allclose(
        (found.plan_from_level @ MIDDLE_LEVEL)[:2], (PLAN_FROM_LEVEL @ MIDDLE_LEVEL)[:2], atol=0.02
    )


def test_a_right_plan_is_left_alone(office, scan):
    drawn, found = found_in(scan, moved_plan(office, PLAN_FROM_LEVEL))
    assert drawn.is_sure
    assert found is None


def test_walls_drawn_by_centre_lines_are_no_other_scale(office, scan):
    ends = office.ends - 0.1 * office.normals[:, None]
    lines = replace(office, ends=ends, is_oriented=np.zeros(len(office), dtype=bool))
    drawn, found = found_in(scan, lines)
    assert drawn.evidence is not None
    assert drawn.evidence.line_offset_m == pytest.approx(0.1, abs=0.03)
    assert found is None


def test_lines_off_in_scale_are_scaled_but_never_sure(office, scan):
    """Scale and thickness of walls cannot be told apart."""
    lines = replace(office, is_oriented=np.zeros(len(office), dtype=bool)).scaled(1.06)
    _, found = found_in(scan, lines)
    assert found is not None
    assert found.metres_per_unit == pytest.approx(1 / 1.06, rel=5e-3)
    assert not found.is_sure


@pytest.mark.parametrize("options", [AlignOptions(), AlignOptions(start="0,0,0")])
def test_the_search_keeps_to_what_the_user_says(office, scan, options):
    plan, slack = office.scaled(0.95), 0.12 if options.start else 0.02
    assert found_in(scan, plan, options, slack=slack)[1] is None


def test_a_plan_in_metres_keeps_its_scale_unless_the_user_allows_another():
    assert not may_be_rescaled(AlignOptions())
    allowed = AlignOptions(metric_scale_tolerance=0.05)
    assert may_be_rescaled(allowed, 1.04)
    assert not may_be_rescaled(allowed, 1.06)


@pytest.mark.parametrize(("cost_gain", "expected"), [(9.0, False), (9.3, True), (-50.0, False)])
def test_another_scale_is_told_of_from_odds_of_a_hundred_on(cost_gain, expected):
    """Costs are squared sigmas: exp(9.21 / 2) is 100."""
    assert is_clearly_likelier(cost_gain) is expected


def test_a_plan_without_unit_is_not_this_ones_task(office, scan):
    drawn = align(scan, office, AlignOptions())
    plan = replace(office, is_metric=False)
    assert find_plan_scale(scan, plan, drawn, AlignOptions(), 0.12) is None


@pytest.mark.parametrize("seed", range(2))
def test_another_building_fits_at_no_scale(scan, seed):
    rng = np.random.default_rng(seed)
    rooms = [(*rng.uniform(0, 30, 2), *rng.uniform(2, 9, 2)) for _ in range(9)]
    assert found_in(scan, rooms_plan(rooms))[1] is None


@pytest.mark.slow
def test_a_claim_of_axes_resolves_an_ambiguity_at_another_scale_too(scan, office):
    """Two equal wings, 60 m apart; the plan 4 % too large about its origin."""
    twins = rooms_plan([*ROOMS, *((x + 60, y, w, d) for x, y, w, d in ROOMS)]).scaled(1.04)
    _, unclaimed = found_in(scan, twins)
    assert unclaimed is not None
    assert not unclaimed.is_sure
    _, found = found_in(scan, twins, recorded=np.eye(4))
    assert found is not None
    assert found.is_sure
    assert found.is_as_recorded
    assert found.metres_per_unit == pytest.approx(1 / 1.04, rel=2e-3)


def at_scale(office, scan, factor, sigma):
    drawn = align(scan, office, AlignOptions())
    return drawn.rescaled(factor, 0.0, np.zeros(2)).rescaled(1.0, sigma, np.zeros(2))


@pytest.mark.parametrize(
    ("factor", "sigma", "expected"),
    [
        (1.03, 0.002, True),
        (0.97, 0.002, True),
        (1.005, 1e-5, False),  # plans in metres are right within half a per cent
        (1.03, 0.01, False),  # less than three standard deviations
    ],
)
def test_off_is_more_than_usual_and_surely_so(office, scan, factor, sigma, expected):
    assert is_off(at_scale(office, scan, factor, sigma)) is expected


def test_a_plan_at_another_scale_is_found_with_its_factor(office, scan):
    taken = replace(at_scale(office, scan, 1 / 0.97, 0.002), is_plan_rescaled=True)
    found = taken.all_findings[-1]
    assert found.kind is PlanKind.PLAN_RESCALED
    assert found.facts["scale_ratio"] == pytest.approx(1 / 0.97)
    assert found.facts["sigma_share"] == pytest.approx(0.002)

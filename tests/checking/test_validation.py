"""Numbers before and after: when one counts as worse."""

import pytest

from builders import make_structure, make_world, room_plan
from planfit.pipeline.validation import visit_check, wall_check
from verdicts import make_evidence, make_visit


@pytest.fixture
def world(rng):
    return make_world(rng)


def test_visits_that_come_apart_are_worse():
    better, worse = (
        visit_check(make_evidence(visits=(make_visit(before_m=first, kept_out_m=last),)))
        for first, last in ((0.5, 0.05), (0.05, 0.5))
    )
    assert not better.is_worse
    assert worse.is_worse
    assert (worse.before, worse.after) == (better.after, better.before)
    # Poses that were right before: a solve without the visit knows of it a little less well.
    assert not visit_check(
        make_evidence(visits=(make_visit(before_m=0.02, kept_out_m=0.03),))
    ).is_worse


def test_no_visits_no_check():
    assert visit_check(make_evidence(visits=())) is None


def test_walls_that_leave_the_plan_are_worse(world):
    true, off = world.plan_from_cams, world.plan_from_cams.copy()
    off[:, :2, 3] += 0.3
    worse = wall_check(world.structure, world.floorplan, true, off)
    assert worse.is_worse
    assert worse.before == pytest.approx(1.0)
    assert worse.after < 0.2
    assert not wall_check(world.structure, world.floorplan, off, true).is_worse
    assert not wall_check(world.structure, world.floorplan, true, true).is_worse


def test_no_walls_no_check(world):
    none = make_structure(world.plan_from_cams)
    assert wall_check(none, room_plan(), world.plan_from_cams, world.plan_from_cams) is None

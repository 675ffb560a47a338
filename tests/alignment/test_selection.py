"""When two alignments are the same."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from builders import room_plan
from planfit.alignment import MENDED_BY_WALLS, AlignOptions
from planfit.alignment.refine import AlignmentHypothesis
from planfit.alignment.selection import (
    MIN_SCORE,
    SameWithin,
    best_elsewhere,
    is_same,
    keep_distinct,
    select_hypothesis,
)
from planfit.alignment.wall_samples import WallSamples
from planfit.findings import PlanKind
from planfit.geometry import segments

WITHIN = SameWithin(translation_m=0.5, yaw_deg=5.0, scale=0.02)


@pytest.fixture
def walls():
    """A room whose middle is far from the origin, so that a yaw about the origin moves it."""
    plan = room_plan()
    xy, face = segments.sample(plan.ends, 0.1)
    return WallSamples(xy + 50.0, plan.normals[face])


def hypothesis(walls, yaw_deg=0.0, dx_m=0.0, scale=0.01, score=0.5):
    """Puts the middle of the walls at (0, 0) of the drawing, moved by `dx_m`."""
    yaw = np.deg2rad(yaw_deg)
    c, s = np.cos(yaw), np.sin(yaw)
    middle = np.array([[c, -s], [s, c]]) @ walls.xy.mean(axis=0)
    return AlignmentHypothesis(yaw, np.array([dx_m, 0.0]) - middle, score, (scale, scale))


def test_all_of_it_must_be_near(walls):
    others = [
        hypothesis(walls, 4.9),
        hypothesis(walls, 5.1),
        hypothesis(walls, 359.0),
        hypothesis(walls, 0.0, 0.49),
        hypothesis(walls, 0.0, 0.51),
        hypothesis(walls, scale=0.01015),
        hypothesis(walls, scale=0.0103),
    ]
    found = is_same(others, hypothesis(walls), walls, WITHIN)
    assert_array_equal(found, [True, False, True, True, False, True, False])


def test_the_first_of_each_group_is_kept_in_order(walls):
    many = [hypothesis(walls, dx_m=x) for x in (0.0, 3.0, 0.2, 3.3, 6.0, 0.4)]
    assert keep_distinct(many, walls, WITHIN, 9) == [many[0], many[1], many[4]]
    assert keep_distinct(many, walls, WITHIN, 2) == [many[0], many[1]]
    assert keep_distinct([], walls, WITHIN, 2) == []
    assert best_elsewhere(many, many[0], walls, WITHIN) is many[1]
    assert best_elsewhere(many[:1], many[0], walls, WITHIN) is None


@pytest.mark.parametrize(
    ("score", "elsewhere", "is_sure"),
    [(0.62, 0.52, False), (0.62, 0.42, True), (0.85, 0.78, True), (0.55, 0.4, False)],
)
def test_what_fits_little_must_stand_out_more(walls, score, elsewhere, is_sure):
    both = [hypothesis(walls, score=score), hypothesis(walls, dx_m=9.0, score=elsewhere)]
    plan, options = room_plan(), AlignOptions()
    found = select_hypothesis(walls, both, None, None, plan, options)
    assert found.is_sure is is_sure
    assert any(each.kind is PlanKind.LITTLE_MARGIN for each in found.findings) is not is_sure
    # Where the scan's format says the same, or the user, little is enough.
    assert select_hypothesis(walls, both, both[0], None, plan, options).is_sure


def test_that_little_wall_fits_is_told_as_what_the_adjustment_may_mend(walls):
    # A walk that drifted by a metre: 39 % before the walls had pulled, 95 % after.
    options = AlignOptions()
    few = [hypothesis(walls, score=MIN_SCORE - 0.1)]
    found = select_hypothesis(walls, few, None, None, room_plan(), options)
    (little,) = found.findings
    assert little.kind is PlanKind.LITTLE_WALL_ON_PLAN
    assert little.kind in MENDED_BY_WALLS
    many = [hypothesis(walls, score=MIN_SCORE + 0.3)]
    assert select_hypothesis(walls, many, None, None, room_plan(), options).findings == ()

"""The plan as an architect drew it."""

import numpy as np
import pytest
from drawn_plans.habits import DrawingHabits, drawn_plan
from numpy.testing import assert_allclose

from planfit.errors import OptionError
from planfit.synth import BuildingOptions, make_building


def building(yaw_deg: float = 0.0):
    return make_building(BuildingOptions(n_rooms=4, yaw_deg=yaw_deg), np.random.default_rng(3))


def test_without_errors_it_is_the_true_plan():
    true = building(20.0).floorplan
    plan = drawn_plan(building(20.0), DrawingHabits(0.0, 0.0, 0.0), np.random.default_rng(0))
    assert_allclose(plan.ends, true.ends, atol=2e-4)
    assert_allclose(plan.normals, true.normals, atol=1e-3)


@pytest.mark.parametrize("yaw_deg", [0.0, 33.0])
def test_finish_moves_faces_into_the_rooms(yaw_deg):
    true = building(yaw_deg).floorplan
    habits = DrawingHabits(offset_sigma_m=0.0, finish_m=0.02, grid_m=0.0)
    plan = drawn_plan(building(yaw_deg), habits, np.random.default_rng(0))
    along = np.einsum("ni,ni->n", (plan.ends - true.ends).mean(axis=1), true.normals)
    assert np.median(along) == pytest.approx(0.02, abs=1e-3)
    assert np.abs(along).max() < 0.0203


def test_offsets_have_their_sigma_and_corners_stay_closed():
    true = building().floorplan
    habits = DrawingHabits(offset_sigma_m=0.02, finish_m=0.0, grid_m=0.0)
    across = []
    for seed in range(30):
        plan = drawn_plan(building(), habits, np.random.default_rng(seed))
        across.append(np.einsum("ni,ni->n", (plan.ends - true.ends)[:, 0], true.normals))
        ends, drawn = true.ends.reshape(-1, 2), plan.ends.reshape(-1, 2)
        same = np.linalg.norm(ends[:, None] - ends, axis=2) < 1e-9
        gap = np.linalg.norm(drawn[:, None] - drawn, axis=2)
        assert gap[same].max() < 1e-9
    assert np.std(across) == pytest.approx(0.02, rel=0.1)


def test_grid_rounds_what_is_drawn():
    plan = drawn_plan(building(), DrawingHabits(0.02, 0.01, 0.05), np.random.default_rng(1))
    assert_allclose(plan.ends / 0.05, np.round(plan.ends / 0.05), atol=1e-6)


def test_the_same_seed_draws_the_same():
    one, two = (drawn_plan(building(), DrawingHabits(), np.random.default_rng(5)) for _ in range(2))
    assert np.array_equal(one.ends, two.ends)


def test_bad_habits_are_refused():
    with pytest.raises(OptionError, match="none below 0"):
        DrawingHabits(offset_sigma_m=-1.0)

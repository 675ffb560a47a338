"""The scale of a plan, by all measurements."""

from unittest.mock import patch

import numpy as np
import pytest

from builders import make_world
from planfit.adjust import AdjustOptions, refit_scale, scale
from planfit.adjust.scale import STEP, about_middle


@pytest.mark.parametrize("wrong", [0.996, 1.0, 1.005])
def test_the_scale_at_which_walls_strain_the_rest_least_is_the_true_one(rng, wrong):
    """And it takes no more than six adjustments to the plan."""
    world = make_world(rng)
    plan = world.floorplan.scaled(wrong)
    start = about_middle(world.plan_from_cams, wrong)
    with patch.object(scale, "adjust_to_plan", wraps=scale.adjust_to_plan) as adjust_to_plan:
        refit = refit_scale(world.measurements, plan, start, AdjustOptions())
    assert adjust_to_plan.call_count <= 6
    assert wrong * refit.factor == pytest.approx(1.0, abs=4e-4)
    assert 0 < refit.sigma < 0.01


def test_without_walls_there_is_no_bottom(rng):
    world = make_world(rng)
    far = world.plan_from_cams.copy()
    far[:, :2, 3] += 100.0
    refit = refit_scale(world.measurements, world.floorplan, far, AdjustOptions())
    assert refit.factor == pytest.approx(1.0, abs=STEP)
    assert refit.sigma > 0.05


def test_the_middle_keeps_its_spot_on_the_drawing(rng):
    poses = make_world(rng).plan_from_cams
    moved = about_middle(poses, 1.1)
    np.testing.assert_allclose(moved[:, :2, 3].mean(0), 1.1 * poses[:, :2, 3].mean(0))
    np.testing.assert_allclose(np.diff(moved[:, :3, 3], axis=0), np.diff(poses[:, :3, 3], axis=0))

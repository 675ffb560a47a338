"""Virtual points: the same cost as many points have, at any poses."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from virtual_points import virtual_matches, virtual_points

from builders import make_world, nudged, random_transforms
from facing import with_noise
from planfit.adjust.terms.between import PointTerm
from planfit.adjust.terms.observation_models import POINTS
from planfit.geometry import se3


@pytest.mark.parametrize("n", [4, 5, 300])
def test_four_points_have_the_moments_of_any_number_on_a_plane(n, rng):
    points = np.column_stack([rng.normal(3, 1, (n, 3)), np.ones(n)])
    weight = rng.uniform(0.1, 2.0, n)
    moments = np.einsum("ni,n,nj->ij", points, weight, points)
    four, each = virtual_points(moments[None])
    four = np.column_stack([four, np.ones(4)])
    assert_allclose(each[0] * four.T @ four, moments, rtol=1e-8)


def test_one_point_is_four_times_itself():
    point = np.array([1.0, 2.0, 3.0, 1.0])
    four, each = virtual_points(2.0 * np.outer(point, point)[None])
    assert_allclose(four, np.tile(point[:3], (4, 1)), atol=1e-6)
    assert_allclose(each, 0.5)


def test_seven_matches_cost_what_all_matches_of_a_pair_cost(rng):
    world = make_world(rng)
    term = PointTerm(with_noise(rng, world.matches), POINTS)
    moments, _ = term.reweight(nudged(rng, world.plan_from_cams, 1.0, 0.1))
    a, b, weight = virtual_matches(moments)
    for poses in (world.plan_from_cams, random_transforms(rng, len(world.plan_from_cams))):
        total = 0.0
        for k, (i, j) in enumerate(moments.pairs):
            seven = slice(7 * k, 7 * k + 7)
            apart = se3.transform(poses[i], a[seven]) - se3.transform(poses[j], b[seven])
            total += 0.5 * weight[k] * np.sum(apart**2)
        assert_allclose(total, moments.cost(poses), rtol=1e-6)

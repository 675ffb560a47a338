"""Laws that hold for every term of matches which does not collapse into moments."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import (
    gradient_by_differences,
    make_matches,
    nudged,
    random_transforms,
)
from facing import drifted, facing_cameras, facing_matches, facing_poses, with_noise, with_outliers
from planfit.adjust.terms.observation_models import RAYS, REPROJECTION
from planfit.adjust.terms.rays import RayTerm
from planfit.adjust.terms.reprojection import ReprojectionTerm
from planfit.lsq.normal_equations import NormalEquations
from planfit.lsq.pose_terms import PosePriorTerm
from planfit.lsq.robust import Loss, LossKind
from planfit.lsq.solver import SolverOptions, Stop, solve

NAMES = ["reprojection", "rays"]
LOSSES = [Loss(kind, 2.0) for kind in LossKind if kind != LossKind.NORM] + [
    Loss(LossKind.NORM, 0.01)
]


@pytest.fixture
def poses():
    return facing_poses()


@pytest.fixture
def matches(rng, poses):
    return facing_matches(rng, poses)


@pytest.fixture
def terms(matches, poses):
    return make_terms(matches, len(poses))


def make_terms(matches, n, **options):
    made = [
        ReprojectionTerm(matches, facing_cameras(n), replace(REPROJECTION, **options)),
        RayTerm(matches, replace(RAYS, **options)),
    ]
    return {term.name: term for term in made}


def rebuilt(term, **options):
    return replace(term, model=replace(term.model, **options))


@pytest.mark.parametrize("name", NAMES)
def test_zero_at_truth(name, terms, poses):
    quadratic, cost = terms[name].reweight(poses)
    assert_allclose(cost, 0.0, atol=1e-18)
    assert_allclose(quadratic.cost(poses), 0.0, atol=1e-18)
    assert_allclose(quadratic.normal_blocks(poses).gradient, 0.0, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_costs_more_away_from_truth(name, terms, poses, rng):
    assert terms[name].reweight(nudged(rng, poses, 1.0, 0.05))[1] > 1.0


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("loss", LOSSES, ids=lambda loss: loss.kind.name)
def test_gradient_is_that_of_the_frozen_and_of_the_robust_cost(name, loss, terms, poses, rng):
    term = rebuilt(terms[name], loss=loss)
    at = nudged(rng, poses, 1.0, 0.05)
    quadratic, _ = term.reweight(at)
    gradient = quadratic.normal_blocks(at).gradient
    robust = gradient_by_differences(lambda here: term.reweight(here)[1], at)
    scale = np.abs(robust).max()
    assert scale > 1.0
    assert_allclose(gradient, robust, atol=1e-5 * scale)
    assert_allclose(gradient, gradient_by_differences(quadratic.cost, at), atol=1e-5 * scale)


@pytest.mark.parametrize("name", NAMES)
def test_gradient_of_the_frozen_cost_elsewhere(name, terms, poses, rng):
    quadratic, _ = terms[name].reweight(nudged(rng, poses, 1.0, 0.05))
    at = nudged(rng, poses, 2.0, 0.05)
    expected = gradient_by_differences(quadratic.cost, at)
    gradient = quadratic.normal_blocks(at).gradient
    assert_allclose(gradient, expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("name", NAMES)
def test_frozen_squares_bound_the_robust_cost(name, matches, poses, rng):
    term = make_terms(with_outliers(rng, matches), len(poses))[name]
    at = nudged(rng, poses, 1.0, 0.05)
    quadratic, cost = term.reweight(at)
    for _ in range(10):
        other = nudged(rng, at, 1.0, 0.05)
        bound = cost + quadratic.cost(other) - quadratic.cost(at)
        assert term.reweight(other)[1] <= bound * (1 + 1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_moving_the_world_changes_nothing(name, terms, poses, rng):
    at = nudged(rng, poses, 1.0, 0.05)
    move = random_transforms(rng, 1)[0]
    assert_allclose(terms[name].reweight(move @ at)[1], terms[name].reweight(at)[1], rtol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_naming_a_pair_the_other_way_changes_nothing(name, terms, matches, poses, rng):
    at = nudged(rng, poses, 1.0, 0.05)
    swapped = replace(
        matches,
        pairs=matches.pairs[:, ::-1],
        points_a=matches.points_b,
        points_b=matches.points_a,
    )
    expected, cost = terms[name].reweight(at)
    other, other_cost = make_terms(swapped, len(poses))[name].reweight(at)
    assert_allclose(other_cost, cost, rtol=1e-9)
    dense = [NormalEquations([q.normal_blocks(at)], len(at)).matrix for q in (other, expected)]
    assert_allclose(dense[0].toarray(), dense[1].toarray(), atol=1e-9 * dense[1].max())


@pytest.mark.parametrize("name", NAMES)
def test_weight_multiplies_the_term_and_zero_switches_it_off(name, terms, poses, rng):
    at = nudged(rng, poses, 0.5, 0.02)
    one, cost = terms[name].reweight(at)
    for factor in (3.0, 0.0):
        other, other_cost = rebuilt(terms[name], weight=factor).reweight(at)
        assert_allclose(other_cost, factor * cost)
        assert_allclose(other.cost(at), factor * one.cost(at))
        expected, blocks = one.normal_blocks(at), other.normal_blocks(at)
        rounding = 1e-12 * np.abs(expected.blocks).max()
        assert_allclose(blocks.blocks, factor * expected.blocks, atol=rounding)
        assert_allclose(blocks.gradient, factor * expected.gradient, atol=rounding)


@pytest.mark.parametrize("name", NAMES)
def test_loss_is_the_one_chosen(name, terms, poses, rng):
    at = nudged(rng, poses, 5.0, 0.5)
    costs = [rebuilt(terms[name], loss=loss).reweight(at)[1] for loss in LOSSES[:4]]
    assert costs == sorted(costs, reverse=True)
    assert costs[0] > 2 * costs[-1]


@pytest.mark.parametrize("name", NAMES)
def test_max_observations_bounds_what_a_pair_is_worth(name, terms, poses, rng):
    at = nudged(rng, poses, 0.5, 0.02)
    one = rebuilt(terms[name], max_observations=1.0).reweight(at)[1]
    assert_allclose(rebuilt(terms[name], max_observations=0.5).reweight(at)[1], one / 2)


@pytest.mark.parametrize("name", NAMES)
def test_no_matches_cost_nothing(name, poses):
    quadratic, cost = make_terms(make_matches(poses, [], np.zeros((0, 3))), len(poses))[
        name
    ].reweight(poses)
    blocks = quadratic.normal_blocks(poses)
    assert cost == quadratic.cost(poses) == 0.0
    assert not blocks.blocks.any()
    assert blocks.gradient.shape == (len(poses), 6)


@pytest.mark.parametrize("name", NAMES)
def test_a_pair_without_matches_changes_nothing(name, terms, matches, poses, rng):
    at = nudged(rng, poses, 1.0, 0.05)
    more = replace(
        matches,
        pairs=np.concatenate([matches.pairs[:2], [[0, 3]], matches.pairs[2:]]),
        start=np.insert(matches.start, 2, matches.start[2]),
    )
    quadratic, cost = make_terms(more, len(poses))[name].reweight(at)
    expected, expected_cost = terms[name].reweight(at)
    assert_allclose(cost, expected_cost)
    gradient = expected.normal_blocks(at).gradient
    assert_allclose(quadratic.normal_blocks(at).gradient, gradient)


@pytest.mark.parametrize("name", NAMES)
def test_matches_may_be_float32(name, matches, poses, rng):
    at = nudged(rng, poses, 1.0, 0.05)
    single = replace(
        matches,
        points_a=matches.points_a.astype(np.float32),
        points_b=matches.points_b.astype(np.float32),
        sigma=matches.sigma.astype(np.float32),
    )
    costs = [make_terms(m, len(poses))[name].reweight(at)[1] for m in (single, matches)]
    assert_allclose(costs[0], costs[1], rtol=1e-4)


def test_outliers_lose_their_weight(matches, poses, rng):
    bad = with_outliers(rng, matches, size_m=2.0)
    far = np.linalg.norm(bad.points_a - matches.points_a, axis=1) > 1.0
    right = np.all(bad.points_a == matches.points_a, axis=1)
    quadratic, _ = make_terms(bad, len(poses))["reprojection"].reweight(poses)
    weight = quadratic.weight[: bad.n_matches]
    assert np.median(weight[far]) < 0.05 * weight[right].min()


@pytest.mark.parametrize(("name", "outliers"), [("reprojection", 0.1), ("rays", 0.0)])
def test_brings_drifted_poses_back(name, outliers, matches, poses, rng):
    # Rays do not hold the scale, hence two priors; nor do they bear outliers (see there).
    noisy = with_outliers(rng, with_noise(rng, matches, 0.001), share=outliers)
    ends = np.array([0, len(poses) - 1])
    pose_prior = PosePriorTerm(ends, poses[ends], np.full(6, 1e-4))
    start = drifted(rng, poses, 1.0, 0.1)
    terms = [make_terms(noisy, len(poses))[name], pose_prior]
    solution = solve(terms, start, SolverOptions(max_iterations=100, cost_tolerance=1e-7))
    assert solution.stop is Stop.COST
    translation_m = [
        np.linalg.norm((p - poses)[:, :3, 3], axis=1).max()
        for p in (start, solution.target_from_cams)
    ]
    assert translation_m[1] < 0.1 * translation_m[0]

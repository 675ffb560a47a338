"""Wall offsets: gradients and blocks against differences, and plans that are a little wrong."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import gradient_by_differences, make_world, nudged
from planfit.adjust import AdjustOptions, adjust_to_plan
from planfit.adjust.association import AssociationOptions, associate
from planfit.adjust.terms import observation_models
from planfit.adjust.terms.observation_models import WALLS
from planfit.adjust.terms.wall_offsets import (
    OffsetWallTerm,
    offset_prior,
    offset_sigmas,
    read_offsets,
    with_offsets,
)
from planfit.adjust.terms.walls import WallTerm
from planfit.geometry import se3
from planfit.lsq.normal_equations import NormalEquations
from planfit.lsq.robust import Loss, LossKind


@pytest.fixture
def world(rng):
    return make_world(rng)


@pytest.fixture
def case(world, rng):
    """A term, and unknowns at which faces are displaced in every direction."""
    association = associate(
        world.structure.walls, world.floorplan, world.plan_from_cams, 0.5, AssociationOptions()
    )
    n = len(world.plan_from_cams)
    term = OffsetWallTerm(world.structure.walls, world.floorplan, association, WALLS, n)
    unknowns = with_offsets(nudged(rng, world.plan_from_cams, 1.0, 0.05), world.floorplan)
    unknowns[n:, :3, 3] = rng.normal(size=(len(world.floorplan), 3)) * 0.05
    return term, unknowns


def test_gradient_is_that_of_the_cost(case):
    term, unknowns = case
    quadratic, cost = term.reweight(unknowns)
    found = quadratic.normal_blocks(unknowns).gradient
    scale = np.abs(found).max()
    assert_allclose(found, gradient_by_differences(quadratic.cost, unknowns), atol=1e-5 * scale)
    robust = gradient_by_differences(lambda u: term.reweight(u)[1], unknowns)
    assert_allclose(found, robust, atol=1e-5 * scale)
    assert cost > 0


def test_blocks_are_the_second_derivative_where_distances_are_zero(world, case):
    term, _ = case
    at_truth = with_offsets(world.plan_from_cams, world.floorplan)
    quadratic, _ = term.reweight(at_truth)
    equations = NormalEquations([quadratic.normal_blocks(at_truth)], len(at_truth))
    size = 6 * len(at_truth)
    expected = np.zeros((size, size))
    for column in range(size):
        delta = np.zeros(size)
        delta[column] = 1e-5
        ahead, behind = (
            quadratic.normal_blocks(se3.retract(at_truth, sign * delta.reshape(-1, 6))).gradient
            for sign in (1, -1)
        )
        expected[:, column] = ((ahead - behind) / 2e-5).ravel()
    found = equations.matrix.toarray()
    assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())


def test_faces_as_drawn_cost_what_the_plain_term_costs(world, case, rng):
    term, _ = case
    poses = nudged(rng, world.plan_from_cams, 1.0, 0.05)
    plain = WallTerm(world.structure.walls, world.floorplan, term.association, term.model)
    displaced = term.reweight(with_offsets(poses, world.floorplan))[1]
    assert displaced == pytest.approx(plain.reweight(poses)[1], rel=1e-12)


def moved_plan(floorplan, face, by_m):
    """The plan with one face drawn off by so much along its normal."""
    ends = floorplan.ends.copy()
    ends[face] += by_m * floorplan.normals[face]
    return replace(floorplan, ends=ends)


def test_a_face_drawn_off_is_found_and_does_not_deform_the_scan(world):
    wrong = moved_plan(world.floorplan, 1, -0.08)
    strain = {}
    for sigma_m in (0.0, 0.05):
        # A loss that does not reject the wall outright, so that it has to go somewhere.
        walls = replace(WALLS, loss=Loss(LossKind.CAUCHY, 2.0))
        options = AdjustOptions(wall_offset_sigma_m=sigma_m)
        with patch.dict(observation_models.ROBUST, walls=walls):
            plan_adjustment = adjust_to_plan(
                world.measurements, wrong, world.plan_from_cams, options
            )
        costs = plan_adjustment.solution.cost_by_term
        strain[sigma_m] = costs["points"].after + costs["odometry"].after
        if sigma_m:
            # Which of two opposite walls is off, the scan cannot tell: they share it.
            assert plan_adjustment.offsets_m[1] + plan_adjustment.offsets_m[3] > 0.055
            assert_allclose(plan_adjustment.offsets_m[[0, 2]], 0.0, atol=0.005)
        else:
            assert_allclose(plan_adjustment.offsets_m, 0.0)
    assert strain[0.05] < 0.5 * strain[0.0]


def test_a_tight_prior_keeps_faces_where_they_are_drawn(world):
    wrong = moved_plan(world.floorplan, 1, -0.08)
    options = AdjustOptions(wall_offset_sigma_m=1e-4)
    plan_adjustment = adjust_to_plan(world.measurements, wrong, world.plan_from_cams, options)
    assert np.abs(plan_adjustment.offsets_m).max() < 1e-3


def test_offsets_are_read_along_the_normals(world):
    n = len(world.plan_from_cams)
    unknowns = with_offsets(world.plan_from_cams, world.floorplan)
    unknowns[n:, :2, 3] = 0.07 * world.floorplan.normals
    assert_allclose(read_offsets(unknowns, n, world.floorplan), 0.07)
    assert offset_prior(n, world.floorplan, 0.07).cost(unknowns) == pytest.approx(
        0.5 * len(world.floorplan)
    )


def test_offsets_that_are_seen_are_surer_than_their_prior(world):
    n, floorplan = len(world.plan_from_cams), world.floorplan
    association = associate(
        world.structure.walls, floorplan, world.plan_from_cams, 0.5, AssociationOptions()
    )
    term = OffsetWallTerm(world.structure.walls, floorplan, association, WALLS, n)
    terms = [*world.scan_terms, term, offset_prior(n, floorplan, 0.05)]
    unknowns = with_offsets(world.plan_from_cams, floorplan)
    faces = n + np.arange(len(floorplan))
    sigmas_m = offset_sigmas(terms, unknowns, faces, floorplan.normals)
    seen = np.isin(np.arange(len(floorplan)), association.face_idx)
    assert np.all(sigmas_m[seen] < 0.05)
    assert_allclose(sigmas_m[~seen], 0.05, rtol=1e-6)

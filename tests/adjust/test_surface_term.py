"""The surfaces term: its cost is that of the pairs' information, and free directions are not held."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import gradient_by_differences, make_world, nudged, random_transforms
from planfit.adjust import AdjustOptions, build_problem, hold_to_keyframes, reduce_measurements
from planfit.adjust.options import TermOptions
from planfit.adjust.paper.preset import paper_options
from planfit.adjust.terms.between import SurfaceTerm
from planfit.adjust.terms.observation_models import SURFACES
from planfit.errors import OptionError, ScanError
from planfit.geometry import se3
from planfit.lsq.robust import SQUARES
from planfit.matching import SurfacePairs
from planfit.tracking import KeyframeOptions, choose_keyframes, surface_motions


def make_pairs(rng, poses, pairs, rank=6):
    """Exact motions between poses, with information of a rank."""
    pairs = np.asarray(pairs)
    i, j = pairs.T
    motion = se3.inverse(poses[i]) @ poses[j]
    rows = rng.normal(size=(len(pairs), rank, 6))
    information = np.swapaxes(rows, 1, 2) @ rows * 100
    by_sensor = 0.3 * rng.normal(size=(len(pairs), 6, 7))
    ones = np.ones(len(pairs))
    return SurfacePairs(pairs, motion, information, ones, by_sensor, 2.5 * ones)


@pytest.mark.parametrize("rank", [6, 5, 3])
def test_cost_is_the_information_along_the_tangent(rng, rank) -> None:
    poses = random_transforms(rng, 4)
    pairs = make_pairs(rng, poses, [[0, 1], [1, 3]], rank)
    assert (pairs.n_free == 6 - rank).all()
    term = SurfaceTerm(pairs, replace(SURFACES, loss=SQUARES))
    tangent = 1e-4 * rng.normal(size=(2, 6))
    off = replace(pairs, a_from_b=se3.retract(pairs.a_from_b, tangent))
    moved = SurfaceTerm(off, replace(SURFACES, loss=SQUARES))
    expected = 0.5 * np.einsum("pi,pij,pj->", tangent, pairs.information, tangent)
    assert term.reweight(poses)[1] == pytest.approx(0.0, abs=1e-12)
    assert moved.reweight(poses)[1] == pytest.approx(expected, rel=2e-3)


def test_gradient_by_differences_at_a_rank_below_six(rng) -> None:
    poses = random_transforms(rng, 4)
    pairs = make_pairs(rng, poses, [[0, 1], [1, 3], [0, 3]], rank=5)
    term = SurfaceTerm(pairs, SURFACES)
    there = nudged(rng, poses, 2.0, 0.05)
    by_terms = term.reweight(there)[0].normal_blocks(there).gradient
    slopes = gradient_by_differences(lambda p: term.reweight(p)[1], there)
    assert_allclose(by_terms, slopes, rtol=1e-4, atol=1e-4 * np.abs(slopes).max())


def test_weight_and_loss_reach_the_term(rng) -> None:
    poses = random_transforms(rng, 3)
    pairs = make_pairs(rng, poses, [[0, 1], [1, 2]])
    there = nudged(rng, poses, 5.0, 0.3)

    def cost(**options):
        return SurfaceTerm(pairs, replace(SURFACES, **options)).reweight(there)[1]

    assert cost(weight=2.0) == pytest.approx(2 * cost())
    assert cost(loss=SQUARES) > cost()


def test_pairs_hold_frames_that_nothing_else_holds(rng) -> None:
    """Drifted steps, no keypoints: surfaces bring the frames back, but for the direction they leave free."""
    world = make_world(rng, n=8)
    none = world.matches.of_pairs(np.zeros(len(world.matches.pairs), dtype=bool))
    pairs = [[i, j] for i in range(8) for j in range(i + 1, 8)]
    surfaces = make_pairs(rng, world.plan_from_cams, pairs)
    measured = replace(world.measurements, matches=none, surfaces=surfaces)
    start = world.plan_from_cams.copy()
    start[1:] = nudged(rng, start[1:], 2.0, 0.1)
    options = AdjustOptions(odometry=replace(AdjustOptions().odometry, weight=0.0))
    problem = build_problem(measured, options, start)
    assert problem.surfaces is not None
    assert "surfaces" in problem.costs(start)
    solved = problem.solve().target_from_cams
    assert_allclose(solved[:, :3, 3], world.plan_from_cams[:, :3, 3], atol=2e-3)
    without = replace(options, surfaces=TermOptions(0.0))
    assert build_problem(measured, without, start).surfaces is None


def test_a_direction_left_free_is_not_held(rng) -> None:
    poses = np.tile(np.eye(4), (2, 1, 1))
    information = np.diag([1e4, 1e4, 1e4, 1e4, 1e4, 0.0])[None]
    pairs = SurfacePairs(
        np.array([[0, 1]]),
        np.eye(4)[None],
        information,
        np.ones(1),
        np.zeros((1, 6, 7)),
        np.ones(1),
    )
    term = SurfaceTerm(pairs, SURFACES)
    along, across = poses.copy(), poses.copy()
    along[1, 2, 3] = 3.0
    across[1, 0, 3] = 0.1
    assert term.reweight(along)[1] == pytest.approx(0.0, abs=1e-9)
    assert term.reweight(across)[1] > 1.0
    motions = surface_motions(pairs)
    sigmas = np.sqrt(np.diagonal(motions.covariance[0]))
    assert sigmas[5] == pytest.approx(10.0, rel=0.01)
    assert sigmas[3] < 0.02


def test_keyframes_carry_pairs_and_what_they_observe(rng) -> None:
    """A departure of the poses costs the same, whether frames or keyframes are asked."""
    n = 12
    steps = random_transforms(rng, n - 1, max_rotation=0.05, extent_m=0.05)
    poses = [np.eye(4)]
    for step in steps:
        poses.append(poses[-1] @ step)
    poses = np.stack(poses)
    world = make_world(rng, n=n)
    pairs = make_pairs(rng, poses, [[0, 5], [1, 2], [2, 9], [4, 11]], rank=5)
    measured = replace(world.measurements, surfaces=pairs)
    chosen = KeyframeOptions(min_frames=2, max_step_m=0.15, max_rotation_deg=30.0)
    keyframes = hold_to_keyframes(
        poses, choose_keyframes(poses, np.arange(float(len(poses))), chosen)
    )
    assert len(keyframes.frame_idx) < n
    reduced = reduce_measurements(measured, keyframes).surfaces
    moved = nudged(rng, poses[keyframes.frame_idx], 0.002, 0.0001)
    every = moved[keyframes.nearest] @ keyframes.key_from_cam
    options = replace(SURFACES, loss=SQUARES)
    between = keyframes.nearest[pairs.pairs]
    own = pairs[between[:, 0] != between[:, 1]]
    assert len(reduced) == len(own) > 0
    assert (reduced.n_free == 1).all()
    expected = SurfaceTerm(own, options).reweight(every)[1]
    assert SurfaceTerm(reduced, options).reweight(moved)[1] == pytest.approx(expected, rel=1e-3)


def test_a_pair_that_is_not_finite_is_refused_by_name(rng) -> None:
    world = make_world(rng, n=4)
    pairs = make_pairs(rng, world.plan_from_cams, [[0, 1]])
    bad = replace(pairs, information=pairs.information * np.nan)
    with pytest.raises(ScanError, match="pair of surfaces"):
        replace(world.measurements, surfaces=bad)


def test_the_papers_cost_has_no_surfaces() -> None:
    assert paper_options().surfaces.weight == 0.0
    by_sgd = replace(paper_options(), method="sgd")
    with pytest.raises(OptionError, match="paper's cost only"):
        replace(by_sgd, surfaces=TermOptions())

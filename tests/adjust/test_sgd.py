"""The paper's solver: the same cost and slope as planfit's terms, safe at zero, and why it stops."""

import sys
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import gradient_by_differences, make_world, nudged
from planfit.adjust.association import Association, AssociationOptions, associate
from planfit.adjust.paper import descent as sgd
from planfit.adjust.paper.descent import DescentSchedule, DescentStop, PaperWeights
from planfit.adjust.paper.preset import paper_terms
from planfit.errors import OptionError
from planfit.lsq.solver import SolverOptions, solve

QUICK = DescentSchedule(max_steps=300, record_every_steps=50, tolerance=0.0)


def needs_torch():
    pytest.importorskip("torch", reason="PyTorch is not installed (pip install planfit[torch])")


@pytest.fixture
def world(rng):
    return make_world(rng)


@pytest.fixture
def inputs(world):
    association = associate(
        world.structure.walls, world.floorplan, world.plan_from_cams, 0.5, AssociationOptions()
    )
    face_idx = association.face_idx.copy()
    face_idx[::3] = -1  # some wall patches have no face
    partly = Association(face_idx, association.distance_m)
    return world.matches, world.structure, world.floorplan, partly


@pytest.fixture
def start(world, rng):
    return nudged(rng, world.plan_from_cams, 2.0, 0.05)


def paper_cost(inputs, poses, weights=None):
    terms = paper_terms(*inputs, weights or PaperWeights())
    return sum(term.reweight(poses)[1] for term in terms)


def test_paper_terms_are_means_of_distances(inputs, world, start):
    matches, structure, floorplan, association = inputs
    costs = {t.name: t.reweight(start)[1] for t in paper_terms(*inputs, PaperWeights(10.0, 0.5))}
    apart = []
    for k, (i, j) in enumerate(matches.pairs):
        part = slice(matches.start[k], matches.start[k + 1])
        a = matches.points_a[part] @ start[i, :3, :3].T + start[i, :3, 3]
        b = matches.points_b[part] @ start[j, :3, :3].T + start[j, :3, 3]
        apart.append(np.linalg.norm(a - b, axis=1))
    poses = start[structure.floor.frame_idx]
    floor = np.einsum("ka,ka->k", poses[:, 2, :3], structure.floor.points_cam) + poses[:, 2, 3]
    poses = start[structure.walls.point_frame_idx]
    wall = np.einsum("kab,kb->ka", poses[:, :3, :3], structure.walls.points_cam) + poses[:, :3, 3]
    face = np.repeat(association.face_idx, np.diff(structure.walls.start))
    off = np.einsum("ka,ka->k", wall[:, :2], floorplan.normals[face]) - floorplan.offsets[face]
    assert_allclose(costs["points"], np.concatenate(apart).mean(), rtol=1e-4)
    assert_allclose(costs["floor"], 10.0 * np.abs(floor).mean(), rtol=1e-4)
    assert_allclose(costs["walls"], 0.5 * np.abs(off[face >= 0]).mean(), rtol=1e-4)


@pytest.mark.parametrize(
    "weights", [PaperWeights(), PaperWeights(3.0, 2.0), PaperWeights(0.0, 0.6), PaperWeights(1, 0)]
)
def test_loss_and_slope_are_those_of_the_terms(inputs, start, weights):
    needs_torch()
    loss, slope = sgd.loss_and_gradient(*inputs, start, weights)
    quadratics = [term.reweight(start) for term in paper_terms(*inputs, weights)]
    assert_allclose(loss, sum(cost for _, cost in quadratics), rtol=1e-6)
    analytic = sum(quadratic.normal_blocks(start).gradient for quadratic, _ in quadratics)
    assert_allclose(slope, analytic, atol=1e-8 * np.abs(analytic).max())
    differences = gradient_by_differences(lambda at: paper_cost(inputs, at, weights), start)
    assert_allclose(slope, differences, atol=2e-3 * np.abs(differences).max())


def test_slope_is_finite_at_zero_distance_and_zero_rotation(inputs, world):
    needs_torch()
    matches = replace(inputs[0], points_b=inputs[0].points_a)
    still = np.tile(np.eye(4), (len(world.plan_from_cams), 1, 1))
    loss, slope = sgd.loss_and_gradient(matches, *inputs[1:], still, PaperWeights(0.0, 0.0))
    assert loss == 0.0
    assert_array_equal(slope, 0.0)
    _, slope = sgd.loss_and_gradient(*inputs, world.plan_from_cams, PaperWeights())
    assert np.isfinite(slope).all()


def test_descent_lowers_the_loss_to_that_of_its_poses(inputs, start):
    needs_torch()
    found = sgd.descend(*inputs, start, PaperWeights(), QUICK)
    assert found.stop is DescentStop.LIMIT
    assert_array_equal(found.steps, np.arange(0, 301, 50))
    assert_allclose(
        found.loss_m[[0, -1]], [paper_cost(inputs, p) for p in (start, found.target_from_cams)]
    )
    assert found.loss_m[-1] < 0.5 * found.loss_m[0]
    assert (np.diff(found.elapsed_s) > 0).all()
    again = sgd.descend(*inputs, start, PaperWeights(), QUICK)
    assert_array_equal(again.target_from_cams, found.target_from_cams)


def test_levenberg_marquardt_gets_lower(inputs, start):
    needs_torch()
    found = sgd.descend(*inputs, start, PaperWeights(), QUICK)
    solution = solve(paper_terms(*inputs, PaperWeights()), start, SolverOptions())
    assert paper_cost(inputs, solution.target_from_cams) < found.loss_m[-1]


def test_tolerance_stops_it_once_the_late_rate_is_reached(inputs, start):
    needs_torch()
    # Any change is below this tolerance: only the schedule keeps the descent going.
    easy = replace(QUICK, tolerance=10.0, max_steps=80)
    for drop, expected in ((0, 1), (30, 31)):
        options = replace(easy, drop_after_steps=drop)
        found = sgd.descend(*inputs, start, PaperWeights(), options)
        assert (found.stop, found.steps[-1]) == (DescentStop.TOLERANCE, expected)
    never = sgd.descend(*inputs, start, PaperWeights(), replace(easy, drop_after_steps=80))
    assert (never.stop, never.steps[-1]) == (DescentStop.LIMIT, 80)


def test_the_published_schedule():
    schedule = DescentSchedule()
    assert (schedule.learning_rate, sgd.LATE_LEARNING_RATE) == (1e-3, 1e-4)
    assert (schedule.drop_after_steps, schedule.tolerance) == (20_000, 1e-5)
    assert sgd.MOMENTUM == 0.9
    assert schedule.max_steps > schedule.drop_after_steps


def test_the_stop_is_where_the_first_small_change_is_by_the_losses(inputs, start):
    needs_torch()
    # Slow twin: all losses written down, the stop looked up in them.
    drop = 100
    kept = replace(QUICK, max_steps=250, drop_after_steps=drop, record_every_steps=1)
    loss_m = sgd.descend(*inputs, start, PaperWeights(), kept).loss_m
    changes = np.abs(np.diff(loss_m))  # change k: from step k to k + 1
    tolerance = float(np.median(changes[drop:]))
    expected = next(k + 1 for k in range(drop, 250) if changes[k] < tolerance)
    found = sgd.descend(*inputs, start, PaperWeights(), replace(kept, tolerance=tolerance))
    assert (found.stop, found.steps[-1]) == (DescentStop.TOLERANCE, expected)
    assert_allclose(found.loss_m[-1], loss_m[expected])


def test_learning_rate_drops_after_its_steps(inputs, start):
    needs_torch()
    slow = replace(QUICK, max_steps=1, learning_rate=1e-4)
    dropped = replace(QUICK, max_steps=1, learning_rate=1e-3, drop_after_steps=0)
    one, other, fast = (
        sgd.descend(*inputs, start, PaperWeights(), options).target_from_cams
        for options in (slow, dropped, replace(QUICK, max_steps=1))
    )
    assert_array_equal(one, other)
    assert np.abs(fast - start).max() > 5 * np.abs(one - start).max()


def test_momentum_and_precision_count(inputs, start):
    needs_torch()
    with patch.object(sgd, "MOMENTUM", 0.0):
        plain = sgd.descend(*inputs, start, PaperWeights(), replace(QUICK, max_steps=20))
    heavy = sgd.descend(*inputs, start, PaperWeights(), replace(QUICK, max_steps=20))
    single = sgd.descend(
        *inputs, start, PaperWeights(), replace(QUICK, max_steps=20, dtype="float32")
    )
    assert heavy.loss_m[-1] < plain.loss_m[-1]
    assert_allclose(single.target_from_cams, heavy.target_from_cams, atol=1e-4)
    assert np.abs(single.target_from_cams - heavy.target_from_cams).max() > 0


def test_says_that_it_diverged(inputs, start):
    needs_torch()
    wild = replace(QUICK, learning_rate=1e200, max_steps=20)
    found = sgd.descend(*inputs, start, PaperWeights(), wild)
    assert found.stop is DescentStop.DIVERGED
    assert_array_equal(found.target_from_cams, start)


def test_says_how_to_get_torch(inputs, start, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(OptionError, match=r"planfit\[torch\]"):
        sgd.descend(*inputs, start, PaperWeights(), QUICK)

"""A term out of a residual function: against dense twins, and its mistakes by name."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import least_squares

from builders import gradient_by_differences, jacobian_by_differences, nudged, random_transforms
from lsq.pose_graphs import random_information
from planfit.errors import OptionError
from planfit.geometry import se3
from planfit.lsq import Loss, LossKind, PosePriorTerm, Problem, ResidualTerm, SolverOptions
from planfit.lsq.normal_equations import NormalEquations
from planfit.lsq.residual_term import check_information
from planfit.lsq.residual_term import jacobian_by_differences as differenced

N = 5
TIGHT = SolverOptions(max_iterations=300, cost_tolerance=1e-13)


def distances_term(rng, poses, k=12, **fields):
    """Distances between poses, one number a row."""
    pose_idx = np.array([rng.choice(N, 2, replace=False) for _ in range(k)])

    def distance(at):
        return np.linalg.norm(at[:, 0, :3, 3] - at[:, 1, :3, 3], axis=1)

    measured = distance(poses[pose_idx]) + rng.normal(0, 0.1, k)
    return ResidualTerm(pose_idx, lambda at: (distance(at) - measured)[:, None], **fields)


def midpoint_term(rng, k=7, **fields):
    """Three poses a row, three numbers: a point of the middle one, seen halfway between the outer ones."""
    pose_idx = rng.integers(N, size=(k, 3))
    points = rng.normal(size=(k, 3))

    def residual(at):
        middle = se3.transform_each(at[:, 1], points)
        return middle - 0.5 * (at[:, 0, :3, 3] + at[:, 2, :3, 3])

    return ResidualTerm(pose_idx, residual, **fields)


def point_term(rng, k=9, **fields):
    """One pose a row: a point belongs at a place; with its Jacobian."""
    pose_idx, points, places = rng.integers(N, size=(k, 1)), *rng.normal(size=(2, k, 3))

    def residual(at):
        return se3.transform_each(at[:, 0], points) - places

    def jacobian(at):
        rotated = np.einsum("kij,kj->ki", at[:, 0, :3, :3], points)
        return np.concatenate([-se3.skew(rotated), np.tile(np.eye(3), (k, 1, 1))], axis=2)

    return ResidualTerm(pose_idx, residual, jacobian=jacobian, **fields)


CAUCHY = Loss(LossKind.CAUCHY, 1.5)


def cases(rng, poses):
    return {
        "one number": distances_term(rng, poses, sigma=0.2, loss=CAUCHY),
        "sigma of a number": midpoint_term(rng, sigma=np.array([0.1, 0.5, np.inf]), weight=3.0),
        "sigma of a row": midpoint_term(rng, sigma=rng.uniform(0.1, 1, (7, 3)), loss=CAUCHY),
        "one information": midpoint_term(rng, information=random_information(rng, 1)[0, :3, :3]),
        "information of a row": point_term(
            rng, information=random_information(rng, 9)[:, :3, :3], loss=CAUCHY
        ),
    }


NAMES = list(cases(np.random.default_rng(0), np.tile(np.eye(4), (N, 1, 1))))


@pytest.fixture
def poses(rng):
    return random_transforms(rng, N)


def whitened(term, poses):
    """Roots of the information times residuals, flat; the root of a diagonal is its square root."""
    information = term.reweight(poses)[0].information
    if information.ndim == 2:
        return lambda at: (np.sqrt(information) * term.residuals(at)).ravel()
    root = np.swapaxes(np.linalg.cholesky(information), 1, 2)
    return lambda at: np.einsum("kab,kb->ka", root, term.residuals(at)).ravel()


@pytest.mark.parametrize("name", NAMES)
def test_blocks_are_those_of_the_dense_jacobian(name, poses, rng):
    term = cases(rng, poses)[name]
    at = nudged(rng, poses, 5.0, 0.2)
    residuals = whitened(term, at)
    jacobian = jacobian_by_differences(residuals, at)
    quadratic, _ = term.reweight(at)
    blocks = quadratic.normal_blocks(at)
    dense = NormalEquations([blocks], N).matrix.toarray()
    assert_allclose(dense, jacobian.T @ jacobian, atol=1e-6 * np.abs(dense).max())
    expected = jacobian.T @ residuals(at)
    assert_allclose(blocks.gradient.ravel(), expected, atol=1e-6 * np.abs(expected).max())
    assert_allclose(quadratic.cost(at), 0.5 * np.sum(residuals(at) ** 2))


@pytest.mark.parametrize("name", NAMES)
def test_gradient_is_that_of_the_robust_cost(name, poses, rng):
    term = cases(rng, poses)[name]
    expected = gradient_by_differences(lambda at: term.reweight(at)[1], poses)
    gradient = term.reweight(poses)[0].normal_blocks(poses).gradient
    assert_allclose(gradient, expected, atol=1e-5 * np.abs(expected).max())


def test_differences_meet_the_analytic_jacobian(poses, rng):
    term = point_term(rng)
    at = poses[term.pose_idx]
    assert_allclose(differenced(term.residual, at), term.jacobian(at), atol=1e-9)


def test_differences_leave_poses_as_they_were(poses, rng):
    term, copy = midpoint_term(rng), poses.copy()
    differenced(term.residual, poses[term.pose_idx])
    np.testing.assert_array_equal(poses, copy)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 4), st.integers(1, 5))
def test_rows_that_name_poses_in_any_order_or_twice_add_up(seed, n_named, d):
    """Linear residuals of random Jacobians: the sum of rows is the product of the dense Jacobian."""
    rng = np.random.default_rng(seed)
    pose_idx = rng.integers(N, size=(6, n_named))
    jacobians, given = rng.normal(size=(6, d, 6 * n_named)), rng.normal(size=(6, d))
    term = ResidualTerm(pose_idx, lambda _: given, jacobian=lambda _: jacobians)
    dense = np.zeros((6 * d, 6 * N))
    for row, named in enumerate(pose_idx):
        for slot, i in enumerate(named):
            part = jacobians[row, :, 6 * slot : 6 * slot + 6]
            dense[row * d : row * d + d, 6 * i : 6 * i + 6] += part
    at = np.tile(np.eye(4), (N, 1, 1))
    blocks = term.reweight(at)[0].normal_blocks(at)
    matrix = NormalEquations([blocks], N).matrix.toarray()
    assert_allclose(matrix, dense.T @ dense, atol=1e-10)
    assert_allclose(blocks.gradient.ravel(), dense.T @ given.ravel(), atol=1e-10)


@pytest.mark.parametrize(
    "loss", [Loss(LossKind.SQUARED), CAUCHY, Loss(LossKind.GEMAN_MCCLURE, 3.0)]
)
def test_a_solve_agrees_with_scipy(poses, rng, loss):
    prior = PosePriorTerm(np.array([0]), poses[:1], np.full(6, 1e-2))
    term = replace(distances_term(rng, poses, 30), sigma=0.1, loss=loss)
    near = PosePriorTerm(np.arange(N), nudged(rng, poses, 3.0, 0.1), np.full(6, 0.3), "near")
    start = nudged(rng, poses, 1.0, 0.05)

    def residuals(flat):
        at = se3.retract(start, flat.reshape(-1, 6))
        s = np.sum((term.residuals(at) / 0.1) ** 2, axis=1)
        c2 = loss.scale**2
        rho = {
            LossKind.SQUARED: s,
            LossKind.CAUCHY: c2 * np.log1p(s / c2),
            LossKind.GEMAN_MCCLURE: s * c2 / (c2 + s),
        }[loss.kind]
        held = se3.difference(at[:1], poses[:1]) / 1e-2
        about = se3.difference(at, near.target_from_priors) / 0.3
        return np.concatenate([np.sqrt(rho + 1e-300), held.ravel(), about.ravel()])

    solution = Problem([prior, term, near], start).solve(TIGHT)
    other = least_squares(residuals, np.zeros(6 * N), xtol=1e-14, ftol=1e-14, gtol=1e-12)
    total = sum(cost.after for cost in solution.cost_by_term.values())
    assert_allclose(total, other.cost, rtol=1e-7)
    expected = se3.retract(start, other.x.reshape(-1, 6))
    assert_allclose(solution.target_from_cams, expected, atol=1e-4)


def test_moving_the_world_changes_no_cost_between_poses(poses, rng):
    term = distances_term(rng, poses, loss=CAUCHY, sigma=0.1)
    moved = random_transforms(rng, 1)[0] @ poses
    assert_allclose(term.reweight(moved)[1], term.reweight(poses)[1], rtol=1e-9)


def test_a_wider_loss_is_a_larger_scale(poses, rng):
    term = distances_term(rng, poses, sigma=0.01, loss=CAUCHY)
    wide = term.with_wider_loss(3.0)
    assert wide.loss == Loss(LossKind.CAUCHY, 4.5)
    assert wide.reweight(poses)[1] > term.reweight(poses)[1]


def test_no_rows_cost_nothing(poses):
    term = ResidualTerm(np.zeros((0, 2), dtype=int), lambda at: np.zeros((len(at), 3)))
    quadratic, cost = term.reweight(poses)
    assert cost == 0.0
    assert not quadratic.normal_blocks(poses).blocks.any()


ROWS = np.array([[0, 1], [1, 2]])


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"pose_idx": np.array([[0, -1]])}, "expected indices of poses, found one below 0"),
        ({"sigma": 0.0}, "expected sigmas above 0"),
        ({"sigma": 1.0, "information": np.eye(3)}, "expected sigma or information, found both"),
    ],
)
def test_what_cannot_work_is_refused(fields, message):
    with pytest.raises(OptionError, match=f"term 'mine': {message}"):
        ResidualTerm(**{"pose_idx": ROWS, "residual": len, "name": "mine", **fields})


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"residual": lambda _: np.zeros((3, 3))}, r"residuals of shape \(2, d\).*found \(3, 3\)"),
        ({"residual": lambda _: np.zeros(2)}, r"residuals of shape \(2, d\).*found \(2,\)"),
        ({"sigma": np.ones(2)}, r"sigma of shape \(d\) or \(k, d\).*found \(2,\)"),
        ({"information": np.eye(2)}, r"information of shape \(d, d\).*found \(2, 2\)"),
        ({"jacobian": lambda _: np.zeros((2, 3, 6))}, r"Jacobian of shape \(2, d, 12\)"),
    ],
)
def test_wrong_shapes_are_named(fields, message, poses):
    fields = {"residual": lambda _: np.zeros((2, 3)), **fields}
    term = ResidualTerm(ROWS, name="mine", **fields)
    with pytest.raises(OptionError, match=f"term 'mine': expected a?.*{message}"):
        term.reweight(poses)[0].normal_blocks(poses)


@pytest.mark.parametrize(
    ("information", "words"),
    [
        (np.full(3, 100.0), "shape"),
        (np.array([[1.0, 2.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), "symmetric"),
        (np.diag([1.0, -1.0, 1.0]), "negative eigenvalues"),
        (np.full((3, 3), np.nan), "finite"),
    ],
    ids=["a diagonal alone", "not symmetric", "indefinite", "not finite"],
)
def test_information_that_has_no_minimum_is_refused(information, words):
    with pytest.raises(OptionError, match=words):
        check_information("mine", information)

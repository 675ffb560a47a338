"""Derivatives by sensor, scales of odometry and plan, and thickness of walls, held against differences."""

from dataclasses import replace
from importlib import import_module
from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import nudged
from faulty_sensors import make_sensor_world, with_points
from planfit.adjust.calibration import PRIORS, SHARED
from planfit.adjust.calibration.blocks import HALF, ODOMETRY, PLAN, S, shared_blocks
from planfit.adjust.calibration.reduced import shared_step
from planfit.adjust.terms.between import OdometryTerm, PointTerm
from planfit.adjust.terms.levels import LevelTerm
from planfit.adjust.terms.wall_offsets import OffsetWallTerm, with_offsets
from planfit.adjust.terms.walls import WallTerm
from planfit.geometry import se3
from planfit.geometry.calibration import NOMINAL
from planfit.lsq.robust import loss_value
from planfit.matching import SurfacePairs
from planfit.priors import Prior

STEP = 1e-6
NOTHING = np.zeros(S)


@pytest.fixture
def world(rng):
    some_lines = np.array([0.1, 0.0, 0.12, 0.0])
    return make_sensor_world(rng, n=6, noise_m=0.0, n_rays=60, before_line=some_lines)


def sensor_at(shared):
    return NOMINAL.with_vector(NOMINAL.vector + shared[:7])


def stretch(z, shared, base):
    """Of rays, by which sigmas across them grow."""
    return sensor_at(shared).depths(z) / sensor_at(base).depths(z)


def stretch_along(z, shared, base):
    """Of depth, by which sigmas along rays grow: the derivative of what is corrected by what was measured."""
    return (1 + shared[0] + 2 * shared[2] * z) / (1 + base[0] + 2 * base[2] * z)


def projectors(rays):
    """Onto rays (m, 3): (m, 3, 3)."""
    units = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return units[:, :, None] * units[:, None]


def residuals_of(term, poses, shared, base=NOTHING):
    """Residuals in sigmas (m, d) of a term and the weight of each row (m,), written out.

    Its points are as measured, its sigmas those of points that `base` corrects.
    """
    sensor = sensor_at(shared)
    if isinstance(term, OdometryTerm):
        grown = 1 + shared[ODOMETRY]
        steps = term.odometry.cam_from_next
        rows = []
        for k, step in enumerate(steps):
            found = se3.inverse(poses[k]) @ poses[k + 1]
            turn = se3.log_so3((step[:3, :3].T @ found[:3, :3])[None])[0]
            moved = step[:3, :3].T @ (found[:3, 3] - grown * step[:3, 3]) / grown
            rows.append(
                [
                    *(turn / term.odometry.sigma_rotation[k]),
                    *(moved / term.odometry.sigma_translation[k]),
                ]
            )
        return np.array(rows), np.full(len(steps), term.model.weight), term.model.loss
    groups = term.groups
    counts = np.diff(groups.start)
    weights = np.repeat(groups.weight_per_point, counts)
    if isinstance(term, PointTerm):
        a, b = groups.points_a.astype(float), groups.points_b.astype(float)
        first, second = (np.repeat(poses[groups.pairs[:, k]], counts, axis=0) for k in (0, 1))
        there = se3.inverse(first) @ second
        gaps = sensor.points(a) - se3.transform_each(there, sensor.points(b))
        z = (a[:, 2] + b[:, 2]) / 2
        rays = 0.5 * projectors(a)
        rays += 0.5 * projectors(np.einsum("mij,mj->mi", there[:, :3, :3], b))
        along = np.einsum("mij,mj->mi", rays, gaps)
        across = gaps - along
        gaps = across / stretch(z, shared, base)[:, None]
        gaps += along / stretch_along(z, shared, base)[:, None]
        gaps[:, :2] *= np.exp(shared[3])
        return gaps / groups.sigma_m[:, None], weights, groups.loss
    points = groups.points_cam.astype(float)
    of_point = np.repeat(poses[groups.pose_idx], counts, axis=0)
    planes = np.repeat(groups.planes, counts, axis=0)
    at = np.sum(planes[:, :3] * se3.transform_each(of_point, sensor.points(points)), axis=1)
    if isinstance(term, WallTerm):
        grown = 1 + shared[PLAN]
        before = term.floorplan.before_line[term.association.face_idx]
        forward = shared[HALF] * np.repeat(before > 0, counts)
        gaps = (at + grown * planes[:, 3] - forward) / grown
    else:
        level = np.einsum("mji,mj->mi", of_point[:, :3, :3], planes[:, :3])
        gaps = (at + planes[:, 3]) / stretch_along(points[:, 2], shared, base)
        gaps *= np.exp(shared[3] * (level[:, 0] ** 2 + level[:, 1] ** 2))
    return gaps[:, None] / groups.sigma_m, weights, groups.loss


ROLES = {PointTerm: "geometric", LevelTerm: "floor", WallTerm: "walls", OdometryTerm: "odometry"}


def with_only(problem, kind):
    """The problem with one of its terms; with none where `kind` is none of them."""
    return replace(problem, **{role: None for other, role in ROLES.items() if other != kind})


def of_kind(problem, kind):
    return next(term for term in problem.terms if isinstance(term, kind))


def cost_of(problem, poses, shared, base=NOTHING):
    total = 0.0
    for term in problem.terms:
        if not isinstance(term, tuple(ROLES)):
            continue
        rows, weights, loss = residuals_of(term, poses, shared, base)
        total += 0.5 * weights @ loss_value(np.sum(rows**2, axis=1), loss)[0]
    return total


def dense_rows(term, poses, base=NOTHING):
    """Residuals and Jacobian (rows, 6 n + S) of a term by central differences, weights frozen."""
    rows, weights, loss = residuals_of(term, poses, base, base)
    root = np.sqrt(weights * loss_value(np.sum(rows**2, axis=1), loss)[1])[:, None]
    columns = []
    for k in range(6 * len(poses) + S):
        ends = []
        for way in (STEP, -STEP):
            delta, shared = np.zeros(6 * len(poses)), base.copy()
            if k < len(delta):
                delta[k] = way
            else:
                shared[k - len(delta)] += way
            moved = se3.retract(poses, delta.reshape(-1, 6))
            ends.append((root * residuals_of(term, moved, shared, base)[0]).ravel())
        columns.append((ends[0] - ends[1]) / (2 * STEP))
    return (root * rows).ravel(), np.stack(columns, axis=1)


def dense(problem, poses, base=NOTHING):
    """J^T J and J^T r over poses and shared parameters; points of the problem as they were measured."""
    known = [t for t in problem.terms if isinstance(t, tuple(ROLES))]
    n = 6 * len(poses) + S
    normal, gradient = np.zeros((n, n)), np.zeros(n)
    for term in known:
        rows, jacobian = dense_rows(term, poses, base)
        normal += jacobian.T @ jacobian
        gradient += jacobian.T @ rows
    return normal, gradient


@pytest.mark.parametrize("kind", [PointTerm, LevelTerm, WallTerm, OdometryTerm])
def test_blocks_of_each_term_are_those_of_differences_where_residuals_vanish(world, kind):
    problem = world.problem()
    term = of_kind(problem, kind)
    _, jacobian = dense_rows(term, world.plan_from_cams)
    n = 6 * len(world.plan_from_cams)
    normal = jacobian.T @ jacobian
    found = shared_blocks(with_only(problem, kind), world.plan_from_cams)
    size = np.abs(normal[n:, n:]).max()
    assert size > 0
    assert_allclose(found.by_self, normal[n:, n:], atol=1e-6 * size)
    assert_allclose(
        found.by_pose.reshape(n, S), normal[:n, n:], atol=1e-6 * np.abs(normal[:n, n:]).max()
    )


def test_blocks_of_faces_with_offsets_are_those_of_differences_where_residuals_vanish(world):
    problem, poses = world.problem(), world.plan_from_cams
    walls = of_kind(problem, WallTerm)
    n = len(poses)
    term = OffsetWallTerm(walls.patches, walls.floorplan, walls.association, walls.model, n)
    unknowns = with_offsets(poses, walls.floorplan)

    def residuals(unknowns, shared):
        rows, weights, loss = residuals_of(term.displaced(unknowns), unknowns[:n], shared)
        root = np.sqrt(weights * loss_value(np.sum(rows**2, axis=1), loss)[1])
        return (root[:, None] * rows).ravel()

    columns = []
    for k in range(6 * len(unknowns) + S):
        ends = []
        for way in (STEP, -STEP):
            delta = np.zeros(6 * len(unknowns) + S)
            delta[k] = way
            moved = se3.retract(unknowns, delta[:-S].reshape(-1, 6))
            ends.append(residuals(moved, delta[-S:]))
        columns.append((ends[0] - ends[1]) / (2 * STEP))
    jacobian = np.stack(columns, axis=1)
    normal = jacobian.T @ jacobian
    alone = replace(with_only(problem, None), offset_walls=term, unknowns=unknowns)
    found = shared_blocks(alone, unknowns)
    assert_allclose(found.by_self, normal[-S:, -S:], atol=1e-6 * np.abs(normal[-S:, -S:]).max())
    across = normal[:-S, -S:]
    assert np.abs(across[6 * n :]).max() > 0
    assert_allclose(found.by_pose.reshape(-1, S), across, atol=1e-6 * np.abs(across).max())


def test_the_gradient_is_that_of_the_robust_cost_with_sigmas_that_grow_with_the_points(world, rng):
    problem = world.problem()
    poses = nudged(rng, world.plan_from_cams, 0.4, 0.02)
    found = shared_blocks(problem, poses).gradient
    for k in range(S):
        ends = []
        for way in (STEP, -STEP):
            shared = np.zeros(S)
            shared[k] = way
            ends.append(cost_of(problem, poses, shared))
        expected = (ends[0] - ends[1]) / (2 * STEP)
        assert abs(expected) > 1e-3  # the case tells something of every parameter
        assert_allclose(found[k], expected, rtol=1e-5, atol=1e-5)


def test_the_gradient_is_that_of_the_cost_where_depth_is_corrected_by_much(world, rng):
    """Of 0.04 z^2 the derivative by z^2, the corrected depth's, would be off by 14 to 60 %."""
    base = np.array([0.05, -0.03, -0.04, *[0.0] * (S - 3)])
    as_measured = world.measured_by(sensor_at(base)).measurements
    corrected = world.problem(with_points(as_measured, sensor_at(base).points))
    measured = world.problem(as_measured)
    poses = nudged(rng, world.plan_from_cams, 0.4, 0.02)
    found = shared_blocks(corrected, poses, sensor_at(base)).gradient
    for k in range(3):
        way = STEP * np.eye(S)[k]
        ends = [cost_of(measured, poses, base + side * way, base) for side in (1, -1)]
        expected = (ends[0] - ends[1]) / (2 * STEP)
        assert abs(expected) > 1e-3
        assert_allclose(found[k], expected, rtol=1e-5, atol=1e-5)


def test_terms_that_know_nothing_of_shared_parameters_add_nothing(world):
    held_alone = with_only(world.problem(walls=False), None)
    assert [term.name for term in held_alone.terms] == [held_alone.gauge.name]
    found = shared_blocks(held_alone, world.plan_from_cams)
    assert not found.by_self.any()
    assert not found.by_pose.any()
    assert not found.gradient.any()


@pytest.mark.parametrize("held", [(), (4, 7, 8)])
def test_the_reduced_step_is_a_dense_one_over_poses_and_parameters(world, rng, held):
    # Pose blocks of matches leave out what vanishes with the residuals.
    poses = nudged(rng, world.plan_from_cams, 1e-4, 1e-5)
    sigmas = np.array([0.03, 0.02, 0.004, 0.03, 0.02, 0.008, 0.008, 0.003, 0.006, 0.02])
    sigmas[list(held)] = 0.0
    departures = np.where(sigmas > 0, 0.3 * sigmas, 0.0)
    departures[3:7] = 0.0  # blocks are exact where the lens is nominal
    of_depth = np.where(np.arange(S) < 3, departures, 0.0)
    as_measured = world.measured_by(sensor_at(of_depth)).measurements
    problem = world.problem(with_points(as_measured, sensor_at(of_depth).points))
    n = 6 * len(poses)
    normal, gradient = dense(world.problem(as_measured), poses, of_depth)
    free = np.concatenate([np.arange(n), n + np.flatnonzero(sigmas > 0)])
    of_free = np.flatnonzero(sigmas > 0)
    normal[n + of_free, n + of_free] += 1 / sigmas[of_free] ** 2
    gradient[n + of_free] += departures[of_free] / sigmas[of_free] ** 2
    solved = np.zeros(n + S)
    inverse = np.linalg.inv(normal[np.ix_(free, free)])
    solved[free] = -inverse @ gradient[free]
    reduced = import_module("planfit.adjust.calibration.reduced")
    with patch.object(reduced, "WALL_AS_BUILT_SIGMA_M", Prior(1e-7, "Walls exactly as drawn.")):
        step = shared_step(problem, poses, departures, sigmas)
    assert np.abs(solved[n + of_free]).max() > 1e-3
    assert_allclose(step.change[of_free], solved[n + of_free], rtol=1e-3, atol=2e-6)
    assert_allclose(
        step.covariance[np.ix_(of_free, of_free)],
        inverse[n:, n:],
        rtol=1e-3,
        atol=1e-4 * inverse[n:, n:].max(),
    )
    # Poses and parameters vary together by how poses follow.
    together = inverse[:n, n:]
    follow = step.pose_by_shared.reshape(n, -1)[:, of_free]
    assert_allclose(follow @ inverse[n:, n:], together, atol=5e-3 * np.abs(together).max())
    assert not step.pose_by_shared[:, :, list(held)].any()
    assert not step.change[list(held)].any()


@pytest.mark.parametrize("z", [0.0, -1.0])
def test_points_that_no_depth_image_can_have_say_nothing_of_the_sensor(world, z):
    def with_one(points, at):
        spoilt = points.copy()
        spoilt[0] = [0.3, 0.2, at]
        return spoilt

    measured, poses = world.measurements, world.plan_from_cams
    points = measured.matches.points_a
    spoilt = replace(measured, matches=replace(measured.matches, points_a=with_one(points, z)))
    found = shared_blocks(world.problem(spoilt), poses)
    assert np.isfinite(found.by_self).all()
    assert np.isfinite(found.by_pose).all()
    far = replace(measured, matches=replace(measured.matches, points_a=with_one(points, -7.0)))
    elsewhere = shared_blocks(world.problem(far), poses)
    assert_allclose(found.by_self, elsewhere.by_self, rtol=1e-9)


def surface_world(world, rng):
    """The world with nothing but motions by surfaces, which follow the sensor in any way."""
    poses = world.plan_from_cams
    pairs = np.array([[0, 1], [1, 2], [0, 3], [3, 5]])
    rows = rng.normal(size=(len(pairs), 5, 6))
    surfaces = SurfacePairs(
        pairs,
        se3.inverse(poses[pairs[:, 0]]) @ poses[pairs[:, 1]],
        100 * np.swapaxes(rows, 1, 2) @ rows,
        np.ones(len(pairs)),
        0.3 * rng.normal(size=(len(pairs), 6, 7)),
        rng.uniform(1.0, 4.0, len(pairs)),
    )
    problem = world.problem(replace(world.measurements, surfaces=surfaces))
    kept = {role: None for role in ROLES.values()}
    return surfaces, replace(problem, **kept)


def test_blocks_of_motions_by_surfaces_are_those_of_differences(world, rng):
    """Weights frozen where nothing departs: then the Gauss-Newton block is the Hessian of the cost."""
    surfaces, problem = surface_world(world, rng)
    poses = world.plan_from_cams
    n = 6 * len(poses)
    term = problem.surfaces

    def cost(delta):
        sensor = NOMINAL.with_vector(NOMINAL.vector + delta[n:])
        seen = replace(term, measured=surfaces.corrected(sensor))
        return seen.reweight(se3.retract(poses, delta[:n].reshape(-1, 6)))[1]

    found = shared_blocks(problem, poses)
    step, axes = 1e-4, np.eye(n + 7)
    expected = np.zeros((n + 7, 7))
    for j in range(7):
        for i in range(n + 7):
            expected[i, j] = sum(
                a * b * cost(step * (a * axes[i] + b * axes[n + j]))
                for a in (1, -1)
                for b in (1, -1)
            ) / (4 * step**2)
    size = np.abs(expected).max()
    assert size > 0
    assert_allclose(found.by_pose.reshape(n, S)[:, :7], expected[:n], atol=2e-3 * size)
    assert_allclose(found.by_self[:7, :7], expected[n:], atol=2e-3 * size)
    assert not found.by_self[7:].any()


def test_the_gradient_of_motions_by_surfaces_is_that_of_their_robust_cost(world, rng):
    surfaces, problem = surface_world(world, rng)
    poses = nudged(rng, world.plan_from_cams, 0.2, 0.004)
    found = shared_blocks(problem, poses).gradient
    for k in range(7):
        ends = []
        for way in (STEP, -STEP):
            off = way * np.eye(7)[k]
            seen = surfaces.corrected(NOMINAL.with_vector(NOMINAL.vector + off))
            ends.append(replace(problem.surfaces, measured=seen).reweight(poses)[1])
        expected = (ends[0] - ends[1]) / (2 * STEP)
        # A turn of the measured motion turns the axes of its departure: of second order.
        assert found[k] == pytest.approx(expected, rel=0.02, abs=0.02 * np.abs(found).max())


@pytest.mark.parametrize(
    "name", ["depth_scale", "depth_offset_m", "depth_quadratic_per_m", "focal_scale"]
)
def test_depth_that_is_noisy_along_its_rays_does_not_look_wrong(name):
    """Noise of 0.01 z^2: shrinking what is far would make it smaller, at 9 sigmas if that were let pay."""
    k = SHARED.index(name)
    sigmas = np.where(np.arange(S) == k, PRIORS.sigmas, 0.0)
    in_sigmas = []
    for seed in range(6):
        rng = np.random.default_rng([11, seed])
        world = make_sensor_world(rng, noise_m=0.0)

        def noisy(points, rng=rng):
            return points * (1 + 0.01 * points[..., 2:] * rng.normal(size=(*points.shape[:-1], 1)))

        problem = world.problem(with_points(world.measurements, noisy))
        step = shared_step(problem, problem.solve().target_from_cams, np.zeros(S), sigmas)
        in_sigmas.append(step.change[k] / np.sqrt(step.covariance[k, k]))
    assert abs(np.mean(in_sigmas)) < 2.0


def test_blocks_of_points_in_parts_are_those_of_all_at_once(world, rng, monkeypatch):
    problem, poses = world.problem(), nudged(rng, world.plan_from_cams, 0.4, 0.02)
    at_once = shared_blocks(problem, poses)
    monkeypatch.setattr("planfit.geometry.se3.POINTS_AT_A_TIME", 7)
    in_parts = shared_blocks(problem, poses)
    for name in ("by_pose", "by_self", "gradient"):
        expected = getattr(at_once, name)
        scale = np.abs(expected).max()
        assert_allclose(getattr(in_parts, name), expected, rtol=1e-9, atol=1e-10 * scale)

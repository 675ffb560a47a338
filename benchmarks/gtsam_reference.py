"""The same adjustment solved by GTSAM, to compare time, cost and poses: by its optimiser, and directly.

What is compared: squared losses; 3D point error, floor, walls with a given association, odometry;
the same information on every point. GTSAM gets

- one `BetweenFactorPose3` (C++) for each step of the odometry. Its error is the logarithm of SE(3), ours
  that of SO(3) x R^3: they differ in second order, by less than 1e-3 of that term here;
- one `CustomFactor` for each pair of frames (3 residuals a match) and each frame and plane (1 residual
  a point), with analytic Jacobians, each evaluated by a handful of numpy calls on all its points.

Why not native factors: the Python wheel (4.3.0) has none for this. There is no pose-to-point nor
point-to-plane factor; `KnownLandmarkFactorPose3` weighs errors along the camera's axes, not the plane's;
`OrientedPlane3Factor` compares a plane with a plane, `ReferenceFrameFactor` needs a landmark on each
side of a match. A factor for each point would call Python a million times a step, which would be unfair
to GTSAM; for a pair at a time, the calls do not dominate. The time that remains when all time inside
our Python functions is taken off is reported too: no native factor can be faster than a factor whose
residuals and Jacobians cost nothing. It is a lower bound for GTSAM with residuals point by point.

Three ways:

- `optimise`: GTSAM's own Levenberg-Marquardt. Its loop asks for the error of every candidate, which is a
  second evaluation of all residuals, and damps;
- `iterate`: the same factors linearised, eliminated and retracted without that loop (Gauss-Newton). The
  error of the linearised graph is that of the residuals, so nothing is evaluated twice;
- `iterate_moments`: the blocks that planfit's moments give, handed to GTSAM's elimination. That is planfit's
  method with another linear solver; it tells what each of the two parts is worth.

Not compared: robust losses (GTSAM's are per factor, so would be per pair here).
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X
from problems import Problem

from planfit.adjust.terms import observation_models
from planfit.adjust.terms.between import OdometryTerm, PointTerm
from planfit.adjust.terms.levels import FLOOR_PLANE, floor_term
from planfit.adjust.terms.walls import WallTerm, face_planes
from planfit.geometry import se3
from planfit.lsq.blocks import NormalBlocks, sum_by_pose
from planfit.lsq.robust import Loss, LossKind
from planfit.lsq.term import Term

SQUARED = Loss(LossKind.SQUARED)
POINTS, FLOOR, WALLS = (
    replace(observation_models.POINTS, loss=SQUARED),
    replace(observation_models.FLOOR, loss=SQUARED),
    replace(observation_models.WALLS, loss=SQUARED),
)


@dataclass
class Stopwatch:
    """CPU time spent inside our Python functions."""

    cpu_s: float = 0.0


@dataclass(frozen=True)
class Reference:
    """What GTSAM found."""

    plan_from_cams: np.ndarray  # (n, 4, 4)
    iterations: int
    cpu_s: float
    python_cpu_s: float
    """Part of that in Python: inside our residual functions, or making blocks of moments."""


def squared_terms(problem: Problem) -> list[Term]:
    """planfit's terms of the same cost."""
    measurements = problem.measurements
    return [
        PointTerm(measurements.matches, POINTS),
        floor_term(measurements.structure, FLOOR),
        WallTerm(measurements.structure.walls, problem.floorplan, problem.association, WALLS),
        OdometryTerm(measurements.odometry, replace(observation_models.ODOMETRY, loss=SQUARED)),
    ]


def make_graph(problem: Problem, watch: Stopwatch) -> gtsam.NonlinearFactorGraph:
    """The factors; not counted in any time."""
    graph = gtsam.NonlinearFactorGraph()
    matches, structure = problem.measurements.matches, problem.measurements.structure
    information = POINTS.weight_per_point(np.diff(matches.start))
    for k, (i, j) in enumerate(matches.pairs):
        part = slice(matches.start[k], matches.start[k + 1])
        root = np.sqrt(information[k]) / matches.sigma[part].astype(float)
        points = matches.points_a[part].astype(float), matches.points_b[part].astype(float)
        graph.push_back(_pair_factor(int(i), int(j), *points, root, watch))
    n = len(structure.floor.start) - 1
    groups = [
        (structure.floor.points_cam, structure.floor.start, np.arange(n),
         np.tile(FLOOR_PLANE, (n, 1)), FLOOR),
        (structure.walls.points_cam, structure.walls.start, structure.walls.frame_idx,
         face_planes(problem.floorplan, problem.association.face_idx), WALLS),
    ]  # fmt: skip
    for points, start, frames, planes, model in groups:
        root = np.sqrt(model.weight_per_point(np.diff(start))) / model.sigma
        for k, frame in enumerate(frames):
            part = points[start[k] : start[k + 1]].astype(float)
            graph.push_back(_plane_factor(int(frame), part, planes[k], root[k], watch))
    odometry = problem.measurements.odometry
    for k, step in enumerate(odometry.cam_from_next):
        sigmas = np.repeat([odometry.sigma_rotation[k], odometry.sigma_translation[k]], 3)
        noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
        graph.push_back(gtsam.BetweenFactorPose3(X(k), X(k + 1), gtsam.Pose3(step), noise))
    return graph


def optimise(
    problem: Problem, graph: gtsam.NonlinearFactorGraph, watch: Stopwatch, relative_tolerance: float
) -> Reference:
    """GTSAM's Levenberg-Marquardt with its defaults but for the tolerance."""
    initial = _values(problem)
    params = gtsam.LevenbergMarquardtParams()
    params.setRelativeErrorTol(relative_tolerance)
    params.setAbsoluteErrorTol(0.0)
    watch.cpu_s = 0.0
    cpu = time.process_time()
    optimiser = gtsam.LevenbergMarquardtOptimizer(graph, initial, params)
    result = optimiser.optimize()
    cpu_s = time.process_time() - cpu
    return Reference(_poses(result, problem), optimiser.iterations(), cpu_s, watch.cpu_s)


def iterate(
    problem: Problem, graph: gtsam.NonlinearFactorGraph, watch: Stopwatch, relative_tolerance: float
) -> Reference:
    """Linearise, eliminate, retract, until a step is predicted to gain less than the tolerance."""
    values = _values(problem)
    zero = values.zeroVectors()
    watch.cpu_s, iterations, is_done = 0.0, 0, False
    cpu = time.process_time()
    ordering = gtsam.Ordering.ColamdNonlinearFactorGraph(graph)
    while not is_done:
        linear = graph.linearize(values)
        delta = linear.optimize(ordering)
        before = linear.error(zero)
        is_done = before - linear.error(delta) < relative_tolerance * before
        values = values.retract(delta)
        iterations += 1
    cpu_s = time.process_time() - cpu
    return Reference(_poses(values, problem), iterations, cpu_s, watch.cpu_s)


def iterate_moments(problem: Problem, relative_tolerance: float) -> Reference:
    """planfit's moments and blocks, GTSAM's elimination; `python_cpu_s` is all but the elimination."""
    poses, iterations, is_done, ordering = problem.initial_plan_from_cams, 0, False, None
    eliminate_s, cpu = 0.0, time.process_time()
    # Squared losses: the moments of the first pass are those of every step.
    quadratics, costs = zip(*(t.reweight(poses) for t in squared_terms(problem)), strict=True)
    total = sum(costs)
    while not is_done:
        linear, gradient = _gaussian_graph([q.normal_blocks(poses) for q in quadratics])
        begin = time.process_time()
        ordering = ordering or gtsam.Ordering.ColamdGaussianFactorGraph(linear)
        solution = linear.optimize(ordering)
        delta = np.stack([solution.at(X(k)) for k in range(len(poses))])
        eliminate_s += time.process_time() - begin
        # At the minimum of a quadratic half the slope times the step is what the step gains.
        is_done = -0.5 * float(np.sum(gradient * delta)) < relative_tolerance * total
        poses = se3.retract(poses, delta)
        total = sum(q.cost(poses) for q in quadratics)
        iterations += 1
    cpu_s = time.process_time() - cpu
    return Reference(poses, iterations, cpu_s, cpu_s - eliminate_s)


def _gaussian_graph(parts: list[NormalBlocks]) -> tuple[gtsam.GaussianFactorGraph, np.ndarray]:
    """One Hessian factor a pose and one a pair of poses; also the gradient (n, 6)."""
    n = len(parts[0].gradient)
    gradient = np.sum([p.gradient for p in parts], axis=0)
    keys = np.concatenate([p.rows * n + p.columns for p in parts])
    at, group = np.unique(keys, return_inverse=True)
    blocks = sum_by_pose(group, np.concatenate([p.blocks for p in parts]), len(at))
    graph, nothing, still = gtsam.GaussianFactorGraph(), np.zeros((6, 6)), np.zeros(6)
    for (i, j), block in zip(np.stack(np.divmod(at, n), axis=1).tolist(), blocks, strict=True):
        if i == j:
            graph.push_back(gtsam.HessianFactor(X(i), block, -gradient[i], 0.0))
        else:
            pair = X(i), X(j), nothing, block, still, nothing, still, 0.0
            graph.push_back(gtsam.HessianFactor(*pair))
    return graph, gradient


def _values(problem: Problem) -> gtsam.Values:
    """Where a solve begins."""
    values = gtsam.Values()
    for k, pose in enumerate(problem.initial_plan_from_cams):
        values.insert(X(k), gtsam.Pose3(pose))
    return values


def _poses(values: gtsam.Values, problem: Problem) -> np.ndarray:
    n = len(problem.initial_plan_from_cams)
    return np.stack([values.atPose3(X(k)).matrix() for k in range(n)])


def cost(terms: Sequence[Term], plan_from_cams: np.ndarray) -> float:
    """The common yardstick: planfit's cost of all terms."""
    return sum(term.reweight(plan_from_cams)[1] for term in terms)


def _pair_factor(
    i: int, j: int, points_a: np.ndarray, points_b: np.ndarray, root: np.ndarray, watch: Stopwatch
) -> gtsam.CustomFactor:
    """Residuals p - T_i^-1 T_j q, axes of camera i; right tangents (rotation, translation), as GTSAM's."""
    n = len(points_a)
    by_rotation_b = -se3.skew(points_b) * root[:, None, None]
    first, second = np.zeros((n, 3, 6)), np.zeros((n, 3, 6))
    first[:, :, 3:] = np.eye(3) * root[:, None, None]

    def error(this, values, jacobians):  # noqa: ARG001
        begin = time.thread_time()
        a_from_b = values.atPose3(X(i)).between(values.atPose3(X(j))).matrix()
        rotation = a_from_b[:3, :3]
        moved = points_b @ rotation.T + a_from_b[:3, 3]
        if jacobians is not None:
            x, y, z = (moved * root[:, None]).T
            first[:, 0, 1], first[:, 0, 2], first[:, 1, 2] = z, -y, x
            first[:, 1, 0], first[:, 2, 0], first[:, 2, 1] = -z, y, -x
            second[:, :, :3] = -rotation @ by_rotation_b
            second[:, :, 3:] = -rotation * root[:, None, None]
            jacobians[0] = first.reshape(-1, 6)
            jacobians[1] = second.reshape(-1, 6)
        residual = ((points_a - moved) * root[:, None]).ravel()
        watch.cpu_s += time.thread_time() - begin
        return residual

    noise = gtsam.noiseModel.Unit.Create(3 * n)
    return gtsam.CustomFactor(noise, [X(i), X(j)], error)


def _plane_factor(
    i: int, points: np.ndarray, plane: np.ndarray, root: float, watch: Stopwatch
) -> gtsam.CustomFactor:
    """Residuals: distances of points to a plane of the plan, in sigmas."""

    def error(this, values, jacobians):  # noqa: ARG001
        begin = time.thread_time()
        plane_cam = values.atPose3(X(i)).matrix().T @ plane * root
        normal = plane_cam[:3]
        if jacobians is not None:
            jacobian = np.zeros((len(points), 6), order="F")
            jacobian[:, :3] = points @ se3.skew(normal).T * -1.0
            jacobian[:, 3:] = normal
            jacobians[0] = jacobian
        residual = points @ normal + plane_cam[3]
        watch.cpu_s += time.thread_time() - begin
        return residual

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(len(points)), [X(i)], error)

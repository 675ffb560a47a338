"""The same adjustment solved by g2o (`g2opy`), whose edges for it are all compiled.

`EdgeVVGicp` holds a point of one pose to a point of another with any information matrix: a match with the
identity's, and a point on a plane with that of its normal, the plan being a pose that is fixed. `EdgeSE3`
is the odometry. g2o's rotation is half a rotation vector, so its information is four times that of the
vector.

Two ways: an edge a point, as g2o is used (a million edges); and an edge a *virtual* point
(`virtual_points`), seven a pair of frames and four a frame and plane, which stand for any number of
points, exactly.

Edges are made one by one from Python and not counted; g2o then runs without a call to Python.
Gauss-Newton, as many iterations as lower the error by more than the tolerance, and one that does not.
"""

import time
from dataclasses import dataclass

import g2opy as g2o
import numpy as np
from gtsam_reference import FLOOR, POINTS, WALLS, Reference, squared_terms
from problems import Problem
from virtual_points import virtual_matches, virtual_points

from planfit.adjust.terms.levels import FLOOR_PLANE
from planfit.adjust.terms.walls import face_planes
from planfit.lsq.moments import PairMoments, PlaneMoments

MAX_ITERATIONS = 10


@dataclass(frozen=True)
class Edges:
    """Points of one pose that belong to points of another, or on planes of the plan."""

    first: np.ndarray  # (m,) pose, or the number of poses: the plan
    second: np.ndarray  # (m,) pose
    at_first: np.ndarray  # (m, 3) m
    at_second: np.ndarray  # (m, 3) m
    information: np.ndarray  # (m, 3, 3) 1/m^2


@dataclass(frozen=True)
class Groups:
    """Points in groups, each of which belongs on a plane of the plan."""

    points_cam: np.ndarray
    start: np.ndarray
    frame_idx: np.ndarray
    planes: np.ndarray
    weight: np.ndarray  # (k,) of each point of a group, 1/m^2


class Optimiser:
    """A g2o problem that can be solved again from the beginning."""

    def __init__(self, problem: Problem, edges: list[Edges]) -> None:
        self._poses = problem.initial_plan_from_cams
        self._optimiser = g2o.SparseOptimizer()
        solver = g2o.BlockSolverSE3(g2o.LinearSolverEigenSE3())
        self._optimiser.set_algorithm(g2o.OptimizationAlgorithmGaussNewton(solver))
        self._vertices = [self._vertex(k) for k in range(len(self._poses) + 1)]
        self._vertices[-1].set_fixed(True)
        self._vertices[-1].set_estimate(g2o.Isometry3d(np.eye(4)))
        for part in edges:
            for row in zip(part.first.tolist(), part.second.tolist(), part.at_first, part.at_second,
                           part.information, strict=True):  # fmt: skip
                self._add_point(*row)
        odometry = problem.measurements.odometry
        for k, step in enumerate(odometry.cam_from_next):
            sigmas = [odometry.sigma_translation[k]] * 3 + [odometry.sigma_rotation[k] / 2] * 3
            edge = g2o.EdgeSE3()
            edge.set_vertex(0, self._vertices[k])
            edge.set_vertex(1, self._vertices[k + 1])
            edge.set_measurement(g2o.Isometry3d(step))
            edge.set_information(np.diag(1.0 / np.square(sigmas)))
            self._optimiser.add_edge(edge)
        self._optimiser.initialize_optimization()

    def needed(self, relative_tolerance: float) -> int:
        """Iterations until one lowers the error by less than the tolerance."""
        self._begin()
        self._optimiser.compute_active_errors()
        previous = self._optimiser.chi2()
        for k in range(1, MAX_ITERATIONS + 1):
            self._optimiser.optimize(1)
            self._optimiser.compute_active_errors()
            last = self._optimiser.chi2()
            if previous - last < relative_tolerance * previous:
                return k
            previous = last
        raise RuntimeError(f"g2o: {MAX_ITERATIONS} iterations did not converge")

    def run(self, iterations: int) -> Reference:
        """So many iterations from the beginning."""
        self._begin()
        cpu = time.process_time()
        self._optimiser.optimize(iterations)
        cpu_s = time.process_time() - cpu
        poses = np.stack([v.estimate().matrix() for v in self._vertices[:-1]])
        return Reference(poses, iterations, cpu_s, 0.0)

    def _begin(self) -> None:
        for vertex, pose in zip(self._vertices, self._poses, strict=False):
            vertex.set_estimate(g2o.Isometry3d(pose))

    def _vertex(self, number: int) -> g2o.VertexSE3:
        vertex = g2o.VertexSE3()
        vertex.set_id(number)
        self._optimiser.add_vertex(vertex)
        return vertex

    def _add_point(
        self, i: int, j: int, at_i: np.ndarray, at_j: np.ndarray, information: np.ndarray
    ) -> None:
        points = g2o.EdgeGICP()
        points.pos0, points.pos1 = at_i, at_j
        edge = g2o.EdgeVVGicp()
        edge.set_vertex(0, self._vertices[i])
        edge.set_vertex(1, self._vertices[j])
        edge.set_measurement(points)
        edge.set_information(information)
        self._optimiser.add_edge(edge)


def edges_by_point(problem: Problem) -> list[Edges]:
    """An edge a match and an edge a point on a plane."""
    matches, structure = problem.measurements.matches, problem.measurements.structure
    counts = np.diff(matches.start)
    weight = np.repeat(POINTS.weight_per_point(counts), counts)
    pairs = np.repeat(matches.pairs, counts, axis=0)
    information = (weight / matches.sigma.astype(float) ** 2)[:, None, None] * np.eye(3)
    points = matches.points_a.astype(float), matches.points_b.astype(float)
    made = [Edges(pairs[:, 0], pairs[:, 1], *points, information)]
    n = len(structure.floor.start) - 1
    faces = face_planes(problem.floorplan, problem.association.face_idx)
    for points_cam, start, frames, planes, model in (
        (structure.floor.points_cam, structure.floor.start, np.arange(n),
         np.tile(FLOOR_PLANE, (n, 1)), FLOOR),
        (structure.walls.points_cam, structure.walls.start, structure.walls.frame_idx, faces, WALLS),
    ):  # fmt: skip
        per_point = model.weight_per_point(np.diff(start)) / model.sigma**2
        made.append(_on_planes(Groups(points_cam, start, frames, planes, per_point), len(
            problem.initial_plan_from_cams)))  # fmt: skip
    return made


def edges_by_moments(problem: Problem) -> list[Edges]:
    """Seven edges a pair of frames, four a frame and plane; the pass over the points is planfit's."""
    poses, made = problem.initial_plan_from_cams, []
    for term in squared_terms(problem):
        moments, _ = term.reweight(poses)
        if isinstance(moments, PairMoments):
            a, b, weight = virtual_matches(moments)
            pairs = np.repeat(moments.pairs, 7, axis=0)
            information = np.repeat(weight, 7)[:, None, None] * np.eye(3)
            made.append(Edges(pairs[:, 0], pairs[:, 1], a, b, information))
        elif isinstance(moments, PlaneMoments):
            points, weight = virtual_points(moments.moments)
            start = 4 * np.arange(len(weight) + 1)
            groups = Groups(points, start, moments.pose_idx, moments.planes, weight)
            made.append(_on_planes(groups, len(poses)))
    return made


def _on_planes(groups: Groups, plan: int) -> Edges:
    counts = np.diff(groups.start)
    normals = groups.planes[:, :3]
    information = groups.weight[:, None, None] * normals[:, :, None] * normals[:, None]
    at_plan = -groups.planes[:, 3:] * normals  # the plane's point nearest to the origin
    return Edges(
        np.full(counts.sum(), plan),
        np.repeat(groups.frame_idx, counts),
        np.repeat(at_plan, counts, axis=0),
        groups.points_cam.astype(float),
        np.repeat(information, counts, axis=0),
    )

"""What a step and a pass over the points cost, apart from each other."""

import os
import time

import numpy as np
from problems import Problem, make_problem
from records import Record, machine, median_times, memory_gb_per_s

from planfit.adjust import AdjustOptions, build_problem
from planfit.adjust.terms.levels import FLOOR_PLANE
from planfit.adjust.terms.walls import WallTerm
from planfit.geometry import se3
from planfit.lsq.moments import pair_moments, plane_moments
from planfit.lsq.normal_equations import NormalEquations
from planfit.lsq.robust import Loss, LossKind
from planfit.lsq.term import Quadratic

N_POSES, N_POINTS = 1000, 5_000_000


def step_time_ratio() -> list[Record]:
    """A step with ten times the points: the same moments, so it should cost the same."""
    few = make_problem(N_POSES, matches_per_pair=20, points_per_frame=400)
    many = make_problem(N_POSES, matches_per_pair=200, points_per_frame=4000)
    cases = [(problem.initial_plan_from_cams, _frozen(problem)) for problem in (few, many)]
    for poses, quadratics in cases:
        _step(poses, quadratics)
    seconds = np.zeros((15, 2))
    for row in seconds:  # in turns, so that other load on the machine falls on both
        for k, (poses, quadratics) in enumerate(cases):
            begin = time.process_time()
            _step(poses, quadratics)
            row[k] = time.process_time() - begin
    one, ten = np.median(seconds, axis=0)
    n_few = 5 * N_POSES * 20 + N_POSES * 400
    conditions = (
        f"{N_POSES} frames, about 5 pairs a frame, {n_few / 1e6:.1f} and {n_few / 1e5:.0f} million "
        f"points; assembly, solve and cost of one step, weights frozen; {1e3 * one:.1f} and "
        f"{1e3 * ten:.1f} ms CPU, medians of 15 in turns; {machine()}"
    )
    return [Record("step_time_ratio_10x_points", float(ten / one), "1", conditions)]


def reweighting() -> list[Record]:
    """Points a second through one pass: residual, robust weight, cost and moments."""
    rng = np.random.default_rng(0)
    poses = np.tile(np.eye(4), (N_POSES, 1, 1))
    start = np.linspace(0, N_POINTS, N_POSES + 1).astype(int)
    points = rng.normal(size=(N_POINTS, 3)).astype(np.float32)
    other = points + 0.02 * rng.standard_normal(points.shape, dtype=np.float32)
    planes, ones = np.tile(FLOOR_PLANE, (N_POSES, 1)), np.ones(N_POSES)
    sigma = np.full(N_POINTS, 0.03, dtype=np.float32)
    pairs = np.stack([np.arange(N_POSES), np.roll(np.arange(N_POSES), 1)], axis=1)
    frames = np.arange(N_POSES)
    bandwidth, made = memory_gb_per_s(), []
    for name, loss in (
        ("reweight_points_per_s", Loss()),
        ("reweight_points_per_s, unsquared norm", Loss(LossKind.NORM, 1e-6)),
    ):
        passes = {
            "": lambda by=loss: plane_moments(points, start, frames, planes, ones, poses, 0.03, by),
            ", matches": lambda by=loss: pair_moments(
                points, other, sigma, start, pairs, ones, poses, by
            ),
        }
        for label, one_pass in passes.items():
            wall_s, cpu_s = median_times(one_pass, 15)
            size = 28 if label else 12
            rate = N_POINTS / wall_s
            own = N_POINTS * (os.cpu_count() or 1) / cpu_s / 1e6
            conditions = (
                f"{N_POINTS / 1e6:.0f} million {'matches' if label else 'points on planes'}, float32, "
                f"{N_POSES} poses, {loss.kind.name.lower()} loss, {os.cpu_count()} threads; wall, "
                f"median of 15 ({1e3 * wall_s:.1f} ms; CPU {1e3 * cpu_s:.1f} ms on all threads, "
                f"{own:.0f} million a second were the cores its own); reads "
                f"{rate * size / 1e9:.1f} GB/s of the {bandwidth:.1f} GB/s that one thread copies "
                f"(read and write); {machine()}"
            )
            made.append(Record(name + label, rate, "1/s", conditions))
    return made


def _frozen(problem: Problem) -> list[Quadratic]:
    options = AdjustOptions()
    measurements = problem.measurements
    walls = WallTerm(
        measurements.structure.walls, problem.floorplan, problem.association, options.model("walls")
    )
    terms = [
        *build_problem(measurements, options, problem.initial_plan_from_cams).scan_terms,
        walls,
    ]
    return [term.reweight(problem.initial_plan_from_cams)[0] for term in terms]


def _step(poses: np.ndarray, quadratics: list[Quadratic]) -> float:
    equations = NormalEquations([q.normal_blocks(poses) for q in quadratics], len(poses))
    moved = se3.retract(poses, equations.step(1e-4))
    return sum(q.cost(moved) for q in quadratics)

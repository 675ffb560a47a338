"""planfit against GTSAM on the same problem; what is compared is said in `gtsam_reference`."""

import numpy as np
from gtsam_reference import Stopwatch, cost, make_graph, solve_with_gtsam, squared_terms
from inputs import largest_difference
from problems import make_problem
from records import Record, machine, median_times

from planfit.lsq.solver import SolverOptions, solve

TOLERANCE = 1e-6
REPEATS = 3


def records(n_frames: int = 500) -> list[Record]:
    problem = make_problem(n_frames, frames_per_lap=n_frames // 2)
    terms, options = squared_terms(problem), SolverOptions(cost_tolerance=TOLERANCE)
    initial = problem.initial_plan_from_cams
    wall_s, cpu_s = median_times(lambda: solve(squared_terms(problem), initial, options), 7)
    ours = solve(terms, initial, options)
    watch = Stopwatch()
    graph = make_graph(problem, watch)
    runs = [solve_with_gtsam(problem, graph, watch, TOLERANCE) for _ in range(REPEATS)]
    theirs_s, theirs_cpu_s, python_s = np.median(
        [(run.seconds, run.cpu_s, run.python_cpu_s) for run in runs], axis=0
    )
    theirs = runs[0]
    costs = cost(terms, ours.target_from_cams), cost(terms, theirs.plan_from_cams)
    apart_m, apart_rad = largest_difference(ours.target_from_cams, theirs.plan_from_cams)
    measurements = problem.measurements
    n_points = len(measurements.structure.floor.points_cam) + len(
        measurements.structure.walls.points_cam
    )
    conditions = (
        f"{n_frames} frames, {len(measurements.matches.pairs)} pairs, "
        f"{measurements.matches.n_matches} matches, "
        f"{n_points} floor and wall points, squared losses, given association; both stop at a relative "
        f"decrease below {TOLERANCE:g}; CPU time of all threads (wall ratio "
        f"{theirs_s / wall_s:.1f}); planfit {wall_s:.3f} s wall, {cpu_s:.3f} s CPU (passes over the "
        f"points included), {ours.iterations} rounds; GTSAM 4.3.0 {theirs_s:.2f} s wall, "
        f"{theirs_cpu_s:.2f} s CPU, of it {python_s:.2f} s CPU in numpy residuals (graph made before), "
        f"{theirs.iterations} iterations; medians of 7 and {REPEATS}; cost {costs[0]:.6g} and "
        f"{costs[1]:.6g}, poses within {apart_m:.1e} m and {apart_rad:.1e} rad; {machine()}"
    )
    return [
        Record("gtsam_over_lm_time", theirs_cpu_s / cpu_s, "1", conditions),
        Record(
            "gtsam_over_lm_time, without its time in Python",
            (theirs_cpu_s - python_s) / cpu_s,
            "1",
            "lower bound of GTSAM with native residuals; " + conditions,
        ),
        Record(
            "gtsam_cost_difference", abs(costs[1] / costs[0] - 1.0), "1", "relative; " + conditions
        ),
        Record("gtsam_pose_difference", apart_m, "m", "largest; " + conditions),
    ]

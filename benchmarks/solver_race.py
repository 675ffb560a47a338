"""planfit against GTSAM and g2o on the same problem; the ways are said in `gtsam_reference` and
`g2o_reference`.

CPU time of the process, all contenders in turns, so that what else the machine does falls on all of them;
each once before, not counted. What each makes only once (GTSAM's factors, g2o's edges) is not counted,
planfit's terms, pass over the points and ordering are. All stop at the same relative decrease.

Two sizes: 100 matches a pair and 2,000 points a frame, as a scan has; and 10 and 60, where sums over
points are worth the least. g2o with an edge a point is run at the second alone: its Python binding takes
time quadratic in the number of edges to make them, hours for a million.
"""

from collections.abc import Callable
from dataclasses import dataclass

import g2o_reference
import gtsam_reference
import numpy as np
from gtsam_reference import Reference, squared_terms
from inputs import largest_difference
from problems import Problem, make_problem
from records import Record, cpu_seconds, machine

from planfit.lsq.normal_equations import NormalEquations
from planfit.lsq.solver import SolverOptions, solve

TOLERANCE = 1e-6
REPEATS = 5


@dataclass(frozen=True)
class Size:
    """How large a problem is."""

    name: str
    matches_per_pair: int
    points_per_frame: int
    has_edges_by_point: bool

    def problem(self, n_frames: int) -> Problem:
        return make_problem(
            n_frames,
            frames_per_lap=n_frames // 2,
            matches_per_pair=self.matches_per_pair,
            points_per_frame=self.points_per_frame,
        )


SIZES = (Size("many points", 100, 2000, False), Size("few points", 10, 60, True))

Run = Callable[[], Reference]
"""Solves the problem once, from the beginning."""


def records(n_frames: int = 500) -> list[Record]:
    return [record for size in SIZES for record in _of_size(size, n_frames)]


def _of_size(size: Size, n_frames: int) -> list[Record]:
    problem = size.problem(n_frames)
    contenders = _contenders(problem, size)
    runs: dict[str, list[Reference]] = {name: [] for name in contenders}
    for run in contenders.values():
        run()
    for _ in range(REPEATS):
        for name, run in contenders.items():
            runs[name].append(run())
    measurements = problem.measurements
    structure = measurements.structure
    n_points = len(structure.floor.points_cam) + len(structure.walls.points_cam)
    conditions = (
        f"{size.name}: {n_frames} frames, {len(measurements.matches.pairs)} pairs, "
        f"{measurements.matches.n_matches} matches, {n_points} floor and wall points, squared losses, "
        f"given association, relative decrease below {TOLERANCE:g}; CPU time of all threads, medians of "
        f"{REPEATS} in turns; {machine()}"
    )
    made = [
        record
        for name, found in runs.items()
        for record in _rows(f"{size.name}, {name}", found, problem, runs["planfit"][0], conditions)
    ]
    return [*made, *_where_planfits_time_goes(problem, size, conditions)]


def _contenders(problem: Problem, size: Size) -> dict[str, Run]:
    watch = gtsam_reference.Stopwatch()
    graph = gtsam_reference.make_graph(problem, watch)
    arguments = problem, graph, watch, TOLERANCE
    found: dict[str, Run] = {
        "planfit": lambda: _planfit(problem),
        "GTSAM's optimiser": lambda: gtsam_reference.optimise(*arguments),
        "GTSAM called directly": lambda: gtsam_reference.iterate(*arguments),
        "GTSAM fed with moments": lambda: gtsam_reference.iterate_moments(problem, TOLERANCE),
        "g2o fed with moments": _g2o(problem, g2o_reference.edges_by_moments, is_pass_counted=True),
    }
    if size.has_edges_by_point:
        found["g2o, an edge a point"] = _g2o(problem, g2o_reference.edges_by_point)
    return found


def _planfit(problem: Problem) -> Reference:
    options = SolverOptions(cost_tolerance=TOLERANCE)
    initial = problem.initial_plan_from_cams
    cpu_s, solution = cpu_seconds(lambda: solve(squared_terms(problem), initial, options))
    return Reference(solution.target_from_cams, solution.iterations, cpu_s, 0.0)


def _g2o(
    problem: Problem,
    make_edges: Callable[[Problem], list[g2o_reference.Edges]],
    is_pass_counted: bool = False,
) -> Run:
    optimiser = g2o_reference.Optimiser(problem, make_edges(problem))
    iterations = optimiser.needed(TOLERANCE)

    def run() -> Reference:
        found = optimiser.run(iterations)
        pass_s = cpu_seconds(lambda: make_edges(problem))[0] if is_pass_counted else 0.0
        return Reference(found.plan_from_cams, iterations, found.cpu_s + pass_s, pass_s)

    return run


def _rows(
    name: str, runs: list[Reference], problem: Problem, ours: Reference, conditions: str
) -> list[Record]:
    """Time, its part in Python, cost and poses against planfit's."""
    cpu_s, python_s = np.median([(run.cpu_s, run.python_cpu_s) for run in runs], axis=0)
    terms = squared_terms(problem)
    apart_m, apart_rad = largest_difference(ours.plan_from_cams, runs[0].plan_from_cams)
    costs = [gtsam_reference.cost(terms, run.plan_from_cams) for run in (ours, runs[0])]
    said = (
        f"{runs[0].iterations} iterations; cost {costs[1] / costs[0] - 1:+.1e} of planfit's, poses within "
        f"{apart_m:.1e} m and {apart_rad:.1e} rad; {conditions}"
    )
    made = [Record(f"race, {name}", float(cpu_s), "s", said)]
    if python_s > 0:
        made.append(Record(f"race, {name}, of it in Python", float(python_s), "s", conditions))
    return made


def _where_planfits_time_goes(problem: Problem, size: Size, conditions: str) -> list[Record]:
    """One of each of the parts that a solve is made of."""
    poses = problem.initial_plan_from_cams
    terms = squared_terms(problem)
    quadratics = [term.reweight(poses)[0] for term in terms]
    blocks = [q.normal_blocks(poses) for q in quadratics]
    pattern = NormalEquations(blocks, len(poses)).pattern
    equations = NormalEquations(blocks, len(poses), pattern)
    equations.step(1e-4)
    parts: dict[str, Callable[[], object]] = {
        "terms and a pass over the points": lambda: [
            term.reweight(poses) for term in squared_terms(problem)
        ],
        "ordering, once": lambda: NormalEquations(blocks, len(poses)).step(1e-4),
        "blocks of a step": lambda: [q.normal_blocks(poses) for q in quadratics],
        "adding blocks up": lambda: NormalEquations(blocks, len(poses), pattern),
        "factorising and solving": lambda: equations.step(1e-4),
        "cost of a trial": lambda: [q.cost(poses) for q in quadratics],
    }
    return [
        Record(
            f"race, {size.name}, planfit's {name}",
            float(np.median([cpu_seconds(run)[0] for _ in range(REPEATS)])),
            "s",
            f"medians of {REPEATS}; {conditions}",
        )
        for name, run in parts.items()
    ]

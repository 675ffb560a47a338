"""How much drift, how many wrong matches and how wrong a plan the adjustment stands: two tables.

    python benchmarks/robustness.py [--seeds 20] [--json FILE]      measure
    python benchmarks/robustness.py --tables FILE                   write the tables of docs/robustness.md

Problems are made without images (`problems.py`): a walk of 50 m round a ring corridor, two laps, 500
frames, drift as a random walk. `loops first` closes loops before walls pull; `walls at once` does not.
A run succeeds if its final error is within twice the median error at the smallest drift.
"""

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from problems import Problem, make_problem

from planfit.adjust import AdjustOptions, adjust_to_plan, close_loops
from planfit.evaluation import position_errors
from planfit.floorplan import Floorplan
from planfit.matching import Matches
from planfit.synth import DriftOptions

PAGE = Path(__file__).parents[1] / "docs/robustness.md"
N_FRAMES, PER_LAP, WALKED_M = 500, 250, 50.0
DRIFTS = (
    (0.5, 0.5),
    (1.0, 2.0),
    (2.0, 4.0),
    (4.0, 8.0),
    (8.0, 16.0),
)  # per cent of distance, deg at the end


@dataclass(frozen=True)
class Way:
    name: str
    options: AdjustOptions
    loops_first: bool = True


WAYS = (
    Way("default", AdjustOptions()),
    Way("no graduation", AdjustOptions(gnc_schedule=(1.0,))),
    Way("walls at once", AdjustOptions(), loops_first=False),
)


def drifted(seed: int, percent: float, turn_deg: float) -> Problem:
    drift = DriftOptions(
        yaw_deg=turn_deg / np.sqrt(N_FRAMES),
        translation_m=percent / 100 * WALKED_M / np.sqrt(2 * N_FRAMES),
    )
    return make_problem(
        N_FRAMES, seed, PER_LAP, matches_per_pair=30, points_per_frame=200, drift=drift, piece_m=3.0
    )


def final_error(problem: Problem, way: Way) -> float:
    poses = problem.initial_plan_from_cams
    if way.loops_first:
        poses = close_loops(problem.measurements, poses, way.options).target_from_cams
    plan_adjustment = adjust_to_plan(problem.measurements, problem.floorplan, poses, way.options)
    return position_errors(
        plan_adjustment.solution.target_from_cams, problem.true_plan_from_cams
    ).rms_m


def convergence(seeds: int) -> list[dict]:
    rows = []
    base: dict[str, float] = {}
    for percent, turn_deg in DRIFTS:
        problems = [drifted(seed, percent, turn_deg) for seed in range(seeds)]
        before = [
            position_errors(p.initial_plan_from_cams, p.true_plan_from_cams).rms_m for p in problems
        ]
        for way in WAYS:
            errors = np.array([final_error(problem, way) for problem in problems])
            base.setdefault(way.name, float(np.median(errors)))
            limit = 2 * min(base.values())
            rows.append(
                {
                    "drift_percent": percent,
                    "drift_deg": turn_deg,
                    "way": way.name,
                    "before_m": float(np.median(before)),
                    "median_m": float(np.median(errors)),
                    "worst_m": float(errors.max()),
                    "success": float(np.mean(errors <= limit)),
                }
            )
            print(rows[-1], flush=True)
    return rows


def with_wrong_matches(problem: Problem, share: float, rng: np.random.Generator) -> Problem:
    """A share of matches led astray by up to 2 m each way, as look-alike texture does."""
    matches: Matches = problem.measurements.matches
    wrong = rng.random(matches.n_matches) < share
    points = matches.points_a.copy()
    points[wrong] += rng.uniform(-2, 2, (int(wrong.sum()), 3)).astype(points.dtype)
    measurements = replace(problem.measurements, matches=replace(matches, points_a=points))
    return replace(problem, measurements=measurements)


def _with_faces(problem: Problem, keep: np.ndarray, ends: np.ndarray) -> Problem:
    plan = problem.floorplan
    changed = Floorplan(plan.name, ends[keep], plan.normals[keep], plan.is_oriented[keep])
    return replace(problem, floorplan=changed)


def with_missing_walls(problem: Problem, share: float, rng: np.random.Generator) -> Problem:
    plan = problem.floorplan
    return _with_faces(problem, rng.random(len(plan)) >= share, plan.ends)


def with_moved_walls(problem: Problem, share: float, rng: np.random.Generator) -> Problem:
    """A share of faces drawn 0.1 to 0.5 m off, to either side."""
    plan = problem.floorplan
    shift = rng.uniform(0.1, 0.5, len(plan)) * rng.choice([-1, 1], len(plan))
    shift *= rng.random(len(plan)) < share
    ends = plan.ends + (shift[:, None] * plan.normals)[:, None]
    return _with_faces(problem, np.ones(len(plan), dtype=bool), ends)


def robustness(seeds: int) -> list[dict]:
    rows = []
    spoilers = {
        "wrong matches": (with_wrong_matches, (0.0, 0.15, 0.3, 0.45, 0.6)),
        "walls missing": (with_missing_walls, (0.0, 0.15, 0.3)),
        "walls moved": (with_moved_walls, (0.0, 0.15, 0.3)),
    }
    problems = [drifted(seed, 1.0, 2.0) for seed in range(seeds)]
    for name, (spoil, shares) in spoilers.items():
        for share in shares:
            errors = np.array(
                [
                    final_error(spoil(p, share, np.random.default_rng(100 + k)), WAYS[0])
                    for k, p in enumerate(problems)
                ]
            )
            rows.append(
                {
                    "spoiled": name,
                    "share": share,
                    "median_m": float(np.median(errors)),
                    "worst_m": float(errors.max()),
                }
            )
            print(rows[-1], flush=True)
    return rows


def drift_table(rows: list[dict]) -> str:
    lines = [
        "| drift | before, median | default: median, worst | success | without GNC "
        "| without loops first: worst | success |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for percent, turn_deg in DRIFTS:
        by_way = {row["way"]: row for row in rows if row["drift_percent"] == percent}
        first, flat, at_once = (by_way[way.name] for way in WAYS)
        lines.append(
            f"| {percent:g} %, {turn_deg:g} deg | {first['before_m']:.2f} m "
            f"| {first['median_m']:.4f}, {first['worst_m']:.4f} m | {first['success']:.0%} "
            f"| {flat['success']:.0%} | {at_once['worst_m']:.4f} m | {at_once['success']:.0%} |"
        )
    return "\n".join(lines)


def spoiled_table(rows: list[dict]) -> str:
    lines = [
        "| spoiled | share | median | worst | median, against none |",
        "| --- | --- | --- | --- | --- |",
    ]
    for row in rows:
        none = next(r for r in rows if r["spoiled"] == row["spoiled"] and r["share"] == 0)
        lines.append(
            f"| {row['spoiled']} | {row['share']:.0%} | {row['median_m']:.4f} m "
            f"| {row['worst_m']:.4f} m | {row['median_m'] / none['median_m'] - 1:+.0%} |"
        )
    return "\n".join(lines)


def write_tables(tables: dict[str, list[dict]], page: Path) -> None:
    """Put the tables between their marks in a page."""
    text = page.read_text()
    made = {
        "drift": drift_table(tables["convergence"]),
        "spoiled": spoiled_table(tables["robustness"]),
    }
    for name, table in made.items():
        begin, end = f"<!-- table: {name} -->\n", "<!-- end -->"
        before, rest = text.split(begin)
        text = f"{before}{begin}{table}\n{rest[rest.index(end) :]}"
    page.write_text(text)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--tables", type=Path, help="JSON of an earlier run")
    arguments = parser.parse_args()
    if arguments.tables:
        write_tables(json.loads(arguments.tables.read_text()), PAGE)
        return
    tables = {
        "convergence": convergence(arguments.seeds),
        "robustness": robustness(arguments.seeds),
    }
    if arguments.json:
        arguments.json.write_text(json.dumps(tables, indent=1))


if __name__ == "__main__":
    main()

"""Plans and scans that do not belong together: how often an alignment is called sure.

    python benchmarks/wrong_plans.py [--cases 20] [--first-seed 0] [--ways WAY ...] [--part 1.0] [--json FILE]

Cases are those of `alignment_cases.py`, each with its plan spoilt in known ways, or another's. Even seeds
are for choosing thresholds, odd ones for reporting.
"""

import argparse
import json
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from alignment_cases import Case, make_case
from scipy.spatial import ConvexHull

from planfit.alignment import Alignment, AlignmentHypothesis, WallSamples, align, plan_evidence
from planfit.alignment.refine import rotation_2d
from planfit.errors import PlanfitError
from planfit.floorplan import Floorplan
from planfit.geometry import segments

Pair = tuple[WallSamples, Floorplan]


def metric(case: Case) -> Floorplan:
    return case.floorplan.scaled(case.metres_per_unit)


def kept(plan: Floorplan, which: np.ndarray) -> Floorplan:
    return replace(
        plan,
        ends=plan.ends[which],
        normals=plan.normals[which],
        is_oriented=plan.is_oriented[which],
    )


def right(case: Case, _: np.random.Generator) -> Pair:
    return case.walls, metric(case)


def other_building(case: Case, rng: np.random.Generator) -> Pair:
    return case.walls, metric(make_case(int(rng.integers(50_000, 60_000))))


def other_without_unit(case: Case, rng: np.random.Generator) -> Pair:
    walls, plan = other_building(case, rng)
    return walls, replace(plan, is_metric=False)


def mirrored(case: Case, _: np.random.Generator) -> Pair:
    plan = metric(case)
    return case.walls, replace(plan.mirrored(), source=plan.source)


def outline(case: Case, _: np.random.Generator) -> Pair:
    """Faces near the hull of the plan."""
    plan = metric(case)
    hull = ConvexHull(plan.ends.reshape(-1, 2))
    inside = -(plan.ends @ hull.equations[:, :2].T + hull.equations[:, 2])  # (n, 2, sides) m
    return case.walls, kept(plan, (inside.max(axis=1) < 0.6).any(axis=1))


def centre_lines(case: Case, _: np.random.Generator) -> Pair:
    """Each wall as a line in its middle, of unknown side."""
    plan = metric(case)
    ends = plan.ends - 0.5 * thickness(plan)[:, None, None] * plan.normals[:, None]
    return case.walls, replace(plan, ends=ends, is_oriented=np.zeros(len(plan), dtype=bool))


def thickness(plan: Floorplan) -> np.ndarray:
    """Of the wall behind each face (m); 0 where there is none."""
    middle, along = plan.ends.mean(axis=1), segments.directions(plan.ends)
    found = np.zeros(len(plan))
    for i in range(len(plan)):
        behind = -(middle - middle[i]) @ plan.normals[i]
        at = (plan.ends - plan.ends[i, 0]) @ along[i]
        overlaps = (at.max(axis=1) > 0.1) & (at.min(axis=1) < plan.lengths[i] - 0.1)
        partner = (
            (plan.normals @ plan.normals[i] < -0.99) & (behind > 0.02) & (behind < 0.6) & overlaps
        )
        found[i] = behind[partner].min() if partner.any() else 0.0
    return found


def wing_rebuilt(case: Case, rng: np.random.Generator) -> Pair:
    """Half of the plan is another's."""
    plan, other = metric(case), metric(make_case(int(rng.integers(50_000, 60_000))))
    side = plan.ends.mean(axis=1)
    shift = side.mean(axis=0) - other.ends.mean(axis=(0, 1))
    moved = replace(other, ends=other.ends + shift)
    direction = rotation_2d(rng.uniform(-np.pi, np.pi))[0]
    cut = np.median(side @ direction)
    a, b = (
        kept(plan, side @ direction < cut),
        kept(moved, moved.ends.mean(axis=1) @ direction >= cut),
    )
    return case.walls, replace(
        a,
        ends=np.concatenate([a.ends, b.ends]),
        normals=np.concatenate([a.normals, b.normals]),
        is_oriented=np.concatenate([a.is_oriented, b.is_oriented]),
    )


def shuffled(case: Case, rng: np.random.Generator) -> Pair:
    """Each view where another was, in a direction of its own."""
    walls, view = case.walls, views(case.walls)
    eyes = eyes_of(walls)[np.unique(view, return_index=True)[1]]
    return carried(
        walls, view, rng.permutation(eyes), rng.uniform(-np.pi, np.pi, len(eyes))
    ), metric(case)


def constant(case: Case, _: np.random.Generator) -> Pair:
    """Each view from one spot and in one direction."""
    walls, view = case.walls, views(case.walls)
    n = view.max() + 1
    ahead = np.array([(walls.xy - eyes_of(walls))[view == k].mean(axis=0) for k in range(n)])
    return carried(walls, view, np.zeros((n, 2)), -np.arctan2(ahead[:, 1], ahead[:, 0])), metric(
        case
    )


def eyes_of(walls: WallSamples) -> np.ndarray:
    """The camera of each sample (m, 2)."""
    assert walls.seen_from is not None
    return walls.seen_from


def views(walls: WallSamples) -> np.ndarray:
    """Number of the view of each sample."""
    return np.concatenate([[0], np.cumsum(np.any(np.diff(eyes_of(walls), axis=0) != 0, axis=1))])


def carried(
    walls: WallSamples, view: np.ndarray, eyes: np.ndarray, yaws: np.ndarray
) -> WallSamples:
    """Each view rotated by its yaw about its camera, and the camera moved to its new eye."""
    rotation = np.array([rotation_2d(yaw) for yaw in yaws])[view]
    lever = np.einsum("mab,mb->ma", rotation, walls.xy - eyes_of(walls))
    normals = np.einsum("mab,mb->ma", rotation, walls.normals)
    return WallSamples(eyes[view] + lever, normals, eyes[view])


WAYS: dict[str, Callable[[Case, np.random.Generator], Pair]] = {
    way.__name__.replace("_", " "): way
    for way in (right, other_building, other_without_unit, mirrored, outline, centre_lines, wing_rebuilt,
                shuffled, constant)
}  # fmt: skip


ON_PLAN = ("right", "outline", "centre lines", "wing rebuilt")
"""Ways that leave a true place."""


def off_m(case: Case, found: Alignment) -> float:
    """Distance of the scan's middle from its true place."""
    middle = case.walls.xy.mean(axis=0)
    true_xy = case.plan_from_level[:2, :2] @ middle + case.plan_from_level[:2, 2]
    xy = found.plan_from_level[:2, :2] @ middle + found.plan_from_level[:2, 3]
    return float(np.linalg.norm(xy / found.metres_per_unit - true_xy))


def run_case(seed: int, chosen: Sequence[str] = (), part: float = 1.0) -> list[dict[str, Any]]:
    case, rows = make_case(seed), []
    walked = np.arange(round(part * len(case.walls.xy)))
    case = replace(case, walls=case.walls.picked(walked))
    for number, (name, spoil) in enumerate(WAYS.items()):
        if chosen and name not in chosen:
            continue
        walls, plan = spoil(case, np.random.default_rng([seed, number]))
        try:
            found = align(walls, plan)
        except PlanfitError as error:
            rows.append({"seed": seed, "way": name, "is_sure": False, "warnings": [str(error)]})
            continue
        taken = AlignmentHypothesis.from_transform(found.plan_from_level)
        evidence = plan_evidence(walls, plan, replace(taken, scale_xy=found.scale_xy))
        rows.append(
            {
                "seed": seed,
                "way": name,
                "is_sure": found.is_sure,
                "score": found.score,
                "margin": found.margin,
                "off_m": off_m(case, found) if name in ON_PLAN else None,
                **vars(evidence),
                "warnings": list(found.warnings),
            }
        )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--ways", nargs="*", default=[], choices=list(WAYS))
    parser.add_argument("--part", type=float, default=1.0, help="share of the walk, from its begin")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.cases)
    rows: list[dict[str, Any]] = []
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for found in pool.map(partial(run_case, chosen=arguments.ways, part=arguments.part), seeds):
            rows += found
            if arguments.json:
                arguments.json.write_text(json.dumps(rows, indent=1))
    print(
        f"{'':20} sure of all   score: median, range   margin, most   walked, seen through: median"
    )
    for name in WAYS:
        part = [row for row in rows if row["way"] == name]
        full = [row for row in part if "score" in row]
        if not full:
            continue
        score = np.array([row["score"] for row in full])
        print(
            f"{name:20} {sum(row['is_sure'] for row in part):4} {len(part):6}   "
            f"{np.median(score):.2f} {score.min():.2f}-{score.max():.2f}   "
            f"{max(row['margin'] for row in full):.2f}   "
            f"{np.median([row['walked_through_share'] for row in full]):.2f} "
            f"{np.median([row['seen_through_share'] for row in full]):.2f}"
        )


if __name__ == "__main__":
    main()

"""Does the adjustment end where it would have from the true poses? Share of starts that do, by full cost.

    python benchmarks/optimality.py [--starts 100] [--first-seed 0] [--conslam] [--json FILE]

Flats (`flats.py`) with niches and pilasters 0.1 to 0.2 m deep are walked with 1, 2 or 4 per cent of drift:
with loops matched, with neighbouring frames matched only, and without matches; a third each with the right
plan, with 30 % of faces drawn 0.1 to 0.5 m off, and with half of them missing. `--conslam` adds the real
scan, labelled by geometry, at ten drifts. A start is a scan with its loops closed, off by 0.15 m and 1
degree as a whole; the reference is the same adjustment from the true poses. Ends are alike where the full
cost is at most 1 % above. Stricter is the excess as a share of what walls can cost: matches are most of the
full cost.
"""

import argparse
import dataclasses
import json
import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from flats import FlatOptions, make_flat
from robustness import with_missing_walls, with_moved_walls

import planfit
from planfit.adjust import AdjustOptions, Measurements, close_loops
from planfit.adjust.alternation import Alternation, PlanTask
from planfit.adjust.association import associate, displaced
from planfit.adjust.ceilings import find_ceilings
from planfit.adjust.competition import best_of_starts, full_cost, limits
from planfit.evaluation import position_errors
from planfit.floorplan import Floorplan
from planfit.pipeline.align import align_to_plan
from planfit.pipeline.prepare import extract_observations, prepare
from planfit.runtime import Runtime, StageTimer
from planfit.scan import read_tum
from planfit.scan.formats.facap import PLAN_FROM_WORLD
from planfit.segmentation import SegmentationOptions
from planfit.synth import DriftOptions, drift_poses

CONSLAM = Path(os.environ.get("PLANFIT_SHARED", "../shared/data")) / "conslam"
WAYS = {
    "loops": FlatOptions(),
    "neighbours": FlatOptions(loops=False),
    "no matches": FlatOptions(loops=False, neighbours=0),
}
PERCENT = (1.0, 2.0, 4.0)
PLANS = ("right", "moved", "missing")


@dataclass(frozen=True)
class Start:
    """A scan with its loops closed, aligned with a plan."""

    name: str
    measurements: Measurements
    floorplan: Floorplan
    plan_from_cams: np.ndarray
    true_plan_from_cams: np.ndarray
    moved_m: np.ndarray | None = None
    """How far the wall of each face stands off where it is drawn, where faces were moved."""


def flat_starts(first_seed: int, n: int) -> Iterator[Start]:
    """All ways, drifts and plans in turn, each with a flat and a walk of its own."""
    for seed in range(first_seed, first_seed + n):
        name = list(WAYS)[seed % len(WAYS)]
        percent = PERCENT[seed // len(WAYS) % len(PERCENT)]
        plan = PLANS[seed // (len(WAYS) * len(PERCENT)) % len(PLANS)]
        problem = make_flat(seed, percent, WAYS[name])
        rng = np.random.default_rng(1000 + seed)
        built, moved_m = problem.floorplan, None
        if plan == "moved":
            problem = with_moved_walls(problem, 0.3, rng)
            apart = (built.ends - problem.floorplan.ends)[:, 0]
            moved_m = np.einsum("fi,fi->f", apart, built.normals)
        if plan == "missing":
            problem = with_missing_walls(problem, 0.5, rng)
        closed = close_loops(problem.measurements, problem.initial_plan_from_cams, AdjustOptions())
        # Drift turns and shifts the whole from its first frame on; an alignment takes that out.
        aligned = _rigidly_to(closed.target_from_cams, problem.true_plan_from_cams, rng)
        yield Start(
            f"flat {seed}, {name}, {percent:g} %, plan {plan}",
            problem.measurements,
            problem.floorplan,
            aligned,
            problem.true_plan_from_cams,
            moved_m,
        )


def _rigidly_to(poses: np.ndarray, true: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Poses brought to the truth as a whole, seen from above, but for 0.15 m and 1 degree."""
    xy, target = poses[:, :2, 3], true[:, :2, 3]
    # As complex numbers, the rotation that best takes a to b is the angle of sum of conj(a) b.
    a, b = (xy - xy.mean(0)) @ [1, 1j], (target - target.mean(0)) @ [1, 1j]
    yaw = np.angle(np.sum(np.conj(a) * b)) + np.deg2rad(rng.normal())
    c, s = np.cos(yaw), np.sin(yaw)
    whole = np.eye(4)
    whole[:2, :2] = [[c, -s], [s, c]]
    whole[:2, 3] = target.mean(0) - whole[:2, :2] @ xy.mean(0) + rng.normal(0.0, 0.15, 2)
    return whole @ poses


def conslam_starts(seeds: range) -> Iterator[Start]:
    """The real scan, labelled by geometry, drifted anew."""
    scan = planfit.read_scan(CONSLAM)
    assert scan.floorplan_path is not None
    assert scan.up_world is not None
    floorplan = planfit.read_floorplan(scan.floorplan_path)
    _, true = read_tum(CONSLAM / "groundtruth.tum")
    options = planfit.RefineOptions(segmentation=SegmentationOptions(back_end="geometry"))
    drift = DriftOptions(yaw_deg=0.15, tilt_share=0.3, translation_m=0.02, vertical_share=0.3)
    with tempfile.TemporaryDirectory() as cache:
        runtime = Runtime(cache_dir=Path(cache))
        for seed in seeds:
            drifted = drift_poses(true, drift, np.random.default_rng(seed), scan.up_world)
            again = dataclasses.replace(scan, world_from_cams=drifted)
            timer = StageTimer(runtime)
            seen = extract_observations(again, options, runtime, timer=timer)
            prepared = prepare(again, seen, options, timer)
            on_plan = align_to_plan(again, prepared, floorplan, options, timer)
            yield Start(
                f"ConSLAM {seed}",
                prepared.measurements,
                on_plan.floorplan,
                on_plan.plan_from_level @ prepared.level_from_keys,
                PLAN_FROM_WORLD @ true,
            )


def measure(start: Start, options: AdjustOptions) -> dict:
    """Costs and errors where the adjustment ends, from the start and from the true poses."""
    ceilings_m = find_ceilings(
        start.measurements.structure, start.plan_from_cams, options.ceiling_heights
    )
    task = PlanTask(start.measurements, start.floorplan, options, ceilings_m)
    ends = {
        "found": best_of_starts(task, start.plan_from_cams).best,
        "from truth": best_of_starts(task, start.true_plan_from_cams).best,
    }
    row: dict = {"start": start.name}
    row["before_m"] = position_errors(start.plan_from_cams, start.true_plan_from_cams).rms_m
    for name, end in ends.items():
        row[f"cost, {name}"] = full_cost(task, end)
        row[f"{name}_m"] = position_errors(end.plan_from_cams, start.true_plan_from_cams).rms_m
    if start.moved_m is not None:
        row.update(named(start, ends["found"], start.moved_m, options))
    excess = row["cost, found"] - row["cost, from truth"]
    row["above"] = excess / row["cost, from truth"]
    row["above, share of walls"] = excess / float(limits(task).sum())
    row["is_optimal"] = bool(row["above"] <= 0.01)
    return row


def named(start: Start, end: Alternation, moved_m: np.ndarray, options: AdjustOptions) -> dict:
    """Moved faces that three patches or more see, how many were named within 3 cm, and what was misnamed."""
    walls, poses = start.measurements.structure.walls, start.true_plan_from_cams
    built = displaced(start.floorplan, moved_m)
    seen = associate(walls, built, poses, 0.1, options.association).face_idx
    counts = np.bincount(seen[seen >= 0], minlength=len(built))
    found_m, sigmas_m = end.problem.offsets(end.solution.target_from_cams)
    found_m = np.where(np.isfinite(sigmas_m), found_m, np.nan)
    is_moved = (np.abs(moved_m) > 1e-6) & (counts >= 3)
    return {
        "moved": int(is_moved.sum()),
        "named": int((is_moved & (np.abs(found_m - moved_m) < 0.03)).sum()),
        "named wrongly": int((np.isfinite(found_m) & (np.abs(moved_m) < 1e-6)).sum()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--conslam", action="store_true")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    n = arguments.starts - (10 if arguments.conslam else 0)
    starts = flat_starts(arguments.first_seed, n)
    rows = []
    for part in (starts, conslam_starts(range(10)) if arguments.conslam else ()):
        for start in part:
            rows.append(measure(start, AdjustOptions()))
            row = rows[-1]
            print(
                f"{row['start']:45} {row['before_m']:.3f} -> {row['found_m']:.3f} m "
                f"(from truth {row['from truth_m']:.3f}), cost {row['above']:+.2%}, "
                f"{row['above, share of walls']:+.1%} of walls"
                + (f", {row['named']} of {row['moved']} moved walls" if "moved" in row else ""),
                flush=True,
            )
    optimal = np.mean([row["is_optimal"] for row in rows])
    near = np.mean([row["above, share of walls"] <= 0.01 for row in rows])
    print(
        f"{len(rows)} starts: {optimal:.0%} within 1 % of the full cost reached from the true poses, "
        f"{near:.0%} within 1 % of what walls can cost"
    )
    moved = [row for row in rows if row.get("moved")]
    if moved:
        share = sum(row["named"] for row in moved) / sum(row["moved"] for row in moved)
        wrong = sum(row["named wrongly"] for row in moved)
        print(f"{share:.0%} of moved walls named within 3 cm, {wrong} walls as drawn called moved")
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()

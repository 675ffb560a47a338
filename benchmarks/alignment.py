"""How often, how exactly and how fast scans are aligned with plans.

    python benchmarks/alignment.py battery [--cases 200] [--first-seed 0] [--jobs 2] [--json FILE]
    python benchmarks/alignment.py conslam [--cases 10] [--refine]
    python benchmarks/alignment.py picture
    python benchmarks/alignment.py speed [--plan FILE]

`battery`: synthetic cases (`alignment_cases.py`: built from geometry, nothing is rendered), this
alignment beside the paper's. Right means within 0.3 m, 1 degree and 1 % of scale of the true alignment of the
(deformed) scan as a whole. Seeds below 10000 are for reporting; development used 10000 and above.
`conslam`: the real scan with its plan turned, scaled (0.01 to 100) and moved at random, without unit.
`picture`: the real scan with `floorplan.png`, a picture of the whole plan at an unknown scale.
`speed`: seconds for the real scan on the whole plan, unknown scale.
"""

import argparse
import json
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from alignment_cases import Case, make_case
from inputs import CACHE, CONSLAM

import planfit
from planfit.alignment import Alignment, AlignOptions, align, align_paper, metric_plan
from planfit.errors import PlanfitError
from planfit.floorplan import Floorplan, PlanOptions
from planfit.geometry import se3
from planfit.pipeline.align import align as align_scan
from planfit.pipeline.options import RefineOptions
from planfit.runtime import Runtime
from planfit.scan import read_tum
from planfit.scan.formats.facap import PLAN_FROM_WORLD

MAX_M, MAX_DEG, MAX_SCALE = 0.3, 1.0, 0.01


def errors(case: Case, found: Alignment) -> tuple[float, float, float]:
    """Translation of the scan's middle (m), rotation (deg) and scale (share) off the truth."""
    middle = case.walls.xy.mean(axis=0)
    true_xy = case.plan_from_level[:2, :2] @ middle + case.plan_from_level[:2, 2]
    xy = found.plan_from_level[:2, :2] @ middle + found.plan_from_level[:2, 3]
    xy = xy / found.scale_xy * case.metres_per_unit
    yaw = [se3.yaw_of(m) for m in (found.plan_from_level, case.plan_from_level)]
    rotation = abs(np.rad2deg(np.angle(np.exp(1j * (yaw[0] - yaw[1])))))
    scale = np.abs(np.log(np.array(found.scale_xy) / case.metres_per_unit)).max()
    return float(np.linalg.norm(xy - true_xy)), float(rotation), float(scale)


def run_case(seed: int) -> dict[str, Any]:
    """Both methods on the case of a seed."""
    case = make_case(seed)
    row: dict[str, Any] = {"seed": seed, "words": case.words, "deformation_m": case.residual_m}
    for method in ("search", "paper"):
        begin = time.perf_counter()
        try:
            if method == "search":
                found = align(case.walls, case.floorplan, AlignOptions())
            else:
                rng = np.random.default_rng(seed)
                found = align_paper(case.cloud, case.walls, case.floorplan, rng)
        except PlanfitError as error:
            row[method] = {"is_right": False, "is_sure": False, "warnings": [str(error)]}
            continue
        off = errors(case, found)
        row[method] = {
            "is_right": off[0] < MAX_M and off[1] < MAX_DEG and off[2] < MAX_SCALE,
            "is_sure": found.is_sure,
            "off": off,
            "score": found.score,
            "margin": found.margin,
            "seconds": time.perf_counter() - begin,
            "warnings": list(found.warnings),
        }
    row["is_scale_known"] = case.is_scale_known
    row["coverage"], row["drift"] = case.coverage, case.drift
    return row


def battery(arguments: argparse.Namespace) -> None:
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.cases)
    begin = time.perf_counter()
    with ProcessPoolExecutor(arguments.jobs) as pool:
        rows = list(pool.map(run_case, seeds))
    for row in rows:
        search = row["search"]
        if not search["is_right"]:
            metres, degrees, share = search.get("off", (np.nan,) * 3)
            print(
                f"seed {row['seed']}: {metres:.2f} m, {degrees:.2f} deg, {share:.1%} off, "
                f"{'SURE' if search['is_sure'] else 'flagged'}; deformed by "
                f"{row['deformation_m']:.2f} m; {row['words']}"
            )
    print(f"{'':34}search   paper")
    groups = {
        "all": lambda _: True,
        "scale known": lambda row: row["is_scale_known"],
        "scale unknown": lambda row: not row["is_scale_known"],
        "coverage 25 to 50 %": lambda row: row["coverage"] < 0.5,
        "coverage 50 to 90 %": lambda row: 0.5 <= row["coverage"] < 0.9,
        "coverage above 90 %": lambda row: row["coverage"] >= 0.9,
        "drift above 1 %": lambda row: row["drift"] > 0.01,
    }
    for name, chosen in groups.items():
        part = [row for row in rows if chosen(row)]
        print(f"right, {name:20} ({len(part):3})", end="")
        for method in ("search", "paper"):
            print(f"{np.mean([row[method]['is_right'] for row in part]):8.1%}", end="")
        print()
    for words, count in (
        ("wrong and said to be sure", lambda m: not m["is_right"] and m["is_sure"]),
        ("right but flagged", lambda m: m["is_right"] and not m["is_sure"]),
    ):
        print(f"{words:32}", *(f"{sum(count(r[m]) for r in rows):7}" for m in ("search", "paper")))
    right = [row for row in rows if row["search"]["is_right"]]
    off = np.array([row["search"]["off"] for row in right])
    free = np.array([row["search"]["off"][2] for row in right if not row["is_scale_known"]])
    if len(off) and len(free):
        print(
            f"right ones, median (most): {np.median(off[:, 0]):.3f} ({off[:, 0].max():.3f}) m, "
            f"{np.median(off[:, 1]):.2f} ({off[:, 1].max():.2f}) deg, "
            f"{np.median(free):.2%} ({free.max():.2%}) of an unknown scale"
        )
    for known in (True, False):
        times = [r["search"]["seconds"] for r in rows if r["is_scale_known"] == known]
        print(
            f"seconds, scale {'known' if known else 'unknown'}: "
            f"median {np.median(times):.1f}, most {max(times):.1f}"
        )
    print(f"{time.perf_counter() - begin:.0f} s for all, {arguments.jobs} processes")
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))


def conslam(arguments: argparse.Namespace) -> None:
    """The scan on its plan, disguised; the alignments are compared where the plan's true frame has them."""
    scan = planfit.read_scan(CONSLAM)
    floorplan = planfit.read_floorplan(CONSLAM / "floorplan.npy")
    _, true_world_from_cams = read_tum(CONSLAM / "groundtruth.tum")
    truth = (PLAN_FROM_WORLD @ true_world_from_cams)[:, :2, 3]
    runtime, options = Runtime(cache_dir=CACHE), RefineOptions()
    rng = np.random.default_rng(7)
    results = []
    for case in range(arguments.cases):
        yaw, scale = rng.uniform(-np.pi, np.pi), 10 ** rng.uniform(-2, 2)
        translation = rng.uniform(-100, 100, 2)
        disguised = disguise(floorplan, yaw, scale, translation)
        begin = time.perf_counter()
        if arguments.refine:
            run = planfit.refine(scan, disguised, options, runtime)
            assert run.alignment is not None
            found, on_plan = run.alignment, run.plan_from_cams
        else:
            aligned = align_scan(scan, disguised, options, runtime)
            found = aligned.alignment
            on_plan = aligned.plan_from_world @ scan.world_from_cams
        seconds = time.perf_counter() - begin
        xy = undisguise(on_plan[:, :2, 3] / found.metres_per_unit, yaw, scale, translation)
        results.append(xy)
        print(
            f"case {case}: turned {np.rad2deg(yaw):7.1f} deg, unit {scale:8.4f} m: scale off by "
            f"{found.metres_per_unit / scale - 1:+.3%} (said: {found.scale_sigma:.2%}), position RMS "
            f"{rms(xy, truth):.3f} m, {rms(xy, results[0]):.4f} m from case 0, "
            f"score {found.score:.2f}, {'sure' if found.is_sure else 'NOT SURE'}, {seconds:.1f} s"
        )
    if arguments.refine:
        run = planfit.refine(scan, floorplan, options, runtime)
        xy = run.plan_from_cams[:, :2, 3]
        gaps = [rms(xy, other) for other in results]
        print(f"plan in metres: position RMS {rms(xy, truth):.3f} m; the cases are {min(gaps):.4f} "
              f"to {max(gaps):.4f} m from it")  # fmt: skip


def picture(arguments: argparse.Namespace) -> None:  # noqa: ARG001
    """Print what `on_picture` finds."""
    run, off, apart = on_picture()
    assert run.alignment is not None
    print(
        f"scale off by {off:+.3%}, position RMS {np.sqrt((apart**2).sum(axis=1).mean()):.3f} m "
        f"(horizontal {np.sqrt((apart[:, :2] ** 2).sum(axis=1).mean()):.3f} m), score "
        f"{run.alignment.score:.2f}, {'sure' if run.alignment.is_sure else 'NOT SURE'}"
    )
    print(*run.warnings, sep="\n")


def on_picture() -> tuple[planfit.RefineResult, float, np.ndarray]:
    """The scan with a picture of its whole plan and nothing else; judged in the plan's true frame.

    Returns the run, the relative error of the scale, and the errors of the positions (n, 3), m.
    """
    scan = planfit.read_scan(CONSLAM)
    floorplan = planfit.read_floorplan(CONSLAM / "floorplan.png")
    truth = json.loads((CONSLAM / "floorplan_png_truth.json").read_text())
    _, true_world_from_cams = read_tum(CONSLAM / "groundtruth.tum")
    run = planfit.refine(scan, floorplan, RefineOptions(), Runtime(cache_dir=CACHE))
    assert run.alignment is not None
    uv = run.plan_from_cams[:, :2, 3] / run.alignment.metres_per_unit * (1.0, -1.0)
    xz = (uv + truth["origin_px"]) / truth["pixels_per_metre"] @ np.array(truth["rotation"])
    true = true_world_from_cams[:, [0, 2, 1], 3]  # world y is up
    apart = np.column_stack([xz, run.plan_from_cams[:, 2, 3]]) - true
    return run, run.alignment.metres_per_unit * truth["pixels_per_metre"] - 1, apart


def disguise(floorplan: Floorplan, yaw: float, scale: float, translation: np.ndarray) -> Floorplan:
    """The plan rotated, moved (m), and in units of `scale` m: a file of bare segments, unit unknown."""
    rotation = se3.yaw_transform(yaw)[:2, :2]
    ends = (floorplan.ends @ rotation.T + translation) / scale
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "disguised.npy"
        np.save(path, (ends * (1.0, -1.0)).reshape(-1, 4))  # the layout's (u, v) is our (x, -y)
        return planfit.read_floorplan(path, PlanOptions(unit="unknown"))


def undisguise(
    xy_units: np.ndarray, yaw: float, scale: float, translation: np.ndarray
) -> np.ndarray:
    """Points (n, 2) in the units of the disguised plan, back in the true plan (m)."""
    return (xy_units * scale - translation) @ se3.yaw_transform(yaw)[:2, :2]


def rms(a: np.ndarray, b: np.ndarray) -> float:
    """RMS distance of points (n, 2)."""
    return float(np.sqrt(np.mean(np.sum((a - b) ** 2, axis=1))))


def speed(arguments: argparse.Namespace) -> None:
    """Alignment alone, loops already closed, of the real scan; first call apart (it compiles)."""
    scan = planfit.read_scan(CONSLAM)
    runtime, options = Runtime(cache_dir=CACHE), RefineOptions()
    floorplan = planfit.read_floorplan(arguments.plan)
    if floorplan.is_metric:
        floorplan = disguise(floorplan, 0.4, 0.05, np.zeros(2))
    aligned = align_scan(scan, floorplan, options, runtime)
    walls = aligned.walls
    for name, plan in (
        ("unknown scale", floorplan),
        ("known scale", metric_plan(floorplan, aligned.alignment.scale_xy)),
    ):
        times = []
        for _ in range(3):
            begin = time.perf_counter()
            align(walls, plan, options.align)
            times.append(time.perf_counter() - begin)
        print(
            f"{name}: median {np.median(times):.2f} s of 3 ({len(walls.xy)} samples, {len(plan)} faces)"
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    of_battery = commands.add_parser("battery")
    of_battery.add_argument("--cases", type=int, default=200)
    of_battery.add_argument("--first-seed", type=int, default=0)
    of_battery.add_argument("--jobs", type=int, default=2)
    of_battery.add_argument("--json", type=Path)
    of_conslam = commands.add_parser("conslam")
    of_conslam.add_argument("--cases", type=int, default=10)
    of_conslam.add_argument("--refine", action="store_true", help="refine too, not only align")
    commands.add_parser("picture")
    of_speed = commands.add_parser("speed")
    of_speed.add_argument("--plan", type=Path, default=CONSLAM / "floorplan.npy")
    arguments = parser.parse_args()
    {"battery": battery, "conslam": conslam, "picture": picture, "speed": speed}[arguments.command](
        arguments
    )


if __name__ == "__main__":
    main()

"""`planfit compare`: two runs, or a run and other poses: where they differ, and which is better."""

import json
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from planfit.cli.compare_inputs import CompareArguments as CompareArguments
from planfit.cli.compare_inputs import Pair, read_pair
from planfit.cli.console import StageBars, note, out, table
from planfit.cli.run_record import cache_of
from planfit.errors import OutputError, require
from planfit.evaluation import Comparison, compare
from planfit.export.cloud import place_cloud, sample_cloud
from planfit.report.comparison_words import conclusion, local_in_words, whole_in_words
from planfit.report.html.comparison_page import Compared, make_comparison
from planfit.report.measures import CloudXY
from planfit.report.plots.scan_view import at_camera_height
from planfit.runtime import Runtime, made_folder, write_whole

PAGE, RECORD = "comparison.html", "comparison.json"


def compare_command(arguments: CompareArguments) -> int:
    """Read, compare, write, tell. Exit code 0 whichever is better."""
    require(
        arguments.b is None or arguments.poses is None,
        "--poses: expected either a second run or a file of poses, found both; leave out one",
    )
    folder = arguments.out
    if folder is not None:
        _check_free(folder, arguments.overwrite)
    made = nullcontext() if folder is None else made_folder(folder)
    with made, StageBars() as bars:
        runtime = Runtime(arguments.workers, cache_of(arguments.a), bars.update)
        pair = read_pair(arguments, runtime)
        comparison = compare(pair.scan, pair.a, pair.b, pair.matches, arguments.options, runtime)
        record = to_record(str(arguments.a), pair, comparison)
        if folder is not None:
            plan = pair.a.floorplan.name if pair.a.floorplan else ""
            what = Compared(Path(pair.scan.name).name, str(arguments.a), pair.name_b, plan)
            cloud = _cloud(pair, comparison, runtime)
            page = make_comparison(what, comparison, cloud, pair.notes)
            write_whole(folder / PAGE, page)
            write_whole(folder / RECORD, json.dumps(record, indent=1, allow_nan=False) + "\n")
    if arguments.json:
        out.print_json(json.dumps(record, allow_nan=False))
    else:
        _tell(str(arguments.a), pair, comparison, folder)
    return 0


def to_record(name_a: str, pair: Pair, comparison: Comparison) -> dict[str, Any]:
    """A comparison as plain values; null where a number could not be taken."""
    differences = comparison.differences
    return {
        "scan": pair.scan.name,
        "a": name_a,
        "b": pair.name_b,
        "frames": len(differences.distance_m),
        "axes": comparison.axes,
        "is_aligned": differences.is_aligned,
        "preferred": comparison.preferred,
        "conclusion": " ".join(conclusion(comparison).split()),
        "witnesses": [
            {
                "name": witness.name,
                "metric": witness.deciding.name,
                "unit": witness.deciding.unit,
                "a": witness.deciding.before,
                "b": witness.deciding.after,
                "prefers": witness.prefers,
            }
            for witness in comparison.witnesses
        ],
        "difference": {
            "rms_m": differences.rms_m,
            "max_m": float(differences.distance_m.max()),
            "max_deg": float(differences.angle_deg.max()),
            "as_a_whole_m": differences.whole[0],
            "as_a_whole_deg": differences.whole[1],
            "aligned_rms_m": differences.aligned_rms_m,
        },
        "stretches": [
            {
                "first_frame": local.stretch.first,
                "last_frame": local.stretch.last,
                "max_m": local.stretch.max_distance_m,
                "max_deg": local.stretch.max_angle_deg,
                "matches_m": {"a": _finite(local.match_m[0]), "b": _finite(local.match_m[1])},
                "wall_near_plan": {
                    "a": _finite(local.near_share[0]),
                    "b": _finite(local.near_share[1]),
                },
            }
            for local in comparison.stretches
        ],
        "metrics": {
            name: {
                "meaning": metric.meaning.strip(),
                "unit": metric.unit,
                "a": _finite(metric.before),
                "b": _finite(metric.after),
            }
            for name, metric in comparison.metrics.items()
        },
        "by_frame": {
            "frame": list(pair.scan.frame_ids),
            "distance_m": [round(v, 6) for v in differences.distance_m.tolist()],
            "angle_deg": [round(v, 5) for v in differences.angle_deg.tolist()],
        },
        "notes": [*pair.notes, *comparison.notes],
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _cloud(pair: Pair, comparison: Comparison, runtime: Runtime) -> CloudXY | None:
    """Without a plan: what was seen at camera height, at A and at B."""
    if comparison.poses.floorplan is not None:
        return None
    cloud = sample_cloud(pair.scan, runtime)
    at_a, at_b = comparison.poses.plan_from_cams
    a, b = place_cloud(cloud, at_a), place_cloud(cloud, at_b)
    is_shown = at_camera_height(at_a[:, :3, 3], a)
    return a[is_shown, :2], b[is_shown, :2]


def _check_free(folder: Path, overwrite: bool) -> None:
    """Raise `OutputError` where a folder holds something that is not to be replaced."""
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: expected a folder, found a file; choose another with -o")
    if folder.exists():
        names = {item.name for item in folder.iterdir()}
        if names - {PAGE, RECORD}:
            raise OutputError(
                f"{folder}: expected an empty folder or an earlier comparison, found other files; choose "
                "another with -o"
            )
        if names and not overwrite:
            raise OutputError(
                f"{folder}: expected an empty folder, found an earlier comparison; choose another with "
                "-o, or pass --overwrite"
            )


def _tell(name_a: str, pair: Pair, comparison: Comparison, folder: Path | None) -> None:
    """One screen: the evidence, where they differ, the conclusion."""
    out.print(f"\nA  {name_a}\nB  {pair.name_b}\n", soft_wrap=True)
    rows = [
        [
            f"{w.name}: {w.deciding.meaning}",
            *(f"{v:.3g} {w.deciding.unit}" for v in (w.deciding.before, w.deciding.after)),
            {"a": "A", "b": "B", "neither": "-"}[w.prefers],
        ]
        for w in comparison.witnesses
    ]
    out.print(table("", ["lower is better", "A", "B", "prefers"], rows))
    rows = []
    for local in comparison.stretches:
        stretch = local.stretch
        rows.append(
            [
                f"{stretch.first}-{stretch.last}",
                f"{stretch.max_distance_m:.3f} m",
                f"{stretch.max_angle_deg:.1f} deg",
                *local_in_words(local),
            ]
        )
    if rows:
        heads = [
            "frames that differ most",
            "apart by",
            "turned by",
            "matches, A / B",
            "wall, A / B",
        ]
        out.print()
        out.print(table("", heads, rows))
    axes = "the plan's axes" if comparison.axes == "plan" else "the scan's own axes"
    out.print(f"\ndistances in {axes}. {whole_in_words(comparison)}")
    for words in (*pair.notes, *comparison.notes):
        note(words)
    out.print(f"\n{conclusion(comparison)}")
    if folder is not None:
        out.print(f"\nwritten: {folder / PAGE}", soft_wrap=True)

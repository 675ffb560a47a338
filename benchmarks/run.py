"""Measure planfit and write the numbers down.

    python benchmarks/run.py [--only PART ...] [--fresh] [--out FILE]

Parts: step, reweight, solvers (GTSAM and g2o), scaling, descent (the paper's solver), real_scan, picture (the
real scan on a picture of its plan), without_planfit (Open3D), plan_pictures, real_plans,
real_drawings, metrics, throughput (3,000 frames from files to poses, rendered once; again with all of them as
keyframes), building (25,000 frames in 20 rooms, likewise, of 5,000 that are rendered once), plots.
A part replaces its own records in FILE and leaves the others; a part whose library or data is absent says so
and is left out.
Descents are kept between runs: `--fresh` makes them again (a few minutes each).
"""

import argparse
import dataclasses
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from records import Record

RESULTS = Path(__file__).parent / "results"


def descent_part(fresh: bool) -> list[Record]:
    import descent

    return descent.records(fresh)


def solvers_part(fresh: bool) -> list[Record]:  # noqa: ARG001
    import solver_race

    return solver_race.records()


def step_part(fresh: bool) -> list[Record]:  # noqa: ARG001
    import speed

    return speed.step_time_ratio()


def reweight_part(fresh: bool) -> list[Record]:  # noqa: ARG001
    import speed

    return speed.reweighting()


def scaling_part(fresh: bool) -> list[Record]:  # noqa: ARG001
    import scaling

    return scaling.records()


def real_scan_part(fresh: bool) -> list[Record]:  # noqa: ARG001
    import real_scan

    if not real_scan.DEFAULT.exists():
        print(f"real_scan: left out, {real_scan.DEFAULT} is absent (set PLANFIT_SHARED)")
        return []
    shipped, *own = _real_scan_rows(real_scan.__file__)
    (by_geometry,) = _real_scan_rows(
        real_scan.__file__, "--back-end", "geometry", "--seeds", "0"
    )  # fmt: skip
    errors = sorted(row["after_m"] for row in own)
    conditions = "ConSLAM scan, position RMS in the plan's frame, no alignment; "
    drifts = f"{len(own)} drifts of our own of the same size"
    return [
        Record(
            "real_scan_shipped_m",
            shipped["after_m"],
            "m",
            f"{conditions}as shipped, {shipped['before_m']:.3f} m before",
        ),
        Record("real_scan_shipped_aligned_m", shipped["aligned_m"], "m", "after rigid alignment"),
        Record(
            "real_scan_geometry_m",
            by_geometry["after_m"],
            "m",
            f"{conditions}as shipped, floor and walls without masks",
        ),
        Record(
            "real_scan_s",
            shipped["seconds"],
            "s",
            f"wall, with nothing kept; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}",
        ),
        Record("real_scan_peak_gb", shipped["peak_gb"], "GB", "peak resident memory of that run"),
        Record("real_scan_worst_m", errors[-1], "m", f"{conditions}worst of {drifts}"),
        Record("real_scan_median_m", errors[len(errors) // 2], "m", f"{conditions}of {drifts}"),
    ]


def _real_scan_rows(script: str, *arguments: str) -> list[dict]:
    """In a process of its own, for its memory."""
    with tempfile.TemporaryDirectory() as folder:
        rows_path = Path(folder) / "rows.json"
        command = [sys.executable, script, "--json", str(rows_path), *arguments]
        subprocess.run(command, check=True)
        return json.loads(rows_path.read_text())


def picture_part(fresh: bool) -> list[Record]:  # noqa: ARG001
    import alignment

    if not alignment.CONSLAM.exists():
        print(f"picture: left out, {alignment.CONSLAM} is absent (set PLANFIT_SHARED)")
        return []
    _, scale_off, apart_m = alignment.on_picture()
    conditions = "ConSLAM scan with a picture of its whole plan at an unknown scale"
    rms_m = float((apart_m**2).sum(axis=1).mean() ** 0.5)
    return [
        Record("picture_scale_off", abs(scale_off), "1", f"{conditions}; relative"),
        Record("picture_m", rms_m, "m", f"{conditions}; position RMS, no alignment to the truth"),
    ]


def without_planfit_part(fresh: bool) -> list[Record]:  # noqa: ARG001
    import without_planfit

    return without_planfit.records()


def plan_pictures_part(fresh: bool) -> list[Record]:  # noqa: ARG001
    import plan_pictures

    return [
        plan_pictures.time_large(),
        *plan_pictures.dense_ratios(),
        *plan_pictures.records(),
    ]


def real_plans_part(fresh: bool) -> list[Record]:  # noqa: ARG001
    import real_plans

    found = real_plans.records()
    if not found:
        print(f"real_plans: left out, {real_plans.SHARED} has none (set PLANFIT_SHARED)")
    return found


def real_drawings_part(fresh: bool) -> list[Record]:  # noqa: ARG001
    import real_drawings

    found = real_drawings.records()
    if not found:
        print(f"real_drawings: left out, {real_drawings.SHARED} has none (set PLANFIT_SHARED)")
    return found


def metrics_part(fresh: bool) -> list[Record]:  # noqa: ARG001
    with tempfile.TemporaryDirectory() as folder:
        rows_path = Path(folder) / "rows.json"
        script = Path(__file__).with_name("metrics.py")  # a process of its own, for its memory
        subprocess.run([sys.executable, script, "--json", str(rows_path)], check=True)
        return [Record(**row) for row in json.loads(rows_path.read_text())]


def throughput_part(fresh: bool) -> list[Record]:  # noqa: ARG001
    import inputs
    import throughput

    folder = inputs.CACHE / "throughput"
    return throughput.records(throughput.Arguments(folder=folder, all_frames=True))


def building_part(fresh: bool) -> list[Record]:  # noqa: ARG001
    import inputs
    import throughput

    return throughput.records(
        throughput.Arguments(
            folder=inputs.CACHE / "throughput", n_frames=25_000, n_rooms=20, n_rendered=5_000
        )
    )


EXTRAS = ("torch", "gtsam", "g2opy", "open3d")
PARTS: dict[str, Callable[[bool], list[Record]]] = {
    "step": step_part,
    "reweight": reweight_part,
    "solvers": solvers_part,
    "scaling": scaling_part,
    "descent": descent_part,
    "real_scan": real_scan_part,
    "picture": picture_part,
    "without_planfit": without_planfit_part,
    "plan_pictures": plan_pictures_part,
    "real_plans": real_plans_part,
    "real_drawings": real_drawings_part,
    "metrics": metrics_part,
    "throughput": throughput_part,
    "building": building_part,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=[*PARTS, "plots"])
    parser.add_argument("--fresh", action="store_true")
    parser.add_argument("--out", type=Path, default=RESULTS / "latest.json")
    arguments = parser.parse_args()
    chosen = arguments.only or [*PARTS, "plots"]
    for part in (name for name in PARTS if name in chosen):
        try:
            found = PARTS[part](arguments.fresh)
        except ImportError as error:
            # A name that is gone is a fault, not an extra. Open3D also needs the system's libraries.
            if (error.name or "open3d").split(".")[0] not in EXTRAS:
                raise
            print(f"{part}: left out, {error} (pip install -e '.[bench]')")
            continue
        today = time.strftime("%Y-%m-%d")
        rows = [{"part": part, **dataclasses.asdict(r), "date": today} for r in found]
        kept = [row for row in _read(arguments.out) if row["part"] != part] + rows
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(json.dumps(kept, indent=1) + "\n")
        for record in found:
            print(f"{record.name}: {record.value:.4g} {record.unit}\n    {record.conditions}")
    if "plots" in chosen:
        import plots

        plots.plot_all(_read(arguments.out), arguments.out.parent)


def _read(path: Path) -> list[dict]:
    return json.loads(path.read_text()) if path.exists() else []


if __name__ == "__main__":
    main()

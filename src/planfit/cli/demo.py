"""`planfit demo`: make a scan, drift it, refine it, compare with the truth."""

import shutil
import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import tyro
from jaxtyping import Float

from planfit.cli.arguments import Out
from planfit.cli.console import SHOWN_FROM_S, StageBars, note, out, table
from planfit.cli.refine import refine_into, tell_verdict
from planfit.cli.view import ViewArguments, open_session, serve
from planfit.errors import OutputError
from planfit.evaluation import position_errors, surface_metrics
from planfit.floorplan import read_floorplan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.result import RefineResult
from planfit.report.measures import TruthErrors
from planfit.saving import RunInputs
from planfit.scan import Scan, ScanOptions, read_scan, read_tum
from planfit.synth import CameraOptions, DriftOptions, SynthOptions, make_scan, write_facap
from planfit.units import in_units, quantity

DEMO_SCAN = SynthOptions(
    camera=CameraOptions(width_px=480, height_px=360),
    drift=DriftOptions(yaw_deg=0.25, translation_m=0.02),
)
_MARK = ".planfit-demo"


@dataclass(frozen=True)
class DemoArguments:
    """Make a synthetic scan of a synthetic building, drift its poses, refine them against its plan, and
    compare with the truth."""

    out: Out[Path] = Path("demo")
    """Folder for the scan and for the results; an earlier demo in it is replaced."""
    view: tyro.conf.FlagCreatePairsOff[bool] = False
    """Then show the run as `planfit view` does, to be corrected by hand; Ctrl-C ends."""
    port: int = 0
    """Port of that page; 0 takes one that is free."""
    no_browser: tyro.conf.FlagCreatePairsOff[bool] = False
    """Do not open that page in a browser; its address is printed either way."""
    workers: int = 2
    """Threads."""
    synth: SynthOptions = field(default_factory=lambda: DEMO_SCAN)
    """The building, the walk, the camera and the drift."""


def demo_command(arguments: DemoArguments) -> int:
    """Everything from nothing, through files, as a user's own scan would go."""
    begin = time.perf_counter()
    folder = arguments.out
    _make_way(folder)
    scan_folder, run_folder = folder / "scan", folder / "run"
    with StageBars() as bars:
        synthetic = make_scan(arguments.synth)
        write_facap(
            scan_folder,
            synthetic,
            lambda done, total: bars.update("render scan", done, total),
            arguments.workers,
        )
    rendered = time.perf_counter()
    scan = read_scan(scan_folder)
    floorplan = read_floorplan(scan_folder / "floorplan.npy")
    _, true_world_from_cams = read_tum(scan_folder / "groundtruth.tum")

    truth_of = partial(_truth_errors, scan, true_world_from_cams)
    inputs = RunInputs(scan, floorplan, RefineOptions(), ScanOptions())
    result = refine_into(run_folder, inputs, arguments.workers, True, truth_of, begun=rendered)
    errors = truth_of(result)
    metrics = surface_metrics(
        result.structure, floorplan, result.initial_plan_from_cams, result.plan_from_cams
    )
    walked = float(np.linalg.norm(np.diff(true_world_from_cams[:, :3, 3], axis=0), axis=1).sum())
    rows = [
        [
            "position error, RMS",
            *(in_units(e, ".3f") for e in (errors.before_rms_m, errors.after_rms_m)),
        ],
        *(
            [
                metric.meaning.strip(),
                *(quantity(v, metric.unit, ".1f") for v in (metric.before, metric.after)),
            ]
            for metric in metrics
            if metric.name in ("nsd", "floor_plane_rms")
        ),
    ]
    out.print()
    title = f"{len(scan)} frames, {in_units(walked, '.0f')} walked through a building with "
    title += f"{len(floorplan)} wall faces"
    out.print(table(title, ["", "before", "after"], rows))
    seconds = {"render scan": rendered - begin, **result.seconds_by_stage}
    stages = [[name, f"{value:.1f} s"] for name, value in seconds.items() if value > SHOWN_FROM_S]
    out.print()
    out.print(table("time per stage", ["", ""], stages))
    for warning in result.warnings:
        note(warning)
    tell_verdict(result.verdict)
    out.print(f"\n{time.perf_counter() - begin:.0f} s in all. Report: {run_folder / 'report.html'}")
    if arguments.view:
        out.print()
        shown = ViewArguments(run_folder, workers=arguments.workers)
        serve(open_session(shown), arguments.port, arguments.no_browser)
    return 0 if result.verdict.is_refined else 1


def _truth_errors(
    scan: Scan, true_world_from_cams: Float[np.ndarray, "n 4 4"], result: RefineResult
) -> TruthErrors:
    """Position errors before and after, in the scan's own axes."""
    before = position_errors(scan.world_from_cams, true_world_from_cams)
    after = position_errors(result.world_from_cams, true_world_from_cams)
    return TruthErrors(
        before_rms_m=before.rms_m,
        after_rms_m=after.rms_m,
        before_aligned_rms_m=before.aligned_rms_m,
        after_aligned_rms_m=after.aligned_rms_m,
        after_by_frame_m=np.linalg.norm(
            (result.world_from_cams - true_world_from_cams)[:, :3, 3], axis=1
        ),
    )


def _make_way(folder: Path) -> None:
    """Remove an earlier demo; anything else is left alone."""
    if folder.exists():
        if not (folder / _MARK).exists():
            raise OutputError(
                f"{folder}: expected no such folder or an earlier demo, found something else; "
                "choose another folder with -o"
            )
        shutil.rmtree(folder)
    try:
        folder.mkdir(parents=True)
        (folder / _MARK).touch()
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror})") from error

"""Everything that a run writes into its folder: poses, clouds, pictures, record, report (docs/outputs.md)."""

import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from planfit import __version__
from planfit.as_built import AS_BUILT, AsBuilt, compare_as_built, write_as_built
from planfit.errors import OptionError
from planfit.export.cloud import Cloud, Sampling, place_cloud, sample_clouds
from planfit.export.record import make_record
from planfit.export.tables import plain, scan_options_record, to_toml
from planfit.export.write import record_text, write_clouds, write_results
from planfit.findings import sentences_of
from planfit.floorplan import Floorplan
from planfit.pipeline.depth_unit import in_unit
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.result import RefineResult
from planfit.pipeline.together import TogetherResult
from planfit.report.html.page import Provenance, ReportOptions, make_report, provenance_now
from planfit.report.make_scene import make_pictures, make_scene
from planfit.report.measures import BeforeAfter, CloudXY, TruthErrors, measure
from planfit.report.plots.overlay import draw_overlay, draw_overlays
from planfit.report.plots.scan_view import at_camera_height
from planfit.report.scene import Scene
from planfit.runtime import Runtime, StageTimer, write_whole
from planfit.runtime.run_folder import RECORD, RunFolder
from planfit.scan import Scan, ScanOptions, calibrated_scan
from planfit.units import told_in

REPORT = "report.html"
SCANS = "scans"
"""Folder of what is written of each of several scans."""
VIEW_POINTS = 1_500_000
"""Of the 3D view, at most; each adds about 8 bytes to the page."""
VIEW_POINTS_OF_FRAME = 10_000
"""Of the 3D view, at most: a short scan shows its surfaces closed, and its page stays small."""
VIEW_PICTURES = 120
"""Frames whose images the report holds, evenly spread, about 15 kB each; of others the nearest is shown."""


@dataclass(frozen=True)
class RunInputs:
    """What a run was given, as its record tells it."""

    scan: Scan
    floorplan: Floorplan | dict[int, Floorplan] | None
    options: RefineOptions
    scan_options: ScanOptions
    cache: Path | None = None
    """The cache that it shared with others."""
    report: ReportOptions = field(default_factory=ReportOptions)
    """The report."""
    more: Mapping[str, str] = field(default_factory=dict)
    """What the record says of inputs besides."""
    scans: tuple[Scan, ...] = ()
    """Those that `scan` was joined of, and those that found no place."""
    made: Provenance = field(default_factory=provenance_now)
    """When, how and with what."""

    @property
    def names(self) -> dict[str, str]:
        """Paths and fingerprints of what is read: the folder of a run belongs to these."""
        read = self.scans or (self.scan,)
        scan = {
            "scan": " + ".join(str(Path(one.name).resolve()) for one in read),
            "scan_fingerprint": " + ".join(one.fingerprint for one in read),
        }
        if isinstance(self.floorplan, Floorplan):
            path = str(Path(self.floorplan.name).resolve())
            plan = {"plan": path, "plan_fingerprint": self.floorplan.fingerprint}
        elif self.floorplan:
            plans = sorted(self.floorplan.items())
            paths = " ".join(f"{number}={Path(one.name).resolve()}" for number, one in plans)
            prints = " ".join(one.fingerprint for _, one in plans)
            plan = {"plan": paths, "plan_fingerprint": prints}
        else:
            plan = {}
        return {**scan, **plan, **self.more}

    @property
    def plan_sha256(self) -> dict[str, str]:
        """Of the files of the plans that are there, by name."""
        plans = self.floorplan or {}
        names = [plans.name] if isinstance(plans, Floorplan) else [p.name for p in plans.values()]
        files = (Path(name) for name in names)
        return {f.name: sha256(f.read_bytes()).hexdigest() for f in files if f.is_file()}


@dataclass(frozen=True)
class RunViews:
    """What is sampled of the scan's images for the files of a run."""

    cloud: Cloud
    """Points of the frames that have a place, as the corrected sensor sees them."""
    scene: Scene | None
    """What the 3D view of the report shows; None where none is wanted."""
    as_built: AsBuilt | None = None
    """Verdicts on the walls of the plan; None where the scan has no place on one."""


def save_result(
    result: RefineResult | TogetherResult,
    folder: str | Path,
    *,
    overwrite: bool = False,
    runtime: Runtime | None = None,
) -> None:
    """Write a result as `planfit refine` does; see docs/outputs.md. What `save` of both kinds calls.

    Args:
        result: of `planfit.refine`, or of several scans together.
        folder: new, empty, or of an earlier run with the same scan and plan.
        overwrite: whether another run's results may be replaced.
        runtime: threads and progress of the point clouds.

    Raises:
        OptionError: the result does not know what it was made of.
        OutputError: the folder holds other files, is in use, or cannot be written.
        ScanError: a frame of the scan can no longer be read.
    """
    scans = tuple(each.scan for each in result.scans) if isinstance(result, TogetherResult) else ()
    made_of = _whole(result).made_of
    if made_of is None:
        raise OptionError(
            "save: expected a result of planfit.refine, found one that was put together otherwise; "
            "write its world_from_cams with planfit.scan.write_tum"
        )
    plans = made_of.floorplan
    given = plans if plans is None or isinstance(plans, Floorplan) else dict(plans)
    inputs = RunInputs(made_of.scan, given, made_of.options, ScanOptions(), scans=scans)
    with RunFolder.claimed(Path(folder), inputs.names, overwrite) as run:
        write_run(run, inputs, result, runtime or Runtime())


def write_run(
    run: RunFolder,
    inputs: RunInputs,
    result: RefineResult | TogetherResult,
    runtime: Runtime,
    errors: TruthErrors | None = None,
    timer: StageTimer | None = None,
) -> dict[str, float]:
    """Write all that a run writes, and give the seconds of all its stages.

    Of several scans what all came to, and into `scans/NAME` what a run of each alone writes, but its report.
    Poses, numbers and the overlay first: they stay where what needs the images once more, clouds and report,
    is interrupted or fails.
    """
    timer = timer or StageTimer(runtime)
    inputs = replace(inputs, made=replace(inputs.made, plan_sha256=inputs.plan_sha256))
    whole, more = _whole(result), {}
    if isinstance(result, TogetherResult):
        assert whole.made_of is not None
        inputs, more = replace(inputs, scan=whole.made_of.scan), _scans_record(result)
    timer.add(whole.seconds_by_stage)
    with timer.stage("write poses"), run.writing(to_come=[REPORT]) as staging:
        both = None if whole.floorplan is None else measure(whole.floorplan, whole)
        _write_numbers(staging, inputs, whole, both, more)
        if isinstance(result, TogetherResult):
            _write_scans(staging / SCANS, inputs, result, run.cache_dir)
    with timer.stage("write report"):
        views = _result_views(inputs, whole, runtime)
        with run.writing(has_begun=True) as staging:
            _write_views(staging, inputs, whole, both, views, errors)
            if isinstance(result, TogetherResult):
                shutil.copytree(run.path / SCANS, staging / SCANS)
                placed = [each.result for each in result.scans if each.result is not None]
                for own, each in zip(whole.scans, placed, strict=True):
                    cloud = views.cloud.of_frames(own.frames)
                    write_clouds(staging / SCANS / own.name, each, cloud)
    seconds = timer.all_seconds()
    record = json.loads((run.path / RECORD).read_text(encoding="utf-8"))
    write_whole(run.path / RECORD, record_text(record | {"seconds_by_stage": seconds}))
    return seconds


def _whole(result: RefineResult | TogetherResult) -> RefineResult:
    """The result of all scans."""
    return result.together if isinstance(result, TogetherResult) else result


def _write_numbers(
    staging: Path,
    inputs: RunInputs,
    result: RefineResult,
    both: BeforeAfter | None,
    more: dict[str, Any],
) -> None:
    """What is known of one result without its images, into an empty folder; `more` stands at the end of its
    record."""
    record = _record(inputs, result, inputs.cache) | {"report_options": plain(inputs.report)}
    record |= {"made": asdict(inputs.made), **more}
    write_results(staging, inputs.scan, result, record)
    if both is not None:
        _write_overlays(staging, result, both)


def _write_views(
    staging: Path,
    inputs: RunInputs,
    result: RefineResult,
    both: BeforeAfter | None,
    views: RunViews,
    errors: TruthErrors | None,
) -> None:
    """The rest of one result. Without a plan, the overlay shows the cloud."""
    write_clouds(staging, result, views.cloud)
    if both is None:
        both = measure(None, result, _seen_from_above(views.cloud, result))
        _write_overlays(staging, result, both)
    if views.as_built is not None:
        write_as_built(staging / AS_BUILT, views.as_built)
    text, shown = to_toml(inputs.options), (both, views.scene, views.as_built)
    report = make_report(
        inputs.scan.name, result.floorplan, result, text, errors, *shown, inputs.made
    )
    (staging / REPORT).write_text(report, encoding="utf-8")


def _write_overlays(staging: Path, result: RefineResult, both: BeforeAfter) -> None:
    for name, overlay in draw_overlays(result, both).items():
        (staging / name).write_bytes(overlay)


def _write_scans(folder: Path, inputs: RunInputs, result: TogetherResult, cache_dir: Path) -> None:
    """Files of each scan that has a place, but its clouds."""
    for each in result.scans:
        if each.result is None:
            continue
        target, floorplan = folder / each.name, each.result.floorplan
        target.mkdir(parents=True)
        alone = RunInputs(each.scan, inputs.floorplan, inputs.options, inputs.scan_options)
        record = _record(alone, each.result, inputs.cache or cache_dir)
        record["made"] = asdict(inputs.made)
        write_results(target, each.scan, each.result, record)
        overlay = draw_overlay(floorplan, measure(floorplan, each.result))
        (target / "overlay.png").write_bytes(overlay)


def _record(inputs: RunInputs, result: RefineResult, cache: Path | None) -> dict[str, Any]:
    """What every record of a run says."""
    names, floorplan = inputs.names, result.floorplan
    record = make_record(__version__, names, inputs.scan, floorplan, inputs.options, result)
    record["cache"] = None if cache is None else str(cache.resolve())
    record["scan_options"] = scan_options_record(inputs.scan_options)
    return record


@told_in("m")
def _scans_record(result: TogetherResult) -> dict[str, Any]:
    """What the record of a run says of its scans, also of those without a place."""
    frames = {own.name: [own.first, own.last] for own in result.together.scans}
    scans = [
        {
            "name": each.name,
            "path": str(Path(each.scan.name).resolve()),
            "frames": frames.get(each.name),
            "placed_by": each.placed_by,
            "without_place_because": ", and ".join(sentences_of(each.reasons)) or None,
            "verdict": None if each.result is None else each.result.verdict.outcome.value,
            "predicted_error_rms_m": None
            if each.result is None
            else each.result.evidence.predicted_rms_m,
            "folder": None if each.result is None else f"{SCANS}/{each.name}",
        }
        for each in result.scans
    ]
    return {"scans": scans, "pairs_between_scans": result.between_pairs}


def _result_views(inputs: RunInputs, result: RefineResult, runtime: Runtime) -> RunViews:
    """Sample the images once more, for the clouds and the report, and judge the walls of the plan."""
    scan, options, as_built = inputs.scan, inputs.report, _as_built(inputs, result)
    corrected = calibrated_scan(in_unit(scan, result.depth_unit), result.sensor)
    unplaced = result.evidence.unplaced
    samplings = [Sampling()]
    if options.has_view:
        samplings.append(Sampling(VIEW_POINTS, VIEW_POINTS_OF_FRAME))
    # Keyframes see what all frames see, and their images are all that a run opens.
    keys = result.solved_frame_idx
    clouds = sample_clouds(corrected, runtime, samplings, frame_idx=keys)
    cloud = clouds[0].without(unplaced)
    if not options.has_view:
        return RunViews(cloud, None, as_built)
    shown = clouds[1].without(unplaced).thinned(VIEW_POINTS)
    pictures = make_pictures(scan, result.plan_from_cams, VIEW_PICTURES, runtime)
    points = (shown.points_cam, shown.colors, shown.start)
    scene = make_scene(scan, result, *points, pictures, as_built)
    return RunViews(cloud, scene, as_built)


def _as_built(inputs: RunInputs, result: RefineResult) -> AsBuilt | None:
    """Verdicts on the walls of the plan; None where the scan has no place on one."""
    if result.floorplan is None or result.alignment is None:
        return None
    return compare_as_built(result, inputs.report.as_built)


def _seen_from_above(cloud: Cloud, result: RefineResult) -> CloudXY:
    """Points of the cloud at camera height, before and after, for plots without a plan."""
    before, after = (
        place_cloud(cloud, poses)
        for poses in (result.initial_plan_from_cams, result.plan_from_cams)
    )
    is_shown = at_camera_height(result.plan_from_cams[:, :3, 3], after)
    return before[is_shown, :2], after[is_shown, :2]

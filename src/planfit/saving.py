"""Everything that a run writes into its folder: poses, clouds, pictures, record, report (docs/outputs.md)."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from planfit import __version__
from planfit.as_built import AS_BUILT, AsBuilt, compare_as_built, write_as_built
from planfit.errors import OptionError
from planfit.export import make_record, sample_cloud, write_results
from planfit.export.cloud import Cloud, place_cloud
from planfit.export.option_files import scan_options_record, to_toml
from planfit.floorplan import Floorplan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.result import RefineResult
from planfit.report import (
    ReportOptions,
    Scene,
    TruthErrors,
    draw_overlays,
    make_pictures,
    make_report,
    make_scene,
)
from planfit.report.measures import CloudXY
from planfit.report.plots.scan_view import at_camera_height
from planfit.run_folder import RunFolder
from planfit.runtime import Runtime
from planfit.scan import Scan, ScanOptions, calibrated_scan

VIEW_POINTS_OF_FRAME = 10_000
"""Of the 3D view, at most: a short scan shows its surfaces closed, and its page stays small."""


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

    @property
    def names(self) -> dict[str, str]:
        """Paths and fingerprints of what is read: the folder of a run belongs to these."""
        path = str(Path(self.scan.name).resolve())
        scan = {"scan": path, "scan_fingerprint": self.scan.fingerprint}
        return {**scan, **plan_inputs(self.floorplan), **self.more}


@dataclass(frozen=True)
class RunViews:
    """What is sampled of the scan's images for the files of a run."""

    cloud: Cloud
    """Points of the frames that have a place, as the corrected sensor sees them."""
    scene: Scene | None
    """What the 3D view of the report shows; None where none is wanted."""
    as_built: AsBuilt | None = None
    """Verdicts on the walls of the plan; None where the scan has no place on one."""


def plan_inputs(floorplan: Floorplan | dict[int, Floorplan] | None) -> dict[str, str]:
    """What a record says of the plans that a run reads."""
    if floorplan is None:
        return {}
    if isinstance(floorplan, Floorplan):
        path = str(Path(floorplan.name).resolve())
        return {"plan": path, "plan_fingerprint": floorplan.fingerprint}
    plans = sorted(floorplan.items())
    return {
        "plan": " ".join(f"{number}={Path(plan.name).resolve()}" for number, plan in plans),
        "plan_fingerprint": " ".join(plan.fingerprint for _, plan in plans),
    }


def save_result(
    result: RefineResult,
    folder: str | Path,
    *,
    overwrite: bool = False,
    runtime: Runtime | None = None,
) -> None:
    """Write a result as `planfit refine` does; see docs/outputs.md. What `RefineResult.save` calls.

    Args:
        result: of `planfit.refine`.
        folder: new, empty, or of an earlier run with the same scan and plan.
        overwrite: whether another run's results may be replaced.
        runtime: threads and progress of the point clouds.

    Raises:
        OptionError: the result does not know what it was made of.
        OutputError: the folder holds other files, is in use, or cannot be written.
        ScanError: a frame of the scan can no longer be read.
    """
    made_of = result.made_of
    if made_of is None:
        raise OptionError(
            "save: expected a result of planfit.refine, found one that was put together otherwise; "
            "write its world_from_cams with planfit.scan.write_tum"
        )
    plans = made_of.floorplan
    given = plans if plans is None or isinstance(plans, Floorplan) else dict(plans)
    inputs = RunInputs(made_of.scan, given, made_of.options, ScanOptions())
    runtime = runtime or Runtime()
    with RunFolder.claimed(Path(folder), inputs.names, overwrite) as run:
        views = result_views(inputs, result, runtime)
        with run.writing() as staging:
            write_run(staging, inputs, result, views)


def result_views(inputs: RunInputs, result: RefineResult, runtime: Runtime) -> RunViews:
    """Sample the images once more, for the clouds and the report, and judge the walls of the plan."""
    scan, options, as_built = inputs.scan, inputs.report, _as_built(inputs, result)
    corrected, unplaced = calibrated_scan(scan, result.sensor), result.evidence.unplaced
    # Keyframes see what all frames see, and their images are all that a run opens.
    sample = partial(sample_cloud, corrected, runtime, frame_idx=result.solved_frame_idx)
    cloud = sample().without(unplaced)
    if not options.has_view:
        return RunViews(cloud, None, as_built)
    sampled = sample(max_points=options.max_points, max_per_frame=VIEW_POINTS_OF_FRAME)
    shown = sampled.without(unplaced).thinned(options.max_points)
    pictures = make_pictures(scan, result.plan_from_cams, options.max_pictures, runtime)
    points = (shown.points_cam, shown.colors, shown.start)
    scene = make_scene(scan, result, *points, pictures, as_built)
    return RunViews(cloud, scene, as_built)


def write_run(
    staging: Path,
    inputs: RunInputs,
    result: RefineResult,
    views: RunViews,
    errors: TruthErrors | None = None,
) -> None:
    """Write all of it into an empty folder.

    Args:
        staging: the folder.
        inputs: what the run was given.
        result: what it found.
        views: from `result_views`.
        errors: against true poses, where these are known, for the report.
    """
    scan, options = inputs.scan, inputs.options
    record = make_record(__version__, inputs.names, scan, result.floorplan, options, result)
    record["cache"] = None if inputs.cache is None else str(inputs.cache.resolve())
    record["scan_options"] = scan_options_record(inputs.scan_options)
    write_results(staging, scan, result, record, views.cloud)
    seen = _seen_from_above(views.cloud, result)
    for name, overlay in draw_overlays(result, seen).items():
        (staging / name).write_bytes(overlay)
    if views.as_built is not None:
        write_as_built(staging / AS_BUILT, views.as_built)
    text, shown = to_toml(options), (seen, views.scene, views.as_built)
    report = make_report(scan.name, result.floorplan, result, text, errors, *shown)
    (staging / "report.html").write_text(report, encoding="utf-8")


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

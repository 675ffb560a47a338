"""`planfit refine`: from files to files."""

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from planfit.cli.arguments import AlignmentFlags, PlanFlags
from planfit.cli.console import StageBars, err, note, out, table, tell_scan
from planfit.cli.storeys import read_plans, tell_storeys
from planfit.cli.survey import SurveyFlags, tell_survey
from planfit.corrections import NO_CORRECTIONS, Corrections, read_corrections
from planfit.errors import FloorplanError, require
from planfit.floorplan import Floorplan, read_floorplan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.refine import refine
from planfit.pipeline.result import RefineResult
from planfit.pipeline.verdict import Outcome, Verdict
from planfit.report.key_metrics import TruthErrors
from planfit.report.options import ReportOptions
from planfit.report.provenance import provenance_now
from planfit.runtime import Runtime
from planfit.runtime.run_folder import RunFolder
from planfit.saving import RunInputs, result_views, write_run
from planfit.scan import Scan, ScanOptions, read_scan
from planfit.survey import Survey


@dataclass(frozen=True)
class RefineArguments:
    """Refine the camera poses of a scan so that its reconstruction agrees with the floorplan; or, with
    --no-plan, with itself."""

    scan: tyro.conf.Positional[tuple[Path, ...]]
    """Folder of the scan, zip archive of one, or bag; several of one storey are refined together."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder for the results."""
    plan: Annotated[
        tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="[NUMBER=]FILE")
    ] = ()
    """Floorplan; by default the one inside the scan's folder. Of a walk through several storeys, that of each
    by its number: `--plan 0=ground.pdf --plan 1=first.pdf`."""
    no_plan: tyro.conf.FlagCreatePairsOff[bool] = False
    """Refine without a plan, even if the scan's folder holds one: by closed loops, floors, ceilings alone."""
    preset: str = "default"
    """Options to begin with: `default`, what works best, or `paper`, the published method to the letter."""
    scan_options: Annotated[ScanOptions, tyro.conf.arg(name="")] = field(
        default_factory=ScanOptions
    )
    plan_flags: Annotated[PlanFlags, tyro.conf.arg(name="")] = field(default_factory=PlanFlags)
    alignment_flags: Annotated[AlignmentFlags, tyro.conf.arg(name="")] = field(
        default_factory=AlignmentFlags
    )
    survey_flags: Annotated[SurveyFlags, tyro.conf.arg(name="")] = field(
        default_factory=SurveyFlags
    )
    corrections: Path | None = None
    """TOML file of corrections by hand (docs/corrections.md): places, loops, frames, walls."""
    without_contradicted: tyro.conf.FlagCreatePairsOff[bool] = False
    """Leave out corrections that others or the scan contradict, and solve again without them; else they are
    used, as far as they can be, and named."""
    config: Path | None = None
    """TOML file of options, on top of the preset and overruled by flags."""
    overwrite: bool = False
    """Replace the results of another run in the output folder."""
    cache: Path | None = None
    """Folder that keeps finished stages, which runs may share, also at the same time; else OUT/cache."""
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Threads."""
    report: ReportOptions = field(default_factory=ReportOptions)
    """The report."""
    options: Annotated[RefineOptions, tyro.conf.arg(name="")] = field(default_factory=RefineOptions)


@dataclass(frozen=True)
class HandChoice:
    """Corrections by hand, and what becomes of those that something contradicts."""

    corrections: Corrections = NO_CORRECTIONS
    without_contradicted: bool = False


NOTHING_BY_HAND = HandChoice()


def refine_command(arguments: RefineArguments) -> int:
    """Read, refine, write, summarise. Exit code 0 where the verdict is "refined", 1 where it has
    reservations or the result is no better than the input."""
    if len(arguments.scan) > 1:
        from planfit.cli.together import refine_together_files

        return 0 if refine_together_files(arguments).is_refined else 1
    return exit_code(refine_files(arguments).verdict)


def refine_files(
    arguments: RefineArguments, more_inputs: Mapping[str, str] | None = None
) -> RefineResult:
    """Read, refine, write, summarise; `more_inputs` stand among the inputs in the record."""
    begin = time.perf_counter()
    # Before anything that takes time: a bad file is told at once.
    corrections = NO_CORRECTIONS
    if arguments.corrections is not None:
        corrections = read_corrections(arguments.corrections)
    scan = read_scan(
        _only_scan(arguments), arguments.options.segmentation.reads_masks, arguments.scan_options
    )
    floorplan = read_plan(arguments, scan)
    survey = arguments.survey_flags.read(scan, floorplan is not None)
    result = refine_into(
        arguments.out,
        scan,
        floorplan,
        arguments.alignment_flags.added_to(arguments.options),
        arguments.workers,
        arguments.overwrite,
        scan_options=arguments.scan_options,
        more_inputs={**(more_inputs or {}), **arguments.survey_flags.inputs},
        report_options=arguments.report,
        cache=arguments.cache,
        survey=survey,
        by_hand=HandChoice(corrections, arguments.without_contradicted),
    )
    summarise(arguments.out, scan, floorplan, result, time.perf_counter() - begin)
    return result


def _only_scan(arguments: RefineArguments) -> Path:
    require(
        len(arguments.scan) == 1,
        "refine: expected SCAN -o OUT, found no SCAN; 'planfit refine --help' tells more",
    )
    return arguments.scan[0]


def read_plan(arguments: RefineArguments, scan: Scan) -> Floorplan | dict[int, Floorplan] | None:
    """The plan to refine against, or those of storeys; None where the user wants none."""
    if arguments.no_plan:
        require(
            not arguments.plan
            and arguments.plan_flags == PlanFlags()
            and arguments.alignment_flags == AlignmentFlags(),
            "--no-plan: expected no flags of a plan beside it, found some; leave out one or the other",
        )
        return None
    if arguments.plan:
        return read_plans(arguments.plan, arguments.plan_flags.options)
    if scan.floorplan_path is None:
        raise FloorplanError(
            f"{scan.name}: expected a floorplan inside the scan's folder, found none; "
            "give one with --plan FILE, or refine by closed loops and floor alone with --no-plan"
        )
    return read_floorplan(scan.floorplan_path, arguments.plan_flags.options)


def refine_into(
    folder: Path,
    scan: Scan,
    floorplan: Floorplan | dict[int, Floorplan] | None,
    options: RefineOptions,
    workers: int,
    overwrite: bool,
    truth_of: Callable[[RefineResult], TruthErrors] | None = None,
    scan_options: ScanOptions | None = None,
    more_inputs: Mapping[str, str] | None = None,
    report_options: ReportOptions | None = None,
    cache: Path | None = None,
    survey: Survey | None = None,
    by_hand: HandChoice = NOTHING_BY_HAND,
) -> RefineResult:
    """Refine a scan and write everything a run writes; see docs/outputs.md.

    `truth_of` gives the errors of a result against true poses, where they are known, for the report.
    `scan_options` are those that the scan was read with, for the record, and `more_inputs` stand there beside
    the fingerprints. `report_options`: by default, all of a report. `cache` takes the place of the folder's
    own. `survey` are control and check points. `by_hand`: corrections, and whether contradicted ones are left
    out.
    """
    inputs = RunInputs(
        scan,
        floorplan,
        options,
        scan_options or ScanOptions(),
        cache,
        report_options or ReportOptions(),
        more_inputs or {},
        made=provenance_now(out.speech.command),
    )
    with RunFolder.claimed(folder, inputs.names, overwrite) as run, StageBars() as bars:
        runtime = Runtime(workers, cache or run.cache_dir, bars.update)
        result = refine(
            scan,
            floorplan,
            options,
            runtime,
            survey=survey,
            corrections=by_hand.corrections,
            without_contradicted=by_hand.without_contradicted,
        )
        seen = result_views(inputs, result, runtime)
        with run.writing() as staging:
            bars.update("write results", 0, 0)
            write_run(staging, inputs, result, seen, truth_of(result) if truth_of else None)
        bars.update("write results", 1, 0)
    return result


def summarise(
    folder: Path,
    scan: Scan,
    floorplan: Floorplan | dict[int, Floorplan] | None,
    result: RefineResult,
    seconds: float,
) -> None:
    """One screen: what changed, the warnings, where the rest is."""
    rows = []
    for check in result.checks:
        rows.append([check.name, *(_amount(v, check.unit) for v in (check.before, check.after))])
    out.print()
    plan_name = "none: loops, floor and ceilings alone"
    if result.floorplan is not None:
        plan_name = result.floorplan.name
    out.print(f"scan {scan.name}\nplan {plan_name}\n", soft_wrap=True)
    out.print(table("", ["", "before", "after"], rows))
    matches, adjustment = result.matches, result.adjustment
    found = "" if floorplan is None else (
        f"{adjustment.association.n_associated} of {len(result.structure.walls)} wall patches on the plan, "
    )  # fmt: skip
    n_keyframes = len(result.solved_frame_idx)
    keys = f" ({n_keyframes} keyframes)" if n_keyframes < len(scan) else ""
    out.print(
        f"\n{len(scan)} frames{keys}, {matches.n_matches} matches in {len(matches.pairs)} pairs, "
        f"{found}labels from {result.structure.back_end}"
    )
    if len(result.surfaces):
        out.print(result.surfaces.finding.sentence)
    stages = ", ".join(f"{name} {s:.1f}" for name, s in result.seconds_by_stage.items() if s > 0.05)
    out.print(f"{seconds:.1f} s: {stages}")
    alignment = result.alignment
    if result.storeys is not None:
        tell_storeys(result.storeys)
    if alignment is not None and isinstance(floorplan, Floorplan) and not floorplan.is_metric:
        out.print(
            f"the plan's unit was found to be {alignment.metres_per_unit:.5g} m, within "
            f"{alignment.scale_sigma:.2%} (one standard deviation)"
        )
    if result.survey is not None:
        tell_survey(result.survey)
    tell_scan(scan)
    if result.by_hand is not None:
        out.print(result.by_hand.sentence)
    for warning in result.warnings:
        note(warning)
    tell_verdict(result.verdict)
    out.print(f"report: {folder / 'report.html'}", soft_wrap=True)


def tell_verdict(verdict: Verdict) -> None:
    """The outcome, why, which frames are less sure, and what to do."""
    color = {Outcome.REFINED: "green", Outcome.IMPROVED: "yellow", Outcome.NO_BETTER: "red"}
    out.print(f"\n{verdict.headline}", style=color[verdict.outcome])
    for reason in verdict.further_reasons:
        out.print(f"  {reason}")
    for reservation in verdict.further_reservations:
        out.print(f"  {reservation.words}; {reservation.advice}")
    if not verdict.is_refined:
        err.print(f"planfit: {verdict.outcome.value}: {verdict.advice}", soft_wrap=True)


def exit_code(verdict: Verdict) -> int:
    """0 for a result to be used as it is, 1 for one that is not."""
    return 0 if verdict.is_refined else 1


def _amount(value: float, unit: str) -> str:
    return f"{value:.0%}" if unit == "share" else f"{value:.3g} {unit}"

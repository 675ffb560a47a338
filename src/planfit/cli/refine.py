"""`planfit refine`: from files to files, and what is said of the run."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from planfit.cli.arguments import SurveyFlags
from planfit.cli.console import COMPILED, SHOWN_FROM_S, StageBars, err, note, out, table, tell_scan
from planfit.cli.refine_inputs import RefineArguments as RefineArguments
from planfit.cli.refine_inputs import read_plan, read_scans
from planfit.compiled.making import compile_what_is_not_ready
from planfit.corrections import NO_CORRECTIONS, Corrections, read_corrections
from planfit.errors import require
from planfit.findings import frame_ranges
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.pipeline.on_plan import Storeys
from planfit.pipeline.refine import refine
from planfit.pipeline.result import RefineResult
from planfit.pipeline.together import TogetherResult, refine_together
from planfit.pipeline.verdict import Outcome, Verdict
from planfit.report.formatting import length
from planfit.report.html.page import provenance_now
from planfit.report.measures import TruthErrors
from planfit.runtime import Runtime, StageTimer
from planfit.runtime.run_folder import RunFolder
from planfit.saving import RunInputs, write_run
from planfit.scan import Scan
from planfit.scan.joined import short_names
from planfit.scan.views import decoded_once
from planfit.survey import RoleResiduals, Survey, SurveyResiduals
from planfit.units import in_units, quantity

AnyResult = TypeVar("AnyResult", RefineResult, TogetherResult)


@dataclass(frozen=True)
class HandChoice:
    """Corrections by hand, and what becomes of those that something contradicts."""

    corrections: Corrections = NO_CORRECTIONS
    without_contradicted: bool = False


NOTHING_BY_HAND = HandChoice()


def refine_command(arguments: RefineArguments) -> int:
    """Read, refine, write, summarise. Exit code 0 where the verdict is "refined", 1 where it has
    reservations or the result is no better than the input."""
    arguments = arguments.with_plan_among_scans()
    if len(arguments.scan) > 1:
        return 0 if _refine_together_files(arguments).is_refined else 1
    return 0 if refine_files(arguments).verdict.is_refined else 1


def refine_files(
    arguments: RefineArguments, more_inputs: Mapping[str, str] | None = None
) -> RefineResult:
    """Read, refine, write, summarise; `more_inputs` stand among the inputs in the record."""
    begin = time.perf_counter()
    require(
        len(arguments.scan) == 1,
        "refine: expected SCAN -o OUT, found no SCAN; 'planfit refine --help' tells more",
    )
    # Before anything that takes time: a bad file is told at once.
    corrections = NO_CORRECTIONS
    if arguments.corrections is not None:
        corrections = read_corrections(arguments.corrections)
    (scan,) = read_scans(arguments)
    floorplan = read_plan(arguments, scan)
    survey = arguments.survey_flags.read(scan, floorplan is not None)
    more = {**(more_inputs or {}), **arguments.survey_flags.inputs}
    options = arguments.alignment_flags.added_to(arguments.options)
    inputs = RunInputs(
        scan, floorplan, options, arguments.scan_options, arguments.cache, arguments.report, more
    )
    by_hand = HandChoice(corrections, arguments.without_contradicted)
    where = (arguments.out, inputs, arguments.workers, arguments.overwrite)
    result = refine_into(*where, survey=survey, by_hand=by_hand, begun=begin)
    summarise(arguments.out, scan, floorplan, result)
    return result


def _refine_together_files(arguments: RefineArguments) -> TogetherResult:
    """Read all scans, refine them together, write, summarise.

    Raises:
        ScanError: scans cannot be read: all of them are named, before anything that takes time.
        OptionError: flags were given that are for one scan.
    """
    begin = time.perf_counter()
    require(
        arguments.corrections is None
        and arguments.survey_flags == SurveyFlags()
        and arguments.scan_options.poses is None,
        "--corrections, --poses and flags of control points: expected one scan, found "
        f"{len(arguments.scan)}; give them to a run of that scan alone",
    )
    scans = read_scans(arguments)
    short_names(scans)  # a scan that is given twice is told before the plan is read
    plan_of = next((scan for scan in scans if scan.floorplan_path is not None), scans[0])
    floorplan = read_plan(arguments, plan_of)
    require(
        not isinstance(floorplan, dict),
        "--plan: expected one plan for several scans, found plans by storey; refine the scans of each storey "
        "together, one storey after the other",
    )
    assert not isinstance(floorplan, dict)
    options = arguments.alignment_flags.added_to(arguments.options)
    inputs = RunInputs(
        scans[0], floorplan, options, arguments.scan_options, arguments.cache, arguments.report,
        scans=tuple(scans),
    )  # fmt: skip

    def solve(runtime: Runtime) -> TogetherResult:
        return refine_together(kept, floorplan, options, runtime)

    with decoded_once(scans) as kept:
        where = (arguments.out, inputs, arguments.workers, arguments.overwrite)
        result, seconds = _solved_into(*where, solve, begin)
    result = replace(result, together=replace(result.together, seconds_by_stage=seconds))
    summarise_together(arguments.out, result)
    return result


def refine_into(
    folder: Path,
    inputs: RunInputs,
    workers: int,
    overwrite: bool,
    truth_of: Callable[[RefineResult], TruthErrors] | None = None,
    survey: Survey | None = None,
    by_hand: HandChoice = NOTHING_BY_HAND,
    begun: float | None = None,
) -> RefineResult:
    """Refine a scan and write everything a run writes; see docs/outputs.md.

    Args:
        folder: of the run.
        inputs: the scan, the plan, the options, and what the record says besides.
        workers: threads.
        overwrite: whether another run's results may be replaced.
        truth_of: gives the errors of a result against true poses, where they are known, for the report.
        survey: control and check points.
        by_hand: corrections, and whether contradicted ones are left out.
        begun: when reading began, by `time.perf_counter`; without, the time of reading is not told.
    """

    def solve(runtime: Runtime) -> RefineResult:
        return refine(
            inputs.scan,
            inputs.floorplan,
            inputs.options,
            runtime,
            survey=survey,
            corrections=by_hand.corrections,
            without_contradicted=by_hand.without_contradicted,
        )

    with decoded_once([inputs.scan]) as (scan,):
        inputs = replace(inputs, scan=scan)
        result, seconds = _solved_into(folder, inputs, workers, overwrite, solve, begun, truth_of)
    return replace(result, seconds_by_stage=seconds)


def _solved_into(
    folder: Path,
    inputs: RunInputs,
    workers: int,
    overwrite: bool,
    solve: Callable[[Runtime], AnyResult],
    begun: float | None,
    truth_of: Callable[[AnyResult], TruthErrors] | None = None,
) -> tuple[AnyResult, dict[str, float]]:
    """Claim the folder, solve, and write the result; the seconds of all stages, too."""
    inputs = replace(inputs, made=provenance_now(out.speech.command))
    with RunFolder.claimed(folder, inputs.names, overwrite) as run, StageBars() as bars:
        runtime = Runtime(workers, inputs.cache or run.cache_dir, bars.update)
        timer = StageTimer(runtime, begun)
        begin = time.perf_counter()
        if compile_what_is_not_ready(runtime.report):
            timer.add({"compile": time.perf_counter() - begin})
            err.print(COMPILED)
        result = solve(runtime)
        errors = truth_of(result) if truth_of else None
        return result, write_run(run, inputs, result, runtime, errors, timer)


def summarise(
    folder: Path,
    scan: Scan,
    floorplan: Floorplan | dict[int, Floorplan] | None,
    result: RefineResult,
) -> None:
    """One screen: what changed, the warnings, where the rest is."""
    rows = []
    for check in result.checks:
        rows.append([check.name, *(_amount(v, check.unit) for v in (check.before, check.after))])
    name = result.floorplan.name if result.floorplan else "none: loops, floor and ceilings alone"
    out.print(f"\nscan {scan.name}\nplan {name}\n", soft_wrap=True)
    out.print(table("", ["", "before", "after"], rows))
    matches, adjustment = result.matches, result.adjustment
    found = "" if floorplan is None else (
        f"{adjustment.association.n_associated} of {len(result.structure.walls)} wall patches on the plan, "
    )  # fmt: skip
    n_keyframes = len(result.solved_frame_idx)
    keys = f" ({n_keyframes} keyframes)" if n_keyframes < len(scan) else ""
    out.print(
        f"\n{len(scan)} frames{keys}, {matches.n_matches} matches in {len(matches.pairs)} pairs, "
        f"{found}floor and walls from {result.structure.back_end}"
    )
    if len(result.surfaces):
        out.print(result.surfaces.finding.sentence)
    _tell_seconds(result)
    alignment = result.alignment
    if result.storeys is not None:
        _tell_storeys(result.storeys)
    if alignment is not None and isinstance(floorplan, Floorplan) and not floorplan.is_metric:
        out.print(
            f"the plan's unit was found to be {alignment.metres_per_unit:.5g} m, within "
            f"{alignment.scale_sigma:.2%} (one standard deviation)"
        )
    if result.survey is not None:
        _tell_survey(result.survey)
    _tell_end(folder, scan, result)


def summarise_together(folder: Path, result: TogetherResult) -> None:
    """One screen: the scans and their places, the warnings, where the rest is."""
    together, rows = result.together, []
    for each in result.scans:
        outcome, error = "", ""
        if each.result is not None:
            outcome = each.result.verdict.outcome.value
            error = length(each.result.evidence.predicted_rms_m)
        rows.append([each.name, str(len(each.scan)), each.placed_by or "no place", outcome, error])
    name = together.floorplan.name if together.floorplan else "none: the scans alone"
    out.print(f"\nplan {name}\n", soft_wrap=True)
    heads = ["frames", "placed by", "verdict", "expected error"]
    out.print(table("", ["scan", *heads], rows))
    out.print(
        f"\n{len(together.plan_from_cams)} frames with a place, {together.matches.n_matches} matches in "
        f"{len(together.matches.pairs)} pairs, {result.between_pairs} of them between scans"
    )
    _tell_seconds(together)
    _tell_end(folder, None if together.made_of is None else together.made_of.scan, together)


def _tell_seconds(result: RefineResult) -> None:
    """Seconds in all, and of each stage."""
    by_stage = result.seconds_by_stage
    stages = ", ".join(f"{name} {s:.1f}" for name, s in by_stage.items() if s > SHOWN_FROM_S)
    out.print(f"{sum(by_stage.values()):.1f} s: {stages}")


def _tell_end(folder: Path, scan: Scan | None, result: RefineResult) -> None:
    """Warnings, verdict, where the report is."""
    if scan is not None:
        tell_scan(scan)
    if result.by_hand is not None:
        out.print(result.by_hand.sentence)
    for warning in result.warnings:
        note(warning)
    tell_verdict(result.verdict)
    out.print(f"report: {folder / 'report.html'}", soft_wrap=True)


def _tell_storeys(storeys: Storeys) -> None:
    """A line a storey: its floor, its frames, and where its plan lies."""
    for storey in reversed(storeys.walked):
        lies = ""
        if storey.own is not None:
            x, y, _ = storey.own.plan_from_own[:3, 3]
            yaw_deg = se3.wrapped_deg(float(se3.yaw_of(storey.own.plan_from_own)))
            lies = f", its plan turned by {yaw_deg:.2f} deg and moved by ({x:.2f}, {y:.2f}) m"
            if storey.own.shares_axes:
                lies = ", its plan as drawn, in shared axes"
        out.print(
            f"{storey.name}: floor at {in_units(storey.floor_m)}, frames {frame_ranges(storey.frames)}{lies}",
            soft_wrap=True,
        )


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


def _amount(value: float, unit: str) -> str:
    return f"{value:.0%}" if unit == "share" else quantity(value, unit, ".3g")


def _tell_survey(survey: SurveyResiduals) -> None:
    """Control and check points, a line each."""
    for name, role in (("control", survey.control), ("check", survey.check)):
        if role is not None:
            out.print(_role_words(name, role))
    if survey.check is None:
        out.print(
            "no check points: how well control points fit says nothing of places between them"
        )


def _role_words(name: str, role: RoleResiduals) -> str:
    """Residuals in one line."""
    points = "point" if role.count == 1 else "points"
    height = (
        "" if role.rms_height_m is None else f", height {in_units(role.rms_height_m, '.3f', '')}"
    )
    return (
        f"{role.count} {name} {points}: residual {in_units(role.rms_m, '.3f')} RMS (horizontal "
        f"{in_units(role.rms_horizontal_m, '.3f', '')}{height}), worst "
        f"{in_units(role.worst_m, '.3f')} at {role.worst_id}"
    )

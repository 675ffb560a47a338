"""`planfit refine A B C`: several scans of one building."""

import time
from dataclasses import replace

from planfit.cli.console import StageBars, note, out, table, tell_scan
from planfit.cli.refine import RefineArguments, read_plan, tell_verdict
from planfit.cli.survey import SurveyFlags
from planfit.errors import ScanError, require
from planfit.floorplan import Floorplan
from planfit.pipeline.together import TogetherResult, refine_together
from planfit.report.options import provenance_now
from planfit.runtime import Runtime
from planfit.runtime.run_folder import RunFolder
from planfit.saving import RunInputs, result_views, write_together
from planfit.scan import Scan, read_scan
from planfit.scan.joined import short_names


def refine_together_files(arguments: RefineArguments) -> TogetherResult:
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
    scans = _read(arguments)
    short_names(scans)  # a scan that is given twice is told before the plan is read
    plan_of = next((scan for scan in scans if scan.floorplan_path is not None), scans[0])
    floorplan = read_plan(arguments, plan_of)
    require(
        not isinstance(floorplan, dict),
        "--plan: expected one plan for several scans, found plans by storey; refine the scans of each storey "
        "together, one storey after the other",
    )
    assert floorplan is None or isinstance(floorplan, Floorplan)
    result = _refine_into(arguments, scans, floorplan)
    _summarise(arguments, result, time.perf_counter() - begin)
    return result


def _read(arguments: RefineArguments) -> list[Scan]:
    scans, errors = [], []
    for path in arguments.scan:
        try:
            scans.append(
                read_scan(
                    path,
                    arguments.options.segmentation.reads_masks,
                    arguments.scan_options,
                )
            )
        except ScanError as error:
            errors.append(error)
    if len(errors) == 1:
        raise errors[0]
    if errors:
        raise ScanError("; ".join(str(error) for error in errors))
    return scans


def _refine_into(
    arguments: RefineArguments, scans: list[Scan], floorplan: Floorplan | None
) -> TogetherResult:
    options = arguments.alignment_flags.added_to(arguments.options)
    inputs = RunInputs(
        scans[0],
        floorplan,
        options,
        arguments.scan_options,
        arguments.cache,
        arguments.report,
        scans=tuple(scans),
        made=provenance_now(out.speech.command),
    )
    claimed = RunFolder.claimed(arguments.out, inputs.names, arguments.overwrite)
    with claimed as run, StageBars() as bars:
        runtime = Runtime(arguments.workers, arguments.cache or run.cache_dir, bars.update)
        result = refine_together(scans, floorplan, options, runtime)
        made_of = result.together.made_of
        assert made_of is not None
        inputs = replace(inputs, scan=made_of.scan)
        views = result_views(inputs, result.together, runtime)
        with run.writing() as staging:
            bars.update("write results", 0, 0)
            write_together(staging, inputs, result, views, run.cache_dir)
        bars.update("write results", 1, 0)
    return result


def _summarise(arguments: RefineArguments, result: TogetherResult, seconds: float) -> None:
    """One screen: the scans and their places, the warnings, where the rest is."""
    together, rows = result.together, []
    for each in result.scans:
        outcome, error = "", ""
        if each.result is not None:
            outcome = each.result.verdict.outcome.value
            error = f"{each.result.evidence.predicted_rms_m:.2f} m"
        rows.append([each.name, str(len(each.scan)), each.placed_by or "no place", outcome, error])
    plan_name = "none: the scans alone" if together.floorplan is None else together.floorplan.name
    out.print(f"\nplan {plan_name}\n", soft_wrap=True)
    heads = ["frames", "placed by", "verdict", "expected error"]
    out.print(table("", ["scan", *heads], rows))
    out.print(
        f"\n{len(together.plan_from_cams)} frames with a place, {together.matches.n_matches} matches in "
        f"{len(together.matches.pairs)} pairs, {result.between_pairs} of them between scans"
    )
    stages = ", ".join(
        f"{name} {s:.1f}" for name, s in together.seconds_by_stage.items() if s > 0.05
    )
    out.print(f"{seconds:.1f} s: {stages}")
    if together.made_of is not None:
        tell_scan(together.made_of.scan)
    for warning in together.warnings:
        note(warning)
    tell_verdict(together.verdict)
    out.print(f"report: {arguments.out / 'report.html'}", soft_wrap=True)

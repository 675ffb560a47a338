"""`planfit refine`: from files to files."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from planfit.cli.console import StageBars, out
from planfit.cli.refine_inputs import RefineArguments as RefineArguments
from planfit.cli.refine_inputs import read_plan, read_scans
from planfit.cli.run_words import summarise, summarise_together
from planfit.cli.survey import SurveyFlags
from planfit.corrections import NO_CORRECTIONS, Corrections, read_corrections
from planfit.errors import require
from planfit.pipeline.refine import refine
from planfit.pipeline.result import RefineResult
from planfit.pipeline.together import TogetherResult, refine_together
from planfit.report.key_metrics import TruthErrors
from planfit.report.provenance import provenance_now
from planfit.runtime import Runtime
from planfit.runtime.run_folder import RunFolder
from planfit.saving import RunInputs, write_run
from planfit.scan.joined import short_names
from planfit.survey import Survey

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
    result = refine_into(*where, survey=survey, by_hand=by_hand)
    summarise(arguments.out, scan, floorplan, result, time.perf_counter() - begin)
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
        return refine_together(scans, floorplan, options, runtime)

    result = _solved_into(arguments.out, inputs, arguments.workers, arguments.overwrite, solve)
    summarise_together(arguments.out, result, time.perf_counter() - begin)
    return result


def refine_into(
    folder: Path,
    inputs: RunInputs,
    workers: int,
    overwrite: bool,
    truth_of: Callable[[RefineResult], TruthErrors] | None = None,
    survey: Survey | None = None,
    by_hand: HandChoice = NOTHING_BY_HAND,
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

    return _solved_into(folder, inputs, workers, overwrite, solve, truth_of)


def _solved_into(
    folder: Path,
    inputs: RunInputs,
    workers: int,
    overwrite: bool,
    solve: Callable[[Runtime], AnyResult],
    truth_of: Callable[[AnyResult], TruthErrors] | None = None,
) -> AnyResult:
    """Claim the folder, solve, and write the result."""
    inputs = replace(inputs, made=provenance_now(out.speech.command))
    with RunFolder.claimed(folder, inputs.names, overwrite) as run, StageBars() as bars:
        runtime = Runtime(workers, inputs.cache or run.cache_dir, bars.update)
        result = solve(runtime)
        write_run(run, inputs, result, runtime, truth_of(result) if truth_of else None)
    return result

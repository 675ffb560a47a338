"""Faulty scans and wrong plans: what planfit makes of them, and what it says of it."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NoReturn

import tyro

from faults.batches import PageArguments, answer, of_present_scans, tell, write_page
from faults.battery import digest_of, read_measured, run_battery
from faults.cases import Case, all_cases, choose
from faults.figures import make_figures, match_results, require_none_bad
from faults.measure import CRASHED, How, Measured
from faults.page import make_page
from planfit import RefineOptions
from planfit.cli.console import out, table
from planfit.cli.main import exit_with

NAME = "python benchmarks/faults"


@dataclass(frozen=True)
class RunArguments:
    """Measure cases. Goes on where it stopped; what was measured with other code is measured again."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("faults.jsonl")
    """One line a case, added to."""
    only: str = ""
    """Words that the case's name holds, several with `|` between: "one jump|walls moved"."""
    scans: tuple[str, ...] = ()
    """Names of scans; all without."""
    every: int = 1
    """One in so many pairs of an even and an odd number."""
    jobs: int = 2
    """Cases at a time, each in a process of its own."""
    cache: Path = Path("faults.cache")
    """Folder for rendered images and keypoints."""
    optimality: bool = False
    """Also solve from the true poses, and compare costs."""
    strict: bool = False
    """End with an error where a case crashes, is wrong without a word, is vouched for though nothing of
    it can be right, or is named for another convention; and where a faultless one is not vouched for."""


@dataclass(frozen=True)
class ListArguments:
    """Show numbers and names of cases."""

    only: str = ""
    """Words that the case's name holds, several with `|` between."""
    scans: tuple[str, ...] = ()
    """Names of scans; all without."""
    every: int = 1
    """One in so many pairs of an even and an odd number."""


Arguments = (
    Annotated[RunArguments, tyro.conf.subcommand("run")]
    | Annotated[PageArguments, tyro.conf.subcommand("page")]
    | Annotated[ListArguments, tyro.conf.subcommand("list")]
)


def main() -> NoReturn:
    """Run what the command line says, and exit."""
    exit_with(lambda: run(sys.argv[1:]))


def run(argv: Sequence[str]) -> int:
    """Measure, write the page, or list; the exit code."""
    actions = {RunArguments: _run, PageArguments: _write_page, ListArguments: _list}
    return answer(argv, Arguments, NAME, actions)


def _write_page(arguments: PageArguments) -> None:
    write_page(arguments.out, make_page(all_cases(), read_measured(arguments.measured)))


def _list(arguments: ListArguments) -> None:
    for case in _chosen(arguments):
        out.print(f"{case.number:4} {case.name}", soft_wrap=True)


def _chosen(arguments: RunArguments | ListArguments) -> list[Case]:
    return choose(all_cases(), arguments.only, arguments.scans, arguments.every)


def _run(arguments: RunArguments) -> None:
    options = RefineOptions()
    digest = digest_of(options, arguments.optimality)
    how = How(arguments.cache.resolve(), digest, options, arguments.optimality)
    here = of_present_scans(_chosen(arguments))
    run_battery(here, arguments.out, how, arguments.jobs, _tell)
    numbers = {case.number for case in here}
    measured = [m for m in read_measured(arguments.out) if m.number in numbers]
    results = match_results(here, measured)
    rows = [
        [figure.name, figure.asked, figure.found, str(figure.n)]
        for figure in make_figures(results)
        if figure.n
    ]
    out.print(table("even and odd numbers", ["", "asked", "found", "cases"], rows))
    if arguments.strict:
        require_none_bad(results)


def _tell(measured: Measured, left: int) -> None:
    errors = ""
    if measured.error_m is not None and measured.before_m is not None:
        errors = f"{measured.before_m:.3f} -> {measured.error_m:.3f} m, "
    code = "crash" if measured.exit_code == CRASHED else f"exit {measured.exit_code}"
    words = f"{measured.number:4} {measured.name}: {errors}{code}, {measured.said[:160]}"
    tell(measured, words, left)

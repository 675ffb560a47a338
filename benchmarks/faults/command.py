"""Faulty scans and wrong plans: what planfit makes of them, and what it says of it."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NoReturn

import tyro

from faults.battery import digest_of, read_measured, run_battery
from faults.cases import Case, all_cases, choose
from faults.figures import make_figures, match_results
from faults.measure import CRASHED, How, Measured
from faults.page import write_page
from faults.scans import SHARED
from planfit import RefineOptions
from planfit.cli.arguments import parse
from planfit.cli.console import out, table
from planfit.cli.main import exit_with, in_one_line

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


@dataclass(frozen=True)
class PageArguments:
    """Write the figures and tables of measured cases as a Markdown page."""

    measured: tyro.conf.Positional[Path]
    """What `run` wrote."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Markdown file, written anew."""


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

    def action() -> int:
        arguments = parse(Arguments, NAME, list(argv))
        if isinstance(arguments, RunArguments):
            _run(arguments)
        elif isinstance(arguments, PageArguments):
            write_page(all_cases(), read_measured(arguments.measured), arguments.out)
            out.print(f"written: {arguments.out}", soft_wrap=True)
        else:
            for case in _chosen(arguments):
                out.print(f"{case.number:4} {case.name}", soft_wrap=True, highlight=False)
        return 0

    return in_one_line(action, "what is measured is kept, the same command goes on from there")


def _chosen(arguments: RunArguments | ListArguments) -> list[Case]:
    return choose(all_cases(), arguments.only, arguments.scans, arguments.every)


def _run(arguments: RunArguments) -> None:
    options = RefineOptions()
    digest = digest_of(options, arguments.optimality)
    how = How(arguments.cache.resolve(), digest, options, arguments.optimality)
    chosen = _chosen(arguments)
    absent = {name for name in ("conslam", "kitchen") if not (SHARED / name).is_dir()}
    for name in sorted(absent & {case.scan for case in chosen}):
        out.print(f"left out: {name}, as {SHARED / name} is absent (set PLANFIT_SHARED)")
    here = [case for case in chosen if case.scan not in absent]
    run_battery(here, arguments.out, how, arguments.jobs, _tell)
    numbers = {case.number for case in here}
    measured = [m for m in read_measured(arguments.out) if m.number in numbers]
    rows = [
        [figure.name, figure.asked, figure.found, str(figure.n)]
        for figure in make_figures(match_results(here, measured))
        if figure.n
    ]
    out.print(table("even and odd numbers", ["", "asked", "found", "cases"], rows))


def _tell(measured: Measured, left: int) -> None:
    errors = ""
    if measured.error_m is not None and measured.before_m is not None:
        errors = f"{measured.before_m:.3f} -> {measured.error_m:.3f} m, "
    code = "crash" if measured.exit_code == CRASHED else f"exit {measured.exit_code}"
    out.print(
        f"{measured.number:4} {measured.name}: {errors}{code}, {measured.said[:160]} "
        f"({measured.seconds:.0f} s, {left} left)",
        soft_wrap=True,
        highlight=False,
        markup=False,
    )

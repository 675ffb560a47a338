"""Recordings whose unit, mount or clock is another: whether that is decided rightly."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NoReturn

import tyro
from faults.batches import PageArguments, answer, digest_with, tell, write_page
from faults.battery import read_measured, run_battery
from faults.measure import How, Measured

from planfit import RefineOptions
from planfit.cli.console import out
from planfit.cli.main import exit_with
from recordings import measure as measuring
from recordings import sources
from recordings.cases import Case, all_cases, choose
from recordings.page import figures, make_page
from recordings.sources import absent, whole

NAME = "python benchmarks/recordings"


@dataclass(frozen=True)
class RunArguments:
    """Judge recordings. Goes on where it stopped; what was measured with other code is measured again."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("recordings.jsonl")
    """One line a case, added to."""
    only: str = ""
    """Words that the case's name holds, several with `|` between: "clock|mount"."""
    every: int = 1
    """One in so many pairs of an even and an odd number."""
    half: Literal["even", "odd", "both"] = "both"
    """Even numbers to choose by, odd ones to report on."""
    jobs: int = 2
    """Cases at a time, each in a process of its own."""
    cache: Path = Path("recordings.cache")
    """Folder for images that are rendered once, keypoints, and motions."""


@dataclass(frozen=True)
class ListArguments:
    """Show the names of cases."""

    only: str = ""
    """Words that the case's name holds, several with `|` between."""
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


def _list(arguments: ListArguments) -> None:
    for case in choose(all_cases(), arguments.only, arguments.every):
        out.print(case.name, soft_wrap=True)


def _run(arguments: RunArguments) -> None:
    halves = {"even": (False,), "odd": (True,), "both": (False, True)}[arguments.half]
    chosen = choose(all_cases(), arguments.only, arguments.every)
    here = present([case for case in chosen if case.is_last in halves])
    options = RefineOptions()
    digest = digest_with(options, measuring, sources)
    how = How(arguments.cache.resolve(), digest, options)
    pieces = dict.fromkeys((case.scan, case.is_last) for case in here)
    for scan, is_last in pieces:
        cases = [case for case in here if (case.scan, case.is_last) == (scan, is_last)]
        if scan in sources.NAMES:
            whole(scan, how.cache_dir)  # read once: the processes of its cases are copies of this
        run_battery(cases, arguments.out, how, arguments.jobs, _tell, measuring.measure)
    rows = [row for row in _read(arguments.out) if row.digest == digest]
    for line in figures(here, rows):
        out.print(line, soft_wrap=True)


def _write_page(arguments: PageArguments) -> None:
    last = {row.number: row for row in _read(arguments.measured)}
    write_page(arguments.out, make_page(all_cases(), list(last.values())))


def _read(path: Path) -> list[measuring.Row]:
    rows = read_measured(path, measuring.Row)
    return [row for row in rows if isinstance(row, measuring.Row)]


def present(cases: Sequence[Case]) -> list[Case]:
    """Cases whose scans are on this machine; what is not is said once."""
    missing = {name: absent(name) for name in dict.fromkeys(case.scan for case in cases)}
    for name, reason in missing.items():
        if reason:
            out.print(f"left out: {name}, as {reason}", soft_wrap=True)
    return [case for case in cases if not missing[case.scan]]


def _tell(measured: Measured, left: int) -> None:
    assert isinstance(measured, measuring.Row)
    said = f"{measured.outcome}: {measured.put_in} -> {measured.found or measured.said[:160]}"
    tell(measured, f"{measured.name}: {said}", left)

"""`make buildings`: measure every building, show the totals, compare with what was kept."""

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, NoReturn

import tyro
from faults.batches import answer, tell, write_page
from faults.battery import read_measured, run_battery
from faults.measure import CRASHED, How, Measured
from records import machine

from buildings.cases import Case, all_cases, choose
from buildings.failures import compare, failures_of
from buildings.measure import absent, digest_for, measure, steadied
from buildings.rows import Row
from buildings.table import (
    HEAD,
    KEPT,
    columns,
    comparison_words,
    make_page,
    plain_table,
    read_kept,
    totals,
    write_kept,
)
from planfit import RefineOptions
from planfit.cli.console import out
from planfit.cli.main import exit_with
from planfit.errors import OutputError

NAME = "python benchmarks/buildings"


@dataclass(frozen=True)
class RunArguments:
    """Measure cases, show totals, compare with the rows kept. Goes on where it stopped."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("buildings.jsonl")
    """One line a case, added to; what was measured with other code is measured again."""
    only: str = ""
    """Words that the case's name holds, several with `|` between: "conslam|one jump"."""
    short: bool = False
    """The quick choice: the first drift of each building, and the quickest files."""
    seed: int = 0
    """Drifts are drawn from it; rows are kept of seed 0."""
    leave_out: tuple[str, ...] = ()
    """Buildings that the totals are without: choose on the others, report on these."""
    keep: bool = False
    """Keep the rows in benchmarks/results, and write the page, for the next run to be compared with."""
    page: Path = Path("docs/buildings.md")
    """Markdown page that `keep` writes."""
    jobs: int = 2
    """Cases at a time, each in a process of its own."""
    cache: Path = Path("buildings.cache")
    """Folder for images that are rendered once, and for keypoints."""
    limit_s: float = 600.0
    """A case that takes longer is ended and counts as a crash."""


@dataclass(frozen=True)
class ListArguments:
    """Show the names of cases."""

    only: str = ""
    """Words that the case's name holds, several with `|` between."""
    short: bool = False
    """The quick choice."""


Arguments = (
    Annotated[RunArguments, tyro.conf.subcommand("run")]
    | Annotated[ListArguments, tyro.conf.subcommand("list")]
)


def main() -> NoReturn:
    """Run what the command line says, and exit."""
    exit_with(lambda: run(sys.argv[1:]))


def run(argv: Sequence[str]) -> int:
    """Measure or list; the exit code."""
    return answer(argv, Arguments, NAME, {RunArguments: _run, ListArguments: _list})


def _list(arguments: ListArguments) -> None:
    for case in choose(all_cases(), arguments.only, arguments.short):
        out.print(f"{case.number:4} {case.name}", soft_wrap=True)


def _run(arguments: RunArguments) -> None:
    cases = all_cases(arguments.seed)
    _require_known(arguments.leave_out, cases)
    here = present(choose(cases, arguments.only, arguments.short))
    begin = os.times()
    rows = [row for are_read in (False, True) for row in _measured(here, arguments, are_read)]
    end = os.times()
    spent_s = sum(end[:4]) - sum(begin[:4])
    for line in plain_table(HEAD, totals(columns(rows, cases), arguments.leave_out)):
        out.print(line, soft_wrap=True)
    for row in rows:
        for failure in failures_of(row):
            out.print(f"fails: {row.name}: {failure.words}", soft_wrap=True)
    kept = read_kept()
    for line in comparison_words(compare(kept, rows), len(kept)):
        out.print(line, soft_wrap=True)
    out.print(f"{len(rows)} cases; this run took {spent_s / 60:.1f} CPU minutes")
    if arguments.keep:
        _keep(rows, cases, arguments)


def _measured(cases: Sequence[Case], arguments: RunArguments, are_read: bool) -> list[Row]:
    """Rows of the cases that are only read, or of the others; measured now where they are not there yet."""
    own = [case for case in cases if (case.reading is not None) == are_read]
    options = RefineOptions()
    digest = digest_for(options, arguments.seed, are_read)
    how = How(arguments.cache.resolve(), digest, options)
    run_battery(own, arguments.out, how, arguments.jobs, _tell, measure, arguments.limit_s)
    return _rows_of(own, arguments.out, how)


def present(cases: Sequence[Case]) -> list[Case]:
    """Cases whose files are on this machine; what is not is said once."""
    reasons = {case.name: absent(case) for case in cases}
    for reason in dict.fromkeys(reason for reason in reasons.values() if reason):
        n_cases = list(reasons.values()).count(reason)
        out.print(f"left out: {n_cases} cases, as {reason}", soft_wrap=True)
    return [case for case in cases if not reasons[case.name]]


def _rows_of(cases: Sequence[Case], path: Path, how: How) -> list[Row]:
    """Rows of this code and these cases, in their order; the last one of each."""
    measured = {row.name: row for row in read_measured(path, Row) if row.digest == how.digest}
    own = [_as_row(measured[case.name], case) for case in cases if case.name in measured]
    return steadied(own, cases, how)


def _as_row(measured: Measured, case: Case) -> Row:
    """A process that died told nothing but that."""
    assert isinstance(measured, Row)
    if measured.building:
        return measured
    return replace(measured, building=case.scan)


def _keep(rows: Sequence[Row], cases: Sequence[Case], arguments: RunArguments) -> None:
    if arguments.seed or arguments.only or arguments.short:
        raise OutputError(
            "--keep: expected the whole table of seed 0, found --seed, --only or --short; leave them out"
        )
    total_s = sum(row.cpu_s for row in rows)
    conditions: dict[str, str | float] = {
        "seed": arguments.seed,
        "machine": machine().partition(", load")[0],
        "CPU minutes": round(total_s / 60, 1),
    }
    write_kept(rows, conditions)
    out.print(f"kept: {KEPT}", soft_wrap=True)
    write_page(arguments.page, make_page(rows, cases, conditions))


def _require_known(names: Sequence[str], cases: Sequence[Case]) -> None:
    known = dict.fromkeys(case.scan for case in cases)
    unknown = [name for name in names if name not in known]
    if unknown:
        raise OutputError(
            f"--leave-out: expected some of {'; '.join(known)}, found {'; '.join(unknown)}"
        )


def _tell(measured: Measured, left: int) -> None:
    errors = ""
    if measured.error_m is not None and measured.before_m is not None:
        errors = f"{measured.before_m:.3f} -> {measured.error_m:.3f} m, "
    code = "crash" if measured.exit_code == CRASHED else f"exit {measured.exit_code}"
    outcome = measured.reading if isinstance(measured, Row) and measured.reading else code
    tell(measured, f"{measured.name}: {errors}{outcome}, {measured.said[:120]}", left)

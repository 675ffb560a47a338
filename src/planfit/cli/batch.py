"""`planfit batch`: many scans, each into a folder of its own."""

import contextlib
import os
import re
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from planfit.batch.jobs import Column, Job, Option, inputs_of, read_jobs
from planfit.batch.ledger import Ledger, State
from planfit.batch.memory import GB, SHARE_OF_FREE, free_bytes
from planfit.batch.page import JobRow, Result, counts_in_words, row_of, write_page
from planfit.batch.pool import LocalPool, Task, require_distributed, run_on_cluster
from planfit.batch.process import Errand, Launcher
from planfit.batch.sheet import Row
from planfit.cli.arguments import Out
from planfit.cli.commands import COMMANDS_BY_NAME, off_name
from planfit.cli.console import note, out
from planfit.cli.parser import parse
from planfit.cli.refine import RefineArguments
from planfit.errors import OptionError, PlanfitError, require
from planfit.units import in_units

_OF_THE_BATCH = ("out", "overwrite", "workers", "cache", "plan")
"""Flags of refine that no job has an option for."""


@dataclass(frozen=True)
class BatchArguments:
    """Refine the scans of a list, each into a folder of its own; OUT/index.html and OUT/jobs.csv show all.
    What is done with the same inputs and options is skipped, one failure stops no other."""

    jobs: tyro.conf.Positional[Path]
    """List of jobs (CSV, TOML or JSON): name, scan, plan, and any option of `planfit refine`; see
    `planfit help batch`."""
    out: Out[Path]
    """Folder for the results."""
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Scans at a time, each in a process; the machine's processors are shared among them."""
    memory_gb: float | None = None
    """Memory for all of them together; by default four fifths of what is free when it begins. A scan waits
    until it fits."""
    shard: Annotated[str, tyro.conf.arg(metavar="I/N")] = ""
    """Do only the I-th of N parts of the list, 1/N to N/N, for arrays of jobs."""
    scheduler: Annotated[str, tyro.conf.arg(metavar="ADDRESS")] = ""
    """Hand the jobs to a dask.distributed cluster, tcp://HOST:8786, whose workers all see OUT
    (extra `cluster`)."""
    staged: Path | None = None
    """Folder for copies of scans and plans at s3://, https:// and other addresses; by default
    OUT/batch/staged."""
    overwrite: bool = False
    """Replace the results of runs that no batch made."""


def batch_command(arguments: BatchArguments) -> int:
    """Read the list, do what is not done, show all. Exit code 0 where all are refined, 1 where some are not
    vouched for, 2 where some were refused or crashed."""
    require(arguments.workers >= 1, f"--workers: expected 1 or more, found {arguments.workers}")
    require(
        arguments.memory_gb is None or arguments.memory_gb > 0,
        f"--memory-gb: expected a number above 0, found {arguments.memory_gb}",
    )
    first, step = parse_shard(arguments.shard)
    if arguments.scheduler:
        require_distributed()
    rows = read_jobs(arguments.jobs, columns())
    _check_values(rows)
    jobs = [job for _, job in rows]
    ledger = Ledger(arguments.out.resolve())
    ledger.open()
    mine = jobs[first::step]
    tasks = _open_tasks(mine, arguments, ledger)
    if len(tasks) < len(mine):
        out.print(f"{len(mine) - len(tasks)} of {len(mine)} scans are done already")
    try:
        with contextlib.closing(_runs(tasks, arguments)) as ended:
            for n, (task, state) in enumerate(ended, 1):
                _tell(n, len(tasks), row_of(task.errand.job, ledger), state)
    finally:
        shown = write_page(jobs, ledger, arguments.jobs.stem)
    names = {job.name for job in mine}
    own = [row for row in shown if row.job.name in names]
    out.print(f"{len(own)} scans: {counts_in_words(own)}")
    out.print(f"all: {arguments.out / 'index.html'}", soft_wrap=True)
    return exit_code(own)


def exit_code(rows: Sequence[JobRow]) -> int:
    """0 all refined, 1 some not vouched for, 2 some without results."""
    results = {row.result for row in rows}
    if results & {Result.REFUSED, Result.CRASHED, Result.OPEN}:
        return 2
    return 1 if results - {Result.REFINED} else 0


def columns() -> dict[str, Column]:
    """Options of refine that a job may have, by the name of their column."""
    known = COMMANDS_BY_NAME["refine"].known_flags()
    switches = [name for name, flag in known.items() if flag.kind == "switch"]
    names = [name for name in known if name.startswith("--")]
    names = [name for name in names if name not in map(off_name, switches)]
    return {
        name.removeprefix("--"): Column(
            is_switch=name in switches,
            has_no=off_name(name) in known,
            is_file=known[name].kind == "file",
            is_repeated=known[name].kind == "several",
        )
        for name in names
        if name.removeprefix("--") not in _OF_THE_BATCH
    }


def parse_shard(text: str) -> tuple[int, int]:
    """Index of the first job, and the step to the next one.

    Raises:
        OptionError: it is no I/N.
    """
    if not text:
        return 0, 1
    found = re.fullmatch(r"\s*(\d+)\s*/\s*(\d+)\s*", text)
    number, of = (int(found[1]), int(found[2])) if found else (0, 0)
    require(
        1 <= number <= of,
        f"--shard: expected I/N with I from 1 to N, as 1/8, found {text!r}; in an array of Slurm, count from "
        "1: --array=1-8",
    )
    return number - 1, of


def _check_values(rows: Sequence[tuple[Row, Job]]) -> None:
    """Raise `OptionError` where refine would not take the options of a job; each set of options once."""
    known: set[tuple[Option, ...]] = set()
    for row, job in rows:
        if job.options in known:
            continue
        known.add(job.options)
        words = [word for option in job.options for word in option.words]
        try:
            parse(RefineArguments, "planfit refine", ["SCAN", "--out", "OUT", *words])
        except PlanfitError as error:
            raise OptionError(f"{row.where}: {error}") from error


def _open_tasks(jobs: Sequence[Job], arguments: BatchArguments, ledger: Ledger) -> list[Task]:
    """Jobs that are not done."""
    staged = str(arguments.staged.resolve()) if arguments.staged else ""
    tasks = []
    for job in jobs:
        try:
            inputs = inputs_of(job)
        except (PlanfitError, OSError):
            inputs = None  # its own process will say it
        if inputs is not None and ledger.is_done(job.name, inputs.key):
            ledger.close(job.name, inputs.key)
            continue
        errand = Errand(job, str(ledger.out), overwrite=arguments.overwrite, staged=staged)
        tasks.append(Task(errand, inputs.scan if inputs else None))
    return tasks


def _runs(
    tasks: Sequence[Task], arguments: BatchArguments
) -> Generator[tuple[Task, State], None, None]:
    """The tasks as they end, on this machine or on the cluster."""
    if arguments.scheduler:
        yield from run_on_cluster(arguments.scheduler, _launcher(arguments.workers), tasks)
        return
    workers = max(min(arguments.workers, len(tasks)), 1)
    free = free_bytes()
    allowed = None if free is None else int(SHARE_OF_FREE * free)
    if arguments.memory_gb is not None:
        allowed = int(arguments.memory_gb * GB)
    elif free is None and tasks:
        note("how much memory is free is not told by this system; give --memory-gb")
    yield from LocalPool(_launcher(workers), workers, allowed, _tell_start).run(tasks)


def _launcher(side_by_side: int) -> Launcher:
    """Processes that share out the processors."""
    return Launcher("planfit.cli.batch_job", max((os.cpu_count() or 1) // side_by_side, 1))


def _tell_start(task: Task, number: int) -> None:
    if number > 1:
        log = task.errand.ledger.log(task.errand.job.name)
        note(f"{task.errand.job.name}: crashed, is tried once more; {log}")


def _tell(n: int, of: int, row: JobRow, state: State) -> None:
    """A line for a scan that ended."""
    words = f"[{n}/{of}] {row.job.name}: {row.result.value}"
    if row.predicted_m is not None:
        words += f", predicted error {in_units(row.predicted_m, '.3f')}"
    if state.seconds is not None:
        words += f", {state.seconds:.0f} s"
    if row.result is not Result.REFINED and row.reason:
        words += f": {row.reason}"
    color = {Result.REFINED: "green", Result.RESERVATIONS: "yellow"}.get(row.result, "red")
    out.print(words, style=color, soft_wrap=True)

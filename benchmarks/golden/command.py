"""Golden runs made and compared with the kept ones, or kept anew."""

import multiprocessing
import os
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, NoReturn

import tyro

from golden.compare import Difference, compare_runs
from golden.kept import KEPT, Kept, Run, read_kept, write_kept
from golden.machine import describe_machine, ensure_ready_kernels, environment, what_differs
from golden.runs import CASES, Performed, perform
from planfit.cli.console import err, out, table
from planfit.cli.main import EXIT_NOT_BETTER, EXIT_OK, exit_with, in_one_line
from planfit.cli.parser import parse

NAME = "python benchmarks/golden"
ADVICE = f"where the change means to change results: {NAME} record, and say why in the commit"


@dataclass(frozen=True)
class CheckArguments:
    """Make the runs and compare them with the kept ones: poses, outcome and scale. Exit code 1 where one
    differs."""

    bits: bool = False
    """On the machine that they were recorded on, also fail where a bit differs: for changes that only move
    code."""
    kept: Path = KEPT
    """The file of kept runs."""
    jobs: int = 2
    """Runs at a time, each in a process of its own."""
    workers: int = 1
    """Threads of each; bits do not depend on them."""


@dataclass(frozen=True)
class RecordArguments:
    """Make the runs and keep them, in the place of those that were kept; say why in the commit."""

    kept: Path = KEPT
    """The file of kept runs."""
    jobs: int = 2
    """Runs at a time, each in a process of its own."""
    workers: int = 1
    """Threads of each; bits do not depend on them."""


Arguments = (
    Annotated[CheckArguments, tyro.conf.subcommand("check")]
    | Annotated[RecordArguments, tyro.conf.subcommand("record")]
)


def main() -> NoReturn:
    """Run what the command line says, and exit."""
    exit_with(lambda: run(sys.argv[1:]))


def run(argv: Sequence[str]) -> int:
    """Check or record; the exit code."""

    def action() -> int:
        arguments = parse(Arguments, NAME, list(argv))
        if isinstance(arguments, CheckArguments):
            return _check(arguments)
        return _record(arguments)

    return in_one_line(action, "nothing of it is kept")


def _check(arguments: CheckArguments) -> int:
    kept = read_kept(arguments.kept)  # before two minutes of runs
    runs, machine = _perform_all(arguments.jobs, arguments.workers)
    return tell(compare_runs(runs, kept.runs), kept, machine, arguments.bits)


def _record(arguments: RecordArguments) -> int:
    write_kept(arguments.kept, *_perform_all(arguments.jobs, arguments.workers))
    out.print(f"written: {arguments.kept}", soft_wrap=True)
    return EXIT_OK


def tell(
    differences: Sequence[Difference], kept: Kept, here: Mapping[str, str], is_strict: bool
) -> int:
    """Say how each run compares; the exit code.

    Args:
        differences: of all runs.
        kept: what they were compared with.
        here: the machine that they were made on.
        is_strict: whether bits that differ are a fault on the machine that the kept runs are from.
    """
    rows = [[d.name, f"{d.position_m:.2g}", f"{d.rotation_rad:.2g}", _bits(d)] for d in differences]
    out.print(table("beside the kept runs", ["", "m", "rad", "bits"], rows))
    other = what_differs(here, kept.machine)
    out.print(
        f"recorded on another machine: {other}" if other else "recorded on this machine",
        soft_wrap=True,
    )
    faults = [f"{d.name}: {fault}" for d in differences for fault in d.faults]
    if is_strict and not other:
        faults += [
            f"{d.name}: bits differ, by at most {d.position_m:.2g} m"
            for d in differences
            if not (d.are_bits_equal or d.faults)
        ]
    for fault in faults:
        err.print(fault, soft_wrap=True)
    if faults:
        err.print(ADVICE, soft_wrap=True)
    return EXIT_NOT_BETTER if faults else EXIT_OK


def _bits(difference: Difference) -> str:
    return "equal" if difference.are_bits_equal else "differ"


def _perform_all(jobs: int, workers: int) -> tuple[list[Run], dict[str, str]]:
    """All runs in order, each told when it is done; and the machine as it was to them."""
    begin = time.perf_counter()
    if ensure_ready_kernels():
        out.print(f"kernels compiled for these sources in {time.perf_counter() - begin:.0f} s")
    runs = []
    with TemporaryDirectory() as folder:
        # Read by numba, numpy and BLAS when the processes begin, before anything of ours is asked.
        os.environ.update(environment(Path(folder)))
        spawn = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(jobs, mp_context=spawn) as pool:
            for each in pool.map(perform, CASES, [workers] * len(CASES)):
                _tell(each)
                runs.append(each.run)
            machine = pool.submit(describe_machine).result()
    out.print(f"{len(runs)} runs in {time.perf_counter() - begin:.0f} s")
    return runs, machine


def _tell(performed: Performed) -> None:
    run = performed.run
    out.print(
        f"{run.name}: {len(run.plan_from_cams)} frames, {run.outcome}, "
        f"{performed.cpu_s:.1f} s of CPU time, {performed.wall_s:.1f} s",
        soft_wrap=True,
    )

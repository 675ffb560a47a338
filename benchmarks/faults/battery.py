"""Runs cases in processes of their own, and keeps a line for each: what is done is not done again."""

import hashlib
import json
import multiprocessing
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Protocol, TypeVar

import planfit
from faults.measure import CRASHED, How, Measured, as_json, measure
from planfit.errors import OutputError

TIME_LIMIT_S = 900.0


def digest_of(options: planfit.RefineOptions, is_optimality: bool = False) -> str:
    """Changes when planfit's code, the battery's, or the options do."""
    digest = hashlib.sha256(repr((options, is_optimality)).encode())
    own = [path for path in Path(__file__).parent.glob("*.py") if path.name not in _DOES_NOT_MATTER]
    for path in sorted([*Path(planfit.__file__).parent.rglob("*.py"), *own]):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:12]


_DOES_NOT_MATTER = ("cases.py", "battery.py", "figures.py", "page.py", "command.py", "batches.py")
"""Which cases there are, and what is made of them; all else is what a case is and how it is measured."""


def read_measured(path: Path, kind: type[Measured] = Measured) -> list[Measured]:
    """All lines of a file; a last line that was cut off is left out.

    Args:
        path: what `run_battery` wrote; nothing is read where there is no file.
        kind: what each line becomes: `Measured`, or more than that.

    Raises:
        OutputError: the file is another.
    """
    if not path.exists():
        return []
    names = {field.name for field in fields(kind)}
    lines = path.read_text().splitlines()
    found = []
    for k, line in enumerate(lines):
        try:
            values = json.loads(line)
            values["warnings"] = tuple(values["warnings"])
            found.append(kind(**{name: values[name] for name in names if name in values}))
        except (ValueError, KeyError, TypeError) as error:
            if k == len(lines) - 1:
                break
            raise OutputError(
                f"{path}, line {k + 1}: expected a case of 'benchmarks/faults run', found another text "
                f"({error})"
            ) from error
    return found


class Numbered(Protocol):
    """A case of any kind."""

    @property
    def number(self) -> int:
        """Its place in the list of all."""
        ...

    @property
    def name(self) -> str:
        """In words; no two cases share it."""
        ...


AnyCase = TypeVar("AnyCase", bound=Numbered)


@dataclass
class _Running:
    """A case that is under way."""

    case: Numbered
    process: BaseProcess
    receiver: Connection
    begin_s: float


def run_battery(
    cases: Sequence[AnyCase],
    path: Path,
    how: How,
    jobs: int,
    on_measured: Callable[[Measured, int], None],
    run_case: Callable[[AnyCase, How], Measured] = measure,
    time_limit_s: float = TIME_LIMIT_S,
) -> None:
    """Measure the cases that the file does not have with this digest; each line is written as it comes.

    Args:
        cases: what is asked for.
        path: JSONL file, added to.
        how: options and digest.
        jobs: cases at a time.
        on_measured: told of each, and how many are left.
        run_case: measures one, in a process of its own.
        time_limit_s: a case that takes longer is ended, and recorded as a crash.
    """
    done = {measured.number for measured in read_measured(path) if measured.digest == how.digest}
    waiting = [case for case in cases if case.number not in done]
    path.parent.mkdir(parents=True, exist_ok=True)
    running: list[_Running] = []
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                running.append(_start(waiting.pop(0), how, run_case))
            wait([run.receiver for run in running], timeout=1.0)
            for run in list(running):
                measured = _answer(run, how, time_limit_s)
                if measured is not None:
                    running.remove(run)
                    with path.open("a") as file:
                        file.write(json.dumps(as_json(measured)) + "\n")
                    on_measured(measured, len(waiting) + len(running))
    finally:
        for run in running:
            run.process.kill()


def _start(case: AnyCase, how: How, run_case: Callable[[AnyCase, How], Measured]) -> _Running:
    receiver, sender = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.Process(target=_work, args=(sender, run_case, case, how), daemon=True)
    process.start()
    sender.close()
    return _Running(case, process, receiver, time.perf_counter())


def _work(
    sender: Connection, run_case: Callable[[AnyCase, How], Measured], case: AnyCase, how: How
) -> None:
    sender.send(run_case(case, how))


def _answer(run: _Running, how: How, time_limit_s: float) -> Measured | None:
    """What a process answered; a crash where it died or took too long; None while it works."""
    seconds = time.perf_counter() - run.begin_s
    said = ""
    if run.receiver.poll():
        try:
            measured = run.receiver.recv()
        except EOFError:
            run.process.join()
            said = f"the process ended with {run.process.exitcode}"
        else:
            run.process.join()
            return measured
    elif seconds > time_limit_s:
        run.process.kill()
        said = f"no answer in {time_limit_s:g} s"
    if not said:
        return None
    return Measured(
        run.case.number, run.case.name, how.digest, CRASHED, said, seconds=round(seconds, 2)
    )

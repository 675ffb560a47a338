"""What a user sees in the terminal: progress while it runs, a table at the end."""

import logging
import sys
import time
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console as RichConsole
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from planfit.cli.commands import WIDTH
from planfit.cli.speech import USUAL, Speech
from planfit.errors import OutputError, printable
from planfit.findings.finding import FEW_NAMED
from planfit.scan import Scan, corrupt_frames
from planfit.units import told_in

_LOG_WIDTH = 2 * WIDTH
SHOWN_FROM_S = 0.05
"""Stages that took less are left out: with one digit they would be told as 0.0 s."""
COMPILED = (
    "note: inner loops were compiled for this user, the next run has them; 'planfit doctor --compile' does "
    "so for all users"
)


class Console(RichConsole):
    """A console that shows text as it is, and leaves a closed pipe to the one who ends the program.

    No mark-up: names of files, layers and rooms may hold brackets. Colours are given as styles.
    """

    def __init__(self, stderr: bool = False) -> None:
        super().__init__(stderr=stderr, highlight=False, markup=False, emoji=False)
        self.speech = USUAL
        """How much is said; see `speaking_as`."""
        self.copy: RichConsole | None = None
        """What is printed goes there as well."""

    def print(self, *objects: Any, **how: Any) -> None:
        """As rich does, without control characters in text."""
        safe = [printable(o, keep="\n") if isinstance(o, str) else o for o in objects]
        super().print(*safe, **how)
        if self.copy is not None:
            self.copy.print(*safe, **how)

    def on_broken_pipe(self) -> None:
        """Called while `BrokenPipeError` is handled; rich would exit with code 1 here."""
        raise


out = Console()
err = Console(stderr=True)


@contextmanager
def speaking_as(speech: Speech) -> Iterator[None]:
    """Both consoles say as much as asked for while the context lasts; so do planfit's own loggers, and what
    Python and libraries warn of, which is for those who ask for more: no line of it says what to do."""
    log = None
    if speech.log is not None:
        log = RichConsole(
            file=speech.log, width=_LOG_WIDTH, color_system=None, highlight=False, markup=False, emoji=False
        )  # fmt: skip
    handlers = [logging.StreamHandler(sys.stderr)] if speech.is_verbose else []
    handlers += [logging.StreamHandler(speech.log)] if speech.log is not None else []
    # Warnings of planfit's own, such as of a damaged cache, are for all but those who want errors alone.
    is_told = not (speech.is_quiet or speech.is_verbose)
    own = (logging.lastResort if is_told else None) or logging.NullHandler()
    loggers = [logging.getLogger("planfit"), logging.getLogger("py.warnings")]
    levels = [logger.level for logger in loggers]
    logging.captureWarnings(True)
    for console in (out, err):
        console.speech, console.copy = speech, log
    out.quiet = speech.is_quiet
    loggers[0].addHandler(own)
    for logger in loggers if handlers else []:
        logger.setLevel(logging.DEBUG)
        for handler in handlers:
            logger.addHandler(handler)
    try:
        with told_in(speech.units):
            yield
    finally:
        for console in (out, err):
            console.speech, console.copy = USUAL, None
        out.quiet = False
        logging.captureWarnings(False)
        loggers[0].removeHandler(own)
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
            for handler in handlers:
                logger.removeHandler(handler)


class StageBars:
    """A bar for each stage; use as a context, and give `update` to `planfit.runtime.Runtime`."""

    def __init__(self) -> None:
        self._progress = Progress(
            TextColumn("{task.description:<18}"),
            BarColumn(bar_width=30),
            TextColumn("{task.fields[count]:>12}"),
            TimeElapsedColumn(),
            console=err,
            disable=err.speech.is_quiet,
        )
        self._tasks: dict[str, TaskID] = {}
        self._begun: dict[str, float] = {}

    def __enter__(self) -> "StageBars":
        self._progress.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._progress.stop()

    def update(self, stage: str, done: int, total: int) -> None:
        """Show how far a stage is; a total of 0 means that nobody knows how much there is."""
        self._tell(stage, is_done=done > 0 and done >= total)
        if stage not in self._tasks:
            self._tasks[stage] = self._progress.add_task(stage, total=None, count="")
        task = self._tasks[stage]
        if total:
            self._progress.update(task, completed=done, total=total, count=f"{done}/{total}")
        elif done:
            known = self._progress.tasks[task].total or 1
            self._progress.update(task, completed=known, total=known)

    def _tell(self, stage: str, is_done: bool) -> None:
        """A line at the end of each stage for those who asked for more, and for the log."""
        begin = self._begun.setdefault(stage, time.perf_counter())
        if not is_done:
            return
        del self._begun[stage]
        line = f"{time.strftime('%H:%M:%S')} {stage}: {time.perf_counter() - begin:.2f} s"
        if err.speech.is_verbose:
            err.print(line)
        elif err.copy is not None:
            err.copy.print(line)


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str | Text]]) -> Table:
    """A plain table: the first column to the left, numbers to the right."""
    result = Table(
        title=printable(title) or None,
        title_justify="left",
        box=None,
        pad_edge=False,
        title_style="bold",
    )
    for i, column in enumerate(columns):
        result.add_column(column, justify="left" if i == 0 else "right")
    for row in rows:
        result.add_row(*(printable(cell) if isinstance(cell, str) else cell for cell in row))
    return result


def listing(rows: Sequence[Sequence[str]]) -> Table:
    """A plain table of names and words, without heads."""
    result = table("", ["", ""], rows)
    result.columns[1].justify = "left"
    result.show_header = False
    return result


def check_suffix(target: Path, kinds: Collection[str]) -> None:
    """Raise `OutputError` where a file to write has none of the suffixes that tell what to write."""
    if target.suffix.lower() not in kinds:
        raise OutputError(
            f"{target}: expected a file of {', '.join(kinds)}, found {target.suffix or 'no suffix'}; choose "
            "another name with -o"
        )


def note(words: str) -> None:
    """What a user should know, on a line of its own that is not wrapped."""
    out.print(Text.assemble(("note:", "yellow"), " ", printable(words)), soft_wrap=True)


def tell_scan(scan: Scan) -> None:
    """Warnings, frames that were left out, frames that could not be decoded; nothing where all is well."""
    for warning in scan.warnings:
        note(warning)
    if scan.skipped:
        n = len(scan.skipped)
        _tell_list(f"{n} of {n + len(scan)} frames are left out", scan.skipped)
    reasons = [f"frame {frame_id}: {why}" for frame_id, why in corrupt_frames(scan).items()]
    if reasons:
        _tell_list(
            f"{len(reasons)} of {len(scan)} frames cannot be decoded and take no part", reasons
        )


def _tell_list(begin: str, lines: tuple[str, ...] | list[str]) -> None:
    named = "; ".join(lines[:FEW_NAMED])
    more = f"; and {len(lines) - FEW_NAMED} more" if len(lines) > FEW_NAMED else ""
    note(f"{begin}: {named}{more}")

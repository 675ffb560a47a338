"""What a user sees in the terminal: how much is said, progress while it runs, a table at the end."""

import logging
import shlex
import sys
import time
import traceback
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from rich.console import Console as RichConsole
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from planfit import __version__
from planfit.errors import OptionError, OutputError, printable
from planfit.findings.finding import FEW_NAMED
from planfit.scan import Scan, corrupt_frames

_NAMED = FEW_NAMED
"""So many lines of a list are told in full."""
_LOG_WIDTH = 160
SHOWN_FROM_S = 0.05
"""Stages that took less are left out: with one digit they would be told as 0.0 s."""
COMPILED = (
    "note: inner loops were compiled for this user, the next run has them; 'planfit doctor --compile' does "
    "so for all users"
)
FLAGS = {
    "--verbose": "Say more: seconds of each stage, steps of the solver, where errors come from. Short: `-v`.",
    "--quiet": "Say nothing but errors, and that a result is not to be used as it is. Short: `-q`.",
    "--log": "`--log FILE` also appends all that is said to FILE, with versions, times of stages, and where "
    "an error comes from.",
}
"""By their long names, which `_ALIASES` shorten."""
_ALIASES = {"-v": "--verbose", "-q": "--quiet"}
NAMES = (*FLAGS, *_ALIASES)


@dataclass(frozen=True)
class Speech:
    """How much a command says."""

    is_verbose: bool = False
    is_quiet: bool = False
    log: TextIO | None = None
    """Open file that gets all that is said."""
    command: str = ""
    """The command line as it was typed."""

    def error(self, words: str) -> None:
        """One line on stderr; where the error in progress comes from too, where that was asked for."""
        line = f"planfit: {printable(words)}"
        print(line, file=sys.stderr)
        if self.is_verbose:
            traceback.print_exc()
        if self.log is not None:
            print(line, file=self.log)
            traceback.print_exc(file=self.log)


USUAL = Speech()


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
    named = "; ".join(lines[:_NAMED])
    more = f"; and {len(lines) - _NAMED} more" if len(lines) > _NAMED else ""
    note(f"{begin}: {named}{more}")


def split_speech(words: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Words of a command line without those of `FLAGS`, and the values of these by their long names.

    Raises:
        OptionError: --log has no file behind it, another has a value, or both more and less are asked for.
    """
    rest, found = [], {}
    waiting = iter(words)
    for word in waiting:
        name, _, value = word.partition("=")
        name = _ALIASES.get(name, name)
        if name not in FLAGS:
            rest.append(word)
            continue
        if "=" in word and name != "--log":
            raise OptionError(
                f"{name}: expected no value behind it, found {value!r}; give {name} alone"
            )
        if name == "--log" and not value:
            value = next(waiting, "")
            if not value or value.startswith("-"):
                raise OptionError("--log: expected a file behind it, found none; give --log FILE")
        found[name] = value
    if "--verbose" in found and "--quiet" in found:
        raise OptionError("--quiet: expected it without --verbose, found both; leave one out")
    return rest, found


@contextmanager
def speaking(flags: dict[str, str], command: Sequence[str]) -> Iterator[Speech]:
    """How a command speaks while the context lasts.

    Args:
        flags: from `split_speech`.
        command: the whole command line, for the log and the records of runs.

    Raises:
        OSError: the log cannot be written.
    """
    is_verbose, is_quiet = "--verbose" in flags, "--quiet" in flags
    typed = f"planfit {shlex.join(command)}"
    if "--log" not in flags:
        yield Speech(is_verbose, is_quiet, command=typed)
        return
    with Path(flags["--log"]).open("a", encoding="utf-8", errors="backslashreplace") as log:
        begin = time.perf_counter()
        now = time.strftime("%Y-%m-%d %H:%M:%S %z")
        print(f"{now} planfit {__version__}: {typed}", file=log)
        print(f"Python {sys.version.split()[0]} on {sys.platform}", file=log, flush=True)
        try:
            yield Speech(is_verbose, is_quiet, log, typed)
        except BaseException:
            traceback.print_exc(file=log)
            raise
        finally:
            print(f"ended after {time.perf_counter() - begin:.1f} s\n", file=log)

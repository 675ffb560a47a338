"""How much a command says, where else, and in which units: `-q`, `-v`, `--log FILE` and `--units`, which
every command takes.

Nothing heavy is imported here.
"""

import shlex
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO, cast

from planfit import __version__
from planfit.errors import OptionError, printable
from planfit.units import UNITS, Units

FLAGS = {
    "--verbose": "Say more: seconds of each stage, steps of the solver, where errors come from. Short: `-v`.",
    "--quiet": "Say nothing but errors, and that a result is not to be used as it is. Short: `-q`.",
    "--log": "`--log FILE` also appends all that is said to FILE, with versions, times of stages, and where "
    "an error comes from.",
    "--units": "`--units ft` tells lengths in feet and inches, on the screen and in the report. Files for "
    "programs, coordinates and the rims of plots stay metric.",
}
"""By their long names, which `_ALIASES` shorten."""
_VALUES = {"--log": "a file", "--units": f"one of {', '.join(UNITS)}"}
"""What stands behind those that take a value."""
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
    units: Units = "m"
    """That lengths are told in."""

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


def split_speech(words: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Words of a command line without those of `FLAGS`, and the values of these by their long names.

    Raises:
        OptionError: one has not the value behind it that it takes, another has one, or both more and less
            are asked for.
    """
    rest, found = [], {}
    waiting = iter(words)
    for word in waiting:
        name, _, value = word.partition("=")
        name = _ALIASES.get(name, name)
        if name not in FLAGS:
            rest.append(word)
            continue
        if "=" in word and name not in _VALUES:
            raise OptionError(
                f"{name}: expected no value behind it, found {value!r}; give {name} alone"
            )
        if name in _VALUES and not value:
            value = next(waiting, "")
            if not value or value.startswith("-"):
                example = "--log FILE" if name == "--log" else "--units ft"
                raise OptionError(
                    f"{name}: expected {_VALUES[name]} behind it, found none; give {example}"
                )
        if name == "--units" and value not in UNITS:
            raise OptionError(
                f"--units: expected {_VALUES[name]}, found {value!r}; give --units ft"
            )
        found[name] = value
    if "--verbose" in found and "--quiet" in found:
        raise OptionError("--quiet: expected it without --verbose, found both; leave one out")
    return rest, found


@contextmanager
def speaking(flags: dict[str, str], command: Sequence[str]) -> Iterator[Speech]:
    """How a command speaks while the context lasts.

    Raises:
        OSError: the log cannot be written.
    """
    is_verbose, is_quiet = "--verbose" in flags, "--quiet" in flags
    units = cast(Units, flags.get("--units", "m"))
    typed = f"planfit {shlex.join(command)}"
    if "--log" not in flags:
        yield Speech(is_verbose, is_quiet, None, typed, units)
        return
    with Path(flags["--log"]).open("a", encoding="utf-8", errors="backslashreplace") as log:
        begin = time.perf_counter()
        now = time.strftime("%Y-%m-%d %H:%M:%S %z")
        print(f"{now} planfit {__version__}: {typed}", file=log)
        print(f"Python {sys.version.split()[0]} on {sys.platform}", file=log, flush=True)
        try:
            yield Speech(is_verbose, is_quiet, log, typed, units)
        except BaseException:
            traceback.print_exc(file=log)
            raise
        finally:
            print(f"ended after {time.perf_counter() - begin:.1f} s\n", file=log)

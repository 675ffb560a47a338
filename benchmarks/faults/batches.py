"""What the commands that measure cases by the hundred share: flags, their way through, what they tell."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, Protocol, TypeVar

import tyro

from faults.battery import digest_of
from faults.measure import Measured
from faults.scans import SHARED
from planfit import RefineOptions
from planfit.cli.console import out
from planfit.cli.main import in_one_line
from planfit.cli.parser import parse
from planfit.errors import OutputError


class OfScan(Protocol):
    """A case of any kind."""

    @property
    def scan(self) -> str:
        """Name of its scan."""
        ...


AnyCase = TypeVar("AnyCase", bound=OfScan)


@dataclass(frozen=True)
class PageArguments:
    """Write the figures and tables of measured cases as a Markdown page."""

    measured: tyro.conf.Positional[Path]
    """What `run` wrote."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Markdown file, written anew."""


def answer(
    argv: Sequence[str], kinds: Any, name: str, actions: Mapping[type, Callable[[Any], None]]
) -> int:
    """Do what the command line asks for; the exit code.

    Args:
        argv: without the program's name.
        kinds: union of the subcommands' arguments, as tyro takes it.
        name: of the program.
        actions: what to do for each kind of arguments.
    """

    def action() -> int:
        arguments = parse(kinds, name, list(argv))
        actions[type(arguments)](arguments)
        return 0

    return in_one_line(action, "what is measured is kept, the same command goes on from there")


def digest_with(options: RefineOptions, *modules: ModuleType) -> str:
    """As `digest_of`, and changes with the code of some modules too."""
    digest = hashlib.sha256(digest_of(options).encode())
    for module in modules:
        digest.update(Path(str(module.__file__)).read_bytes())
    return digest.hexdigest()[:12]


def of_present_scans(cases: Sequence[AnyCase]) -> list[AnyCase]:
    """Cases whose scans are on this machine; the others are named."""
    absent = {name for name in ("conslam", "kitchen") if not (SHARED / name).is_dir()}
    for name in sorted(absent & {case.scan for case in cases}):
        out.print(f"left out: {name}, as {SHARED / name} is absent (set PLANFIT_SHARED)")
    return [case for case in cases if case.scan not in absent]


def write_page(path: Path, text: str) -> None:
    """Write a page, and say so.

    Raises:
        OutputError: it cannot be written.
    """
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from error
    out.print(f"written: {path}", soft_wrap=True)


def tell(measured: Measured, words: str, left: int) -> None:
    """A line of progress."""
    out.print(f"{words} ({measured.seconds:.0f} s, {left} left)", soft_wrap=True)

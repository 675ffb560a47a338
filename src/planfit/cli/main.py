"""The commands, and what they have in common: help at once, errors in one line, exit codes.

Nothing heavy is imported here: what a command needs is imported when the command is run.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from planfit import __version__
from planfit.cli.known_flags import check_flags, completions
from planfit.cli.speech import USUAL, Speech, speaking, split_speech
from planfit.errors import OptionError, PlanfitError, did_you_mean

EXIT_OK, EXIT_NOT_BETTER, EXIT_BAD_INPUT, EXIT_INTERRUPTED = 0, 1, 2, 130
EXIT_CLOSED_PIPE = 141
"""128 + SIGPIPE: what a shell tells of other tools whose reader went away."""
EXIT_CODES = (
    "0 done; 1 done, but with reservations, no better than before or not surely aligned; 2 bad input; "
    "130 stopped"
)
COMPLETE = "__complete"
"""Not for users: what the scripts of `planfit completion` ask for the words that may come next."""
EVERYWHERE = "-q, --quiet; -v, --verbose; --log FILE"


@dataclass(frozen=True)
class Command:
    """One command. Its module, `planfit.cli.NAME`, has `NameArguments`, what it takes, and `name_command`."""

    name: str
    usage: str
    """What stands behind its name."""
    summary: str
    """One line for `planfit --help`."""
    flags: tuple[str, ...]
    """The flags that `--help` shows beside those that must be given; `--help-all` shows all. The text is
    written by docs/reference.py, as reading it from the options would take seconds."""
    keeps_stages: bool = False
    """Whether a run that was stopped goes on from its last finished stage."""
    is_light: bool = False
    """Whether it starts where libraries are missing or broken; its arguments then parse their own words."""

    def load(self) -> tuple[type, Callable[[Any], int]]:
        """The dataclass of its arguments, and the function that takes them and gives the exit code."""
        module = import_module(f"planfit.cli.{self.name}")
        arguments = getattr(module, f"{self.name.capitalize()}Arguments")
        return arguments, getattr(module, f"{self.name}_command")

    @property
    def help_path(self) -> Path:
        """The file that `--help` prints."""
        return Path(__file__).parent / "help" / f"{self.name}.txt"


COMMANDS = (
    Command(
        "refine",
        "SCAN [SCAN ...] -o OUT [--plan FILE | --no-plan]",
        "refine the camera poses of a scan, or of several; OUT/report.html tells how it went",
        (
            "plan", "no-plan", "unit", "scale", "storey", "poses", "calibration", "preset", "config",
            "overwrite",
        ),
        keeps_stages=True,
    ),
    Command(
        "view",
        "FOLDER",
        "show a run on a page of this machine, correct it by hand, solve again",
        ("scan", "plan", "port", "no-browser", "without-contradicted", "unit", "scale", "storey", "workers"),
    ),
    Command(
        "batch",
        "JOBS.csv -o OUT",
        "refine many scans, a line each; OUT/index.html shows all; goes on where it stopped",
        ("workers", "memory-gb", "shard", "scheduler", "staged", "overwrite"),
        keeps_stages=True,
    ),
    Command(
        "align",
        "SCAN PLAN -o OUT",
        "align a scan with a plan; a picture of each hypothesis that fits",
        (
            "candidate", "pin", "unit", "scale", "storey", "mirror", "poses", "calibration",
            "preset", "config", "workers",
        ),
    ),
    Command(
        "calibrate",
        "SCAN -o FILE [--plan FILE]",
        "find what a depth camera gets wrong; --calibration FILE corrects its other scans",
        ("plan", "unit", "scale", "storey", "poses", "preset", "config", "workers"),
    ),
    Command(
        "inspect",
        "SCAN [-o FILE.png]",
        "show what is found in a scan: frames, depth, path, up, gaps, jumps",
        ("out", "format", "poses", "depth-scale", "workers"),
    ),
    Command(
        "plan",
        "PLAN [-o FILE.png|svg|dxf|json]",
        "show what is read of a floorplan",
        (
            "out", "unit", "scale", "storey", "layer", "page", "cut-height-m", "wall-mask", "mirror", "drop",
            "keep-region", "write-edits", "numbers", "plan-edits",
        ),
    ),
    Command(
        "evaluate",
        "FOLDER [--truth FILE]",
        "how good the poses of a run are, before and after; also SCAN --poses FILE",
        (
            "poses", "poses-frame", "plan", "truth", "truth-frame", "true-cloud", "delta-m",
            "depth-maps", "json", "workers",
        ),
    ),
    Command(
        "compare",
        "A [B] [--poses FILE] [-o OUT]",
        "two runs, or a run and other poses: where they differ, which is better",
        (
            "out", "poses", "poses-frame", "align", "scan", "plan", "depth-maps", "json", "overwrite",
            "workers",
        ),
    ),
    Command(
        "export",
        "SOURCE --to KIND -o FILE",
        "write poses for other programs: tum, kitti, open3d, g2o, ply, mesh, ...",
        ("frame", "voxel-m", "max-depth-m", "tolerance-m", "workers"),
    ),
    Command(
        "demo",
        "[-o OUT]",
        "make a synthetic scan, drift it, refine it, and compare with the truth",
        ("out", "workers"),
    ),
    Command(
        "synth",
        "OUT [--plan FILE]",
        "write a synthetic scan with its plan and its truth",
        ("plan", "scale", "seed", "building.n-rooms", "walk.n-frames", "drift.yaw-deg",
         "drift.translation-m"),
    ),
    Command(
        "doctor",
        "[--json]",
        "check this installation: versions, extras, threads, GPU, disk, a self-test",
        ("json", "folder", "cache"),
        is_light=True,
    ),
    Command(
        "completion",
        "SHELL",
        "print what makes bash, zsh or fish complete commands and options",
        (),
        is_light=True,
    ),
)  # fmt: skip


def overview() -> str:
    """What `planfit --help` prints."""
    width = max(len(f"{c.name} {c.usage}") for c in COMMANDS)
    lines = [f"  {f'{c.name} {c.usage}':<{width}}  {c.summary}" for c in COMMANDS]
    return "\n".join(
        [
            f"planfit {__version__}: fit a posed RGB-D scan of a building to its floorplan.",
            "",
            "usage: planfit COMMAND ...",
            "",
            "commands:",
            *lines,
            "",
            f"every command also takes {EVERYWHERE}",
            "'planfit COMMAND --help' shows the options that matter, --help-all every one.",
            f"exit codes: {EXIT_CODES}",
            "",
        ]
    )


def main(argv: Sequence[str] | None = None) -> NoReturn:
    """Run a command and exit with its code."""
    exit_with(lambda: run(sys.argv[1:] if argv is None else argv))


def exit_with(action: Callable[[], int]) -> NoReturn:
    """Exit with the code of an action; silently if whoever read the output went away, as `head` does."""
    try:
        code = action()
        sys.stdout.flush()
    except BrokenPipeError:
        # What is still buffered goes nowhere, or the interpreter complains of it at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = EXIT_CLOSED_PIPE
    sys.exit(code)


def run(argv: Sequence[str]) -> int:
    """Run a command and give its exit code; errors of the input become one line and exit code 2."""
    if argv and argv[0] == COMPLETE:
        print("\n".join(completions(argv[1:], [command.name for command in COMMANDS])))
        return EXIT_OK
    try:
        words, flags = split_speech(argv)
    except OptionError as error:
        USUAL.error(str(error))
        return EXIT_BAD_INPUT
    name, rest = (words[0], words[1:]) if words else ("--help", [])
    if name in ("-h", "--help", "help"):
        print(overview(), end="")
        return EXIT_OK
    if name in ("-V", "--version"):
        print(__version__)
        return EXIT_OK
    commands = {command.name: command for command in COMMANDS}
    if name not in commands:
        meant = did_you_mean(name, commands) or f"known: {', '.join(commands)}"
        USUAL.error(f"unknown command {name!r}; {meant}")
        return EXIT_BAD_INPUT
    command = commands[name]
    if not {"-h", "--help", *(["--help-all"] if command.is_light else [])}.isdisjoint(rest):
        print(command.help_path.read_text(encoding="utf-8"), end="")
        return EXIT_OK
    kept = (
        "finished stages are kept, the same command goes on from there"
        if command.keeps_stages
        else "nothing of it is kept"
    )

    def spoken() -> int:
        with speaking(flags, argv) as speech:
            return in_one_line(lambda: _run_command(command, rest, speech), kept, speech)

    return in_one_line(spoken, kept)  # for the log, which may not be writable


def in_one_line(action: Callable[[], int], kept: str, speech: Speech = USUAL) -> int:
    """The exit code of an action; errors of the input become one line on stderr, and so does Ctrl-C.

    Args:
        action: what is done; gives its exit code.
        kept: what an interrupted run leaves, in words.
        speech: how errors are told.
    """
    try:
        return action()
    except SystemExit as stop:  # the parser has told what was wrong, or printed its help
        return stop.code if isinstance(stop.code, int) else EXIT_BAD_INPUT
    except PlanfitError as error:
        speech.error(str(error))
        return EXIT_BAD_INPUT
    except BrokenPipeError:
        raise  # no fault of the input; see `exit_with`
    except OSError as error:
        what = f"{error.filename}: " if error.filename is not None else ""
        why = error.strerror or str(error)
        speech.error(f"{what}{why}; check the path, the rights and the disk")
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        speech.error(f"stopped; {kept}")
        return EXIT_INTERRUPTED


def _run_command(command: Command, argv: list[str], speech: Speech) -> int:
    check_flags(command.name, argv)
    with _stopped_at_once():
        arguments_type, function = command.load()
        if command.is_light:
            return function(arguments_type.from_words(argv))
        from planfit.cli.arguments import parse
        from planfit.cli.console import speaking_as

        words = ["--help" if word == "--help-all" else word for word in argv]
        arguments = parse(arguments_type, f"planfit {command.name}", words)
    with speaking_as(speech):
        return function(arguments)


@contextmanager
def _stopped_at_once() -> Iterator[None]:
    """Ctrl-C ends the program here and now, while nothing but imports has happened.

    As an exception it would pass through half-made modules, some of which, compiled ones above all, turn it
    into an ImportError of their own and a long traceback.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may say what signals do
        return

    def stop(*_: object) -> NoReturn:
        os.write(2, b"planfit: stopped; nothing was begun\n")
        os._exit(EXIT_INTERRUPTED)

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)

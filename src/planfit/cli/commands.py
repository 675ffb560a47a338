"""The commands: their names, what they take, the page that lists them; and `planfit help TOPIC`, the pages of
the documentation in a terminal, which wheels carry.

Nothing heavy is imported here: what a command needs is imported when the command is run.
"""

import re
import sys
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from planfit import __version__
from planfit.cli.gone_options import refuse_gone_flag
from planfit.errors import OptionError, did_you_mean

EXIT_CODES = (
    "0 done; 1 done, but with reservations, no better than before or not surely aligned; 2 bad input; "
    "130 stopped"
)
EVERYWHERE = "-q, --quiet; -v, --verbose; --log FILE; --units ft"
HELP = ("-h", "--help", "--help-all")


@dataclass(frozen=True)
class KnownFlag:
    """A name of a flag, or a word that chooses one of several kinds, as a command's list has it."""

    kind: str
    """What it takes: nothing, for a `switch`; a path, `file`; `several` values, each behind the flag again;
    another value, `one`. Else it is a `word`."""
    choices: tuple[str, ...] = ()
    """The values, where these can be listed."""


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

    @property
    def flags_path(self) -> Path:
        """The list of all its flags. It is written by docs/reference.py too: neither a misspelt word nor the
        Tab key may take seconds."""
        return self.help_path.with_suffix(".flags")

    def known_flags(self) -> dict[str, KnownFlag]:
        """All its flags by name, aliases and `--no-` forms too."""
        return _listed(self.flags_path)

    def check_flags(self, words: Sequence[str]) -> None:
        """Raise `OptionError` at the first word that looks like a flag and is none, naming the nearest one,
        or the usage, where that has a word of this name; and at a switch that is given a value."""
        known = self.known_flags()
        for word in words:
            name = plain_name(word)
            if not looks_like_flag(word) or name in HELP or name.startswith("--tyro-"):
                continue
            if name in known:
                is_switch, value = known[name].kind == "switch", word.partition("=")[2]
                if is_switch and "=" in word:
                    raise OptionError(
                        f"{name}: expected no value behind it, found {value!r}; give {name} alone"
                    )
                continue
            if name.removeprefix("--").upper() in re.split(r"[ \[\]]+", self.usage):
                raise OptionError(
                    f"{name}: expected 'planfit {self.name} {self.usage}', found an option in place of a "
                    f"word; leave {name} out"
                )
            refuse_gone_flag(name)
            meant = did_you_mean(name, known)
            raise OptionError(
                f"{name}: expected an option of 'planfit {self.name}', found an unknown one; "
                f"{f'{meant} ' if meant else ''}'planfit {self.name} --help-all' lists every one"
            )


@cache
def _listed(path: Path) -> dict[str, KnownFlag]:
    """One a line: its name, its kind, the values that it takes."""
    lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
    return {name: KnownFlag(kind, tuple(values)) for name, kind, *values in lines}


def looks_like_flag(word: str) -> bool:
    """Whether a word is meant as a flag: numbers below 0 are not."""
    return re.match(r"--?[A-Za-z]", word) is not None


def plain_name(word: str) -> str:
    """The name of a flag, without a value that is written to it, and as the lists have it."""
    return word.split("=", 1)[0].replace("_", "-")


def off_name(name: str) -> str:
    """The flag that switches off what another switches on: `--adjust.walls.no-mutual`."""
    begin = name.rfind(".") + 1 or len("--")
    return f"{name[:begin]}no-{name[begin:]}"


COMMANDS = (
    Command(
        "refine",
        "SCAN [SCAN ...] [PLAN | --no-plan] -o OUT",
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
        ("out", "view", "workers"),
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
        ("json", "folder", "cache", "compile"),
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


COMMANDS_BY_NAME = {command.name: command for command in COMMANDS}


WIDTH = 80
"""Columns of the narrowest terminal in use: 80, as of the VT100."""


def overview() -> str:
    """What `planfit --help` prints."""
    lines = []
    for command in COMMANDS:
        lines.append(f"  {command.name} {command.usage}")
        lines += textwrap.wrap(
            command.summary, WIDTH - 1, initial_indent=" " * 6, subsequent_indent=" " * 6
        )
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
            "'planfit COMMAND --help' shows the options that matter, --help-all every one;",
            "'planfit help TOPIC' a page of the documentation, 'planfit help' lists them.",
            *textwrap.wrap(f"exit codes: {EXIT_CODES}", WIDTH - 1),
            "",
        ]
    )


_FOLDERS = (Path(__file__).parents[1] / "pages", Path(__file__).parents[3] / "docs")
"""Of a wheel (hatch_build.py), and of the sources."""


def topics() -> dict[str, Path]:
    """The pages by what `planfit help` calls them."""
    folder = next((each for each in _FOLDERS if each.is_dir()), _FOLDERS[0])
    return {path.stem: path for path in sorted(folder.glob("*.md"))}


def show_help(words: list[str]) -> None:
    """Print the overview and the topics, or the page of a topic, or the help of a command.

    Raises:
        OptionError: there is no such topic.
    """
    known = topics()
    if not words:
        listed = textwrap.wrap(", ".join(known), WIDTH - 1, break_on_hyphens=False)
        print("\n".join([overview(), "topics of 'planfit help TOPIC':", *listed]))
        return
    name = " ".join(words)
    path = COMMANDS_BY_NAME[name].help_path if name in COMMANDS_BY_NAME else known.get(name)
    if path is None:
        step = did_you_mean(name, [*known, *COMMANDS_BY_NAME]) or "'planfit help' lists all"
        raise OptionError(f"help: expected a topic or a command, found {name!r}; {step}")
    text = path.read_text(encoding="utf-8")
    if sys.stdout.isatty():
        import pydoc  # takes longer than all else here

        pydoc.pager(text)
    else:
        print(text, end="")

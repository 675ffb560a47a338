"""The commands: their names, what they take, and the page that lists them.

Nothing heavy is imported here: what a command needs is imported when the command is run.
"""

import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from planfit import __version__

EXIT_CODES = (
    "0 done; 1 done, but with reservations, no better than before or not surely aligned; 2 bad input; "
    "130 stopped"
)
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


_WIDTH = 80
"""Columns of the narrowest terminal in use."""


def overview() -> str:
    """What `planfit --help` prints."""
    lines = []
    for command in COMMANDS:
        lines.append(f"  {command.name} {command.usage}")
        lines += textwrap.wrap(
            command.summary, _WIDTH - 1, initial_indent=" " * 6, subsequent_indent=" " * 6
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
            "'planfit COMMAND --help' shows the options that matter, --help-all every one.",
            *textwrap.wrap(f"exit codes: {EXIT_CODES}", _WIDTH - 1),
            "",
        ]
    )

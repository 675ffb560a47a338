"""`planfit synth`: a synthetic scan, written in the FACaP layout with its plan and its truth."""

import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from planfit.cli.console import StageBars, out
from planfit.errors import OutputError
from planfit.synth import SynthOptions, make_scan, write_facap


@dataclass(frozen=True)
class SynthArguments:
    """Write a synthetic scan of a synthetic building, with drifted poses, its plan and its truth."""

    out: tyro.conf.Positional[Path]
    """Folder for the scan; must not exist or be empty."""
    options: Annotated[SynthOptions, tyro.conf.arg(name="")] = field(default_factory=SynthOptions)


def synth_command(arguments: SynthArguments) -> int:
    """Build, render, write."""
    if arguments.out.exists() and (not arguments.out.is_dir() or any(arguments.out.iterdir())):
        raise OutputError(f"{arguments.out}: expected no such folder, found files; choose another")
    with StageBars() as bars:
        synthetic = make_scan(arguments.options)
        try:
            write_facap(
                arguments.out, synthetic, lambda done, total: bars.update("render", done, total)
            )
        except BaseException:
            shutil.rmtree(arguments.out, ignore_errors=True)  # half a scan is of no use
            raise
    out.print(f"{len(synthetic.scan)} frames and their plan: {arguments.out}")
    out.print(f"next: planfit refine {arguments.out} -o {arguments.out}-refined")
    return 0

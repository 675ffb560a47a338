"""The paper's tables on synthetic and real scans; two variants or versions compared on the same scans."""

import os
import platform
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, NoReturn

import tyro

from paper_tables.page import write_page
from paper_tables.paired import compare_paired
from paper_tables.results import Measured, Results, read_results
from paper_tables.run import BenchOptions, run_bench
from paper_tables.scans import descent_scan, paper_scans, small_scans
from planfit import __version__
from planfit.cli.console import StageBars, out, table
from planfit.cli.main import exit_with, in_one_line
from planfit.cli.parser import parse
from planfit.errors import OptionError, require
from planfit.runtime import Runtime

NAME = "python benchmarks/paper_tables"


@dataclass(frozen=True)
class PaperArguments:
    """Measure every row of the paper's three tables, with the paper's cost and with the default, on ten
    synthetic scans in two sets, and on real ones. Goes on where it stopped."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("paper.json")
    """JSON file of results."""
    real: tuple[Path, ...] = ()
    """Folders of real scans with their plan (FACaP layout) and `groundtruth.tum`, measured too."""
    small: bool = False
    """Two scans of 60 frames instead of the ten."""
    descent: bool = field(default_factory=lambda: find_spec("torch") is not None)
    """Also the paper's own descent, its whole schedule, on a small scan of its own: half an hour. By default
    where PyTorch is installed."""
    page: Path | None = None
    """Also write the tables as a Markdown page."""
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Threads."""


@dataclass(frozen=True)
class PageArguments:
    """Write the tables of a file of results as a Markdown page."""

    results: tyro.conf.Positional[Path]
    """What `paper` wrote."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Markdown file, written anew."""


@dataclass(frozen=True)
class CompareArguments:
    """Compare B with A on the scans that both were measured on, pair by pair: two versions, two options."""

    a: tyro.conf.Positional[str]
    """A file of results, and which variant of it: `FILE` or `FILE:PRESET/NAME`; `default/all` if none is
    named."""
    b: tyro.conf.Positional[str]
    """Another, or another variant of the same file."""


Arguments = (
    Annotated[PaperArguments, tyro.conf.subcommand("paper")]
    | Annotated[PageArguments, tyro.conf.subcommand("page")]
    | Annotated[CompareArguments, tyro.conf.subcommand("compare")]
)


def main() -> NoReturn:
    """Run what the command line says, and exit."""
    exit_with(lambda: run(sys.argv[1:]))


def run(argv: Sequence[str]) -> int:
    """Measure, write the page, or compare; the exit code."""

    def action() -> int:
        arguments = parse(Arguments, NAME, list(argv))
        if isinstance(arguments, PaperArguments):
            _measure(arguments)
        elif isinstance(arguments, PageArguments):
            write_page(read_results(arguments.results), arguments.out)
            out.print(f"written: {arguments.out}", soft_wrap=True)
        else:
            _compare(arguments)
        return 0

    return in_one_line(action, "what is measured is kept, the same command goes on from there")


def _measure(arguments: PaperArguments) -> None:
    options = BenchOptions(
        out=arguments.out,
        scans=small_scans() if arguments.small else paper_scans(),
        real=arguments.real,
        descent=descent_scan() if arguments.descent else None,
    )
    conditions = f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
    with StageBars() as bars:
        runtime = Runtime(arguments.workers, None, bars.update)
        results = run_bench(options, __version__, conditions, runtime, _tell)
    if arguments.page is not None:
        write_page(results, arguments.page)
        out.print(f"written: {arguments.page}", soft_wrap=True)
    out.print(f"written: {arguments.out}", soft_wrap=True)


def _tell(measured: Measured) -> None:
    if measured.failed:
        out.print(f"{measured.scan}, {measured.variant}: [yellow]{measured.failed}[/]")
        return
    shown = ", ".join(
        f"{name} {measured.metrics[name]:.3f}"
        for name in ("mme", "mpv", "mom", "nnd", "nsd", "ate")
        if name in measured.metrics
    )
    out.print(f"{measured.scan}, {measured.variant}: {shown}", soft_wrap=True)


def _compare(arguments: CompareArguments) -> None:
    sides = [_side(text) for text in (arguments.a, arguments.b)]
    metrics = []
    for results, variant, path in sides:
        found = results.metrics_of(variant)
        known = sorted({m.variant for m in results.measured})
        require(
            bool(found),
            f"{path}: expected metrics of {variant}, found those of {', '.join(known) or 'none'}",
        )
        metrics.append(found)
    rows = []
    for row in compare_paired(*metrics):
        error = row.standard_error
        sure = "" if not error > 0 else f"{row.mean_difference / error:+.1f}"
        rows.append(
            [
                row.name,
                f"{row.mean_a:.4g}",
                f"{row.mean_b:.4g}",
                f"{row.mean_difference:+.4g}",
                f"{row.sigma:.3g}",
                sure,
                f"{row.wins} of {row.n}",
            ]
        )
    title = f"A: {arguments.a}, B: {arguments.b}; {rows[0][-1].split()[-1]} scans; lower is better"
    columns = [
        "",
        "mean A",
        "mean B",
        "mean B - A",
        "sigma",
        "in standard errors",
        "B better",
    ]
    out.print(table(title, columns, rows))


def _side(text: str) -> tuple[Results, str, str]:
    path, _, variant = text.partition(":")
    if not path:
        raise OptionError(f"{text!r}: expected FILE or FILE:PRESET/NAME")
    return read_results(Path(path)), variant or "default/all", path

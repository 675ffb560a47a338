"""Do stated errors mean what they say? Covariances of poses beside true errors, over small synthetic scans.

python benchmarks/consistency.py run -o consistency.jsonl
python benchmarks/consistency.py page consistency.jsonl -o docs/consistency.md
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NoReturn

import consistency_cases
import numpy as np
import tyro
from consistency_cases import WORLDS, Consistency, Consistent, all_cases, measure
from faults.batches import PageArguments, answer, digest_with, tell, write_page
from faults.battery import read_measured, run_battery
from faults.measure import How, Measured

from planfit import RefineOptions
from planfit.cli.console import out
from planfit.cli.main import exit_with
from planfit.errors import OutputError

NAME = "python benchmarks/consistency.py"


@dataclass(frozen=True)
class RunArguments:
    """Measure all scans. Goes on where it stopped; what was measured with other code is measured again."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("consistency.jsonl")
    """One line a scan, added to."""
    half: str = "both"
    """Those for `choosing`, those for `reporting`, or `both`."""
    jobs: int = 2
    """Scans at a time, each in a process of its own."""
    cache: Path = Path("faults.cache")
    """Folder for rendered images and keypoints; that of benchmarks/faults may be used."""


Arguments = (
    Annotated[RunArguments, tyro.conf.subcommand("run")]
    | Annotated[PageArguments, tyro.conf.subcommand("page")]
)

_HEAD = """# Stated errors beside true ones

From `python benchmarks/consistency.py run` and `python benchmarks/consistency.py page consistency.jsonl
-o docs/consistency.md`. Thirty flats of two to five rooms, 80 frames each, by both kinds of sensor,
furnished or hardly. *NEES* is the mean over frames of squared errors by their covariances, for each number
of a position (3) or a pose (6): 1 where covariances mean what they say, less where they are too wide. *In
95 %* is the share of frames whose error lies in the ellipsoid that should hold 95 % of them; of the radius,
in `radius_95_m` of `trajectory_sigma.csv`. Errors are those on the plan, without alignment to the truth.
What decides was chosen on scans of even numbers."""


def main() -> NoReturn:
    """Run what the command line says, and exit."""
    exit_with(lambda: run(sys.argv[1:]))


def run(argv: Sequence[str]) -> int:
    """Measure, or write the page; the exit code."""
    return answer(argv, Arguments, NAME, {RunArguments: _run, PageArguments: _write_page})


def _write_page(arguments: PageArguments) -> None:
    write_page(arguments.out, make_page(pair(all_cases(), _read(arguments.measured))))


Pair = tuple[Consistency, Consistent]


def pair(cases: Sequence[Consistency], measured: Sequence[Consistent]) -> list[Pair]:
    """Cases with what was last measured of them; those that gave no poses too."""
    last = {m.number: m for m in measured}
    return [(case, last[case.number]) for case in cases if case.number in last]


def make_page(pairs: Sequence[Pair]) -> str:
    """The page as Markdown."""
    columns = "NEES, position | in 95 % | NEES, pose | in 95 % | in 95 % radius"
    head = f"| scans | number | error, m | predicted, m | {columns} |"
    rows = [head, "| --- " * 9 + "|"]
    for words, chosen in (
        ("for reporting", [p for p in pairs if not p[0].is_for_choosing]),
        ("for choosing", [p for p in pairs if p[0].is_for_choosing]),
    ):
        rows.append(summary(f"**{words}**", chosen))
        rows += [summary(world, [p for p in chosen if p[0].world == world]) for world in WORLDS]
    each = [head.replace("scans | number", "scan | exit"), "| --- " * 9 + "|"]
    each += [_row(case.name, str(m.exit_code), [m]) for case, m in pairs]
    return "\n\n".join([_HEAD, "\n".join(rows), "## Scan by scan", "\n".join(each)]) + "\n"


def summary(words: str, pairs: Sequence[Pair]) -> str:
    """A row of the table: means over scans, and the median error."""
    return _row(words, str(len(pairs)), [m for _, m in pairs])


def _row(words: str, number: str, measured: Sequence[Consistent]) -> str:
    known = [m for m in measured if m.error_m is not None]
    if not known:
        return f"| {words} | {number} " + "| - " * 7 + "|"
    errors, predicted = (
        np.median([getattr(m, n) for m in known]) for n in ("error_m", "predicted_m")
    )
    names = ("nees_position", "within_position", "nees_pose", "within_pose", "within_radius")
    means = {name: float(np.mean([getattr(m, name) for m in known])) for name in names}
    figures = [f"{v:.2f}" if name.startswith("nees") else f"{v:.1%}" for name, v in means.items()]
    return f"| {words} | {number} | {errors:.4f} | {predicted:.4f} | " + " | ".join(figures) + " |"


def _run(arguments: RunArguments) -> None:
    options = RefineOptions()
    digest = digest_with(options, consistency_cases)
    how = How(arguments.cache.resolve(), digest, options)
    halves = {"both": (True, False), "choosing": (True,), "reporting": (False,)}
    if arguments.half not in halves:
        raise OutputError(f"--half: expected {', '.join(halves)}, found {arguments.half}")
    chosen = [case for case in all_cases() if case.is_for_choosing in halves[arguments.half]]
    run_battery(chosen, arguments.out, how, arguments.jobs, _tell, measure)
    measured = [m for m in _read(arguments.out) if m.digest == digest]
    out.print(summary("all", pair(chosen, measured)), soft_wrap=True)


def _read(path: Path) -> list[Consistent]:
    return [m for m in read_measured(path, Consistent) if isinstance(m, Consistent)]


def _tell(measured: Measured, left: int) -> None:
    assert isinstance(measured, Consistent)
    said = measured.said[:160]
    if measured.error_m is not None:
        said = f"{measured.error_m:.4f} m, predicted {measured.predicted_m:.4f} m, " + (
            f"NEES {measured.nees_position:.2f}, {measured.within_position:.0%} within"
        )
    tell(measured, f"{measured.name}: {said}", left)


if __name__ == "__main__":
    main()

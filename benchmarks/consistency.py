"""Do stated errors mean what they say, and is anything corrected that is right? Over flats drawn at random.

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
from consistency_cases import N_SCANS, WORLDS, Consistency, Consistent, all_cases, measure
from faults.batches import PageArguments, answer, digest_with, tell, write_page
from faults.battery import read_measured, run_battery
from faults.measure import How, Measured

from planfit import RefineOptions
from planfit.cli.console import out
from planfit.cli.main import exit_with
from planfit.errors import OutputError

NAME = "python benchmarks/consistency.py"
TOLERANCE_M = 0.15
"""Of a result that is vouched for; that of the verdict."""


@dataclass(frozen=True)
class RunArguments:
    """Measure all scans. Goes on where it stopped; what was measured with other code is measured again."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("consistency.jsonl")
    """One line a scan, added to."""
    first: int = N_SCANS
    """So many of the scans, from the first."""
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

_HEAD = """# Stated errors beside true ones, and what is corrected that is right

From `python benchmarks/consistency.py run` and `python benchmarks/consistency.py page consistency.jsonl
-o docs/consistency.md`. Flats of two to eight rooms, drawn at random: bare or furnished, by both kinds of
sensor, with half to one and a half times the drift of the real building site. Three of four are *honest*:
nothing is wrong but drift and noise, and nothing is to be corrected. *NEES* is the mean over frames of
squared errors by their covariances, for each number of a position (3) or a pose (6): 1 where covariances
mean what they say, less where they are too wide. *In 90 %* is the share of frames whose error along x, y and
z lies in the interval that should hold 90 % of them. *In 95 %* is the share whose error lies in the
ellipsoid that should hold 95 %; of the radius, in `radius_95_m` of `trajectory_sigma.csv`. Errors are those
on the plan, without alignment to the truth. *False* counts scans of which a correction was announced that is
none, *silent* those that are off by more than 0.15 m and vouched for. What decides was chosen on scans of
even numbers."""


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
    rows = [f"| scans | number | {_COLUMNS} |", "| --- " * 12 + "|"]
    for words, chosen in (
        ("for reporting", [p for p in pairs if not p[0].is_for_choosing]),
        ("for choosing", [p for p in pairs if p[0].is_for_choosing]),
    ):
        rows.append(summary(f"**{words}**", chosen))
        rows.append(summary("honest", [p for p in chosen if p[0].is_honest]))
        rows += [summary(world, [p for p in chosen if p[0].world == world]) for world in WORLDS]
    amiss = [
        f"- {case.name}: exit {m.exit_code}, {m.error_m} m, "
        f"false: {', '.join(m.false) or 'nothing'}; {m.said}"
        for case, m in pairs
        if m.false or m.exit_code or is_silent(m)
    ]
    return (
        "\n\n".join(
            [_HEAD, "\n".join(rows), "## False, silent, or not vouched for", "\n".join(amiss)]
        )
        + "\n"
    )


_COLUMNS = (
    "exit 0 | false | silent | error, m | predicted, m | NEES, position | in 90 %, x, y, z | in 95 % "
    "| NEES, pose | in 95 % radius"
)


def is_silent(measured: Consistent) -> bool:
    """Whether a wrong result was vouched for."""
    return measured.exit_code == 0 and (measured.error_m or 0.0) > TOLERANCE_M


def summary(words: str, pairs: Sequence[Pair]) -> str:
    """A row of the table: means over scans, and the median error."""
    known = [m for _, m in pairs if m.error_m is not None]
    if not known:
        return f"| {words} | {len(pairs)} " + "| - " * 10 + "|"
    n_vouched, n_false, n_silent = (
        sum(map(bool, each))
        for each in (
            [m.exit_code == 0 for m in known],
            [m.false for m in known],
            [is_silent(m) for m in known],
        )
    )
    errors, predicted = (
        np.median([getattr(m, n) for m in known]) for n in ("error_m", "predicted_m")
    )
    names = ("nees_position", "within_position", "nees_pose", "within_radius")
    nees, within, nees_pose, radius = (np.mean([getattr(m, n) for m in known]) for n in names)
    axes = ", ".join(f"{share:.0%}" for share in np.mean([m.within_axes for m in known], axis=0))
    return (
        f"| {words} | {len(pairs)} | {n_vouched} | {n_false} | {n_silent} | {errors:.4f} | {predicted:.4f} "
        f"| {nees:.2f} | {axes} | {within:.1%} | {nees_pose:.2f} | {radius:.1%} |"
    )


def _run(arguments: RunArguments) -> None:
    options = RefineOptions()
    digest = digest_with(options, consistency_cases)
    how = How(arguments.cache.resolve(), digest, options)
    halves = {"both": (True, False), "choosing": (True,), "reporting": (False,)}
    if arguments.half not in halves:
        raise OutputError(f"--half: expected {', '.join(halves)}, found {arguments.half}")
    cases = all_cases()[: arguments.first]
    chosen = [case for case in cases if case.is_for_choosing in halves[arguments.half]]
    run_battery(chosen, arguments.out, how, arguments.jobs, _tell, measure)
    measured = [m for m in _read(arguments.out) if m.digest == digest]
    out.print(summary("all", pair(chosen, measured)), soft_wrap=True)


def _read(path: Path) -> list[Consistent]:
    return [m for m in read_measured(path, Consistent) if isinstance(m, Consistent)]


def _tell(measured: Measured, left: int) -> None:
    assert isinstance(measured, Consistent)
    said = measured.said[:160]
    if measured.error_m is not None:
        said = (
            f"exit {measured.exit_code}, {measured.error_m:.4f} m, predicted {measured.predicted_m:.4f} m, "
            f"NEES {measured.nees_position:.2f}, false: {', '.join(measured.false) or 'nothing'}"
        )
    tell(measured, f"{measured.name}: {said}", left)


if __name__ == "__main__":
    main()

"""Does planfit find what a depth camera gets wrong? Faults put on scans' images, poses held to the truth.

python benchmarks/calibration.py run -o calibration.jsonl
python benchmarks/calibration.py page calibration.jsonl -o docs/calibration-figures.md
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NoReturn

import calibration_cases
import tyro
from calibration_cases import (
    Calibrated,
    Judged,
    all_cases,
    choose,
    judge_all,
    measure,
    shares,
)
from faults.batches import PageArguments, answer, digest_with, of_present_scans, tell, write_page
from faults.battery import TIME_LIMIT_S, read_measured, run_battery
from faults.measure import CRASHED, How, Measured

from planfit import RefineOptions
from planfit.cli.console import out, table
from planfit.cli.main import exit_with
from planfit.errors import OutputError

NAME = "python benchmarks/calibration.py"


@dataclass(frozen=True)
class RunArguments:
    """Measure cases. Goes on where it stopped; what was measured with other code is measured again."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("calibration.jsonl")
    """One line a case, added to."""
    only: str = ""
    """Words that the case's name holds, several with `|` between: "depth x0.95|focal +5%"."""
    scans: tuple[str, ...] = ()
    """Names of scans, or of a scan with its drift: "conslam, drift 1"; all without."""
    jobs: int = 2
    """Cases at a time, each in a process of its own."""
    cache: Path = Path("faults.cache")
    """Folder for rendered images and keypoints; that of benchmarks/faults may be used."""
    limit_s: float = TIME_LIMIT_S
    """A case that takes longer is ended and counts as a crash; more on a machine that is busy."""


Arguments = (
    Annotated[RunArguments, tyro.conf.subcommand("run")]
    | Annotated[PageArguments, tyro.conf.subcommand("page")]
)

_HEAD = """# The sensor's calibration

From `python benchmarks/calibration.py run` and `python benchmarks/calibration.py page calibration.jsonl
-o docs/calibration-figures.md`. Faults of a depth camera are put on the images and cameras of scans whose
truth is known; planfit is told nothing of them. Errors are RMS of positions in the plan's frame, without
alignment to the truth. *Beside* is the same scan with the same drift and no fault; of the faultless rows,
the same without calibration (`RefineOptions.calibration.is_on`). Parameters are departures from 1 or 0, those
that undo the fault; in brackets what was estimated and not corrected. What decides what is believed was
chosen on ConSLAM's drifts 0 and 3, the flat's drifts 1 and 2, the offices' drifts 1 and 2, and the kitchen's
drift 0: none of these is here."""


def main() -> NoReturn:
    """Run what the command line says, and exit."""
    exit_with(lambda: run(sys.argv[1:]))


def run(argv: Sequence[str]) -> int:
    """Measure, or write the page; the exit code."""
    return answer(argv, Arguments, NAME, {RunArguments: _run, PageArguments: _write_page})


def _write_page(arguments: PageArguments) -> None:
    write_page(arguments.out, make_page(judge_all(all_cases(), _read(arguments.measured))))


def make_page(judged: Sequence[Judged]) -> str:
    """The page as Markdown."""
    figures = ["| figure | of | cases |", "| --- | --- | --- |"]
    figures += [f"| {name} | {some} | {n} |" for name, (some, n) in shares(judged).items()]
    head = "| fault | error, m | beside, m | ratio | near | put in | found | sigma | right |"
    parts = [_HEAD, "\n".join(figures)]
    for setting in dict.fromkeys(j.case.setting for j in judged):
        rows = [head, "| --- | --- | --- | --- | --- | --- | --- | --- | --- |"]
        rows += ["| " + " | ".join(row_of(j)) + " |" for j in judged if j.case.setting == setting]
        parts += [f"## {setting}", "\n".join(rows)]
    return "\n\n".join(parts) + "\n"


def row_of(judged: Judged) -> list[str]:
    """Fault, error, that beside it, ratio, whether near enough; put in, found, sigma, whether right."""
    measured = judged.measured
    if measured.error_m is None:
        return [judged.case.fault.name, f"none: {measured.said[:80]}", *["-"] * 7]
    beside = judged.reference.error_m if judged.reference else None
    names = list(dict.fromkeys([*measured.put_in, *measured.found, *measured.implausible]))

    def words(values: dict[str, float], open_where_not_found: bool = False) -> str:
        said = []
        for name in names:
            if name in values:
                number = f"{name} {values[name]:+.4f}"
                is_open = open_where_not_found and name not in measured.found
                said.append(f"({number})" if is_open else number)
        return ", ".join(said) or "-"

    found = words({**measured.asked, **measured.found}, open_where_not_found=True)
    if measured.implausible:
        found += "; implausible"
    sigma = ", ".join(f"{measured.sigmas[n]:.4f}" for n in names if n in measured.sigmas) or "-"
    return [
        judged.case.fault.name,
        f"{measured.error_m:.4f}",
        "-" if beside is None else f"{beside:.4f}",
        f"{judged.ratio:.2f}",
        "yes" if judged.is_near else "no",
        words(measured.put_in),
        found,
        sigma,
        "yes" if judged.is_recovered else "no",
    ]


def _run(arguments: RunArguments) -> None:
    options = RefineOptions()
    digest = digest_with(options, calibration_cases)
    how = How(arguments.cache.resolve(), digest, options)
    known = dict.fromkeys(name for case in all_cases() for name in (case.scan, case.setting))
    unknown = set(arguments.scans) - set(known)
    if unknown:
        raise OutputError(
            f"--scans: expected some of {'; '.join(known)}, found {'; '.join(sorted(unknown))}"
        )
    here = of_present_scans(choose(all_cases(), arguments.only, arguments.scans))
    run_battery(here, arguments.out, how, arguments.jobs, _tell, measure, arguments.limit_s)
    judged = judge_all(here, [m for m in _read(arguments.out) if m.digest == digest])
    rows = [[name, str(some), str(n)] for name, (some, n) in shares(judged).items() if n]
    out.print(table("the sensor's calibration", ["", "of", "cases"], rows))


def _read(path: Path) -> list[Calibrated]:
    return [m for m in read_measured(path, Calibrated) if isinstance(m, Calibrated)]


def _tell(measured: Measured, left: int) -> None:
    code = "crash" if measured.exit_code == CRASHED else f"exit {measured.exit_code}"
    error = "no poses" if measured.error_m is None else f"{measured.error_m:.4f} m"
    found = getattr(measured, "found", {})
    words = (
        ", ".join(f"{name} {value:+.4f}" for name, value in found.items()) or "nothing corrected"
    )
    said = "" if measured.error_m is not None else f", {measured.said[:160]}"
    tell(measured, f"{measured.name}: {error}, {words}, {code}{said}", left)


if __name__ == "__main__":
    main()

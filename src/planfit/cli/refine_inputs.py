"""What `planfit refine` takes: its arguments, and the scans and plans that they name."""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro

from planfit.cli.arguments import AlignmentFlags, Flat, Out, PlanFlags, SurveyFlags
from planfit.errors import FloorplanError, OptionError, ScanError, require
from planfit.floorplan import Floorplan, PlanOptions, read_floorplan
from planfit.floorplan.formats import READERS
from planfit.pipeline.options import RefineOptions
from planfit.report.html.page import ReportOptions
from planfit.scan import Scan, ScanOptions, read_scan


@dataclass(frozen=True)
class RefineArguments:
    """Refine the camera poses of a scan so that its reconstruction agrees with the floorplan; or, with
    --no-plan, with itself."""

    scan: tyro.conf.Positional[tuple[Path, ...]]
    """Folder of the scan, zip archive of one, or bag; several of one storey are refined together. A file of a
    plan among them is the plan, as by --plan."""
    out: Out[Path]
    """Folder for the results."""
    plan: Annotated[
        tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="[NUMBER=]FILE")
    ] = ()
    """Floorplan; by default the one inside the scan's folder. Of a walk through several storeys, that of each
    by its number: `--plan 0=ground.pdf --plan 1=first.pdf`."""
    no_plan: tyro.conf.FlagCreatePairsOff[bool] = False
    """Refine without a plan, even if the scan's folder holds one: by closed loops, floors, ceilings alone."""
    preset: str = "default"
    """Options to begin with: `default`, what works best, or `paper`, the published method to the letter."""
    scan_options: Flat[ScanOptions] = field(default_factory=ScanOptions)
    plan_flags: Flat[PlanFlags] = field(default_factory=PlanFlags)
    alignment_flags: Flat[AlignmentFlags] = field(default_factory=AlignmentFlags)
    survey_flags: Flat[SurveyFlags] = field(default_factory=SurveyFlags)
    corrections: Path | None = None
    """TOML file of corrections by hand (`planfit help corrections`): places, loops, frames, walls."""
    without_contradicted: tyro.conf.FlagCreatePairsOff[bool] = False
    """Leave out corrections that others or the scan contradict, and solve again without them; else they are
    used, as far as they can be, and named."""
    config: Path | None = None
    """TOML file of options, on top of the preset and overruled by flags."""
    overwrite: bool = False
    """Replace the results of another run in the output folder."""
    cache: Path | None = None
    """Folder that keeps finished stages, which runs may share, also at the same time; else OUT/cache."""
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Threads."""
    report: ReportOptions = field(default_factory=ReportOptions)
    """The report."""
    options: Flat[RefineOptions] = field(default_factory=RefineOptions)

    def with_plan_among_scans(self) -> "RefineArguments":
        """The same with a plan that stands among the scans as `--plan`.

        Raises:
            OptionError: there are several plans, or one besides that of a flag.
        """
        plans = [path for path in self.scan if is_plan_file(path)]
        scans = tuple(path for path in self.scan if path not in plans)
        if not plans or not scans:  # that nothing but a plan is given, its reading as a scan tells
            return self
        named = " and ".join([*map(str, plans), *self.plan])
        require(
            len(plans) == 1 and not self.plan,
            f"refine: expected one plan, found {named}; plans of storeys are --plan 0=FILE --plan 1=FILE",
        )
        return replace(self, scan=scans, plan=(str(plans[0]),))


def is_plan_file(path: Path) -> bool:
    """Whether a path is a plan by its suffix. Folders and archives, which scans are as well, are not: a plan
    as IMDF takes --plan."""
    suffix = path.suffix.lower()
    return suffix in READERS and suffix != ".zip" and not path.is_dir()


def read_scans(arguments: RefineArguments) -> list[Scan]:
    """All scans.

    Raises:
        ScanError: some cannot be read: all of them are named.
    """
    reads_masks, options = arguments.options.segmentation.reads_masks, arguments.scan_options
    scans, errors = [], []
    for path in arguments.scan:
        try:
            scans.append(read_scan(path, reads_masks, options))
        except ScanError as error:
            errors.append(str(error))
    if errors:
        raise ScanError("; ".join(errors))
    return scans


def read_plan(arguments: RefineArguments, scan: Scan) -> Floorplan | dict[int, Floorplan] | None:
    """The plan to refine against, or those of storeys; None where the user wants none."""
    if arguments.no_plan:
        require(
            not arguments.plan
            and arguments.plan_flags == PlanFlags()
            and arguments.alignment_flags == AlignmentFlags(),
            "--no-plan: expected no flags of a plan beside it, found some; leave out one or the other",
        )
        return None
    if arguments.plan:
        return read_plans(arguments.plan, arguments.plan_flags.options)
    if scan.floorplan_path is None:
        raise FloorplanError(
            f"{scan.name}: expected a floorplan inside the scan's folder, found none; "
            "give one behind the scan ('planfit refine SCAN PLAN -o OUT'), or refine by closed loops and "
            "floor alone with --no-plan"
        )
    return read_floorplan(scan.floorplan_path, arguments.plan_flags.options)


def read_plans(words: Sequence[str], options: PlanOptions) -> Floorplan | dict[int, Floorplan]:
    """One plan, or plans by the number of their storey.

    Words are `FILE`, or `NUMBER=FILE` once or more. A file that is given for several storeys holds them: of
    each, the storey of its number is read.

    Raises:
        OptionError: a number is none or comes twice, or there are several plans without numbers.
        FloorplanError: a plan cannot be read, or a file that is given twice holds one storey.
    """
    if len(words) == 1 and ("=" not in words[0] or Path(words[0]).exists()):
        return read_floorplan(words[0], options)
    paths: dict[int, Path] = {}
    for word in words:
        number, path = _numbered(word)
        require(
            number not in paths,
            f"--plan {word}: expected one plan for storey {number}, found two; give the other one its own "
            "number",
        )
        paths[number] = path
    plans = {}
    for number, path in paths.items():
        is_shared = list(paths.values()).count(path) > 1
        chosen = replace(options, storey=str(number)) if is_shared else options
        plans[number] = read_floorplan(path, chosen)
        if is_shared and not plans[number].source.storeys:
            raise FloorplanError(
                f"{path}: expected a file of several storeys, as it is given for more than one, found one "
                "plan; give each storey its own file"
            )
    return plans


def _numbered(word: str) -> tuple[int, Path]:
    number, found, path = word.partition("=")
    if not found or not path or not re.fullmatch(r"[+-]?\d+", number):
        raise OptionError(
            f"--plan {word}: expected NUMBER=FILE with the whole number of a storey, as there are plans by "
            f"storey, found {word!r}; give --plan 0=FILE --plan 1=FILE, from the lowest storey up"
        )
    return int(number), Path(path)

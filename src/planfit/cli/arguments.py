"""Groups of flags: how to read the plan, what is known of the alignment, surveyed points of the scan."""

import hashlib
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar, cast

import tyro

from planfit.errors import OptionError, require
from planfit.floorplan import PlanOptions
from planfit.floorplan.options import Unit
from planfit.scan import Scan
from planfit.survey import FAMILIES, Survey, SurveyAxes, read_marks, read_points

if TYPE_CHECKING:
    from planfit.pipeline.options import RefineOptions

Value = TypeVar("Value")
Flat = Annotated[Value, tyro.conf.arg(name="")]
"""A group of flags whose names begin with no name of the group."""
Out = Annotated[Value, tyro.conf.arg(aliases=["-o"])]
"""What is written, also named by `-o`."""


@dataclass(frozen=True)
class PlanFlags:
    """How to read the plan."""

    unit: Unit = "auto"
    """Unit of the plan's coordinates; `auto` takes what the file says, `unknown` leaves the scale to the
    alignment."""
    scale: Annotated[str | None, tyro.conf.arg(metavar="METRES|1:N")] = None
    """Metres of one unit of the file (a pixel, a point), or the scale on paper as 1:100 (PDF, SVG, pictures
    with dpi); overrules --unit."""
    storey: str = ""
    """Name or number (from 0) of the storey to read where a file holds several."""
    layer: Annotated[
        tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]], tyro.conf.arg(metavar="NAME ...")
    ] = ()
    """Layers that hold the walls (`*` stands for anything), `--layer A B` or `--layer A --layer B`; without,
    a guess from names and line work."""
    page: int = 1
    """Page of a PDF."""
    cut_height_m: float = 1.2
    """Height above the storey's floor at which models (IFC, meshes) are cut."""
    wall_mask: Path | None = None
    """Picture of the size of the plan, white where there is wall; takes the place of planfit's
    interpretation of the picture."""
    plan_edits: Path | None = None
    """JSON file of corrections of the plan as read, written by `planfit plan` (its flag write-edits)."""
    mirror: bool = False
    """Swap left and right of the plan: for one that was drawn or exported mirrored."""

    @property
    def options(self) -> PlanOptions:
        """The same as options of the readers.

        Raises:
            OptionError: a value cannot work.
        """
        metres, paper = parse_scale(self.scale)
        return PlanOptions(
            unit=self.unit,
            metres_per_unit=metres,
            paper_scale=paper,
            storey=self.storey,
            layers=tuple(name for names in self.layer for name in names),
            page=self.page,
            cut_height_m=self.cut_height_m,
            wall_mask=self.wall_mask,
            edits=self.plan_edits,
            mirror=self.mirror,
        )


def parse_scale(text: str | None) -> tuple[float | None, float | None]:
    """Metres of one unit, or N of a scale on paper 1:N.

    Raises:
        OptionError: it is neither.
    """
    if text is None:
        return None, None
    ratio = re.fullmatch(r"\s*1\s*[:/]\s*(\d+(?:\.\d+)?)\s*", text)
    try:
        number = float(ratio[1] if ratio else text)
    except ValueError:
        number = math.nan
    if not (math.isfinite(number) and number > 0):
        raise OptionError(
            f"--scale: expected metres of one unit of the file, as 0.02, or a scale as 1:100, found {text!r}"
        )
    return (None, number) if ratio else (number, None)


@dataclass(frozen=True)
class AlignmentFlags:
    """What is known of the alignment."""

    candidate: int = 1
    """Which of the alignment hypotheses is taken, 1 the best, as numbered by `planfit align`."""
    pin: Annotated[
        tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]],
        tyro.conf.arg(metavar="X,Y,Z=X,Y ..."),
    ] = ()
    """Known pairs "x,y,z=X,Y": a point of the scan in its own axes (m) and the same point on the plan, in the
    coordinates at the rim of `planfit plan PLAN -o plan.png`; "x,y,z=file:X,Y" in the file's own."""

    def added_to(self, options: "RefineOptions") -> "RefineOptions":
        """Options with these in place of `align.candidate`, and beside `align.control_points`."""
        points = tuple(point for points in self.pin for point in points)
        chosen = replace(
            options.align,
            candidate=self.candidate if self.candidate != 1 else options.align.candidate,
            control_points=options.align.control_points + points,
        )
        return replace(options, align=chosen)


@dataclass(frozen=True)
class SurveyFlags:
    """Surveyed points that the scan sees."""

    control_points: Annotated[Path | None, tyro.conf.arg(metavar="FILE.csv")] = None
    """Table id,x,y,z[,sigma] (m) of points that hold the poses; an empty z is not known."""
    check_points: Annotated[Path | None, tyro.conf.arg(metavar="FILE.csv")] = None
    """The same of points that take no part: how far they end from their places is reported."""
    marks: Annotated[Path | None, tyro.conf.arg(metavar="FILE.csv")] = None
    """Table frame,u,v,id of pixels that show points; with empty u and v, the camera stood at the point."""
    survey_axes: SurveyAxes | None = None
    """Whose axes the points are in: `plan`, as at the rim of `planfit plan PLAN -o plan.png`, heights above
    the floor; `file`, the plan file's own; `map`, those of its map conversion (IFC) or world file; `site`,
    others, without a plan. By default `plan`, without a plan `site`."""
    tags: Annotated[str, tyro.conf.arg(metavar="FAMILY")] = ""
    """Look for tags in the images, whose ids are ids of points: `apriltag-36h11`, `aruco-4x4-50` and others
    of these kinds."""
    tag_size_m: float | None = None
    """Side of the black square of a tag: tells its distance where depth is missing."""

    @property
    def is_given(self) -> bool:
        """Whether there are points."""
        return self.control_points is not None or self.check_points is not None

    def read(self, scan: Scan, has_plan: bool) -> Survey | None:
        """The survey; None without points.

        Raises:
            OptionError: a table cannot be read, or nothing tells where the points are seen.
        """
        if not self.is_given:
            require(
                self == SurveyFlags(),
                "--marks, --tags, --survey-axes: expected points beside them, found none; give "
                "--control-points FILE or --check-points FILE",
            )
            return None
        require(
            self.marks is not None or self.tags != "",
            "--control-points, --check-points: expected to be told where the points are seen, found neither "
            "--marks FILE nor --tags FAMILY; give one of them",
        )
        require(
            self.tags == "" or self.tags in FAMILIES,
            f"--tags: expected one of {', '.join(FAMILIES)}, found {self.tags!r}; name that of the tags",
        )
        require(
            self.tag_size_m is None or self.tag_size_m > 0,
            f"--tag-size-m: expected a length above 0, found {self.tag_size_m}; measure the black square",
        )
        points = []
        for path, is_check in ((self.control_points, False), (self.check_points, True)):
            points += read_points(path, is_check) if path is not None else ()
        marks = () if self.marks is None else read_marks(self.marks, scan.frame_ids)
        axes: SurveyAxes = self.survey_axes or ("plan" if has_plan else "site")
        return Survey(tuple(points), marks, axes, self.tags, self.tag_size_m)

    @property
    def inputs(self) -> dict[str, str]:
        """Files as the record of a run names them, with what tells their contents."""
        found = {}
        for name in _TABLES:
            path = getattr(self, name)
            if path is not None:
                found[name] = str(path.resolve())
                found[f"{name}_fingerprint"] = _fingerprint(path)
        if self.is_given:
            found |= {"survey_axes": self.survey_axes or "", "tags": self.tags}
            found["tag_size_m"] = "" if self.tag_size_m is None else repr(self.tag_size_m)
        return found

    @staticmethod
    def of_record(inputs: Mapping[str, str]) -> "SurveyFlags":
        """Those that a run was given, from the inputs that its record names.

        Raises:
            OptionError: a table is no longer there, or is another.
        """
        paths = {name: Path(inputs[name]) for name in _TABLES if name in inputs}
        flags = SurveyFlags(
            **paths,
            survey_axes=cast(SurveyAxes | None, inputs.get("survey_axes") or None),
            tags=inputs.get("tags", ""),
            tag_size_m=float(inputs["tag_size_m"]) if inputs.get("tag_size_m") else None,
        )
        for name, path in paths.items():
            is_there = path.is_file()
            require(
                is_there and _fingerprint(path) == inputs.get(f"{name}_fingerprint"),
                f"{path}: expected the {name.replace('_', ' ')} of the run, found "
                f"{'others' if is_there else 'nothing'}; run 'planfit refine' again with those of now",
            )
        return flags


_TABLES = ("control_points", "check_points", "marks")


def _fingerprint(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]

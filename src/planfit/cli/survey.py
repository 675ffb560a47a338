"""Flags of control and check points, and what is said of them."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, cast

import tyro

from planfit.cli.console import out
from planfit.errors import require
from planfit.scan import Scan
from planfit.survey import (
    FAMILIES,
    RoleResiduals,
    Survey,
    SurveyAxes,
    SurveyResiduals,
    read_marks,
    read_points,
)


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


def tell_survey(survey: SurveyResiduals) -> None:
    """Control and check points, a line each."""
    for name, role in (("control", survey.control), ("check", survey.check)):
        if role is not None:
            out.print(role_words(name, role))
    if survey.check is None:
        out.print(
            "no check points: how well control points fit says nothing of places between them"
        )


def role_words(name: str, role: RoleResiduals) -> str:
    """Residuals in one line."""
    points = "point" if role.count == 1 else "points"
    height = "" if role.rms_height_m is None else f", height {role.rms_height_m:.3f}"
    return (
        f"{role.count} {name} {points}: residual {role.rms_m:.3f} m RMS (horizontal "
        f"{role.rms_horizontal_m:.3f}{height}), worst {role.worst_m:.3f} m at {role.worst_id}"
    )

"""What a surveyor gives, and what the scan sees of it; and the tables that it is read from.

Points are `id,x,y,z[,sigma]` and marks `frame,u,v,id`, parted by commas, semicolons, tabs or blanks. A first
line of names may order the columns otherwise; it is how northing is told from easting. Lines that begin with
# are left out."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import OptionError
from planfit.findings import some_ids
from planfit.geometry.calibration import SensorCalibration
from planfit.priors import SURVEYED_POINT_SIGMA_M
from planfit.runtime import short_repr, whole_number

SurveyAxes = Literal["plan", "file", "map", "site"]
"""Whose axes the points are in: `plan`, x and y as at the rim of `planfit plan PLAN -o plan.png`, z above the
floor; `file`, the plan file's own; `map`, those that the plan's georeference leads to; `site`, others that
have nothing to do with a plan."""
DEFAULT_SIGMA_M = SURVEYED_POINT_SIGMA_M.value
"""Of a point whose file tells none: what a total station or a good GNSS receiver reaches on a site."""


@dataclass(frozen=True)
class SurveyPoint:
    """A point whose coordinates are known."""

    id: str
    xyz: Float[np.ndarray, "3"]
    """As given, in the axes of the survey; z is NaN where the height is not known."""
    sigma_m: float = DEFAULT_SIGMA_M
    """Standard deviation of each coordinate."""
    is_check: bool = False
    """Whether it judges the result and takes no part in it."""


@dataclass(frozen=True)
class Mark:
    """A point seen in a frame."""

    frame_idx: int
    point_id: str
    uv: tuple[float, float] | None = None
    """Column and row of the pixel, integers being pixel centres; None: the camera itself stood at the
    point."""


@dataclass(frozen=True)
class Survey:
    """Points, and where they were seen.

    Raises:
        OptionError: two points share an id, no points, a mark names a point that is not there.
    """

    points: tuple[SurveyPoint, ...]
    marks: tuple[Mark, ...] = ()
    axes: SurveyAxes = "plan"
    tags: str = ""
    """Family of tags to look for in the images, whose ids are ids of points; empty: none."""
    tag_size_m: float | None = None
    """Side of the black square of a tag: gives its distance where depth is missing."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if not self.points:
            raise OptionError("the survey: expected points, found none; give --control-points FILE")
        ids = [point.id for point in self.points]
        for k, name in enumerate(ids):
            if name in ids[:k]:
                raise OptionError(
                    f"the survey: expected each point once, found {name!r} twice; a point is either a "
                    "control point or a check point: leave it out of one of the files"
                )
        for mark in self.marks:
            if mark.point_id not in ids:
                raise OptionError(
                    f"the survey: expected marks of points that are given, found {mark.point_id!r} in frame "
                    f"{mark.frame_idx}, which is none of {some_ids(ids)}; mend the id, or add the point"
                )

    @property
    def is_check(self) -> np.ndarray:
        """Of each point."""
        return np.array([point.is_check for point in self.points])

    @property
    def sigmas_m(self) -> Float[np.ndarray, " p"]:
        """Of each point."""
        return np.array([point.sigma_m for point in self.points])


@dataclass(frozen=True)
class LiftedMarks:
    """Points of a survey as cameras see them; m marks."""

    points_cam: Float[np.ndarray, "m 3"]
    """m, axes of the frame's camera."""
    sigma_m: Float[np.ndarray, " m"]
    """Standard deviation of each coordinate, by depth alone."""
    frame_idx: Int[np.ndarray, " m"]
    point_idx: Int[np.ndarray, " m"]
    """Index among the survey's points."""

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.frame_idx)

    def __getitem__(self, which: np.ndarray) -> "LiftedMarks":
        """Some of them."""
        return LiftedMarks(
            self.points_cam[which],
            self.sigma_m[which],
            self.frame_idx[which],
            self.point_idx[which],
        )

    def corrected(self, sensor: SensorCalibration) -> "LiftedMarks":
        """As the corrected sensor sees them."""
        if sensor.is_nominal or len(self) == 0:
            return self
        is_camera = (self.points_cam == 0).all(axis=1)
        points = np.where(is_camera[:, None], 0.0, sensor.points(self.points_cam))
        return replace(self, points_cam=points)


_POINT_NAMES = {
    "id": ("id", "name", "point", "label", "no", "nr", "number", "pt", "point_id", "p"),
    "x": ("x", "x_m", "east", "easting", "e"),
    "y": ("y", "y_m", "north", "northing", "n"),
    "z": ("z", "z_m", "h", "height", "elevation", "elev", "alt", "altitude"),
    "sigma": ("sigma", "sigma_m", "std", "accuracy", "accuracy_m", "sd"),
}
_MARK_NAMES = {
    "frame": ("frame", "image", "frame_id", "photo", "file"),
    "u": ("u", "x", "px", "u_px", "column", "col"),
    "v": ("v", "y", "py", "v_px", "row"),
    "id": _POINT_NAMES["id"],
}
_SHAPE_OF_POINTS, _SHAPE_OF_MARKS = "id,x,y,z[,sigma]", "frame,u,v,id"
_MAX_BYTES = 50_000_000


def read_points(path: Path, is_check: bool = False) -> tuple[SurveyPoint, ...]:
    """Points of a file, in its order. An empty z is a height that is not known.

    Raises:
        OptionError: the file is no such table, or gives a point two places.
    """
    found: dict[str, SurveyPoint] = {}
    for line, row in _rows(path, _POINT_NAMES, ("id", "x", "y", "z"), _SHAPE_OF_POINTS):
        where = f"{path}:{line}: "
        x, y = (_number(row[name], name, where) for name in ("x", "y"))
        z = _number(row["z"], "z", where) if row.get("z") else np.nan
        sigma = _number(row["sigma"], "sigma", where) if row.get("sigma") else DEFAULT_SIGMA_M
        if not 0 < sigma < 100:
            raise OptionError(
                f"{where}expected a sigma above 0 in metres, found {sigma:g}; leave it out where it is not "
                "known"
            )
        point = SurveyPoint(row["id"], np.array([x, y, z]), sigma, is_check)
        before = found.setdefault(point.id, point)
        if not np.array_equal(before.xyz, point.xyz, equal_nan=True):
            raise OptionError(
                f"{where}expected one place of point {point.id!r}, found two, "
                f"{_words(before.xyz)} and {_words(point.xyz)}; leave out the wrong one"
            )
    return tuple(found.values())


def read_marks(path: Path, frame_ids: Sequence[str]) -> tuple[Mark, ...]:
    """Marks of a file, in its order; with empty u and v, the camera itself stood at the point.

    Args:
        path: the file.
        frame_ids: what the scan's format calls each frame. Frames are told by their number in the scan, from
            0, as in the report; or by that name, where it is no number.

    Raises:
        OptionError: the file is no such table, or names a frame that is not there.
    """
    by_name = {name: k for k, name in enumerate(frame_ids) if not name.isdecimal()}
    marks = []
    for line, row in _rows(path, _MARK_NAMES, ("frame", "u", "v", "id"), _SHAPE_OF_MARKS):
        where = f"{path}:{line}: "
        frame = row["frame"]
        number = whole_number(frame)
        number = by_name.get(frame, -1) if number is None else number
        if not 0 <= number < len(frame_ids):
            raise OptionError(
                f"{where}expected a frame of the scan, 0 to {len(frame_ids) - 1}, found {frame!r}; frames "
                "are numbered as in the report, from 0"
            )
        if bool(row["u"]) != bool(row["v"]):
            raise OptionError(
                f"{where}expected u and v, or neither for a camera that stood at the point, found one of "
                "them; fill in the other"
            )
        uv = tuple(_number(row[name], name, where) for name in "uv") if row["u"] else None
        marks.append(Mark(number, row["id"], uv))  # type: ignore[arg-type]
    return tuple(marks)


def _rows(
    path: Path, names: dict[str, tuple[str, ...]], needed: tuple[str, ...], shape: str
) -> list[tuple[int, dict[str, str]]]:
    """Cells of each line by name, with the number of the line; there is one at least."""
    lines = [
        (k, line)
        for k, line in enumerate(_text(path, shape).splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    columns, head = list(names), lines[0][1] if lines else ""
    part = next((mark for mark in (";", "\t", ",") if mark in head), None)  # None: blanks
    header = [cell.lower() for cell in _cells(head, part)]
    known = {alias: name for name, aliases in names.items() for alias in aliases}
    if sum(cell in known for cell in header) >= 2:
        columns = [known.get(cell, cell) for cell in header]
        lines = lines[1:]
    if not lines:
        raise OptionError(f"{path}: expected lines {shape}, found none; is it the right file?")
    rows = []
    for k, line in lines:
        cells = _cells(line, part)
        row = dict(zip(columns, cells, strict=False))
        if missing := [name for name in needed if name not in row]:
            raise OptionError(
                f"{path}:{k}: expected {shape}, found {line.strip()[:80]!r}, without {missing[0]}; write one "
                "line a point, cells parted by commas"
            )
        if not row["id"]:
            raise OptionError(f"{path}:{k}: expected an id, found an empty cell; name the point")
        rows.append((k, row))
    return rows


def _text(path: Path, shape: str) -> str:
    try:
        data = path.read_bytes() if path.stat().st_size <= _MAX_BYTES else b"\0"
    except OSError as error:
        raise OptionError(
            f"{path}: expected a table {shape}, found {error.strerror or error}; check the path"
        ) from error
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise OptionError(
            f"{path}: expected a table {shape} in plain text (UTF-8), found other data; export it as CSV"
        )
    return text


def _cells(line: str, part: str | None) -> list[str]:
    cells = line.split() if part is None else line.split(part)
    cells = [cell.strip().strip("\"'").strip() for cell in cells]
    # A comma is a decimal point where it parts no cells.
    if part in (";", "\t"):
        cells = [
            re.sub(r"^([+-]?\d+),(\d+)$", r"\1.\2", cell) if "," in cell else cell for cell in cells
        ]
    return cells


def _number(text: str, name: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise OptionError(
            f"{where}expected a number as {name}, found {text!r}; write it as 12.345, or order columns by "
            "a first line of names"
        )
    return value


def _words(xyz: np.ndarray) -> str:
    return f"({', '.join(f'{v:.3f}' for v in xyz)})"

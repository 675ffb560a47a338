"""`planfit plan`: what is found in a plan, and the plan in another form."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from jaxtyping import Float

from planfit.cli.arguments import Flat, Out, PlanFlags
from planfit.cli.console import check_suffix, listing, note, out
from planfit.errors import OutputError
from planfit.export.plan_files import write_plan_dxf, write_plan_svg
from planfit.floorplan import Floorplan, read_floorplan, write_floorplan_json
from planfit.floorplan.edits import (
    PlanEdits,
    edited,
    ends_of_faces,
    regions_of_words,
    write_edits,
)
from planfit.floorplan.elements import are_glass, find_columns
from planfit.report.plots.plan_picture import draw_plan_picture
from planfit.runtime import write_whole
from planfit.units import in_units, quantity


@dataclass(frozen=True)
class PlanArguments:
    """Read a plan, tell what was found, and write it as a picture, drawing or JSON."""

    plan: tyro.conf.Positional[Path]
    """File of the plan."""
    out: Out[Path | None] = None
    """File to write: `.png` (faces over the drawing), `.svg`, `.dxf`, or `.json` (lossless)."""
    drop: Annotated[
        tyro.conf.UseAppendAction[tuple[tuple[int, ...], ...]], tyro.conf.arg(metavar="N ...")
    ] = ()
    """Faces to leave out, by the numbers that --numbers shows."""
    keep_region: Annotated[
        tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]], tyro.conf.arg(metavar="X,Y,X,Y ...")
    ] = ()
    """Keep what lies in a region alone: "x0,y0,x1,y1", or its corners "x,y,x,y,x,y", in the coordinates at
    the rim of the picture."""
    write_edits: Path | None = None
    """JSON file for --drop and --keep-region, for `--plan-edits` of all commands that read a plan."""
    numbers: bool = False
    """Number the faces in the picture."""
    flags: Flat[PlanFlags] = field(default_factory=PlanFlags)


def _write_png(path: Path, floorplan: Floorplan, has_numbers: bool = False) -> None:
    write_whole(path, draw_plan_picture(floorplan, Path(floorplan.name), has_numbers))


WRITERS: dict[str, Callable[[Path, Floorplan], None]] = {
    ".png": _write_png,
    ".svg": write_plan_svg,
    ".dxf": write_plan_dxf,
    ".json": write_floorplan_json,
}


def plan_command(arguments: PlanArguments) -> int:
    """Read, print, write."""
    writer = None
    if arguments.out is not None:
        check_suffix(arguments.out, WRITERS)
        writer = WRITERS[arguments.out.suffix.lower()]
        if arguments.out.resolve() == arguments.plan.resolve():
            raise OutputError(
                f"{arguments.out}: expected another file than the plan itself; choose another name"
            )
    drop = tuple(number for numbers in arguments.drop for number in numbers)
    regions = regions_of_words(tuple(each for words in arguments.keep_region for each in words))
    options = replace(arguments.flags.options, keep_regions=regions)
    floorplan = read_floorplan(arguments.plan, options)
    ends = ends_of_faces(floorplan, drop)
    if drop:
        floorplan = edited(floorplan, PlanEdits(ends), "--drop")
    if arguments.write_edits is not None:
        if not (drop or regions):
            raise OutputError(
                "--write-edits: expected --drop or --keep-region beside it, found neither"
            )
        write_edits(arguments.write_edits, PlanEdits(ends, tuple(map(np.array, regions))))
        out.print(f"written: {arguments.write_edits}", soft_wrap=True)
    summarise(floorplan)
    if writer is not None and arguments.out is not None:
        if arguments.numbers and writer is _write_png:
            writer = partial(_write_png, has_numbers=True)
        writer(arguments.out, floorplan)
        out.print(f"written: {arguments.out}", soft_wrap=True)
    return 0


def summarise(floorplan: Floorplan) -> None:
    """What was found, how the unit is known, what was left out."""
    source = floorplan.source
    unit = "m" if floorplan.is_metric else "units of the drawing"
    width, depth = floorplan.size

    def side(value: float, spec: str = ".3g") -> str:
        """A number whose unit follows."""
        return in_units(value, spec, "") if floorplan.is_metric else f"{value:{spec}}"

    oriented = f", {int(floorplan.is_oriented.sum())} with a known free side"
    rows = [
        ["kind", source.kind or "plan"],
        ["faces", f"{len(floorplan)}{oriented}"],
        ["length of faces", quantity(floorplan.lengths.sum(), unit, ".4g")],
        ["size", " x ".join([side(width, ".4g"), quantity(depth, unit, ".4g")])],
        ["unit of the file", source.unit + (f" ({source.unit_from})" if source.unit_from else "")],
    ]
    if not floorplan.is_metric:
        rows.append(
            ["scale", "found with the alignment, or given: --scale 1:100, or metres a unit"]
        )
    if floorplan.thickness is not None and np.isfinite(floorplan.thickness).any():
        low, middle, high = _thicknesses(floorplan)
        rows.append(
            ["thickness", f"{side(low)} to {side(high)}, median {quantity(middle, unit, '.3g')}"]
        )
    if floorplan.openings is not None:
        kinds = f" ({', '.join(source.opening_kinds)})" if source.opening_kinds else ""
        gaps = f"{len(floorplan.openings)} gaps of doors and windows in faces{kinds}"
        rows.append(["openings", gaps])
    is_glass = are_glass(floorplan)
    if is_glass.any():
        rows.append(
            ["glass", f"{quantity(floorplan.lengths[is_glass].sum(), unit, '.4g')} of faces"]
        )
    columns = find_columns(floorplan).sizes
    if len(columns):
        low, high = columns.max(axis=1).min(), columns.max(axis=1).max()
        begin = "" if high < 1.01 * low else f"{side(low)} to "
        span = begin + quantity(high if begin else low, unit, ".3g")
        rows.append(["columns", f"{len(columns)} that stand alone, {span} across"])
    if source.map_words:
        rows.append(["on the map", source.map_words])
    if source.is_mirrored:
        rows.append(["mirrored", "left and right of the file are swapped (--mirror)"])
    if source.storeys:
        chosen = f"; read: {source.storey}" if source.storey else ""
        rows.append(["storeys", ", ".join(source.storeys) + chosen])
    if source.layers:
        rows.append(["layers", ", ".join(source.layers)])
    rows += [["left out" if i == 0 else "", words] for i, words in enumerate(source.dropped)]
    out.print(f"plan {floorplan.name}\n", soft_wrap=True)
    out.print(listing(rows))
    for warning in source.warnings:
        note(warning)


def _thicknesses(floorplan: Floorplan) -> Float[np.ndarray, " 3"]:
    """Thickness below which 5, 50 and 95 % of the length of faces is: behind the short end of a wall
    is its whole length."""
    assert floorplan.thickness is not None
    known = np.isfinite(floorplan.thickness)
    thickness, length = floorplan.thickness[known], floorplan.lengths[known]
    order = np.argsort(thickness)
    reached = np.cumsum(length[order]) / length.sum()
    return thickness[order][np.searchsorted(reached, [0.05, 0.5, 0.95])]

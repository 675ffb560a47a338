"""The plan, and its walls and openings as built, for other programs: CSV, GeoJSON, SVG, and DXF with a
layer a verdict.

As built, a drawing is written in the coordinates of the plan's own file, so that it lies over it; where
the plan was a picture, in metres of the plan frame. The table is always in metres of the plan frame. A
line of the plan itself runs so that the free side of its face is on its left, seen from above, where that
is known; layers (groups in SVG) are those of `planfit.floorplan.vector.own_drawing`, and planfit reads
them again as they are."""

import csv
import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from ezdxf.document import Drawing
from ezdxf.enums import TextEntityAlignment
from ezdxf.filemanagement import new
from jaxtyping import Float

from planfit.as_built import AsBuilt, OpeningVerdict, Verdict, in_words, opening_words
from planfit.export.bcf import write_bcf
from planfit.floorplan import Floorplan
from planfit.floorplan.vector.own_drawing import FACES, LINES, OPENINGS
from planfit.runtime import whole_file, write_whole


def opening_rows(as_built: AsBuilt) -> Iterator[list[Any]]:
    """Cells of the table, a row an opening."""
    for number, opening in enumerate(as_built.openings, start=1):
        yield [
            f"O{number}",
            opening.verdict.value,
            *("", ""),
            opening.element_id,
            *("", ""),
            metres(opening.drawn_width_m),
            *(metres(value) for value in opening.ends.ravel()),
            *(f"{value:.6f}" for value in opening.normal),
            *("", ""),
            max(opening.n_through_frames, opening.n_surface_frames),
            f"{opening.open_share:.2f}",
            opening_words(opening),
            opening.kind or "opening",
            f"{opening.closed_share:.2f}",
            metres(opening.width_m),
            metres(opening.width_sigma_m),
            metres(opening.shift_m) if opening.is_drawn else "",
        ]


def opening_lines(as_built: AsBuilt) -> Iterator[tuple[Float[np.ndarray, "2 2"], dict[str, Any]]]:
    """Ends, m, plan frame, and properties of the lines of GeoJSON: where each is drawn, and, of those whose
    sides were seen, where it is."""
    for number, opening in enumerate(as_built.openings, start=1):
        properties: dict[str, Any] = {
            "what": opening.kind or "opening",
            "opening": number,
            "verdict": opening.verdict.value,
            "element_id": opening.element_id or None,
            "drawn_width_m": rounded(opening.drawn_width_m) if opening.is_drawn else None,
            "width_m": rounded(opening.width_m),
            "width_sigma_m": rounded(opening.width_sigma_m),
            "shift_m": rounded(opening.shift_m) if opening.is_drawn else None,
            "open_share": round(opening.open_share, 2),
            "closed_share": round(opening.closed_share, 2),
            "closed_by": opening.word_of_closing,
            "through_frames": opening.n_through_frames,
            "surface_frames": opening.n_surface_frames,
            "words": opening_words(opening),
        }
        if opening.is_drawn:
            yield opening.ends, {**properties, "line": "as drawn"}
        if not opening.is_drawn or np.isfinite(opening.width_m):
            yield opening.built_ends, {**properties, "line": "as built"}


def draw_openings(document: Drawing, as_built: AsBuilt, text_height: float) -> None:
    """A line an opening on the layer of its verdict, `AS_BUILT_OPENING_CLOSED`: where it is, where its sides
    were seen, else where it is drawn; and the width of those."""
    space = document.modelspace()
    for verdict in OpeningVerdict:
        document.layers.add(layer_of(verdict), color=LAYER_COLORS[verdict])
    for opening in as_built.openings:
        layer = {"layer": layer_of(opening.verdict)}
        first, last = as_built.in_file(opening.built_ends)
        space.add_line(tuple(first), tuple(last), dxfattribs=layer)
        if np.isfinite(opening.width_m):
            label = f"{opening.width_m:.2f} m +- {opening.width_sigma_m:.2f}"
            turn = {"rotation": upright_deg(last - first), "dxfattribs": layer}
            text = space.add_text(label, height=text_height, **turn)
            text.set_placement(tuple((first + last) / 2), align=TextEntityAlignment.TOP_CENTER)


def upright_deg(along: Float[np.ndarray, "2"]) -> float:
    """Direction of a line, deg, so that text along it is read from below or from the right."""
    angle = float(np.rad2deg(np.arctan2(along[1], along[0])))
    return (angle + 90.0) % 180.0 - 90.0


def metres(value: float) -> str:
    """Of a cell; empty where it is not known."""
    return f"{value:.4f}" if np.isfinite(value) else ""


def rounded(value: float) -> float | None:
    """Of a property; None where it is not known."""
    return round(float(value), 4) if np.isfinite(value) else None


AS_BUILT_HEADER = (
    "wall,verdict,is_sure,face,element_id,offset_m,sigma_m,length_m,x1_m,y1_m,x2_m,y2_m,normal_x,normal_y,"
    "is_oriented,patches,frames,through_share,words,what,closed_share,width_m,width_sigma_m,shift_m"
)
"""Columns of the table, as docs/as-built.md has them."""
LAYER_COLORS: dict[Verdict | OpeningVerdict, int] = {
    Verdict.AGREES: 3,
    Verdict.MOVED: 6,
    Verdict.MISSING: 1,
    Verdict.NOT_SEEN: 8,
    Verdict.NEW: 30,
    OpeningVerdict.OPEN: 3,
    OpeningVerdict.CLOSED: 1,
    OpeningVerdict.NOT_SEEN: 8,
    OpeningVerdict.NEW: 30,
}
"""Of AutoCAD's index: green, magenta, red, grey, orange."""
AS_DRAWN_LAYER, TEXT_M = "AS_BUILT_MOVED_AS_DRAWN", 0.12


def write_as_built_csv(path: Path, as_built: AsBuilt, tolerance_m: float | None = None) -> None:
    """A line a wall, then a line an opening; lengths in metres, coordinates of the plan frame.

    Raises:
        OutputError: the file cannot be written.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(AS_BUILT_HEADER.split(","))
    for number, wall in enumerate(as_built.walls, start=1):
        verdict = as_built.verdict(wall, tolerance_m)
        writer.writerow(
            [
                number,
                verdict.value,
                "yes" if as_built.is_sure(wall, tolerance_m) else "no",
                wall.face_idx if wall.face_idx >= 0 else "",
                wall.element_id,
                metres(wall.offset_m) if wall.face_idx >= 0 else "",
                metres(wall.sigma_m),
                metres(wall.length_m),
                *(metres(value) for value in wall.ends.ravel()),
                *(f"{value:.6f}" for value in wall.normal),
                "yes" if wall.is_oriented else "no",
                wall.n_patches,
                wall.n_frames,
                f"{wall.through_share:.2f}",
                in_words(wall, verdict),
                *("wall", "", "", "", ""),
            ]
        )
    writer.writerows(opening_rows(as_built))
    write_whole(path, text.getvalue())


def write_as_built_geojson(path: Path, as_built: AsBuilt, tolerance_m: float | None = None) -> None:
    """A line a wall where it is drawn, and, of those that were moved, one where it stands.

    Raises:
        OutputError: the file cannot be written.
    """
    features = []
    for number, wall in enumerate(as_built.walls, start=1):
        verdict = as_built.verdict(wall, tolerance_m)
        properties: dict[str, Any] = {
            "what": "wall",
            "wall": number,
            "verdict": verdict.value,
            "is_sure": as_built.is_sure(wall, tolerance_m),
            "face": wall.face_idx if wall.face_idx >= 0 else None,
            "element_id": wall.element_id or None,
            "offset_m": rounded(wall.offset_m) if wall.face_idx >= 0 else None,
            "sigma_m": rounded(wall.sigma_m),
            "length_m": rounded(wall.length_m),
            "patches": wall.n_patches,
            "frames": wall.n_frames,
            "through_share": round(wall.through_share, 2),
            "words": in_words(wall, verdict),
        }
        shown = "as built" if verdict is Verdict.NEW else "as drawn"
        features.append(_feature(as_built, wall.ends, {**properties, "line": shown}))
        if verdict is Verdict.MOVED:
            features.append(_feature(as_built, wall.built_ends, {**properties, "line": "as built"}))
    features += [
        _feature(as_built, ends, properties) for ends, properties in opening_lines(as_built)
    ]
    content = {"type": "FeatureCollection", "name": "as built", "features": features}
    write_whole(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def _feature(
    as_built: AsBuilt, ends: Float[np.ndarray, "2 2"], properties: dict[str, Any]
) -> dict[str, Any]:
    # Nine digits of a degree are a tenth of a millimetre.
    line = [[round(float(value), 9) for value in end] for end in as_built.in_file(ends)]
    return {
        "type": "Feature",
        "geometry": {"type": "LineString", "coordinates": line},
        "properties": properties,
    }


def write_as_built_dxf(path: Path, as_built: AsBuilt, tolerance_m: float | None = None) -> None:
    """A line a wall on the layer of its verdict, those that were moved where they stand, with their offset;
    where they are drawn, on a layer of its own; openings on layers of their own.

    Raises:
        OutputError: the file cannot be written.
    """
    # The unit of the plan's own file is not known here, only its coordinates: 0 says so.
    document = new("R2010", units=6 if as_built.file_from_plan is None else 0, setup=["linetypes"])
    for verdict in Verdict:
        document.layers.add(layer_of(verdict), color=LAYER_COLORS[verdict])
    document.layers.add(AS_DRAWN_LAYER, color=LAYER_COLORS[Verdict.MOVED], linetype="DASHED")
    space = document.modelspace()
    text_height = TEXT_M * as_built.file_units_per_metre
    for wall in as_built.walls:
        verdict = as_built.verdict(wall, tolerance_m)
        layer = {"layer": layer_of(verdict)}
        stands = wall.built_ends if verdict is Verdict.MOVED else wall.ends
        first, last = as_built.in_file(stands)
        space.add_line(tuple(first), tuple(last), dxfattribs=layer)
        if verdict is Verdict.MOVED:
            first, last = as_built.in_file(wall.ends)
            space.add_line(tuple(first), tuple(last), dxfattribs={"layer": AS_DRAWN_LAYER})
            label = f"{100 * wall.offset_m:+.1f} cm +- {100 * wall.sigma_m:.1f}"
            turn = {"rotation": upright_deg(last - first), "dxfattribs": layer}
            text = space.add_text(label, height=text_height, **turn)
            at = tuple(as_built.in_file(stands).mean(axis=0))
            text.set_placement(at, align=TextEntityAlignment.BOTTOM_CENTER)
    draw_openings(document, as_built, text_height)
    with whole_file(path) as part:
        document.saveas(part)


def layer_of(verdict: Verdict | OpeningVerdict) -> str:
    """Name of the layer of a verdict: `AS_BUILT_MOVED`, `AS_BUILT_OPENING_CLOSED`."""
    what = "OPENING_" if isinstance(verdict, OpeningVerdict) else ""
    return f"AS_BUILT_{what}{verdict.name}"


AS_BUILT_WRITERS: dict[str, Callable[[Path, AsBuilt, float | None], None]] = {
    ".csv": write_as_built_csv,
    ".geojson": write_as_built_geojson,
    ".dxf": write_as_built_dxf,
    ".bcf": write_bcf,
    ".bcfzip": write_bcf,
}
"""By the suffix of the file."""


_COLOURS = {FACES: (7, "black"), LINES: (8, "#808080"), OPENINGS: (5, "#0072b2")}
"""Of each layer: AutoCAD's number, and that of SVG."""


def write_plan_svg(path: Path, floorplan: Floorplan) -> None:
    """Faces and openings as lines, one unit of the drawing a unit of the plan, y up in the plan and so down
    in the file."""
    xy = floorplan.ends.reshape(-1, 2)
    low, high = xy.min(axis=0), xy.max(axis=0)
    margin = 0.03 * float(max(high - low))
    width, height = high - low + 2 * margin
    unit = "m" if floorplan.is_metric else "unknown"
    stroke = 0.002 * float(max(width, height))
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" data-unit="{unit}" viewBox="{low[0] - margin:.9g} '
        f'{-high[1] - margin:.9g} {width:.9g} {height:.9g}">',
        f"<title>{escape(floorplan.name)}</title>",
    ]
    for layer, ends in _layers(floorplan):
        colour = _COLOURS[layer][1]
        lines.append(f'<g id="{layer}" stroke="{colour}" stroke-width="{stroke:.6g}">')
        lines += [
            f'<line x1="{x1:.9g}" y1="{-y1:.9g}" x2="{x2:.9g}" y2="{-y2:.9g}"/>'
            for (x1, y1), (x2, y2) in ends
        ]
        lines.append("</g>")
    lines.append("</svg>")
    write_whole(path, "\n".join(lines) + "\n")


def write_plan_dxf(path: Path, floorplan: Floorplan) -> None:
    """Faces and openings as lines; metres in the header where the plan is metric."""
    document = new("R2010", units=6 if floorplan.is_metric else 0)
    space = document.modelspace()
    for layer, ends in _layers(floorplan):
        document.layers.add(layer, color=_COLOURS[layer][0])
        for first, last in ends:
            space.add_line(tuple(first), tuple(last), dxfattribs={"layer": layer})
    with whole_file(path) as part:
        document.saveas(part)


def _layers(floorplan: Floorplan) -> list[tuple[str, Float[np.ndarray, "n 2 2"]]]:
    """Lines (n, 2, 2) of each layer that has any, the free side of faces on their left."""
    openings = np.zeros((0, 2, 2)) if floorplan.openings is None else floorplan.openings
    ends, is_oriented = floorplan.ends_free_left, floorplan.is_oriented
    of_layer = {FACES: ends[is_oriented], LINES: ends[~is_oriented], OPENINGS: openings}
    return [(layer, lines) for layer, lines in of_layer.items() if len(lines)]

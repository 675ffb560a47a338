"""A plan as a drawing that other programs open: SVG and DXF."""

from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from jaxtyping import Float

from planfit.floorplan import Floorplan
from planfit.whole_files import whole_file, write_whole


def write_plan_svg(path: Path, floorplan: Floorplan) -> None:
    """Faces and openings as lines, one unit of the drawing a unit of the plan, y up in the plan and so down
    in the file; the normal of a face is on its line as `data-normal`."""
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
        f'<g id="faces" stroke="black" stroke-width="{stroke:.6g}">',
    ]
    for ends, normal, oriented in zip(
        floorplan.ends, floorplan.normals, floorplan.is_oriented, strict=True
    ):
        extra = f' data-normal="{normal[0]:.9g} {-normal[1]:.9g}"' if oriented else ""
        lines.append(_svg_line(ends, extra))
    lines.append("</g>")
    if floorplan.openings is not None and len(floorplan.openings):
        lines.append(f'<g id="openings" stroke="#0072b2" stroke-width="{stroke:.6g}">')
        lines += [_svg_line(ends, "") for ends in floorplan.openings]
        lines.append("</g>")
    lines.append("</svg>")
    write_whole(path, "\n".join(lines) + "\n")


def _svg_line(ends: Float[np.ndarray, "2 2"], extra: str) -> str:
    (x1, y1), (x2, y2) = ends
    return f'<line x1="{x1:.9g}" y1="{-y1:.9g}" x2="{x2:.9g}" y2="{-y2:.9g}"{extra}/>'


def write_plan_dxf(path: Path, floorplan: Floorplan) -> None:
    """Faces on layer WALL_FACES, openings on layer OPENINGS; metres in the header where the plan is metric.

    The free side of a face is on the left of its line, where it is known.
    """
    from ezdxf.filemanagement import new  # takes a quarter of a second to import

    document = new("R2010", units=6 if floorplan.is_metric else 0)
    document.layers.add("WALL_FACES", color=7)
    document.layers.add("OPENINGS", color=5)
    space = document.modelspace()
    for ends, normal in zip(floorplan.ends, floorplan.normals, strict=True):
        along = ends[1] - ends[0]
        is_left = along[0] * normal[1] - along[1] * normal[0] > 0
        first, last = (ends[0], ends[1]) if is_left else (ends[1], ends[0])
        space.add_line(tuple(first), tuple(last), dxfattribs={"layer": "WALL_FACES"})
    for ends in () if floorplan.openings is None else floorplan.openings:
        space.add_line(tuple(ends[0]), tuple(ends[1]), dxfattribs={"layer": "OPENINGS"})
    with whole_file(path) as part:
        document.saveas(part)

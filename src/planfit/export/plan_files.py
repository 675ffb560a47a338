"""A plan as a drawing that other programs open: SVG and DXF, which planfit reads again as they are.

A line runs so that the free side of its face is on its left, seen from above, where that is known; layers
(groups in SVG) are those of `planfit.floorplan.vector.own_drawing`.
"""

from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from jaxtyping import Float

from planfit.floorplan import Floorplan
from planfit.floorplan.vector.own_drawing import FACES, LINES, OPENINGS
from planfit.runtime import whole_file, write_whole

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
    from ezdxf.filemanagement import new  # takes a quarter of a second to import

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

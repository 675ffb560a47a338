"""Drawings that planfit wrote (`planfit plan -o FILE.dxf` or `.svg`): faces are read as they are drawn.

A CAD program is where many would mend a plan. So what was read once is not interpreted again: a wall of a
picture in single faces looks like double lines, hollow rooms and details to the readers of drawings, which
left out half of the faces of a floor of 70 m.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped

from planfit.errors import FloorplanError
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.types import SHORTEST_SHARE, Floorplan, PlanSource
from planfit.floorplan.vector.drawing import VectorDrawing
from planfit.floorplan.vector.layer_names import length_words
from planfit.floorplan.vector.line_work import longest
from planfit.floorplan.vector.units import unit_of_drawing
from planfit.geometry import segments

FACES, LINES, OPENINGS = "PLANFIT_FACES", "PLANFIT_LINES", "PLANFIT_OPENINGS"
"""Layers: of faces whose free side is on the left of their line, of faces whose side is not known, and of
doors and windows."""


def is_own_drawing(drawing: VectorDrawing, options: PlanOptions) -> bool:
    """Whether planfit wrote a drawing, and the user chose no layers of it."""
    return not options.layers and not {FACES, LINES}.isdisjoint(_names(drawing))


def plan_of_own_drawing(
    drawing: VectorDrawing,
    path: Path,
    fingerprint: str,
    options: PlanOptions,
    kind: str,
    file_from_drawing: Float[np.ndarray, "3 3"],
) -> Floorplan:
    """The faces of a drawing that planfit wrote, perhaps mended since; arguments as of `plan_of_drawing`.

    Raises:
        FloorplanError: no faces are left, a storey is asked for, or the user's unit makes an absurd size.
    """
    faces, lines, openings = (_on_layer(drawing, name) for name in (FACES, LINES, OPENINGS))
    ends = np.concatenate([faces, lines])
    if len(ends) == 0:
        raise FloorplanError(
            f"{path}: expected faces on the layers {FACES} or {LINES}, found none; draw them there"
        )
    if options.storey:
        raise FloorplanError(
            f"{path}: expected no storey of a drawing that planfit wrote, which has one plan, found "
            f"{options.storey!r}; choose the storey of the file that it was made of, and write it again"
        )
    size = float(np.ptp(ends.reshape(-1, 2), axis=0).max())
    # planfit writes no unit where it knew none, which is nothing to be guessed again.
    told = drawing if drawing.metres_per_unit else replace(drawing, unit="paper")
    unit = unit_of_drawing(told, path, options, size, None)
    metres = unit.metres
    is_oriented = np.arange(len(ends)) < len(faces)
    is_mirrored = _is_mirrored(faces, metres)
    normals = segments.left_normals(ends) * (-1.0 if is_mirrored else 1.0)
    warnings = unit.warnings
    if is_mirrored:
        warnings += (
            f"most faces on {FACES} have their wall on the left: the drawing was mirrored since planfit "
            "wrote it, and left was taken for right; --mirror swaps left and right of the plan",
        )
    scale = metres or 1.0
    is_other = ~np.isin(_names(drawing)[drawing.lines.layer], (FACES, LINES, OPENINGS))
    return Floorplan(
        str(path),
        ends * scale,
        normals,
        is_oriented,
        fingerprint,
        openings=openings * scale if len(openings) else None,
        is_metric=metres is not None,
        source=PlanSource(
            kind=f"{kind}, written by planfit",
            unit=unit.name,
            unit_from=unit.known_from,
            layers=tuple(name for name in (FACES, LINES) if name in _names(drawing)),
            dropped=_dropped(drawing, is_other, metres),
            warnings=warnings,
            file_from_plan=file_from_drawing @ np.diag([1 / scale, 1 / scale, 1.0]),
            drawn_lines=segments.moved(longest(ends), file_from_drawing),
            dropped_lines=segments.moved(longest(drawing.lines.ends[is_other]), file_from_drawing),
        ),
    )


def _names(drawing: VectorDrawing) -> Shaped[np.ndarray, " l"]:
    """Of layers, as planfit writes them: programs save them in any case, which says nothing in DXF."""
    return np.array([name.upper() for name in drawing.layers])


def _on_layer(drawing: VectorDrawing, name: str) -> Float[np.ndarray, "n 2 2"]:
    """Lines of a layer that have a length, as they run."""
    ends = drawing.lines.ends[_names(drawing)[drawing.lines.layer] == name]
    size = float(np.ptp(ends.reshape(-1, 2), axis=0).max()) if len(ends) else 0.0
    return ends[segments.lengths(ends) > SHORTEST_SHARE * size]


def _is_mirrored(faces: Float[np.ndarray, "n 2 2"], metres: float | None) -> bool:
    """Whether more of the faces, by their length, have the other face of a wall on their left than right."""
    if len(faces) < 2:
        return False
    found = Floorplan.from_segments(faces * (metres or 1.0), is_metric=metres is not None)
    free_on_left = np.einsum("ni,ni->n", found.normals, segments.left_normals(found.ends))
    return float((free_on_left * found.lengths)[found.is_oriented].sum()) < 0.0


def _dropped(drawing: VectorDrawing, is_other: np.ndarray, metres: float | None) -> tuple[str, ...]:
    """What else is in the drawing, in words."""
    if not is_other.any():
        return ()
    names = sorted({drawing.layers[k] or "no layer" for k in drawing.lines.layer[is_other]})
    length = length_words(float(segments.lengths(drawing.lines.ends[is_other]).sum()), metres)
    return (
        f"{length} of lines on other layers than planfit's ({', '.join(names[:6])}): walls are read of "
        f"{FACES} and {LINES}",
    )

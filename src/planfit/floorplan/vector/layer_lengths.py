"""How much of the line work of each layer became faces."""

from dataclasses import dataclass

import numpy as np

from planfit.floorplan.vector.candidates import Candidates
from planfit.floorplan.vector.double_lines import LineFaces
from planfit.floorplan.vector.drawing import VectorDrawing
from planfit.floorplan.vector.layer_names import Role
from planfit.geometry import segments


@dataclass(frozen=True)
class LayerLength:
    """Line work of a layer, in the drawing's own unit."""

    name: str
    role: Role
    n_lines: int
    drawn: float
    """Length of lines that were looked at as faces; of all of them where the layer holds no walls."""
    taken: float
    """Length of the faces among them."""


def lengths_by_layer(
    drawing: VectorDrawing, roles: list[Role], candidates: Candidates, faces: LineFaces
) -> tuple[LayerLength, ...]:
    """What was looked at of each layer that is to be, all line work of the others, and what became faces."""
    n = len(drawing.layers)
    lines = drawing.lines
    count = np.bincount(lines.layer, minlength=n)
    whole = np.bincount(lines.layer, segments.lengths(lines.ends), minlength=n)
    own = candidates.layer >= 0
    drawn = np.bincount(candidates.layer[own], segments.lengths(candidates.ends[own]), minlength=n)
    on_line = faces.line >= 0
    layer = candidates.layer[faces.line[on_line]]
    length = segments.lengths(faces.ends[on_line])
    taken = np.bincount(layer[layer >= 0], length[layer >= 0], minlength=n)
    return tuple(
        LayerLength(
            name,
            roles[i],
            int(count[i]),
            float(whole[i] if roles[i] == Role.NO_WALL else drawn[i]),
            float(taken[i]),
        )
        for i, name in enumerate(drawing.layers)
    )

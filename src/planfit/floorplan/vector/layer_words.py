"""What became of each layer of a drawing: what was left out, with its length, and the words for it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planfit.findings.plan_kinds import MAX_NAMED
from planfit.floorplan.vector.candidates import Candidates, LineFaces
from planfit.floorplan.vector.drawing import VectorDrawing
from planfit.floorplan.vector.layer_names import Role
from planfit.geometry import segments

MOST_NAMED = MAX_NAMED
LITTLE = 0.3
"""A layer that is called wall and of which less became faces is questioned."""


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


def length_words(amount: float, metres_per_unit: float | None) -> str:
    """A length in a drawing's unit, in metres where that is known."""
    if metres_per_unit is None:
        return f"{amount:.3g} units"
    return f"{amount * metres_per_unit:.3g} m"


def words_on_layers(
    layers: Sequence[LayerLength], metres_per_unit: float | None, is_chosen: bool = False
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Layers that were left out by name, line work that was taken for no wall, and layers called wall that
    gave few faces.

    Args:
        layers: lengths in the unit of the drawing.
        metres_per_unit: None where it is unknown.
        is_chosen: whether the user named the layers that hold walls.

    Returns what was left out and what to look at, a sentence each, for `PlanSource`.
    """

    def length(amount: float) -> str:
        return length_words(amount, metres_per_unit)

    def listed(left: list[tuple[LayerLength, float]]) -> str:
        left = sorted(left, key=lambda pair: -pair[1])
        words = [
            f"{each.name or 'no layer'} ({length(amount)})" for each, amount in left[:MOST_NAMED]
        ]
        return ", ".join(words) + (
            f" and {len(left) - MOST_NAMED} more" if len(left) > MOST_NAMED else ""
        )

    dropped, warnings = [], []
    no_wall = [(each, each.drawn) for each in layers if each.role == Role.NO_WALL and each.n_lines]
    if no_wall:
        count = sum(each.n_lines for each, _ in no_wall)
        why = "layers that were not chosen" if is_chosen else "layers of no walls"
        dropped.append(f"{count} lines on {why}: {listed(no_wall)}")
    longest = max((each.drawn for each in layers), default=0.0)
    looked_at = [each for each in layers if each.role != Role.NO_WALL]
    left = [(each, each.drawn - each.taken) for each in looked_at]
    left = [(each, amount) for each, amount in left if amount > 0.05 * each.drawn > 0]
    if left:
        dropped.append(f"line work taken for no wall: {listed(left)}")
    for each in looked_at:
        is_little = each.taken < LITTLE * each.drawn and each.drawn > 0.02 * longest
        if each.role == Role.WALL and is_little:
            called = "was chosen" if is_chosen else "is called wall"
            warnings.append(
                f"layer {each.name!r} {called}, but of its {length(each.drawn)} of lines only "
                f"{length(each.taken)} became faces: compare the overlay (-o FILE.png) with the drawing"
            )
    return tuple(dropped), tuple(warnings)


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

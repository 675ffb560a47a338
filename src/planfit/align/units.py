"""Plans whose unit is not what they claim: which other unit would make them fit the scan."""

from planfit.align.align import Alignment, align
from planfit.align.options import AlignOptions
from planfit.align.walls import WallSamples
from planfit.floorplan import Floorplan, make_floorplan

METRES_PER_UNIT = {
    "millimetres": 0.001,
    "centimetres": 0.01,
    "inches": 0.0254,
    "feet": 0.3048,
    "metres on paper at 1:50": 50.0,
    "metres on paper at 1:100": 100.0,
    "metres on paper at 1:200": 200.0,
}


def find_unit(
    walls: WallSamples, floorplan: Floorplan, alignment: Alignment, options: AlignOptions
) -> tuple[str, float] | None:
    """The unit, and its metres, in which the plan fits the scan although it does not in metres.

    None where the plan fits as it is, or in no unit clearly better.
    """
    if alignment.score >= options.min_score:
        return None
    scores = {}
    for unit, metres in METRES_PER_UNIT.items():
        scaled = make_floorplan(floorplan.name, floorplan.ends * metres)
        if max(scaled.size) > 1.0:
            scores[unit] = align(walls, scaled, options).score
    best = max(scores, key=lambda unit: scores[unit], default=None)
    if best is None or scores[best] < max(options.min_score, alignment.score + 0.2):
        return None
    return best, METRES_PER_UNIT[best]

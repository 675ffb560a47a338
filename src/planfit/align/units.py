"""Plans whose unit is not what they claim: which other unit would make them fit the scan."""

from dataclasses import replace

import numpy as np

from planfit.align.align import Alignment, align
from planfit.align.options import AlignOptions
from planfit.align.wall_samples import WallSamples
from planfit.floorplan import Floorplan

METRES_PER_UNIT = {
    "millimetres": 0.001,
    "centimetres": 0.01,
    "inches": 0.0254,
    "feet": 0.3048,
    "metres on paper at 1:50": 50.0,
    "metres on paper at 1:100": 100.0,
    "metres on paper at 1:200": 200.0,
}
NEAR_UNIT = 0.02
"""A scale this near to a unit, as a share, is that unit."""
BETTER_SCORE = 0.2
"""What another unit must explain beyond what metres do."""


def find_unit(
    walls: WallSamples, floorplan: Floorplan, alignment: Alignment, options: AlignOptions
) -> tuple[str, float] | None:
    """The unit, in words, and its metres, in which a plan that claims metres fits although it does not
    in metres. None where the plan fits as it is, has no unit, or fits in none clearly better.
    """
    if not floorplan.is_metric or alignment.score >= options.min_score:
        return None
    unknown = replace(floorplan, is_metric=False)
    free = replace(options, metres_per_unit=0.0, candidate=1, start="", control_points=())
    found = align(walls, unknown, free)
    if not found.is_sure or found.score < alignment.score + BETTER_SCORE:
        return None
    scale = found.metres_per_unit
    unit = min(METRES_PER_UNIT, key=lambda name: abs(np.log(scale / METRES_PER_UNIT[name])))
    if abs(np.log(scale / METRES_PER_UNIT[unit])) < NEAR_UNIT:
        return unit, METRES_PER_UNIT[unit]
    return f"units of {scale:.4g} m", float(f"{scale:.4g}")

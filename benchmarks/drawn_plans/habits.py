"""The plan as an architect drew it: what was to be built, not what was."""

from dataclasses import dataclass, replace

import numpy as np

from planfit.errors import require
from planfit.floorplan import Floorplan
from planfit.geometry import segments
from planfit.synth.building import Building

_SAME_M = 1e-4


@dataclass(frozen=True)
class DrawingHabits:
    """How a drawn plan departs from the building."""

    offset_sigma_m: float = 0.02
    """Standard deviation of where a wall was built, across it, about where it is drawn."""
    finish_m: float = 0.01
    """Walls are drawn thicker by this on each side: of standard sizes, and with their plaster."""
    grid_m: float = 0.01
    """Drawn coordinates are multiples of this; 0 for any."""

    def __post_init__(self) -> None:
        values = (self.offset_sigma_m, self.finish_m, self.grid_m)
        require(
            all(np.isfinite(v) and v >= 0 for v in values),
            f"drawing habits: expected finite numbers, none below 0, found {values}",
        )


def drawn_plan(building: Building, habits: DrawingHabits, rng: np.random.Generator) -> Floorplan:
    """The plan of a building with the errors of a drawing.

    All faces of one line move together, and the ends of those that meet it with them, so that corners
    stay closed. Columns and the insides of doors move like walls.
    """
    plan = building.floorplan
    rotation = building.plan_from_building[:2, :2]
    ends, normals = plan.ends @ rotation, plan.normals @ rotation
    drawn = ends.copy()
    for axis in (0, 1):
        across = np.abs(normals[:, axis]) > 0.5
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        # Coordinates across the axis that are the same to a tenth of a millimetre are of one line: the line
        # of every end, and which way the wall lies of it, by the length of its faces.
        lines = np.round(ends[..., axis] / _SAME_M).astype(np.int64)
        values, line_of = np.unique(lines, return_inverse=True)
        line_of = line_of.reshape(lines.shape)
        side = np.zeros(len(values))
        np.add.at(side, line_of[across, 0], normals[across, axis] * length[across])
        moved = values * _SAME_M + rng.normal(0.0, habits.offset_sigma_m, len(values))
        moved += habits.finish_m * np.sign(side)
        if habits.grid_m > 0:
            moved = np.round(moved / habits.grid_m) * habits.grid_m
        drawn[..., axis] = moved[line_of]
    drawn = drawn @ rotation.T
    return replace(
        plan,
        name="drawn plan",
        ends=drawn,
        normals=segments.left_normals(drawn),
        fingerprint="",
    )

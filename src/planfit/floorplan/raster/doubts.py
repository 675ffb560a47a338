"""Whether what was read looks like a floorplan at all: facades, sections, site plans and sketches do not."""

import numpy as np
import shapely
from jaxtyping import Float

from planfit.geometry import segments

MOST_STOREYS = 8
"""More plans than this are not drawn on one sheet: windows of a facade, houses of a site plan are."""
_SAME_DEG = 1.5
_LEAST_ALIGNED = 0.8
"""Of the length of faces, what runs along the two main pairs of directions: plans with slanted and round
walls have 0.90 and more (two real sites 0.97), a sketch by hand 0.72."""
_COMPARE = "compare the overlay (-o FILE.png) with the drawing"


def find_doubts(
    ends: Float[np.ndarray, "n 2 2"],
    openings: Float[np.ndarray, "k 2 2"],
    walls: tuple[shapely.Polygon, ...],
    n_groups: int,
) -> tuple[str, ...]:
    """What speaks against a floorplan, a sentence each.

    Args:
        ends: faces.
        openings: doors and windows.
        walls: regions.
        n_groups: groups of walls that stand apart from each other on the sheet.
    """
    result = []
    if n_groups > MOST_STOREYS:
        result.append(
            f"{n_groups} groups of marks stand apart from each other, as windows of a facade or houses of a "
            f"site plan do: this is probably no floorplan; {_COMPARE}"
        )
    n_closed = sum(len(wall.interiors) for wall in walls)
    if len(openings) == 0 and n_closed > 0:
        result.append(
            "no wall has a gap for a door or window, and what it encloses has no way in: is it a section, or "
            f"are doors drawn closed? {_COMPARE}"
        )
    aligned = aligned_share(ends)
    if aligned < _LEAST_ALIGNED:
        result.append(
            f"only {100 * aligned:.0f} % of the length of walls runs along common directions: faces of a "
            f"sketch by hand are no more exact than its lines; {_COMPARE}"
        )
    return tuple(result)


def aligned_share(ends: Float[np.ndarray, "n 2 2"]) -> float:
    """Share of the length of segments along the two most frequent directions and across them."""
    along = ends[:, 1] - ends[:, 0]
    angle = np.rad2deg(np.arctan2(along[:, 1], along[:, 0])) % 90.0
    length = segments.lengths(ends)
    left, total = length.copy(), float(length.sum())
    for _ in range(2):
        off = np.abs((angle[:, None] - np.arange(0.0, 90.0, 0.5)[None] + 45.0) % 90.0 - 45.0)
        reached = ((off < _SAME_DEG) * left[:, None]).sum(axis=0)
        left[off[:, int(np.argmax(reached))] < _SAME_DEG] = 0.0
    return 1.0 - float(left.sum()) / max(total, 1e-9)

"""Whether lines that were taken for no walls go from wall to wall, as partitions drawn as single lines do."""

import numpy as np
import shapely
from jaxtyping import Bool, Float

from planfit.floorplan.faces import PARALLEL_SINE, line_strings
from planfit.floorplan.near_lines import ends_that_meet, groups_within
from planfit.floorplan.plausible import COMPARE
from planfit.floorplan.vector.candidates import Candidates, LineFaces
from planfit.floorplan.vector.line_work import cut_out
from planfit.floorplan.vector.single_lines import BESIDE_REACH, NETWORK, body_of_faces
from planfit.geometry import segments

DOUBTFUL_SHARE = 0.15
"""Of the length of faces, long lines that were left out and go from wall to wall: 0.08 at most of 12 plans
that were read right, 0.39 of a house whose partitions were left out."""


def left_out_words(candidates: Candidates, faces: LineFaces, extent: float) -> tuple[str, ...]:
    """A doubt where much that may be partitions is no face; none where layers tell what walls are.

    Args:
        candidates: all lines that were looked at.
        faces: that were found.
        extent: of the drawing.
    """
    if candidates.is_called_wall.any() or len(faces.ends) == 0:
        return ()
    left = float(segments.lengths(_lines_between_walls(candidates.ends, faces, extent)).sum())
    share = left / float(segments.lengths(faces.ends).sum())
    if share < DOUBTFUL_SHARE:
        return ()
    return (
        f"lines from wall to wall, {100 * share:.0f} % of the length of faces, were taken for no walls: if "
        f"they are partitions drawn as single lines, these are missing; {COMPARE}",
    )


def _lines_between_walls(
    ends: Float[np.ndarray, "n 2 2"], faces: LineFaces, extent: float
) -> Float[np.ndarray, "k 2 2"]:
    """Long lines away from faces whose both ends meet faces, or other such lines."""
    ends = ends[segments.lengths(ends) > NETWORK * extent]
    walls = line_strings(faces.ends)
    near = shapely.buffer(shapely.union_all(walls), 0.5 * BESIDE_REACH * extent)
    body = shapely.union(near, body_of_faces(faces, extent))
    left, _ = cut_out(ends, body, NETWORK * extent)
    left = left[~_are_panes(left, faces, BESIDE_REACH * extent)]
    count = -1
    while len(left) not in (0, count):
        count = len(left)
        others = np.concatenate([line_strings(left), walls])
        meets = ends_that_meet(left, np.arange(count), others, BESIDE_REACH * extent)
        left = left[meets.all(axis=1)]
    if len(left) == 0:
        return left
    # What touches no wall by any other line is a frame, or furniture.
    group = groups_within(left, BESIDE_REACH * extent)
    touches = shapely.distance(line_strings(left), shapely.union_all(walls)) < BESIDE_REACH * extent
    return left[(np.bincount(group, touches) > 0)[group]]


def _are_panes(
    ends: Float[np.ndarray, "k 2 2"], faces: LineFaces, reach: float
) -> Bool[np.ndarray, " k"]:
    """Lines in line with a wall that ends at them: panes and sills of a window in its gap."""
    along, normal = segments.directions(ends), segments.left_normals(faces.ends)
    is_parallel = np.abs(along @ normal.T) < PARALLEL_SINE
    usual = faces.usual_thickness or 0.0
    offset = np.einsum("nj,nj->n", normal, faces.ends[:, 0])
    is_in_line = np.abs(ends.mean(axis=1) @ normal.T - offset) < usual + reach
    strings, walls = line_strings(ends), line_strings(faces.ends)
    found = is_parallel & is_in_line
    line, face = np.nonzero(found)
    found[line, face] = shapely.distance(strings[line], walls[face]) < usual + reach
    return found.any(axis=1)

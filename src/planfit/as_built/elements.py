"""What the plan's file calls each face: the element of a building model whose outline it lies on."""

import numpy as np
import shapely

from planfit.floorplan import Floorplan
from planfit.floorplan.faces import line_strings
from planfit.geometry import segments

NEAR_M = 0.03
"""From the middle of a face to the outline of its element: readers close seams between walls, and simplify
lines."""
PARALLEL = 0.99


def element_ids(floorplan: Floorplan) -> tuple[str, ...]:
    """The element of each face: that of the nearest outline along it; empty where the file names none."""
    source = floorplan.source
    if source.element_lines is None or source.file_from_plan is None or not source.element_ids:
        return ("",) * len(floorplan)
    file_from_plan = source.file_from_plan
    units_per_metre = float(np.sqrt(abs(np.linalg.det(file_from_plan[:2, :2]))))
    ends = floorplan.ends @ file_from_plan[:2, :2].T + file_from_plan[:2, 2]
    has_length = segments.lengths(source.element_lines) > 0
    lines, names = source.element_lines[has_length], np.array(source.element_ids)[has_length]
    middles = shapely.points(ends.mean(axis=1))
    found = [""] * len(floorplan)
    face, line = shapely.STRtree(line_strings(lines)).query(
        middles, predicate="dwithin", distance=NEAR_M * units_per_metre
    )
    along_face, along_line = segments.directions(ends[face]), segments.directions(lines[line])
    is_along = np.abs(np.einsum("ki,ki->k", along_face, along_line)) > PARALLEL
    face, line = face[is_along], line[is_along]
    distance = shapely.distance(middles[face], line_strings(lines[line]))
    for k in np.argsort(-distance, kind="stable"):  # the nearest last
        found[face[k]] = str(names[line[k]])
    return tuple(found)

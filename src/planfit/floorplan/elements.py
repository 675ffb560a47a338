"""What the plan's file says of each face and of each gap: the element of a building model that it is of."""

import numpy as np
import shapely
from jaxtyping import Bool, Int

from planfit.floorplan.faces import line_strings
from planfit.floorplan.gaps import PARALLEL, Gap
from planfit.floorplan.types import Floorplan
from planfit.geometry import segments

NEAR_M = 0.03
"""From the middle of a face to the outline of its element: readers close seams between walls, and simplify
lines."""


def element_ids(floorplan: Floorplan) -> tuple[str, ...]:
    """What the file calls the element of each face; empty where it names none."""
    names = floorplan.source.element_ids
    return tuple(names[line] if line >= 0 else "" for line in _element_lines(floorplan))


def are_glass(floorplan: Floorplan) -> Bool[np.ndarray, " f"]:
    """Faces of glass, as far as the file tells: depth cameras see what is behind."""
    line, of_lines = _element_lines(floorplan), floorplan.source.element_is_glass
    if of_lines is None:
        return np.zeros(len(floorplan), dtype=bool)
    return (line >= 0) & of_lines[np.maximum(line, 0)]


def opening_element(floorplan: Floorplan, gap: Gap) -> tuple[str, str]:
    """What a gap is ("door", "window", "opening"), and its name in the file; empty where it does not tell."""
    source = floorplan.source
    if source.opening_lines is None or source.file_from_plan is None or not source.opening_names:
        return "", ""
    plan_from_file = np.linalg.inv(source.file_from_plan)
    lines = segments.moved(source.opening_lines, plan_from_file)
    relative = lines.mean(axis=1) - gap.ends.mean(axis=0)
    across, along = np.abs(relative @ gap.normal), np.linalg.norm(relative, axis=1)
    is_of = (across < gap.thickness_m / 2 + NEAR_M) & (along < gap.width_m / 2)
    is_of &= np.abs(segments.directions(lines) @ gap.normal) < np.sqrt(1 - PARALLEL**2)
    if not is_of.any():
        return "", ""
    nearest = int(np.argmin(np.where(is_of, along, np.inf)))
    return source.opening_names[nearest], source.opening_ids[nearest]


def _element_lines(floorplan: Floorplan) -> Int[np.ndarray, " f"]:
    """Index of the outline of an element that each face lies along, the nearest; -1 for none."""
    found = np.full(len(floorplan), -1)
    source = floorplan.source
    if source.element_lines is None or source.file_from_plan is None or not source.element_ids:
        return found
    file_from_plan = source.file_from_plan
    units_per_metre = float(np.sqrt(abs(np.linalg.det(file_from_plan[:2, :2]))))
    ends = segments.moved(floorplan.ends, file_from_plan)
    at = np.flatnonzero(segments.lengths(source.element_lines) > 0)
    lines = source.element_lines[at]
    middles = shapely.points(ends.mean(axis=1))
    face, line = shapely.STRtree(line_strings(lines)).query(
        middles, predicate="dwithin", distance=NEAR_M * units_per_metre
    )
    along_face, along_line = segments.directions(ends[face]), segments.directions(lines[line])
    is_along = np.abs(np.einsum("ki,ki->k", along_face, along_line)) > PARALLEL
    face, line = face[is_along], line[is_along]
    distance = shapely.distance(middles[face], line_strings(lines[line]))
    order = np.argsort(-distance, kind="stable")  # the nearest last
    found[face[order]] = at[line[order]]
    return found

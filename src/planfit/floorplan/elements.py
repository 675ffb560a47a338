"""What faces are of: columns, which are small closed outlines that stand by themselves, and the elements of a
building model, by what the plan's file says of each face and of each gap."""

from dataclasses import dataclass

import numpy as np
import scipy.spatial
import shapely
from jaxtyping import Bool, Float, Int

from planfit.floorplan.faces import connected_groups, line_strings
from planfit.floorplan.gaps import PARALLEL, Gap
from planfit.floorplan.types import Floorplan
from planfit.geometry import segments
from planfit.priors import COLUMN_SIDE_M

MOST_M = COLUMN_SIDE_M.high
"""Columns are no longer than this where the unit is known."""
MOST_THICKNESSES = 6.0
"""Else than so many thicknesses of the usual wall."""
ELONGATED = 3.0
"""What is longer than this many times its width is a piece of wall, or a line of one; else a column."""
_GAP = 0.15
"""Ends of neighbours are apart by less than this share of a column: edges of tones are set one by one."""
NEAR_M = 0.03
"""From the middle of a face to the outline of its element: readers close seams between walls, and simplify
lines."""


@dataclass(frozen=True)
class Columns:
    """Columns, in the units of the plan."""

    face: Int[np.ndarray, " n"]
    """For each face of the plan, the number of the column that it belongs to; -1 for none."""
    centres: Float[np.ndarray, "k 2"]
    sizes: Float[np.ndarray, "k 2"]
    """Extents in x and y."""


def find_columns(floorplan: Floorplan) -> Columns:
    """Rings of faces that look outwards, no larger than columns are, to which no wall is joined.

    Columns within a wall are part of its outline. A ring that looks inwards is a shaft.
    """
    ends = floorplan.ends
    n = len(ends)
    most = _most(floorplan)
    small = np.flatnonzero(floorplan.is_oriented & (floorplan.lengths <= most))
    none = Columns(np.full(n, -1), np.zeros((0, 2)), np.zeros((0, 2)))
    if len(small) < 3:
        return none
    tips = ends.reshape(-1, 2)
    tree = scipy.spatial.cKDTree(tips)
    own = np.repeat(small, 2)
    near = _GAP * np.minimum(most, 4 * floorplan.lengths[own])
    touched = tree.query_ball_point(tips[2 * own + np.tile([0, 1], len(small))], near)
    a = np.repeat(own, [len(other) for other in touched])
    b = np.concatenate([np.array(other, dtype=int) for other in touched]) // 2
    group = connected_groups(a, b, n)
    face, centres, sizes = np.full(n, -1), [], []
    is_small = np.zeros(n, dtype=bool)
    is_small[small] = True
    n_faces = np.bincount(group)
    n_small = np.bincount(group[small], minlength=len(n_faces))
    for each in np.flatnonzero((n_small >= 3) & (n_small == n_faces)):
        at = np.flatnonzero(group == each)
        if not _is_column(ends[at], floorplan.normals[at], most):
            continue
        low, high = ends[at].min(axis=(0, 1)), ends[at].max(axis=(0, 1))
        face[at] = len(centres)
        centres.append((low + high) / 2)
        sizes.append(high - low)
    return Columns(face, np.reshape(centres, (-1, 2)), np.reshape(sizes, (-1, 2)))


def _most(floorplan: Floorplan) -> float:
    """Largest side of a column, in units of the plan."""
    if floorplan.is_metric:
        return MOST_M
    thickness = floorplan.thickness
    if thickness is None or not np.isfinite(thickness).any():
        return 0.0
    return MOST_THICKNESSES * float(np.nanmedian(thickness))


def _is_column(
    ends: Float[np.ndarray, "m 2 2"], normals: Float[np.ndarray, "m 2"], most: float
) -> bool:
    """Whether faces go once around a compact body, which they look away from."""
    middle = ends.mean(axis=1)
    tips = ends.reshape(-1, 2)
    size = np.ptp(tips, axis=0)
    side = float(size.max())
    if not 0 < side <= most:
        return False
    # Along their main axes: what stands askew has a square box too.
    axes = np.linalg.svd(tips - tips.mean(axis=0), full_matrices=False)[2]
    across = np.ptp(tips @ axes.T, axis=0)
    if across.max() > ELONGATED * across.min():
        return False
    from_centre = middle - (tips.min(axis=0) + tips.max(axis=0)) / 2
    if (np.einsum("mi,mi->m", from_centre, normals) <= 0).any():
        return False
    # All around: the normals of a closed ring, weighed by the lengths of its faces, add up to nothing.
    length = segments.lengths(ends)
    rest = np.linalg.norm(normals.T @ length)
    return bool(rest < 2 * _GAP * length.sum() / np.pi)


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
    tree = shapely.STRtree(line_strings(lines))
    face, line = tree.query(middles, "dwithin", NEAR_M * units_per_metre)
    along_face, along_line = segments.directions(ends[face]), segments.directions(lines[line])
    is_along = np.abs(np.einsum("ki,ki->k", along_face, along_line)) > PARALLEL
    face, line = face[is_along], line[is_along]
    distance = shapely.distance(middles[face], line_strings(lines[line]))
    order = np.argsort(-distance, kind="stable")  # the nearest last
    found[face[order]] = at[line[order]]
    return found

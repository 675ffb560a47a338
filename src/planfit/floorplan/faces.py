"""From bare segments to faces: which side of each segment is free.

Plans draw a wall as two parallel lines with the wall between them. So the free side of a line is
the one away from its partner: the nearest parallel line that overlaps it within a wall's thickness.
A line that has partners on both sides equally near, or none, stays unoriented.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TypeVar

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int, Shaped

from planfit.compiled import kernel
from planfit.floorplan.near_lines import possible_partners
from planfit.geometry import segments
from planfit.priors import WALL_FACES_APART_M

PARALLEL_SINE = float(np.sin(np.deg2rad(2.0)))
"""Lines of a drawing that differ by less are parallel."""
_PARALLEL_SINE = np.sin(np.deg2rad(5.0))
BESIDE_SHARE = 0.3
"""Share of a line with another beside it from which that may be the other side of its wall."""

_OfRows = TypeVar("_OfRows", bound="Rows")


class Rows:
    """A dataclass whose fields are arrays, all with one row for each of some things."""

    def take(self: _OfRows, keep: Shaped[np.ndarray, " k"]) -> _OfRows:
        """Those of a mask or an index."""
        return type(self)(*(getattr(self, name)[keep] for name in _names(type(self))))

    @classmethod
    def together(cls: type[_OfRows], parts: Sequence[_OfRows]) -> _OfRows:
        """All of several, one at least, in their order."""
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in _names(cls)))


def _names(kind: type[Rows]) -> list[str]:
    return [field.name for field in fields(kind)]  # type: ignore[arg-type] - each is a dataclass


@dataclass(frozen=True)
class Partners(Rows):
    """Pairs of parallel lines with one beside the other; `line` ascends.

    Gaps and places along are in the unit of the lines. A pair is listed once for each of its lines.
    """

    line: Int[np.ndarray, " p"]
    """Index of the line."""
    partner: Int[np.ndarray, " p"]
    """Index of the line beside it."""
    gap: Float[np.ndarray, " p"]
    """Least distance across, > 0 left of `line`, < 0 right of it."""
    low: Float[np.ndarray, " p"]
    """Where along `line` the partner's shadow begins, 0 = its first end."""
    high: Float[np.ndarray, " p"]
    """Where it ends."""


def line_strings(ends: Float[np.ndarray, "n 2 2"]) -> Shaped[np.ndarray, " n"]:
    """Segments as shapely's line strings."""
    return np.asarray(shapely.linestrings(ends), dtype=object)


def find_partners(
    ends: Float[np.ndarray, "n 2 2"],
    max_gap: float,
    min_gap: float,
    min_overlap: float,
    parallel_sine: float = _PARALLEL_SINE,
) -> Partners:
    """All pairs of lines whose whole length is within `max_gap`, and beyond `min_gap`, of
    the other line, with more than `min_overlap` beside it.

    Raises:
        LineWorkTooDense: they are more than in any plan.
    """
    parts = [
        _those_beside(ends, line, partner, max_gap, min_gap, min_overlap, parallel_sine)
        for line, partner in possible_partners(ends, max_gap, parallel_sine)
    ]
    none = Partners(*(np.zeros(0, kind) for kind in (int, int, float, float, float)))
    found = Partners.together([none, *parts])
    return found.take(np.lexsort((found.partner, found.line)))


def _those_beside(
    ends: Float[np.ndarray, "n 2 2"],
    line: Int[np.ndarray, " q"],
    partner: Int[np.ndarray, " q"],
    max_gap: float,
    min_gap: float,
    min_overlap: float,
    parallel_sine: float,
) -> Partners:
    """Of possible pairs, those that `find_partners` is to find."""
    sine = np.einsum(
        "pi,pi->p", segments.directions(ends[partner]), segments.left_normals(ends[line])
    )
    is_parallel = np.abs(sine) < parallel_sine
    line, partner = line[is_parallel], partner[is_parallel]
    relative = ends[partner] - ends[line, :1]
    gap = np.einsum("pei,pi->pe", relative, segments.left_normals(ends[line]))
    at = np.einsum("pei,pi->pe", relative, segments.directions(ends[line]))
    length = segments.lengths(ends[line])
    low = np.clip(at.min(axis=1), 0.0, length)
    high = np.clip(at.max(axis=1), 0.0, length)
    is_left = (gap.min(axis=1) > min_gap) & (gap.max(axis=1) < max_gap)
    is_right = (gap.max(axis=1) < -min_gap) & (gap.min(axis=1) > -max_gap)
    keep = (is_left | is_right) & (high - low > min_overlap)
    nearest = np.where(is_left, gap.min(axis=1), gap.max(axis=1))
    return Partners(line, partner, nearest, low, high).take(keep)


def orient_faces(
    ends: Float[np.ndarray, "n 2 2"],
    max_thickness_m: float = WALL_FACES_APART_M.high,
    min_thickness_m: float = WALL_FACES_APART_M.low,
) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, " n"]]:
    """Normals towards the free side, and whether that side is known.

    Args:
        ends: m.
        max_thickness_m: parallel lines further apart than this are two walls, not one.
        min_thickness_m: lines nearer than this are the same line drawn twice.
    """
    normals = segments.left_normals(ends)
    # A twelfth: 5 cm of 60 cm, and the same in a plan of another unit.
    pairs = find_partners(ends, max_thickness_m, min_thickness_m, max_thickness_m / 12)
    length = segments.lengths(ends)
    gap_left, overlap_left = _nearest_partner(pairs, pairs.gap > 0, length)
    gap_right, overlap_right = _nearest_partner(pairs, pairs.gap < 0, length)
    # The wall is on the side where most of the line has a partner; where both sides have one
    # (a thin cavity between two walls), the nearer partner is the wall.
    wall_is_left = (overlap_left > BESIDE_SHARE) & (
        (overlap_right <= BESIDE_SHARE) | (gap_left < 0.7 * gap_right)
    )
    wall_is_right = (overlap_right > BESIDE_SHARE) & (
        (overlap_left <= BESIDE_SHARE) | (gap_right < 0.7 * gap_left)
    )
    is_oriented = wall_is_left ^ wall_is_right
    return np.where(wall_is_left[:, None], -normals, normals), is_oriented


def _nearest_partner(
    pairs: Partners, is_on_side: Bool[np.ndarray, " p"], length: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Gap to the nearest partner on one side, and the share of each line that has any."""
    gaps = np.full(len(length), np.inf)
    line = pairs.line[is_on_side]
    np.minimum.at(gaps, line, np.abs(pairs.gap[is_on_side]))
    covered = covered_lengths(line, pairs.low[is_on_side], pairs.high[is_on_side], len(length))
    return gaps, covered / length


def covered_lengths(
    line: Int[np.ndarray, " p"], low: Float[np.ndarray, " p"], high: Float[np.ndarray, " p"], n: int
) -> Float[np.ndarray, " n"]:
    """Length of the union of the intervals `low` to `high` of each of `n` lines."""
    # By line and beginning: the compiled loop then meets each line's intervals in order, and adds what of
    # each lies beyond the furthest end reached so far.
    order = np.lexsort((low, line))
    return _covered_lengths(line[order], low[order], high[order], n)


@kernel
def _covered_lengths(line, low, high, n):  # pragma: no cover - compiled; has a twin in the tests
    total = np.zeros(n)
    reached, current = -np.inf, -1
    for i in range(len(line)):
        if line[i] != current:
            current, reached = line[i], -np.inf
        total[current] += max(0.0, high[i] - max(low[i], reached))
        reached = max(reached, high[i])
    return total


def usual_gap(ends: Float[np.ndarray, "n 2 2"], max_gap: float) -> float:
    """Gap between a line and its nearest parallel neighbour, of the median length of line; infinite
    where most have none within `max_gap`. Says how thick walls are in a plan of unknown scale."""
    length = segments.lengths(ends)
    pairs = find_partners(ends, max_gap, 1e-3 * max_gap, max_gap / 12)
    nearest, _ = _nearest_partner(pairs, np.ones(len(pairs.line), dtype=bool), length)
    return weighted_median(nearest, length)


def weighted_median(values: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"]) -> float:
    """The value at which the sum of weights, from the least value on, reaches half of all."""
    order = np.argsort(values)
    reached = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(reached, reached[-1] / 2)])


def first_of_each(ends: Float[np.ndarray, "n 2 2"]) -> Int[np.ndarray, " m"]:
    """Indices, ascending, of segments without those that repeat one before, in either direction."""
    low_first = np.array([sorted(pair) for pair in ends.tolist()]).reshape(-1, 4)
    _, first = np.unique(low_first, axis=0, return_index=True)
    return np.sort(first)

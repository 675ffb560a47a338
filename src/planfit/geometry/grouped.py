"""Points that lie in groups, one group after the other, some of them at a time."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Int

from planfit.geometry import se3


def in_parts(start: Int[np.ndarray, " l"]) -> Iterator[tuple[slice, Int[np.ndarray, " p"]]]:
    """Points of groups, group k of which are start[k]:start[k + 1], some at a time, and the group of each.

    What is made for each point, a transform of 128 bytes say, then takes no memory that grows with the scan.
    """
    m = int(start[-1])
    for first in range(0, m, se3.POINTS_AT_A_TIME):
        part = slice(first, min(first + se3.POINTS_AT_A_TIME, m))
        yield part, np.searchsorted(start, np.arange(part.start, part.stop), side="right") - 1


def groups_in_parts(start: Int[np.ndarray, " l"]) -> Iterator[slice]:
    """The same by whole groups: a part is one group, or several that have no more points together."""
    first, n_groups = 0, len(start) - 1
    while first < n_groups:
        most = start[first] + se3.POINTS_AT_A_TIME
        last = max(int(np.searchsorted(start, most, side="right")) - 1, first + 1)
        yield slice(first, min(last, n_groups))
        first = last

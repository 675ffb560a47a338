"""Where before and after differ most."""

import numpy as np

from planfit.report.measures import BeforeAfter
from planfit.report.plots.top_view import Crop, Mark

SIZE_M = 8.0
_MIN_DIFFERENCE_M = 0.02
_MIN_POINTS = 50
_CELLS = 8
"""Cells a window has each way."""


def choose_close_ups(both: BeforeAfter, crop: Crop, max_count: int = 3) -> tuple[Mark, ...]:
    """Square windows that do not overlap, the greatest change of distance to the plan first.

    None where the scan is so small that its overview shows everything.
    """
    if not both.has_walls or crop.size.max() < 2 * SIZE_M:
        return ()
    # Far strays would outweigh whole walls.
    before, after = (np.minimum(s.wall_distances_m, 1.0) for s in (both.before, both.after))
    inside = crop.contains(both.after.wall_xy)
    xy, difference = both.after.wall_xy[inside], np.abs(before - after)[inside]
    cell_m = SIZE_M / _CELLS
    shape = np.maximum(np.ceil(crop.size / cell_m).astype(int), _CELLS)
    at = np.minimum(((xy - crop.low) / cell_m).astype(int), shape - 1)
    flat, n_cells = at[:, 1] * shape[0] + at[:, 0], int(shape.prod())
    sums = np.bincount(flat, difference, n_cells).reshape(shape[1], shape[0])
    counts = np.bincount(flat, minlength=n_cells).reshape(shape[1], shape[0])
    # Points near the middle of a window weigh more, so that what matters is centred.
    centred = np.outer(*[np.hanning(_CELLS + 2)[1:-1]] * 2)
    score, sums, counts = (
        _in_windows(sums, centred),
        _in_windows(sums, np.ones_like(centred)),
        _in_windows(counts, np.ones_like(centred)),
    )
    score[(counts < _MIN_POINTS) | (sums < _MIN_DIFFERENCE_M * counts)] = -1.0
    marks: list[Mark] = []
    for letter in "ABCDEFGH"[:max_count]:
        row, column = np.unravel_index(int(np.argmax(score)), score.shape)
        if score[row, column] <= 0:
            break
        low = crop.low + cell_m * np.array([column, row])
        marks.append(Mark(letter, Crop(low, low + SIZE_M)))
        score[
            max(row - _CELLS + 1, 0) : row + _CELLS, max(column - _CELLS + 1, 0) : column + _CELLS
        ] = -1.0  # every window that overlaps this one
    return tuple(marks)


def _in_windows(cells: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted sums of all square windows of cells."""
    windows = np.lib.stride_tricks.sliding_window_view(cells, weights.shape)
    return np.einsum("ijkl,kl->ij", windows, weights)

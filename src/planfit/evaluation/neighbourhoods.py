"""Covariance of the points around every point of a cloud: exact, compiled, and not pair by pair.

A covariance is made of sums, so a cell of the grid that lies within the radius as a whole is added as ten
sums, however many points it holds; only cells that the sphere's surface cuts are looked at point by point.
"""

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import require
from planfit.evaluation.neighbour_kernels import fill_table, sum_cells, sum_neighbours
from planfit.runtime import ROWS_AT_A_TIME

Result = TypeVar("Result")

_POINTS_PER_CELL = 50.0
"""Cells are made as small as leaves them this many points on average: smaller ones cost more to visit than
they save. On surfaces with 50 to 2,200 neighbours 30 to 80 make little difference, 6 doubles the time."""
_MAX_CELLS_PER_RADIUS = 8


@dataclass(frozen=True)
class NeighbourGrid:
    """A cloud sorted into cubes; made by `make_grid`."""

    radius: float  # m
    cells_per_radius: int  # edge of a cube is radius / cells_per_radius
    origin: Float[np.ndarray, "3"]  # m, corner of cell (0, 0, 0)
    order: Int[np.ndarray, " m"]  # index of each sorted point in the cloud as given
    points: Float[np.ndarray, "3 m"]  # m from the origin, sorted by column of cells, then height
    cells: Int[np.ndarray, "c 3"]  # indices of the cells that hold points
    start: Int[np.ndarray, " c+1"]  # points of cell j are start[j]:start[j + 1]
    column_start: Int[
        np.ndarray, " starts"
    ]  # cells of column i: column_start[i]:column_start[i + 1]
    table: tuple[np.ndarray, np.ndarray]  # columns by a hash of their two indices
    sums: Float[
        np.ndarray, "c 10"
    ]  # of each cell about its centre: number, x y z, xx xy xz yy yz zz

    def __len__(self) -> int:
        return len(self.order)


def make_grid(
    points: Float[np.ndarray, "m 3"], radius_m: float, cells_per_radius: int | None = None
) -> NeighbourGrid:
    """Sort points (m) for neighbourhoods of `radius_m`.

    `cells_per_radius` changes the time and not the result; by default it suits the density.

    Raises:
        OptionError: the radius is not above 0, or the points extend over more than 100,000 radii.
    """
    require(radius_m > 0, f"radius_m: expected a length above 0, found {radius_m}")
    origin = points.min(axis=0) if len(points) else np.zeros(3)
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    require(
        extent < 1e5 * radius_m,
        f"cloud: expected points within {1e5 * radius_m:g} m, found an extent of {extent:g} m; "
        "are there stray points, or is it in millimetres?",
    )
    if cells_per_radius is None:
        cells_per_radius = _suited(points, origin, radius_m)
    edge = radius_m / cells_per_radius
    key = _keys(points, origin, edge)
    order = np.argsort(key, kind="stable")
    key, start = np.unique(key[order], return_index=True)
    # The key packs x, y, z in 21 bits each, x first: sorted, cells of one column (x, y) are neighbours.
    cells = np.stack([key >> 42, (key >> 21) & 0x1FFFFF, key & 0x1FFFFF], axis=1)
    columns, column_start = np.unique(key >> 21, return_index=True)
    start, column_start = np.append(start, len(order)), np.append(column_start, len(key))
    sorted_points = np.ascontiguousarray((points[order] - origin).T, dtype=float)
    return NeighbourGrid(
        radius=radius_m,
        cells_per_radius=cells_per_radius,
        origin=origin,
        order=order,
        points=sorted_points,
        cells=cells,
        start=start,
        column_start=column_start,
        table=fill_table(columns),
        sums=sum_cells(sorted_points, start, cells, edge),
    )


def covariances(
    grid: NeighbourGrid, workers: int = 1
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Blocks of the cloud: index (m,) of each point, its number of neighbours (m,), and their covariance.

    A neighbour lies within the radius; a point is its own. Covariances (m, 6) m^2 are xx xy xz yy yz zz,
    unbiased, and zero where there are no two neighbours. The order of blocks and of sums is always the
    same, whatever the number of `workers` (threads).
    """
    return each_block(grid, lambda *block: block, workers)


def each_block(
    grid: NeighbourGrid,
    finish: Callable[[np.ndarray, np.ndarray, np.ndarray], Result],
    workers: int = 1,
) -> Iterator[Result]:
    """What `finish` makes of each block of `covariances`, in their order; it is called in the threads."""

    def one(bounds: tuple[int, int]) -> Result:
        return finish(*_block(grid, *bounds))

    waiting: deque[Future[Result]] = deque()
    with ThreadPoolExecutor(workers) as pool:
        for bounds in _blocks(grid.start):
            waiting.append(pool.submit(one, bounds))
            # A few blocks ahead of the one in use, never all of them: they would fill the memory.
            if len(waiting) > 2 * workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def as_matrices(covariance: Float[np.ndarray, "m 6"]) -> Float[np.ndarray, "m 3 3"]:
    """Symmetric matrices of their six entries xx xy xz yy yz zz."""
    return covariance[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)


def _block(grid: NeighbourGrid, first: int, last: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    begin, end = grid.start[first], grid.start[last]
    counts = np.zeros(end - begin, dtype=np.int64)
    covariance = np.zeros((end - begin, 6))
    sum_neighbours(
        first,
        last,
        grid.points,
        grid.cells,
        grid.start,
        grid.column_start,
        *grid.table,
        grid.sums,
        grid.radius,
        grid.cells_per_radius,
        counts,
        covariance,
    )
    return grid.order[begin:end], counts, covariance


def _blocks(start: np.ndarray) -> list[tuple[int, int]]:
    """Ranges of cells with about as many points each."""
    n = start[-1]
    cuts = np.searchsorted(start, np.arange(ROWS_AT_A_TIME, n, ROWS_AT_A_TIME))
    edges = np.unique(np.concatenate([[0], cuts, [len(start) - 1]]))
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))


def _keys(points: np.ndarray, origin: np.ndarray, edge: float) -> np.ndarray:
    """Sorting key (n,) of each point's cell: x, y, z with 21 bits each, 63 of an integer's 64."""
    key = np.zeros(len(points), dtype=np.int64)
    for axis in range(3):
        key <<= 21
        key |= ((points[:, axis] - origin[axis]) / edge).astype(np.int64)
    return key


def _suited(points: np.ndarray, origin: np.ndarray, radius: float) -> int:
    """Most cells in a radius that leave a cell its points; judged by at most some 200,000 points."""
    if len(points) == 0:
        return 1
    step = max(1, len(points) // 200_000)
    for n in range(_MAX_CELLS_PER_RADIUS, 1, -1):
        # Points per cell, as a point sees it, falls with thinning in proportion.
        _, sizes = np.unique(_keys(points[::step], origin, radius / n), return_counts=True)
        others = float(np.sum(sizes * (sizes - 1.0)) / sizes.sum()) * step
        if others + 1 >= _POINTS_PER_CELL:
            return n
    return 1

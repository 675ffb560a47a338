"""A way on foot through all rooms: stops, their order, and the shortest paths between."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.sparse import csgraph

from planfit.errors import OptionError
from planfit.synth.building import Building
from planfit.synth.options import WalkOptions

GRID_M = 0.08
MARGIN_M = 0.03
"""Kept beyond the clearance, so that straight steps between grid points do not cut corners."""
COMFORT_M = 0.9
"""Ways nearer than this to walls and furniture count as longer, so people walk in the middle."""


@dataclass(frozen=True)
class Grid:
    """Points where the camera may be, and the steps between neighbours."""

    xy: Float[np.ndarray, "n 2"]
    """Building frame, m."""
    clearance: Float[np.ndarray, " n"]
    """Distance to walls and furniture, m."""
    steps: sparse.csr_matrix
    """Cost of the steps between any two, m; (n, n)."""

    def stops(
        self,
        nodes: Int[np.ndarray, " m"],
        area_m2: float,
        options: WalkOptions,
        rng: np.random.Generator,
    ) -> list[int]:
        """Nodes of a room of this area, one for every so many m2: each as far as can be from those before
        and, if possible, from walls."""
        clear = self.clearance[nodes]
        roomy = nodes[clear >= min(0.7, np.quantile(clear, 0.6))]
        xy = self.xy[roomy]
        # The one drawn is only the seed of the others.
        gap = np.linalg.norm(xy - xy[rng.integers(len(roomy))], axis=1)
        chosen: list[int] = []
        for _ in range(max(1, round(area_m2 / options.area_per_stop_m2))):
            chosen.append(int(roomy[np.argmax(gap)]))
            gap = np.minimum(gap, np.linalg.norm(xy - self.xy[chosen[-1]], axis=1))
        return list(dict.fromkeys(chosen))

    def furthest(self, nodes: Int[np.ndarray, " m"], start: int) -> int:
        """Of some nodes the one furthest from a node."""
        away = np.linalg.norm(self.xy[nodes] - self.xy[start], axis=1)
        return int(nodes[np.argmax(away)])


def find_route(
    building: Building,
    options: WalkOptions,
    rng: np.random.Generator,
    start: Float[np.ndarray, "2"] | None = None,
) -> Float[np.ndarray, "n 2"]:
    """Points, m, of a way that calls at every room; closed ways end where they begin.

    Args:
        building: one storey.
        options: clearance, stops, and whether the way is closed.
        rng: source of the stops.
        start: where it begins, m, building frame; without, at a stop.

    Raises:
        OptionError: some room cannot be entered with this clearance.
    """
    grid = _make_grid(building, options.clearance_m)
    stops = _choose_stops(building, grid, options, rng)
    if start is not None:
        first = int(np.argmin(np.linalg.norm(grid.xy - start, axis=1)))
        stops = np.concatenate([[first], stops[stops != first]])
    cost, before = csgraph.dijkstra(grid.steps, indices=stops, return_predecessors=True)
    between = cost[:, stops]
    if not np.isfinite(between).all():
        raise OptionError(
            "clearance_m: expected a way on foot to every room, found none; "
            "use a smaller clearance_m, wider doors, or less furniture"
        )
    order = short_tour(between, options.is_loop)
    legs = [trace(before[a], stops[a], stops[b]) for a, b in pairwise(order)]
    xy = grid.xy[[stops[order[0]], *(node for leg in legs for node in leg)]]
    if start is None:
        return xy
    return np.concatenate([start[None], xy, start[None] if options.is_loop else xy[:0]])


def _make_grid(building: Building, clearance: float) -> Grid:
    bounds = building.bounds
    x = np.arange(bounds.x0, bounds.x1, GRID_M)
    y = np.arange(bounds.y0, bounds.y1, GRID_M)
    xy = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    distance = building.clearance(xy)
    is_free = distance >= clearance + MARGIN_M
    price = comfort_price(distance)
    shape = (len(x), len(y))
    return Grid(
        xy[is_free],
        distance[is_free],
        grid_steps(is_free.reshape(shape), price.reshape(shape), GRID_M),
    )


def comfort_price(clearance: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """What a metre costs so near to walls; 1 where there is room."""
    return 1.0 + 2.0 * np.maximum(0.0, 1.0 - clearance / COMFORT_M)


def grid_steps(
    is_free: Bool[np.ndarray, "nx ny"], price: Float[np.ndarray, "nx ny"], spacing_m: float
) -> sparse.csr_matrix:
    """Cost of the steps between free points and their free neighbours, eight at most; (n, n) over the free
    points in the order of `is_free.ravel()`."""
    number = np.full(is_free.shape, -1)
    number[is_free] = np.arange(is_free.sum())
    n_x, n_y = is_free.shape
    price = price[is_free]
    rows, columns, costs = [], [], []
    # Half of the eight neighbours; the other half are the same steps the other way (`half.T`). Slices of
    # the image of node numbers shifted against each other pair each point with its neighbour.
    for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
        a = number[: n_x - dx, max(0, -dy) : n_y - max(0, dy)].ravel()
        b = number[dx:, max(0, dy) : n_y + min(0, dy)].ravel()
        both = (a >= 0) & (b >= 0)
        rows.append(a[both])
        columns.append(b[both])
        costs.append(np.hypot(dx, dy) * spacing_m * (price[a[both]] + price[b[both]]) / 2)
    n = int(is_free.sum())
    half = sparse.csr_matrix(
        (np.concatenate(costs), (np.concatenate(rows), np.concatenate(columns))), shape=(n, n)
    )
    return half + half.T


def _choose_stops(
    building: Building, grid: Grid, options: WalkOptions, rng: np.random.Generator
) -> Int[np.ndarray, " k"]:
    """In each room a point for every so many m2, far from each other and, if possible, from walls.

    Only points of the largest connected part count: corners behind furniture are no place to go.
    """
    _, part = csgraph.connected_components(grid.steps, directed=False)
    is_main = part == np.argmax(np.bincount(part)) if len(part) else np.zeros(0, dtype=bool)
    stops: list[int] = []
    for i, room in enumerate(building.layout.rooms):
        inside = np.flatnonzero(is_main & room.contains(grid.xy))
        if len(inside) == 0:
            raise OptionError(
                f"clearance_m: expected a way on foot into every room, found none into room {i}; "
                "use a smaller clearance_m, wider doors, or less furniture"
            )
        stops += grid.stops(inside, room.area, options, rng)
    if len(stops) < 2:
        stops.append(grid.furthest(np.flatnonzero(is_main), stops[0]))
    return np.array(stops)


def short_tour(between: Float[np.ndarray, "n n"], is_loop: bool) -> list[int]:
    """Order of stops from 0: nearest neighbour, then 2-opt; a loop comes back to 0."""
    n = len(between)
    order, left = [0], set(range(1, n))
    while left:
        nearest = min(sorted(left), key=lambda s: between[order[-1], s])
        order.append(nearest)
        left.remove(nearest)
    if is_loop:
        order.append(0)
    last = len(order) - 1 if is_loop else len(order)
    improved = True
    while improved:
        improved = False
        for i in range(1, last - 1):
            for j in range(i + 1, last):
                after = between[order[j], order[j + 1]] if j + 1 < len(order) else 0.0
                new_after = between[order[i], order[j + 1]] if j + 1 < len(order) else 0.0
                old = between[order[i - 1], order[i]] + after
                new = between[order[i - 1], order[j]] + new_after
                if new < old - 1e-9:
                    order[i : j + 1] = order[i : j + 1][::-1]
                    improved = True
    return order


def trace(before: Int[np.ndarray, " n"], start: int, stop: int) -> list[int]:
    """Nodes after `start` up to `stop`, back along the node `before` each on its shortest way."""
    nodes = []
    while stop != start:
        nodes.append(int(stop))
        stop = before[stop]
    return nodes[::-1]

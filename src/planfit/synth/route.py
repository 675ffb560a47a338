"""A way on foot through all rooms of a building, or through those of a plan, of a length that may be limited:
stops, their order, and the shortest paths between."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.sparse import csgraph

from planfit.errors import OptionError
from planfit.floorplan import Floorplan
from planfit.priors import DOOR_PASSED_LEAST_M
from planfit.scan.poses import read_tum
from planfit.synth.building import Building
from planfit.synth.options import WalkOptions
from planfit.synth.plan_building import PlanBuilding
from planfit.synth.plan_walls import CELL_M

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
    """Points, m, of a way that calls at every room; closed ways end where they begin: at `start` (m, building
    frame), or at a stop.

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


_SQUEEZE_PRICE = 8.0
"""Ways through doors narrower than twice the clearance count as so much longer, at their narrowest."""
DOOR_CLEARANCE_M = DOOR_PASSED_LEAST_M.value / 2
"""How near the camera comes to walls, m, in doors narrower than twice `clearance_m`: half a narrow
passage."""
_NEAR_M = 20.0
"""The next stop is first looked for this near: the whole of a large plan takes a second a stop."""


def read_path(options: WalkOptions, floorplan: Floorplan) -> Float[np.ndarray, "n 2"]:
    """Points, plan frame, m, of the path that the options name.

    Raises:
        ScanError: the file is missing or of another kind.
        OptionError: it does not lead anywhere, or not through the plan.
    """
    assert options.path is not None
    _, poses = read_tum(options.path)
    xy = poses[:, :2, 3] + options.path_offset_m
    extent = float(np.ptp(xy, axis=0).max())
    if not 0.1 < extent < np.inf:
        raise OptionError(
            f"{options.path}: expected a path in metres that leads somewhere, found one within {extent:.3g} m"
        )
    low, high = floorplan.ends.min(axis=(0, 1)), floorplan.ends.max(axis=(0, 1))
    if np.all((xy >= low) & (xy <= high), axis=1).mean() < 0.5:
        raise OptionError(
            f"{options.path}: expected a path through {floorplan.name}, whose walls lie in "
            f"{_range(low, high)}, found one in {_range(xy.min(axis=0), xy.max(axis=0))}; move it with "
            "--walk.path-offset-m (the origin of a picture is its top left corner, y up), or check the scale"
        )
    return xy


def _range(low: Float[np.ndarray, " 2"], high: Float[np.ndarray, " 2"]) -> str:
    return f"x {low[0]:.4g} to {high[0]:.4g}, y {low[1]:.4g} to {high[1]:.4g} m"


def find_plan_route(
    building: PlanBuilding, options: WalkOptions, rng: np.random.Generator
) -> Float[np.ndarray, "n 2"]:
    """Points, plan frame, m, of a way that calls at every large room that can be reached, or at as many as
    the length allows; closed ways end where they begin.

    Raises:
        OptionError: there is no free space that one could walk through.
    """
    grid, step_lengths = _find_ways(building, options)
    stops = _choose_plan_stops(building, grid, options, rng)
    order, between = _visit(step_lengths, stops, options)
    visited = order[:-1] if options.is_loop else order
    kept = stops[visited]
    known = between[np.ix_(visited, visited)]
    tour = short_tour(known, options.is_loop)
    nodes = [int(kept[tour[0]])]
    for a, b in pairwise(tour):
        nodes += _leg(grid, int(kept[a]), int(kept[b]), known[a, b])
    return grid.xy[nodes]


def _find_ways(building: PlanBuilding, options: WalkOptions) -> tuple[Grid, sparse.csr_matrix]:
    """Cells where the camera may be, those in narrow doors dear; and the lengths of their steps, m."""
    clearance = building.cells.clearance
    least = min(DOOR_CLEARANCE_M, options.clearance_m) + MARGIN_M
    is_free = clearance >= least
    if is_free.sum() < 2:
        raise _no_way(building)
    short = np.clip((options.clearance_m + MARGIN_M - clearance) / CELL_M, 0.0, 1.0)
    price = comfort_price(clearance) + _SQUEEZE_PRICE * short
    grid = Grid(
        building.cells.xy[is_free.ravel()],
        clearance[is_free],
        grid_steps(is_free, price, CELL_M),
    )
    return grid, grid_steps(is_free, np.ones_like(clearance), CELL_M)


def _no_way(building: PlanBuilding) -> OptionError:
    return OptionError(
        f"{building.floorplan.name}: expected free space between walls to walk through, found none that a "
        f"camera can move in {DOOR_CLEARANCE_M:g} m from walls; check the plan's scale "
        f"({building.floorplan.size[0]:.3g} x {building.floorplan.size[1]:.3g} m now) with planfit plan, or "
        "give a plan with wider doors"
    )


def _choose_plan_stops(
    building: PlanBuilding, grid: Grid, options: WalkOptions, rng: np.random.Generator
) -> Int[np.ndarray, " k"]:
    """In each large room of the part that holds most of them, points far from each other and from walls."""
    _, part = csgraph.connected_components(grid.steps, directed=False)
    is_large = np.zeros(len(part), dtype=bool)
    inside = [np.flatnonzero(room.contains(grid.xy)) for room in building.rooms]
    for nodes in inside:
        is_large[nodes] = True
    counts = np.bincount(part[is_large], minlength=1) if is_large.any() else np.bincount(part)
    main = int(np.argmax(counts))
    stops: list[int] = []
    for room, nodes in zip(building.rooms, inside, strict=True):
        reached = nodes[part[nodes] == main]
        if len(reached):
            stops += grid.stops(reached, room.area, options, rng)
    if len(stops) < 2:
        # One small room, or none that is large: to its far end and back.
        nodes = np.flatnonzero(part == main)
        first = stops[0] if stops else int(nodes[rng.integers(len(nodes))])
        stops = [first, grid.furthest(nodes, first)]
    begin = int(rng.integers(len(stops)))
    return np.array(stops[begin:] + stops[:begin])


def _visit(
    step_lengths: sparse.csr_matrix, stops: Int[np.ndarray, " k"], options: WalkOptions
) -> tuple[list[int], Float[np.ndarray, "k k"]]:
    """Indices of stops, each the nearest to the one before, as many as the length allows (two at least),
    and what is known of the distances between them, infinite elsewhere. A loop comes back to the first."""
    longest = np.inf if options.max_length_m is None else options.max_length_m
    home = _lengths(step_lengths, stops, 0)
    between = np.full((len(stops), len(stops)), np.inf)
    between[0] = between[:, 0] = home
    order, left, walked = [0], set(range(1, len(stops))), 0.0
    while left:
        last = order[-1]
        ahead = _distances(step_lengths, stops, last, left)
        between[last] = np.minimum(between[last], ahead)
        between[:, last] = between[last]
        nearest = min(sorted(left), key=lambda s: float(ahead[s]))
        back = home[nearest] if options.is_loop else 0.0
        if len(order) > 1 and walked + ahead[nearest] + back > longest:
            break
        walked += ahead[nearest]
        order.append(nearest)
        left.remove(nearest)
    return ([*order, 0] if options.is_loop else order), between


def _distances(
    step_lengths: sparse.csr_matrix, stops: Int[np.ndarray, " k"], start: int, left: set[int]
) -> Float[np.ndarray, " k"]:
    """Lengths of ways from a stop to all others; infinite for far ones where a near one is left."""
    near = _lengths(step_lengths, stops, start, _NEAR_M)
    if np.isfinite(near[sorted(left)]).any():
        return near
    return _lengths(step_lengths, stops, start)


def _lengths(
    step_lengths: sparse.csr_matrix,
    stops: Int[np.ndarray, " k"],
    start: int,
    limit_m: float = np.inf,
) -> Float[np.ndarray, " k"]:
    return csgraph.dijkstra(step_lengths, indices=stops[[start]], limit=limit_m)[0, stops]


def _leg(grid: Grid, start: int, stop: int, length_m: float) -> list[int]:
    """Nodes of the way that is most pleasant to walk."""
    # A step costs up to three times its length where it is not in a narrow door: the search need seldom go
    # further.
    for most in (3.0 * length_m + 1.0, np.inf):
        _, before = csgraph.dijkstra(
            grid.steps, indices=np.array([start]), return_predecessors=True, limit=most
        )
        if before[0, stop] >= 0:
            break
    return trace(before[0], start, stop)

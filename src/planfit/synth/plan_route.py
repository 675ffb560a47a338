"""A way on foot through the rooms of a plan, of a length that may be limited."""

from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse
from scipy.sparse import csgraph

from planfit.errors import OptionError
from planfit.floorplan import Floorplan
from planfit.scan.poses import read_tum
from planfit.synth.options import WalkOptions
from planfit.synth.plan_building import PlanBuilding
from planfit.synth.plan_space import CELL_M
from planfit.synth.route import MARGIN_M, Grid, comfort_price, grid_steps, short_tour, trace

_SQUEEZE_PRICE = 8.0
"""Ways through doors narrower than twice the clearance count as so much longer, at their narrowest."""
DOOR_CLEARANCE_M = 0.25
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
    stops = _choose_stops(building, grid, options, rng)
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


def _choose_stops(
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

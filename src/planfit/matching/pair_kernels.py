"""Compiled loops of matching: descriptors, budgets, covisibility, paths.

In NumPy they are hundreds of calls on arrays of a few hundred rows, each under the interpreter's lock:
a second thread then mostly waits. Numba compiles their types, which nothing can wrap: shapes are in the
docstrings here, and in the annotations of the functions that call them.
"""

import heapq

import numpy as np

from planfit.compiled import kernel


@kernel
def mutual_nearest(
    product: np.ndarray, norms_a: np.ndarray, norms_b: np.ndarray, max_ratio_sq: float
) -> np.ndarray:
    """For each row of scalar products (k, l) its match, or -1, in one pass over them.

    Squared distances of descriptors of small integers are exact in float32, in whatever order summed.
    """
    k, n_columns = product.shape
    nearest = np.full(k, -1, np.int64)
    is_clear = np.zeros(k, np.bool_)
    best_of_column = np.full(n_columns, np.float32(np.inf))
    row_of_column = np.full(n_columns, -1, np.int64)
    for i in range(k):
        best = second = np.float32(np.inf)
        for j in range(n_columns):
            distance_sq = norms_a[i] + norms_b[j] - np.float32(2.0) * product[i, j]
            if distance_sq < second:
                if distance_sq < best:
                    best, second, nearest[i] = distance_sq, best, j
                else:
                    second = distance_sq
            if distance_sq < best_of_column[j]:
                best_of_column[j], row_of_column[j] = distance_sq, i
        is_clear[i] = best < np.float32(max_ratio_sq) * second
    for i in range(k):
        if not is_clear[i] or row_of_column[nearest[i]] != i:
            nearest[i] = -1
    return nearest


@kernel
def take_within_budget(pairs: np.ndarray, most: int, used: np.ndarray) -> np.ndarray:
    """Which pairs (p, 2) are taken (p,) bool, in order, while neither frame has `most`; counts in `used`."""
    taken = np.zeros(len(pairs), dtype=np.bool_)
    for k in range(len(pairs)):
        a, b = pairs[k, 0], pairs[k, 1]
        if used[a] < most and used[b] < most:
            used[a] += 1
            used[b] += 1
            taken[k] = True
    return taken


@kernel
def covisible_share(
    points: np.ndarray, bounds: np.ndarray, a_from_b: np.ndarray, pairs: np.ndarray
) -> np.ndarray:
    """Share (p,) of the points of either frame of a pair that the other shows, the smaller of the two.

    Points (n, s, 3) m of each frame, NaN for none; bounds (n, 2, 2) of x / z and y / z in its image;
    a_from_b (p, 4, 4) of pairs (p, 2).
    """
    result = np.zeros(len(pairs))
    for k in range(len(pairs)):
        i, j = pairs[k]
        rotation, translation = a_from_b[k, :3, :3], a_from_b[k, :3, 3]
        back = np.zeros(3)  # translation of the inverse, -R^T t
        for r in range(3):
            back[r] = -(
                rotation[0, r] * translation[0]
                + rotation[1, r] * translation[1]
                + rotation[2, r] * translation[2]
            )
        result[k] = min(
            _visible_share(points[j], rotation, translation, bounds[i]),
            _visible_share(points[i], rotation.T, back, bounds[j]),
        )
    return result


@kernel
def _visible_share(
    points: np.ndarray, rotation: np.ndarray, translation: np.ndarray, bound: np.ndarray
) -> float:
    """Share of points (s, 3) that, once moved, lie before the camera and within the image's bounds."""
    n, seen = 0, 0
    for p in points:
        if np.isnan(p[0]):
            continue
        n += 1
        z = rotation[2, 0] * p[0] + rotation[2, 1] * p[1] + rotation[2, 2] * p[2] + translation[2]
        if z > 0.1:
            x = (
                rotation[0, 0] * p[0]
                + rotation[0, 1] * p[1]
                + rotation[0, 2] * p[2]
                + translation[0]
            ) / z
            y = (
                rotation[1, 0] * p[0]
                + rotation[1, 1] * p[1]
                + rotation[1, 2] * p[2]
                + translation[1]
            ) / z
            if bound[0, 0] < x < bound[0, 1] and bound[1, 0] < y < bound[1, 1]:
                seen += 1
    return seen / n if n > 0 else 0.0


@kernel
def most_certain_paths(
    begin: np.ndarray, to: np.ndarray, edge: np.ndarray, is_back: np.ndarray, cost_of: np.ndarray,
    forth: np.ndarray, back: np.ndarray, variance: np.ndarray, ends: np.ndarray, max_cost: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Motions (p, 4, 4) and summed variances (p, 3) along the cheapest paths between `ends` (p, 2).

    Where the path costs more than `max_cost`, it is not looked for: its motion is 0, its variances infinite.

    Half-edges leave node i at begin[i]:begin[i + 1]; half-edge h leads to node to[h] along edge[h], against
    its direction where is_back[h]. Edges have a cost (e,), a motion (e, 4, 4) forth and its inverse back,
    and a variance (e, 3). `ends` are sorted by source: one search serves all targets of a source.
    """
    motions = np.zeros((len(ends), 4, 4))
    variances = np.zeros((len(ends), 3))
    k = 0
    while k < len(ends):
        source = ends[k, 0]
        last = k
        while last < len(ends) and ends[last, 0] == source:
            last += 1
        via, before = _search_paths(begin, to, edge, cost_of, source, ends[k:last, 1], max_cost)
        for t in range(k, last):
            if via[ends[t, 1]] < 0 and ends[t, 1] != source:
                variances[t] = np.inf
                continue
            # From the target back to the source: each step is put before what was gathered.
            motion = np.zeros((4, 4))  # np.eye takes 0.4 s to compile
            for r in range(4):
                motion[r, r] = 1.0
            node = ends[t, 1]
            while node != source:
                h = via[node]
                step = back[edge[h]] if is_back[h] else forth[edge[h]]
                motion = step @ motion
                variances[t] += variance[edge[h]]
                node = before[node]
            motions[t] = motion
        k = last
    return motions, variances


@kernel
def _search_paths(
    begin: np.ndarray, to: np.ndarray, edge: np.ndarray, cost_of: np.ndarray, source: int,
    targets: np.ndarray, max_cost: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Dijkstra from one source until its targets are reached, or nothing else is within `max_cost`: half-edge
    and node before each node (n,), -1 where none is."""
    n = len(begin) - 1
    cost = np.full(n, np.inf)
    via, before = np.full(n, -1), np.full(n, -1)
    is_done, is_target = np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_)
    n_left = 0
    for target in targets:
        if not is_target[target]:
            is_target[target] = True
            n_left += 1
    cost[source] = 0.0
    heap = [(0.0, source)]
    while len(heap) > 0 and n_left > 0:
        here_cost, here = heapq.heappop(heap)
        if is_done[
            here
        ]:  # a cheaper entry of this node came first; the heap keeps no keys to lower
            continue
        is_done[here] = True
        if is_target[here]:
            n_left -= 1
        for h in range(begin[here], begin[here + 1]):
            new = here_cost + cost_of[edge[h]]
            if new < cost[to[h]] and new <= max_cost:
                cost[to[h]] = new
                via[to[h]] = h
                before[to[h]] = here
                heapq.heappush(heap, (new, to[h]))  # type: ignore[arg-type]
    return via, before

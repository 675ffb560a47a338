"""The order of elimination and its work, against a slow twin on sets; and the choice made from it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.errors import OptionError
from planfit.lsq.normal_equations import BlockPattern
from planfit.lsq.ordering import minimum_degree_ordering
from planfit.lsq.solver import SolverOptions


def work_of(order, rows, columns, n):
    """Work of eliminating poses in an order, on sets; each must have the fewest neighbours left."""
    near = [set() for _ in range(n)]
    for i, j in zip(rows, columns, strict=True):
        if i != j:
            near[i].add(j)
            near[j].add(i)
    work, left = 0.0, set(range(n))
    for v in order:
        if all(len(near[u]) == len(left) - 1 for u in left):
            return work + len(left) ** 3 / 6.0
        assert len(near[v]) == min(len(near[u]) for u in left)
        work += 0.5 * (len(near[v]) + 1) ** 2
        left.remove(v)
        for u in near[v]:
            near[u] = (near[u] | near[v]) - {u, v}
    return work


def graph(rng, n, n_loops):
    i, j = np.arange(n - 1), np.arange(1, n)
    loops = np.sort(rng.integers(n, size=(n_loops, 2)), axis=1)
    pattern = BlockPattern(np.append(i, loops[:, 0]), np.append(j, loops[:, 1]), n)
    return pattern.rows, pattern.columns


@pytest.mark.parametrize(
    ("n", "n_loops"), [(1, 0), (2, 0), (30, 0), (30, 10), (200, 400), (40, 2000)]
)
def test_order_is_of_minimum_degree_and_work_is_its_own(rng, n, n_loops):
    rows, columns = graph(rng, n, n_loops)
    found = minimum_degree_ordering(rows, columns, n, np.inf)
    assert_array_equal(np.sort(found.order), np.arange(n))
    assert_allclose(found.work, work_of(found.order, rows, columns, n))


def test_count_ends_at_its_limit(rng):
    rows, columns = graph(rng, 200, 400)
    work = minimum_degree_ordering(rows, columns, 200, np.inf).work
    assert minimum_degree_ordering(rows, columns, 200, work).work == work
    assert minimum_degree_ordering(rows, columns, 200, 0.5 * work) is None


def test_neighbours_are_those_left_when_a_pose_goes(rng):
    rows, columns = graph(rng, 60, 40)
    found = minimum_degree_ordering(rows, columns, 60, np.inf)
    near = [set() for _ in range(60)]
    for i, j in zip(rows, columns, strict=True):
        if i != j:
            near[i].add(j)
            near[j].add(i)
    for k, v in enumerate(found.order):
        assert set(found.neighbours[found.start[k] : found.start[k + 1]]) == near[v]
        for u in near[v]:
            near[u] = (near[u] | near[v]) - {u, v}


@pytest.mark.slow
def test_few_loops_are_factorised_and_paths_and_scattered_loops_are_not(rng):
    assert BlockPattern(*graph(rng, 20_000, 100), 20_000).cholesky is not None
    assert BlockPattern(*graph(rng, 20_000, 0), 20_000).is_banded
    assert BlockPattern(*graph(rng, 20_000, 20_000), 20_000).cholesky is None


def test_unknown_linear_solver_is_named():
    with pytest.raises(
        OptionError, match=r"linear_solver: expected auto, direct, cg or pardiso, found 'lu'"
    ):
        SolverOptions(linear_solver="lu")

"""Supernodes against the factor of a dense matrix: every block of it has its place, and few more."""

import numpy as np
import pytest

from planfit.lsq.ordering import (
    MAX_SMALL,
    MAX_ZEROS,
    find_supernodes,
    minimum_degree_ordering,
)


def walk(n, lap):
    """Edges of a walk in laps: neighbours in time, and the same place a lap later."""
    gaps = [0, 1, 2, 3, lap]
    rows = np.concatenate([np.arange(n - k) for k in gaps if k < n])
    return rows, rows + np.concatenate([np.full(n - k, k) for k in gaps if k < n])


def filled(order, rows, columns):
    """Blocks (n, n) of the factor that are not zero, in that order: elimination on sets."""
    n = len(order)
    place = np.argsort(order)
    near = np.eye(n, dtype=bool)
    near[place[rows], place[columns]] = near[place[columns], place[rows]] = True
    for k in range(n):
        later = np.flatnonzero(near[k, k + 1 :]) + k + 1
        near[np.ix_(later, later)] = True
    return np.tril(near)


@pytest.mark.parametrize(("n", "lap"), [(1, 5), (12, 40), (60, 20), (120, 12), (90, 80)])
def test_fronts_hold_the_factor_and_few_zeros(n, lap):
    rows, columns = walk(n, lap)
    nodes = find_supernodes(minimum_degree_ordering(rows, columns, n, np.inf))
    np.testing.assert_array_equal(np.sort(nodes.order), np.arange(n))
    expected = filled(nodes.order, rows, columns)
    stored = np.zeros((n, n), dtype=bool)
    for s in range(len(nodes.n_children)):
        own = np.arange(nodes.first[s], nodes.first[s + 1])
        below = nodes.below[nodes.start[s] : nodes.start[s + 1]]
        assert (np.diff(below) > 0).all()
        assert (below >= nodes.first[s + 1]).all()
        stored[np.ix_(own, own)] = np.tri(len(own), dtype=bool)
        stored[np.ix_(below, own)] = True
        assert (nodes.of_place[own] == s).all()
        if len(own) > MAX_SMALL:
            held = stored[:, own]
            assert (held & ~expected[:, own]).sum() <= MAX_ZEROS * held.sum()
    assert not (expected & ~stored).any()


@pytest.mark.parametrize(("n", "lap"), [(60, 20), (120, 12), (200, 200)])
def test_what_a_child_leaves_has_rows_in_its_parent(n, lap):
    nodes = find_supernodes(minimum_degree_ordering(*walk(n, lap), n, np.inf))
    waiting = []  # as the factorisation takes them: the last that were left
    for s in range(len(nodes.n_children)):
        own = np.arange(nodes.first[s], nodes.first[s + 1])
        below = nodes.below[nodes.start[s] : nodes.start[s + 1]]
        front = np.append(own, below)
        for _ in range(nodes.n_children[s]):
            child = slice(*nodes.start[(c := waiting.pop()) : c + 2])
            np.testing.assert_array_equal(front[nodes.in_parent[child]], nodes.below[child])
        if len(below):
            waiting.append(s)
    assert not waiting

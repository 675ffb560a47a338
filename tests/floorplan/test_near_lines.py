"""Lines near one another, found without looking at every pair: the same ones; refused where too many."""

import numpy as np
import pytest
import scipy.sparse
import shapely

from planfit.errors import FloorplanError
from planfit.floorplan import read_floorplan
from planfit.floorplan.near_lines import groups_within, possible_partners
from planfit.floorplan.vector.line_work import merge_collinear
from planfit.geometry import segments


def random_lines(rng, n, size=20.0):
    angle = rng.choice([0.0, 0.5 * np.pi, 0.3], n) + rng.normal(0, 0.02, n) * rng.integers(0, 2, n)
    start = np.round(rng.uniform(0, size, (n, 2)), 1)
    length = rng.exponential(2.0, n) + 1e-4
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.stack([start, start + length[:, None] * along], axis=1)


def components(near):
    return scipy.sparse.csgraph.connected_components(scipy.sparse.coo_matrix(near), directed=False)[
        1
    ]


def distances(ends):
    lines = np.asarray(shapely.linestrings(ends), dtype=object)
    return shapely.distance(lines[:, None], lines[None])


@pytest.mark.parametrize("sine", [np.sin(np.deg2rad(2.0)), np.sin(np.deg2rad(5.0))])
def test_no_line_beside_another_is_missed(rng, sine):
    ends = random_lines(rng, 400, 10.0)
    along, left = segments.directions(ends), segments.left_normals(ends)
    wanted = (distances(ends) <= 0.6) & (np.abs(along @ left.T) < sine)
    found = np.zeros_like(wanted, dtype=int)
    for line, other in possible_partners(ends, 0.6, sine):
        np.add.at(found, (line, other), 1)
    assert wanted.sum() > 1000
    assert found[wanted].min() == 1
    assert found.max() == 1


@pytest.mark.parametrize("distance", [0.02, 0.3, 1.0])
def test_groups_are_those_of_all_distances(rng, distance):
    ends = np.concatenate([random_lines(rng, 120, 15.0), random_lines(rng, 15, 10.0) + 40.0])
    expected = components(distances(ends) <= distance)
    found = groups_within(ends, distance)
    assert len(np.unique(found)) == len(np.unique(expected)) > 1
    assert len(np.unique(np.stack([found, expected]), axis=1).T) == len(np.unique(expected))


def test_lines_on_one_another_are_those_of_all_pairs(rng):
    whole = random_lines(rng, 150)
    share = rng.uniform(0, 1, (100, 2, 1))
    parts = whole[:100, :1] * (1 - share) + whole[:100, 1:] * share
    specks = parts[:30, :1] + rng.uniform(-4e-3, 4e-3, (30, 2, 2))
    ends, tolerance = np.concatenate([whole, parts, specks]), 5e-3
    length, left = segments.lengths(ends), segments.left_normals(ends)
    across = np.abs(np.einsum("abei,ai->abe", ends[None] - ends[:, None, :1], left)).max(axis=2)
    near = (distances(ends) <= tolerance) & (across < tolerance)
    near &= length[None] < length[:, None]
    expected = components(near)
    merged, group = merge_collinear(ends, tolerance)
    assert (group == expected).all()
    assert len(merged) == expected.max() + 1 < 200


def svg_of(path, ends):
    lines = "".join(
        f'<line x1="{a:.4f}" y1="{b:.4f}" x2="{c:.4f}" y2="{d:.4f}" stroke="black"/>'
        for a, b, c, d in ends.reshape(-1, 4)
    )
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 900 900">{lines}</svg>')
    return path


@pytest.mark.parametrize("kind", ["side by side", "cross"])
def test_line_work_beyond_any_plan_is_refused_in_a_line(tmp_path, rng, kind):
    n = 3_000 if kind == "side by side" else 1_600
    if kind == "cross":
        ends = rng.uniform(0, 900, (n, 2, 2))
    else:
        v = rng.uniform(400, 410, n)
        ends = np.stack([np.stack([0 * v + 10, v], 1), np.stack([0 * v + 890, v], 1)], axis=1)
    path = svg_of(tmp_path / "dense.svg", ends)
    with pytest.raises(FloorplanError, match=rf"dense\.svg: expected line work .*{kind}.*--layer"):
        read_floorplan(path)

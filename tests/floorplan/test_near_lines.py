"""Lines near one another, found without looking at every pair: the same ones; refused where too many."""

import json
import re
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
import scipy.sparse
import shapely

from planfit.errors import FloorplanError
from planfit.floorplan import read_floorplan
from planfit.floorplan.faces import groups_within, possible_partners
from planfit.floorplan.vector.cleaning import MOST_TIMES, cleaned
from planfit.floorplan.vector.drawing import DrawingBuilder
from planfit.floorplan.vector.line_work import merge_collinear
from planfit.floorplan.vector.regions import SelfCrossings
from planfit.floorplan.vector.wall_sides import sides_with_room
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


def geojson_of(path, kind, coordinates):
    features = [
        {"type": "Feature", "properties": {"type": "wall"},
         "geometry": {"type": kind, "coordinates": each}}
        for each in coordinates
    ]  # fmt: skip
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))


def star(n):
    """A closed outline of `n` corners, of which each side crosses most others."""
    angle = 2.399 * np.arange(n)
    points = np.stack([4.5 + 4 * np.cos(angle), 3 + 3 * np.sin(angle)], axis=1)
    return [*points.tolist(), points[0].tolist()]


ROOM = [[0, 0, 9, 0], [9, 0, 9, 6], [9, 6, 0, 6], [0, 6, 0, 0]]


def star_of_one_polygon(path):
    geojson_of(path, "Polygon", [[star(4000)]])


def stars_of_many_polygons(path):
    geojson_of(path, "Polygon", [[star(40)] for _ in range(40)])


def needles_across_one_another(path):
    rng = np.random.default_rng(0)
    tips, feet = rng.uniform(0, 20, (2, 4000, 2))
    rings = np.stack([tips, feet, feet + 0.1, tips], axis=1)
    geojson_of(path, "Polygon", [[ring] for ring in rings.tolist()])


def star_filled(path):
    points = " ".join(f"{x:.3f},{y:.3f}" for x, y in star(4000))
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg"><path d="M{points}Z"/></svg>')


def nearly_equal_segments(path):
    noise = np.random.default_rng(0).normal(0, 1e-9, (800_000, 4))
    np.save(path, np.tile(ROOM, (200_000, 1)) + noise)


def specks_on_one_another(path):
    ends = np.tile([[[450.0, 450.0], [450.1, 450.0]]], (30_000, 1, 1))
    ends += np.random.default_rng(0).uniform(0, 0.02, ends.shape)
    room = 100 * np.reshape(ROOM, (-1, 2, 2))
    svg_of(path, np.concatenate([room, ends]))


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (star_of_one_polygon, "a.geojson"),
        (stars_of_many_polygons, "a.geojson"),
        (needles_across_one_another, "a.geojson"),
        (star_filled, "a.svg"),
        pytest.param(nearly_equal_segments, "a.npy", marks=pytest.mark.slow),
        pytest.param(specks_on_one_another, "a.svg", marks=pytest.mark.slow),
    ],
)
def test_plans_that_would_take_all_memory_are_refused_in_a_line(tmp_path, make, name):
    """Two of them took 4.7 GB, and one of these ended the process."""
    make(tmp_path / name)
    code, said, peak_mb = planned(tmp_path / name)
    assert code == 2, said
    assert re.fullmatch(
        rf"planfit: .*{name}: expected line work of a plan, found .*--layer.*", said
    )
    assert peak_mb < 2000


@pytest.mark.slow
def test_a_wall_drawn_a_hundred_thousand_times_is_one(tmp_path):
    """It took 3.5 GB, and was refused as a damaged file."""
    path = tmp_path / "a.geojson"
    lines = [[[a, b], [c, d]] for a, b, c, d in [*ROOM, *[[3, 0, 3, 6]] * 100_000]]
    geojson_of(path, "LineString", lines)
    code, said, peak_mb = planned(path, "--unit", "m")
    assert code == 0, said
    assert peak_mb < 2000


def test_room_beside_the_lines_of_a_scribble_is_sought_without_all_pairs(rng):
    first = rng.uniform(0, 1.5, (3000, 2))
    scribble = np.stack([first, first + rng.normal(0, 0.1, first.shape)], axis=1)
    tracemalloc.start()
    try:
        sides = sides_with_room(scribble, 0.62)
        peak_mb = tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()
    assert (sides == 0).mean() > 0.9
    assert peak_mb < 30


def planned(path, *words):
    """Exit code, standard error and megabytes of `planfit plan` in a process of its own."""
    code = f"""
import resource
from planfit.cli import run
code = run(["plan", {str(path)!r}, *{words!r}])
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000)
raise SystemExit(code)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    return done.returncode, done.stderr.strip(), float(done.stdout.splitlines()[-1])


def test_a_ring_that_crosses_itself_now_and_then_is_made_valid():
    bow_tie, pentagram = shapely.Polygon([[0, 0], [9, 6], [9, 0], [0, 6]]), shapely.Polygon(star(5))
    crossings = SelfCrossings()
    for area in (bow_tie, pentagram, shapely.Polygon(star(20)), shapely.box(0, 0, 1, 1)):
        assert crossings.valid(area).equals(shapely.make_valid(area))
    many = [shapely.Polygon(star(20))] * 100
    with pytest.raises(FloorplanError, match="cross themselves over 4000 times"):
        list(map(crossings.valid, many))


def test_of_a_line_drawn_many_times_some_stay():
    ends = np.array([[[0.0, 0.0], [9.0, 0.0]]] * 200 + [[[0.0, 0.0], [0.0, 6.0]]] * 3)
    builder = DrawingBuilder()
    for k, each in enumerate(ends):
        builder.add_polyline(each if k % 2 else each[::-1], np.zeros(1, dtype=bool), "walls", "")
    drawing, notes = cleaned(builder.build())
    assert len(drawing.lines) == MOST_TIMES + 3
    assert notes == ("201 lines drawn twice",)

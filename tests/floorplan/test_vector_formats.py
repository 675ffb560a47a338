"""The same building in every format gives the same faces; windows and doors drawn in it are gaps."""

import numpy as np
import pytest
import shapely

from plan_files import (
    PNG_MARGIN_PX,
    VILLA_WINDOWS,
    door_lines,
    make_plan,
    make_villa,
    window_lines,
    write_dxf,
    write_geojson,
    write_ifc,
    write_pdf,
    write_png,
    write_svg,
)
from planfit.floorplan import PlanOptions, read_floorplan
from planfit.floorplan.vector.regions import faces_of_regions

WALLS, BUILDING = make_plan(n_rooms=6)
VILLA = make_villa()
BUILDINGS = {"straight": WALLS, "slanted": VILLA}
MIN_FACE_M = 0.5
"""Shorter ones are jambs and ends of walls, which formats with lines alone need not show."""


@pytest.fixture(params=BUILDINGS)
def walls(request):
    return BUILDINGS[request.param]


def on_faces(ends, normals, of_ends, of_normals, within):
    """Share of the length of `of` that lies on a face of `ends` looking the same way."""
    found = total = 0.0
    for segment, normal in zip(of_ends, of_normals, strict=True):
        length = np.linalg.norm(segment[1] - segment[0])
        t = (np.arange(0.02, length - 0.02, 0.02) / length)[:, None]
        points = shapely.points(segment[0] * (1 - t) + segment[1] * t)
        alike = ends[normals @ normal > 0.99]
        if len(alike):
            lines = shapely.multilinestrings(shapely.linestrings(alike))
            found += (shapely.distance(points, lines) < within).sum()
        total += len(points)
    return found / total


def assert_same(plan, walls, scale=1.0, offset=(0.0, 0.0), within=0.01, share=0.999):
    """All true faces are there, and nothing else; `scale` is plan units a metre."""
    truth = faces_of_regions(walls, 1e-6, 0.05)
    ends = plan.ends / scale - offset
    long = np.linalg.norm(truth.ends[:, 1] - truth.ends[:, 0], axis=1) > MIN_FACE_M
    assert plan.is_oriented.all()
    recall = on_faces(ends, plan.normals, truth.ends[long], truth.normals[long], within)
    precision = on_faces(truth.ends, truth.normals, ends, plan.normals, within)
    assert recall > share
    assert precision > share


def test_the_truth_is_that_of_the_building():
    truth = faces_of_regions(WALLS, 1e-6, 0.05)
    drawn = BUILDING.faces.ends[BUILDING.faces.parts != 1]
    assert np.linalg.norm(np.diff(drawn, axis=1)[:, 0], axis=1).sum() == pytest.approx(
        np.linalg.norm(np.diff(truth.ends, axis=1)[:, 0], axis=1).sum(), rel=0.01
    )


@pytest.mark.parametrize("hatch", [False, True])
@pytest.mark.parametrize(
    ("insunits", "unit", "scale"),
    [(6, "m", 1.0), (4, "mm", 0.001), (5, "cm", 0.01), (2, "ft", 0.3048)],
)
def test_dxf(tmp_path, walls, hatch, insunits, unit, scale):
    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", walls, scale, insunits, hatch=hatch))
    assert_same(plan, walls)
    assert plan.is_metric
    assert plan.source.unit == unit
    assert plan.source.unit_from == "the file's header"
    assert plan.source.layers == ("A-WALL",)


@pytest.mark.parametrize("fill", ["none", "black", "#777"])
def test_svg(tmp_path, walls, fill):
    plan = read_floorplan(write_svg(tmp_path / "a.svg", walls, fill=fill))
    assert not plan.is_metric
    assert plan.source.unit == "unknown"
    assert_same(plan, walls, 20.0, (5.0, -5.0))
    in_file = (
        plan.ends[0] @ plan.source.file_from_plan[:2, :2].T + plan.source.file_from_plan[:2, 2]
    )
    np.testing.assert_allclose(in_file, plan.ends[0] * (1, -1))


def test_svg_in_metres_where_told(tmp_path, walls):
    path = write_svg(tmp_path / "a.svg", walls)
    plan = read_floorplan(path, PlanOptions(metres_per_unit=0.05))
    assert_same(plan, walls, 1.0, (5.0, -5.0))


@pytest.mark.parametrize("fill", [None, "0 0 0", "0.5 0.5 0.5"])
def test_pdf(tmp_path, walls, fill):
    plan = read_floorplan(write_pdf(tmp_path / "a.pdf", walls, fill=fill))
    assert not plan.is_metric
    assert_same(plan, walls, 20.0, (5.0, 5.0))


def test_a_turned_page_is_read_as_it_is_shown(tmp_path):
    plan = read_floorplan(write_pdf(tmp_path / "a.pdf", WALLS, rotate=90))
    # Turned clockwise: page (x, y) is shown at (y, 1200 - x).
    back = np.stack([1200 - plan.ends[..., 1], plan.ends[..., 0]], axis=-1) / 20 - 5
    truth = faces_of_regions(WALLS, 1e-6, MIN_FACE_M)
    lines = shapely.multilinestrings(shapely.linestrings(back))
    assert shapely.distance(shapely.points(truth.ends.mean(axis=1)), lines).max() < 0.01


@pytest.mark.parametrize("prefix", [None, "MILLI"])
def test_ifc(tmp_path, walls, prefix):
    plan = read_floorplan(write_ifc(tmp_path / "a.ifc", walls, prefix))
    assert_same(plan, walls)
    assert plan.source.unit == ("m" if prefix is None else "mm")
    assert plan.source.storey == "Ground"


def test_geojson(tmp_path, walls):
    plan = read_floorplan(write_geojson(tmp_path / "a.geojson", walls))
    low = np.array(walls.bounds).reshape(2, 2)
    assert_same(plan, walls, offset=-low.mean(axis=0))
    in_file = plan.ends @ plan.source.file_from_plan[:2, :2].T + plan.source.file_from_plan[:2, 2]
    assert np.abs(in_file - (11.57, 48.14)).max() < 1e-3


@pytest.mark.parametrize("pixels_per_metre", [50.0, 70.0, 100.0])
@pytest.mark.parametrize("has_lines", [False, True], ids=["bare", "with lines"])
def test_png(tmp_path, walls, has_lines, pixels_per_metre):
    if has_lines and walls is WALLS:
        pytest.skip("its doors and windows are not known")
    lines, arcs = door_lines("line")
    drawn = ([*window_lines("panes"), *lines], arcs) if has_lines else ([], [])
    plan = read_floorplan(write_png(tmp_path / "a.png", walls, pixels_per_metre, *drawn))
    west, _, _, north = walls.bounds
    # The plan has (u, -v).
    offset = np.array([PNG_MARGIN_PX, -PNG_MARGIN_PX]) / pixels_per_metre - (west, north)
    assert_same(plan, walls, pixels_per_metre, offset, within=1.5 / pixels_per_metre, share=0.99)


def drawn_in_dxf(windows, doors, layer):
    lines, arcs = door_lines(doors)

    def draw(document):
        space, layers = document.modelspace(), {"layer": layer}
        for start, end in [*window_lines(windows), *lines]:
            space.add_line(start, end, dxfattribs=layers)
        for arc in arcs:
            space.add_arc(*arc, dxfattribs=layers)

    return draw


def drawn_in_svg(windows, doors, scale=20.0):
    def at(xy):
        return f"{xy[0] * scale + 100:.6f} {-xy[1] * scale + 100:.6f}"

    lines, arcs = door_lines(doors)
    paths = [f"M {at(start)} L {at(end)}" for start, end in [*window_lines(windows), *lines]]
    for centre, radius, *angles in arcs:
        start, end = (
            centre + radius * np.array([np.cos(a), np.sin(a)]) for a in np.deg2rad(angles)
        )
        paths.append(f"M {at(start)} A {radius * scale} {radius * scale} 0 0 0 {at(end)}")
    return "".join(f'<path d="{path}" fill="none" stroke="black"/>' for path in paths)


@pytest.mark.parametrize("doors", ["line", "box"])
@pytest.mark.parametrize("windows", ["pane", "panes", "sills"])
@pytest.mark.parametrize("kind", ["dxf, one layer", "dxf, layers", "svg", "svg, filled"])
def test_windows_and_doors_are_gaps(tmp_path, kind, windows, doors):
    """Panes and leaves are no walls, sills drawn through do not close a gap, and windows are marked."""
    if kind.startswith("dxf"):
        layer, other = ("PLAN", "PLAN") if "one" in kind else ("WALLS", "WINDOWS")
        extra = drawn_in_dxf(windows, doors, other)
        plan = read_floorplan(write_dxf(tmp_path / "a.dxf", VILLA, layer=layer, extra=extra))
        scale, offset = 1.0, np.zeros(2)
    else:
        fill = "black" if "filled" in kind else "none"
        extra = drawn_in_svg(windows, doors)
        plan = read_floorplan(write_svg(tmp_path / "a.svg", VILLA, fill=fill, extra=extra))
        scale, offset = 20.0, np.array([5.0, -5.0])
    assert_same(plan, VILLA, scale, offset, share=0.998)
    marked = plan.openings / scale - offset
    expected = []
    for start, end, low, high, thickness in VILLA_WINDOWS:
        along = (np.array(end, float) - start) / np.linalg.norm(np.array(end, float) - start)
        for depth in (0.0, thickness):
            origin = start + depth * np.array([-along[1], along[0]])
            expected.append([origin + low * along, origin + high * along])
    assert len(marked) == len(expected)
    apart = np.abs(np.array(expected)[:, None] - marked[None])
    either_way = np.minimum(
        apart.max(axis=(2, 3)),
        np.abs(np.array(expected)[:, None] - marked[None, :, ::-1]).max(axis=(2, 3)),
    )
    assert either_way.min(axis=1).max() < 0.01


@pytest.mark.parametrize("depths", [(0.3,), (0.4, 0.6), (0.2, 0.5)])
def test_layers_of_a_wall_are_no_windows(tmp_path, depths):
    """Lines within a wall from one door's jamb to the next: the wall ends where they do."""

    def layers(document):
        space = document.modelspace()
        for x in (0.0, 4.0, 8.0):
            for depth in depths:
                space.add_line((x, 0.4 * depth), (x + 3.0, 0.4 * depth))

    pieces = [shapely.box(x, 0.0, x + 3.0, 0.4) for x in (0.0, 4.0, 8.0)]
    piers = shapely.union_all(pieces)
    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", piers, layer="PLAN", extra=layers))
    assert plan.openings is None
    assert_same(plan, piers)


def test_an_arc_in_several_pieces_is_one_door(tmp_path):
    def draw(document):
        space = document.modelspace()
        lines, arcs = door_lines("box")
        for start, end in lines:
            space.add_line(start, end)
        for centre, radius, start, end in arcs:
            for low, high in ((start, start + 25), (start + 25, start + 60), (start + 60, end)):
                space.add_arc(centre, radius, low, high)

    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", VILLA, layer="PLAN", extra=draw))
    assert_same(plan, VILLA, share=0.998)


def test_a_leaf_that_swings_both_ways_is_no_wall(tmp_path):
    def draw(document):
        space = document.modelspace()
        for x in (7.0, 7.05):
            space.add_line((x, 3.0), (x, 5.0))
        space.add_arc((7.0, 4.0), 1.0, 90, 270)

    def bench(document):
        draw(document)
        space = document.modelspace()
        space.delete_entity(space.query("ARC").first)

    clean = read_floorplan(write_dxf(tmp_path / "a.dxf", VILLA, layer="PLAN"))
    plan = read_floorplan(write_dxf(tmp_path / "b.dxf", VILLA, layer="PLAN", extra=draw))
    np.testing.assert_allclose(plan.ends, clean.ends)
    # The same two lines without the arc are a thin wall.
    wall = read_floorplan(write_dxf(tmp_path / "c.dxf", VILLA, layer="PLAN", extra=bench))
    assert len(wall) == len(clean) + 2


def test_clones_and_symbols_of_an_svg_are_drawn_where_they_are_used(tmp_path):
    path = write_svg(tmp_path / "a.svg", WALLS)
    alone = read_floorplan(path)
    text = path.read_text()
    clone = '<use xlink:href="#floor" x="400"/></svg>'
    path.write_text(text.replace("<g >", '<g id="floor">').replace("</svg>", clone))
    twice = read_floorplan(path)
    assert len(twice) == 2 * len(alone)
    assert twice.size[0] == pytest.approx(alone.size[0] + 400)
    # A symbol shows only where it is used, and shows there.
    symbol = text.replace("<g >", '<symbol id="floor">').replace("</g>", "</symbol>")
    path.write_text(symbol.replace("</svg>", clone))
    moved = read_floorplan(path)
    np.testing.assert_allclose(moved.ends, alone.ends + np.array([400, 0]), atol=1e-6)


def test_a_wall_drawn_in_layers_between_its_windows_stays(tmp_path):
    """Panes and layers both run from jamb to jamb: what nothing tells apart is not cut out of the plan."""
    house = shapely.box(0, 0, 20, 8).difference(shapely.box(0.4, 0.4, 19.6, 7.6))

    def facade(document):
        space, layer, start = document.modelspace(), {"layer": "PLAN"}, 0.4
        for low, high in ((3.0, 4.5), (7.0, 8.5), (12.0, 14.0), (19.6, None)):
            space.add_line((start, 0.15), (low, 0.15), dxfattribs=layer)
            if high is not None:
                space.add_line((low, 0.2), (high, 0.2), dxfattribs=layer)
                for x in (low, high):
                    space.add_line((x, 0.0), (x, 0.4), dxfattribs=layer)
                start = high

    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", house, layer="PLAN", extra=facade))
    assert plan.openings is None
    assert_same(plan, house)


BEAMS = [((1.0, y), (4.0, y)) for y in (1.2, 1.45)] + [((x, 1.0), (x, 3.0)) for x in (2.0, 2.3)]
"""m, in front of whatever is there."""


@pytest.mark.parametrize("suffix", ["dxf", "pdf", "svg"])
def test_dashed_lines_are_told_apart(tmp_path, suffix):
    """By the line type of an entity or its layer, by the dash of a stroke."""
    path = tmp_path / f"plan.{suffix}"
    if suffix == "pdf":
        ends = [[f"{100 + 20 * v:.2f}" for v in (*a, *b)] for a, b in BEAMS]
        beams = "\n".join(f"{a} {b} m {c} {d} l S" for a, b, c, d in ends)
        write_pdf(path, WALLS, extra=f"[8 4] 0 d\n{beams}")
    elif suffix == "svg":
        ends = [[f"{100 + s * 20 * v:.2f}" for s, v in zip((1, -1) * 2, (*a, *b), strict=True)]
                for a, b in BEAMS]  # fmt: skip
        beams = "".join(f'<path d="M{a} {b} L{c} {d}"/>' for a, b, c, d in ends)
        style = "<style>.over path{stroke:#000;stroke-dasharray:8px 4px}</style>"
        write_svg(path, WALLS, extra=f'{style}<g class="over">{beams}</g>')
    else:

        def add(document):
            document.linetypes.add("HIDDEN", [0.375, 0.25, -0.125])
            document.layers.add("N2", linetype="HIDDEN")
            for k, (a, b) in enumerate(BEAMS):
                own = {"layer": "N2"} if k % 2 else {"layer": "N1", "linetype": "HIDDEN"}
                document.modelspace().add_line(a, b, dxfattribs=own)

        write_dxf(path, WALLS, layer="N1", extra=add)
    plan = read_floorplan(path)
    assert any(f"{len(BEAMS)} lines on layers of no walls: dashed lines" in words
               for words in plan.source.dropped)  # fmt: skip

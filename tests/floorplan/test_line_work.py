"""Walls among the rest of a drawing: rows, panes, furniture, rooms, layers, dimension texts."""

import json

import ezdxf
import numpy as np
import pytest
import scipy.spatial
import shapely
import trimesh
from ezdxf.enums import TextEntityAlignment
from test_vector_formats import on_faces

from plan_files import (
    make_plan,
    rings_of,
    write_dxf,
    write_geojson,
    write_ifc,
    write_pdf_stream,
    write_svg,
)
from planfit.errors import FloorplanError
from planfit.floorplan import PlanOptions, read_floorplan
from planfit.floorplan.faces import orient_faces
from planfit.floorplan.vector.double_lines import rows_of_lines
from planfit.floorplan.vector.layer_names import Role, role_of
from planfit.floorplan.vector.line_work import merge_collinear
from planfit.floorplan.vector.regions import faces_of_regions, section_area
from planfit.floorplan.vector.units import length_of_text
from planfit.priors import WALL_FACES_APART_M

WALLS, BUILDING = make_plan(n_rooms=6)
TRUTH = faces_of_regions(WALLS, 1e-6, 0.5)


def recall(plan, scale=1.0, translation=(0.0, 0.0), within=0.01):
    return on_faces(
        plan.ends / scale - translation, plan.normals, TRUTH.ends, TRUTH.normals, within
    )


def precision(plan, scale=1.0, translation=(0.0, 0.0), within=0.01):
    truth = faces_of_regions(WALLS, 1e-6, 0.02)
    return on_faces(
        truth.ends, truth.normals, plan.ends / scale - translation, plan.normals, within
    )


# --- partners: the slow, obvious twin of the tree ---------------------------------------------


def slow_orientation(ends, most=WALL_FACES_APART_M.high, least=WALL_FACES_APART_M.low):
    n = len(ends)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    along = (ends[:, 1] - ends[:, 0]) / length[:, None]
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    near, share = np.full((2, n), np.inf), np.zeros((2, n))
    for s, sides in enumerate((left, -left)):
        for i in range(n):
            spans = []
            for j in range(n):
                gap, at = (ends[j] - ends[i, 0]) @ sides[i], (ends[j] - ends[i, 0]) @ along[i]
                low, high = np.clip([at.min(), at.max()], 0, length[i])
                if (
                    abs(along[j] @ sides[i]) < np.sin(np.deg2rad(5))
                    and gap.min() > least
                    and gap.max() < most
                    and high - low > 0.05
                ):
                    near[s, i] = min(near[s, i], gap.min())
                    spans.append(shapely.LineString([(low, 0), (high, 0)]))
            share[s, i] = shapely.union_all(spans).length / length[i]
    wall_left = (share[0] > 0.3) & ((share[1] <= 0.3) | (near[0] < 0.7 * near[1]))
    wall_right = (share[1] > 0.3) & ((share[0] <= 0.3) | (near[1] < 0.7 * near[0]))
    return np.where(wall_left[:, None], -left, left), wall_left ^ wall_right


@pytest.mark.parametrize("sigma_deg", [0.0, 3.0])
def test_the_tree_finds_what_every_pair_finds(rng, sigma_deg):
    start = rng.uniform(0, 6, (150, 2))
    angle = rng.integers(0, 4, 150) * np.pi / 2 + 0.3 + np.deg2rad(rng.normal(0, sigma_deg, 150))
    way = np.stack([np.cos(angle), np.sin(angle)], axis=1) * rng.uniform(0.2, 5, (150, 1))
    ends = np.stack([start, start + way], axis=1)
    normals, is_oriented = orient_faces(ends)
    expected, expected_oriented = slow_orientation(ends)
    np.testing.assert_array_equal(is_oriented, expected_oriented)
    np.testing.assert_allclose(normals, expected)
    assert 0.2 < is_oriented.mean() < 1


# --- collinear --------------------------------------------------------------------------------


def test_lines_on_one_another_become_one_and_doors_stay_open():
    ends = np.array([
        [[0, 0], [2, 0]], [[1, 0], [3, 0.0001]], [[3, 0], [2.5, 0]],  # overlap, turned
        [[3.9, 0], [5, 0]],                                            # beyond a door
        [[0, 0.1], [3, 0.1]], [[3, 0], [3, 2]],                        # beside, across
    ], dtype=float)  # fmt: skip
    merged, group = merge_collinear(ends, 0.001)
    assert len(merged) == 4
    assert len({group[0], group[1], group[2]}) == 1
    lengths = np.sort(np.linalg.norm(merged[:, 1] - merged[:, 0], axis=1))
    np.testing.assert_allclose(lengths, [1.1, 2, 3, 3], atol=1e-6)


def test_pieces_of_a_wall_become_the_wall(rng):
    cuts = np.sort(rng.uniform(0, 10, 30))
    points = np.stack([cuts, 0.5 * cuts], axis=1)
    pieces = np.stack([points[:-1], points[1:]], axis=1)[rng.permutation(29)]
    merged, _ = merge_collinear(pieces, 1e-3)
    assert len(merged) == 1
    np.testing.assert_allclose(np.sort(merged[0], axis=0), points[[0, -1]], atol=1e-3)


# --- rows -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("n", "is_row"), [(2, False), (4, False), (8, True)])
def test_treads_are_a_row_and_panes_are_not(n, is_row):
    y = 0.28 * np.arange(n)
    ends = np.stack([np.stack([0 * y, y], 1), np.stack([0 * y + 1.2, y], 1)], axis=1)
    assert (rows_of_lines(ends, np.zeros(n, dtype=int), 1.0) == is_row).all()


# --- layers -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("A-WALL-FULL", Role.WALL), ("Wand (neu)", Role.WALL), ("OuterWalls", Role.WALL),
        ("MUR_PORTEUR", Role.WALL), ("paredes", Role.WALL), ("墙体", Role.WALL),
        ("A-WALL-TEXT", Role.NO_WALL), ("Furniture 3", Role.NO_WALL), ("Möbel", Role.NO_WALL),
        ("A-DOOR", Role.OPENING), ("Fenster", Role.OPENING), ("0", Role.UNKNOWN),
        ("wallpaper", Role.UNKNOWN),
    ],
)  # fmt: skip
def test_names_of_layers(name, role):
    assert role_of(name) == role


def furniture(layer):
    def add(document):
        document.layers.add(layer)
        for x in (2.0, 4.5):
            shelf = [(x, 1), (x + 0.4, 1), (x + 0.4, 3), (x, 3)]
            document.modelspace().add_lwpolyline(shelf, close=True, dxfattribs={"layer": layer})

    return add


def test_layers_of_furniture_are_left_out(tmp_path):
    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", WALLS, extra=furniture("Furniture")))
    assert precision(plan) > 0.999
    assert plan.source.dropped == ("8 lines on layers of no walls: Furniture (9.6 m)",)


def test_the_user_chooses_layers_with_wildcards(tmp_path):
    path = write_dxf(tmp_path / "a.dxf", WALLS, layer="W 12 new", extra=furniture("W 13"))
    assert precision(read_floorplan(path, PlanOptions(layers=("w*new",)))) > 0.999
    both = read_floorplan(path, PlanOptions(layers=("W*",)))
    assert both.source.layers == ("W 12 new", "W 13")


@pytest.mark.parametrize("hide", ["off", "freeze"])
def test_hidden_layers_are_not_read(tmp_path, hide):
    def add(document):
        furniture("Old walls")(document)
        getattr(document.layers.get("Old walls"), hide)()

    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", WALLS, extra=add))
    assert precision(plan) > 0.999
    assert plan.source.dropped == ("layers that are off or frozen: Old walls",)


def test_walls_in_blocks_turned_and_scaled(tmp_path):
    def as_block(document):
        block = document.blocks.new("house")
        for ring in rings_of(WALLS):
            block.add_lwpolyline(ring[:-1] * 500.0, close=True)
        turned = {"layer": "Walls", "rotation": 90, "xscale": 0.002, "yscale": 0.002}
        document.modelspace().add_blockref("house", (3, 4), dxfattribs=turned)

    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", shapely.MultiPolygon(), extra=as_block))
    back = np.stack([plan.ends[..., 1] - 4, 3 - plan.ends[..., 0]], axis=-1)
    lines = shapely.multilinestrings(shapely.linestrings(back))
    assert shapely.distance(shapely.points(TRUTH.ends.mean(axis=1)), lines).max() < 0.01
    assert plan.source.layers == ("Walls",)


# --- clutter without layers -------------------------------------------------------------------


def clutter():
    """Treads, a door's arc, chairs, a window's panes, a legend, text: SVG, 20 px a metre."""
    treads = "".join(f'<path d="M {130 + 5 * i},40 v 25" stroke="black"/>' for i in range(10))
    chairs = "".join(
        f'<circle cx="{130 + 12 * i}" cy="80" r="4" stroke="black" fill="none"/>' for i in range(4)
    )
    arc = '<path d="M 150,60 a 18,18 0 0 1 18,18" stroke="black" fill="none"/>'
    legend = "".join(
        f'<rect x="600" y="{400 + 20 * i}" width="20" height="8" stroke="black" fill="none"/>'
        for i in range(4)
    )
    text = '<text x="140" y="60" font-size="6">KITCHEN</text>'
    return treads + chairs + arc + legend + text


def test_clutter_is_left_out_of_line_work(tmp_path):
    plan = read_floorplan(write_svg(tmp_path / "a.svg", WALLS, extra=clutter()))
    assert recall(plan, 20.0, (5.0, -5.0)) > 0.999
    assert precision(plan, 20.0, (5.0, -5.0)) > 0.98
    assert any("in rows at equal distance" in note for note in plan.source.dropped)


@pytest.mark.parametrize("rotation_deg", [0, 70, 200])
@pytest.mark.parametrize("flip", [1, -1])
def test_an_open_door_is_no_wall(tmp_path, rotation_deg, flip):
    def door(document):
        leaf = [(0, 0), (0.9, 0), (0.9, 0.04), (0, 0.04)]
        angle = np.deg2rad(rotation_deg)
        turned = np.array(leaf) @ [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
        space = document.modelspace()
        space.add_lwpolyline(turned + 2.0, close=True, dxfattribs={"layer": "A-WALL"})
        span = (rotation_deg, rotation_deg + 90) if flip > 0 else (rotation_deg - 90, rotation_deg)
        space.add_arc((2, 2), 0.9, *span, dxfattribs={"layer": "A-WALL"})

    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", WALLS, extra=door))
    assert precision(plan) > 0.999
    assert recall(plan) > 0.999
    assert "2 lines of open doors" in plan.source.dropped


def test_panes_of_a_window_are_no_faces(tmp_path):
    def panes(document):
        for y in (0.08, 0.12, 0.16):
            document.modelspace().add_line((1, y), (3, y), dxfattribs={"layer": "W"})

    room = shapely.box(-0.24, -0.24, 5, 4).difference(shapely.box(0, 0, 4.76, 3.76))
    room = shapely.transform(room, lambda xy: xy + np.array([0.0, 0.24]))
    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", room, layer="W", extra=panes))
    assert not (np.isin(np.round(plan.ends[:, 0, 1], 3), [0.08, 0.12, 0.16])).any()
    assert len(plan) == 8


def filled_rooms(path, rooms, lines=()):
    """A PDF of 40 points a metre."""

    def at(x, y):
        return f"{x * 40 + 100:.3f} {y * 40 + 100:.3f}"

    fills = [
        f"0.9 {0.2 + 0.1 * k:.1f} 0.2 rg "
        + " ".join(
            f"{at(*p)} {'m' if i == 0 else 'l'}" for i, p in enumerate(rings_of(room)[0][:-1])
        )
        + " f"
        for k, room in enumerate(rooms)
    ]
    strokes = [f"0 0 0 RG 0.3 w {at(*a)} m {at(*b)} l S" for a, b in lines]
    return write_pdf_stream(path, "\n".join([*fills, *strokes]))


def test_rooms_filled_with_colour_leave_the_walls_between(tmp_path):
    rooms = [shapely.box(x + 0.1, y + 0.1, x + 4, y + 3) for x in (0, 4) for y in (0, 3)]
    plan = read_floorplan(filled_rooms(tmp_path / "a.pdf", rooms))
    assert len(plan) == 16
    middles = plan.ends.mean(axis=1) + 2 * plan.normals
    inside = shapely.union_all([shapely.box(*(np.array(r.bounds) * 40 + 100)) for r in rooms])
    assert shapely.contains(inside, shapely.points(middles)).all()


def test_a_filled_room_ends_at_a_front_that_no_second_line_makes_a_wall(tmp_path):
    """A glazed front between two pieces of wall, the line outside of which is drawn beside these alone."""
    rooms = [shapely.box(x + 0.1, y + 0.1, x + 8, y + 3) for x in (0, 8) for y in (0, 3)]
    outside = [((0, -0.1), (2, -0.1)), ((6, -0.1), (8, -0.1))]
    plan = read_floorplan(filled_rooms(tmp_path / "a.pdf", rooms, outside))
    front = shapely.linestrings([(0.1 * 40 + 100, 104), (8 * 40 + 100, 104)])
    near = shapely.union_all(shapely.linestrings(plan.ends)).intersection(front.buffer(0.1))
    assert near.length == pytest.approx(front.length, rel=0.01)


def test_edges_that_two_filled_rooms_share_are_open_and_said_so(tmp_path):
    rooms = [shapely.box(x + 0.1, y + 0.1, x + 4, y + 3) for x in (0, 4) for y in (0, 3)]
    rooms.append(shapely.box(8, 0.1, 10, 3))
    plan = read_floorplan(filled_rooms(tmp_path / "a.pdf", rooms))
    shared = 2.9 * 40
    words = f"{shared:.3g} units of edges where two rooms meet without a wall between them"
    assert words in plan.source.dropped


@pytest.mark.parametrize("share", [1.0, 0.3])
def test_a_line_drawn_where_two_filled_rooms_meet_is_a_wall(tmp_path, share):
    """A glazed front; of a third of the edge alone, it is a threshold or a sill."""
    rooms = [shapely.box(x + 0.1, y + 0.1, x + 4, y + 3) for x in (0, 4) for y in (0, 3)]
    rooms.append(shapely.box(8, 0.1, 10, 3))
    line = ((8, 0.1), (8, 0.1 + share * 2.9))
    plan = read_floorplan(filled_rooms(tmp_path / "a.pdf", rooms, [line]))
    front = shapely.LineString(np.array(line) * 40 + 100)
    near = shapely.union_all(shapely.linestrings(plan.ends)).intersection(front.buffer(0.1))
    is_read = share == 1.0
    assert (near.length > 0.98 * front.length) == is_read
    assert (~plan.is_oriented).sum() == int(is_read)
    assert any("single lines" in words for words in plan.source.warnings) == is_read
    assert any("without a wall between" in words for words in plan.source.dropped) != is_read


def test_walls_as_single_lines_are_read_and_said_so(tmp_path):
    def lines(document):
        for ring in ([(0, 0), (8, 0), (8, 6), (0, 6)], [(0, 0), (4, 0), (4, 6), (0, 6)]):
            document.modelspace().add_lwpolyline(ring, close=True, dxfattribs={"layer": "walls"})

    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", shapely.MultiPolygon(), extra=lines))
    assert not plan.is_oriented.any()
    assert plan.lengths.sum() == pytest.approx(34, rel=1e-3)
    assert "single lines" in plan.source.warnings[0]


@pytest.mark.parametrize(("margin_m", "is_building"), [(0.0, True), (0.5, False), (3.0, False)])
def test_an_outline_that_walls_end_at_is_wall_and_the_frame_of_a_sheet_is_none(
    margin_m, is_building, tmp_path
):
    """Planned walls as two lines in a shell drawn as one, on a layer that says nothing, as a published plan
    of a club has it."""
    planned = shapely.union_all([shapely.box(3, 0, 3.1, 5), shapely.box(6, 0, 6.1, 5)])

    def shell(document):
        low, high = -margin_m, 5 + margin_m
        ring = [(low, low), (9 - low, low), (9 - low, high), (low, high)]
        document.modelspace().add_lwpolyline(ring, close=True, dxfattribs={"layer": "Base"})

    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", planned, layer="Wand (neu)", extra=shell))
    around = plan.lengths[~plan.is_oriented].sum()
    assert around == pytest.approx(28 - 4 * 0.1 if is_building else 0.0, abs=0.1)
    assert any("single lines" in words for words in plan.source.warnings) == is_building


def test_an_outline_is_wall_as_far_as_a_bay_where_the_line_goes_on_across_its_mouth(tmp_path):
    """The shell of that club: its side is one line, that runs on where a bay leaves it."""
    planned = shapely.union_all([shapely.box(3, 0, 3.1, 4), shapely.box(6, 0, 6.1, 4)])

    def shell(document):
        space, layer = document.modelspace(), {"layer": "Base"}
        space.add_lwpolyline([(0, 0), (9, 0), (9, 5), (0, 5)], close=True, dxfattribs=layer)
        space.add_lwpolyline([(2, 5), (3.5, 6.5), (6, 6.5), (6, 5)], dxfattribs=layer)

    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", planned, layer="Wand (neu)", extra=shell))
    lines = shapely.multilinestrings(shapely.linestrings(plan.ends))
    x = np.array([0.5, 1.5, 7.0, 8.5, 3.5, 5.0])
    apart = shapely.distance(shapely.points(x, np.full(6, 5.0)), lines)
    assert (apart < 0.05).tolist() == [True] * 4 + [False] * 2


# --- units ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("scale", "unit"), [(0.001, "mm"), (0.01, "cm")])
def test_a_missing_unit_is_guessed_or_left_open_but_never_wrong(tmp_path, scale, unit):
    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", WALLS, scale, insunits=0))
    assert plan.source.unit in (unit, "unknown")
    assert plan.is_metric == (plan.source.unit == unit)
    assert "does not say its unit" in plan.source.warnings[0]


@pytest.mark.parametrize("in_file", [0.001, 0.01])
def test_walls_without_thickness_have_the_unit_of_their_dimensions(tmp_path, in_file):
    """And where none are drawn, the units in which their size is likely are named, and none is taken."""
    document = ezdxf.new(setup=True)
    document.header["$INSUNITS"] = 0
    space, wall = document.modelspace(), {"layer": "wall"}
    corners = np.array([(0, 0), (12, 0), (12, 9), (0, 9)]) / in_file
    space.add_lwpolyline(corners, close=True, dxfattribs=wall)
    for x in (4.0, 7.0):
        space.add_line((x / in_file, 0), (x / in_file, 9 / in_file), dxfattribs=wall)
    document.saveas(tmp_path / "bare.dxf")
    bare = read_floorplan(tmp_path / "bare.dxf")
    assert not bare.is_metric
    named = bare.source.warnings[0]
    assert f" {'mm' if in_file == 0.001 else 'cm'}" in named
    assert "no likely" not in named
    dims = {"layer": "dims"}
    for x, y, length in ((2, -1, 4), (5.5, -1, 3), (9.5, -1, 5), (6, -2, 12)):
        a, b = (x - length / 2) / in_file, (x + length / 2) / in_file
        space.add_line((a, y / in_file), (b, y / in_file), dxfattribs=dims)
        text = space.add_text(f"{length / in_file:g}", height=0.3 / in_file, dxfattribs=dims)
        text.set_placement(
            (x / in_file, (y + 0.2) / in_file), align=TextEntityAlignment.BOTTOM_CENTER
        )
    document.saveas(tmp_path / "told.dxf")
    plan = read_floorplan(tmp_path / "told.dxf")
    assert plan.is_metric == (in_file == 0.01)  # of 12000 units a hall of 120 m is likely too
    size_m = np.array(plan.size) * (1.0 if plan.is_metric else in_file)
    assert size_m == pytest.approx((12, 9), rel=0.01)


def test_the_users_unit_comes_first(tmp_path):
    path = write_dxf(tmp_path / "a.dxf", WALLS, 0.01, insunits=6)
    plan = read_floorplan(path, PlanOptions(unit="cm"))
    assert recall(plan) > 0.999
    assert plan.source.unit_from == "--unit"
    assert not read_floorplan(path, PlanOptions(unit="unknown")).is_metric


@pytest.mark.parametrize(
    ("text", "metres", "has_unit"),
    [("4.20", 4.2, False), ("4,20 m", 4.2, True), ("420 cm", 4.2, True), ("13'-6\"", 4.1148, True),
     ("6'", 1.8288, True), ("3 1/2\"", 0.0889, True), ("7.5 м", 7.5, True), ("12 см", 0.12, True),
     ("8.8 m roof", 8.8, True)],
)  # fmt: skip
def test_lengths_in_texts(text, metres, has_unit):
    found = length_of_text(text)
    assert found is not None
    assert found[0] == pytest.approx(metres)
    assert found[1] == has_unit


@pytest.mark.parametrize(
    "text", ["", "Room 12", "12 m2", "1:100", "-3", "0", "KITCHEN", "2 beds", "3 rooms"]
)
def test_texts_that_are_no_length(text):
    assert length_of_text(text) is None


def dimensions(values, say):
    """Dimension lines of these lengths, m, under the plan, each with what it says at its middle."""
    return "".join(
        f'<path d="M 100,{150 + 15 * i} h {20 * v}" stroke="black"/>'
        f'<text x="{100 + 10 * v}" y="{148 + 15 * i}" font-size="6" text-anchor="middle">{say(v)}</text>'
        for i, v in enumerate(values)
    )


def test_dimension_texts_that_agree_tell_the_scale(tmp_path):
    extra = dimensions((3.2, 4.15, 5.5, 7.35), lambda v: f"{v:.2f} m")
    plan = read_floorplan(write_svg(tmp_path / "a.svg", WALLS, extra=extra))
    assert plan.is_metric
    assert "dimension texts" in plan.source.unit_from
    assert recall(plan, 1.0, (5.0, -5.0)) > 0.999


def test_dimension_texts_that_disagree_tell_nothing(tmp_path):
    extra = dimensions((3.2, 4.15, 5.5, 7.35), lambda v: f"{v**1.3:.2f} m")
    assert not read_floorplan(write_svg(tmp_path / "a.svg", WALLS, extra=extra)).is_metric


def test_numbers_of_rooms_over_equal_tables_tell_no_scale(tmp_path):
    """They differ by less than lengths that agree may, and so agree with any lines of one length."""
    numbers = iter((2.01, 2.02, 2.03, 2.04))
    extra = dimensions((1.6, 1.6, 1.6, 1.6), lambda _: f"{next(numbers):.2f}")
    assert not read_floorplan(write_svg(tmp_path / "a.svg", WALLS, extra=extra)).is_metric


# --- SVG, IFC, GeoJSON, models ----------------------------------------------------------------


def test_svg_transforms_and_layers(tmp_path):
    group = 'transform="translate(30,10) rotate(30) scale(2)" inkscape:label="Walls"'
    plan = read_floorplan(write_svg(tmp_path / "a.svg", WALLS, group=group))
    assert plan.source.layers == ("Walls",)
    xy = plan.ends * (1, -1) - (30, 10)
    c, s = np.cos(np.deg2rad(-30)), np.sin(np.deg2rad(-30))
    back = xy @ np.array([[c, -s], [s, c]]).T / 2 * (1, -1) / 20 - (5, -5)
    lines = shapely.multilinestrings(shapely.linestrings(back))
    assert shapely.distance(shapely.points(TRUTH.ends.mean(axis=1)), lines).max() < 0.01


def test_clips_within_nested_groups_cut_what_is_drawn_beyond(tmp_path):
    hatch = "".join(f'<path d="M {x},0 l 400,400" stroke="blue"/>' for x in range(-400, 400, 12))
    room = '<path id="room" d="M 0,0 h 160 v 120 h -160 z"/>'
    path = tmp_path / "a.svg"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 400 300" width="800" height="600">'
        f'<defs><clipPath id="c">{room}</clipPath></defs>'
        '<g transform="translate(20,20)"><g transform="scale(2)">'
        f'<g clip-path="url(#c)"><g transform="translate(1,1)">{hatch}</g></g>'
        '<path d="M 0,0 h 160 v 120 h -160 z M -4,-4 h 168 v 128 h -168 z" fill="none" stroke="red"/>'
        "</g></g></svg>"
    )
    plan = read_floorplan(path)
    # Twice by the group, twice by the view box: the room is 640 x 480 from (40, 40).
    assert len(plan) == 8
    np.testing.assert_allclose(plan.ends.reshape(-1, 2).min(axis=0), [24, -536])
    np.testing.assert_allclose(plan.ends.reshape(-1, 2).max(axis=0), [696, -24])


def test_storeys_by_name_and_number(tmp_path):
    path = write_ifc(tmp_path / "a.ifc", WALLS, storeys=(("Ground", 0.0), ("First", 3.0)))
    assert read_floorplan(path).source.storey == "Ground"
    assert read_floorplan(path, PlanOptions(storey="first")).source.storey == "First"
    assert read_floorplan(path, PlanOptions(storey="1")).source.storey == "First"


def test_the_height_of_the_cut(tmp_path):
    path = write_ifc(tmp_path / "a.ifc", WALLS, height_m=1.0)
    assert len(read_floorplan(path, PlanOptions(cut_height_m=0.9)))
    with pytest.raises(FloorplanError, match=r"1\.2 m above the floor of 'Ground', found none"):
        read_floorplan(path)


def test_rooms_of_geojson_look_inwards_and_doors_are_gaps(tmp_path):
    rooms = shapely.MultiPolygon([shapely.box(0, 0, 4, 3), shapely.box(4, 0, 8, 3)])
    plan = read_floorplan(write_geojson(tmp_path / "a.geojson", rooms, kind="room"))
    assert len(plan) == 8
    assert plan.lengths.sum() == pytest.approx(28, rel=1e-3)
    towards = np.array([[-2.0, 0], [2.0, 0]])
    inside = plan.ends.mean(axis=1) + 0.1 * plan.normals
    assert (np.abs(inside[:, None] - towards).max(axis=2).min(axis=1) < 2).all()


def imdf(folder):
    write_geojson(folder / "unit.geojson", shapely.box(0, 0, 4, 3), kind="room")
    door = shapely.LineString([(1, 0), (2, 0)]).buffer(1e-3)
    write_geojson(folder / "opening.geojson", door, kind="pedestrian")
    return folder


def test_an_opening_of_imdf_is_a_gap(tmp_path):
    plan = read_floorplan(imdf(tmp_path))
    assert plan.source.kind == "IMDF"
    assert len(plan) == 5
    assert plan.lengths.sum() == pytest.approx(14 - 1 - 2 * 0.051, abs=0.02)


def test_levels_of_imdf_go_by_their_names_from_the_lowest_on(tmp_path):
    imdf(tmp_path)
    units = json.loads((tmp_path / "unit.geojson").read_text())
    units["features"][0]["properties"]["level_id"] = "b7"
    (tmp_path / "unit.geojson").write_text(json.dumps(units))
    named = [("a1", {"de": "1. Stock"}, 1), ("b7", {"fr": "Rez", "en": "Ground"}, 0),
             ("c3", {"en": "Ground"}, 0), ("d9", {}, -1)]  # fmt: skip
    levels = [{"type": "Feature", "id": level, "feature_type": "level", "geometry": None,
               "properties": {"name": name, "ordinal": ordinal}}
              for level, name, ordinal in named]  # fmt: skip
    (tmp_path / "level.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": levels})
    )
    source = read_floorplan(tmp_path).source
    assert source.storeys == ("d9", "Ground", "Ground (2)", "1. Stock")
    assert source.storey == "Ground"
    for asked in ("b7", "ground", "1"):
        assert read_floorplan(tmp_path, PlanOptions(storey=asked)).source.storey == "Ground"
    with pytest.raises(FloorplanError, match=r"expected walls or rooms"):
        read_floorplan(tmp_path, PlanOptions(storey="1. Stock"))
    with pytest.raises(FloorplanError, match=r"expected a storey 'attic', found d9, Ground"):
        read_floorplan(tmp_path, PlanOptions(storey="attic"))


def tube(outer, inner, height):
    """Upright walls between two rectangles (x0, y0, x1, y1), from z = 0."""

    def upright(x0, y0, x1, y1):
        box = trimesh.creation.box((x1 - x0, y1 - y0, height))
        box.apply_translation(((x0 + x1) / 2, (y0 + y1) / 2, height / 2))
        return box

    hole = upright(*inner)
    hole.invert()
    return trimesh.util.concatenate([upright(*outer), hole])


@pytest.mark.parametrize("height", [0.5, 1.0])
def test_the_section_of_a_box_with_a_hole(height):
    mesh = tube((0, 0, 4, 3), (1, 1, 2, 2), 2.0)
    ring = shapely.box(0, 0, 4, 3).difference(shapely.box(1, 1, 2, 2))
    area = section_area(np.asarray(mesh.vertices), np.asarray(mesh.faces), height)
    assert area.symmetric_difference(ring).area < 1e-6
    assert section_area(np.asarray(mesh.vertices), np.asarray(mesh.faces), 3.0).is_empty


@pytest.mark.parametrize("up", ["y", "z"])
def test_a_mesh_becomes_its_walls(tmp_path, up):
    walls = shapely.box(-0.3, -0.3, 6.3, 4.3).difference(shapely.box(0, 0, 6, 4))
    solid = tube((-0.3, -0.3, 6.3, 4.3), (0, 0, 6, 4), 2.5)
    floor = trimesh.creation.box(
        (6.6, 4.6, 0.1), trimesh.transformations.translation_matrix((3, 2, -0.05))
    )
    mesh = trimesh.util.concatenate([solid, floor])
    if up == "y":
        mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)))
    mesh.export(tmp_path / "a.ply")
    plan = read_floorplan(tmp_path / "a.ply")
    truth = faces_of_regions(walls, 1e-6, 0.5)
    assert f"up is {up}" in plan.source.warnings[0]
    assert on_faces(plan.ends, plan.normals, truth.ends, truth.normals, 0.03) > 0.97
    assert on_faces(truth.ends, truth.normals, plan.ends, plan.normals, 0.03) > 0.97


@pytest.mark.parametrize(
    ("options", "size", "unit", "told_by"),
    [
        ({}, 6.0, "m", "assumed"),
        ({"unit": "cm"}, 6.0, "cm", "--unit"),
        ({"metres_per_unit": 0.02}, 6.0, "0.02 m", "--scale"),
        ({"unit": "unknown"}, 6.0, "unknown", ""),
    ],
)
def test_the_source_of_a_mesh_says_its_unit_and_what_told_it(
    tmp_path, options, size, unit, told_by
):
    chosen = PlanOptions(**options)
    metres = {"0.02 m": 0.02, "cm": 0.01}.get(unit, 1.0)
    room = trimesh.creation.box((size / metres, 4 / metres, 2.5 / metres))
    room.export(tmp_path / "a.ply")
    plan = read_floorplan(tmp_path / "a.ply", chosen)
    assert (plan.source.unit, plan.source.unit_from) == (unit, told_by)
    assert plan.is_metric == (unit != "unknown")
    np.testing.assert_allclose(plan.size, [6, 4], atol=0.1)


def test_a_given_scale_of_geojson_is_named_as_what_told_the_unit(tmp_path):
    path = write_geojson(tmp_path / "a.geojson", shapely.box(0, 0, 6, 4))
    plan = read_floorplan(path, PlanOptions(metres_per_unit=80_000.0))
    assert (plan.source.unit, plan.source.unit_from) == ("80000 m", "--scale")


def test_a_point_cloud_becomes_walls_without_a_side(tmp_path, rng):
    room = trimesh.creation.box((6, 4, 2.5))
    points, _ = trimesh.sample.sample_surface(room, 60_000, seed=1)
    trimesh.PointCloud(points + rng.normal(0, 0.003, points.shape)).export(tmp_path / "a.ply")
    plan = read_floorplan(tmp_path / "a.ply")
    assert not plan.is_oriented.any()
    assert len(plan) == 4
    np.testing.assert_allclose(np.sort(plan.lengths), [4, 4, 6, 6], atol=0.12)
    corners = np.array([(x, y) for x in (-3, 3) for y in (-2, 2)])
    assert scipy.spatial.cKDTree(corners).query(plan.ends.reshape(-1, 2))[0].max() < 0.1

"""Plans as web pages and home automation draw them: rooms as filled boxes on a page in a pale tint."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import shapely

from planfit.floorplan import Floorplan, read_floorplan
from planfit.floorplan.formats.svg.styles import apply_styles

ROOMS = [(60, 60, 340, 280), (400, 60, 300, 280), (60, 340, 340, 200), (400, 340, 300, 200)]
"""x, y, width, height: each ends where the next begins."""


def svg(path: Path, *shapes: str, size: str = 'viewBox="0 0 800 600"') -> Path:
    text = "\n".join(shapes)
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n{text}\n</svg>')
    return path


def box(x: float, y: float, width: float, height: float, **style: str) -> str:
    words = " ".join(f'{key.replace("_", "-")}="{value}"' for key, value in style.items())
    return f'<rect x="{x}" y="{y}" width="{width}" height="{height}" {words}/>'


def drawn_share(plan: Floorplan, lines: list[tuple[float, float, float, float]]) -> float:
    """Share of the length of lines x0, y0, x1, y1 of the file that faces lie on."""
    truth = shapely.union_all([shapely.LineString([a[:2], a[2:]]) for a in lines])
    faces = shapely.union_all(shapely.linestrings(plan.ends * (1.0, -1.0)))
    return truth.intersection(faces.buffer(1.0)).length / truth.length


WALLS = [
    (60, 60, 700, 60), (700, 60, 700, 540), (700, 540, 60, 540), (60, 540, 60, 60),
    (400, 60, 400, 540), (60, 340, 700, 340),
]  # fmt: skip


@pytest.mark.parametrize("page", ["#f5f5f0", "#e0e8ff"])
@pytest.mark.parametrize("floors", [
    ["#fff"] * 4, ["#fde", "#def", "#efd", "#fed"], ["#def"] * 4, ["#def", "#def", "#fed", "#fed"],
])  # fmt: skip
def test_the_page_is_no_room_and_rooms_that_touch_have_walls_between(
    tmp_path: Path, page: str, floors: list[str]
) -> None:
    rooms = [
        box(*room, fill=floor, stroke="#222", stroke_width="4")
        for room, floor in zip(ROOMS, floors, strict=True)
    ]
    sofas = [box(x, 120, 90, 40, fill="#ccc", stroke="#999") for x in (120, 460)]
    sofas += [box(x, 120, 90, 14, fill="#bbb", stroke="#999") for x in (120, 460)]
    path = svg(tmp_path / "plan.svg", box(0, 0, 800, 600, fill=page), *rooms, *sofas)
    plan = read_floorplan(path)
    assert drawn_share(plan, WALLS) > 0.99
    assert drawn_share(plan, [(0, 0, 800, 0), (0, 600, 0, 0)]) == 0.0
    assert plan.lengths.sum() == pytest.approx(
        sum(np.hypot(c - a, d - b) for a, b, c, d in WALLS), rel=0.01
    )
    assert any("rooms touch" in words for words in plan.source.warnings)


def test_rooms_of_a_wing_apart_are_told_but_samples_of_a_legend_are_not(tmp_path: Path) -> None:
    def words(*others: str) -> list[str]:
        rooms = [box(*room, fill="#def", stroke="#222") for room in ROOMS]
        plan = read_floorplan(svg(tmp_path / "plan.svg", *rooms, *others))
        return [each for each in plan.source.warnings if "stand apart" in each]

    wing = [box(760, 60 + 250 * k, 200, 240, fill="#def", stroke="#222") for k in range(2)]
    legend = [box(760, 60 + 40 * k, 30, 30, fill="#def", stroke="#222") for k in range(9)]
    assert len(words(*wing)) == 1
    assert not words(*legend)


def test_filled_furniture_makes_no_plan_of_rooms(tmp_path: Path) -> None:
    """Walls as two lines; a kitchen's island of five fills stands in one of the rooms."""
    walls = [box(60, 60, 640, 480, fill="none", stroke="#222")]
    walls += [box(x, 72, 302, 456, fill="none", stroke="#222") for x in (72, 386)]
    row = [box(140 + 30 * k, 250, 30, 40, fill=f"#ab{k}", stroke="#888") for k in range(5)]
    plan = read_floorplan(svg(tmp_path / "plan.svg", *walls, *row))
    alone = read_floorplan(svg(tmp_path / "alone.svg", *walls))
    assert plan.lengths.sum() == pytest.approx(alone.lengths.sum(), rel=0.01)
    assert drawn_share(plan, [(140, 290, 290, 290)]) == 0.0


@pytest.mark.parametrize(("size", "metres"), [
    ('width="8000mm" height="6000mm" viewBox="0 0 8000 6000"', 6.4),
    ('width="315in" height="236.25in" viewBox="0 0 800 600"', 6.4008),
    ('width="800mm" height="600mm" viewBox="0 0 800 600"', None),
    ('width="8000" height="6000" viewBox="0 0 8000 6000"', None),
])  # fmt: skip
def test_a_page_larger_than_paper_tells_the_size_of_the_building(
    tmp_path: Path, size: str, metres: float | None
) -> None:
    scale = 10 if "0 0 8000" in size else 1
    rooms = [
        box(*(scale * v for v in room), fill=fill)
        for room, fill in zip(ROOMS, ("#fde", "#def", "#efd", "#fed"), strict=True)
    ]
    plan = read_floorplan(svg(tmp_path / "plan.svg", *rooms, size=size))
    assert plan.is_metric == (metres is not None)
    if metres is not None:
        assert plan.size[0] == pytest.approx(metres, rel=1e-3)


def line(x0: float, y0: float, x1: float, y1: float, colour: str, width: float) -> str:
    return (
        f'<line x1="{x0}" y1="{y0}" x2="{x1}" y2="{y1}" stroke="{colour}" stroke-width="{width}"/>'
    )


@pytest.mark.parametrize("is_dark", [False, True])
def test_lines_of_the_colour_of_the_page_are_gaps_in_walls(tmp_path: Path, is_dark: bool) -> None:
    ink, paper = ("#fff", "#111") if is_dark else ("#111", "#fff")
    walls = [line(*wall, ink, 6) for wall in WALLS]
    door = line(400, 420, 400, 470, paper, 8)
    page = [box(0, 0, 800, 600, fill=paper)] if is_dark else []
    plan = read_floorplan(svg(tmp_path / "plan.svg", *page, *walls, door))
    # A stroke of 6 px that stands out is a wall with two faces.
    inner = [(403, 63, 697, 63), (697, 343, 697, 537), (63, 537, 397, 537), (63, 63, 63, 337)]
    assert drawn_share(plan, inner) > 0.98
    assert drawn_share(plan, [(x, 424, x, 466) for x in (397, 403)]) == 0.0


def test_boxes_with_rounded_corners_have_straight_sides(tmp_path: Path) -> None:
    rooms = [box(x, 72, 302, 456, fill="none", stroke="#222", rx="2") for x in (72, 386)]
    outer = box(60, 60, 640, 480, fill="none", stroke="#222", rx="4")
    plan = read_floorplan(svg(tmp_path / "plan.svg", outer, *rooms))
    assert drawn_share(plan, [(70, 60, 690, 60), (700, 70, 700, 530), (72, 80, 72, 520)]) > 0.98


def test_pale_patches_over_dark_fills_cut_them_and_furniture_cuts_no_floor(tmp_path: Path) -> None:
    """Rooms laid over a dark slab, a door as a patch over the wall between; a table on one of the floors."""
    rooms = [box(x, 72, 302, 456, fill="#fbfaf7") for x in (72, 386)]
    door = box(370, 250, 20, 90, fill="#fbfaf7")
    slab = box(60, 60, 640, 480, fill="#3b464d")
    page = box(0, 0, 800, 600, fill="#fbfaf7")
    plan = read_floorplan(svg(tmp_path / "plan.svg", page, slab, *rooms, door))
    assert drawn_share(plan, [(72, 72, 374, 72), (374, 80, 374, 248), (386, 342, 386, 520)]) > 0.98
    assert drawn_share(plan, [(374, 254, 374, 336), (386, 254, 386, 336)]) == 0.0
    floors = [
        box(*room, fill=fill)
        for room, fill in zip(ROOMS, ("#fde", "#def", "#efd", "#fed"), strict=True)
    ]
    table = box(150, 150, 80, 60, fill="#f4f4f4")
    plan = read_floorplan(svg(tmp_path / "floors.svg", *floors, table))
    assert drawn_share(plan, [(150, 150, 230, 150)]) == 0.0


def _tinted(walls: str, rooms: list[str], more: str = "") -> list[str]:
    """Rooms of `ROOMS` in tints that meet in the middle of walls, drawn over them as strokes that reach the
    far side of each other at corners; a window of two thin lines and a door in the outer ones."""
    outer, inner = 'stroke-width="16"', 'stroke-width="8"'
    lines = [
        (52, 60, 708, 60, outer), (700, 52, 700, 548, outer), (52, 540, 200, 540, outer),
        (320, 540, 708, 540, outer), (60, 52, 60, 400, outer), (60, 480, 60, 548, outer),
        (400, 52, 400, 180, inner), (400, 260, 400, 548, inner), (52, 340, 708, 340, inner),
    ]  # fmt: skip
    drawn = [
        f'<line x1="{a}" y1="{b}" x2="{c}" y2="{d}" stroke="{walls}" {width}/>'
        for a, b, c, d, width in lines
    ]
    window = [
        f'<line x1="200" y1="{y}" x2="320" y2="{y}" stroke="{walls}" stroke-width="1"/>'
        for y in (537, 543)
    ]
    filled = [
        box(*room, fill=tint, fill_opacity="0.14") for room, tint in zip(ROOMS, rooms, strict=True)
    ]
    return [more, *filled, *drawn, *window]


def test_tints_of_rooms_under_walls_make_no_faces(tmp_path: Path) -> None:
    """Not in the middle of walls, nor across doors and windows; and walls end where they meet."""
    shapes = _tinted("#1b1b1b", ["#26d", "#e71", "#2a5", "#c4b"])
    plan = read_floorplan(svg(tmp_path / "plan.svg", *shapes))
    middles = [(60, 80, 60, 320), (60, 405, 60, 475), (205, 540, 315, 540), (400, 185, 400, 255),
               (80, 340, 380, 340)]  # fmt: skip
    assert drawn_share(plan, middles) == 0.0
    faces = [(52, 52, 708, 52), (708, 52, 708, 548), (68, 68, 396, 68), (404, 344, 404, 532),
             (68, 336, 396, 336)]  # fmt: skip
    assert drawn_share(plan, faces) > 0.99
    low, high = plan.ends.min(axis=(0, 1)), plan.ends.max(axis=(0, 1))
    assert [*low, *high] == pytest.approx([52, -548, 708, -52], abs=0.01)


def test_colours_by_variables_are_those_of_the_light_page(tmp_path: Path) -> None:
    style = (
        "<style>svg{--dark:#1b1b1b;--wall:var(--dark);--page:#fff /* paper */}"
        "@media (prefers-color-scheme:dark){svg{--wall:#eee;--page:#111}}"
        "svg.night{--wall:#eee;--page:#111}</style>"
        '<rect width="800" height="600" fill="var(--page)"/>'
    )
    tints = ["var(--none, #26d)", "var(--x,rgb(224,113,17))", "#2a5", "#c4b"]
    named = svg(tmp_path / "named.svg", *_tinted("var(--wall)", tints, style))
    page = '<rect width="800" height="600" fill="#fff"/>'
    shapes = _tinted("#1b1b1b", ["#26d", "#e07111", "#2a5", "#c4b"], page)
    plain = read_floorplan(svg(tmp_path / "plain.svg", *shapes))
    np.testing.assert_allclose(read_floorplan(named).ends, plain.ends, atol=1e-9)


@pytest.mark.parametrize("tints", [
    ("#cdc", "#ccd", "#dcc", "#f0f0f0"), ("#cdc", "#ccd", "#dcc", "#fff"),
])  # fmt: skip
def test_lines_called_wall_along_rooms_are_the_walls_with_their_doors(
    tmp_path: Path, tints: tuple[str, ...]
) -> None:
    """However thin they are, they say more than the tints between them, of which one is as good as white."""
    floors = [box(*room, fill=tint) for room, tint in zip(ROOMS, tints, strict=True)]
    lines = ["M60 60H700V540H60Z", "M400 60V150M400 200V420M400 470V540", "M60 340H200M250 340H700"]
    walls = [f'<path class="wall" fill="none" stroke="#222" d="{line}"/>' for line in lines]
    plan = read_floorplan(svg(tmp_path / "plan.svg", *floors, *walls))
    doors = [(400, 153, 400, 197), (400, 423, 400, 467), (203, 340, 247, 340)]
    assert drawn_share(plan, doors) == 0.0
    assert drawn_share(plan, WALLS) == pytest.approx(1 - 150 / (2240 + 480 + 640), abs=0.01)


def test_variables_that_name_each_other_grow_not(tmp_path: Path) -> None:
    rules = "".join(f"--v{k}:var(--v{k + 1}) var(--v{k + 1});" for k in range(40))
    style = f"<style>svg{{{rules}--a:var(--b);--b:var(--a)}}</style>"
    shapes = _tinted("var(--v0)", ["var(--a)", "#e71", "#2a5", "#c4b"], style)
    root = ET.fromstring(svg(tmp_path / "plan.svg", *shapes).read_bytes())
    apply_styles(root)
    assert len(ET.tostring(root)) < 20_000
    assert len(read_floorplan(tmp_path / "plan.svg").ends) > 0


def test_a_variable_that_is_never_closed_is_left_in_time() -> None:
    text = (
        b"<svg xmlns='http://www.w3.org/2000/svg'><style>svg{--a:red;fill:var(--a," + b"x" * 10**6
    )
    data = text + b"}</style><rect fill='var(--a)'/></svg>"
    root = ET.fromstring(data)
    apply_styles(root)
    assert root[1].get("fill") == "#ff0000"
    assert root.get("fill", "").startswith("var(--a,xxx")


DARK = "#1e1e2e"


@pytest.mark.parametrize("where", ["rect", "style", "rule"])
def test_a_drawing_on_dark_ground_is_read_as_its_negative(tmp_path: Path, where: str) -> None:
    """Lights of a home's page: white, and thin as air, over walls in white."""
    walls = [line(*wall, "#fff", 6) for wall in WALLS]
    ground = {
        "rect": box(0, 0, 800, 600, fill=DARK),
        "style": "",
        "rule": f"<style>svg{{background:{DARK}}}</style>",
    }[where]
    lamps = [
        box(x, y, 60, 40, fill="#fff", fill_opacity="0.05", stroke="#fff", stroke_opacity="0.4")
        for x in range(80, 680, 100) for y in (120, 200, 400)
    ]  # fmt: skip
    sofa = box(100, 480, 90, 40, fill="#2b2b3b")
    size = 'viewBox="0 0 800 600"' + (
        f' style="background-color: {DARK}"' if where == "style" else ""
    )
    plan = read_floorplan(svg(tmp_path / "plan.svg", ground, *walls, *lamps, sofa, size=size))
    inner = [(403, 63, 697, 63), (697, 343, 697, 537), (63, 537, 397, 537), (63, 63, 63, 337)]
    assert drawn_share(plan, inner) > 0.98
    assert plan.lengths.sum() < 1.15 * 2 * sum(np.hypot(c - a, d - b) for a, b, c, d in WALLS)


@pytest.mark.parametrize("size", ["0 0 800 600", "60 60 640 480"])
def test_a_dark_slab_with_rooms_on_it_is_walls_and_no_ground(tmp_path: Path, size: str) -> None:
    slab = box(60, 60, 640, 480, fill="#333")
    rooms = [box(x, 72, 302, 456, fill="#fff") for x in (72, 386)]
    plan = read_floorplan(svg(tmp_path / "plan.svg", slab, *rooms, size=f'viewBox="{size}"'))
    assert plan.thickness == pytest.approx(12.0, abs=0.01)
    assert plan.lengths.sum() == pytest.approx(2 * (640 + 480 + 302 + 456 + 302 + 456))


def outline(**style: str) -> list[str]:
    """Walls of 12 with two faces, each a box."""
    boxes = [(60, 60, 640, 480), (72, 72, 302, 456), (386, 72, 302, 456)]
    return [box(*one, **{"fill": "none", "stroke": "#222", **style}) for one in boxes]


@pytest.mark.parametrize("name", ["id", "class"])
def test_a_shape_is_furniture_by_its_id_or_class_but_a_room_is_none(
    tmp_path: Path, name: str
) -> None:
    def desks(word: str) -> list[str]:
        """Rows of desks as thick as walls."""
        return [
            box(x, y, 200, 12, fill="#333", **{name: f"{word}-{x}-{y}"})
            for x in (120, 440) for y in (200, 300, 400)
        ]  # fmt: skip

    def length(*shapes: str) -> float:
        return float(read_floorplan(svg(tmp_path / "plan.svg", *shapes)).lengths.sum())

    alone = length(*outline())
    assert length(*outline(), *desks("desk")) == pytest.approx(alone, rel=1e-3)
    assert length(*outline(**{name: "kitchen-border"})) == pytest.approx(alone, rel=1e-3)


def test_shapes_whose_style_is_in_another_file_are_outlines_and_it_is_said(tmp_path: Path) -> None:
    drawn = [f'<g class="walls">{"".join(outline())}</g>'.replace('fill="none" stroke="#222"', "")]
    rooms = [box(*room, **{"class": "area"}) for room in ROOMS]
    plan = read_floorplan(svg(tmp_path / "plan.svg", *rooms, *drawn))
    assert plan.thickness == pytest.approx(12.0, abs=0.01)
    assert any("class 'area'" in words for words in plan.source.warnings)


def test_namespaces_that_a_page_of_the_web_leaves_out_are_put_in(tmp_path: Path) -> None:
    whole = svg(tmp_path / "whole.svg", *outline())
    text = whole.read_text().replace(' xmlns="http://www.w3.org/2000/svg"', "")
    bare = tmp_path / "bare.svg"
    bare.write_text(text.replace("<rect", '<rect data:at="1" xlink:title="wall"'))
    np.testing.assert_array_equal(read_floorplan(bare).ends, read_floorplan(whole).ends)


def test_what_is_dashed_is_no_wall_however_wide(tmp_path: Path) -> None:
    walls = [line(*wall, "#111", 6) for wall in WALLS]
    plot = box(
        20, 20, 760, 560, fill="none", stroke="#111", stroke_width="6", stroke_dasharray="20 8"
    )
    with_plot, alone = (
        read_floorplan(svg(tmp_path / "plan.svg", *shapes, *walls)) for shapes in ([plot], [])
    )
    assert with_plot.lengths.sum() == pytest.approx(alone.lengths.sum(), rel=1e-3)


def test_partitions_in_a_finer_pen_that_hang_on_walls_are_walls(tmp_path: Path) -> None:
    thick = [line(*wall, "#111", 10) for wall in WALLS[:4]]
    partitions = [line(400, 60, 400, 540, "#111", 5), line(400, 340, 700, 340, "#111", 5)]
    bench = line(120, 200, 340, 200, "#111", 5)
    treads = [line(460, y, 560, y, "#111", 2) for y in range(380, 520, 12)]
    plan = read_floorplan(svg(tmp_path / "plan.svg", *thick, *partitions, bench, *treads))
    sides = [(x, 70, x, 330) for x in (397.5, 402.5)] + [(405, y, 690, y) for y in (337.5, 342.5)]
    assert drawn_share(plan, sides) > 0.98
    assert drawn_share(plan, [(120, y, 340, y) for y in (197.5, 202.5)]) == 0.0


DRAWN = "M60,60 H700 V540 H60 Z M400,60 V200 M400,260 V540 M400,340 H700"


@pytest.mark.parametrize(("before", "more"), [
    ("", 'class="text-gray-900"'), ("", 'class="wall light"'), ("", 'id="Bed_2"'), ("", 'id="My Table"'),
    ('<g class="app-window">', ""), ("", 'stroke-dasharray="5000"'),
    ("", 'pathLength="1" stroke-dasharray="1"'), ("", 'stroke-dasharray="6 0.01"'),
    ("<style>svg{background:#111}</style>" + box(20, 20, 760, 560, fill="#fff"), ""),
    (box(0, 0, 800, 600, opacity="0%"), ""), (box(0, 0, 800, 600, opacity="0.03"), ""),
    ('<g visibility="hidden">' + box(0, 0, 800, 600) + "</g>", ""),
])  # fmt: skip
def test_what_styles_and_hides_changes_no_wall(tmp_path: Path, before: str, more: str) -> None:
    """Words by which pages style and name, lines that draw themselves, what does not show."""

    def length(before: str, more: str) -> float:
        walls = f'<path d="{DRAWN}" fill="none" stroke="#000" stroke-width="12" {more}/>'
        after = "</g>" if before.startswith("<g class") else ""
        return float(read_floorplan(svg(tmp_path / "p.svg", before, walls, after)).lengths.sum())

    assert length(before, more) == pytest.approx(length("", ""), rel=1e-3)


def test_windows_in_a_pen_a_third_as_wide_as_walls_are_none(tmp_path: Path) -> None:
    walls = [line(*wall, "#111", 12) for wall in WALLS]
    thin = [line(100, 60 + d, 220, 60 + d, "#111", 4) for d in (-6, 6)] + [
        line(80, 300, 82, 280, "#111", 1)
    ]
    plans = [read_floorplan(svg(tmp_path / "p.svg", *walls, *more)) for more in ([], thin)]
    assert plans[1].lengths.sum() == pytest.approx(plans[0].lengths.sum(), rel=0.02)


def test_another_encoding_is_read_as_it_is(tmp_path: Path) -> None:
    whole = svg(tmp_path / "whole.svg", *outline())
    other = tmp_path / "other.svg"
    text = whole.read_text().replace("<rect", '<rect xmlns:a="urn:a" a:b="1"')
    other.write_bytes(('<?xml version="1.0" encoding="UTF-16"?>' + text).encode("utf-16"))
    np.testing.assert_array_equal(read_floorplan(other).ends, read_floorplan(whole).ends)


def test_names_that_would_leave_a_page_alone_are_not_believed(tmp_path: Path) -> None:
    # Matplotlib calls the group that holds all that it draws `axes_1`, beside the page in `patch_1`.
    page = '<g id="patch_1"><path d="M0 0H800V600H0Z" fill="#ffffff"/></g>'
    drawn = f'<g id="figure_1">{page}<g id="axes_1">{"".join(outline())}</g></g>'
    texts = "".join(outline()), drawn
    plain, named = (svg(tmp_path / f"{k}.svg", text) for k, text in enumerate(texts))
    found, expected = read_floorplan(named), read_floorplan(plain)
    assert len(found) == len(expected)
    assert found.lengths.sum() == pytest.approx(expected.lengths.sum())


def test_a_style_for_strokes_of_walls_makes_no_walls_of_rooms(tmp_path: Path) -> None:
    rooms = [box(*room, fill="#fefefe", stroke="#222", stroke_width="4") for room in ROOMS]
    styled = [room.replace("<rect", '<rect class="room-fill wall-stroke"') for room in rooms]
    plain, named = (
        read_floorplan(svg(tmp_path / f"{k}.svg", *each)) for k, each in enumerate((rooms, styled))
    )
    assert drawn_share(named, WALLS) > 0.99
    assert named.lengths.sum() == pytest.approx(plain.lengths.sum())


def test_flats_along_a_corridor_are_no_faces_of_thick_walls(tmp_path: Path) -> None:
    # Of a web map, drawn by one line each, a corridor and a street between lines nearer than rooms are wide.
    style = {"fill": "#fff", "stroke": "#000"}
    widths = [74, 82, 66, 74, 90, 70, 74, 78, 74, 68]
    left = 60 + np.concatenate([[0], np.cumsum(widths)])
    flats = [(x, y, w, 120) for y in (140, 284) for x, w in zip(left, widths, strict=False)]
    flats.append((60, 260, float(left[-1]) - 60, 24))
    street = '<path d="M40 96H870V124H40Q24 124 24 140V430H0V96Z" fill="#eaeaea" stroke="#000"/>'
    path = svg(
        tmp_path / "map.svg",
        street,
        *(box(*one, **style) for one in flats),
        size='viewBox="0 0 900 560"',
    )
    plan = read_floorplan(path)
    right = float(left[-1])
    walls = [(60, y, right, y) for y in (140.0, 260.0, 284.0, 404.0)]
    walls += [(x, y, x, y + 120) for x in left.tolist() for y in (140.0, 284.0)]
    assert drawn_share(plan, walls) > 0.97
    assert not plan.is_oriented.any()


@pytest.mark.parametrize("seed", range(3))
def test_strokes_that_imitate_a_hand_are_straight(seed: int, tmp_path: Path) -> None:
    # As rough.js draws for Excalidraw: each line twice, as curves that leave it by a pixel or two.
    rng, strokes = np.random.default_rng(seed), []
    for x0, y0, x1, y1 in [*WALLS, *WALLS]:
        length = np.hypot(x1 - x0, y1 - y0)
        across = np.array([y0 - y1, x1 - x0]) / length
        bends = rng.uniform(-2.0, 2.0, 2)
        a, b = (
            np.array([x0, y0]) + t * np.array([x1 - x0, y1 - y0]) + bend * across
            for t, bend in zip((0.3, 0.6), bends, strict=True)
        )
        strokes.append(
            f'<path d="M{x0} {y0} C{a[0]:.2f} {a[1]:.2f}, {b[0]:.2f} {b[1]:.2f}, {x1} {y1}" stroke="#1e1e1e" '
            'stroke-width="2" fill="none"/>'
        )
    plan = read_floorplan(svg(tmp_path / "plan.svg", *strokes))
    assert drawn_share(plan, WALLS) > 0.99


def test_arcs_of_doors_stay_arcs_whatever_their_pen(tmp_path: Path) -> None:
    door = '<path d="M386 300 A60 60 0 0 1 446 360" fill="none" stroke="#222" stroke-width="{}"/>'
    plans = [
        read_floorplan(svg(tmp_path / f"{pen}.svg", *outline(), door.format(pen)))
        for pen in (0.5, 3)
    ]
    assert plans[0].lengths.sum() == pytest.approx(plans[1].lengths.sum())

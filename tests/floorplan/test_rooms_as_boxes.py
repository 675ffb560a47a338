"""Rooms drawn as boxes that lie on a ground, over one another or apart; grids under them; and what is drawn
in the groups of walls."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from planfit.floorplan import Floorplan, read_floorplan
from planfit.floorplan.vector.areas import HIDDEN, uppermost
from planfit.floorplan.vector.drawing import DrawingBuilder, Fill

Box = tuple[float, float, float, float]
Line = tuple[float, float, float, float]


def svg(path: Path, *shapes: str) -> Floorplan:
    text = "\n".join(shapes)
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 900 700">{text}</svg>')
    return read_floorplan(path)


def box(at: Box, style: str) -> str:
    x, y, width, height = at
    return f'<rect x="{x}" y="{y}" width="{width}" height="{height}" {style}/>'


def line(at: Line, style: str) -> str:
    return '<line x1="{}" y1="{}" x2="{}" y2="{}" {}/>'.format(*at, style)


def sides(*boxes: Box) -> list[Line]:
    return [
        side
        for x, y, w, h in boxes
        for side in (
            (x, y, x + w, y), (x + w, y, x + w, y + h), (x, y + h, x + w, y + h), (x, y, x, y + h),
        )
    ]  # fmt: skip


def shares(plan: Floorplan, lines: list[Line]) -> tuple[float, float]:
    """Recall and precision of the length of lines x0, y0, x1, y1 of the file."""
    truth = shapely.union_all([shapely.LineString([a[:2], a[2:]]) for a in lines])
    found = shapely.union_all(shapely.linestrings(plan.ends * (1.0, -1.0)))
    recall = truth.intersection(found.buffer(1.5)).length / truth.length
    return recall, found.intersection(truth.buffer(1.5)).length / found.length


ROOMS: list[Box] = [
    (x, y, 200, h) for x in (150, 350, 550) for y, h in ((100, 150), (250, 200), (450, 100))
]


@pytest.mark.parametrize("floors", [["#fffdf7"], ["#fffdf7", "#f1f7ff"], ["#eef7eb", "#f1f7ff"]])
def test_a_plot_under_all_rooms_and_land_without_an_outline_are_no_rooms(
    tmp_path: Path, floors: list[str]
) -> None:
    """Also of white rooms, which are paper where no tint lies under them."""
    around = [(60, 100, 82, 450), (758, 100, 82, 450), (150, 40, 600, 50), (150, 560, 600, 60)]
    land = [box(at, 'fill="#eee8df"') for at in around]
    plot = box((150, 100, 600, 450), 'fill="#f8f6ef" stroke="#222" stroke-width="4"')
    rooms = [
        box(at, f'fill="{floors[k % len(floors)]}" stroke="#222" stroke-width="3"')
        for k, at in enumerate(ROOMS)
    ]
    plan = svg(tmp_path / "plan.svg", *land, plot, *rooms)
    recall, precision = shares(plan, sides(*ROOMS))
    assert recall > 0.97
    assert precision > 0.97


def test_a_corridor_under_the_rooms_that_are_laid_over_its_edge_does_not_open_them(
    tmp_path: Path,
) -> None:
    """Nor does white furniture that reaches over the edge of a room."""
    offices: list[Box] = [(100, 60, 220, 180), (420, 60, 220, 180), (100, 360, 220, 180)]
    tints = ["#e3f2fd", "#fff8e1", "#ffebee"]
    corridors = [(60, 240, 700, 120), (240, 40, 80, 200), (560, 40, 80, 200), (240, 360, 80, 200)]
    drawn = [box(at, 'fill="#ecf0f1" stroke="#999"') for at in corridors]
    drawn += [
        box(at, f'fill="{tint}" stroke="#1976d2" stroke-width="2"')
        for at, tint in zip(offices, tints, strict=True)
    ]
    desks = [box((x - 4, y + 60, 30, 80), 'fill="white"') for x, y, _, _ in offices]
    for k, things in enumerate([[], desks]):
        plan = svg(tmp_path / f"{k}.svg", *drawn, *things)
        assert shares(plan, sides(*offices))[0] > 0.97


@pytest.mark.parametrize("step", [25, 50])
def test_a_pale_grid_under_walls_is_no_hatch_of_a_room(tmp_path: Path, step: int) -> None:
    outer: Box = (100, 100, 700, 500)
    walls = [(300, 100, 300, 320), (550, 100, 550, 320), (100, 320, 210, 320), (270, 320, 460, 320),
             (520, 320, 800, 320), (400, 400, 400, 600)]  # fmt: skip
    grid = [(x, 100, x, 600) for x in range(100, 801, step)]
    grid += [(100, y, 800, y) for y in range(100, 601, step)]
    drawn = [line(at, 'stroke="#e7ebef"') for at in grid]
    drawn += [box(outer, 'fill="none" stroke="#111" stroke-width="3"')]
    drawn += [line(at, 'stroke="#111" stroke-width="3"') for at in walls]
    plan = svg(tmp_path / "plan.svg", *drawn)
    recall, precision = shares(plan, [*sides(outer), *walls])
    assert recall > 0.97
    assert precision > 0.97
    assert any("pale" in words for words in plan.source.dropped)
    # Where nothing is darker, pale lines are the walls.
    pale = svg(tmp_path / "pale.svg", *(each.replace("#111", "#ddd") for each in drawn[-7:]))
    assert shares(pale, [*sides(outer), *walls])[0] > 0.97


def test_blocks_of_rooms_that_stand_free_within_an_outline_are_read(tmp_path: Path) -> None:
    """Drawn as single lines, with cupboards in the hall."""
    style = 'fill="none" stroke="#111"'
    outer: Box = (60, 60, 780, 560)
    rooms = [
        (x + 90 * k, y, 90, 160) for x in (140, 560) for k in range(2) for y in (180, 340)
    ]  # fmt: skip
    cupboards: list[Box] = [(x, 580, 60, 10) for x in range(150, 700, 100)]
    plan = svg(tmp_path / "plan.svg", *(box(at, style) for at in [outer, *rooms, *cupboards]))
    recall, precision = shares(plan, sides(outer, *rooms))
    assert recall > 0.97
    assert precision > 0.97


def test_openings_in_the_group_of_their_wall_do_not_make_furniture_walls(tmp_path: Path) -> None:
    walls = [(100, 100, 300, 16), (560, 100, 240, 16), (100, 584, 700, 16), (100, 100, 16, 500),
             (784, 100, 16, 500), (440, 116, 8, 180), (440, 360, 8, 224)]  # fmt: skip
    dark = 'fill="#111"'
    groups = [f'<g class="wall">{box(at, dark)}</g>' for at in walls]
    sills = (line((400, y, 560, y), 'stroke="#777"') for y in (100, 105, 111, 116))
    groups[0] = f'<g class="wall">{box(walls[0], dark)}<g class="window">{"".join(sills)}</g></g>'
    door = '<g class="door-leaf" fill="none" stroke="#777"><path d="M440,296 h-64 A64,64 0 0 0 440,360"/></g>'
    groups[5] = f'<g class="wall">{box(walls[5], dark)}{door}</g>'
    thin = 'fill="white" stroke="black"'
    things = [box(at, thin) for at in ((140, 130, 120, 160), (560, 130, 200, 50), (600, 300, 90, 60),
                                       (140, 480, 200, 80), (150, 140, 50, 30))]  # fmt: skip
    plan = svg(tmp_path / "plan.svg", *groups, *things)
    recall, precision = shares(plan, sides(*walls))
    assert recall > 0.97
    assert precision > 0.97


@pytest.mark.parametrize(
    "corner", ['rx="0"', 'rx="2"', 'rx="20"'], ids=["square", "rounded", "round"]
)
def test_walls_are_what_is_between_rooms_that_are_boxes_apart(tmp_path: Path, corner: str) -> None:
    """Their outer sides too, beside which no other line runs; doors are lines of the page's colour."""
    rooms: list[Box] = [
        (60, 60, 240, 160), (310, 60, 100, 380), (420, 60, 300, 160), (60, 230, 240, 210),
        (420, 230, 140, 210), (570, 230, 150, 210),
    ]  # fmt: skip
    doors = [(x, y, x, y + 24) for x, y in ((300, 100), (310, 100), (410, 300), (420, 300))]
    drawn = [box(at, f'fill="none" stroke="#c5b9a8" stroke-width="1.2" {corner}') for at in rooms]
    drawn += [line(at, 'stroke="#fafaf8" stroke-width="2"') for at in doors]
    plan = svg(tmp_path / "plan.svg", *drawn)
    recall, precision = shares(plan, sides(*rooms))
    assert recall > (0.8 if "20" in corner else 0.95)
    assert precision > 0.8
    assert plan.is_oriented.all()


def test_rooms_in_the_middle_of_others_belong_to_the_building(tmp_path: Path) -> None:
    tint = 'fill="#def" stroke="#222" stroke-width="2"'
    ring: list[Box] = [(60 + 100 * k, y, 90, 80) for k in range(8) for y in (40, 560)]
    ring += [(x, 130 + 85 * k, 90, 75) for k in range(5) for x in (60, 760)]
    inner: list[Box] = [(300 + 100 * k, y, 90, 90) for k in range(3) for y in (250, 350)]
    legend: list[Box] = [(200, 300 + 12 * k, 8, 8) for k in range(4)]
    plan = svg(tmp_path / "plan.svg", *(box(at, tint) for at in [*ring, *inner, *legend]))
    recall, precision = shares(plan, sides(*ring, *inner))
    assert recall > 0.97
    assert precision > 0.97


def test_colours_for_dark_pages_and_mixed_ones_are_those_on_paper(tmp_path: Path) -> None:
    rooms = [box((x, 100, 200, 300), "") for x in (100, 320, 540)]
    fills = {
        "light-dark(#def, #121212)": "#def", "color-mix(in srgb, #def 88%, #1c1c1e)": "#def",
        "color-mix(in oklch, rgb(221 238 255), black 12%)": "#def",
    }  # fmt: skip
    for k, (fill, plain) in enumerate(fills.items()):
        style = "<style>rect {{ fill: {}; stroke: light-dark(rgb(0, 0, 0), #fff); }}</style>"
        plan = svg(tmp_path / f"{k}.svg", style.format(fill), *rooms)
        known = svg(tmp_path / f"{k} plain.svg", style.format(plain), *rooms)
        assert (plan.ends == known.ends).all()
        assert not any("not understood" in words for words in plan.source.warnings)


@pytest.mark.parametrize("fill", ["color-mix(red)", "color-mix()", "light-dark()", "light-dark(,)"])
def test_a_broken_mix_of_colours_is_one_style_that_is_not_understood(
    tmp_path: Path, fill: str
) -> None:
    rooms = [box((x, 100, 200, 300), 'fill="#def" stroke="#000"') for x in (100, 320, 540)]
    known = svg(tmp_path / "known.svg", *rooms)
    plan = svg(tmp_path / "plan.svg", *rooms, box((150, 150, 9, 9), f'fill="{fill}"'))
    assert any("not understood" in words for words in plan.source.warnings)
    apart = np.abs(plan.ends[:, None] - known.ends).max(axis=(2, 3)).min(axis=0)
    assert apart.max() < 1e-6


def test_of_a_pile_of_floors_that_stay_which_show() -> None:
    rng = np.random.default_rng(5)
    low, size = rng.uniform(0, 6, (150, 2)), rng.uniform(1, 4, (150, 2))
    fills = tuple(Fill(shapely.box(*a, *(a + b)), 0, (220, 230, 240), True)
                  for a, b in zip(low, size, strict=True))  # fmt: skip
    shown = []
    for k, fill in enumerate(fills):
        above = shapely.union_all([other.polygon for other in fills[k + 1 :]])
        if fill.polygon.difference(above).area > HIDDEN * fill.polygon.area:
            shown.append(fill)
    found = uppermost(fills)
    assert 3 < len(found) == len(shown) < 60
    assert all(fill.polygon.covers(one.polygon.buffer(-1e-9))
               for fill, one in zip(shown, found, strict=True))  # fmt: skip


@pytest.mark.parametrize("named", ['class="dim"', 'class="dim-line"', 'class="cota"', ""])
@pytest.mark.parametrize("has_rooms", [False, True])
def test_lines_beside_walls_drawn_as_single_lines_are_not_their_other_face(
    tmp_path: Path, named: str, has_rooms: bool
) -> None:
    """Dimension lines 25 units off an outline of 800 were; of rooms that touch too."""
    outline = (100.0, 100.0, 700.0, 500.0)
    rooms: list[Box] = [(100, 100, 300, 500), (400, 100, 400, 250), (400, 350, 400, 250)]
    if has_rooms:
        drawn = [box(at, 'fill="#fff4e0" stroke="#222" stroke-width="3"') for at in rooms]
    else:
        wall = 'class="wall" fill="none" stroke="#222" stroke-width="3"'
        inner = [line((400, 100, 400, 600), wall), line((400, 350, 800, 350), wall)]
        drawn = [box(outline, wall), *inner]
    beside: list[Line] = [(100, 75, 800, 75), (75, 100, 75, 600), (400, 625, 800, 625)]
    drawn += [line(at, f'{named} stroke="#c44"') for at in beside]
    recall, precision = shares(svg(tmp_path / "plan.svg", *drawn), sides(*rooms))
    assert recall > 0.98
    assert precision > 0.98


@pytest.mark.parametrize("floor", ["#ffffff", "#e8dcc4", "#dcdcdc", "#c69c6d", "#b8d4e8"])
@pytest.mark.parametrize("slab", ["#000000", "#5b4636"])
def test_rooms_of_any_colour_on_a_slab_in_the_colour_of_walls_leave_the_walls(
    tmp_path: Path, slab: str, floor: str
) -> None:
    """As home planners export them: a dark piece, its floors on it, doors over walls."""
    rooms = ((80, 80, 300, 500), (400, 80, 400, 240), (400, 340, 400, 240))
    floors = [box(room, f'fill="{floor}"') for room in rooms]
    door, sofa = (380, 150, 20, 80), (120, 400, 80, 150)
    plan = svg(
        tmp_path / "a.svg",
        box((60, 60, 760, 540), f'fill="{slab}"'),
        *floors,
        box(door, f'fill="{floor}"'),
        box(sofa, 'fill="#7a8ea0" stroke="#333"'),
    )
    walls = shapely.box(60, 60, 820, 600).difference(
        shapely.union_all([shapely.box(x, y, x + w, y + h) for x, y, w, h in (*rooms, door)])
    )
    edges = shapely.union_all(shapely.linestrings(plan.ends * [1, -1]))
    near = shapely.buffer(edges, 1.0)
    outline = shapely.boundary(walls)
    assert shapely.length(shapely.intersection(outline, near)) > 0.99 * shapely.length(outline)
    near = shapely.buffer(outline, 1.0)
    assert shapely.length(shapely.intersection(edges, near)) > 0.97 * shapely.length(edges)


GREY, WHITE, BLACK = (179, 179, 179), (255, 255, 255), (0, 0, 0)


@pytest.mark.parametrize(
    ("under", "colour", "over", "is_cut"),
    [
        ((0, 0, 40, 30), GREY, [(2, 2, 8, 6), (20, 2, 15, 7), (2, 20, 9, 9)], False),  # furniture
        ((0, 0, 80, 60), BLACK, [(2, 2, 38, 56), (42, 2, 36, 56)], True),  # rooms on a slab
        ((0, 0, 80, 2), BLACK, [(30, -1, 9, 4)], True),  # a door in a wall
        ((0, 0, 40, 30), (210, 190, 160), [(2, 2, 36, 26)], False),  # a carpet on a floor
    ],
)
def test_what_lies_on_a_dark_area_is_cut_out_of_walls_and_not_of_floors(
    under: Box, colour: tuple[int, int, int], over: list[Box], is_cut: bool
) -> None:
    """Tiles in grey 179 are as dark as walls: cut out of them, basins and tubs were walls."""

    def area(x: float, y: float, w: float, h: float) -> shapely.Polygon:
        return shapely.box(x, y, x + w, y + h)

    builder = DrawingBuilder()
    for one, paint in ((under, colour), *((each, WHITE) for each in over)):
        builder.add_fill([shapely.get_coordinates(area(*one))], "", paint, is_opaque=True)
    hidden = shapely.union_all([area(*each) for each in over])
    expected = area(*under).difference(hidden) if is_cut else area(*under)
    assert builder.build().fills[0].polygon.area == pytest.approx(expected.area)


@pytest.mark.parametrize("is_on_plot", [False, True])
def test_a_plot_that_passes_for_a_room_is_a_doubt(tmp_path: Path, is_on_plot: bool) -> None:
    """Three tinted rooms of a house of single lines are less than the plot that it stands on."""
    plot: Box = (20, 20, 560, 460)
    house: Box = (100, 100, 300, 300)
    tinted: list[Box] = [(100, 340, 60, 60), (340, 340, 60, 60), (100, 100, 50, 50)]
    drawn = [box(plot, 'fill="#e8f5e9" stroke="#2e7d32" stroke-width="3"')] if is_on_plot else []
    drawn.append(box(house, 'fill="#fff" stroke="#000" stroke-width="4"'))
    drawn += [box(at, 'fill="#e3f2fd"') for at in tinted]
    drawn += [
        line(at, 'stroke="#000" stroke-width="3"')
        for at in [(100, 250, 400, 250), (250, 100, 250, 400)]
    ]
    plan = svg(tmp_path / "plan.svg", *drawn)
    assert any("is it the plot" in words for words in plan.source.warnings) == is_on_plot

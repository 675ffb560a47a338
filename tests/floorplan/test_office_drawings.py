"""Drawings without layers as offices export them: storeys, frames, dimensions, axes, furniture, strokes."""

import itertools
from pathlib import Path

import numpy as np
import pytest
import shapely

from planfit.errors import FloorplanError
from planfit.floorplan import Floorplan, PlanOptions, read_floorplan
from planfit.floorplan.vector.double_lines import Thickness
from planfit.floorplan.vector.drawing import Lines
from planfit.floorplan.vector.furniture import are_furniture
from planfit.floorplan.vector.layer_names import Role, role_of
from planfit.floorplan.vector.sheet import lines_of_plain_axes

PX = 40.0
"""A metre."""


def house(x: float = 0.0, y: float = 0.0) -> shapely.Geometry:
    """Four rooms in 12 x 9 m, doors as gaps; in metres."""
    outside = shapely.box(0, 0, 12, 9)
    rooms = [(0.3, 0.3, 5, 4), (5.12, 0.3, 11.7, 4), (0.3, 4.12, 7, 8.7), (7.12, 4.12, 11.7, 8.7)]
    doors = [(5, 2, 5.12, 2.9), (3, 4, 3.9, 4.12), (7, 6, 7.12, 6.9), (9, 4, 9.9, 4.12),
             (1, 8.7, 2, 9)]  # fmt: skip
    free = shapely.union_all([shapely.box(*room) for room in [*rooms, *doors]])
    return shapely.affinity.translate(shapely.difference(outside, free), x, y)


def rings(area: shapely.Geometry) -> list[np.ndarray]:
    return [shapely.get_coordinates(ring) for ring in shapely.get_rings(shapely.get_parts(area))]


def path(points: object, width: float = 1.0) -> str:
    at = " L".join(f"{x * PX:.3f},{y * PX:.3f}" for x, y in np.asarray(points, dtype=float))
    return f'<path d="M{at}" fill="none" stroke="#000" stroke-width="{width}"/>'


def box(x0: float, y0: float, x1: float, y1: float) -> str:
    return path([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)])


def outlines(area: shapely.Geometry) -> list[str]:
    return [path(ring) for ring in rings(area)]


def svg(folder: Path, drawn: list[str]) -> Path:
    file = folder / "plan.svg"
    file.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="-200 -200 2600 1600">'
                    f"{''.join(drawn)}</svg>")  # fmt: skip
    return file


def read(folder: Path, drawn: list[str], options: PlanOptions | None = None) -> Floorplan:
    """The plan in metres of `house`, y down."""
    plan = read_floorplan(svg(folder, drawn), options)
    there = plan.source.file_from_plan
    assert there is not None
    ends = plan.ends @ there[:2, :2].T + there[:2, 2]
    return Floorplan.from_segments((ends - 200.0) / PX)


def shares(plan: Floorplan, walls: shapely.Geometry) -> tuple[float, float]:
    """Recall of the length of walls' outlines but for jambs, and precision of the faces, within 2 cm."""
    sides = [np.stack(pair) for ring in rings(walls) for pair in itertools.pairwise(ring)]
    long = shapely.MultiLineString([side for side in sides if np.hypot(*(side[1] - side[0])) > 0.4])
    faces = shapely.MultiLineString(list(plan.ends))
    recall = shapely.intersection(long, faces.buffer(0.02)).length / long.length
    near = shapely.boundary(walls).buffer(0.02)
    return recall, shapely.intersection(faces, near).length / faces.length


def swing(x: float, y: float, radius: float = 0.9) -> str:
    """A door from its hinge."""
    angle = np.deg2rad(np.linspace(0, 90, 20))
    arc = np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=1)
    return path(arc) + path([(x, y), (x, y + radius)])


APART = {"beside": (15.0, 0.0), "near": (13.2, 0.0), "below": (0.5, 12.0)}


@pytest.mark.parametrize("where", APART)
@pytest.mark.parametrize("style", ["outlined", "filled"])
def test_storeys_in_one_drawing_are_told_and_chosen(tmp_path: Path, where: str, style: str) -> None:
    both = [house(), house(*APART[where])]
    drawn = [line for walls in both for line in outlines(walls)]
    if style == "filled":
        drawn = [line.replace('fill="none"', 'fill="#333"') for line in drawn]
    plan = read_floorplan(svg(tmp_path, drawn))
    assert len(plan.source.storeys) == 2
    assert any("probably storeys" in words for words in plan.source.warnings)
    for storey, walls in enumerate(both):
        chosen = read(tmp_path, drawn, PlanOptions(storey=str(storey)))
        assert min(shares(chosen, walls)) > 0.99
    with pytest.raises(FloorplanError, match="expected a storey of 0"):
        read_floorplan(tmp_path / "plan.svg", PlanOptions(storey="2"))


def test_axes_through_two_storeys_join_them_not_and_are_no_walls(tmp_path: Path) -> None:
    both = [house(), house(15.0)]
    axes = []
    for y in (0.15, 4.06, 8.85):
        angle = np.linspace(0, 2 * np.pi, 25)
        axes += [path(np.stack([-2.3 + 0.3 * np.cos(angle), y + 0.3 * np.sin(angle)], axis=1))]
        axes += [path([(-2.0, y), (28.5, y)])]
    drawn = [*(line for walls in both for line in outlines(walls)), *axes]
    plan = read_floorplan(svg(tmp_path, drawn))
    assert len(plan.source.storeys) == 2
    assert any("axes with bubbles" in words for words in plan.source.dropped)
    assert min(shares(read(tmp_path, drawn), shapely.union_all(both))) > 0.98


@pytest.mark.parametrize("tails", [(2.0, 2.0), (1.2, 0.2)])
@pytest.mark.parametrize("at", ["middles of walls", "faces of walls"])
def test_axes_without_bubbles_are_no_walls(
    tmp_path: Path, tails: tuple[float, float], at: str
) -> None:
    """Through the middle of walls they are a face of either half, on their faces they are those on and on."""
    walls = house()
    off = 0.0 if at == "faces of walls" else 0.06
    axes = [path([(x, -tails[0]), (x, 9 + tails[1])]) for x in (0.15, 5 + off, 7 + off, 11.85)]
    axes += [path([(-tails[1], y), (12 + tails[0], y)]) for y in (0.15, 4 + off, 8.85)]
    drawn = [*outlines(walls), *axes]
    assert min(shares(read(tmp_path, drawn), walls)) > 0.98
    plan = read_floorplan(tmp_path / "plan.svg")
    assert any("axes without bubbles" in words for words in plan.source.dropped)


def test_lines_that_cross_at_corners_are_no_axes(tmp_path: Path) -> None:
    """As draughtsmen let them, by 0.15 m; walls without doors."""
    rooms = [(0.3, 0.3, 5, 8.7), (5.12, 0.3, 11.7, 8.7)]
    over = 0.15
    drawn = []
    for x0, y0, x1, y1 in [(0, 0, 12, 9), *rooms]:
        drawn += [path([(x, y0 - over), (x, y1 + over)]) for x in (x0, x1)]
        drawn += [path([(x0 - over, y), (x1 + over, y)]) for y in (y0, y1)]
    walls = shapely.box(0, 0, 12, 9) - shapely.union_all([shapely.box(*room) for room in rooms])
    assert shares(read(tmp_path, drawn), walls)[0] > 0.97


def test_drawings_without_a_long_line_of_unknown_layer_have_no_axes() -> None:
    none = np.zeros(0, dtype=int)
    lines = Lines(np.zeros((0, 2, 2)), none, none, none, *3 * [none.astype(bool)])
    assert len(lines_of_plain_axes(lines, 1.0)) == 0


def test_dashed_beams_overhead_are_no_walls(tmp_path: Path) -> None:
    """Two lines as far apart as faces, between walls that they end at; walls drawn in dashes are walls."""
    walls = house()
    beams = [path([(0.3, y), (5.0, y)]) for y in (2.0, 2.2)]
    beams += [path([(x, 4.12), (x, 8.7)]) for x in (9.0, 9.25)]
    assert shares(read(tmp_path, [*outlines(walls), *beams]), walls)[1] < 0.9
    dashed = [beam.replace("/>", ' stroke-dasharray="8 4"/>') for beam in beams]
    assert min(shares(read(tmp_path, [*outlines(walls), *dashed]), walls)) > 0.99
    plan = read_floorplan(tmp_path / "plan.svg")
    assert any("dashed lines" in words for words in plan.source.dropped)
    old = [line.replace("/>", ' stroke-dasharray="2 1"/>') for line in outlines(walls)]
    assert min(shares(read(tmp_path, old), walls)) > 0.99


def test_a_building_in_parts_is_one_plan(tmp_path: Path) -> None:
    """A row of piers beside a core, and two wings that a glazed passage joins."""
    piers = [shapely.box(15, y, 15.4, y + 0.4) for y in np.arange(0, 9, 1.7)]
    panes = [path([(12.0, y), (15.0, y)]) for y in (4.0, 4.1)]
    for parts, more in (([house(), *piers], []), ([house(), house(15.0)], panes)):
        drawn = [line for part in parts for line in outlines(part)]
        assert read_floorplan(svg(tmp_path, [*drawn, *more])).source.storeys == ()


FRAME = [box(-4, -4, 18, 15), box(-3.7, -3.7, 17.7, 14.7)]
TITLE = [path([(11, y), (17.7, y)]) for y in (12.5, 13.1, 13.5)] + [path([(11, 12.5), (11, 14.7)])]


def test_the_frame_of_a_sheet_is_no_wall(tmp_path: Path) -> None:
    walls = house()
    drawn = [*FRAME, *TITLE, *outlines(walls)]
    assert min(shares(read(tmp_path, drawn), walls)) > 0.99
    plan = read_floorplan(tmp_path / "plan.svg")
    assert any("frame of the sheet" in words for words in plan.source.dropped)


def test_outer_walls_are_no_frame(tmp_path: Path) -> None:
    """Of one room with tables and the swings of doors, and of rooms whose doors are not drawn open."""
    tables = [box(x, y, x + 1.2, y + 0.8) for x in (2, 5, 8) for y in (2, 4, 6)]
    hall = shapely.difference(shapely.box(0, 0, 12, 9), shapely.box(0.3, 0.3, 11.7, 8.7))
    plan = read(tmp_path, [*outlines(hall), *tables, swing(4, 0.3), swing(6, 0.3)])
    assert shares(plan, hall)[0] > 0.9
    rooms = shapely.union_all([shapely.box(0.3, 0.3, 6, 8.7), shapely.box(6.12, 0.3, 11.7, 8.7)])
    closed = shapely.difference(shapely.box(0, 0, 12, 9), rooms)
    plan = read(tmp_path, [*outlines(closed), swing(2, 0.3), swing(8, 0.3)])
    assert shares(plan, closed)[0] > 0.85


def test_chains_of_dimensions_are_no_walls(tmp_path: Path) -> None:
    walls, chains = house(), []
    for y in (-1.0, -1.35):
        chains.append(path([(0, y), (12, y)]))
        for x in (0, 0.3, 5, 5.12, 11.7, 12):
            chains += [path([(x - 0.1, y + 0.1), (x + 0.1, y - 0.1)])]
            chains += [path([(x, y + 0.2), (x, y - 0.12)])]
    drawn = [*outlines(walls), *chains]
    assert min(shares(read(tmp_path, drawn), walls)) > 0.99


def test_dimensions_within_a_room_leave_its_walls(tmp_path: Path) -> None:
    walls = house()
    chain = [path([(0.3, 1.0), (5.0, 1.0)])]
    chain += [path([(x - 0.1, 1.1), (x + 0.1, 0.9)]) for x in (0.3, 5.0)]
    assert shares(read(tmp_path, [*outlines(walls), *chain]), walls)[0] > 0.99


def test_hatching_is_no_chain_of_dimensions(tmp_path: Path) -> None:
    """Short lines of an outline that long slanted ones end at are ticks of nothing."""
    walls = house()
    hatches = [path([(5.12 + s, 0.3), (5.12 + s + 3.7, 4.0)]) for s in (0.0, 0.35, 1.4, 1.8)]
    assert shares(read(tmp_path, [*outlines(walls), *hatches]), walls)[0] > 0.99


def test_beds_and_worktops_beside_walls_are_no_walls(tmp_path: Path) -> None:
    walls = house()
    furniture = [box(0.6, 0.5, 2.6, 2.1), box(11.0, 0.5, 11.6, 3.2), box(5.3, 4.3, 6.8, 6.3),
                 box(7.3, 7.2, 9.0, 8.5)]  # fmt: skip
    assert min(shares(read(tmp_path, [*outlines(walls), *furniture]), walls)) > 0.99


def test_outlines_that_cross_are_looked_at() -> None:
    """A worktop through a slanted wall: of lines that are not cut where they cross, it is a hole that pokes
    out of its area."""
    room = [(0, 7.2), (1.8, 9), (6, 9), (6, 4.8), (0, 4.8), (0, 7.2)]
    worktop = [(0.1, 5), (0.7, 5), (0.7, 8.4), (0.1, 8.4), (0.1, 5)]
    ends = np.array(
        [side for ring in (room, worktop) for side in itertools.pairwise(ring)], dtype=float
    )
    assert are_furniture(ends, Thickness(0.1, 0.03, 0.6), 100.0).all()


def test_rooms_drawn_as_outlines_are_no_furniture(tmp_path: Path) -> None:
    rooms = [(0.3, 0.3, 5, 4), (5.12, 0.3, 11.7, 4), (0.3, 4.12, 2, 8.7), (2.12, 4.12, 11.7, 8.7)]
    free = shapely.union_all([shapely.box(*room) for room in rooms])
    walls = shapely.difference(shapely.box(0, 0, 12, 9), free)
    drawn = [box(*room) for room in rooms] + [box(0, 0, 12, 9)]
    assert min(shares(read(tmp_path, drawn), walls)) > 0.98


CENTRES = [[(0, 0), (12, 0), (12, 9), (0, 9), (0, 0)], [(5, 0), (5, 2)], [(5, 3), (5, 4)],
           [(0, 4), (3, 4)], [(4, 4), (12, 4)], [(7, 4), (7, 9)]]  # fmt: skip
LOOSE = [box(0.6, 0.5, 2.6, 2.1), box(5.3, 4.3, 6.8, 6.3), box(11.2, 5, 11.8, 8)]


def test_strokes_as_wide_as_walls_are_walls(tmp_path: Path) -> None:
    thick = [shapely.LineString(line).buffer(0.1, cap_style="flat", join_style="mitre")
             for line in CENTRES]  # fmt: skip
    walls = shapely.union_all([*thick, shapely.box(-0.1, -0.1, 0.1, 0.1)])
    drawn = [path(line, 0.2 * PX) for line in CENTRES] + LOOSE
    plan = read(tmp_path, drawn)
    assert min(shares(plan, walls)) > 0.97
    thickness = read_floorplan(tmp_path / "plan.svg").thickness
    assert thickness is not None
    np.testing.assert_allclose(np.nanmedian(thickness), 0.2 * PX, rtol=0.02)


def test_faces_drawn_in_a_broad_pen_are_no_walls_by_themselves(tmp_path: Path) -> None:
    walls = house()
    drawn = [path(ring, 0.1 * PX) for ring in rings(walls)] + LOOSE[:1]
    assert min(shares(read(tmp_path, drawn), walls)) > 0.98


def test_rooms_of_single_lines_with_furniture_along_them(tmp_path: Path) -> None:
    """Furniture and the lines that it stands at are as near as the two faces of a wall."""
    drawn = [path(line) for line in CENTRES]
    # Radiators and rails: no closed outlines.
    rails = [(0.15, 0.3, 3.7), (0.15, 4.5, 8.5), (7.3, 5.0, 8.7), (11.8, 0.3, 3.7)]
    against = [path([(x, y0), (x, y1)]) for x, y0, y1 in rails]
    plan = read(tmp_path, [*drawn, *LOOSE, *against])
    truth = shapely.union_all([shapely.LineString(line) for line in CENTRES])
    faces = shapely.MultiLineString(list(plan.ends))
    assert shapely.intersection(truth, faces.buffer(0.02)).length > 0.95 * truth.length


def section() -> list[str]:
    """Slabs, walls and a roof of a house, upright."""
    slabs = [shapely.box(0, y, 12, y + 0.3) for y in (0, 3, 6)]
    walls = [shapely.box(x, 0, x + 0.3, 6.3) for x in (0, 5, 11.7)]
    roof = path([(-0.5, -0.3), (6, -4), (12.5, -0.3)])
    return [*outlines(shapely.union_all([*slabs, *walls])), roof, path([(-5, 6.3), (18, 6.3)])]


def sketch() -> list[str]:
    """Walls by a shaking pen."""
    rng = np.random.default_rng(0)
    lines = [line for chain in CENTRES for line in itertools.pairwise(chain)]
    return [
        path(np.linspace(a, b, 30) + np.cumsum(rng.normal(size=(30, 2)), axis=0) * 0.015)
        for a, b in lines
    ]


@pytest.mark.parametrize(("drawn", "words"), [
    (section(), "is it a section"), (sketch(), "a sketch by hand"), (outlines(house()), ""),
    (outlines(house() | shapely.box(1, 8.7, 2, 9)), ""),
])  # fmt: skip
def test_drawings_of_other_things_are_said_to_be_doubtful(
    tmp_path: Path, drawn: list[str], words: str
) -> None:
    """Not a house whose rooms are joined by doors, though its entrance is closed."""
    warnings = read_floorplan(svg(tmp_path, drawn)).source.warnings
    if words:
        assert any(words in warning for warning in warnings)
    else:
        assert warnings == ()


def test_furniture_in_german() -> None:
    assert role_of("070 Möblierung") == role_of("MOEBLIERUNG") == Role.NO_WALL

"""One small house as others draw it: on grounds in a tint, in white on dark, with a round front, with doors
ajar, by single lines with furniture; every reading is held beside its walls."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely.geometry.base import BaseGeometry

from planfit.floorplan import Floorplan, read_floorplan

OUTSIDE, INSIDE = shapely.box(200, 200, 1000, 700), shapely.box(216, 216, 984, 684)
PARTITIONS = [shapely.box(600, 216, 608, 684), shapely.box(216, 440, 600, 448)]
DOORWAYS = [
    shapely.box(590, 300, 620, 355),
    shapely.box(380, 430, 435, 460),
    shapely.box(700, 190, 760, 220),
]
SOLID = shapely.union_all([OUTSIDE.difference(INSIDE), *PARTITIONS]).difference(
    shapely.union_all(DOORWAYS)
)
ROOMS = shapely.get_parts(INSIDE.difference(shapely.union_all(PARTITIONS)))
NEAR = 3.0


def path_of(area: BaseGeometry, style: str) -> str:
    rings = [
        shapely.get_coordinates(ring)
        for part in shapely.get_parts(area)
        for ring in shapely.get_rings(part)
    ]
    data = " ".join("M" + " L".join(f"{x:.2f},{y:.2f}" for x, y in ring) + " Z" for ring in rings)
    return f'<path d="{data}" fill-rule="evenodd" {style}/>'


def polyline(points: np.ndarray, style: str = 'fill="none" stroke="#000"') -> str:
    return f'<polyline points="{" ".join(f"{x:.2f},{y:.2f}" for x, y in points)}" {style}/>'


def read(path: Path, *shapes: str) -> Floorplan:
    text = "\n".join(shapes)
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1200 900">\n{text}\n</svg>'
    )
    return read_floorplan(path)


def shares(plan: Floorplan, truth: BaseGeometry, either: BaseGeometry) -> tuple[float, float]:
    """Recall and precision of the length of faces, px of the file, but for places that count neither way."""
    found = shapely.difference(shapely.multilinestrings(plan.ends * (1.0, -1.0)), either)
    truth = shapely.difference(truth, either)
    return (
        truth.intersection(found.buffer(NEAR)).length / truth.length,
        found.intersection(truth.buffer(NEAR)).length / found.length,
    )


def at_doors() -> BaseGeometry:
    return shapely.union_all([door.buffer(6) for door in DOORWAYS])


def test_grounds_and_slabs_under_walls_are_no_rooms(tmp_path: Path) -> None:
    """A lawn, and a slab a little larger than the house."""
    lawn = path_of(shapely.box(50, 50, 1150, 850), 'fill="#d6e6cd"')
    slab = path_of(OUTSIDE.buffer(8, join_style="mitre"), 'fill="#faf0d7"')
    shown = path_of(SOLID, 'fill="#555"')
    cases = [
        path_of(shapely.box(300 + 90 * k, 560, 330 + 90 * k, 580), 'fill="none" stroke="#777"')
        for k in range(3)
    ]
    plan = read(tmp_path / "a.svg", lawn, slab, shown, *cases)
    assert min(shares(plan, SOLID.boundary, at_doors())) > 0.98


def test_tints_that_end_at_the_faces_of_solid_walls_close_no_doors(tmp_path: Path) -> None:
    tints = [
        path_of(room, f'fill="#{c}"') for room, c in zip(ROOMS, ("fde", "def", "efd"), strict=True)
    ]
    page = path_of(shapely.box(50, 50, 1150, 850), 'fill="#f5f5f0"')
    plan = read(tmp_path / "a.svg", page, *tints, path_of(SOLID, 'fill="#2c3e50"'))
    assert min(shares(plan, SOLID.boundary, shapely.Polygon())) > 0.98
    faces = shapely.multilinestrings(plan.ends * (1.0, -1.0))
    inner = [shapely.intersection(door, room) for door in DOORWAYS[:2] for room in ROOMS]
    through = shapely.union_all([area.buffer(1).buffer(-8) for area in inner])
    assert faces.intersection(through).length == 0.0
    assert not any("close in" in words for words in plan.source.warnings)


def test_white_walls_on_a_dark_page_are_walls_and_the_page_is_none(tmp_path: Path) -> None:
    page = path_of(shapely.box(100, 100, 1100, 800), 'fill="#788ca0"')
    arc = (
        608 + 55 * np.sin(np.linspace(0, np.pi / 2, 12)),
        300 + 55 * np.cos(np.linspace(0, np.pi / 2, 12)),
    )
    plan = read(
        tmp_path / "a.svg", page, path_of(SOLID, 'fill="#fff"'), polyline(np.stack(arc, axis=1))
    )
    assert min(shares(plan, SOLID.boundary, at_doors())) > 0.98
    # The free side is outside of the white.
    middles = plan.ends.mean(axis=1) + 2.0 * plan.normals
    is_in_wall = shapely.contains(SOLID, shapely.points(middles * (1.0, -1.0)))
    assert plan.is_oriented.all()
    assert not is_in_wall.any()


@pytest.mark.parametrize("radius", [140.0, 220.0])
def test_round_walls_of_two_arcs_are_faces(tmp_path: Path, radius: float) -> None:
    bay = shapely.Point(1000, 450).buffer(radius, 24)
    outside = OUTSIDE.union(bay)
    rooms = outside.buffer(-16, join_style="mitre")
    walls = shapely.union_all([outside.difference(rooms), *PARTITIONS]).difference(
        shapely.union_all(DOORWAYS)
    )
    table = [shapely.Point(450, 600).buffer(r, 16) for r in (30, 27)]
    drawn = [path_of(area, 'fill="none" stroke="#000"') for area in (walls, *table)]
    plan = read(tmp_path / "a.svg", *drawn)
    recall, precision = shares(plan, walls.boundary, at_doors())
    assert min(recall, precision) > 0.95
    is_round = shapely.within(
        shapely.linestrings(plan.ends * (1.0, -1.0)), shapely.box(1004, 0, 1200, 900)
    )
    towards = (plan.ends.mean(axis=1) * (1.0, -1.0))[is_round] - (1000, 450)
    # Of the outer arc away from the centre, of the inner one towards it.
    outwards = np.einsum("ni,ni->n", towards, plan.normals[is_round] * (1.0, -1.0)) > 0
    np.testing.assert_array_equal(outwards, np.linalg.norm(towards, axis=1) > radius - 8)
    np.testing.assert_allclose(plan.thickness[is_round], 16, atol=1.5)


@pytest.mark.parametrize("angle_deg", [25, 40, 60])
def test_a_wall_that_begins_at_a_door_ajar_stays(tmp_path: Path, angle_deg: float) -> None:
    """From its far end all of the door's short arc is about as far away as from a hinge."""
    t = np.deg2rad(np.linspace(0, angle_deg, 6))
    leaves = []
    for hinge, along, across in (((608, 300), (0, 1), (1, 0)), ((380, 448), (1, 0), (0, 1))):
        arc = np.array(hinge) + 55 * (np.outer(np.cos(t), along) + np.outer(np.sin(t), across))
        leaves += [polyline(arc), polyline(np.array([hinge, arc[-1]]))]
    plan = read(tmp_path / "a.svg", path_of(SOLID, 'fill="none" stroke="#000"'), *leaves)
    assert min(shares(plan, SOLID.boundary, at_doors())) > 0.98


def test_furniture_between_single_lines_is_no_wall(tmp_path: Path) -> None:
    """Beds of two outlines each, in rooms of single lines; one piece of wall stands alone."""
    lines = [
        ((200, 200), (1000, 200), (1000, 700), (200, 700), (200, 200)), ((600, 200), (600, 420)),
        ((600, 480), (600, 560)), ((600, 620), (600, 700)), ((200, 440), (300, 440)),
        ((360, 440), (600, 440)),
    ]  # fmt: skip
    walls = [polyline(np.array(line, dtype=float)) for line in lines]
    beds = [
        shapely.box(x, y, x + 90, y + 50)
        for x, y in ((230, 230), (450, 520), (640, 230), (800, 560), (640, 600))
    ]
    furniture = [
        path_of(b.buffer(-k, join_style="mitre"), 'fill="none" stroke="#000"')
        for b in beds
        for k in (0, 6)
    ]
    plan = read(tmp_path / "a.svg", *walls, *furniture)
    truth = shapely.union_all([shapely.LineString(line) for line in lines])
    assert min(shares(plan, truth, shapely.Polygon())) > 0.98

"""Doors drawn in walls whose lines run through them, and arcs that a file holds as rough polylines."""

from pathlib import Path

import ezdxf
import numpy as np
import pytest
import shapely

from plan_files import VILLA_DOORS, door_lines, make_villa, write_dxf
from planfit.floorplan import PlanOptions, read_floorplan
from planfit.floorplan.elements import opening_element
from planfit.floorplan.gaps import find_gaps
from planfit.floorplan.vector.arcs import fit_circle

OUTER = shapely.box(0, 0, 10, 8).difference(shapely.box(0.3, 0.3, 9.7, 7.7))
WALL = shapely.box(5, 0.3, 5.12, 7.7)


def closed_rooms(path: Path, rounded: float, leaf: bool = True, corner: bool = False) -> Path:
    """Two rooms whose outlines run through a door of 0.9 m in the wall between them, m."""

    def add(document: ezdxf.document.Drawing) -> None:
        space = document.modelspace()
        low = 0.3 if corner else 3.0
        t = np.linspace(0, np.pi / 2, 12)
        hinge = np.array([5.12, low])
        arc = hinge + 0.9 * np.stack([np.sin(t), np.cos(t)], axis=1)
        arc = np.round(arc / rounded) * rounded if rounded else arc
        space.add_lwpolyline(arc, dxfattribs={"layer": "PLAN"})
        if leaf:
            space.add_line(hinge, hinge + np.array([0.9, 0.0]), dxfattribs={"layer": "PLAN"})

    return write_dxf(path, shapely.union(OUTER, WALL), layer="PLAN", extra=add)


@pytest.mark.parametrize("rounded", [0.0, 0.01])
@pytest.mark.parametrize("corner", [False, True])
def test_a_door_is_open_though_lines_run_through_it(tmp_path: Path, rounded, corner) -> None:
    plan = read_floorplan(closed_rooms(tmp_path / "a.dxf", rounded, corner=corner))
    low = 0.3 if corner else 3.0
    gap = shapely.box(4.9, low + 0.1, 5.2, low + 0.8)
    assert not shapely.intersects(gap, shapely.multilinestrings(shapely.linestrings(plan.ends)))
    openings = plan.openings[np.argsort(plan.openings[:, 0, 0])]
    np.testing.assert_allclose(openings[:, :, 0], [[5.0, 5.0], [5.12, 5.12]], atol=1e-6)
    np.testing.assert_allclose(np.abs(np.diff(openings[..., 1])), 0.9, atol=0.1)
    assert plan.source.opening_kinds == ("1 door",)
    (door,) = find_gaps(plan, (0.5, 3.0))
    assert opening_element(plan, door) == ("door", "")
    assert any("ran through 1 door drawn" in words for words in plan.source.dropped)
    whole = shapely.union(OUTER, WALL).length
    assert plan.lengths.sum() == pytest.approx(whole - 1.8, abs=0.2)


@pytest.mark.parametrize("is_wide", [False, True])
def test_a_half_circle_opens_its_leaf_or_both(tmp_path: Path, is_wide: bool) -> None:
    # A leaf that swings both ways: centre at the hinge. Two leaves as one arc: from jamb to jamb.
    def add(document: ezdxf.document.Drawing) -> None:
        start, end = (270, 90) if is_wide else (0, 180)
        arc = {"center": (5.12, 3.0), "radius": 0.9, "start_angle": start, "end_angle": end}
        document.modelspace().add_arc(**arc, dxfattribs={"layer": "PLAN"})

    walls = shapely.union(OUTER, WALL)
    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", walls, layer="PLAN", extra=add))
    low, high = (2.1, 3.9) if is_wide else (3.0, 3.9)
    faces = shapely.union_all(shapely.linestrings(plan.ends))
    middle = shapely.points([(x, (low + high) / 2) for x in (5.0, 5.12)])
    beside = shapely.points([(x, y) for x in (5.0, 5.12) for y in (low - 0.1, high + 0.1)])
    assert (shapely.distance(middle, faces) > 0.35).all()
    assert (shapely.distance(beside, faces) < 0.01).all()


def test_an_arc_in_a_room_opens_nothing(tmp_path: Path) -> None:
    def add(document: ezdxf.document.Drawing) -> None:
        document.modelspace().add_arc((2.5, 4), 0.9, 0, 90, dxfattribs={"layer": "PLAN"})

    walls = shapely.union(OUTER, WALL)
    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", walls, layer="PLAN", extra=add))
    assert plan.openings is None


def test_doors_that_are_gaps_already_stay_as_they_are(tmp_path: Path) -> None:
    leaves, arcs = door_lines("line")

    def add(document: ezdxf.document.Drawing) -> None:
        space = document.modelspace()
        for leaf in leaves:
            space.add_line(*leaf, dxfattribs={"layer": "PLAN"})
        for centre, radius, start, end in arcs:
            space.add_arc(centre, radius, start, end, dxfattribs={"layer": "PLAN"})

    villa = make_villa()
    bare = read_floorplan(write_dxf(tmp_path / "a.dxf", villa, layer="PLAN"))
    doors = read_floorplan(write_dxf(tmp_path / "b.dxf", villa, layer="PLAN", extra=add))
    assert len(arcs) == len(VILLA_DOORS)
    assert doors.lengths.sum() == pytest.approx(bare.lengths.sum(), abs=0.3)


def test_a_circle_through_points() -> None:
    t = np.linspace(0.3, 1.9, 9)
    points = np.array([3.0, -2.0]) + 5.0 * np.stack([np.cos(t), np.sin(t)], axis=1)
    circle = fit_circle(points)
    assert circle is not None
    np.testing.assert_allclose([*circle.centre, circle.radius], [3, -2, 5], atol=1e-9)
    assert fit_circle(np.array([[0, 0], [1, 0], [2, 0], [3, 0.0]])) is None
    assert fit_circle(np.array([[0, 0], [4, 0], [4, 1], [0, 3.0]])) is None


PATCH = '<rect x="180" y="190" width="40" height="20" style="{style}"/>'
"""Over the wall between two rooms, as a published map of a museum draws its doors."""


@pytest.mark.parametrize(
    ("style", "is_last", "is_open"),
    [
        ("fill:#dddddd;stroke:none", True, True),
        ("fill:#dddddd;stroke:none", False, False),  # the wall is drawn over it
        ("fill:#dddddd;stroke:none;fill-opacity:0.4", True, False),
        ("fill:#dddddd;stroke:none;opacity:0.4", True, False),
        ("fill:#333333;stroke:none", True, False),  # wall
        ("fill:none;stroke:none", True, False),
        ("fill:#dddddd;stroke:#000000", True, False),  # furniture
    ],
)
def test_a_patch_over_a_wall_is_a_door(
    style: str, is_last: bool, is_open: bool, tmp_path: Path
) -> None:
    rooms = "".join(
        f'<rect x="{x}" y="{y}" width="300" height="100" style="fill:none;stroke:#000000"/>'
        for x, y in ((50, 100), (50, 200), (350, 100), (350, 200))
    )
    # Also a stroke that the patch hides as a whole.
    rooms += '<line x1="190" y1="198" x2="210" y2="198" style="stroke:#000000"/>'
    patch = PATCH.format(style=style)
    shapes = rooms + patch if is_last else patch + rooms
    path = tmp_path / "a.svg"
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg">{shapes}</svg>')
    plan = read_floorplan(path)
    wall = shapely.union_all(shapely.linestrings(plan.ends))
    door = shapely.LineString([(183, -200), (217, -200)])
    covered = shapely.intersection(wall.buffer(0.5), door).length
    assert covered == pytest.approx(0.0 if is_open else door.length, abs=1.0)
    beside = shapely.LineString([(60, -200), (178, -200)])
    assert shapely.intersection(wall.buffer(0.5), beside).length == pytest.approx(
        beside.length, abs=1
    )


@pytest.mark.parametrize("at_swings", [True, False])
def test_jambs_are_doors_where_doors_with_swings_have_them(tmp_path: Path, at_swings: bool) -> None:
    """A corridor with nine doors drawn as swings and two as jambs alone, all with lines through; without
    jambs at the swings, lines across a wall may be anything. A box as long as a window is none."""
    swings, bare = np.arange(2.0, 29.0, 3.0), np.array([30.0, 33.0])
    box = np.array([36.0, 38.0])
    y = 4.0

    def add(document: ezdxf.document.Drawing) -> None:
        space = document.modelspace()
        for x in swings:
            space.add_arc((x, y + 0.12), 0.9, 0, 90, dxfattribs={"layer": "PLAN"})
            space.add_line((x, y + 0.12), (x, y + 1.02), dxfattribs={"layer": "PLAN"})
        doors = [*swings, *bare] if at_swings else bare
        jambs = [*np.concatenate([np.add(doors, step) for step in (-0.03, 0.0, 0.9, 0.93)]), *box]
        for x in jambs:
            space.add_line((x, y), (x, y + 0.12), dxfattribs={"layer": "PLAN"})

    outer = shapely.box(0, 0, 42, 9).difference(shapely.box(0.3, 0.3, 41.7, 8.7))
    walls = shapely.union(outer, shapely.box(0.3, y, 41.7, y + 0.12))
    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", walls, layer="PLAN", extra=add))
    faces = shapely.union_all(shapely.linestrings(plan.ends))

    def are_open(doors: np.ndarray) -> bool:
        middles = [(x + 0.45, y + side) for x in doors for side in (0.0, 0.12)]
        return bool((shapely.distance(shapely.points(middles), faces) > 0.3).all())

    assert are_open(swings)
    assert are_open(bare) == at_swings
    assert shapely.distance(shapely.Point(box.mean(), y), faces) < 0.01
    expected = ("9 doors", "2 openings") if at_swings else ("9 doors",)
    assert plan.source.opening_kinds == expected
    if at_swings:
        assert any("2 openings between jambs" in words for words in plan.source.dropped)


@pytest.mark.parametrize("depth_m", [0.85, 1.2])
@pytest.mark.parametrize("layers", [(), ("Wall",)])
def test_a_door_at_the_end_of_a_narrow_room(
    tmp_path: Path, depth_m: float, layers: tuple[str, ...]
) -> None:
    """The room's side, 0.1 m behind the doorway's, is no leaf beside the drawn one. And doors open the walls
    of chosen layers from where they are."""
    rooms = [(0, 0, 4, depth_m), (0, depth_m + 0.2, 4, 6), (4.2, 0, 8, 6)]
    walls = shapely.box(-0.2, -0.2, 8.2, 6.2).difference(
        shapely.union_all([shapely.box(*room) for room in rooms])
    )

    def add(document: ezdxf.document.Drawing) -> None:
        space, layer = document.modelspace(), {"layer": "Door"}
        space.add_line((4, 0.05), (3.25, 0.05), dxfattribs=layer)
        space.add_arc((4, 0.05), 0.75, 90, 180, dxfattribs=layer)

    path = write_dxf(tmp_path / "a.dxf", walls, layer="Wall", extra=add)
    plan = read_floorplan(path, PlanOptions(layers=layers))
    assert plan.source.opening_kinds == ("1 door",)
    np.testing.assert_allclose(np.sort(plan.openings[:, 0, 0]), [4.0, 4.2], atol=1e-6)
    assert plan.lengths.sum() == pytest.approx(walls.length - 1.5, abs=0.3)

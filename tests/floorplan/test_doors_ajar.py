"""Doors drawn open at any angle, and leaf and swing as one filled area: no walls, and the wall is open."""

import itertools
from pathlib import Path

import ezdxf
import numpy as np
import pytest
import shapely

from planfit.floorplan import Floorplan, read_floorplan

WIDTH_M = 0.9
DOORS = [((2.0, 0.0), 0.0), ((9.0, 3.0), 90.0), ((5.0, 6.0), 180.0)]
"""Hinge, m, and direction of the closed leaf, degrees."""
WALLS = [shapely.box(0, 0, 12, 6).exterior, shapely.LineString([(9, 0), (9, 6)])]


def written(path: Path, angle_deg: float, *, is_single: bool = True, off: float = 0.0) -> Path:
    """Walls without thickness, or 0.2 m thick about the same lines; arcs whose radius is `off` by a share."""
    document = ezdxf.new()  # pyright: ignore[reportPrivateImportUsage]
    document.header["$INSUNITS"] = 6
    space = document.modelspace()
    lines = (
        WALLS
        if is_single
        else [shapely.union_all([w.buffer(0.1, join_style="mitre") for w in WALLS])]
    )
    for line in lines:
        rings = [line] if is_single else shapely.get_rings(line)
        for ring in rings:
            points = shapely.get_coordinates(ring)
            for start, end in itertools.pairwise(points):
                space.add_line(start, end)
    for hinge, closed_deg in DOORS:
        open_deg = closed_deg + angle_deg
        tip = np.array(hinge) + WIDTH_M * np.array(
            [np.cos(np.deg2rad(open_deg)), np.sin(np.deg2rad(open_deg))]
        )
        space.add_line(hinge, tip)
        space.add_arc(hinge, WIDTH_M * (1 + off), closed_deg, open_deg)
    document.saveas(path)
    return path


def doors_of(plan: Floorplan, at: float, angle_deg: float = 0.0) -> list[bool]:
    """Whether a face lies within 3 cm of a place `at` of the width from the hinge, of each door; m."""
    faces = shapely.multilinestrings(plan.ends)
    to_file = plan.source.file_from_plan
    assert to_file is not None
    faces = shapely.transform(faces, lambda xy: xy @ to_file[:2, :2].T + to_file[:2, 2])
    places = [np.array(hinge) + at * WIDTH_M * np.array([np.cos(a), np.sin(a)])
              for hinge, closed_deg in DOORS for a in [np.deg2rad(closed_deg + angle_deg)]]  # fmt: skip
    return [bool(shapely.distance(faces, shapely.Point(place)) < 0.11) for place in places]


@pytest.mark.parametrize("angle_deg", [15, 30, 45, 60, 75, 90, 110])
@pytest.mark.parametrize("is_single", [True, False], ids=["single lines", "double lines"])
def test_the_wall_opens_and_the_leaf_is_no_wall(
    tmp_path: Path, angle_deg: float, is_single: bool
) -> None:
    plan = read_floorplan(written(tmp_path / "a.dxf", angle_deg, is_single=is_single))
    assert doors_of(plan, 0.5) == [False] * 3
    assert doors_of(plan, 1.5) == [True] * 3
    if angle_deg > 15:
        assert doors_of(plan, 0.8, angle_deg) == [False] * 3
    np.testing.assert_allclose(sorted(plan.size), [6.0, 12.0], atol=0.21)


def test_arcs_need_not_be_exact(tmp_path: Path) -> None:
    plan = read_floorplan(written(tmp_path / "a.dxf", 25.0, off=-0.06))
    assert doors_of(plan, 0.5) == [False] * 3


@pytest.mark.parametrize("angle_deg", [62, 90, 118])
@pytest.mark.parametrize("has_gap", [True, False])
def test_filled_sectors_are_doors(tmp_path: Path, angle_deg: float, has_gap: bool) -> None:
    """cm, without unit: walls filled, with or without a gap where the door is."""
    wall = shapely.box(0, 0, 1000, 700).difference(shapely.box(30, 30, 970, 670))
    wall = wall.union(shapely.box(500, 0, 515, 700))
    if has_gap:
        wall = wall.difference(shapely.box(490, 300, 520, 390))
    turned = np.deg2rad(90 - np.linspace(0, angle_deg, 20))
    sector = np.concatenate(
        [[[515, 300]], np.stack([515 + 90 * np.cos(turned), 300 + 90 * np.sin(turned)], 1)]
    )
    data = " ".join("M" + " L".join(f"{x},{y}" for x, y in ring) + "Z"
                    for ring in map(shapely.get_coordinates, shapely.get_rings(wall)))  # fmt: skip
    door = "M" + " L".join(f"{x},{y}" for x, y in sector) + "Z"
    path = tmp_path / "a.svg"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="1000" height="700"><g fill-rule="evenodd">'
        f'<path fill="#444" d="{data}"/><path fill="#555" d="{door}"/></g></svg>'
    )
    plan = read_floorplan(path)
    assert "1 door" in plan.source.opening_kinds
    along = np.abs(plan.ends[:, 1] - plan.ends[:, 0])
    assert (np.minimum(*along.T) < 1.0).all()
    faces = shapely.multilinestrings(plan.ends * (1.0, -1.0))
    assert shapely.distance(faces, shapely.Point(508, 345)) > 30
    assert shapely.distance(faces, shapely.Point(508, 450)) < 10

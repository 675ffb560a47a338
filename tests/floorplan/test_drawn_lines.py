"""The line work that a plan keeps to be shown behind its faces, and what was left out of it."""

from pathlib import Path

import ezdxf
import numpy as np
import pytest
import shapely
import trimesh

from plan_files import make_plan, write_dxf, write_geojson, write_ifc, write_pdf, write_svg
from planfit.floorplan import Floorplan, PlanOptions, read_floorplan
from planfit.floorplan.vector.line_work import longest, outlines

WALLS, _ = make_plan(n_rooms=4)


def in_plan(plan: Floorplan, lines: np.ndarray | None) -> np.ndarray:
    assert lines is not None
    plan_from_file = np.linalg.inv(plan.source.file_from_plan)
    return lines @ plan_from_file[:2, :2].T + plan_from_file[:2, 2]


def assert_under_faces(plan: Floorplan, within: float) -> None:
    """Every corner of a face lies on the line work, whichever way the file's axes run."""
    drawn = in_plan(plan, plan.source.drawn_lines)
    lines = shapely.multilinestrings(shapely.linestrings(drawn))
    apart = shapely.distance(shapely.points(plan.ends.reshape(-1, 2)), lines)
    assert apart.max() < within
    assert plan.lengths.sum() <= np.linalg.norm(drawn[:, 1] - drawn[:, 0], axis=1).sum() * 1.01


@pytest.mark.parametrize("scale", [None, 0.05])
def test_faces_lie_on_the_line_work(tmp_path: Path, scale: float | None) -> None:
    options = PlanOptions(metres_per_unit=scale)
    unit = 1.0 if scale is None else scale
    for path in (
        write_svg(tmp_path / "a.svg", WALLS),
        write_svg(tmp_path / "filled.svg", WALLS, fill="black", stroke="none"),
        write_pdf(tmp_path / "a.pdf", WALLS),
        write_pdf(tmp_path / "turned.pdf", WALLS, rotate=90),
        write_dxf(tmp_path / "a.dxf", WALLS, 0.05, 0),
        write_dxf(tmp_path / "hatch.dxf", WALLS, 0.05, 0, hatch=True),
    ):
        assert_under_faces(read_floorplan(path, options), 0.3 * unit)


@pytest.mark.parametrize("prefix", [None, "MILLI"])
def test_sections_of_a_model_in_its_own_unit(tmp_path: Path, prefix: str | None) -> None:
    assert_under_faces(read_floorplan(write_ifc(tmp_path / "a.ifc", WALLS, prefix)), 0.02)


def test_geojson_keeps_what_it_used(tmp_path: Path) -> None:
    plan = read_floorplan(write_geojson(tmp_path / "a.geojson", WALLS))
    assert_under_faces(plan, 0.02)
    assert plan.source.dropped_lines is not None
    assert len(plan.source.dropped_lines) == 0


def test_a_mesh_keeps_its_surface_at_the_cut(tmp_path: Path) -> None:
    box = trimesh.creation.box((6.0, 4.0, 2.6))
    box.invert()
    box.export(tmp_path / "room.ply")
    plan = read_floorplan(tmp_path / "room.ply")
    drawn = in_plan(plan, plan.source.drawn_lines)
    room = shapely.box(-3, -2, 3, 2).exterior
    assert shapely.distance(shapely.points(drawn.reshape(-1, 2)), room).max() < 0.011
    assert 1000 < len(drawn) <= 100_000


def test_layers_of_no_walls_are_left_out_lines(tmp_path: Path) -> None:
    chair = np.array([[2.0, 2.0], [2.5, 2.0], [2.5, 2.5], [2.0, 2.5]])

    def furnish(document: ezdxf.document.Drawing) -> None:
        document.modelspace().add_lwpolyline(chair, close=True, dxfattribs={"layer": "FURNITURE"})
        document.modelspace().add_arc((4.0, 3.0), 0.8, 0, 90, dxfattribs={"layer": "A-WALL"})

    path = write_dxf(tmp_path / "a.dxf", WALLS, extra=furnish)
    plan = read_floorplan(path)
    drawn, left = plan.source.drawn_lines, plan.source.dropped_lines
    assert drawn is not None
    assert left is not None
    on_chair = shapely.distance(shapely.points(left.mean(axis=1)), shapely.Polygon(chair)) < 1e-9
    assert on_chair.sum() == 4
    on_arc = np.abs(np.linalg.norm(left - (4.0, 3.0), axis=2) - 0.8).max(axis=1) < 1e-3
    assert on_arc.sum() >= 4
    assert len(left) == on_chair.sum() + on_arc.sum()
    assert len(drawn) == len(outlines([WALLS]))


def test_layers_that_were_not_chosen_are_left_out_lines(tmp_path: Path) -> None:
    def add_paving(document: ezdxf.document.Drawing) -> None:
        document.modelspace().add_line((0, -9), (9, -9), dxfattribs={"layer": "GROUND"})

    path = write_dxf(tmp_path / "a.dxf", WALLS, extra=add_paving)
    plan, chosen = read_floorplan(path), read_floorplan(path, PlanOptions(layers=("A-WALL",)))
    assert (np.array(plan.source.drawn_lines)[..., 1] == -9).any()
    np.testing.assert_array_equal(chosen.source.dropped_lines, [[[0, -9], [9, -9]]])


def test_scaled_plans_keep_the_place_of_their_lines(tmp_path: Path) -> None:
    plan = read_floorplan(write_svg(tmp_path / "a.svg", WALLS)).scaled(0.05)
    assert_under_faces(plan, 0.02)


def test_outlines_are_of_rings_and_lines() -> None:
    ring = shapely.box(0, 0, 4, 4) - shapely.box(1, 1, 2, 2)
    shapes = [
        ring,
        shapely.MultiPolygon([shapely.box(8, 0, 9, 1), shapely.box(8, 2, 9, 3)]),
        shapely.GeometryCollection([shapely.LineString([(0, 9), (1, 9), (2, 8)]), ring]),
        shapely.Point(3, 3),
    ]
    pieces = outlines(shapes)
    assert len(pieces) == 8 + 8 + 2 + 8
    assert np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1).max() == 4.0
    assert outlines([]).shape == (0, 2, 2)


def test_the_longest_are_kept_in_their_order() -> None:
    x = np.array([3.0, 1.0, 5.0, 2.0, 4.0])
    ends = np.stack([np.zeros((5, 2)), np.stack([x, 0 * x], axis=1)], axis=1)
    np.testing.assert_array_equal(longest(ends, 3)[:, 1, 0], [3.0, 5.0, 4.0])
    assert longest(ends, 5) is ends

"""The same building in every vector format gives the same faces."""

import numpy as np
import pytest
import shapely

from plan_files import make_plan, write_dxf, write_geojson, write_ifc, write_pdf, write_svg
from planfit.floorplan import PlanOptions, read_floorplan
from planfit.floorplan.regions import faces_of_regions

WALLS, BUILDING = make_plan(n_rooms=6)
MIN_FACE_M = 0.5
"""Shorter ones are jambs and ends of walls, which formats with lines alone need not show."""


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


def assert_same(plan, scale=1.0, shift=(0.0, 0.0), within=0.01):
    """All true faces are there, and nothing else; `scale` is plan units a metre."""
    truth = faces_of_regions(WALLS, 1e-6, 0.05)
    ends = plan.ends / scale - shift
    long = np.linalg.norm(truth.ends[:, 1] - truth.ends[:, 0], axis=1) > MIN_FACE_M
    assert plan.is_oriented.all()
    recall = on_faces(ends, plan.normals, truth.ends[long], truth.normals[long], within)
    precision = on_faces(truth.ends, truth.normals, ends, plan.normals, within)
    assert recall > 0.999
    assert precision > 0.999


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
def test_dxf(tmp_path, hatch, insunits, unit, scale):
    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", WALLS, scale, insunits, hatch=hatch))
    assert_same(plan)
    assert plan.is_metric
    assert plan.source.unit == unit
    assert plan.source.unit_from == "the file's header"
    assert plan.source.layers == ("A-WALL",)


@pytest.mark.parametrize("fill", ["none", "black", "#777"])
def test_svg(tmp_path, fill):
    plan = read_floorplan(write_svg(tmp_path / "a.svg", WALLS, fill=fill))
    assert not plan.is_metric
    assert plan.source.unit == "unknown"
    assert_same(plan, 20.0, (5.0, -5.0))
    in_file = (
        plan.ends[0] @ plan.source.file_from_plan[:2, :2].T + plan.source.file_from_plan[:2, 2]
    )
    np.testing.assert_allclose(in_file, plan.ends[0] * (1, -1))


def test_svg_in_metres_where_told(tmp_path):
    path = write_svg(tmp_path / "a.svg", WALLS)
    assert_same(read_floorplan(path, PlanOptions(metres_per_unit=0.05)), 1.0, (5.0, -5.0))


@pytest.mark.parametrize("fill", [None, "0 0 0", "0.5 0.5 0.5"])
def test_pdf(tmp_path, fill):
    plan = read_floorplan(write_pdf(tmp_path / "a.pdf", WALLS, fill=fill))
    assert not plan.is_metric
    assert_same(plan, 20.0, (5.0, 5.0))


def test_a_turned_page_is_read_as_it_is_shown(tmp_path):
    plan = read_floorplan(write_pdf(tmp_path / "a.pdf", WALLS, rotate=90))
    # Turned clockwise: page (x, y) is shown at (y, 1200 - x).
    back = np.stack([1200 - plan.ends[..., 1], plan.ends[..., 0]], axis=-1) / 20 - 5
    truth = faces_of_regions(WALLS, 1e-6, MIN_FACE_M)
    lines = shapely.multilinestrings(shapely.linestrings(back))
    assert shapely.distance(shapely.points(truth.ends.mean(axis=1)), lines).max() < 0.01


@pytest.mark.parametrize("prefix", [None, "MILLI"])
def test_ifc(tmp_path, prefix):
    plan = read_floorplan(write_ifc(tmp_path / "a.ifc", WALLS, prefix))
    assert_same(plan)
    assert plan.source.unit == ("m" if prefix is None else "mm")
    assert plan.source.storey == "Ground"


def test_geojson(tmp_path):
    plan = read_floorplan(write_geojson(tmp_path / "a.geojson", WALLS))
    low = np.array(WALLS.bounds).reshape(2, 2)
    assert_same(plan, shift=-low.mean(axis=0))
    in_file = plan.ends @ plan.source.file_from_plan[:2, :2].T + plan.source.file_from_plan[:2, 2]
    assert np.abs(in_file - (11.57, 48.14)).max() < 1e-3

"""Real drawings and models: what can be known of them without their truth."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
import shapely

from planfit.errors import FloorplanError
from planfit.floorplan import PlanOptions, read_floorplan
from planfit.floorplan.elements import find_columns

DATA = Path(os.environ.get("PLANFIT_SHARED", Path(__file__).parents[2].parent / "shared" / "data"))
PLANS = DATA / "floorplans"
DRAWN_BY_HAND = json.loads(Path(__file__).with_name("real_drawing_walls.json").read_text())[
    "drawings"
]

pytestmark = [
    pytest.mark.shared,
    pytest.mark.skipif(
        not PLANS.is_dir(), reason="no real plans: set PLANFIT_SHARED to their folder"
    ),
]


@pytest.fixture(scope="module")
def pdf():
    return read_floorplan(PLANS / "pdf" / "NSH2012_GIS-1.pdf")


@pytest.mark.slow
def test_the_same_floor_as_pdf_and_as_svg_gives_the_same_faces(pdf):
    svg = read_floorplan(PLANS / "svg" / "NSH2012_GIS-1.svg")
    points = svg.ends / 1.25 + (0, 612)  # 1.25 px a point; y down from the top
    lines = shapely.multilinestrings(shapely.linestrings(pdf.ends))
    apart = shapely.distance(shapely.points(points.reshape(-1, 2)), lines)
    assert np.mean(apart < 0.05) > 0.99
    assert svg.lengths.sum() / 1.25 == pytest.approx(pdf.lengths.sum(), rel=0.01)
    assert not pdf.is_metric


@pytest.mark.slow
def test_faces_of_the_university_floor_follow_its_two_directions(pdf):
    angle = np.rad2deg(np.arctan2(pdf.normals[:, 1], pdf.normals[:, 0])) % 90
    is_along = np.minimum(angle, 90 - angle) < 3
    # Hatches run at 45 degrees; some rooms are askew.
    assert pdf.lengths[is_along].sum() > 0.9 * pdf.lengths.sum()
    assert not (pdf.ends[..., 0] < 150).any()  # the legend


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "unit", "size"),
    [
        ("office_metres", "m", (34, 27)),
        # The drawn shell with its bay, not only the walls that are to be built in it.
        ("room_centimetres", "cm", (7.83, 5.5)),
        ("two_rooms_metres", "m", (8, 5.5)),
    ],
)
def test_drawings(name, unit, size):
    plan = read_floorplan(PLANS / "dxf" / f"{name}.dxf")
    assert plan.source.unit == unit
    np.testing.assert_allclose(plan.size, size, rtol=0.15)
    assert not any("urniture" in layer for layer in plan.source.layers)
    assert not any("damaged" in warning for warning in plan.source.warnings)
    # Chamfered squares on a layer of doors; pans and basins on that of walls are none.
    assert len(find_columns(plan).sizes) == (3 if name == "office_metres" else 0)


@pytest.mark.slow
@pytest.mark.parametrize("truth", DRAWN_BY_HAND, ids=lambda truth: Path(truth["file"]).stem)
def test_walls_of_drawings_are_those_drawn_over_them_by_hand(truth):
    path = DATA / truth["file"]
    if not path.is_file():
        pytest.skip(f"no {path}")
    plan = read_floorplan(path)
    walls = np.array(truth["walls"], float).reshape(-1, 2, 2)
    near = 0.05 if plan.is_metric else 0.01 * np.ptp(walls.reshape(-1, 2), axis=0).max()
    either = shapely.union_all([shapely.Polygon(corners) for corners in truth["either"]])
    drawn, found = (
        shapely.difference(shapely.multilinestrings(shapely.linestrings(ends)), either)
        for ends in (walls, plan.ends)
    )
    read, right = (
        shapely.length(shapely.intersection(lines, shapely.buffer(others, near))) / lines.length
        for lines, others in ((drawn, found), (found, drawn))
    )
    assert read > 0.95
    assert right > 0.95


@pytest.mark.parametrize(
    ("name", "storey", "size"),
    [("AC20-FZK-Haus", "Erdgeschoss", (12, 10)), ("duplex", "Level 1", (8.8, 17.8))],
)
def test_models(name, storey, size):
    plan = read_floorplan(PLANS / "ifc" / f"{name}.ifc")
    assert plan.source.storey == storey
    np.testing.assert_allclose(plan.size, size, atol=0.05)
    upper = read_floorplan(
        PLANS / "ifc" / f"{name}.ifc", PlanOptions(storey=plan.source.storeys[-1], cut_height_m=0.5)
    )
    assert upper.fingerprint == plan.fingerprint


def test_a_model_without_walls():
    path = PLANS / "ifc" / "no_walls.ifc"
    with pytest.raises(FloorplanError) as caught:
        read_floorplan(path)
    assert str(caught.value) == (
        f"{path}: expected walls (IfcWall), found none in 3687 elements; export the architect's model, "
        "not that of the structure or the services"
    )

"""Openings of IFC models by kind, and their place on a map."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from plan_files import make_plan, write_ifc
from planfit.as_built.elements import element_ids
from planfit.cli import run
from planfit.floorplan import PlanOptions, read_floorplan
from planfit.floorplan.formats.ifc_places import map_conversion
from planfit.floorplan.types import PlanSource

DATA = Path(os.environ.get("PLANFIT_SHARED", Path(__file__).parents[2].parent / "shared" / "data"))
ifcopenshell = pytest.importorskip("ifcopenshell")


def wall_with_holes(path: Path, scale: float) -> Path:
    """A wall of 6 m along x, 0.3 m thick, with a door at 1 to 2, a window at 3 to 4.5 and a hole at 5 to 5.5;
    lengths in units of 1 / scale m."""
    import ifcopenshell.guid

    model = ifcopenshell.file(schema="IFC4")
    make, new = model.create_entity, ifcopenshell.guid.new
    prefix = None if scale == 1.0 else "MILLI"
    point = lambda *c: make("IfcCartesianPoint", tuple(float(v) * scale for v in c))  # noqa: E731
    unit = make("IfcSIUnit", None, "LENGTHUNIT", prefix, "METRE")
    origin = make("IfcAxis2Placement3D", point(0, 0, 0))
    context = make("IfcGeometricRepresentationContext", None, "Model", 3, 1e-5, origin)
    project = make("IfcProject", new(), RepresentationContexts=[context],
                   UnitsInContext=make("IfcUnitAssignment", [unit]))  # fmt: skip
    storey = make("IfcBuildingStorey", new(), Name="Ground", Elevation=0.0)
    make("IfcRelAggregates", new(), RelatingObject=project, RelatedObjects=[storey])

    def box(x0, x1, y0, y1, z0, z1):
        ring = [point(x0, y0), point(x1, y0), point(x1, y1), point(x0, y1), point(x0, y0)]
        profile = make("IfcArbitraryClosedProfileDef", "AREA", None, make("IfcPolyline", ring))
        at = make("IfcAxis2Placement3D", point(0, 0, z0))
        up = make("IfcDirection", (0.0, 0.0, 1.0))
        solid = make("IfcExtrudedAreaSolid", profile, at, up, (z1 - z0) * scale)
        shape = make("IfcShapeRepresentation", context, "Body", "SweptSolid", [solid])
        return make("IfcProductDefinitionShape", None, None, [shape])

    ground = make("IfcLocalPlacement", None, origin)
    wall = make("IfcWall", new(), ObjectPlacement=ground, Representation=box(0, 6, 0, 0.3, 0, 2.7))
    other = make(
        "IfcWall", new(), ObjectPlacement=ground, Representation=box(0, 0.3, 0.3, 4, 0, 2.7)
    )
    holes = [("IfcDoor", 1, 2, 0.0, 2.1), ("IfcWindow", 3, 4.5, 0.8, 2.0), (None, 5, 5.5, 0.0, 2.1),
             ("IfcWindow", 2.2, 2.8, 1.9, 2.3)]  # fmt: skip
    for kind, x0, x1, z0, z1 in holes:
        hole = make("IfcOpeningElement", new(), ObjectPlacement=ground,
                    Representation=box(x0, x1, -0.1, 0.4, z0, z1))  # fmt: skip
        make("IfcRelVoidsElement", new(), RelatingBuildingElement=wall, RelatedOpeningElement=hole)
        if kind:
            at = make("IfcLocalPlacement", None, make("IfcAxis2Placement3D", point(x0, 0, z0)))
            filling = make(kind, new(), ObjectPlacement=at)
            make(
                "IfcRelFillsElement",
                new(),
                RelatingOpeningElement=hole,
                RelatedBuildingElement=filling,
            )
    make(
        "IfcRelContainedInSpatialStructure",
        new(),
        RelatedElements=[wall, other],
        RelatingStructure=storey,
    )
    model.write(str(path))
    return path


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_faces_know_their_elements(tmp_path: Path, scale: float) -> None:
    """Two walls that meet: after the union that faces are made of, each face is still of its wall."""
    path = wall_with_holes(tmp_path / "a.ifc", scale)
    along_x, along_y = (wall.GlobalId for wall in ifcopenshell.open(str(path)).by_type("IfcWall"))
    plan = read_floorplan(path)
    ids = element_ids(plan)
    for ends, length, found in zip(plan.ends, plan.lengths, ids, strict=True):
        if length > 0.4:
            is_along_y = abs(ends[0, 0] - ends[1, 0]) < 0.01
            assert found == (along_y if is_along_y else along_x)
    assert {along_x, along_y} == set(ids)
    # Whatever becomes of the plan's axes, they stay.
    assert element_ids(plan.mirrored()) == ids
    assert element_ids(replace(plan, source=PlanSource())) == ("",) * len(plan)


def test_the_elevation_of_the_storey_is_kept(tmp_path: Path) -> None:
    walls, _ = make_plan(n_rooms=4)
    path = write_ifc(tmp_path / "a.ifc", walls, storeys=(("Ground", 0.0), ("First", 3.0)))
    for storey, elevation_m in (("Ground", 0.0), ("First", 3.0)):
        plan = read_floorplan(path, PlanOptions(storey=storey))
        assert plan.source.elevation_m == pytest.approx(elevation_m)


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_openings_are_marked_and_counted_by_kind(tmp_path: Path, scale: float, capsys) -> None:
    path = wall_with_holes(tmp_path / "a.ifc", scale)
    plan = read_floorplan(path)
    found = {(*np.round(np.sort(sides[:, 0]), 2), round(sides[0, 1], 2)) for sides in plan.openings}
    assert found == {(a, b, y) for a, b in ((1, 2), (3, 4.5), (5, 5.5)) for y in (0.0, 0.3)}
    assert plan.source.opening_kinds == ("1 door", "1 window", "1 opening")
    gaps = shapely.multilinestrings(shapely.linestrings(plan.openings))
    faces = shapely.multilinestrings(shapely.linestrings(plan.ends))
    assert shapely.length(shapely.intersection(gaps.buffer(1e-3), faces)) < 0.05
    assert run(["plan", str(path)]) == 0
    assert "1 door, 1 window, 1 opening" in " ".join(capsys.readouterr().out.split())


def model_on_map(schema: str, east: float, north: float, **entries: object):
    model = ifcopenshell.file(schema=schema)
    make = model.create_entity
    unit = make("IfcSIUnit", None, "LENGTHUNIT", "MILLI", "METRE")
    origin = make("IfcAxis2Placement3D", make("IfcCartesianPoint", (0.0, 0.0, 0.0)))
    context = make("IfcGeometricRepresentationContext", None, "Model", 3, 1e-5, origin)
    make("IfcProject", "0" * 22, RepresentationContexts=[context],
         UnitsInContext=make("IfcUnitAssignment", [unit]))  # fmt: skip
    crs = make("IfcProjectedCRS", Name="EPSG:28992")
    make("IfcMapConversion", context, crs, east, north, 4.0, **entries)
    return model


def words_on_map(model, unit_scale: float) -> str:
    found = map_conversion(model, unit_scale)
    assert found is not None
    return found.words


def test_a_map_conversion_in_the_unit_that_is_meant() -> None:
    """A real exporter writes millimetres and claims feet; east of the Earth's edge, they are millimetres."""
    turned = {"XAxisAbscissa": -0.8167, "XAxisOrdinate": 0.577}
    words = words_on_map(model_on_map("IFC4", 93869354.3, 435604866.6, **turned), 0.001)
    assert words == "origin at (93869.354, 435604.867) m in EPSG:28992, x turned by 144.759 deg"
    words = words_on_map(model_on_map("IFC4", 93869.3543, 435604.8665), 0.001)
    assert words.startswith("origin at (93869.354, 435604.86")
    assert map_conversion(ifcopenshell.file(schema="IFC4"), 1.0) is None
    assert map_conversion(ifcopenshell.file(schema="IFC2X3"), 1.0) is None


@pytest.mark.shared
@pytest.mark.skipif(not (DATA / "real_files").is_dir(), reason="no real models: set PLANFIT_SHARED")
def test_a_real_georeferenced_model_in_an_archive(capsys) -> None:
    path = DATA / "real_files" / "ifc_georef" / "Duplex_A_20110907_georeferenced.ifczip"
    assert run(["plan", str(path)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "origin at (76670.000, 77179.000) m in EPSG:9897, x turned by 71.000 deg" in said
    assert "6 doors, 4 windows" in said

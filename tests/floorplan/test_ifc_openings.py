"""Openings of IFC models by kind, and their place on a map."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from plan_files import make_plan, write_ifc
from planfit.cli import run
from planfit.floorplan import PlanOptions, read_floorplan
from planfit.floorplan.elements import are_glass, element_ids, opening_element
from planfit.floorplan.formats.georeference import map_conversion
from planfit.floorplan.gaps import find_gaps
from planfit.floorplan.types import PlanSource

DATA = Path(os.environ.get("PLANFIT_SHARED", Path(__file__).parents[2].parent / "shared" / "data"))
ifcopenshell = pytest.importorskip("ifcopenshell")


class Builder:
    """A model of one storey at height 0; lengths in units of 1 / scale m."""

    def __init__(self, scale: float = 1.0) -> None:
        import ifcopenshell.guid

        self.model, self.scale = ifcopenshell.file(schema="IFC4"), scale
        self.new_id = ifcopenshell.guid.new
        unit = self.make(
            "IfcSIUnit", None, "LENGTHUNIT", None if scale == 1.0 else "MILLI", "METRE"
        )
        origin = self.place(0, 0, 0)
        self.context = self.make(
            "IfcGeometricRepresentationContext", None, "Model", 3, 1e-5, origin
        )
        self.ground = self.make("IfcLocalPlacement", None, origin)
        units = self.make("IfcUnitAssignment", [unit])
        project = self.rooted(
            "IfcProject", RepresentationContexts=[self.context], UnitsInContext=units
        )
        self.storey = self.rooted("IfcBuildingStorey", Name="Ground", Elevation=0.0)
        self.rooted("IfcRelAggregates", RelatingObject=project, RelatedObjects=[self.storey])

    def make(self, kind: str, *values, **named):
        return self.model.create_entity(kind, *values, **named)

    def rooted(self, kind: str, **named):
        return self.make(kind, self.new_id(), **named)

    def point(self, *xyz: float):
        return self.make("IfcCartesianPoint", tuple(float(v) * self.scale for v in xyz))

    def place(self, *xyz: float):
        return self.make("IfcAxis2Placement3D", self.point(*xyz))

    def box(self, x0, x1, y0, y1, z0, z1):
        corners = (x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)
        ring = [self.point(*corner) for corner in corners]
        profile = self.make(
            "IfcArbitraryClosedProfileDef", "AREA", None, self.make("IfcPolyline", ring)
        )
        up = self.make("IfcDirection", (0.0, 0.0, 1.0))
        solid = self.make(
            "IfcExtrudedAreaSolid", profile, self.place(0, 0, z0), up, (z1 - z0) * self.scale
        )
        shape = self.make("IfcShapeRepresentation", self.context, "Body", "SweptSolid", [solid])
        return self.make("IfcProductDefinitionShape", None, None, [shape])

    def element(self, kind: str, *box: float, material: str = "", **named):
        made = self.rooted(
            kind,
            ObjectPlacement=self.ground,
            Representation=self.box(*box) if box else None,
            **named,
        )
        if material:
            layers = [self.make("IfcMaterial", Name=name) for name in material.split(", ")]
            stuff = self.make("IfcMaterialList", layers)
            self.rooted("IfcRelAssociatesMaterial", RelatedObjects=[made], RelatingMaterial=stuff)
        return made

    def write(self, path: Path, elements: list) -> Path:
        self.rooted(
            "IfcRelContainedInSpatialStructure",
            RelatedElements=elements,
            RelatingStructure=self.storey,
        )
        self.model.write(str(path))
        return path


def wall_with_holes(path: Path, scale: float) -> Path:
    """A wall of 6 m along x, 0.3 m thick: a door at 1 to 2, a window at 3 to 4.5, a hole at 5 to 5.5."""
    build = Builder(scale)
    wall = build.element("IfcWall", 0, 6, 0, 0.3, 0, 2.7)
    other = build.element("IfcWall", 0, 0.3, 0.3, 4, 0, 2.7)
    holes = [("IfcDoor", 1, 2, 0.0, 2.1), ("IfcWindow", 3, 4.5, 0.8, 2.0), (None, 5, 5.5, 0.0, 2.1),
             ("IfcWindow", 2.2, 2.8, 1.9, 2.3)]  # fmt: skip
    for kind, x0, x1, z0, z1 in holes:
        hole = build.element("IfcOpeningElement", x0, x1, -0.1, 0.4, z0, z1)
        build.rooted("IfcRelVoidsElement", RelatingBuildingElement=wall, RelatedOpeningElement=hole)
        if kind:
            at = build.make("IfcLocalPlacement", None, build.place(x0, 0, z0))
            build.rooted(
                "IfcRelFillsElement",
                RelatingOpeningElement=hole,
                RelatedBuildingElement=build.rooted(kind, ObjectPlacement=at),
            )
    return build.write(path, [wall, other])


def model_with_glass(path: Path) -> Path:
    """A curtain wall along x at y 0 (three posts, two panes, a door at 4.6 to 5.5, a metal panel beyond) put
    together in two steps, panes at x 3, a wall insulated with glass wool at x 5, and a front called
    glass at y 6."""
    build = Builder()
    front = build.element("IfcCurtainWall")
    frame = build.element("IfcElementAssembly")
    posts = [build.element("IfcMember", x, x + 0.1, 0, 0.1, 0, 2.7) for x in (0.0, 2.0, 4.5)]
    panes = [
        build.element("IfcPlate", x0, x1, 0.04, 0.06, 0, 2.7, material=material)
        for x0, x1, material in (
            (0.1, 2.0, ""), (2.1, 4.5, "Glass, Air, Glass"), (5.5, 7.0, "Metal - Aluminium")
        )
    ]  # fmt: skip
    door = build.element("IfcDoor", 4.6, 5.5, 0.03, 0.07, 0, 2.1)
    for whole, parts in ((frame, [*posts, *panes]), (front, [frame, door])):
        build.rooted("IfcRelAggregates", RelatingObject=whole, RelatedObjects=parts)
    walls = [
        build.element(
            "IfcWall", 3, 3.05, 0.3, 5, 0, 2.7, material="Isolierglas, Luft, Isolierglas"
        ),
        build.element(
            "IfcWall", 5, 5.15, 0.3, 5, 0, 2.7, material="Plasterboard, Glass wool, Plasterboard"
        ),
        build.element("IfcWall", 0, 7, 6, 6.1, 0, 2.7, Name="Basic Wall:Glazed front 100"),
    ]
    return build.write(path, [front, *walls])


def test_glass_is_told_by_kind_and_by_material(tmp_path: Path, capsys) -> None:
    path = model_with_glass(tmp_path / "a.ifc")
    plan = read_floorplan(path)
    is_glass, middle = are_glass(plan), plan.ends.mean(axis=1)
    is_pane = (middle[:, 1] < 0.2) & (middle[:, 0] > 0.1) & (middle[:, 0] < 4.5)
    is_pane &= plan.lengths > 1.5
    is_partition = np.abs(middle[:, 0] - 3.0) < 0.1
    is_front = middle[:, 1] > 5.9
    assert is_glass[is_pane].all()
    assert is_pane.sum() == 4
    assert is_glass[is_partition & ~is_pane].all()
    assert is_glass[is_front].all()
    assert not is_glass[np.abs(middle[:, 0] - 5.07) < 0.1].any()  # glass wool
    is_metal = (middle[:, 0] > 5.6) & (middle[:, 1] < 0.2)
    assert is_metal.any()
    assert not is_glass[is_metal].any()
    # The door of the curtain wall is a gap.
    is_doorway = (middle[:, 0] > 4.7) & (middle[:, 0] < 5.4) & (middle[:, 1] < 0.2)
    assert not is_doorway.any()
    assert "are glass" in plan.source.warnings[0]
    assert run(["plan", str(path), "-o", str(tmp_path / "a.png")]) == 0
    assert " m of faces" in capsys.readouterr().out


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


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_gaps_know_their_doors_and_windows(tmp_path: Path, scale: float) -> None:
    path = wall_with_holes(tmp_path / "a.ifc", scale)
    model = ifcopenshell.open(str(path))
    (door,), (window, _) = model.by_type("IfcDoor"), model.by_type("IfcWindow")
    plan = read_floorplan(path)
    told = {
        round(gap.width_m, 2): opening_element(plan, gap) for gap in find_gaps(plan, (0.4, 3.0))
    }
    by_place = {
        1.0: ("door", door.GlobalId),
        1.5: ("window", window.GlobalId),
        0.5: ("opening", ""),
    }
    assert told == by_place
    turned = plan.mirrored()
    assert {opening_element(turned, gap) for gap in find_gaps(turned, (0.4, 3.0))} == set(
        by_place.values()
    )


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

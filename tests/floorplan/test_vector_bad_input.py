"""What is wrong with a drawing is said in one line, with the next step; nothing outside is loaded."""

import json
import re
import sys
import zipfile

import numpy as np
import pytest
import shapely

from plan_files import (
    make_plan,
    write_dxf,
    write_geojson,
    write_ifc,
    write_pdf,
    write_pdf_stream,
    write_svg,
)
from planfit.errors import FloorplanError
from planfit.floorplan import PlanOptions, read_floorplan

WALLS, _ = make_plan(n_rooms=3)


def refusal(path, options=None):
    with pytest.raises(FloorplanError) as caught:
        read_floorplan(path, options)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


def wrote(path, text):
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.dxf", "expected a DXF drawing, found an empty file; export it again"),
        ("a.svg", "expected an SVG, found an empty file; export it again"),
        ("a.pdf", "expected a PDF, found an empty file; export it again"),
        ("a.ply", "expected a mesh or a point cloud, found an empty file"),
    ],
)
def test_empty_files(tmp_path, name, message):
    assert refusal(wrote(tmp_path / name, "")) == message


def test_billion_laughs(tmp_path):
    entities = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 10))
    path = wrote(
        tmp_path / "a.svg",
        f'<?xml version="1.0"?><!DOCTYPE svg [<!ENTITY l0 "ha">{entities}]>'
        '<svg xmlns="http://www.w3.org/2000/svg"><text>&l9;</text></svg>',
    )
    assert refusal(path) == (
        "expected an SVG without entities, found an ENTITY declaration, which can load other files "
        "or grow without bound; save it again as plain SVG"
    )


@pytest.mark.parametrize("what", ['SYSTEM "file:///etc/passwd"', 'SYSTEM "http://example.com/x"'])
def test_external_entities(tmp_path, what):
    path = wrote(
        tmp_path / "a.svg",
        f'<!DOCTYPE svg [<!ENTITY x {what}>]><svg xmlns="http://www.w3.org/2000/svg"><text>&x;</text></svg>',
    )
    assert "found an ENTITY declaration" in refusal(path)


def test_an_encoding_does_not_hide_entities(tmp_path):
    text = '<?xml version="1.0" encoding="utf-16"?><!DOCTYPE svg [<!ENTITY x "y">]><svg/>'
    path = tmp_path / "a.svg"
    path.write_bytes(text.encode("utf-16"))
    assert "found an ENTITY declaration" in refusal(path)


@pytest.mark.parametrize("hidden", ['opacity="0"', 'style="opacity: 0"'])
def test_what_is_transparent_in_an_svg_is_not_read(tmp_path, hidden):
    wall = f'<g {hidden}><path d="M 140,110 v 40 h 4 v -40 z" fill="none" stroke="black"/></g>'
    plan = read_floorplan(write_svg(tmp_path / "a.svg", WALLS, extra=wall))
    clean = read_floorplan(write_svg(tmp_path / "b.svg", WALLS))
    np.testing.assert_allclose(plan.ends, clean.ends)
    seen = read_floorplan(write_svg(tmp_path / "c.svg", WALLS, extra=wall.replace(hidden, "")))
    assert len(seen) > len(clean)


def test_an_svg_that_holds_a_picture_alone_says_so(tmp_path):
    (tmp_path / "a.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" width="9" '
        'height="9"><image width="9" height="9" xlink:href="data:image/png;base64,iVBORw0KGgo="/></svg>'
    )
    with pytest.raises(FloorplanError, match="found a picture in the SVG"):
        read_floorplan(tmp_path / "a.svg")


def test_references_to_other_files_are_not_followed(tmp_path, monkeypatch):
    other = write_svg(tmp_path / "other.svg", shapely.box(50, 50, 60, 60))
    opened = []
    extra = f'<use xlink:href="{other}#x"/><image href="http://example.com/a.png" width="9" height="9"/>'
    path = write_svg(tmp_path / "a.svg", WALLS, extra=extra)

    def note(event, args):
        if event in ("open", "socket.connect"):
            opened.append(str(args))

    sys.addaudithook(note)
    plan = read_floorplan(path)
    assert not [name for name in opened if "other.svg" in name or "example.com" in name]
    assert plan.source.warnings == ("2 references to other files were not followed",)


def test_a_doctype_alone_is_harmless(tmp_path):
    path = write_svg(tmp_path / "a.svg", WALLS)
    doctype = '<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">'
    path.write_text(doctype + path.read_text())
    assert len(read_floorplan(path))


def test_svg_that_is_no_xml(tmp_path):
    assert refusal(wrote(tmp_path / "a.svg", "<svg><g></svg>")) == (
        "expected an SVG, found no well-formed XML (mismatched tag: line 1, column 10); export it again"
    )


def test_svg_without_lines(tmp_path):
    path = wrote(
        tmp_path / "a.svg", '<svg xmlns="http://www.w3.org/2000/svg"><text>hello</text></svg>'
    )
    assert refusal(path) == (
        "expected a drawing of walls, found no lines or areas in it; check that it is the right file"
    )


def test_corrupt_pdf(tmp_path):
    path = write_pdf(tmp_path / "a.pdf", WALLS)
    path.write_bytes(b"%PDF-1.4\n" + path.read_bytes()[300:400])
    assert refusal(path) == (
        "expected a PDF, found a file that is damaged or of another kind; export it again"
    )


def test_encrypted_pdf(tmp_path):
    path = write_pdf(tmp_path / "a.pdf", WALLS)
    secret = "<" + "5a" * 32 + ">"
    data = path.read_bytes().decode("latin-1")
    encrypt = (
        f"/Encrypt << /Filter /Standard /V 1 /R 2 /P -4 /O {secret} /U {secret} >> /ID [<00> <00>]"
    )
    path.write_bytes(data.replace("/Root 1 0 R", f"/Root 1 0 R {encrypt}").encode("latin-1"))
    assert refusal(path) == (
        "expected a PDF that opens without a password, found an encrypted one; "
        "save it without a password"
    )


def test_pdf_page_that_is_not_there(tmp_path):
    path = write_pdf(tmp_path / "a.pdf", WALLS)
    assert refusal(path, PlanOptions(page=3)) == (
        "expected a page 3, found 1 pages; pass a page that there is"
    )


def test_blank_pdf(tmp_path):
    path = write_pdf_stream(tmp_path / "a.pdf", "")
    assert refusal(path) == (
        "expected a drawing of walls, found no lines or areas in it; check that it is the right file"
    )


def test_truncated_dxf(tmp_path):
    path = write_dxf(tmp_path / "a.dxf", WALLS)
    data = path.read_bytes()
    path.write_bytes(data[: int(0.9 * len(data))])
    assert "expected a" in refusal(path)
    assert "cut off" in refusal(path) or "damaged" in refusal(path)


def harmless(document):
    space = document.modelspace()
    space.add_line((0, 0), (0, 0.1), dxfattribs={"layer": "FURNITURE", "linetype": "NONE SUCH"})
    space.add_line((0, 0), (0, 0.1), dxfattribs={"layer": "FURNITURE", "color": 999})


def lose_a_block(document):
    document.modelspace().add_blockref("MISSING", (0, 0))


def lose_a_spline(document):
    spline = document.modelspace().add_spline()
    spline.control_points = [(0, 0), (1, 1), (2, 0), (3, 3)]
    spline.knots = [0, 1, 2]


def test_a_dxf_with_errors_that_lose_nothing_is_not_called_damaged(tmp_path):
    clean = read_floorplan(write_dxf(tmp_path / "a.dxf", WALLS))
    path = write_dxf(tmp_path / "b.dxf", WALLS, layer="WALL", extra=harmless)
    # Layers with a slash are not allowed, and common.
    path.write_text(path.read_text().replace("\nWALL\n", "\nWALL/NEW\n"))
    plan = read_floorplan(path)
    assert plan.source.layers == ("WALL/NEW",)
    assert plan.source.warnings == clean.source.warnings == ()
    np.testing.assert_array_equal(plan.ends, clean.ends)


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        (lose_a_block, r"Deleted entity INSERT\(#\w+\) without required BLOCK definition\."),
        (lose_a_spline, r"Removed SPLINE\(#\w+\) with invalid knot value count: 3 < 8"),
    ],
)
def test_a_dxf_with_lost_entities_is_called_damaged(tmp_path, extra, words):
    plan = read_floorplan(write_dxf(tmp_path / "a.dxf", WALLS, extra=extra))
    (warning,) = plan.source.warnings
    assert re.fullmatch(
        f"the file is damaged: 1 of its parts or numbers were lost or guessed; first: {words}",
        warning,
    )


@pytest.mark.parametrize(("number", "is_guessed"), [("123.5x", True), ("123.5", False)])
def test_a_dxf_with_a_number_that_is_none(tmp_path, number, is_guessed):
    def mark(document):
        document.modelspace().add_line((1, 1), (123.5, 1), dxfattribs={"layer": "FURNITURE"})

    path = write_dxf(tmp_path / "a.dxf", WALLS, extra=mark)
    path.write_text(path.read_text().replace("\n123.5\n", f"\n{number}\n"))
    warnings = read_floorplan(path).source.warnings
    assert [f'"{number}"' in w for w in warnings] == [True] * is_guessed


def test_dxf_of_another_kind(tmp_path):
    assert "expected a DXF drawing" in refusal(wrote(tmp_path / "a.dxf", "hello\nworld\n"))


def test_dxf_that_claims_an_absurd_unit_is_questioned(tmp_path):
    # Metres, said to be millimetres.
    path = write_dxf(tmp_path / "a.dxf", WALLS, 1.0, insunits=4)
    plan = read_floorplan(path)
    size = max(plan.size)
    assert not plan.is_metric
    assert plan.source.unit == "unknown"
    assert plan.source.warnings == (
        f"the file says its unit is mm, which makes a building of {size / 1000:.3g} m: not used",
    )


def test_a_unit_given_that_is_absurd_is_refused(tmp_path):
    path = write_dxf(tmp_path / "a.dxf", WALLS, 1.0, insunits=0)
    size = np.ptp(np.array(WALLS.bounds).reshape(2, 2), axis=0).max()
    assert refusal(path, PlanOptions(unit="mm")) == (
        f"expected a building of 1.5 to 2000 m, found {size / 1000:.4g} m with --unit; it would be "
        f"{size:.3g} m with --unit m, {0.3048 * size:.3g} m with --unit ft, or leave its scale to the "
        "alignment with --unit unknown"
    )


def test_dxf_in_feet_that_says_no_unit_is_read_in_feet(tmp_path):
    path = write_dxf(tmp_path / "a.dxf", WALLS, 0.3048, insunits=0)
    plan = read_floorplan(path)
    assert plan.source.unit == "ft"
    assert max(plan.size) == pytest.approx(
        max(read_floorplan(write_dxf(tmp_path / "b.dxf", WALLS)).size)
    )
    said = refusal(path, PlanOptions(unit="mm"))
    assert f"{max(plan.size):.3g} m with --unit ft" in said


def test_a_plan_whose_numbers_are_no_metres_is_told_what_would_fit(tmp_path):
    path = tmp_path / "plan.npy"
    room = np.array(
        [[0, 0, 4000, 0], [4000, 0, 4000, 3000], [4000, 3000, 0, 3000], [0, 3000, 0, 0]]
    )
    np.save(path, room.astype(float))
    said = refusal(path)
    assert "found 4000 x 3000; it would be 40 m with --unit cm, 4 m with --unit mm, " in said
    assert "1.22e+03 m with --unit ft" in said
    assert max(read_floorplan(path, PlanOptions(unit="mm")).size) == pytest.approx(4)


def test_a_layer_that_is_not_there(tmp_path):
    path = write_dxf(tmp_path / "a.dxf", WALLS)
    assert refusal(path, PlanOptions(layers=("B-*",))) == (
        "expected a layer named 'B-*', found the layers 'A-WALL'"
    )


def test_no_walls_in_ifc(tmp_path):
    path = write_ifc(tmp_path / "a.ifc", WALLS)
    path.write_text(path.read_text().replace("IFCWALL(", "IFCSLAB("))
    n = len(shapely.get_parts(WALLS))
    assert refusal(path) == (
        f"expected walls (IfcWall), found none in {n} elements; export the architect's model, not "
        "that of the structure or the services"
    )


def test_a_storey_that_is_not_there(tmp_path):
    path = write_ifc(tmp_path / "a.ifc", WALLS, storeys=(("Ground", 0.0), ("First", 3.0)))
    for wanted in ("Attic", "\u00b2", "9" * 20):  # a small 2 is a digit, but no number
        assert refusal(path, PlanOptions(storey=wanted)) == (
            f"expected a storey '{wanted}', found 0 'Ground', 1 'First'; pass one of them"
        )
    assert refusal(path, PlanOptions(storey="9" * 5000)).endswith("; pass one of them")


def test_a_mesh_whose_triangles_have_no_size(tmp_path, recwarn):
    # They were sampled all the same: warnings of NumPy, and "none found with x up".
    lines = ["v 0 0 0", "v nan 1 0", "v 0 1 nan", "v 1 1 0", "f 1 2 3", "f 1 4 4"]
    told = refusal(wrote(tmp_path / "a.obj", "\n".join(lines)))
    assert told == "expected a mesh or a point cloud, found 2 points"
    assert not [w for w in recwarn if issubclass(w.category, RuntimeWarning)]


def test_ifc_of_another_kind(tmp_path):
    told = refusal(wrote(tmp_path / "a.ifc", "hello"))
    assert told.startswith("expected an IFC model, found a file that cannot be read (")
    assert told.endswith("); export it again")


def test_ifc_without_ifcopenshell(tmp_path, monkeypatch):
    path = write_ifc(tmp_path / "a.ifc", WALLS)
    monkeypatch.setitem(sys.modules, "ifcopenshell", None)
    assert refusal(path) == (
        "expected the package ifcopenshell to read IFC, found it missing; pip install 'planfit[ifc]'"
    )


def test_geojson_without_walls(tmp_path):
    path = write_geojson(tmp_path / "a.geojson", WALLS, kind="tree")
    n = len(shapely.get_parts(WALLS))
    assert refusal(path) == (
        f"expected walls or rooms, found {n} features of the kinds tree; rooms are polygons, walls "
        "polygons or lines that are named 'wall' in their property 'category' or 'type'"
    )


def test_geojson_with_a_number_beyond_floats_is_refused(tmp_path):
    text = (
        '{"type": "Feature", "properties": {"category": "wall"}, "geometry": '
        '{"type": "LineString", "coordinates": [[' + "9" * 400 + ", 0], [1, 1]]}}"
    )
    assert "expected walls or rooms" in refusal(wrote(tmp_path / "a.geojson", text))


@pytest.mark.parametrize("text", ["", "{", "[1]"])
def test_geojson_of_another_kind(tmp_path, text):
    assert "expected" in refusal(wrote(tmp_path / "a.geojson", text))


def test_a_damaged_archive(tmp_path):
    assert "expected an IMDF archive" in refusal(wrote(tmp_path / "a.zip", "PK"))
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
        archive.writestr("readme.txt", "hello")
    assert refusal(tmp_path / "b.zip") == (
        "expected an IMDF archive with unit.geojson, found none in it"
    )
    (tmp_path / "c").mkdir()
    assert "or a folder of IMDF with unit.geojson, found a folder" in refusal(tmp_path / "c")


def test_absurd_coordinates_and_repeated_lines_are_left_out_and_said_so(tmp_path):
    def mess(document):
        space, layer = document.modelspace(), {"layer": "A-WALL"}
        space.add_line((0, 0), (1e30, 0), dxfattribs=layer)
        space.add_line((1, 1), (1, 1), dxfattribs=layer)
        for _ in range(2):
            space.add_line((0.2, 0.2), (0.2, 0.25), dxfattribs=layer)

    clean = read_floorplan(write_dxf(tmp_path / "a.dxf", WALLS))
    plan = read_floorplan(write_dxf(tmp_path / "b.dxf", WALLS, extra=mess))
    np.testing.assert_allclose(plan.ends, clean.ends)
    assert plan.source.dropped[:3] == (
        "1 line with coordinates that are no numbers or beyond 1e9",
        "1 line without length",
        "1 line drawn twice",
    )


def test_one_stray_line_a_world_away_changes_nothing(tmp_path):
    def stray(document):
        line = ((8e8, 8e8), (8e8 + 3, 8e8))
        document.modelspace().add_line(*line, dxfattribs={"layer": "A-WALL"})

    clean = read_floorplan(write_dxf(tmp_path / "a.dxf", WALLS))
    plan = read_floorplan(write_dxf(tmp_path / "b.dxf", WALLS, extra=stray))
    np.testing.assert_allclose(plan.ends, clean.ends)


def test_a_national_grid_keeps_its_precision(tmp_path):
    far = shapely.transform(WALLS, lambda xy: xy + np.array([4468500.0, 5333100.0]))
    here, there = (
        read_floorplan(write_dxf(tmp_path / f"{i}.dxf", area))
        for i, area in enumerate((WALLS, far))
    )
    assert np.abs(there.ends).max() < 200
    on_grid = (
        there.ends @ there.source.file_from_plan[:2, :2].T + there.source.file_from_plan[:2, 2]
    )
    np.testing.assert_allclose(on_grid - (4468500.0, 5333100.0), here.ends, atol=1e-6)


def test_json_that_nests_without_end(tmp_path):
    path = wrote(tmp_path / "a.geojson", "[" * 100_000)
    assert "expected GeoJSON" in refusal(path)
    assert json.loads("[]") == []

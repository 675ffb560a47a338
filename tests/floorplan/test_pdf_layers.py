"""PDFs as CAD and office programs write them: marked content, layers that are off, transparent paths."""

import numpy as np
import pypdfium2 as pdfium
import pytest
import shapely
from numpy.testing import assert_allclose

from plan_files import write_pdf_stream
from planfit.floorplan import read_floorplan
from planfit.floorplan.formats.pdf_paths import hidden_layers

ROOM = shapely.box(100, 100, 700, 500).difference(shapely.box(110, 110, 690, 490))
UPPER = shapely.box(300, 110, 310, 490)


def filled(area, colour="0 0 0"):
    rings = [part.exterior for part in shapely.get_parts(area)]
    rings += [ring for part in shapely.get_parts(area) for ring in part.interiors]
    words = [f"{colour} rg"]
    for ring in rings:
        (x, y), *rest = ring.coords
        words += [f"{x} {y} m", *(f"{u} {v} l" for u, v in rest[:-1]), "h"]
    return " ".join([*words, "f*"])


def groups(names, settings):
    """Objects 6, 7, ... and the words of the catalog for layers of these names."""
    objects = tuple(f"<< /Type /OCG /Name ({name}) >>" for name in names)
    listed = " ".join(f"{6 + i} 0 R" for i in range(len(names)))
    return objects, f"/OCProperties << /OCGs [{listed}] /D << {settings} >> >>"


def two_layers(tmp_path, settings, names=("WALLS", "WALLS UPPER"), stream=None):
    objects, catalog = groups(names, settings)
    stream = stream or (f"/OC /MC0 BDC {filled(ROOM)} EMC /OC /MC1 BDC {filled(UPPER)} EMC")
    return write_pdf_stream(
        tmp_path / "a.pdf", stream, extra_objects=objects, catalog=catalog,
        resources="/Properties << /MC0 6 0 R /MC1 7 0 R >>",
    )  # fmt: skip


def length(plan):
    return float(plan.lengths.sum())


@pytest.mark.parametrize(
    "mark", ["/P << /MCID 0 >> BDC", "/Artifact BMC", "/Artifact << /Type /Layout >> BDC"]
)
def test_marked_content_is_read(tmp_path, mark):
    plan = read_floorplan(write_pdf_stream(tmp_path / "a.pdf", f"{mark} {filled(ROOM)} EMC"))
    assert len(plan) == 8
    assert_allclose(plan.size, (600, 400), atol=0.01)


def test_objects_have_the_names_of_their_layers(tmp_path):
    plan = read_floorplan(two_layers(tmp_path, "", names=("A-WALL", "A-WALL-PRTN")))
    assert plan.source.layers == ("A-WALL", "A-WALL-PRTN")
    assert length(plan) > 2 * (600 + 400) + 2 * (580 + 380) + 600


@pytest.mark.parametrize("settings", ["/OFF [7 0 R]", "/BaseState /OFF /ON [6 0 R]"])
def test_layers_that_are_off_are_left_out_and_named(tmp_path, settings):
    plan = read_floorplan(two_layers(tmp_path, settings))
    assert len(plan) == 8
    assert "layers that are off or frozen: WALLS UPPER" in plan.source.dropped


def test_a_form_is_on_the_layer_that_it_is_drawn_on(tmp_path):
    inner = filled(UPPER)
    form = (
        "<< /Type /XObject /Subtype /Form /BBox [0 0 1200 900] "
        f"/Length {len(inner)} >>\nstream\n{inner}\nendstream"
    )
    objects, catalog = groups(("WALLS", "WALLS UPPER"), "/OFF [7 0 R]")
    found = []
    for layer in ("/MC0", "/MC1"):
        path = write_pdf_stream(
            tmp_path / "a.pdf", f"/OC /MC0 BDC {filled(ROOM)} EMC /OC {layer} BDC /Fm Do EMC",
            extra_objects=(*objects, form), catalog=catalog,
            resources="/Properties << /MC0 6 0 R /MC1 7 0 R >> /XObject << /Fm 8 0 R >>",
        )  # fmt: skip
        found.append(read_floorplan(path))
    assert [plan.source.layers for plan in found] == [("WALLS",), ("WALLS",)]
    assert length(found[0]) > length(found[1]) + 700


def test_a_layer_of_one_name_with_one_that_is_shown_is_read(tmp_path):
    assert hidden_layers(two_layers(tmp_path, "/OFF [7 0 R]", ("A", "A")).read_bytes()) == set()


def test_what_is_transparent_is_not_read(tmp_path):
    clear = "<< /Type /ExtGState /ca 0 /CA 0 >>"
    path = write_pdf_stream(
        tmp_path / "a.pdf", f"{filled(ROOM)} /G gs {filled(UPPER)} 9 w 500 110 m 500 490 l S",
        extra_objects=(clear,), resources="/ExtGState << /G 6 0 R >>",
    )  # fmt: skip
    assert len(read_floorplan(path)) == 8


SLAB, FLOOR = (
    filled(shapely.box(100, 100, 700, 500)),
    filled(shapely.box(110, 110, 690, 490), "1 1 1"),
)


def form(stream):
    return (
        "<< /Type /XObject /Subtype /Form /BBox [0 0 1200 900] "
        f"/Length {len(stream)} >>\nstream\n{stream}\nendstream"
    )


@pytest.mark.parametrize("floor", [FLOOR, "/Fm Do"])
def test_a_floor_on_a_dark_slab_leaves_its_rim_as_walls(tmp_path, floor):
    """Areas hide what was drawn before them, and forms are drawn where they are called."""
    path = write_pdf_stream(
        tmp_path / "a.pdf", f"{SLAB} {floor} {filled(UPPER)}",
        extra_objects=(form(FLOOR),), resources="/XObject << /Fm 6 0 R >>",
    )  # fmt: skip
    walls = write_pdf_stream(tmp_path / "b.pdf", f"{filled(ROOM)} {filled(UPPER)}")
    slab, drawn = read_floorplan(path), read_floorplan(walls)
    assert length(slab) == pytest.approx(length(drawn), abs=0.01)
    assert length(slab) == pytest.approx(2 * (600 + 400 + 580 + 380 + 380) - 40 + 20, abs=0.1)


@pytest.mark.parametrize("order", ["before", "translucent"])
def test_an_area_hides_neither_what_comes_later_nor_what_shines_through(tmp_path, order):
    pale = "<< /Type /ExtGState /ca 0.5 /CA 0.5 >>"
    walls = f"0 0 0 rg {filled(ROOM)} {filled(UPPER)}"
    stream = f"{FLOOR} {walls}" if order == "before" else f"{walls} /G gs {FLOOR}"
    path = write_pdf_stream(
        tmp_path / "a.pdf", stream, extra_objects=(pale,), resources="/ExtGState << /G 6 0 R >>"
    )
    walls = write_pdf_stream(tmp_path / "b.pdf", walls)
    assert length(read_floorplan(path)) == pytest.approx(length(read_floorplan(walls)), abs=0.01)


def test_layers_that_cannot_be_told_are_read_and_said(tmp_path):
    path = two_layers(tmp_path, "/OFF 17")
    plan = read_floorplan(path)
    assert length(plan) > 2 * (600 + 400) + 2 * (580 + 380) + 600
    assert any(
        "which layers of the file are off could not be told" in w for w in plan.source.warnings
    )


def test_a_name_longer_than_the_buffer_is_cut_and_kept_apart(tmp_path):
    names = ("W" * 300, "X" * 300)
    plan = read_floorplan(two_layers(tmp_path, "", names))
    assert np.isfinite(plan.ends).all()
    assert length(plan) > 2 * (600 + 400) + 2 * (580 + 380) + 600


def test_other_pages_are_named_as_not_read(tmp_path):
    path = write_pdf_stream(tmp_path / "a.pdf", filled(ROOM))
    assert not any("page" in words for words in read_floorplan(path).source.dropped)
    document = pdfium.PdfDocument(path)
    document.new_page(600, 400)
    document.save(tmp_path / "two.pdf")
    plan = read_floorplan(tmp_path / "two.pdf")
    assert len(plan) == 8
    assert any("page 1 of 2 was read" in words for words in plan.source.dropped)

"""Files that once hung a reader of plans, filled the memory, or ended in a traceback: one line each now."""

from pathlib import Path

import numpy as np
import pytest
from ezdxf.filemanagement import new as new_dxf

import planfit
from planfit.cli.main import run
from planfit.errors import FloorplanError, PlanfitError, printable, told_as
from planfit.floorplan.formats import dxf, dxf_contents, pdf

BAD_PLANS = Path(__file__).parent.parent / "data" / "bad_plans"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("expo.dxf", "1,000,000,000 once blocks are drawn out"),
        ("minsert.dxf", "900,000,000 once blocks are drawn out, 900,000,000 by one insertion"),
        ("rec.dxf", "found 'a' inside itself"),
        ("pdf_laughs.pdf", "drawings repeated within drawings"),
        ("pdf-1-14.pdf", "cannot be read"),
        ("npy-1-138.npy", "expected a NumPy array"),
        ("npy_huge.npy", "expected a NumPy array"),
        ("far.ply", "cannot be read"),
        ("ply-1-18.ply", "cannot be read"),
        ("glb-3-2.glb", "cannot be read"),
        ("obj-1-16.obj", "cannot be read"),
        ("svg-1-44.svg", "cannot be read"),
        ("ifc-1-3.ifc", "cannot be read"),
        ("bigint2.geojson", "found 0 features"),
    ],
)
def test_a_bad_file_is_told_in_one_line(name, words, capsys, monkeypatch):
    if name.endswith(".ifc"):
        pytest.importorskip("ifcopenshell", reason="ifcopenshell is not installed (planfit[ifc])")
    monkeypatch.setattr(pdf, "MAX_OPEN_S", 3.0)
    assert run(["plan", str(BAD_PLANS / name)]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert words in told


def test_a_circle_larger_than_the_country_leaves_the_rest_to_read():
    plan = planfit.read_floorplan(BAD_PLANS / "circle1e+12.dxf")
    assert len(plan) >= 4
    assert np.abs(plan.ends).max() < 100.0


def test_mark_up_in_names_is_shown_as_it_is(capsys):
    assert run(["plan", str(BAD_PLANS / "markup.geojson")]) == 0
    assert "WALL[/red]x" in capsys.readouterr().out


def test_insertions_are_counted_as_they_are_drawn():
    document = new_dxf()
    inner = document.blocks.new("inner")
    for k in range(3):
        inner.add_line((0, k), (1, k))
    outer = document.blocks.new("outer")
    outer.add_blockref("inner", (0, 0))
    outer.add_blockref("inner", (0, 5), dxfattribs={"row_count": 4, "column_count": 5})
    space = document.modelspace()
    space.add_blockref("outer", (0, 0))
    space.add_line((0, 0), (1, 1))
    drawn = 3 + 3 * 20 + 1
    path = Path("plan.dxf")
    for limit in (drawn, drawn - 1):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(dxf_contents, "MAX_ENTITIES", limit)
            if limit == drawn:
                dxf_contents.check_expansion(path, document, document.modelspace())
            else:
                with pytest.raises(FloorplanError, match=f"found {drawn} once blocks"):
                    dxf_contents.check_expansion(path, document, document.modelspace())


def _nested(leaf_lines: int):
    """Blocks b0 to b4 of ten insertions each of the next, b5 with some lines; two walls beside them."""
    document = new_dxf()
    document.header["$INSUNITS"] = 6
    for k in range(6):
        block = document.blocks.new(f"b{k}")
        for j in range(leaf_lines if k == 5 else 10):
            if k == 5:
                block.add_line((0, j), (1, j))
            else:
                block.add_blockref(f"B{k + 1}", (j, j))
    space = document.modelspace()
    space.add_blockref("b0", (0, 0))
    for y in (0.0, 0.2, 5.0, 5.2):
        space.add_line((0, y), (9, y))
    return document


def test_blocks_that_hold_nothing_are_not_drawn_out(tmp_path, monkeypatch):
    inserted = []
    decompose = dxf.recursive_decompose
    monkeypatch.setattr(
        dxf, "recursive_decompose", lambda parts: (inserted.append(parts), decompose(parts))[1]
    )
    _nested(0).saveas(tmp_path / "plan.dxf")
    assert len(planfit.read_floorplan(tmp_path / "plan.dxf")) == 4
    assert inserted == []


def test_insertions_count_though_what_they_draw_is_little(tmp_path):
    _nested(1).saveas(tmp_path / "plan.dxf")
    assert dxf_contents.MAX_ENTITIES > 10**5
    with pytest.raises(
        FloorplanError, match="at most 200,000 entities and blocks within them"
    ) as told:
        planfit.read_floorplan(tmp_path / "plan.dxf")
    # 1 + 10 + ... + 10^5 insertions, 10^5 lines, four beside them.
    assert "found 211,115, 211,111 by one insertion of the block 'b0'" in str(told.value)


def test_a_file_that_holds_much_may_draw_much(monkeypatch):
    document = _nested(1)
    monkeypatch.setattr(dxf_contents, "MAX_REPEATED", 211_111 // 51 + 1)
    dxf_contents.check_expansion(Path("plan.dxf"), document, document.modelspace())
    monkeypatch.setattr(dxf_contents, "MAX_REPEATED", 100)
    with pytest.raises(FloorplanError, match="at most 200,000"):
        dxf_contents.check_expansion(Path("plan.dxf"), document, document.modelspace())


def test_a_hall_full_of_seats_may_be_drawn_out():
    document = new_dxf()
    seat = document.blocks.new("seat")
    for k in range(120):
        seat.add_line((k, 0), (k, 1))
    for k in range(2000):
        document.modelspace().add_blockref("seat", (k, 0))
    assert (
        dxf_contents.check_expansion(Path("hall.dxf"), document, document.modelspace())
        == frozenset()
    )


def test_what_libraries_raise_names_the_file_and_what_the_system_says_passes():
    path = Path("plan.obj")
    as_mesh = told_as(FloorplanError, path, "a mesh")
    with (
        pytest.raises(FloorplanError, match=r"plan.obj: expected a mesh, found .*KeyError: .faces"),
        as_mesh,
    ):
        {}["faces"]
    as_mesh = told_as(FloorplanError, path, "a mesh")
    with pytest.raises(FloorplanError, match=r"^mine$"), as_mesh:
        raise FloorplanError("mine")
    with pytest.raises(PermissionError), told_as(FloorplanError, path, "a mesh"):
        raise PermissionError(13, "Permission denied", "plan.obj")
    with pytest.raises(PlanfitError, match="KeyError: "), told_as(PlanfitError, path, "a mesh"):
        raise KeyError("a\x1b[31m\nb" * 500)


def test_control_characters_are_shown_and_letters_of_all_scripts_stay():
    assert printable("Büro – 会議室 [x]") == "Büro – 会議室 [x]"
    assert printable("a\x1b[31mb\nc\u202ed") == "a\\x1b[31mb\\nc\\u202ed"
    assert printable("a\nb", keep="\n") == "a\nb"

"""What DXF files hold besides a plan in lines is named, with what to do."""

from pathlib import Path

import ezdxf
import pytest
import shapely

from plan_files import rings_of
from planfit.errors import FloorplanError
from planfit.floorplan import read_floorplan

ROOM = shapely.box(0, 0, 8, 5).difference(shapely.box(0.3, 0.3, 7.7, 4.7))


def with_walls(space) -> None:
    for ring in rings_of(ROOM):
        space.add_lwpolyline(ring)


def save(document, tmp_path: Path) -> Path:
    document.header["$INSUNITS"] = 6
    document.saveas(tmp_path / "a.dxf")
    return tmp_path / "a.dxf"


def test_a_drawing_that_refers_to_another_file_says_so(tmp_path: Path):
    document = ezdxf.new()
    with_walls(document.modelspace())
    document.add_xref_def("..\\ARCH\\walls.dwg", "WALLS")
    document.modelspace().add_blockref("WALLS", (0, 0))
    (words,) = read_floorplan(save(document, tmp_path)).source.warnings[-1:]
    assert "shows another file" in words
    assert "..\\ARCH\\walls.dwg" in words


def test_a_reference_that_nothing_shows_is_not_told(tmp_path: Path):
    document = ezdxf.new()
    with_walls(document.modelspace())
    document.add_xref_def("walls.dwg", "WALLS")
    assert not any(
        "another file" in w for w in read_floorplan(save(document, tmp_path)).source.warnings
    )


def upright(space) -> None:
    for x in (0.0, 3.0):
        space.add_3dface([(x, 0, 0), (x + 2, 0.5, 0), (x + 2, 0.5, 3), (x, 0, 3)])


def meshes(space) -> None:
    with space.add_mesh().edit_data() as data:
        data.vertices = [(0, 0, 0), (1, 0, 0), (0, 1, 2)]
        data.faces = [(0, 1, 2)]


def polyfaces(space) -> None:
    space.add_polyface().append_face([(0, 0, 0), (1, 0, 0), (0, 1, 2)])


@pytest.mark.parametrize(("add", "words"), [
    (upright, "2 of 3DFACE"), (meshes, "1 of MESH"), (polyfaces, "1 of polyface"),
])  # fmt: skip
def test_bodies_in_space_are_named(tmp_path: Path, add, words: str):
    document = ezdxf.new()
    add(document.modelspace())
    with pytest.raises(FloorplanError, match=words):
        read_floorplan(save(document, tmp_path))
    with_walls(document.modelspace())
    plan = read_floorplan(save(document, tmp_path))
    assert any(words in w and "export the model as IFC" in w for w in plan.source.warnings)


def test_flat_faces_are_areas_and_not_named(tmp_path: Path):
    document = ezdxf.new()
    with_walls(document.modelspace())
    document.modelspace().add_3dface([(1, 1, 0), (2, 1, 0), (2, 2, 0), (1, 2, 0)])
    plan = read_floorplan(save(document, tmp_path))
    assert not any("in space" in w for w in plan.source.warnings)


def test_a_drawing_on_a_layout_alone_is_read_of_unknown_unit(tmp_path: Path):
    document = ezdxf.new()
    with_walls(document.layout("Layout1"))
    plan = read_floorplan(save(document, tmp_path))
    assert len(plan) == 8
    assert not plan.is_metric
    assert any("the layout 'Layout1' was read" in w for w in plan.source.warnings)


def test_what_is_on_a_layout_beside_the_model_is_left_alone(tmp_path: Path):
    document = ezdxf.new()
    with_walls(document.modelspace())
    for ring in rings_of(shapely.affinity.translate(ROOM, 20)):
        document.layout("Layout1").add_lwpolyline(ring)
    plan = read_floorplan(save(document, tmp_path))
    assert len(plan) == 8
    assert plan.is_metric


def test_blocks_within_blocks_on_a_layout_are_counted_too(tmp_path: Path):
    document = ezdxf.new()
    inner = document.blocks.new("B0")
    inner.add_line((0, 0), (1, 0))
    for k in range(1, 12):
        block = document.blocks.new(f"B{k}")
        for _ in range(10):
            block.add_blockref(f"B{k - 1}", (0, 0))
    document.layout("Layout1").add_blockref("B11", (0, 0))
    with pytest.raises(FloorplanError, match="once blocks are drawn out"):
        read_floorplan(save(document, tmp_path))

"""Drawings that planfit wrote, mended in a CAD program or by hand, and read again."""

import re
from dataclasses import replace
from pathlib import Path

import ezdxf
import numpy as np
import pytest
from ezdxf.math import Matrix44
from numpy.testing import assert_allclose

from planfit.errors import FloorplanError
from planfit.export.plan_files import write_plan_dxf, write_plan_svg
from planfit.floorplan import Floorplan, PlanOptions, read_floorplan
from planfit.floorplan.vector.own_drawing import FACES, LINES, OPENINGS
from planfit.synth import BuildingOptions, make_building

WRITERS = {".dxf": write_plan_dxf, ".svg": write_plan_svg}


@pytest.fixture(scope="module")
def plan() -> Floorplan:
    """A building of some rooms, a third of its faces of unknown side."""
    made = make_building(BuildingOptions(n_rooms=5, n_columns=1), np.random.default_rng(3))
    whole = made.floorplan
    is_oriented = np.arange(len(whole)) % 3 > 0
    return replace(whole, is_oriented=is_oriented, openings=np.array([[[1.0, 2.0], [1.9, 2.0]]]))


def assert_same_faces(back: Floorplan, plan: Floorplan) -> None:
    """Those of known side first, which is how they are written; ends may be swapped."""
    order = np.argsort(~plan.is_oriented, kind="stable")
    n_sure = int(plan.is_oriented.sum())
    assert (back.is_oriented == plan.is_oriented[order]).all()
    assert_allclose(back.ends.mean(axis=1), plan.ends[order].mean(axis=1), atol=1e-6)
    assert_allclose(back.lengths, plan.lengths[order], atol=1e-6)
    assert_allclose(back.normals[:n_sure], plan.normals[order][:n_sure], atol=1e-5)


@pytest.mark.parametrize("suffix", WRITERS)
@pytest.mark.parametrize("is_metric", [True, False])
def test_faces_come_back_as_they_were(plan, tmp_path: Path, suffix: str, is_metric: bool):
    far = replace(plan, ends=plan.ends + np.array([300.0, -40.0]), is_metric=is_metric)
    WRITERS[suffix](tmp_path / f"plan{suffix}", far)
    back = read_floorplan(tmp_path / f"plan{suffix}")
    assert back.is_metric == is_metric
    assert_same_faces(back, far)
    assert_allclose(back.openings, far.openings, atol=1e-6)
    assert (back.source.layers, back.source.warnings) == ((FACES, LINES), ())
    assert "written by planfit" in back.source.kind


def test_units_of_the_user_overrule_the_file(plan, tmp_path: Path):
    write_plan_dxf(tmp_path / "plan.dxf", replace(plan, is_metric=False))
    back = read_floorplan(tmp_path / "plan.dxf", PlanOptions(metres_per_unit=0.5))
    assert back.is_metric
    assert_allclose(np.sort(back.lengths), np.sort(0.5 * plan.lengths), atol=1e-9)


def test_what_was_drawn_since_is_read_or_named(plan, tmp_path: Path):
    path = tmp_path / "plan.dxf"
    write_plan_dxf(path, plan)
    document = ezdxf.readfile(path)
    space = document.modelspace()
    faces = [e for e in space if e.dxf.layer == FACES]
    space.delete_entity(faces[0])
    drawn = [(0.0, 50.0), (3.0, 50.0), (3.0, 52.0)]
    space.add_lwpolyline(drawn, dxfattribs={"layer": LINES})
    space.add_line((0, 60), (4, 60), dxfattribs={"layer": "notes"})
    document.saveas(path)
    back = read_floorplan(path)
    assert len(back) == len(plan) - 1 + 2
    mine = back.ends[:, :, 1].min(axis=1) >= 49
    assert not back.is_oriented[mine].any()
    assert mine.sum() == 2
    (words,) = back.source.dropped
    assert "4 m of lines on other layers" in words
    assert "notes" in words
    assert_allclose(back.source.dropped_lines, [[[0, 60], [4, 60]]])


def test_a_drawing_mirrored_since_keeps_free_sides_free(tmp_path: Path):
    made = make_building(BuildingOptions(n_rooms=5), np.random.default_rng(4)).floorplan
    path = tmp_path / "plan.dxf"
    write_plan_dxf(path, made)
    document = ezdxf.readfile(path)
    for entity in document.modelspace():
        entity.transform(Matrix44.scale(-1, 1, 1))
    document.saveas(path)
    back = read_floorplan(path)
    mirrored = replace(made, ends=made.ends * [-1, 1], normals=made.normals * [-1, 1])
    assert_same_faces(back, mirrored)
    assert "mirrored since" in back.source.warnings[0]


def test_layers_may_be_saved_in_another_case(plan, tmp_path: Path):
    """Or openings, which are lines too, would be read as walls."""
    path = tmp_path / "plan.dxf"
    write_plan_dxf(path, plan)
    document = ezdxf.readfile(path)
    for entity in document.modelspace():
        entity.dxf.layer = entity.dxf.layer.lower()
    document.saveas(path)
    back = read_floorplan(path)
    assert_same_faces(back, plan)
    assert_allclose(back.openings, plan.openings, atol=1e-6)
    assert back.source.dropped == ()


def test_a_page_that_a_program_gave_a_size_is_read_in_the_same_metres(plan, tmp_path: Path):
    path = tmp_path / "plan.svg"
    write_plan_svg(path, plan)
    text = path.read_text().replace("data-unit=", 'width="300mm" height="300mm" data-unit=', 1)
    path.write_text(re.sub(r"(<title>)", r"<!-- saved again -->\1", text))
    back = read_floorplan(path)
    assert back.is_metric
    assert_same_faces(back, plan)


def test_chosen_layers_are_read_as_those_of_any_drawing(plan, tmp_path: Path):
    write_plan_dxf(tmp_path / "plan.dxf", plan)
    back = read_floorplan(tmp_path / "plan.dxf", PlanOptions(layers=(FACES,)))
    assert "written by planfit" not in back.source.kind


def test_no_faces_and_storeys_are_refused(plan, tmp_path: Path):
    path = tmp_path / "plan.dxf"
    write_plan_dxf(path, plan)
    with pytest.raises(FloorplanError, match="expected no storey"):
        read_floorplan(path, PlanOptions(storey="1"))
    document = ezdxf.readfile(path)
    for entity in list(document.modelspace()):
        if entity.dxf.layer != OPENINGS:
            document.modelspace().delete_entity(entity)
    document.modelspace().add_line((0, 0), (0, 0), dxfattribs={"layer": LINES})
    document.saveas(path)
    with pytest.raises(FloorplanError, match="found none; draw them there"):
        read_floorplan(path)

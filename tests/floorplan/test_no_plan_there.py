"""Paths that hold no plan, or half of one: what is there is said, and what to give."""

import numpy as np
import pytest
from PIL import Image

from planfit.errors import FloorplanError
from planfit.floorplan import read_floorplan


def told(path) -> str:
    with pytest.raises(FloorplanError) as caught:
        read_floorplan(path)
    message = str(caught.value)
    assert len(message) < 500
    return message.removeprefix(f"{path}: ")


def test_a_folder_of_plans_names_them(tmp_path):
    for name in ("map.pgm", "map.yaml", "notes.txt"):
        (tmp_path / name).write_text("")
    assert told(tmp_path) == (
        "expected a file, or a folder of IMDF with unit.geojson, found a folder that holds map.yaml, "
        "map.pgm; give one of these"
    )


def test_a_folder_without_plans(tmp_path):
    (tmp_path / "notes.txt").write_text("")
    assert told(tmp_path).endswith("found a folder without a plan; give the file")


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("site.laz", "a cloud of points"),
        ("site.e57", "a cloud of points"),
        ("plan.heic", "a picture; save it as PNG"),
        ("plan.dgn", "export it as DXF, SVG, PDF or IFC"),
        ("plan.sh3d", "export it as SVG, DXF or PDF"),
    ],
)
def test_files_of_other_kinds(tmp_path, name, what):
    (tmp_path / name).write_text("x")
    assert what in told(tmp_path / name)


def test_json_of_another_kind(tmp_path):
    (tmp_path / "tags.json").write_text('{"tags": []}')
    assert told(tmp_path / "tags.json").startswith(
        "expected a plan in planfit's own JSON or of RoomPlan, found the parts of another program's own "
        "form, which is not read; export the plan"
    )


@pytest.mark.parametrize("is_plan", [True, False])
def test_the_picture_of_a_map_names_the_description_beside_it(tmp_path, is_plan):
    picture = np.full((200, 300), 255, dtype=np.uint8)
    if is_plan:
        for a, b in ((20, 26), (170, 176)):
            picture[a:b, 20:276] = 0
            picture[20:176, a:b] = 0
        picture[20:176, 270:276] = 0
    Image.fromarray(picture).save(tmp_path / "map.png")
    (tmp_path / "map.yaml").write_text("image: map.png\n")
    hint = "map.yaml beside it may describe it as a ROS map: give that file, which tells the scale"
    if is_plan:
        assert hint in read_floorplan(tmp_path / "map.png").source.warnings
    else:
        assert told(tmp_path / "map.png").endswith(f"; {hint}")

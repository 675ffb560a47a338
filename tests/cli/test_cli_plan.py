"""`planfit plan`: what it prints and what it writes."""

import json
from pathlib import Path

import cv2
import ezdxf
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.cli import run
from planfit.floorplan import PlanOptions, read_floorplan
from planfit.report.plots.drawing import DPI
from planfit.report.plots.plan_picture import plan_axes


@pytest.fixture(scope="module")
def picture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A room of 12 x 6 m at 50 px a metre, walls 0.4 m thick, with a door."""
    image = np.full((400, 700, 3), 255, np.uint8)
    image[50:350, 50:650] = 0
    image[70:330, 70:630] = 255
    image[330:350, 300:380] = 255
    path = tmp_path_factory.mktemp("plan") / "room.png"
    cv2.imwrite(str(path), image)
    return path


def test_it_says_what_was_found(picture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", str(picture), "--scale", "0.02"]) == 0
    said = capsys.readouterr().out
    for words in ("raster picture", "solid black", "12 x 6 m", "--scale", "2 gaps"):
        assert words in said


def test_an_unknown_scale_is_said_to_be_unknown(
    picture: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["plan", str(picture)]) == 0
    said = capsys.readouterr().out
    assert "600 x 300 units of the drawing" in said
    assert "unknown" in said


def test_overlay(picture: Path, tmp_path: Path) -> None:
    assert run(["plan", str(picture), "-o", str(tmp_path / "out.png")]) == 0
    image = cv2.imread(str(tmp_path / "out.png")).astype(int)
    axes = plan_axes(read_floorplan(picture), picture)

    def at(u: float, v: float) -> np.ndarray:
        return image[tuple((axes.at(np.array([u, v], dtype=float)) * DPI / 72).astype(int)[::-1])]

    on_face = at(200, 69.5)
    assert on_face[2] > on_face[0] + 100  # BGR: faces are orange
    assert (at(200, 200) == 255).all()
    assert (at(200, 60) == 140).all()  # a wall of the picture, made pale


def test_overlay_of_a_drawing_shows_its_line_work(tmp_path: Path) -> None:
    walls = [(0, 0, 10, 8), (0.3, 0.3, 9.7, 7.7)]
    document = ezdxf.new()
    document.header["$INSUNITS"] = 6
    space = document.modelspace()
    for x0, y0, x1, y1 in walls:
        corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        space.add_lwpolyline(corners, close=True, dxfattribs={"layer": "WALL"})
    space.add_line((2, 4), (8, 4), dxfattribs={"layer": "LINE"})  # no wall: nothing beside it
    space.add_line((2, 2), (8, 2), dxfattribs={"layer": "FURNITURE"})
    space.add_line((5, 8), (5, 100), dxfattribs={"layer": "LINE"})  # shown for half the size
    document.saveas(tmp_path / "plan.dxf")
    assert run(["plan", str(tmp_path / "plan.dxf"), "-o", str(tmp_path / "out.png")]) == 0
    image = cv2.imread(str(tmp_path / "out.png")).astype(int)
    plan = read_floorplan(tmp_path / "plan.dxf")
    axes = plan_axes(plan, tmp_path / "plan.dxf")
    assert axes.y[1] - axes.y[0] == pytest.approx(13.0, rel=0.1)  # 8 m and 5 more above
    plan_from_file = np.linalg.inv(plan.source.file_from_plan)

    def at(x: float, y: float) -> np.ndarray:
        in_plan = (plan_from_file @ [x, y, 1.0])[:2]
        u, v = (axes.at(in_plan) * DPI / 72).astype(int)
        near = image[v - 2 : v + 3, u - 2 : u + 3].reshape(-1, 3)
        return near[near.sum(axis=1).argmin()]  # the darkest about it

    grey, left_out, face = at(4.1, 4), at(4.1, 2), at(4.1, 0.3)
    assert np.ptp(grey) == 0
    assert 140 < grey[0] < 220
    assert left_out[1] < min(left_out[0], left_out[2]) - 30  # purple
    assert face[2] > face[0] + 100
    assert (at(4.1, 5) == 255).all()
    assert np.ptp(at(5, 11)) == 0
    assert at(5, 11)[0] < 220


def test_json_is_lossless(picture: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    assert run(["plan", str(picture), "-o", str(out)]) == 0
    made, back = read_floorplan(picture), read_floorplan(out)
    assert not back.is_metric
    for name in ("ends", "normals", "is_oriented", "thickness", "openings"):
        assert_array_equal(getattr(back, name), getattr(made, name))
    scaled = read_floorplan(out, PlanOptions(metres_per_unit=0.02))
    assert_allclose(scaled.size, (12.0, 6.0), atol=0.01)
    assert json.loads(out.read_text())["planfit_floorplan"] == 1


@pytest.mark.parametrize("suffix", [".svg", ".dxf"])
@pytest.mark.parametrize("scale", [["--scale", "0.02"], []], ids=["metres", "unknown"])
def test_svg_and_dxf_hold_the_faces(
    picture: Path, tmp_path: Path, suffix: str, scale: list[str]
) -> None:
    plan = read_floorplan(picture, PlanOptions(metres_per_unit=float(scale[1]) if scale else None))
    out = tmp_path / f"out{suffix}"
    assert run(["plan", str(picture), *scale, "-o", str(out)]) == 0
    back = read_floorplan(out)
    assert back.is_metric == plan.is_metric
    assert not back.source.warnings
    for name in ("normals", "is_oriented", "openings"):
        assert_allclose(getattr(back, name), getattr(plan, name), atol=1e-6)
    assert_allclose(back.ends.mean(axis=1), plan.ends.mean(axis=1), atol=1e-6)


def test_a_plan_of_segments(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    room = np.array([[0, 0, 6, 0], [6, 0, 6, 4], [6, 4, 0, 4], [0, 4, 0, 0]], dtype=float)
    np.save(tmp_path / "plan.npy", room)
    assert run(["plan", str(tmp_path / "plan.npy"), "-o", str(tmp_path / "plan.png")]) == 0
    assert "6 x 4 m" in capsys.readouterr().out
    assert cv2.imread(str(tmp_path / "plan.png")) is not None


@pytest.mark.parametrize(("name", "words"), [
    ("out.pdf", ".png, .svg, .dxf, .json"), ("out", "no suffix"), ("room.png", "another"),
])  # fmt: skip
def test_outputs_that_cannot_be(
    picture: Path, name: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = picture.read_bytes()
    assert run(["plan", str(picture), "-o", str(picture.parent / name)]) == 2
    assert words in capsys.readouterr().err
    assert picture.read_bytes() == before


def test_a_mirrored_plan_has_left_and_right_swapped(
    picture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Faces, normals and openings; the overlay still lies on the drawing."""
    as_drawn, mirrored = read_floorplan(picture), read_floorplan(picture, PlanOptions(mirror=True))
    assert_array_equal(mirrored.ends, as_drawn.ends * [-1, 1])
    assert_array_equal(mirrored.normals, as_drawn.normals * [-1, 1])
    assert_array_equal(mirrored.openings, as_drawn.openings * [-1, 1])
    assert_array_equal(mirrored.mirrored().ends, as_drawn.ends)
    pictures = []
    for flags in ([], ["--mirror"]):
        out = tmp_path / "out.png"
        assert run(["plan", str(picture), "-o", str(out), *flags]) == 0
        pictures.append(cv2.imread(str(out)))
    assert_array_equal(*pictures)
    assert "left and right of the file are swapped" in capsys.readouterr().out

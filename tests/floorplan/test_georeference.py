"""Pictures with a place on a map or a size on paper, and scales as 1:100."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image, TiffImagePlugin

from plan_files import make_plan, write_pdf, write_svg
from planfit.cli import run
from planfit.errors import FloorplanError
from planfit.floorplan import PlanOptions, read_floorplan

WALLS, _ = make_plan(n_rooms=2)


def picture() -> np.ndarray:
    """A room, outer walls 400 x 300 px with the upper left corner of the ink at pixel edges (100, 50)."""
    image = np.full((400, 600), 255, np.uint8)
    image[50:350, 100:500] = 0
    image[70:330, 120:480] = 255
    return image


def world_file(folder: Path, text: str, name: str = "room.pgw") -> Path:
    cv2.imwrite(str(folder / "room.png"), picture())
    (folder / name).write_text(text)
    return folder / "room.png"


def corners(plan) -> tuple[np.ndarray, np.ndarray]:
    """Low and high corner of the faces."""
    points = plan.ends.reshape(-1, 2)
    return points.min(axis=0), points.max(axis=0)


@pytest.mark.parametrize("name", ["room.pgw", "room.pngw", "room.wld", "room.PGW"])
def test_a_world_file_gives_scale_and_axes(tmp_path: Path, name: str) -> None:
    """The numbers are of the first pixel's centre."""
    plan = read_floorplan(world_file(tmp_path, "0.02\n0\n0\n-0.02\n10\n20\n", name))
    assert plan.is_metric
    low, high = corners(plan)
    np.testing.assert_allclose(low, [10 + 99.5 * 0.02, 20 - 349.5 * 0.02], atol=0.01)
    np.testing.assert_allclose(high, [10 + 499.5 * 0.02, 20 - 49.5 * 0.02], atol=0.01)
    np.testing.assert_allclose(np.nanmedian(plan.thickness), 0.4, atol=0.02)
    assert name in plan.source.unit_from
    pixel = plan.source.file_from_plan @ [low[0], high[1], 1.0]
    np.testing.assert_allclose(pixel[:2], [99.5, 49.5], atol=0.6)


def test_a_turned_picture_far_away_is_moved_to_its_origin(tmp_path: Path) -> None:
    angle = np.deg2rad(30)
    a, b = 0.02 * np.cos(angle), 0.02 * np.sin(angle)
    path = world_file(tmp_path, f"{a}\n{b}\n{b}\n{-a}\n4468500.5\n5333100.25\n")
    plan = read_floorplan(path)
    assert np.abs(plan.ends).max() < 100
    assert sorted(plan.lengths)[-1] == pytest.approx(8.0, abs=0.03)
    assert "the plan frame is the map's less (" in plan.source.unit_from
    tilt = np.rad2deg(np.arctan2(*np.abs(plan.normals[np.argmax(plan.lengths)])[::-1]))
    assert tilt == pytest.approx(60, abs=0.5)


def test_degrees_and_pixels_that_are_not_square(tmp_path: Path) -> None:
    """A degree of longitude at 60 N is half as long as one of latitude."""
    side = 0.02 / 111_400
    path = world_file(tmp_path, f"{2 * side}\n0\n0\n{-side}\n25.0\n60.0\n")
    plan = read_floorplan(path)
    assert plan.size == pytest.approx((8.0, 6.0), rel=0.01)
    np.testing.assert_allclose(np.linalg.norm(plan.normals, axis=1), 1.0, atol=1e-12)


def test_the_users_scale_goes_before_a_world_file(tmp_path: Path) -> None:
    path = world_file(tmp_path, "0.02\n0\n0\n-0.02\n10\n20\n")
    assert read_floorplan(path, PlanOptions(metres_per_unit=0.01)).size[0] == pytest.approx(
        4, abs=0.02
    )
    assert not read_floorplan(path, PlanOptions(unit="unknown")).is_metric
    absurd = read_floorplan(world_file(tmp_path, "90\n0\n0\n-90\n10\n20\n"))
    assert not absurd.is_metric
    assert any(
        "makes a building of 3.6e+04 m: not used" in words for words in absurd.source.warnings
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "six numbers, found 0 numbers"), ("1\n2\n3\n", "found 3 numbers"),
        ("a b c d e f", "could not convert"), ("0 0 0 0 5 5", "found [[0.0, 0.0, 5.0]"),
        ("nan 0 0 1 5 5", "found [[nan"), ("1e300 0 0 1 5 5", "place a picture on a map"),
    ],
)  # fmt: skip
def test_bad_world_files_are_one_line(tmp_path: Path, text: str, words: str, capsys) -> None:
    path = world_file(tmp_path, text)
    assert run(["plan", str(path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"planfit: {tmp_path / 'room.pgw'}: expected")
    assert words in line


def write_geotiff(path: Path, keys: list[int], **tags: tuple[float, ...]) -> Path:
    directory = TiffImagePlugin.ImageFileDirectory_v2()
    for number, values in (
        (33550, tags.get("scale")),
        (33922, tags.get("tie")),
        (34264, tags.get("matrix")),
    ):
        if values:
            directory[number] = values
            directory.tagtype[number] = 12
    directory[34735] = tuple(keys)
    directory.tagtype[34735] = 3
    Image.fromarray(picture()).save(path, tiffinfo=directory)
    return path


@pytest.mark.parametrize(("raster_type", "shift"), [(1, 0.0), (2, 0.5)])
def test_tags_of_geotiff(tmp_path: Path, raster_type: int, shift: float) -> None:
    keys = [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, raster_type, 3076, 0, 1, 9001]
    path = write_geotiff(
        tmp_path / "a.tif", keys, scale=(0.02, 0.02, 0.0), tie=(0.0, 0.0, 0.0, 10.0, 20.0, 0.0)
    )
    plan = read_floorplan(path)
    low, high = corners(plan)
    # Of an area, the tie point is the corner of the first pixel: its edge at 100 is 2 m away.
    np.testing.assert_allclose(low[0], 10 + (100 - shift) * 0.02, atol=0.008)
    np.testing.assert_allclose(high[1], 20 - (50 - shift) * 0.02, atol=0.008)
    assert "GeoTIFF" in plan.source.unit_from


def test_geotiff_in_feet_by_a_matrix(tmp_path: Path) -> None:
    keys = [1, 1, 0, 2, 1024, 0, 1, 1, 3076, 0, 1, 9002]
    matrix = (0.1, 0, 0, 30, 0, -0.1, 0, 40, 0, 0, 0, 0, 0, 0, 0, 1.0)
    plan = read_floorplan(write_geotiff(tmp_path / "a.tif", keys, matrix=matrix))
    assert plan.size == pytest.approx((400 * 0.03048, 300 * 0.03048), rel=0.01)


# --- scales on paper ---------------------------------------------------------------------------


def test_a_scale_on_paper(tmp_path: Path, capsys) -> None:
    pdf = write_pdf(tmp_path / "a.pdf", WALLS, points_per_metre=72 / 0.0254 / 100)
    svg = write_svg(tmp_path / "a.svg", WALLS, units_per_metre=96 / 0.0254 / 50)
    true_m = np.ptp(np.array(WALLS.bounds).reshape(2, 2), axis=0)
    for path, scale in ((pdf, "1:100"), (svg, "1 : 50"), (svg, "1/50")):
        out = tmp_path / "out.json"
        assert run(["plan", str(path), "--scale", scale, "-o", str(out)]) == 0
        plan = read_floorplan(out)
        assert plan.is_metric
        np.testing.assert_allclose(plan.size, true_m, rtol=0.01)
    Image.fromarray(picture()).save(tmp_path / "a.png", dpi=(254, 254))
    plan = read_floorplan(tmp_path / "a.png", PlanOptions(paper_scale=100))
    assert plan.size == pytest.approx((4.0, 3.0), abs=0.02)
    Image.fromarray(picture()).save(tmp_path / "a.png", dpi=(72, 72))
    plan = read_floorplan(tmp_path / "a.png", PlanOptions(paper_scale=100))
    assert any("72 dpi" in words for words in plan.source.warnings)


@pytest.mark.parametrize("scale", ["1:0", "1:x", "2:100", "-3", "nan", "inf", "", "1:100:2", "0"])
def test_scales_that_are_none_are_one_line(tmp_path: Path, scale: str, capsys) -> None:
    path = write_pdf(tmp_path / "a.pdf", WALLS)
    assert run(["plan", str(path), f"--scale={scale}"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "expected" in line


def test_files_without_a_size_on_paper(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([[0, 0, 5, 0], [0, 0, 0, 5.0]]))
    Image.fromarray(picture()).save(tmp_path / "a.png")
    (tmp_path / "a.json").write_text(json.dumps({}))
    for name, words in (
        ("a.npy", "found .npy"),
        ("a.json", "found .json"),
        ("a.png", "found none"),
    ):
        with pytest.raises(FloorplanError, match=words):
            read_floorplan(tmp_path / name, PlanOptions(paper_scale=100))


@pytest.mark.parametrize("name", ["a.dwg", "a.DWG", "a.rvt", "a.skp"])
def test_files_to_be_converted_first(tmp_path: Path, name: str, capsys) -> None:
    (tmp_path / name).write_bytes(b"AC1032")
    assert run(["plan", str(tmp_path / name)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert any(way in line for way in ("dwg2dxf", "export it as"))

"""Plans that are none, or damaged, through the command line: one line that says what is wrong and what to do
next, exit code 2, no traceback; or the plan cleaned, and what was done to it told."""

import json
import os
import socket
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import shapely
from PIL import Image

from plan_files import (
    make_plan,
    write_dxf,
    write_geojson,
    write_ifc,
    write_pdf,
    write_pdf_stream,
    write_svg,
)
from planfit.cli import run

WALLS, _ = make_plan(n_rooms=3)
XLINK = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
PLANS = (
    Path(os.environ.get("PLANFIT_SHARED", Path(__file__).parents[2].parent / "shared" / "data"))
    / "floorplans"
)


def photograph(height: int = 300, width: int = 400) -> np.ndarray:
    """A cat on a sofa, as far as a program can tell: soft blobs, fur, stripes, whiskers, grain; BGR."""
    rng = np.random.default_rng(5)
    v, u = np.mgrid[:height, :width] / height
    image = np.stack([120 + 40 * np.sin(5 * u + 3 * v), 130 + 30 * np.cos(6 * v), 110 + 40 * u], 2)

    def paint(centre, axes, colour, angle=0.0, soft=0.01):
        shape = np.zeros((height, width), np.float32)
        at = tuple(round(c * height) for c in centre)
        size = tuple(max(round(a * height), 1) for a in axes)
        cv2.ellipse(shape, at, size, angle, 0, 360, 1.0, -1, cv2.LINE_AA)
        shape = cv2.GaussianBlur(shape, (0, 0), soft * height)[..., None]
        image[:] = image * (1 - shape) + np.array(colour) * shape

    fur = (70, 110, 160)
    paint((0.67, 0.72), (0.29, 0.25), fur)
    paint((0.67, 0.4), (0.19, 0.17), fur)
    paint((0.98, 0.78), (0.2, 0.05), fur, -40)
    for side in (-1, 1):
        paint((0.67 + 0.12 * side, 0.24), (0.05, 0.09), fur, 20 * side)
        paint((0.67 + 0.07 * side, 0.38), (0.03, 0.03), (60, 200, 190), soft=0.003)
        paint((0.67 + 0.07 * side, 0.38), (0.008, 0.028), (10, 10, 10), soft=0.003)
        for k in range(4):
            ends = [(0.67 + s * side, 0.45 + 0.02 * k * s) for s in (0.04, 0.24)]
            start, end = (tuple(round(c * height) for c in point) for point in ends)
            cv2.line(image, start, end, (230, 230, 230), 1, cv2.LINE_AA)
    for k in range(8):
        paint((0.48 + 0.05 * k, 0.68), (0.01, 0.1), (40, 70, 110), 10)
    strands = cv2.GaussianBlur(rng.normal(0, 50, (height, width)), (0, 0), 1.0)
    return np.clip(image + 2 * strands[..., None] + rng.normal(0, 4, image.shape), 0, 255).astype(
        np.uint8
    )


def _photo(path: Path) -> None:
    cv2.imwrite(str(path), photograph())


def _blank(path: Path) -> None:
    grain = np.random.default_rng(0).normal(247, 2, (600, 800))
    cv2.imwrite(str(path), np.clip(grain, 0, 255).astype(np.uint8))


def _wide(path: Path) -> None:
    Image.new("1", (30_000, 1_000), 1).save(path)


def _huge(path: Path) -> None:
    Image.new("1", (30_000, 30_000), 1).save(path)


def _corrupt_pdf(path: Path) -> None:
    data = write_pdf(path, WALLS).read_bytes()
    noise = np.random.default_rng(0).integers(0, 255, 600, dtype=np.uint8).tobytes()
    path.write_bytes(data[:100] + noise + data[700 : len(data) // 2])


def _encrypted_pdf(path: Path) -> None:
    data = write_pdf(path, WALLS).read_bytes().decode("latin-1")
    secret = "<" + "5a" * 32 + ">"
    encrypt = (
        f"/Encrypt << /Filter /Standard /V 1 /R 2 /P -4 /O {secret} /U {secret} >> /ID [<00> <00>]"
    )
    path.write_bytes(data.replace("/Root 1 0 R", f"/Root 1 0 R {encrypt}").encode("latin-1"))


def _without_walls(path: Path) -> None:
    text = write_ifc(path, WALLS).read_text()
    path.write_text(text.replace("IFCWALL(", "IFCSLAB("))


def _laughs(path: Path) -> None:
    entities = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 10))
    path.write_text(f'<!DOCTYPE svg [<!ENTITY l0 "ha">{entities}]><svg {XLINK}>&l9;</svg>')


def _laughs_by_use(path: Path) -> None:
    groups = '<g id="a0"><path d="M0 0L9 9"/></g>' + "".join(
        f'<g id="a{i}">{f"""<use xlink:href="#a{i - 1}"/>""" * 10}</g>' for i in range(1, 10)
    )
    path.write_text(f"<svg {XLINK}><defs>{groups}</defs></svg>")


def _repeats_itself(path: Path) -> None:
    path.write_text(f'<svg {XLINK}><g id="a"><path d="M0 0L9 9"/><use xlink:href="#a"/></g></svg>')


def _only_references(path: Path) -> None:
    path.write_text(f'<svg {XLINK}><use xlink:href="other.svg#walls"/></svg>')


def _absurd_lines(path: Path) -> None:
    write_dxf(path, shapely.transform(WALLS, lambda xy: xy + 1e12))


def _absurd_segments(path: Path) -> None:
    np.save(path, np.array([[0, 0, 1e30, 0], [0, 0, 0, 5], [1e30, 0, 1e30, 5]]))


def _points(path: Path) -> None:
    np.save(path, np.ones((5, 4)))


def _face_without_length(path: Path) -> None:
    face = {"ends": [[1, 1], [1, 1]], "normal": None}
    path.write_text(json.dumps({"planfit_floorplan": 1, "unit": "m", "faces": [face]}))


REFUSED: dict[str, tuple[str, Callable[[Path], object], str, str]] = {
    "a photograph": ("cat.jpg", _photo, "found", "--wall-mask"),
    "a blank page": ("blank.png", _blank, "found a blank page", "is it the right page"),
    "a blank PDF": ("a.pdf", lambda p: write_pdf_stream(p, ""), "found no lines", "check"),
    "no walls": ("a.ifc", _without_walls, "found none", "export the architect's model"),
    "a corrupt PDF": ("a.pdf", _corrupt_pdf, "damaged", "export it again"),
    "an encrypted PDF": ("a.pdf", _encrypted_pdf, "found an encrypted one", "save it without"),
    "entities": ("a.svg", _laughs, "found an ENTITY", "save it again as plain SVG"),
    "uses of uses": ("a.svg", _laughs_by_use, "e+09 elements by repetition", "save it again"),
    "a use of itself": ("a.svg", _repeats_itself, "repeats itself", "save it again"),
    "references alone": ("a.svg", _only_references, "reference to another file", "embed"),
    "30,000 px of nothing": ("a.png", _wide, "found a blank page", "is it the right page"),
    "900 million px": ("a.png", _huge, "178 million pixels, found more", "scale it down"),
    "absurd lines": ("a.dxf", _absurd_lines, "beyond 1e9", "check"),
    "absurd segments": ("a.npy", _absurd_segments, "found 1e+30 x 5", "give --scale"),
    "points alone": ("a.npy", _points, "found none", "is it the right file?"),
    "a face without length": ("a.json", _face_without_length, "one without", "planfit help formats"),
}  # fmt: skip


@pytest.mark.parametrize("command", ["plan", "align"])
@pytest.mark.parametrize("case", REFUSED)
def test_bad_plan_is_one_clear_line(
    case: str,
    command: str,
    tmp_path: Path,
    request: pytest.FixtureRequest,
    capsys: pytest.CaptureFixture[str],
) -> None:
    name, write, found, next_step = REFUSED[case]
    write(tmp_path / name)
    out = tmp_path / "out.png"
    words = ["plan", str(tmp_path / name), "-o", str(out)]
    if command == "align":
        if case in ("a photograph", "a blank page"):
            pytest.skip("slow, and read the same way")
        out = tmp_path / "out" / "alignment.json"
        scan = request.getfixturevalue("small_scan")
        words = ["align", str(scan), str(tmp_path / name), "-o", str(tmp_path / "out")]
    assert run(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"planfit: {tmp_path / name}: expected")
    assert found in line
    assert next_step in line
    assert not out.exists()


@pytest.mark.shared
@pytest.mark.skipif(not PLANS.is_dir(), reason="no real plans: set PLANFIT_SHARED to their folder")
def test_a_real_model_without_walls_is_one_clear_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", str(PLANS / "ifc" / "no_walls.ifc")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "expected walls (IfcWall), found none" in line


def _said(path: Path, capsys: pytest.CaptureFixture[str]) -> str:
    assert run(["plan", str(path)]) == 0
    said = capsys.readouterr()
    assert not said.err
    return " ".join(said.out.split())


def test_an_absurd_unit_is_questioned_and_not_used(tmp_path: Path, capsys) -> None:
    for scale, insunits, unit in ((1.0, 4, "mm"), (0.001, 6, "m")):
        said = _said(write_dxf(tmp_path / "a.dxf", WALLS, scale, insunits), capsys)
        assert f"the file says its unit is {unit}, which makes a building of" in said
        assert "unit of the file unknown" in said


def test_a_unit_that_makes_walls_metres_thick_is_questioned(tmp_path: Path, capsys) -> None:
    """Millimetres, said to be inches: 300 m across is no absurd size, but there are no walls."""
    said = _said(write_dxf(tmp_path / "a.dxf", WALLS, 0.001, 1), capsys)
    assert "with in as the unit, no two lines are as near as the faces of a wall" in said
    assert "give --unit" in said
    assert "nan" not in said
    assert "no two lines" not in _said(write_dxf(tmp_path / "b.dxf", WALLS, 0.001, 4), capsys)


def test_coordinates_that_are_no_degrees_are_questioned(tmp_path: Path, capsys) -> None:
    path = write_geojson(tmp_path / "a.geojson", WALLS)
    assert "expected longitude" not in _said(path, capsys)
    data = json.loads(path.read_text())
    for feature in data["features"]:
        rings = feature["geometry"]["coordinates"]
        feature["geometry"]["coordinates"] = [[[1e3 * x, 1e3 * y] for x, y in r] for r in rings]
    path.write_text(json.dumps(data))
    said = _said(path, capsys)
    assert "expected longitude and latitude of a building, found coordinates up to 4.81" in said
    assert "give --unit or --scale" in said


def test_points_and_repeated_segments_are_left_out_and_said_so(tmp_path: Path, capsys) -> None:
    room = [[0, 0, 6, 0], [6, 0, 6, 4], [6, 4, 0, 4], [0, 4, 0, 0]]
    extra = [[0, 0, 6, 0], [6, 0, 0, 0], [3, 3, 3, 3]]
    np.save(tmp_path / "a.npy", np.array(room + extra, dtype=float))
    said = _said(tmp_path / "a.npy", capsys)
    assert "faces 4, " in said
    assert "1 segment without length" in said
    assert "2 segments drawn twice" in said


def test_lines_of_a_drawing_that_no_plan_has_are_said_to_be_left_out(tmp_path, capsys) -> None:
    def mess(document):
        space, layer = document.modelspace(), {"layer": "A-WALL"}
        space.add_line((0, 0), (1e30, 0), dxfattribs=layer)
        space.add_line((1, 1), (1, 1), dxfattribs=layer)
        for _ in range(2):
            space.add_line((0.2, 0.2), (0.2, 0.25), dxfattribs=layer)

    said = _said(write_dxf(tmp_path / "a.dxf", WALLS, extra=mess), capsys)
    assert "1 line with coordinates that are no numbers or beyond 1e9" in said
    assert "1 line without length" in said
    assert "1 line drawn twice" in said


def test_references_of_a_plan_are_not_followed_and_said_so(
    tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("a connection was made")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    extra = '<use xlink:href="other.svg#x"/><image href="http://example.com/a.png"/>'
    said = _said(write_svg(tmp_path / "a.svg", WALLS, extra=extra), capsys)
    assert "2 references to other files were not followed" in said

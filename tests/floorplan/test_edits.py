"""Corrections of a plan that was read, from the command line and from a file."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from planfit.cli import run
from planfit.errors import FloorplanError
from planfit.floorplan import PlanOptions, read_floorplan


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """A room of 6 x 4 m in the layout's (u, v), v being the plan's -y, and a stray face."""
    walls = [[0, 0, 6, 0], [6, 0, 6, 4], [6, 4, 0, 4], [0, 4, 0, 0], [2, 1, 3, 1]]
    np.save(tmp_path / "room.npy", np.array(walls, float))
    return tmp_path / "room.npy"


def test_faces_are_dropped_by_number_and_stay_so(room: Path, tmp_path: Path) -> None:
    edits, out = tmp_path / "edits.json", tmp_path / "out.json"
    plan = read_floorplan(room)
    stray = int(plan.lengths.argmin())
    flags = ["--drop", str(stray), "--write-edits", str(edits), "-o", str(out)]
    assert run(["plan", str(room), *flags]) == 0
    kept = np.delete(plan.ends, stray, axis=0)
    np.testing.assert_array_equal(read_floorplan(out).ends, kept)
    again = read_floorplan(room, PlanOptions(edits=edits))
    np.testing.assert_array_equal(again.ends, kept)
    assert again.fingerprint != plan.fingerprint
    assert any("1 m of faces by" in words for words in again.source.dropped)
    # Numbers may change, places do not.
    values = np.load(room)
    np.save(room, values[::-1])
    assert len(read_floorplan(room, PlanOptions(edits=edits))) == 4
    np.save(room, values[:4])
    with pytest.raises(
        FloorplanError, match="to leave out, found none; the plan is read otherwise"
    ):
        read_floorplan(room, PlanOptions(edits=edits))


@pytest.mark.parametrize("region", ["-1,-5,4,1", "-1,-5,4,-5,4,1,-1,1"])
def test_a_region_is_kept_and_faces_are_cut_at_it(room: Path, tmp_path: Path, region: str) -> None:
    edits = tmp_path / "edits.json"
    assert run(["plan", str(room), f"--keep-region={region}", "--write-edits", str(edits)]) == 0
    plan = read_floorplan(room, PlanOptions(edits=edits))
    assert plan.ends[..., 0].max() == pytest.approx(4.0)
    assert plan.lengths.sum() == pytest.approx(4 + 4 + 4 + 1)


def test_edits_of_a_picture_are_in_its_pixels(tmp_path: Path) -> None:
    image = np.full((400, 700), 255, np.uint8)
    image[50:350, 50:650] = 0
    image[70:330, 70:630] = 255
    cv2.imwrite(str(tmp_path / "room.png"), image)
    edits = tmp_path / "edits.json"
    assert (
        run(
            [
                "plan",
                str(tmp_path / "room.png"),
                "--keep-region",
                "0,0,350,400",
                "--write-edits",
                str(edits),
            ]
        )
        == 0
    )
    for scale in (None, 0.02):
        plan = read_floorplan(
            tmp_path / "room.png", PlanOptions(metres_per_unit=scale, edits=edits)
        )
        assert plan.ends[..., 0].max() == pytest.approx(350 * (scale or 1.0))


def test_what_lies_outside_of_a_region_of_a_picture_misleads_nothing(tmp_path: Path) -> None:
    """A sheet whose table has lines as thick as walls of solid black is read as the plan without it."""
    picture = np.full((700, 1100), 255, np.uint8)
    for u, v, width, height in ((60, 60, 560, 420), (60, 260, 300, 220)):
        cv2.rectangle(picture, (u, v), (u + width, v + height), 0, 14)
    alone, sheet = tmp_path / "alone.png", tmp_path / "sheet.png"
    cv2.imwrite(str(alone), picture)
    for k in range(7):
        cv2.rectangle(picture, (700, 40 + 90 * k), (1060, 100 + 90 * k), 0, 30)
    cv2.imwrite(str(sheet), picture)
    edits = tmp_path / "edits.json"
    flags = ["--keep-region", "20,20,660,540", "--write-edits", str(edits)]
    assert run(["plan", str(sheet), *flags]) == 0
    plan, asked = read_floorplan(sheet, PlanOptions(edits=edits)), read_floorplan(alone)
    np.testing.assert_allclose(np.sort(plan.lengths), np.sort(asked.lengths), atol=2.0)
    assert plan.source.kind == asked.source.kind
    assert not any("second plan" in words for words in plan.source.warnings)


@pytest.mark.parametrize("region", [
    "0,0,1e12,1e12", "-5e9,-5e9,5e9,-5e9,5e9,5e9,-5e9,5e9",
    "0,0,700,0,700,400,0,400,0,0,800,0",  # whose last stretch is a line
])  # fmt: skip
def test_a_region_beyond_all_pixels_leaves_the_picture_as_it_is(
    tmp_path: Path, region: str
) -> None:
    image = np.full((400, 700), 255, np.uint8)
    cv2.rectangle(image, (50, 50), (640, 340), 0, 20)
    path, out = tmp_path / "room.png", tmp_path / "out.json"
    cv2.imwrite(str(path), image)
    assert run(["plan", str(path), f"--keep-region={region}", "-o", str(out)]) == 0
    np.testing.assert_allclose(read_floorplan(out).ends, read_floorplan(path).ends, atol=1e-6)


def test_numbers_of_faces_are_those_of_the_region(room: Path, tmp_path: Path) -> None:
    """What `--numbers` shows with a region is what `--drop` beside that region leaves out."""
    region, out, after = "--keep-region=0.5,-4.5,7,-0.5", tmp_path / "a.json", tmp_path / "b.json"
    assert run(["plan", str(room), region, "-o", str(out)]) == 0
    shown = read_floorplan(out).ends
    assert len(shown) < len(read_floorplan(room))
    edits = tmp_path / "edits.json"
    flags = ["--drop", "1", "--write-edits", str(edits), "-o", str(after)]
    assert run(["plan", str(room), region, *flags]) == 0
    np.testing.assert_allclose(read_floorplan(after).ends, np.delete(shown, 1, axis=0))
    again = read_floorplan(room, PlanOptions(edits=edits))
    np.testing.assert_allclose(again.ends, np.delete(shown, 1, axis=0))


def test_walls_are_added(room: Path, tmp_path: Path) -> None:
    edits = tmp_path / "edits.json"
    edits.write_text(json.dumps({"planfit_edits": 1, "add": [[[3, 0], [3, -4]]]}))
    plan, before = read_floorplan(room, PlanOptions(edits=edits)), read_floorplan(room)
    assert len(plan) == len(before) + 1
    assert not plan.is_oriented[-1]
    np.testing.assert_array_equal(plan.ends[-1], [[3, 0], [3, -4]])


def test_numbers_are_drawn(room: Path, tmp_path: Path) -> None:
    pictures = []
    for flags in ([], ["--numbers"]):
        assert run(["plan", str(room), "-o", str(tmp_path / "out.png"), *flags]) == 0
        pictures.append(cv2.imread(str(tmp_path / "out.png")))
    assert (pictures[0] != pictures[1]).any()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "expected a JSON file of plan edits"), ("[]", "version 1"), ("{}", "version 1"),
        ('{"planfit_edits": 2}', "version 1"), ('{"planfit_edits": 1, "drops": []}', "version 1"),
        ('{"planfit_edits": 1, "drop": [1]}', "shape"), ('{"planfit_edits": 1, "drop": "x"}', "found"),
        ('{"planfit_edits": 1, "add": [[[0, 0], [0, 0]]]}', "without length"),
        ('{"planfit_edits": 1, "add": [[[0, 0], [1e999, 0]]]}', "finite"),
        ('{"planfit_edits": 1, "keep_regions": [[[0, 0], [1, 1]]]}', "region"),
        ('{"planfit_edits": 1, "keep_regions": [[[0, 0], [1, 1], [2, 2]]]}', "without area"),
        ('{"planfit_edits": 1, "keep_regions": [[[90, 90], [91, 90], [91, 91]]]}', "none left"),
        ("[" * 100_000, "JSON"),
    ],
)  # fmt: skip
def test_bad_edits_are_one_line(
    room: Path, tmp_path: Path, content: str, words: str, capsys
) -> None:
    edits = tmp_path / "edits.json"
    edits.write_text(content)
    assert run(["plan", str(room), "--plan-edits", str(edits)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--drop", "99"], "from 0 to 4, found 99"), (["--keep-region", "1,2"], "found '1,2'"),
        (["--keep-region", "a,b,c,d"], "found 'a,b,c,d'"), (["--keep-region", "0,0,0,5"], "--keep-region"),
        (["--write-edits", "a.json"], "found neither"),
    ],
)  # fmt: skip
def test_bad_flags_are_one_line(room: Path, flags: list[str], words: str, capsys) -> None:
    assert run(["plan", str(room), *flags]) == 2
    assert words in capsys.readouterr().err

"""Occupancy maps of ROS: cells to faces, in the axes of the map."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from planfit.cli import run
from planfit.errors import FloorplanError
from planfit.floorplan import read_floorplan
from planfit.geometry import segments

REAL = (
    Path(os.environ.get("PLANFIT_SHARED", Path(__file__).parents[2].parent / "shared" / "data"))
    / "real_files"
    / "ros_map"
)
SIDE_M = 0.05
ROOM_M = (1.0, 1.5, 6.0, 4.5)
"""Free space, x and y from and to, m from the lower left corner of the picture."""
OCCUPIED, UNKNOWN, FREE = 0, 205, 254


def cells_of_a_room(gap_cells: int = 0, rough: bool = False) -> np.ndarray:
    """A room seen from inside, 7 x 6 m of cells; `gap_cells` of unknown before its walls, or rough walls."""
    cells = np.full((120, 140), UNKNOWN, np.uint8)
    x0, y0, x1, y1 = (round(v / SIDE_M) for v in ROOM_M)
    top, bottom = 120 - y1, 120 - y0
    cells[top - 2 : bottom + 2, x0 - 2 : x1 + 2] = OCCUPIED
    cells[top:bottom, x0:x1] = UNKNOWN
    g = gap_cells
    cells[top + g : bottom - g, x0 + g : x1 - g] = FREE
    if rough:
        rng = np.random.default_rng(0)
        for u in range(x0, x1, 3):
            cells[top + rng.integers(0, 2), u] = OCCUPIED
            cells[bottom - 1 - rng.integers(0, 2), u] = OCCUPIED
    cells[20:24, :4] = FREE  # a ray that went out
    return cells


def write_map(folder: Path, cells: np.ndarray, suffix: str = ".pgm", **entries: object) -> Path:
    values = {"image": f"map{suffix}", "resolution": SIDE_M, "origin": "[0.0, 0.0, 0.0]", "negate": 0,
              "occupied_thresh": 0.65, "free_thresh": 0.196, **entries}  # fmt: skip
    Image.fromarray(cells).save(folder / f"map{suffix}")
    path = folder / "map.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in values.items() if value != ""))
    return path


def distances_to_room(plan, map_from_room: np.ndarray) -> np.ndarray:
    """Of the ends of faces to the outline of the room, m."""
    x0, y0, x1, y1 = ROOM_M
    xy = (plan.ends.reshape(-1, 2) - map_from_room[:2, 2]) @ map_from_room[:2, :2]
    return np.abs(np.stack([xy[:, 0] - x0, xy[:, 0] - x1, xy[:, 1] - y0, xy[:, 1] - y1])).min(
        axis=0
    )


@pytest.mark.parametrize("suffix", [".pgm", ".png"])
@pytest.mark.parametrize("yaw", [0.0, 1.0])
def test_faces_stand_where_free_cells_end(tmp_path: Path, suffix: str, yaw: float) -> None:
    origin = f"[2.0, -3.0, {yaw}]"
    plan = read_floorplan(write_map(tmp_path, cells_of_a_room(), suffix, origin=origin))
    c, s = np.cos(yaw), np.sin(yaw)
    map_from_room = np.array([[c, -s, 2], [s, c, -3], [0, 0, 1]])
    assert distances_to_room(plan, map_from_room).max() < 0.03
    assert plan.lengths.sum() == pytest.approx(2 * (5.0 + 3.0), rel=0.05)
    assert plan.is_oriented.all()
    assert plan.is_metric
    middle = map_from_room @ [3.5, 3.0, 1.0]
    inwards = np.einsum("ni,ni->n", middle[:2] - plan.ends.mean(axis=1), plan.normals)
    assert (inwards > 0).all()
    corner = plan.source.file_from_plan @ (map_from_room @ [1.0, 1.5, 1.0])
    np.testing.assert_allclose(corner[:2], [20 - 0.5, 120 - 30 - 0.5], atol=1e-9)


@pytest.mark.parametrize(("gap", "rough"), [(2, False), (0, True)])
def test_unknown_cells_before_a_wall_and_rough_walls(tmp_path: Path, gap: int, rough: bool) -> None:
    plan = read_floorplan(write_map(tmp_path, cells_of_a_room(gap, rough)))
    assert distances_to_room(plan, np.eye(3)).max() < 0.08
    assert plan.lengths.sum() > 0.9 * 16.0
    along = segments.directions(plan.ends)
    assert np.abs(along).max(axis=1).min() > np.cos(np.deg2rad(3))


def test_unknown_is_no_free_space_whatever_the_threshold(tmp_path: Path) -> None:
    """205 is a probability of 0.196, and 0.25 the threshold of many writers."""
    narrow = read_floorplan(write_map(tmp_path, cells_of_a_room()))
    wide = read_floorplan(write_map(tmp_path, cells_of_a_room(), free_thresh=0.25))
    np.testing.assert_allclose(wide.ends, narrow.ends)


def test_negated_raw_and_scaled_maps_say_the_same(tmp_path: Path) -> None:
    cells = cells_of_a_room()
    plain = read_floorplan(write_map(tmp_path, cells))
    negated = np.where(cells == UNKNOWN, 100, 255 - cells).astype(np.uint8)
    raw = np.select([cells == OCCUPIED, cells == FREE], [100, 0], 255).astype(np.uint8)
    scaled = np.where(cells == FREE, 250, cells).astype(np.uint8)
    for values, entries in (
        (negated, {"negate": 1}),
        (raw, {"mode": "raw"}),
        (scaled, {"mode": "scale"}),
        (cells, {"negate": "", "occupied_thresh": "", "free_thresh": "", "mode": "trinary"}),
    ):
        np.testing.assert_allclose(
            read_floorplan(write_map(tmp_path, values, **entries)).ends, plain.ends
        )


def test_forms_of_yaml(tmp_path: Path) -> None:
    write_map(tmp_path, cells_of_a_room())
    path = tmp_path / "other.yaml"
    path.write_bytes(
        b'\xef\xbb\xbf# a map\r\nimage: "/home/robot/maps/map.pgm"  # made on the robot\r\n'
        b"resolution: 5e-2\r\norigin:\r\n  - 1\r\n  - -2.5\r\n  - 0\r\n"
    )
    plan = read_floorplan(path)
    np.testing.assert_allclose(plan.ends.reshape(-1, 2).min(axis=0), [2.0, -1.0], atol=0.03)


BAD = {
    "no map": ("hello: 1\n", "expected the description of a ROS map"),
    "no image": ("resolution: 0.05\norigin: [0, 0, 0]\n", "found no image"),
    "no picture": ("image: a.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n", "beside it, found none"),
    "text": ("image: map.pgm\nresolution: fine\norigin: [0, 0, 0]\n", "found 'fine'"),
    "NaN": ("image: map.pgm\nresolution: nan\norigin: [0, 0, 0]\n", "found 'nan'"),
    "zero": ("image: map.pgm\nresolution: 0\norigin: [0, 0, 0]\n", "0.0001 to 10 m a cell, found 0"),
    "origin": ("image: map.pgm\nresolution: 0.05\norigin: 3\n", "expected origin as [x, y, yaw]"),
    "mode": ("image: map.pgm\nresolution: 0.05\norigin: [0, 0]\nmode: x\n", "mode of trinary"),
    "negate": ("image: map.pgm\nresolution: 0.05\norigin: [0, 0]\nnegate: 7\n", "negate as 0 or 1"),
    "upwards": ("image: ..\nresolution: 0.05\norigin: [0, 0]\n", "beside it, found none"),
    "NUL": ("image: a\0b\nresolution: 0.05\norigin: [0, 0]\n", "beside it, found none"),
    "thresholds": (
        "image: map.pgm\nresolution: 0.05\norigin: [0, 0]\noccupied_thresh: -1\n", "check negate and the",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_maps_are_one_line(tmp_path: Path, case: str, capsys) -> None:
    write_map(tmp_path, cells_of_a_room())
    text, words = BAD[case]
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    assert run(["plan", str(path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"planfit: {path}: expected")
    assert words in line


def refusal(path: Path) -> str | None:
    """What is said of a file that is not read; None where it is."""
    try:
        read_floorplan(path)
    except FloorplanError as error:
        return str(error)
    return None


def test_damaged_files_end_in_one_line_or_in_a_plan(tmp_path: Path) -> None:
    path = write_map(tmp_path, cells_of_a_room())
    whole = {file: file.read_bytes() for file in (path, tmp_path / "map.pgm")}
    rng = np.random.default_rng(0)
    for _ in range(60):
        for file, data in whole.items():
            spoiled = bytearray(data[: rng.integers(1, len(data) + 1)])
            for at in rng.integers(0, min(len(spoiled), 60), 2):
                spoiled[at] = rng.integers(256)
            file.write_bytes(bytes(spoiled))
            assert "\n" not in (refusal(path) or "")
            file.write_bytes(data)


def test_a_picture_beside_its_yaml_is_said_once_to_be_a_map(tmp_path: Path) -> None:
    cells = np.where(np.kron(cells_of_a_room(), np.ones((4, 4), np.uint8)) == 0, 0, 255)
    write_map(tmp_path, cells.astype(np.uint8))
    source = read_floorplan(tmp_path / "map.pgm").source
    assert sum("map.yaml beside it" in words for words in source.warnings) == 1
    assert source.dropped[0] == "no ink: all is wall"


def test_a_map_too_small_for_walls_says_what_they_would_be(tmp_path: Path) -> None:
    cells = np.full((10, 10), 254, np.uint8)
    cells[2:6, 6:8] = 0
    path = write_map(tmp_path, cells)
    with pytest.raises(FloorplanError, match=r"walls of 0.25 m and more .* 8 occupied and 92 free"):
        read_floorplan(path)


@pytest.mark.shared
@pytest.mark.skipif(not REAL.is_dir(), reason="no real maps: set PLANFIT_SHARED to their folder")
@pytest.mark.parametrize(
    ("name", "size"),
    [("tianbot_office/office", (11, 7)), ("nav2/depot", (30, 15)), ("turtlebot3/map", (5, 5))],
)
def test_real_maps(name: str, size: tuple[float, float], capsys) -> None:
    assert run(["plan", str(REAL / f"{name}.yaml")]) == 0
    assert "ROS map" in capsys.readouterr().out
    plan = read_floorplan(REAL / f"{name}.yaml")
    np.testing.assert_allclose(plan.size, size, rtol=0.12)
    assert plan.is_oriented.all()

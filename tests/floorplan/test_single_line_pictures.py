"""Pictures in which a single line stands for each wall, as maps of robots and sketches show rooms."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import shapely

from planfit.floorplan import Floorplan, read_floorplan

ROOM = [(100, 120), (360, 120), (360, 300), (100, 300)]
AROUND = [(70, 90), (390, 90), (390, 330), (70, 330)]
WALLS = [
    *zip(ROOM, [*ROOM[1:], ROOM[0]], strict=True),
    *zip(AROUND, [*AROUND[1:], AROUND[0]], strict=True),
    *(((x, 180), (x + 90, 180)) for x in range(480, 2780, 110)),
    *(((x, 260), (x + 70, 260)) for x in range(480, 2780, 130)),
    *(((x, 260), (x, 340)) for x in range(610, 2780, 260)),
]
"""A room in a ring, whose lines lie beside each other as those of thick walls do, and a corridor."""


def drawn(pen_px: int) -> np.ndarray:
    image = np.full((420, 2900, 3), 255, np.uint8)
    for first, last in WALLS:
        cv2.line(image, first, last, (20,) * 3, pen_px, cv2.LINE_AA)
    return image


def read(image: np.ndarray, tmp_path: Path) -> Floorplan:
    path = tmp_path / "lines.png"
    cv2.imwrite(str(path), image)
    return read_floorplan(path)


def test_every_line_is_read_in_the_middle_of_its_stroke_once(tmp_path: Path) -> None:
    plan = read(drawn(1), tmp_path)
    assert "single lines" in plan.source.kind
    assert any("unknown side" in warning for warning in plan.source.warnings)
    assert not plan.is_oriented.any()
    assert np.isnan(plan.thickness).all()
    lines = shapely.union_all(shapely.linestrings(plan.ends * [1.0, -1.0]))
    walls = shapely.union_all(shapely.linestrings(np.array(WALLS, dtype=float)))
    missing = shapely.length(shapely.difference(walls, shapely.buffer(lines, 0.8)))
    false = shapely.length(shapely.difference(lines, shapely.buffer(walls, 0.8)))
    assert missing < 0.03 * shapely.length(walls)
    assert false < 0.01 * shapely.length(walls)
    assert plan.lengths.sum() == pytest.approx(shapely.length(lines), rel=0.05)


def test_words_beside_lines_are_left_out(tmp_path: Path) -> None:
    image = drawn(1)
    cv2.putText(image, "2nd floor", (700, 120), 0, 1.0, (20,) * 3, 1, cv2.LINE_AA)
    plan = read(image, tmp_path)
    assert "single lines" in plan.source.kind
    is_word = (plan.ends[:, :, 1] > -120).all(axis=1) & (plan.ends[:, :, 0] > 480).all(axis=1)
    # Letters of straight strokes have the form of lines.
    assert plan.lengths[is_word].sum() < 0.05 * plan.lengths.sum()
    assert [words for words in plan.source.dropped if "letters" in words]


def test_ten_times_as_many_words_as_lines_change_none(tmp_path: Path) -> None:
    image = drawn(1)
    for x in range(480, 2780, 130):
        for y in range(40, 160, 14):
            cv2.putText(image, "Kitchen 12.5", (x, y), 0, 0.5, (20,) * 3, 1, cv2.LINE_AA)
    plan = read(image, tmp_path)
    lines = shapely.union_all(shapely.linestrings(plan.ends * [1.0, -1.0]))
    walls = shapely.union_all(shapely.linestrings(np.array(WALLS, dtype=float)))
    assert shapely.length(shapely.difference(walls, shapely.buffer(lines, 0.8))) < 1.0
    assert shapely.length(shapely.difference(lines, shapely.buffer(walls, 0.8))) < 1.0

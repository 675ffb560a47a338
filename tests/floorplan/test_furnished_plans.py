"""Furnished rooms drawn on one layer: walls stay, whatever stands at them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from furnished_plans import make_floor, shares, write_floor
from planfit.floorplan import read_floorplan
from planfit.floorplan.vector.wall_sides import CLEAR, ROOM, STEP, sides_with_room
from planfit.geometry import segments


@pytest.mark.parametrize("seed", range(200, 208))
def test_walls_of_furnished_rooms_on_one_layer_are_read(tmp_path: Path, seed: int) -> None:
    """Of 60 others recall was 0.53 to 1.00 and precision 0.78 to 1.00 before sides were told by room."""
    floor = make_floor(seed)
    recall, precision = shares(floor, read_floorplan(write_floor(tmp_path / "a.dxf", floor)).ends)
    assert recall > 0.9
    assert precision > 0.9


@pytest.mark.parametrize("seed", [302, 306, 326, 334])
def test_walls_alone_with_wide_windows_are_one_plan(tmp_path: Path, seed: int) -> None:
    """As on a layer of walls: nothing drawn joins what stands on two sides of a window. They were told as
    several storeys."""
    walls = replace(make_floor(seed), lines=[], arcs=[])
    plan = read_floorplan(write_floor(tmp_path / "a.dxf", walls))
    assert plan.source.storeys == ()
    assert not plan.source.warnings


def box(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def test_the_side_with_room_is_free() -> None:
    room, around, bed = box(0, 0, 5, 4), box(-0.4, -0.4, 5.4, 4.4), box(0.1, 0.1, 2, 3.9)
    side = sides_with_room(np.concatenate([room, around, bed]), 0.6)
    # Rings run against the clock, so that left is inside: free in the room, right of the outer faces. The
    # west side of the room has a bed all along; the bed has room inside, and outside on one side alone.
    assert side.tolist() == [1, 1, 1, 0, -1, -1, -1, -1, 1, 0, 1, 1]


@pytest.mark.parametrize("seed", range(4))
def test_sides_are_those_that_trying_each_place_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ends = np.concatenate(
        [
            rng.uniform(0, 9, (12, 1, 2)) + rng.normal(0, 1.0, (12, 2, 2)),
            *(box(x, 0, x + 2, 2) for x in (10, 12.2)),
        ]
    )
    widest = 0.5
    strings, radius = shapely.linestrings(ends), ROOM * widest / 2
    expected = []
    for line, left in zip(ends, segments.left_normals(ends), strict=True):
        count = max(int(np.ceil(np.linalg.norm(line[1] - line[0]) / (STEP * radius))), 3)
        at = (np.arange(count)[:, None] + 0.5) / count
        places = (1 - at) * line[0] + at * line[1]
        free = [
            np.mean([
                shapely.distance(shapely.Point(p + side * CLEAR * radius * left), strings).min() > radius
                for p in places
            ])
            for side in (1, -1)
        ]  # fmt: skip
        expected.append(
            1 if free[0] >= 0.1 and free[1] == 0 else -1 if free[1] >= 0.1 and free[0] == 0 else 0
        )
    assert sides_with_room(ends, widest).tolist() == expected
    assert len(set(expected)) > 1


def test_no_lines_have_no_sides() -> None:
    assert len(sides_with_room(np.zeros((0, 2, 2)), 0.5)) == 0

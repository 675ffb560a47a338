"""Columns as such: found among faces of any plan, and among the lines of drawings."""

from pathlib import Path

import cv2
import ezdxf
import numpy as np
import pytest
import shapely

from planfit.cli import run
from planfit.floorplan import Floorplan, PlanOptions, read_floorplan
from planfit.floorplan.elements import find_columns
from planfit.floorplan.raster import plan_of_picture
from planfit.floorplan.vector.closed_pieces import find_column_rings

OUTER = [(0, 0), (9, 0), (9, 6), (0, 6)]
INNER = [(0.3, 0.3), (8.7, 0.3), (8.7, 5.7), (0.3, 5.7)]


def ring(points: list[tuple[float, float]]) -> np.ndarray:
    corners = np.array(points, float)
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def square(x: float, y: float, side: float, turn_deg: float = 0.0) -> np.ndarray:
    angle = np.deg2rad(turn_deg + np.array([45.0, 135.0, 225.0, 315.0]))
    return ring(list((x, y) + side / np.sqrt(2) * np.stack([np.cos(angle), np.sin(angle)], axis=1)))


def plan_of(*rings: np.ndarray, is_metric: bool = True) -> Floorplan:
    """Faces of rings that look to the right of their course: outwards where they run counter-clockwise."""
    ends = np.concatenate(rings)
    along = ends[:, 1] - ends[:, 0]
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    normals /= np.linalg.norm(along, axis=1, keepdims=True)
    return Floorplan(
        "plan", ends, normals, np.ones(len(ends), bool), thickness=np.full(len(ends), 0.3),
        is_metric=is_metric,
    )  # fmt: skip


def test_rings_that_stand_alone_are_columns() -> None:
    walls = [ring(OUTER), ring(INNER[::-1])]
    plan = plan_of(*walls, square(3, 3, 0.4), square(6, 3, 0.5, 20.0))
    found = find_columns(plan)
    np.testing.assert_array_equal(found.face, [-1] * 8 + [0] * 4 + [1] * 4)
    np.testing.assert_allclose(found.centres, [(3, 3), (6, 3)], atol=1e-9)
    np.testing.assert_allclose(found.sizes[0], 0.4)


@pytest.mark.parametrize("other", [
    pytest.param(square(3, 3, 0.8)[::-1, ::-1], id="a shaft looks inwards"),
    pytest.param(square(3, 3, 3.0), id="too large"),
    pytest.param(ring([(3, 3), (4.4, 3), (4.4, 3.2), (3, 3.2)]), id="a piece of wall"),
    pytest.param(square(3, 3, 0.4)[:3], id="open"),
])  # fmt: skip
def test_what_is_no_column(other: np.ndarray) -> None:
    assert len(find_columns(plan_of(ring(OUTER), ring(INNER[::-1]), other)).sizes) == 0


def test_a_pier_that_a_wall_is_joined_to_is_no_column() -> None:
    pier = square(3, 3, 0.4)
    corner = pier[0, 0]
    wall = np.array([[corner, corner + np.array([0.0, 1.0])]])
    assert len(find_columns(plan_of(pier, wall)).sizes) == 0


def test_columns_without_a_unit_are_measured_in_walls() -> None:
    small, large = (
        plan_of(square(0, 0, 1.5), is_metric=False),
        plan_of(square(0, 0, 2.5), is_metric=False),
    )
    assert len(find_columns(small).sizes) == 1
    assert len(find_columns(large).sizes) == 0


def test_columns_of_a_picture_are_found_and_told(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    image = np.full((500, 800, 3), 255, np.uint8)
    cv2.rectangle(image, (50, 50), (750, 450), (0, 0, 0), 18)
    cv2.rectangle(image, (200, 180), (225, 205), (0, 0, 0), -1)
    cv2.circle(image, (500, 250), 14, (0, 0, 0), -1, cv2.LINE_AA)
    found = find_columns(plan_of_picture(image, "picture", "", PlanOptions(), "picture"))
    np.testing.assert_allclose(found.centres[np.argsort(found.centres[:, 0])],
                               [(212.5, -192.5), (500, -250)], atol=1.0)  # fmt: skip
    path, out = tmp_path / "plan.png", tmp_path / "out.png"
    assert cv2.imwrite(str(path), image)
    assert run(["plan", str(path), "-o", str(out)]) == 0
    assert "2 that stand alone, 26 to 2" in capsys.readouterr().out
    drawn = cv2.imread(str(out))
    green = (drawn == (115, 158, 0)).all(axis=2)
    assert green[: drawn.shape[0] // 2, : drawn.shape[1] // 2].any()


def lines_of(*shapes: shapely.Polygon) -> np.ndarray:
    return np.concatenate([ring(list(shape.exterior.coords)[:-1]) for shape in shapes])


def test_rings_of_loose_lines_are_columns_on_layers_of_walls() -> None:
    rng = np.random.default_rng(2)
    chamfered = shapely.box(0, 0, 0.7, 0.7).buffer(-0.06).buffer(0.06, quad_segs=1)
    round_one = shapely.Point(3, 0).buffer(0.2, quad_segs=8)
    basin = shapely.Polygon(
        [(5, 0), (5.5, 0), (5.4, 0.4), (5.1, 0.4)]
    )  # neither rectangle nor circle
    shaft = [shapely.box(7, 0, 7.6, 0.6), shapely.box(7.2, 0.2, 7.5, 0.5)]
    lines = lines_of(chamfered, round_one, basin, *shaft)
    lines = np.concatenate([lines, [[(1.0, 2.0), (6.0, 2.0)]]])
    lines = lines[rng.permutation(len(lines))]
    found = find_column_rings(lines, 0.93)
    middles = sorted(round(shape.centroid.x, 2) for shape in found)
    # The inner box of the shaft has nothing in it: it may be the column, the outer may not.
    assert middles == [0.35, 3.0, 7.35]
    assert len(find_column_rings(lines, 0.93, is_wall_layer=False)) == 0


def test_columns_on_a_layer_of_doors_are_several_alike() -> None:
    alike = [shapely.box(x, 0, x + 0.5, 0.5) for x in (0, 3, 6)]
    found = find_column_rings(lines_of(*alike, shapely.box(9, 0, 9.3, 0.3)), 0.93, False)
    assert len(found) == 3


def test_columns_of_a_drawing_beside_walls_of_two_lines(tmp_path: Path) -> None:
    document = ezdxf.new(units=ezdxf.units.M)
    space = document.modelspace()
    for corners in (OUTER, INNER):
        for start, end in ring(corners):
            space.add_line(start, end, dxfattribs={"layer": "A-WALL"})
    for side in square(4, 3, 0.4, 10.0):
        space.add_line(*side, dxfattribs={"layer": "A-WALL"})
    document.saveas(tmp_path / "plan.dxf")
    found = find_columns(read_floorplan(tmp_path / "plan.dxf"))
    np.testing.assert_allclose(found.centres, [(4, 3)], atol=1e-6)

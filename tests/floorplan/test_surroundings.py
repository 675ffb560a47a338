"""A photographed sheet on a dark desk is told from drawings of every kind."""

import cv2
import numpy as np
import pytest

from planfit.floorplan import read_floorplan
from planfit.floorplan.raster.sheet_marks import dark_sides


def sheet(fill: int = 0) -> np.ndarray:
    """Four rooms in filled walls of 12 px."""
    image = np.full((600, 800, 3), 245, np.uint8)
    for a, b in [((100, 80), (700, 520)), ((100, 80), (420, 300)), ((400, 280), (700, 520))]:
        cv2.rectangle(image, a, b, (fill, fill, fill), 12)
    image[290:310, 200:240] = 245
    image[290:310, 560:600] = 245
    image[160:200, 405:430] = 245
    return image


def on_desk(
    image: np.ndarray, turn_deg: float, shift: tuple[float, float], desk: int
) -> np.ndarray:
    h, w = image.shape[:2]
    matrix = cv2.getRotationMatrix2D((w / 2, h / 2), turn_deg, 0.9)
    matrix[:, 2] += shift
    return cv2.warpAffine(image, matrix, (w, h), borderValue=(desk, desk, desk))


@pytest.mark.parametrize("turn_deg", [0.0, 4.0, -9.0])
@pytest.mark.parametrize("desk", [15, 60, 110])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (60.0, 50.0)])
def test_a_dark_desk_is_seen(turn_deg, desk, shift):
    assert dark_sides(on_desk(sheet(), turn_deg, shift, desk)) >= 2


@pytest.mark.parametrize("fill", [0, 90])
@pytest.mark.parametrize("margin", [0, 40, 90])
def test_a_drawing_is_not(fill, margin):
    """Up to its outer walls along the rim."""
    image = sheet(fill)[max(74 - margin, 0) :, max(94 - margin, 0) :]
    assert dark_sides(image[: 452 + margin, : 612 + margin]) == 0


def test_white_on_dark_is_a_drawing():
    assert dark_sides(255 - sheet()) == 0


def test_the_doubt_is_said(tmp_path):
    for name, image, is_said in (
        ("a", sheet(), False),
        ("b", on_desk(sheet(), 3, (0, 0), 30), True),
    ):
        path = tmp_path / f"{name}.png"
        cv2.imwrite(str(path), image)
        said = [w for w in read_floorplan(path).source.warnings if "dark along" in w]
        assert bool(said) == is_said

"""Pictures of escape plans: signs, ways and panels in safety colours are no walls."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import shapely

from planfit.floorplan import read_floorplan
from planfit.floorplan.raster.sheet_marks import without_signs

GREEN, RED, BLUE = (96, 136, 0), (44, 36, 204), (180, 80, 20)
"""BGR of ISO 3864."""


def walls() -> shapely.Polygon:
    """px: a corridor between four rooms, walls of 24 and 16 px, doors of 60 px."""
    outer = shapely.box(100, 120, 900, 720).difference(shapely.box(124, 144, 876, 696))
    lines = [shapely.box(100, 340, 900, 356), shapely.box(100, 460, 900, 476),
             shapely.box(480, 120, 496, 348), shapely.box(420, 470, 436, 720)]  # fmt: skip
    doors = [
        shapely.box(u, v, u + 60, v + 40)
        for u, v in ((250, 330), (620, 330), (250, 450), (700, 450))
    ]
    return shapely.union_all([outer, *lines]).difference(
        shapely.union_all([*doors, shapely.box(90, 380, 130, 440)])
    )


def drawn(*, has_signs: bool = True) -> np.ndarray:
    image = np.full((900, 1300, 3), 255, np.uint8)
    if has_signs:
        cv2.rectangle(image, (124, 380), (860, 440), (160, 220, 130), -1)
    for part in shapely.get_parts(walls()):
        rings = [
            np.round(shapely.get_coordinates(r)).astype(np.int32) for r in shapely.get_rings(part)
        ]
        cv2.fillPoly(image, rings, (204, 204, 204))
        cv2.polylines(image, rings, isClosed=True, color=(0, 0, 0), thickness=2)
    if not has_signs:
        return image
    for k, (u, v) in enumerate(
        [(200, 200), (600, 200), (200, 560), (760, 600), (560, 400), (330, 400)]
    ):
        colour = RED if k % 2 else GREEN
        cv2.rectangle(image, (u, v), (u + 36, v + 36), colour, -1)
        cv2.rectangle(image, (u + 12, v + 12), (u + 24, v + 24), (255, 255, 255), -1)
    for v, colour in ((120, GREEN), (440, RED)):
        cv2.rectangle(image, (980, v), (1260, v + 280), colour, 14)
        cv2.putText(
            image, "IM BRANDFALL", (1000, v + 60), cv2.FONT_HERSHEY_SIMPLEX, 0.9, (0, 0, 0), 2
        )
    cv2.rectangle(image, (60, 20), (1240, 80), GREEN, -1)
    cv2.circle(image, (520, 420), 18, BLUE, -1)
    return image


def test_grey_walls_are_read_under_signs_and_ways(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), drawn())
    plan = read_floorplan(tmp_path / "a.png")
    assert plan.source.storeys == ()
    assert any("safety colours" in words for words in plan.source.warnings)
    outline = shapely.transform(walls(), lambda uv: uv * (1.0, -1.0)).boundary
    faces = shapely.multilinestrings(plan.ends)
    found = shapely.intersection(faces, shapely.buffer(outline, 6.0)).length / faces.length
    read = shapely.intersection(outline, shapely.buffer(faces, 6.0)).length / outline.length
    assert found > 0.9
    assert read > 0.7


def test_signs_are_told_on_a_sheet_of_any_size() -> None:
    for margin in (0, 400):
        image = cv2.copyMakeBorder(drawn(), *[margin] * 4, cv2.BORDER_CONSTANT, value=(255,) * 3)
        assert without_signs(image)[1]


@pytest.mark.parametrize("kind", ["greys", "green alone", "blue walls"])
def test_other_pictures_stay_as_they_are(kind: str) -> None:
    image = drawn(has_signs=False)
    if kind == "green alone":
        cv2.rectangle(image, (130, 360), (860, 450), GREEN, -1)
    if kind == "blue walls":
        image[image[..., 0] < 250] = BLUE
    cleared, has_signs = without_signs(image)
    assert not has_signs
    assert cleared is image

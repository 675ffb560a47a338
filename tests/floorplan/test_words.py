"""Words in pictures: counted, never read."""

import cv2
import numpy as np
import pytest

from planfit.floorplan import Floorplan, PlanOptions
from planfit.floorplan.raster import plan_of_picture
from planfit.floorplan.raster.words import count_words


def room(words: tuple[str, ...]) -> np.ndarray:
    image = np.full((600, 900), 255, np.uint8)
    cv2.rectangle(image, (100, 100), (800, 500), 0, 22)
    cv2.rectangle(image, (300, 200), (312, 212), 0, -1)
    for k, each in enumerate(words):
        cv2.putText(image, each, (160, 180 + 60 * k), cv2.FONT_HERSHEY_SIMPLEX, 0.7, 0, 2)
    return image


@pytest.mark.parametrize("turned", [False, True])
def test_words_are_counted_along_rows_and_columns(turned: bool) -> None:
    lines = (room(("3.45", "Kitchen", "12.50", "a")) < 128).astype(np.uint8)
    assert count_words(np.ascontiguousarray(lines.T) if turned else lines, 700.0) == 3
    assert count_words((room(()) < 128).astype(np.uint8), 700.0) == 0


def read(image: np.ndarray, options: PlanOptions) -> Floorplan:
    return plan_of_picture(np.dstack([image] * 3), "picture", "", options, "picture")


def test_what_may_tell_the_scale_is_said() -> None:
    image = room(("3.45", "7.20", "12.50", "4.15", "2.85"))
    assert "about 5 words or numbers" in read(image, PlanOptions()).source.unit_from
    assert "words" not in read(room(()), PlanOptions()).source.unit_from
    assert "words" not in read(image, PlanOptions(metres_per_unit=0.01)).source.unit_from

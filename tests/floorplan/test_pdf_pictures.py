"""A page that is a picture goes to the reader of pictures, rendered."""

from pathlib import Path

import numpy as np
import pytest

from builders import room_plan
from plan_files import write_pdf_stream
from planfit.floorplan import PlanOptions, read_floorplan


def write_picture_page(path: Path, width: int, height: int, space: str, pixels: bytes) -> Path:
    """A page of 1200 x 900 points that one image covers."""
    image = (
        f"<< /Type /XObject /Subtype /Image /Width {width} /Height {height} /ColorSpace /{space} "
        f"/BitsPerComponent 8 /Filter /ASCIIHexDecode /Length {2 * len(pixels) + 1} >>\n"
        f"stream\n{pixels.hex()}>\nendstream"
    )
    return write_pdf_stream(
        path, "q 1200 0 0 900 0 0 cm /Im Do Q", extra_objects=(image,),
        resources="/XObject << /Im 6 0 R >>",
    )  # fmt: skip


def test_a_page_that_is_a_picture_is_rendered_and_read_as_one(tmp_path, monkeypatch):
    pixels = bytes([0, 0, 255, 255, 255, 255, 255, 255, 255, 0, 0, 0])
    path = write_picture_page(tmp_path / "a.pdf", 2, 2, "DeviceRGB", pixels)
    seen = []

    def read_image(image_bgr, name, fingerprint, options, kind):
        seen.append((image_bgr, name, fingerprint, options, kind))
        return room_plan()

    monkeypatch.setattr("planfit.floorplan.formats.picture.read_image", read_image)
    options = PlanOptions(unit="m")
    read_floorplan(path, options)
    [(picture, name, fingerprint, passed, kind)] = seen
    assert picture.shape[1:] == (1200, 3)  # 72 dpi: it has less
    assert picture.dtype == np.uint8
    # Blue at the upper left and black at the lower right, in the order blue, green, red.
    np.testing.assert_allclose(picture[24, 24], [255, 0, 0], atol=3)
    np.testing.assert_allclose(picture[-24, -24], [0, 0, 0], atol=3)
    assert name == str(path)
    assert len(fingerprint) == 16
    assert passed is options
    assert kind == "picture in a PDF"


@pytest.mark.parametrize(("pixels", "dpi"), [(500, 72), (2500, 150), (9000, 300)])
def test_a_picture_is_looked_at_as_fine_as_it_is(tmp_path, monkeypatch, pixels: int, dpi: int):
    path = write_picture_page(tmp_path / "a.pdf", pixels, 1, "DeviceGray", bytes(pixels))
    shapes = []

    def read_image(image_bgr, *_):
        shapes.append(image_bgr.shape)
        return room_plan()

    monkeypatch.setattr("planfit.floorplan.formats.picture.read_image", read_image)
    read_floorplan(path)
    np.testing.assert_allclose(shapes, [(900 * dpi / 72, 1200 * dpi / 72, 3)], atol=1)

"""A page that is a picture goes to the reader of pictures, rendered."""

from pathlib import Path

import numpy as np
import pytest

from builders import room_plan
from plan_files import write_pdf_stream
from planfit.floorplan import PlanOptions, read_floorplan


def write_picture_page(
    path: Path, width: int, height: int, space: str, pixels: bytes, drawn: str = ""
) -> Path:
    """A page of 1200 x 900 points that one image covers, with what is `drawn` over it."""
    image = (
        f"<< /Type /XObject /Subtype /Image /Width {width} /Height {height} /ColorSpace /{space} "
        f"/BitsPerComponent 8 /Filter /ASCIIHexDecode /Length {2 * len(pixels) + 1} >>\n"
        f"stream\n{pixels.hex()}>\nendstream"
    )
    return write_pdf_stream(
        path, f"q 1200 0 0 900 0 0 cm /Im Do Q {drawn}", extra_objects=(image,),
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


def plan_pixels() -> np.ndarray:
    """Walls 12 px thick, black on white: four rooms of a flat with doors."""
    pixels = np.full((900, 1200), 255, np.uint8)
    for u0, v0, u1, v1 in ((150, 150, 1050, 750), (600, 150, 612, 750), (150, 440, 1050, 452)):
        walls = np.zeros_like(pixels, dtype=bool)
        walls[v0:v1, u0:u1] = True
        if u1 - u0 > 12 and v1 - v0 > 12:
            walls[v0 + 12 : v1 - 12, u0 + 12 : u1 - 12] = False
        pixels[walls] = 0
    for u, v in ((600, 250), (600, 600)):
        pixels[v : v + 70, u : u + 12] = 255
    for u, v in ((300, 440), (800, 440), (400, 738)):
        pixels[v : v + 12, u : u + 70] = 255
    return pixels


NOTES = "\n".join(
    f"1 0 0 RG {x} {y} 140 50 re S {x + 4} {y + 4} 132 42 re S"
    for x in (20, 520, 1020)
    for y in (20, 820)
)
WALLS = "\n".join(f"0 0 0 RG {d} {d} {1200 - 2 * d} {900 - 2 * d} re S {600 - d / 40} {d} m {600 - d / 40} "
                  f"{900 - d} l S" for d in (100, 120))  # fmt: skip


@pytest.mark.parametrize("has_plan", [True, False])
def test_notes_on_a_picture_are_no_plan_and_a_plan_on_a_picture_is(
    tmp_path: Path, has_plan: bool
) -> None:
    pixels = plan_pixels() if has_plan else np.full((900, 1200), 220, np.uint8)
    drawn = NOTES if has_plan else NOTES + WALLS
    path = write_picture_page(tmp_path / "a.pdf", 1200, 900, "DeviceGray", pixels.tobytes(), drawn)
    plan = read_floorplan(path)
    if not has_plan:
        assert plan.source.kind == "PDF drawing"
        return
    assert plan.source.kind.startswith("picture in a PDF")
    assert any("line work lies on it" in words for words in plan.source.warnings)
    assert plan.source.storeys == ()
    np.testing.assert_allclose(plan.size, [900.0, 600.0], atol=2.0)

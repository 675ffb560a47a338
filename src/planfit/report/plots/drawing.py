"""What pictures are made of: lines and areas, coloured cells, words; how that is SVG inside a page, in the
page's font and colours, and a file, PNG, by PDFium."""

import base64
import ctypes
from dataclasses import dataclass, field
from functools import cache
from html import escape
from io import BytesIO
from typing import Any, Literal

import cv2
import numpy as np
import pypdfium2 as pdfium
import pypdfium2.raw as raw
import shapely
from jaxtyping import Float, UInt8
from PIL import Image, ImageFont

from planfit.pipeline.on_plan import frame_runs
from planfit.report import formatting
from planfit.report.plots import colors

PANEL_PT = 331
"""Width of a picture: half the page on a screen, the whole of it on a phone."""
FONT_PT = 8.5
DASHED, DOTTED = (4.0, 2.0), (1.0, 2.0)
_OF_PAGE = {
    colors.INK: "var(--ink)", colors.GREY: "var(--soft)", colors.LIGHT: "var(--line)",
    colors.PAPER: "var(--paper)", "": "none",
}  # fmt: skip
_UNITS = 10
"""In a point: whole numbers are short, and finer than a pixel."""


@dataclass(frozen=True)
class Clicks:
    """What is where in a picture, so that pressing it can choose a frame."""

    kind: Literal["frames", "plan"]
    """frames: x is the number of a frame; plan: x and y are in the plan frame, m, and what is pressed is the
    nearest frame."""
    box: tuple[float, float, float, float]
    """The axes as shares of the picture from its upper left: left, top, right, bottom."""
    x: tuple[float, float]
    """Values at the left and right rim of the axes."""
    y: tuple[float, float]
    """At the lower and upper rim."""


@dataclass(frozen=True)
class Box:
    """A rectangle of a drawing, pt."""

    left: float
    top: float
    right: float
    bottom: float

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, pt."""
        return self.right - self.left, self.bottom - self.top


@dataclass(frozen=True)
class Shape:
    """Lines of one kind, or areas."""

    lines: list[Float[np.ndarray, "_ 2"]]
    """pt."""
    stroke: str = ""
    """Colour of the lines; empty where there is none."""
    width_pt: float = 1.0
    dash_pt: tuple[float, ...] = ()
    fill: str = ""
    """Colour of the areas; empty where there is none. Areas are closed."""
    opacity: float = 1.0


@dataclass(frozen=True)
class Cells:
    """A grid of coloured cells."""

    idx: UInt8[np.ndarray, "rows columns"]
    """Of the palette, the upper row first."""
    palette: UInt8[np.ndarray, "c 4"]
    """Red, green, blue, and opacity."""
    box: Box


@dataclass(frozen=True)
class Words:
    """One line of text."""

    text: str
    at: tuple[float, float]
    """pt, on its base line."""
    color: str = colors.INK
    anchor: Literal["start", "middle", "end"] = "start"
    """What of the text is there."""
    is_bold: bool = False
    is_upright: bool = False
    """Read from below."""
    size_pt: float = FONT_PT
    is_fitted: bool = False
    """Whether it is as wide as `width_of` says, whatever the font."""


@dataclass
class Drawing:
    """A picture: what is drawn later covers what was drawn before. Lengths are in pt, from the upper left."""

    width_pt: float
    height_pt: float
    items: list[Shape | Cells | Words] = field(default_factory=list)
    clicks: Clicks | None = None
    """None where nothing can be pressed."""


@cache
def _font() -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(10 * FONT_PT)


def width_of(text: str) -> float:
    """About how wide a text is, pt."""
    return _font().getlength(text) / 10


def rgb_of(color: str) -> tuple[int, int, int]:
    """Red, green and blue of a colour written as #rrggbb."""
    red, green, blue = bytes.fromhex(color[1:])
    return red, green, blue


def visible_lines(
    lines: list[Float[np.ndarray, "_ 2"]] | Float[np.ndarray, "f k 2"], box: Box
) -> list[Float[np.ndarray, "_ 2"]]:
    """What of lines (pt) lies in a box, without the points that nobody would miss; a line is broken at points
    that are not finite."""
    # A line along the rim is seen by half of its width.
    rim = box.left - 0.5, box.top - 0.5, box.right + 0.5, box.bottom + 0.5
    runs = [run for line in lines for run in _finite_runs(line) if len(run) > 1]
    shapes = np.array([shapely.linestrings(run) for run in runs], dtype=object)
    inside = shapely.simplify(shapely.clip_by_rect(shapes, *rim), 0.05)
    parts = shapely.get_parts(inside)
    return [shapely.get_coordinates(p) for p in parts[shapely.length(parts) > 0.05]]


def _finite_runs(line: Float[np.ndarray, "_ 2"]) -> list[Float[np.ndarray, "_ 2"]]:
    runs = frame_runs(np.asarray(np.isfinite(line).all(axis=1)))
    return [line[first : last + 1] for first, last in runs]


def to_svg(drawing: Drawing, attributes: str = "") -> str:
    """An element of a page; `attributes` are more of its own, as HTML."""
    width, height = (round(_UNITS * v) for v in (drawing.width_pt, drawing.height_pt))
    parts = [_WRITERS[type(item)](item) for item in drawing.items]
    return (
        f'<svg viewBox="0 0 {width} {height}" width="{width / _UNITS:g}pt" '
        f'height="{height / _UNITS:g}pt" font-size="{_UNITS * FONT_PT:g}" role="img" {attributes}>'
        f"{''.join(parts)}</svg>"
    )


def _shape(shape: Shape) -> str:
    path = "".join(_line(line, bool(shape.fill)) for line in shape.lines)
    if not path:
        return ""
    style = f'fill="{_color(shape.fill)}"'
    if shape.stroke:
        style += f' stroke="{_color(shape.stroke)}" stroke-width="{_UNITS * shape.width_pt:g}"'
    if shape.dash_pt:
        style += f' stroke-dasharray="{" ".join(f"{_UNITS * d:g}" for d in shape.dash_pt)}"'
    if shape.opacity < 1:
        style += f' opacity="{shape.opacity:g}"'
    return f'<path {style} d="{path}"/>'


def _line(points: np.ndarray, is_closed: bool) -> str:
    at = np.round(_UNITS * points).astype(int)
    steps = np.diff(at, axis=0)
    steps = steps[np.any(steps != 0, axis=1)]
    if len(steps) == 0:
        return ""
    # A minus parts numbers as a blank does.
    moves = " ".join(map(str, steps.ravel().tolist())).replace(" -", "-")
    return f"M{at[0, 0]} {at[0, 1]}l{moves}{'z' if is_closed else ''}"


def _cells(cells: Cells) -> str:
    rows, columns = cells.idx.shape
    image = Image.frombytes("P", (columns, rows), np.ascontiguousarray(cells.idx).tobytes())
    image.putpalette(cells.palette[:, :3].tobytes())
    file = BytesIO()
    image.save(file, "PNG", transparency=cells.palette[:, 3].tobytes(), optimize=True)
    data = base64.b64encode(file.getvalue()).decode("ascii")
    box = cells.box
    x, y, width, height = (round(_UNITS * v) for v in (box.left, box.top, *box.size))
    return (
        f'<image x="{x}" y="{y}" width="{width}" height="{height}" preserveAspectRatio="none" '
        f'href="data:image/png;base64,{data}"/>'
    )


def _words(words: Words) -> str:
    x, y = (round(_UNITS * v) for v in words.at)
    style = f'fill="{_color(words.color)}"'
    if words.anchor != "start":
        style += f' text-anchor="{words.anchor}"'
    if words.size_pt != FONT_PT:
        style += f' font-size="{_UNITS * words.size_pt:g}"'
    if words.is_bold:
        style += ' font-weight="bold"'
    if words.is_upright:
        style += f' transform="rotate(-90 {x} {y})"'
    if words.is_fitted:
        style += (
            f' textLength="{_UNITS * width_of(words.text):.0f}" lengthAdjust="spacingAndGlyphs"'
        )
    return f'<text x="{x}" y="{y}" {style}>{escape(words.text)}</text>'


def _color(color: str) -> str:
    return _OF_PAGE.get(color, color)


_WRITERS = {Shape: _shape, Cells: _cells, Words: _words}


DPI = 200


def to_png(picture: Drawing | UInt8[np.ndarray, "h w 3"]) -> bytes:
    """The file of a drawing, or of what `to_image` makes of drawings."""
    image = to_image(picture) if isinstance(picture, Drawing) else picture
    return cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 6])[1].tobytes()


def to_image(drawing: Drawing) -> UInt8[np.ndarray, "h w 3"]:
    """BGR, on white."""
    document = pdfium.PdfDocument.new()
    try:
        page = document.new_page(drawing.width_pt, drawing.height_pt)
        for item in drawing.items:
            part = _MAKERS[type(item)](document, item)
            # From the upper left to PDF's lower left.
            raw.FPDFPageObj_Transform(part, 1, 0, 0, -1, 0, drawing.height_pt)
            raw.FPDFPage_InsertObject(page, part)
        scale: Any = DPI / 72  # declared as a whole number, and none
        return page.render(scale, no_smoothimage=True).to_numpy().copy()
    finally:
        document.close()


def _pdf_shape(_: pdfium.PdfDocument, shape: Shape) -> Any:
    path = raw.FPDFPageObj_CreateNewPath(0, 0)
    for line in shape.lines:
        raw.FPDFPath_MoveTo(path, *line[0])
        for point in line[1:].tolist():
            raw.FPDFPath_LineTo(path, *point)
        if shape.fill:
            raw.FPDFPath_Close(path)
    opacity = round(255 * shape.opacity)
    if shape.stroke:
        raw.FPDFPageObj_SetStrokeColor(path, *rgb_of(shape.stroke), opacity)
        raw.FPDFPageObj_SetStrokeWidth(path, shape.width_pt)
        dash = (ctypes.c_float * len(shape.dash_pt))(*shape.dash_pt)
        raw.FPDFPageObj_SetDashArray(path, dash, len(dash), 0)
    if shape.fill:
        raw.FPDFPageObj_SetFillColor(path, *rgb_of(shape.fill), opacity)
    mode = raw.FPDF_FILLMODE_WINDING if shape.fill else raw.FPDF_FILLMODE_NONE
    raw.FPDFPath_SetDrawMode(path, mode, bool(shape.stroke))
    return path


def _pdf_cells(document: pdfium.PdfDocument, cells: Cells) -> Any:
    rows, columns = cells.idx.shape
    bitmap = pdfium.PdfBitmap.new_native(columns, rows, raw.FPDFBitmap_BGRA)
    bitmap.to_numpy()[:] = cells.palette[cells.idx][:, :, [2, 1, 0, 3]]
    image = raw.FPDFPageObj_NewImageObj(document)
    raw.FPDFImageObj_SetBitmap(None, 0, image, bitmap)
    box, (width, height) = cells.box, cells.box.size
    # An image is the unit square, its first row at the top.
    raw.FPDFImageObj_SetMatrix(image, width, 0, 0, -height, box.left, box.bottom)
    return image


def _pdf_words(document: pdfium.PdfDocument, words: Words) -> Any:
    font = b"Helvetica-Bold" if words.is_bold else b"Helvetica"
    text = raw.FPDFPageObj_NewTextObj(document, font, words.size_pt)
    # The fonts that every PDF may use hold these letters; others become question marks.
    shown = words.text.replace(formatting.MINUS, "\u2013").replace(formatting.SPACE, " ")
    shown = shown.encode("cp1252", "replace").decode("cp1252")
    wide = ctypes.create_string_buffer(shown.encode("utf-16-le") + b"\0\0")
    raw.FPDFText_SetText(text, ctypes.cast(wide, ctypes.POINTER(ctypes.c_ushort)))
    raw.FPDFPageObj_SetFillColor(text, *rgb_of(words.color), 255)
    left, bottom, right, top = (ctypes.c_float() for _ in range(4))
    raw.FPDFPageObj_GetBounds(text, left, bottom, right, top)
    share = {"start": 0.0, "middle": 0.5, "end": 1.0}[words.anchor]
    raw.FPDFPageObj_Transform(text, 1, 0, 0, -1, -share * right.value, 0)
    turn = (0, -1, 1, 0) if words.is_upright else (1, 0, 0, 1)
    raw.FPDFPageObj_Transform(text, *turn, *words.at)
    return text


_MAKERS = {Shape: _pdf_shape, Cells: _pdf_cells, Words: _pdf_words}

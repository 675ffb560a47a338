"""A drawing as PNG, by PDFium: as it would be printed."""

import ctypes
from typing import Any

import cv2
import numpy as np
import pypdfium2 as pdfium
import pypdfium2.raw as raw
from jaxtyping import UInt8

from planfit.report import formatting
from planfit.report.plots.drawing import Cells, Drawing, Shape, Words, rgb_of

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


def _shape(_: pdfium.PdfDocument, shape: Shape) -> Any:
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


def _cells(document: pdfium.PdfDocument, cells: Cells) -> Any:
    rows, columns = cells.idx.shape
    bitmap = pdfium.PdfBitmap.new_native(columns, rows, raw.FPDFBitmap_BGRA)
    bitmap.to_numpy()[:] = cells.palette[cells.idx][:, :, [2, 1, 0, 3]]
    image = raw.FPDFPageObj_NewImageObj(document)
    raw.FPDFImageObj_SetBitmap(None, 0, image, bitmap)
    box, (width, height) = cells.box, cells.box.size
    # An image is the unit square, its first row at the top.
    raw.FPDFImageObj_SetMatrix(image, width, 0, 0, -height, box.left, box.bottom)
    return image


def _words(document: pdfium.PdfDocument, words: Words) -> Any:
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


_MAKERS = {Shape: _shape, Cells: _cells, Words: _words}

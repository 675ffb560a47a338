"""PDF: the vector paths of a page as it is shown, or its picture where the page holds no more."""

import ctypes
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pypdfium2 as pdfium
import pypdfium2.raw as raw
import shapely
from jaxtyping import Float

from planfit.errors import FloorplanError
from planfit.floorplan.faces import groups_within
from planfit.floorplan.formats import MAX_DEPTH, fingerprint_of
from planfit.floorplan.formats.dxf_contents import MAX_ENTITIES
from planfit.floorplan.formats.pdf_paths import Clips, hidden_layers, layer_of, matrix_of, sub_paths
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.types import Floorplan
from planfit.floorplan.vector.drawing import LIGHT, DrawingBuilder, Text, VectorDrawing
from planfit.floorplan.vector.plan import plan_of_drawing
from planfit.floorplan.vector.strokes import Pen
from planfit.units import INCH_M

MIN_PARTS = 20
"""A page with fewer lines and areas, and a picture on it, is the picture."""
LARGE_PICTURE = 1 / 3
"""Of the page: what covers less is a logo, a photograph or a key map beside the drawing."""
TOGETHER = 0.05
"""Of a plan's size, the widest gap between walls of one building."""
PICTURE_DPI = (72.0, 300.0)
"""Pictures on a page are looked at as fine as they are, within this: enlarged, what is drawn beside walls
grew as thick as walls are (precision .79 instead of .92; .18 instead of .99 with a photograph beside)."""
MAX_PICTURE_PX = 10_000
MAX_OPEN_S = 15.0
MAX_OPEN_BYTES = 2_000_000_000
"""What opening a page may take."""
MAX_OBJECTS = MAX_ENTITIES
"""Objects of a page with all its forms drawn out; large plans have some hundred thousand."""
METRES_PER_POINT = INCH_M / 72
"""A point of PDF is 1/72 inch (ISO 32000-1)."""
_CANNOT_TELL = 7
_OPEN_PAGE = f"""
import sys
try:
    import pypdfium2 as pdfium
except ImportError:
    sys.exit({_CANNOT_TELL})
try:
    import resource
    resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[3]),) * 2)
except ImportError:
    pass  # Windows: time alone bounds it
try:
    pdfium.PdfDocument(sys.argv[1])[int(sys.argv[2]) - 1]
except (pdfium.PdfiumError, IndexError):
    sys.exit({_CANNOT_TELL})  # whoever reads the page tells why
"""


@dataclass(frozen=True)
class _Pictures:
    """What a page holds of pictures."""

    dpi: float
    """Of the finest, pixels an inch; 0 where there is none."""
    page_share: float
    """Of the page, what the largest covers."""


def read_pdf(path: Path, options: PlanOptions) -> Floorplan:
    """Wall faces of one page; the file's coordinates are points, from the lower left of the page as it
    is shown, y up.

    Raises:
        FloorplanError: the file is no PDF, is encrypted, has no such page, or shows no walls.
    """
    document = _open(path)
    try:
        data = path.read_bytes()
        _check_page_opens(path, options.page, data)
        if options.page > len(document):
            raise FloorplanError(
                f"{path}: expected a page {options.page}, found {len(document)} pages; "
                "pass a page that there is"
            )
        page = document[options.page - 1]
        hidden, warning = _hidden_layers(data)
        drawing, pictures = _drawing(page, path, hidden)
        n_others = len(document) - 1
        if pictures.dpi > 0 and len(drawing.lines) + len(drawing.fills) < MIN_PARTS:
            floorplan = _read_as_picture(page, path, options, pictures.dpi)
        elif pictures.page_share < LARGE_PICTURE:
            floorplan = _read_as_drawing(drawing, path, options)
        else:
            floorplan = _read_both(page, drawing, pictures, path, options)
    finally:
        document.close()
    if n_others:
        pages = f"page {options.page} of {n_others + 1} was read, the others not (--page N reads one of them)"
        source = floorplan.source
        floorplan = replace(floorplan, source=replace(source, dropped=(*source.dropped, pages)))
    return floorplan.with_warning(warning) if warning else floorplan


def _hidden_layers(data: bytes) -> tuple[frozenset[str], str]:
    """Layers that are off, and a warning where that cannot be told."""
    try:
        return hidden_layers(data), ""
    except ValueError as error:
        return frozenset(), (
            f"which layers of the file are off could not be told ({error}): all were read; if the overlay "
            "(-o FILE.png) shows walls that the page does not, print it to a new PDF"
        )


def _open(path: Path) -> pdfium.PdfDocument:
    if path.stat().st_size == 0:
        raise FloorplanError(f"{path}: expected a PDF, found an empty file; export it again")
    try:
        document = pdfium.PdfDocument(path)
        len(document)
    except pdfium.PdfiumError as error:
        if "password" in str(error).lower():
            raise FloorplanError(
                f"{path}: expected a PDF that opens without a password, found an encrypted one; "
                "save it without a password"
            ) from error
        raise FloorplanError(
            f"{path}: expected a PDF, found a file that is damaged or of another kind; "
            "export it again"
        ) from error
    return document


def _check_page_opens(path: Path, page: int, data: bytes) -> None:
    """Open a page in a process of its own first, where it may hold forms within forms.

    PDFium draws those out as it opens the page: ten levels of ten are a kilobyte in the file, and no call
    of it can be stopped.
    """
    if b"/Form" not in data and b"/ObjStm" not in data:
        return
    command = [sys.executable, "-c", _OPEN_PAGE, str(path), str(page), str(MAX_OPEN_BYTES)]
    try:
        ended = subprocess.run(command, timeout=MAX_OPEN_S, capture_output=True, check=False)
    except subprocess.TimeoutExpired:
        found = f"more than {MAX_OPEN_S:g} s"
    else:
        if ended.returncode in (0, _CANNOT_TELL):
            return
        found = f"more than {MAX_OPEN_BYTES / 1e9:.0f} GB"
    limits = f"{MAX_OPEN_S:g} s and {MAX_OPEN_BYTES / 1e9:.0f} GB"
    raise FloorplanError(
        f"{path}: expected a page that opens within {limits}, found one that takes {found} (drawings "
        "repeated within drawings?); print it to a new PDF"
    )


def _read_as_drawing(drawing: VectorDrawing, path: Path, options: PlanOptions) -> Floorplan:
    on_paper = options.on_paper(METRES_PER_POINT)
    return plan_of_drawing(drawing, path, fingerprint_of(path), on_paper, "PDF drawing", np.eye(3))


def _read_both(
    page: pdfium.PdfPage,
    drawing: VectorDrawing,
    pictures: _Pictures,
    path: Path,
    options: PlanOptions,
) -> Floorplan:
    """A page with line work over a large picture: notes on a plan, or a plan on a photograph. Of its two
    readings the one with more wall is taken, the drawing where they are nearly alike, as it is exact; what
    became of the other is told.

    Raises:
        FloorplanError: neither shows walls.
    """
    try:
        drawn = _read_as_drawing(drawing, path, options)
    except FloorplanError:
        drawn = None
    for item in list(page.get_objects(max_depth=1)):
        if raw.FPDFPageObj_GetType(item.raw) not in (raw.FPDF_PAGEOBJ_IMAGE, raw.FPDF_PAGEOBJ_FORM):
            page.remove_obj(item)
    lying = (
        f"a picture covers {pictures.page_share:.0%} of the page and line work lies on it: read as"
    )
    try:
        seen = _read_as_picture(page, path, options, pictures.dpi)
    except FloorplanError:
        if drawn is None:
            raise
        return drawn
    if drawn is None:
        return seen.with_warning(f"{lying} the picture; the line work alone shows no walls")
    drawn_pt, seen_px = (_building_length(plan) for plan in (drawn, seen))
    seen_pt = seen_px / _picture_scale(page, pictures.dpi)
    if seen_pt < 2.0 * drawn_pt:
        share = seen_pt / max(drawn_pt, 1e-9)
        return drawn.with_warning(f"{lying} line work; the picture shows {share:.0%} as much wall")
    return seen.with_warning(
        f"{lying} the picture, without what lies on it; the line work shows {drawn_pt / seen_pt:.0%} as "
        "much wall"
    )


def _building_length(plan: Floorplan) -> float:
    """Length of the faces that hang together, as those of a building do, in the file's own unit."""
    file_from_plan = plan.source.file_from_plan
    scale = 1.0 if file_from_plan is None else float(np.hypot(*file_from_plan[:2, 0]))
    group = groups_within(plan.ends, TOGETHER * max(plan.size))
    return scale * float(np.bincount(group, plan.lengths).max())


def _picture_scale(page: pdfium.PdfPage, picture_dpi: float) -> float:
    """Pixels to a point at which a page is looked at that holds pictures as fine as `picture_dpi`."""
    longer = max(page.get_size())
    return min(float(np.clip(picture_dpi, *PICTURE_DPI)) / 72.0, MAX_PICTURE_PX / longer)


def _read_as_picture(
    page: pdfium.PdfPage, path: Path, options: PlanOptions, picture_dpi: float
) -> Floorplan:
    # Here, not above: drawings need no OpenCV.
    from planfit.floorplan.formats.picture import fingerprint_with_mask, read_image

    scale = _picture_scale(page, picture_dpi)
    bitmap = page.render(scale=scale, rev_byteorder=False)  # type: ignore[arg-type] - any number
    picture = bitmap.to_numpy()[..., :3]
    fingerprint = fingerprint_with_mask(path, options)
    return read_image(
        np.ascontiguousarray(picture),
        str(path),
        fingerprint,
        options.on_paper(METRES_PER_POINT / scale),
        "picture in a PDF",
    )


def _drawing(
    page: pdfium.PdfPage, path: Path, hidden: frozenset[str]
) -> tuple[VectorDrawing, _Pictures]:
    """The line work of a page, and what it holds of pictures."""
    builder = DrawingBuilder()
    seen_hidden: set[str] = set()
    shown_from_page = _shown_from_page(page)
    picture_dpi, page_share = 0.0, 0.0
    page_area = shapely.box(0.0, 0.0, *page.get_size())
    clips = Clips()
    for n_objects, (item, transform, layer) in enumerate(_objects(page, shown_from_page), 1):
        if n_objects > MAX_OBJECTS:
            raise FloorplanError(
                f"{path}: expected a page of at most {MAX_OBJECTS:,} objects, found more once its forms are "
                "drawn out; print the floor alone to a new PDF"
            )
        kind = raw.FPDFPageObj_GetType(item)
        if layer in hidden:
            seen_hidden.add(layer)
        elif kind == raw.FPDF_PAGEOBJ_PATH:
            builder.clip = clips.of(item, transform)
            _add_path(builder, item, transform @ matrix_of(item), layer)
        elif kind == raw.FPDF_PAGEOBJ_IMAGE:
            shown_from_item = transform @ matrix_of(item)
            picture_dpi = max(picture_dpi, _image_dpi(item, shown_from_item))
            corners = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]) @ shown_from_item.T
            shown = shapely.intersection(shapely.Polygon(corners[:, :2]), page_area)
            page_share = max(page_share, shown.area / page_area.area)
    _add_texts(builder, page, shown_from_page)
    drawing = builder.build(unit="paper", hidden_layers=tuple(sorted(seen_hidden)))
    return drawing, _Pictures(picture_dpi, page_share)


def _objects(
    page: pdfium.PdfPage, shown_from_page: Float[np.ndarray, "3 3"]
) -> Iterator[tuple[Any, Float[np.ndarray, "3 3"], str]]:
    """Objects of a page and of the forms on it, in the order in which they are drawn, each with where what
    holds it is shown and its layer."""
    of_page = (raw.FPDFPage_CountObjects, raw.FPDFPage_GetObject)
    of_form = (raw.FPDFFormObj_CountObjects, raw.FPDFFormObj_GetObject)
    stack: list[Any] = [(page.raw, of_page, 0, shown_from_page, "")]
    while stack:
        owner, (count_of, object_of), first, transform, outer = stack.pop()
        for i in range(first, count_of(owner)):
            item = object_of(owner, i)
            layer = layer_of(item) or outer
            yield item, transform, layer
            is_form = raw.FPDFPageObj_GetType(item) == raw.FPDF_PAGEOBJ_FORM
            if is_form and len(stack) < MAX_DEPTH:
                stack.append((owner, (count_of, object_of), i + 1, transform, outer))
                stack.append((item, of_form, 0, transform @ matrix_of(item), layer))
                break


def _image_dpi(item, shown_from_item: Float[np.ndarray, "3 3"]) -> float:
    """Pixels of an image to an inch of the page, along the side that has more; the most that are used where
    the file does not tell."""
    width, height = ctypes.c_uint(), ctypes.c_uint()
    sides_pt = np.linalg.norm(shown_from_item[:2, :2], axis=0)
    if not raw.FPDFImageObj_GetImagePixelSize(item, width, height) or not (sides_pt > 0).all():
        return PICTURE_DPI[1]
    return float(72.0 * max(width.value / sides_pt[0], height.value / sides_pt[1]))


def _shown_from_page(page: pdfium.PdfPage) -> Float[np.ndarray, "3 3"]:
    """Undoes the page's own rotation and the corner of its box."""
    left, bottom, right, top = page.get_bbox()
    width, height = right - left, top - bottom
    to_corner = np.array([[1, 0, -left], [0, 1, -bottom], [0, 0, 1]], dtype=float)
    rotations = {
        0: np.eye(3),
        90: np.array([[0, 1, 0], [-1, 0, width], [0, 0, 1]], dtype=float),
        180: np.array([[-1, 0, width], [0, -1, height], [0, 0, 1]], dtype=float),
        270: np.array([[0, -1, height], [1, 0, 0], [0, 0, 1]], dtype=float),
    }
    return rotations[page.get_rotation() % 360] @ to_corner


def _add_path(
    builder: DrawingBuilder, item, transform: Float[np.ndarray, "3 3"], layer: str
) -> None:
    fill_mode, has_stroke = ctypes.c_int(), ctypes.c_int()
    raw.FPDFPath_GetDrawMode(item, fill_mode, has_stroke)
    if not (fill_mode.value or has_stroke.value):
        return  # clips only
    parts = sub_paths(item, transform)
    stroke = _colour(item, raw.FPDFPageObj_GetStrokeColor) if has_stroke.value else None
    fill = _colour(item, raw.FPDFPageObj_GetFillColor) if fill_mode.value else None
    if stroke is not None:
        width = ctypes.c_float()
        raw.FPDFPageObj_GetStrokeWidth(item, width)
        style = (stroke, round(width.value, 3))
        is_dashed = raw.FPDFPageObj_GetDashCount(item) > 1
        shown = width.value * float(np.sqrt(abs(np.linalg.det(transform[:2, :2]))))
        for points, is_curved in parts:
            builder.add_polyline(points, is_curved, layer, style, Pen(shown, stroke, is_dashed))
    if fill is not None:
        rings = [points for points, _ in parts]
        is_opaque = not raw.FPDFPageObj_HasTransparency(item)
        if is_opaque and stroke is None and min(fill) >= LIGHT:
            builder.add_cover(rings)
        builder.add_fill(rings, layer, fill, is_opaque)


def _colour(item, getter) -> tuple[int, int, int] | None:
    """RGB, or None of what is transparent altogether."""
    red, green, blue, alpha = (ctypes.c_uint() for _ in range(4))
    is_told = getter(item, red, green, blue, alpha)
    return None if is_told and alpha.value == 0 else (red.value, green.value, blue.value)


def _add_texts(
    builder: DrawingBuilder, page: pdfium.PdfPage, transform: Float[np.ndarray, "3 3"]
) -> None:
    text_page = page.get_textpage()
    for i in range(text_page.count_rects()):
        left, bottom, right, top = text_page.get_rect(i)
        text = text_page.get_text_bounded(left, bottom, right, top).strip()
        middle = transform @ ((left + right) / 2, (bottom + top) / 2, 1.0)
        height = min(right - left, top - bottom)
        if text:
            builder.texts.append(Text(text, middle[:2], float(height), builder.layer("")))
    text_page.close()

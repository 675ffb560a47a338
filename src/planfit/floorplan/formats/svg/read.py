"""SVG: shapes with their transforms, groups as layers, clips; nothing outside the file is loaded."""

import io
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
from jaxtyping import Bool, Float
from shapely.geometry.base import BaseGeometry
from svgelements import (
    SVG,
    Arc,
    Close,
    CubicBezier,
    Group,
    Matrix,
    Move,
    QuadraticBezier,
    Shape,
    Use,
)
from svgelements import Image as SvgImage
from svgelements import Path as SvgPath
from svgelements import Text as SvgText

from planfit.errors import FloorplanError
from planfit.floorplan.formats import fingerprint_of
from planfit.floorplan.formats.svg.css_values import (
    PX,
    covers,
    dark_ground,
    is_dashed,
    is_drawn,
    is_opaque,
    is_white,
    negative,
    rgb_of,
)
from planfit.floorplan.formats.svg.prepare import (
    GROUP_TRANSFORM,
    PARSE_ERRORS,
    drop_broken,
    flatten_transforms,
    load_safely,
    set_symbols_apart,
)
from planfit.floorplan.formats.svg.styles import apply_styles
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.types import Floorplan
from planfit.floorplan.vector.drawing import DrawingBuilder, Text, VectorDrawing
from planfit.floorplan.vector.layer_names import Role, role_of, telling_word
from planfit.floorplan.vector.line_work import SubPaths
from planfit.floorplan.vector.plan import plan_of_drawing
from planfit.floorplan.vector.regions import SelfCrossings
from planfit.floorplan.vector.strokes import Pen
from planfit.priors import PAPER_WIDTH_MOST_M
from planfit.units import INCH_M

PIXELS_PER_INCH = PX["in"]
"""Of CSS (Values and Units, level 3)."""
_LENGTH = re.compile(r"\s*[-+.\deE]+\s*(?:mm|cm|in|pt|pc|Q)\s*")
_SCALE = re.compile(r"\s*1\s*[:/]\s*(\d+(?:\.\d+)?)\s*")
MOST_WHITE = 0.3
"""A share of lines in white above this is of a drawing on dark ground."""
_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
_IFC_CLASS = re.compile(r"\bIfc[A-Z]\w+")
_URL = re.compile(r"url\(\s*['\"]?#([^)'\"]+)['\"]?\s*\)")


def read_svg(path: Path, options: PlanOptions) -> Floorplan:
    """Wall faces of an SVG; the file's coordinates are CSS pixels (96 an inch) of the picture, y down.

    Sizes in an SVG are those of the paper, so that the scale of the building is unknown unless the
    options or dimension texts tell, or the page has a width and height in millimetres or inches that no paper
    has.

    Raises:
        FloorplanError: the file is no SVG, declares entities, or shows no walls.
    """
    root, n_references = load_safely(path)
    svg, not_understood, n_broken = _parsed(root, path)
    builder = DrawingBuilder()
    shapes = list(_shown_shapes(svg))
    ground = dark_ground(svg, _own(svg), shapes)
    if ground is not None:
        for shape in shapes:
            shape.fill, shape.stroke = negative(shape.fill, ground), negative(shape.stroke, ground)
    white = [is_white(shape.stroke) for shape in shapes if is_drawn(shape.stroke)]
    hides_white = sum(white) <= MOST_WHITE * len(white)
    _add_group(builder, svg, svg, "", None, hides_white)
    drawing = builder.build(unit="paper")
    if _is_own(svg):
        drawing = _in_own_units(drawing, svg)
    elif _is_in_true_size(svg):
        metres = INCH_M / PIXELS_PER_INCH
        drawing = replace(drawing, metres_per_unit=metres, unit="1/96 in")
    elif (scale := _told_scale(svg)) is not None:
        metres = scale * INCH_M / PIXELS_PER_INCH
        drawing = replace(drawing, metres_per_unit=metres, unit=f"1/96 in at 1:{scale:g}")
    not_followed = "1 reference to another file was not followed"
    if n_references > 1:
        not_followed = f"{n_references} references to other files were not followed"
    is_empty = len(drawing.lines) == 0 and not drawing.fills
    if is_empty and any(isinstance(element, SvgImage) for element in svg.elements()):
        raise FloorplanError(
            f"{path}: expected a drawing of walls, found a picture in the SVG and no lines or areas; save "
            "the picture as PNG and give that"
        )
    if n_references and is_empty:
        raise FloorplanError(
            f"{path}: expected a drawing of walls, found no lines or areas in it; {not_followed}: "
            "embed in the SVG what they show"
        )
    # The file's y points down.
    file_from_drawing = np.diag([1.0, -1.0, 1.0])
    floorplan = plan_of_drawing(
        drawing,
        path,
        fingerprint_of(path),
        options.on_paper(INCH_M / PIXELS_PER_INCH),
        "SVG drawing",
        file_from_drawing,
    )
    if n_broken:
        words = f"{n_broken} broken elements, which draw nothing"
        dropped = (words, *floorplan.source.dropped)
        floorplan = replace(floorplan, source=replace(floorplan.source, dropped=dropped))
    for words in (*([not_followed] if n_references else []), *not_understood):
        floorplan = floorplan.with_warning(words)
    return floorplan


def _is_own(svg: SVG) -> bool:
    """Whether planfit wrote a drawing (`write_plan_svg`)."""
    return _own(svg).get("data-unit") in ("m", "unknown") and bool(
        Matrix(svg.viewbox_transform or "").a
    )


def _in_own_units(drawing: VectorDrawing, svg: SVG) -> VectorDrawing:
    """The lines of a drawing that planfit wrote in the coordinates that it wrote, wherever a program put
    the page: in metres, or in units that stay unknown."""
    shown = Matrix(svg.viewbox_transform or "")
    # y is up here, and down on the page.
    ends = (drawing.lines.ends - np.array([shown.e, -shown.f])) / shown.a
    is_metric = _own(svg)["data-unit"] == "m"
    return replace(
        drawing,
        lines=replace(drawing.lines, ends=ends),
        metres_per_unit=1.0 if is_metric else None,
        unit="m" if is_metric else "paper",
    )


def _told_scale(svg: SVG) -> float | None:
    """N of a page in units of length that says `data-scale="1:N"`, as Bonsai and IfcOpenShell write."""
    own = _own(svg)
    told = _SCALE.fullmatch(str(own.get("data-scale", "")))
    if told is None or not _has_lengths(own) or not float(told.group(1)) > 0.0:
        return None
    return float(told.group(1))


def _own(element) -> dict[str, str]:
    """Attributes of an element itself."""
    return (element.values or {}).get("attributes") or {}


def _has_lengths(own: dict[str, str]) -> bool:
    """Whether the attributes of a page give its size in units of length."""
    return all(_LENGTH.fullmatch(str(own.get(name, ""))) for name in ("width", "height"))


def _is_in_true_size(svg: SVG) -> bool:
    """Whether the page is given in units of length, and larger than any paper."""
    if not _has_lengths(_own(svg)):
        return False
    side_px = min(float(str(svg.width)), float(str(svg.height)))
    return side_px * INCH_M / PIXELS_PER_INCH > PAPER_WIDTH_MOST_M.value


def _parsed(root: ET.Element, path: Path) -> tuple[SVG, tuple[str, ...], int]:
    """The drawing, what of its styles was not understood, and how many elements are broken and left out."""
    try:
        not_understood = apply_styles(root)
    except FloorplanError as error:
        raise FloorplanError(f"{path}: {error}") from error
    set_symbols_apart(root)
    flatten_transforms(root)
    n_broken = 0
    try:
        svg = _drawing_of(root)
    except PARSE_ERRORS:
        n_broken = drop_broken(root, _drawing_of)
        try:
            svg = _drawing_of(root)
        except PARSE_ERRORS as error:
            raise FloorplanError(
                f"{path}: expected an SVG, found one that cannot be read ({type(error).__name__}: "
                f"{error}); save it again as plain SVG"
            ) from error
    if not isinstance(svg, SVG):
        raise FloorplanError(f"{path}: expected an SVG, found another XML file")
    return svg, not_understood, n_broken


def _drawing_of(root: ET.Element) -> object:
    text = ET.tostring(root, encoding="utf-8")
    return SVG.parse(io.BytesIO(text), reify=True, ppi=PIXELS_PER_INCH)


def _class_of(element) -> str:
    """Classes of an element: layers in drawings that Bonsai and IfcOpenShell make of models. What they see of
    doors and windows below the cut is the opening all the same."""
    words = _own(element).get("class") or ""
    is_opening = role_of(words.replace("projection", "")) == Role.OPENING
    kinds = _IFC_CLASS.findall(words)
    seen = " projection" if "projection" in words.split() and not is_opening else ""
    return f"{kinds[0]}{seen}" if kinds else words


def _shown(group: Group | Use) -> Iterator:
    """Elements of a group, but for those that do not show; of a group the elements in it say so."""
    for element in group:
        is_hidden = (element.values or {}).get("visibility") in ("hidden", "collapse")
        if not _is_clear(element) and (isinstance(element, Group | Use) or not is_hidden):
            yield element


def _shown_shapes(group: Group | Use) -> Iterator[Shape]:
    """Shapes of a group and those within."""
    for element in _shown(group):
        if isinstance(element, Group | Use):
            yield from _shown_shapes(element)
        elif isinstance(element, Shape):
            yield element


def _layer_of(element, layer: str) -> str:
    """The class of an element that a model gave it; else its class or id where that tells its role and the
    `layer` around it tells none."""
    kind = _class_of(element)
    if _IFC_CLASS.match(kind) and role_of(kind) != Role.UNKNOWN:
        return kind
    if role_of(layer) != Role.UNKNOWN or _IFC_CLASS.match(kind):
        # A door that is drawn in the group of its wall.
        is_in_wall = role_of(layer) == Role.WALL and role_of(telling_word(kind)) == Role.OPENING
        return telling_word(kind) if is_in_wall else layer
    # A window that holds others is one of a program.
    is_window = isinstance(element, Group) and role_of(telling_word(kind)) == Role.OPENING
    name = (_own(element).get("id") or "").replace(" ", "-")
    return ("" if is_window else telling_word(kind)) or telling_word(name) or layer


def _add_group(
    builder: DrawingBuilder,
    svg: SVG,
    group: Group | Use,
    layer: str,
    clip: BaseGeometry | None,
    hides_white: bool,
) -> None:
    """Shapes of a group and those within; `layer` is the innermost name given by a person, `hides_white`
    whether white lines hide what is under them."""
    own = _own(group)
    around = layer if group is svg else _layer_of(group, layer)
    layer = own.get(_LABEL) or _telling_id(own.get("id", "")) or around
    clip = _narrowed(svg, group, clip)
    for element in _shown(group):
        if isinstance(element, Group | Use):
            _add_group(builder, svg, element, layer, clip, hides_white)
        elif isinstance(element, Shape):
            builder.clip = _narrowed(svg, element, clip)
            _add_shape(builder, element, _layer_of(element, layer), hides_white)
        elif isinstance(element, SvgText):
            _add_text(builder, element, _layer_of(element, layer))


def _is_clear(element) -> bool:
    """Whether an element, or a group with all in it, is transparent altogether."""
    try:
        return float(str(_own(element).get("opacity", 1.0)).strip().removesuffix("%")) <= 0.0
    except ValueError:
        return False


def _telling_id(name: str) -> str:
    """Ids that programs number (`g12`, `layer1`, `path4`) say nothing."""
    numbered = r"(?i)(svg|g|group|layer|path|rect|use|surface|page)?[-_:]?\d*"
    return "" if re.fullmatch(numbered, name) else name


def _narrowed(svg: SVG, element, clip: BaseGeometry | None) -> BaseGeometry | None:
    found = _URL.match(_own(element).get("clip-path") or "")
    area = None if found is None else _clip_area(svg, found.group(1), element)
    if area is None:
        return clip
    return area if clip is None else shapely.intersection(clip, area)


def _clip_area(svg: SVG, name: str, element) -> BaseGeometry | None:
    """Area of a clipPath in the user space of the element that names it."""
    shapes = svg.get_element_by_id(name)
    if shapes is None:
        return None
    own = Matrix(element.values.get("transform") or "")
    transform = Matrix(_own(element).get(GROUP_TRANSFORM) or "") * own
    area: BaseGeometry = shapely.Polygon()
    crossings = SelfCrossings()
    for shape in shapes if isinstance(shapes, list) else []:
        if isinstance(shape, Shape):
            for points, _ in sub_paths(SvgPath(shape) * transform):
                if len(points) >= 3:
                    area = area.union(crossings.valid(shapely.Polygon(points)))
    return None if area.is_empty else area


def _add_shape(builder: DrawingBuilder, shape: Shape, layer: str, hides_white: bool) -> None:
    try:
        width = float(shape.stroke_width or 1.0) if is_drawn(shape.stroke) else 0.0
        parts = sub_paths(SvgPath(shape), width)
    except (ZeroDivisionError, ValueError, OverflowError):
        return  # an arc with a radius that is no number
    rings = [points for points, _ in parts]
    if covers(shape):
        builder.add_cover(rings)
    if hides_white and is_drawn(shape.stroke) and is_white(shape.stroke):
        # A door or window as a gap: a white line over the wall.
        for points in (ring for ring in rings if np.isfinite(ring).all()):
            gap = shapely.buffer(shapely.LineString(points), width, cap_style="flat")
            builder.add_cover([shapely.get_coordinates(r) for r in shapely.get_rings(gap)])
    elif is_drawn(shape.stroke):
        style = (str(shape.stroke), round(width, 3))
        pen = Pen(width, rgb_of(shape.stroke), is_dashed(shape))
        for points, is_curved in parts:
            builder.add_polyline(points, is_curved, layer, style, pen)
    if is_drawn(shape.fill):
        hides = shape.fill.alpha == 255 and is_opaque(shape)
        builder.add_fill(rings, layer, rgb_of(shape.fill), hides)


def _add_text(builder: DrawingBuilder, element: SvgText, layer: str) -> None:
    text = (element.text or "").strip()
    if not text:
        return
    matrix = Matrix(element.transform)
    height = float(element.font_size or PX["rem"])  # type: ignore[arg-type]
    width = 0.6 * height * len(text)
    offset = {"middle": 0.0, "end": -0.5}.get(str(element.anchor), 0.5) * width
    at = matrix.point_in_matrix_space((element.x + offset, element.y - 0.35 * height))
    scale = float(np.sqrt(abs(matrix.a * matrix.d - matrix.b * matrix.c)))
    builder.texts.append(Text(text, xy_of(at), height * scale, builder.layer(layer)))


def sub_paths(
    path: SvgPath, pen_width: float = 0.0
) -> list[tuple[Float[np.ndarray, "_ 2"], Bool[np.ndarray, " _"]]]:
    """Each sub-path as points (k, 2), y up, and which of its segments (k - 1,) are curved (`is_bent`)."""
    result = SubPaths(pen_width)
    for segment in path.segments(transformed=True):
        if isinstance(segment, Move):
            result.move(xy_of(segment.end))
            continue
        if segment.end is None:
            continue
        if not len(result):
            result.move(xy_of(segment.start))
        if isinstance(segment, Close):
            result.close()
        elif isinstance(segment, QuadraticBezier):
            start, control, end = (xy_of(p) for p in (segment.start, segment.control, segment.end))
            thirds = [(start + 2 * control) / 3, (end + 2 * control) / 3]
            result.cubic(np.array([start, *thirds, end]))
        elif isinstance(segment, Arc | CubicBezier):
            is_arc = isinstance(segment, Arc)
            for cubic in segment.as_cubic_curves() if is_arc else [segment]:
                corners = (cubic.start, cubic.control1, cubic.control2, cubic.end)
                result.cubic(np.array([xy_of(p) for p in corners]))
        else:
            result.line(xy_of(segment.end))
    return result.found()


def xy_of(point) -> Float[np.ndarray, "2"]:
    """A point of svgelements, y up."""
    return np.array([point.x, -point.y], dtype=float)

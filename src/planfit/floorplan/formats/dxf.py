"""DXF: blocks, curves and hatches flattened, hidden layers left out, the unit of the header."""

import io
import logging
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import ezdxf
import ezdxf.recover
import numpy as np
from ezdxf import colors
from ezdxf import path as ezpath
from ezdxf.audit import AuditError, Auditor
from ezdxf.disassemble import recursive_decompose
from ezdxf.document import Drawing as Document
from ezdxf.entities.dxfgfx import DXFGraphic
from ezdxf.lldxf.const import DXFError
from jaxtyping import Float

from planfit.errors import FloorplanError
from planfit.floorplan.formats import fingerprint_of
from planfit.floorplan.formats.dxf_contents import check_expansion, only_layout, unread_words
from planfit.floorplan.options import METRES_PER_FILE_UNIT, PlanOptions
from planfit.floorplan.types import Floorplan
from planfit.floorplan.vector.drawing import ABSURD, DrawingBuilder, Text, VectorDrawing
from planfit.floorplan.vector.line_work import is_bent
from planfit.floorplan.vector.plan import plan_of_drawing
from planfit.floorplan.vector.strokes import Pen

_UNITS = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 10: "yd", 14: "dm", 21: "US survey ft"}
"""Names of `METRES_PER_FILE_UNIT` by the number in the header ($INSUNITS)."""
FINEST_SHARE = 1e-5
"""Curves are flattened to this share of their size at the finest: a full circle has 700 pieces then."""
_CURVED = {"ARC", "CIRCLE", "ELLIPSE", "SPLINE", "HELIX"}
_PATHS = {"LINE", "LWPOLYLINE", "POLYLINE", *_CURVED}
_HARMLESS = {
    AuditError.INVALID_LAYER_NAME,
    AuditError.BLOCK_NAME_MISMATCH,
    AuditError.DECODING_ERROR,
    AuditError.ROOT_DICT_NOT_FOUND,
    AuditError.MISSING_REQUIRED_ROOT_DICT_ENTRY,
    AuditError.ACTIVE_PAPERSPACE_LAYOUT_NOT_FOUND,
    AuditError.INVALID_MLINESTYLE_ELEMENT_COUNT,
}
"""Errors that stay in the document and leave its geometry whole."""
_LOST = {
    AuditError.FOUND_TAG_OUTSIDE_SECTION,
    AuditError.REMOVED_INVALID_GRAPHIC_ENTITY,
    AuditError.REMOVED_ENTITY_WITH_INVALID_OWNER_HANDLE,
    AuditError.UNDEFINED_BLOCK,
    AuditError.UNDEFINED_BLOCK_NAME,
    AuditError.INVALID_VERTEX_COUNT,
    AuditError.INVALID_MAJOR_AXIS,
    AuditError.INVALID_HATCH_BOUNDARY_PATH,
    AuditError.INVALID_SPLINE_DEFINITION,
    AuditError.INVALID_SPLINE_CONTROL_POINT_COUNT,
    AuditError.INVALID_SPLINE_FIT_POINT_COUNT,
    AuditError.INVALID_SPLINE_KNOT_VALUE_COUNT,
    AuditError.INVALID_SPLINE_WEIGHT_COUNT,
}
"""Repairs that take an entity away."""
_DAMAGED = (DXFError, OSError, ValueError, KeyError, IndexError, TypeError, AttributeError)
"""What ezdxf raises of files that it cannot read."""
_RECOVERED = re.compile(r'value "(?P<found>[^"]*)".* as "(?P<read>[^"]*)"')


def read_dxf(path: Path, options: PlanOptions) -> Floorplan:
    """Wall faces of the model space of a DXF, or of a layout where that one is empty.

    Raises:
        FloorplanError: the file is no DXF, is cut off, or has no walls.
    """
    # ezdxf warns of every odd table entry; what matters comes back as an error or in `dropped`.
    logging.getLogger("ezdxf").setLevel(logging.ERROR)
    document, lost = _open(path)
    layout = only_layout(document)
    space = document.modelspace() if layout is None else layout
    empty = check_expansion(path, document, space)
    unread = unread_words(document, space)
    drawing = _drawing(document, space, empty)
    if layout is not None:
        drawing = replace(drawing, metres_per_unit=None, unit="paper")
        unread += (
            f"the model space is empty: the layout {layout.name!r} was read, whose unit is that of the paper",
        )
    try:
        floorplan = plan_of_drawing(
            drawing, path, fingerprint_of(path), options, "DXF drawing", np.eye(3)
        )
    except FloorplanError as error:
        raise FloorplanError("; ".join([str(error), *unread])) from error
    for words in unread:
        floorplan = floorplan.with_warning(words)
    return floorplan if not lost else floorplan.with_warning(
        f"the file is damaged: {len(lost)} of its parts or numbers were lost or guessed; first: {lost[0]}"
    )  # fmt: skip


def _open(path: Path) -> tuple[Document, list[str]]:
    data = path.read_bytes()
    if not data.strip():
        raise FloorplanError(
            f"{path}: expected a DXF drawing, found an empty file; export it again"
        )
    try:
        document, auditor = ezdxf.recover.read(io.BytesIO(data))
    except _DAMAGED as error:
        raise FloorplanError(
            f"{path}: expected a DXF drawing, found a file that is damaged or of another kind "
            f"({type(error).__name__}); export it again as DXF"
        ) from error
    if b"EOF" not in data[-64:] and not data.startswith(b"AutoCAD Binary DXF"):
        raise FloorplanError(
            f"{path}: expected a whole DXF drawing, found one that is cut off (no EOF at its end); "
            "copy or export it again"
        )
    return document, _lost_parts(auditor)


def _drawing(document: Document, space: Any, empty_blocks: frozenset[str]) -> VectorDrawing:
    builder = DrawingBuilder()
    hidden = {layer.dxf.name for layer in document.layers if layer.is_off() or layer.is_frozen()}
    # Layer 0 stands for the layer of the block's insertion; on its own it may be frozen too.
    flatten = _flattening_distance(space)
    seen_hidden: set[str] = set()
    for entity, layer in _entities(space, empty_blocks):
        if layer in hidden:
            seen_hidden.add(layer)
        elif not entity.dxf.get("invisible", 0):
            _add(builder, entity, layer, flatten)
    unit = _UNITS.get(document.header.get("$INSUNITS", 0), "unknown")
    return builder.build(METRES_PER_FILE_UNIT.get(unit), unit, tuple(sorted(seen_hidden)))


def _entities(space, empty_blocks: frozenset[str]) -> Iterator[tuple[Any, str]]:
    """Entities with blocks exploded, and the layer that decides on each: that of the entity, or of the
    block it came in where the entity is on layer 0."""
    for entity in space:
        outer, kind = entity.dxf.get("layer", "0"), entity.dxftype()
        is_bare = kind == "INSERT" and not entity.attribs
        if is_bare and str(entity.dxf.get("name", "")).lower() in empty_blocks:
            continue
        if kind not in ("INSERT", "DIMENSION", "LEADER", "MLINE"):
            yield entity, outer
            continue
        for part in recursive_decompose([entity]):
            inner = part.dxf.get("layer", "0")
            is_dimension = kind in ("DIMENSION", "LEADER")
            yield part, f"{outer} (dimension)" if is_dimension else outer if inner == "0" else inner


def _add(builder: DrawingBuilder, entity: DXFGraphic, layer: str, flatten: float) -> None:
    kind = entity.dxftype()
    style = (entity.dxf.get("color", 256), entity.dxf.get("lineweight", -1), layer)
    if kind in _PATHS:
        try:
            made = ezpath.make_path(entity)
        except (TypeError, ValueError, ZeroDivisionError, OverflowError):
            return
        width = float(entity.dxf.const_width) if kind == "LWPOLYLINE" else 0.0
        pen = Pen(width, _colour(entity), _is_dashed(entity))
        _add_path(builder, made, layer, style, flatten, pen)
    elif kind in ("HATCH", "MPOLYGON"):
        rings = []
        for boundary in ezpath.from_hatch(entity):  # type: ignore[arg-type]
            size = _size(boundary)
            if size < ABSURD:
                rings.append(_xy(boundary.flattening(max(flatten, FINEST_SHARE * size))))
        builder.add_fill(rings, layer, _colour(entity))
    elif kind in ("SOLID", "TRACE", "3DFACE"):
        corners = _xy(entity.wcs_vertices())  # type: ignore[attr-defined]
        builder.add_fill([corners], layer, _colour(entity))
    elif kind in ("TEXT", "MTEXT", "ATTRIB"):
        _add_text(builder, entity, layer)


def _add_path(
    builder: DrawingBuilder, made, layer: str, style: object, flatten: float, pen: Pen
) -> None:
    """Straight and curved segments of a path apart: an arc between two walls is a door."""
    if len(made) == 0:
        return
    size = _size(made)
    flatten = max(flatten, FINEST_SHARE * size)
    points, is_curved = [np.array(made.start)[:2]], []
    at = made.start
    for command in made.commands():
        is_line = command.type == ezpath.Command.LINE_TO or size == math.inf
        if is_line or command.type == ezpath.Command.MOVE_TO:
            points.append(np.array(command.end)[:2])
            is_curved.append(command.type == ezpath.Command.MOVE_TO)
        else:
            flat = _xy(_single(at, command).flattening(flatten, segments=4))[1:]
            bends = is_bent(np.array([np.array(at)[:2], *flat]))
            flat = flat if bends else flat[-1:]
            points.extend(flat)
            is_curved.extend([bends] * len(flat))
        at = command.end
    builder.add_polyline(np.array(points), np.array(is_curved), layer, style, pen)


def _size(made) -> float:
    """Larger side of a path's box; its control points count."""
    corners = _xy(made.control_vertices())
    return float(np.ptp(corners, axis=0).max()) if np.isfinite(corners).all() else math.inf


def _single(start, command):
    curve = ezpath.Path(start)
    if command.type == ezpath.Command.CURVE4_TO:
        curve.curve4_to(command.end, command.ctrl1, command.ctrl2)
    else:
        curve.curve3_to(command.end, command.ctrl)
    return curve


def _add_text(builder: DrawingBuilder, entity: DXFGraphic, layer: str) -> None:
    if entity.dxftype() == "MTEXT":
        text, height = entity.plain_text(), entity.dxf.char_height  # type: ignore[attr-defined]
        at = np.array(entity.dxf.insert)[:2]
        is_centred = entity.dxf.get("attachment_point", 1) in (2, 5, 8)
    else:
        text, height = entity.dxf.text, entity.dxf.height
        is_centred = entity.dxf.get("halign", 0) in (1, 4)
        has_second = is_centred and entity.dxf.hasattr("align_point")
        at = np.array(entity.dxf.align_point if has_second else entity.dxf.insert)[:2]
    rotation = math.radians(entity.dxf.get("rotation", 0.0))
    if not is_centred:
        # A letter is about 0.6 of its height wide.
        at = at + 0.3 * height * len(text) * np.array([math.cos(rotation), math.sin(rotation)])
    if np.isfinite(at).all():
        builder.texts.append(Text(text, at, float(height), builder.layer(layer)))


def _is_dashed(entity: DXFGraphic) -> bool:
    """Whether the line type of an entity, or of its layer, has gaps."""
    document = entity.doc
    if document is None:
        return False
    name = entity.dxf.get("linetype", "BYLAYER")
    layer = entity.dxf.get("layer", "0")
    if name.upper() == "BYLAYER" and layer in document.layers:
        name = document.layers.get(layer).dxf.get("linetype", "CONTINUOUS")
    if name not in document.linetypes:
        return False
    tags = document.linetypes.get(name).pattern_tags.tags
    return any(tag.code == 49 and tag.value < 0 for tag in tags)


def _colour(entity: DXFGraphic) -> tuple[int, int, int] | None:
    """RGB of the entity's own colour; the layer's, and black for white on black, are unknown."""
    if entity.rgb is not None:
        red, green, blue = entity.rgb
        return (red, green, blue)
    index = entity.dxf.get("color", 256)
    if index in (0, 7, 256) or not 0 < index < 256:
        return None
    red, green, blue = colors.aci2rgb(index)
    return (red, green, blue)


def _xy(points) -> Float[np.ndarray, "n 2"]:
    return np.array([(p[0], p[1]) for p in points], dtype=float).reshape(-1, 2)


def _flattening_distance(space) -> float:
    """A thousandth of a likely extent: curves of walls keep their course, circles stay small."""
    points = [e.dxf.start for e in space.query("LINE")]
    points += [p for e in space.query("LWPOLYLINE") for p in e.get_points("xy")]
    flat = _xy(points)
    flat = flat[np.isfinite(flat).all(axis=1) & (np.abs(flat) < ABSURD).all(axis=1)]
    if len(flat) < 2:
        return 0.01
    low, high = np.percentile(flat, [2, 98], axis=0)
    return max(float(max(high - low)) * 1e-3, 1e-6)


def _lost_parts(auditor: Auditor) -> list[str]:
    """A sentence of ezdxf's for each entity that its repair took away and each number that it guessed.

    Most of what it reports (names, styles, owners) loses nothing.
    """
    errors = [e.message for e in auditor.errors if e.code not in _HARMLESS]
    fixes = [e.message for e in auditor.fixes if e.code in _LOST]
    # The codes of splines also stand for superfluous knots and weights.
    return [m for m in errors if not _is_same_number(m)] + [m for m in fixes if "unused" not in m]


def _is_same_number(message: str) -> bool:
    """Whether a number in the wrong form, as 3.0 for a whole one, was read as what it says."""
    match = _RECOVERED.search(message)
    try:
        return match is not None and float(match["found"]) == float(match["read"])
    except ValueError:
        return False

"""What was read of a plan, drawn over the plan itself, with coordinates at the rim to read points off it."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from planfit.floorplan import Floorplan
from planfit.floorplan.columns import find_columns
from planfit.floorplan.elements import are_glass
from planfit.floorplan.formats.picture import load_picture
from planfit.geometry import segments

RIGHT_PX, BOTTOM_PX = 74, 40
_TICK_PX = 6
_STEP_PX = 110
"""Least distance of numbers."""
_RIM_INK = (40, 40, 40)


def with_rim(
    canvas: UInt8[np.ndarray, "h w 3"], uv_from_xy: Float[np.ndarray, "3 3"], words: str
) -> UInt8[np.ndarray, "a b 3"]:
    """A picture with numbers below and to its right; what it shows stays at its pixels.

    Args:
        canvas: BGR.
        uv_from_xy: from homogeneous coordinates to pixels of the canvas; its axes are those of the picture,
            either may be turned over.
        words: whose coordinates they are.
    """
    height, width = canvas.shape[:2]
    rim = cv2.copyMakeBorder(
        canvas, 0, BOTTOM_PX, 0, RIGHT_PX, cv2.BORDER_CONSTANT, value=(255,) * 3
    )
    cv2.rectangle(rim, (0, 0), (width, height), (200, 200, 200), 1)
    for at_px, number in _ticks(uv_from_xy[0, 0], uv_from_xy[0, 2], width):
        cv2.line(rim, (at_px, height), (at_px, height + _TICK_PX), _RIM_INK, 1)
        _write(rim, number, (at_px - 4 * len(number), height + 20))
    for at_px, number in _ticks(uv_from_xy[1, 1], uv_from_xy[1, 2], height):
        cv2.line(rim, (width, at_px), (width + _TICK_PX, at_px), _RIM_INK, 1)
        _write(rim, number, (width + 10, at_px + 5))
    _write(rim, words, (8, height + 35))
    return rim


def _ticks(px_per_unit: float, zero_px: float, length_px: int) -> list[tuple[int, str]]:
    """Pixels and numbers along one side, at multiples of 1, 2 or 5 of a power of ten."""
    if not np.isfinite([px_per_unit, zero_px]).all() or px_per_unit == 0:
        return []
    wanted = _STEP_PX / abs(px_per_unit)
    power = 10.0 ** np.floor(np.log10(wanted))
    step = power * next(k for k in (1, 2, 5, 10) if k * power >= wanted)
    ends = np.sort((np.array([0.0, length_px - 1.0]) - zero_px) / px_per_unit)
    numbers = step * np.arange(np.ceil(ends[0] / step), np.floor(ends[1] / step) + 1)
    # More than six digits would touch each other; a plan so far from its origin is moved to it when read.
    return [(round(zero_px + px_per_unit * n), f"{n + 0.0:.6g}") for n in numbers]


def _write(canvas: np.ndarray, text: str, at: tuple[int, int]) -> None:
    cv2.putText(canvas, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, _RIM_INK, 1, cv2.LINE_AA)


_SIDE_PX = 1600
_MARGIN_PX = 40
_GROW = 0.5
"""Line work is shown around the faces as far as this share of their longer side: a wing that was missed is,
a title block far off is not."""
_DRAWN = (172, 172, 172)
_FACE, _OPENING, _UNORIENTED, _DROPPED = (0, 94, 213), (178, 114, 0), (158, 115, 0), (193, 120, 200)
_COLUMN, _GLASS = (115, 158, 0), (233, 180, 86)
"""BGR; Okabe and Ito's palette."""


def draw_plan_picture(floorplan: Floorplan, path: Path, has_numbers: bool = False) -> bytes:
    """PNG: faces with ticks towards their free side, openings, and what was left out; at the rim, the
    coordinates in which points of the plan are given.

    Over the drawing, made pale, where the file is a picture; else over its line work in light grey.

    Args:
        floorplan: as read.
        path: of the file that it was read from.
        has_numbers: whether faces are numbered, as `planfit plan --drop` counts them.
    """
    source = floorplan.source
    drawn, left_out = (
        _in_plan(floorplan, source.drawn_lines),
        _in_plan(floorplan, source.dropped_lines),
    )
    if source.is_picture and source.file_from_plan is not None:
        canvas, zoom = _pale(path)
        uv_from_plan = _zoomed(source.file_from_plan, zoom)
    else:
        canvas, uv_from_plan = _white(floorplan, np.concatenate([drawn, left_out]))
    scale = float(np.sqrt(abs(np.linalg.det(uv_from_plan[:2, :2]))))
    _draw(canvas, _moved(drawn, uv_from_plan), _DRAWN, 1)
    _draw(canvas, _moved(left_out, uv_from_plan), _DROPPED, 1)
    rotation = uv_from_plan[:2, :2] / scale
    is_column, is_glass = find_columns(floorplan).face >= 0, are_glass(floorplan)
    for is_oriented, color in ((True, _FACE), (False, _UNORIENTED)):
        kept = (floorplan.is_oriented == is_oriented) & ~is_column
        _draw(canvas, _moved(floorplan.ends[kept], uv_from_plan), color, 2)
    _draw(canvas, _moved(floorplan.ends[is_column], uv_from_plan), _COLUMN, 2)
    _draw(canvas, _moved(floorplan.ends[is_glass], uv_from_plan), _GLASS, 3)
    has_tick = floorplan.is_oriented & ~is_column
    ends = _moved(floorplan.ends[has_tick], uv_from_plan)
    if len(ends):
        middle = ends.mean(axis=1)
        tips = middle + 9.0 * floorplan.normals[has_tick] @ rotation.T
        long = segments.lengths(ends) > 12.0
        _draw(canvas, np.stack([middle, tips], axis=1)[long], _FACE, 1)
    if floorplan.openings is not None and len(floorplan.openings):
        _draw(canvas, _moved(floorplan.openings, uv_from_plan), _OPENING, 2)
    if has_numbers:
        for number, middle in enumerate(_moved(floorplan.ends, uv_from_plan).mean(axis=1)):
            at = tuple(np.round(np.clip(middle, -1e5, 1e5)).astype(int).tolist())
            cv2.putText(
                canvas, str(number), at, cv2.FONT_HERSHEY_SIMPLEX, 0.4, (150, 0, 0), 1, cv2.LINE_AA
            )
    canvas = with_rim(
        canvas, uv_from_plan @ np.linalg.inv(source.rim_from_plan), _rim_words(floorplan)
    )
    canvas = _with_key(canvas, floorplan, bool(is_column.any()), bool(is_glass.any()))
    return cv2.imencode(".png", canvas)[1].tobytes()


def _pale(path: Path) -> tuple[np.ndarray, float]:
    """The picture in light grey, at a size for screens, and its zoom."""
    image, shrink = load_picture(path)
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    zoom = _SIDE_PX / max(grey.shape)
    interpolation = cv2.INTER_AREA if zoom < 1 else cv2.INTER_CUBIC
    size = (round(grey.shape[1] * zoom), round(grey.shape[0] * zoom))
    grey = cv2.resize(grey, size, interpolation=interpolation)
    pale = (255 - 0.45 * (255.0 - grey)).astype(np.uint8)
    return cv2.cvtColor(pale, cv2.COLOR_GRAY2BGR), zoom / shrink


def _zoomed(file_from_plan: np.ndarray, zoom: float) -> np.ndarray:
    """file_from_plan (3, 3) in pixels of the zoomed picture: pixel centres are integers before and after."""
    offset = 0.5 * zoom - 0.5
    return np.array([[zoom, 0, offset], [0, zoom, offset], [0, 0, 1]]) @ file_from_plan


def _in_plan(floorplan: Floorplan, lines_in_file: np.ndarray | None) -> np.ndarray:
    file_from_plan = floorplan.source.file_from_plan
    if lines_in_file is None or file_from_plan is None:
        return np.zeros((0, 2, 2))
    return _moved(lines_in_file, np.linalg.inv(file_from_plan))


def _white(floorplan: Floorplan, lines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """White paper with room for the faces and the lines (k, 2, 2) about them, and uv from plan."""
    xy = floorplan.ends.reshape(-1, 2)
    low, high = xy.min(axis=0), xy.max(axis=0)
    if len(lines):
        reach = _GROW * float(max(high - low))
        around = lines.reshape(-1, 2)
        low = np.minimum(low, np.maximum(around.min(axis=0), low - reach))
        high = np.maximum(high, np.minimum(around.max(axis=0), high + reach))
    scale = (_SIDE_PX - 2 * _MARGIN_PX) / float(max(high - low))
    width, height = np.ceil((high - low) * scale).astype(int) + 2 * _MARGIN_PX
    uv_from_plan = np.array(
        [
            [scale, 0, _MARGIN_PX - low[0] * scale],
            [0, -scale, _MARGIN_PX + high[1] * scale],
            [0, 0, 1],
        ]
    )
    return np.full((height, width, 3), 255, np.uint8), uv_from_plan


def _moved(ends: np.ndarray, uv_from_plan: np.ndarray) -> np.ndarray:
    return ends @ uv_from_plan[:2, :2].T + uv_from_plan[:2, 2]


def _draw(canvas: np.ndarray, ends: np.ndarray, color: tuple[int, int, int], width: int) -> None:
    # Fixed point with four fractional bits, for lines between pixels; far ends must not overflow.
    points = np.round(np.clip(ends, -1e5, 1e5) * 16).astype(np.int32)
    cv2.polylines(canvas, list(points), False, color, width, cv2.LINE_AA, 4)


def _rim_words(floorplan: Floorplan) -> str:
    """Whose coordinates are at the rim."""
    if floorplan.source.is_picture:
        return "pixels of the picture, u right, v down"
    return "plan frame, m" if floorplan.is_metric else "plan frame, units of the drawing"


def _with_key(
    canvas: np.ndarray, floorplan: Floorplan, has_columns: bool, has_glass: bool
) -> np.ndarray:
    """A strip below that says what the colours mean."""
    entries = [("face, tick to its free side", _FACE)]
    if floorplan.source.drawn_lines is not None:
        entries.append(("line work", _DRAWN))
    if not floorplan.is_oriented.all():
        entries.append(("face, free side unknown", _UNORIENTED))
    if has_columns:
        entries.append(("column", _COLUMN))
    if has_glass:
        entries.append(("glass", _GLASS))
    if floorplan.openings is not None and len(floorplan.openings):
        entries.append(("door or window", _OPENING))
    if floorplan.source.dropped_lines is not None and len(floorplan.source.dropped_lines):
        entries.append(("left out", _DROPPED))
    strip = np.full((34, max(canvas.shape[1], 760), 3), 255, np.uint8)
    at = 16
    for words, color in entries:
        cv2.line(strip, (at, 17), (at + 28, 17), color, 3, cv2.LINE_AA)
        cv2.putText(strip, words, (at + 36, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (40, 40, 40), 1,
                    cv2.LINE_AA)  # fmt: skip
        at += 60 + cv2.getTextSize(words, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)[0][0]
    right = strip.shape[1] - canvas.shape[1]
    canvas = cv2.copyMakeBorder(canvas, 0, 0, 0, right, cv2.BORDER_CONSTANT, value=(255,) * 3)
    return np.concatenate([canvas, strip])

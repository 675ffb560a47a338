"""What the fill and the stroke of a shape look like: colours on paper or on dark ground, what hides, what has
gaps."""

import re
from collections.abc import Sequence

import numpy as np
import shapely
from svgelements import SVG, Color, Rect, Shape

from planfit.floorplan.formats.svg.css_values import plain_colour
from planfit.floorplan.vector.drawing import LIGHT

PAPER, WHITE = 235, 245
"""Of 255, of every colour: paper, tinted and white."""
DARK_GROUND, GROUND_SHARE, ROOMS_SHARE = 110, 0.9, 0.5
"""Every colour of dark ground is below the first, of 255; it reaches over this share of all that is drawn,
and less than the last of it is light areas: of a slab with rooms on it the rest is walls."""


def dark_ground(
    svg: SVG, own: dict[str, str], shapes: Sequence[Shape]
) -> tuple[int, int, int] | None:
    """Colour of the dark ground that a drawing is on, by its page's `own` attributes or a first box which
    reaches over nearly all; None on paper."""
    told = plain_colour(own.get("background-color") or own.get("background") or "none", {})
    paint = None if told in (None, "none") else Color(told)
    filled = [shape for shape in shapes if is_drawn(shape.fill)]
    if paint is None and filled and isinstance(filled[0], Rect) and is_opaque(filled[0]):
        light = [s for s in filled[1:] if s.fill.alpha == 255 and lightness(s.fill) >= LIGHT]
        page, first, *rooms = (_box(each) for each in (svg, filled[0], *light))
        is_slab = shapely.union_all(np.array(rooms)).area > ROOMS_SHARE * first.area
        is_ground = page.intersection(first).area >= GROUND_SHARE * page.area > 0.0
        paint = filled[0].fill if is_ground and not is_slab else None
    if paint is None or paint.alpha != 255 or max(rgb_of(paint)) >= DARK_GROUND:
        return None
    # Dark lines would not show on it: they are on light areas.
    strokes = [shape for shape in shapes if is_drawn(shape.stroke)]
    around = [_box(shape).length for shape in strokes]
    is_dark = [max(rgb_of(shape.stroke)) < DARK_GROUND for shape in strokes]
    if np.dot(around, is_dark) > 0.5 * sum(around):
        return None
    return rgb_of(paint)


def _box(element: SVG | Shape) -> shapely.Polygon:
    x0, y0, x1, y1 = element.bbox() or (0.0, 0.0, 0.0, 0.0)
    return shapely.box(x0, y0, x1, y1)


def negative(paint: Color, ground: tuple[int, int, int]) -> Color:
    """White for the ground and black for white: a drawing on dark ground is read as its negative."""
    if not is_drawn(paint):
        return paint
    parts = zip((paint.red, paint.green, paint.blue), ground, strict=True)
    return Color(
        *(min(255 - (part or 0) + dark, 255) for part, dark in parts), opacity=paint.opacity
    )


def covers(shape: Shape) -> bool:
    """Whether a shape is a patch that hides what is under it: opaque, light, without an outline. What is dark
    is wall over the lines of its faces."""
    fill, values = shape.fill, shape.values or {}
    if fill is None or not is_drawn(fill) or is_drawn(shape.stroke) or (fill.alpha or 0) < 255:
        return False
    return is_opaque(shape) and "mix-blend-mode" not in values and lightness(fill) >= LIGHT


def is_opaque(shape: Shape) -> bool:
    """Whether nothing shows through a shape but for what its paint lets through."""
    return str((shape.values or {}).get("opacity") or "1").strip() in ("1", "1.0", "100%")


def is_dashed(shape: Shape) -> bool:
    """Whether a stroke has gaps: of dashes and gaps in turn, the same again where their number is odd. Not
    where one dash is as long as all (pages draw lines little by little so), nor where gaps are finer than the
    stroke."""
    values = shape.values or {}
    words = re.split(r"[\s,]+", str(values.get("stroke-dasharray") or "").strip())
    try:
        dashes = [float(word.removesuffix("px")) for word in words]
        whole = float(values.get("pathLength") or 0.0) or _box(shape).length / 2
    except (TypeError, ValueError):
        return False
    gaps = (dashes * 2)[1::2]
    return max(gaps) > 0.5 * float(shape.stroke_width or 1.0) and max(dashes[::2]) < whole


def is_drawn(paint) -> bool:
    """Whether a paint shows."""
    return paint is not None and paint.value is not None and paint.alpha > 0


def is_white(paint) -> bool:
    """Whether a line of this paint is paper on paper."""
    return paint.alpha == 255 and lightness(paint) >= WHITE


def lightness(paint) -> int:
    """Of the darkest of its colours."""
    return min(rgb_of(paint))


def rgb_of(paint) -> tuple[int, int, int]:
    """Colour of a paint, or of as much of it as there is on white paper."""
    share = paint.alpha / 255.0
    red, green, blue = (
        round(255 - share * (255 - (part or 0))) for part in (paint.red, paint.green, paint.blue)
    )
    return red, green, blue

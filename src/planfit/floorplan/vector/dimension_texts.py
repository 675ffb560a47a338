"""The scale of a drawing from its dimension texts, where several agree."""

import re
from dataclasses import dataclass

import numpy as np

from planfit.floorplan.options import METRES_PER_UNIT
from planfit.floorplan.vector.drawing import Text
from planfit.geometry import segments

MIN_AGREEING = 3
AGREEMENT = 0.01

_NUMBER = re.compile(r"^\s*(\d{1,6}(?:[.,]\d{1,3})?)\s*(mm|cm|m)?\s*$", re.IGNORECASE)
_FEET = re.compile(
    r"^\s*(?:(\d{1,4})\s*['′’]\s*-?\s*)?(?:(\d{1,2})(?:\s+(\d{1,2})/(\d{1,2}))?\s*(?:\"|″|''|”))?\s*$"
)


@dataclass(frozen=True)
class DimensionScale:
    """What dimension texts say."""

    metres_per_unit: float
    """As if numbers without a unit were metres."""
    has_unit: bool
    """Whether the texts name their unit."""
    example: str
    count: int


def length_of_text(text: str) -> tuple[float, bool] | None:
    """Metres that a text means and whether it names its unit; None where it is no length.

    A number without a unit is taken as it stands: `4.20` gives 4.2.
    """
    number = _NUMBER.match(text)
    if number:
        value = float(number.group(1).replace(",", "."))
        unit = (number.group(2) or "").lower()
        return (value * METRES_PER_UNIT.get(unit, 1.0), bool(unit)) if value > 0 else None
    feet = _FEET.match(text)
    if feet and (feet.group(1) or feet.group(2)):
        inches = 12.0 * float(feet.group(1) or 0) + float(feet.group(2) or 0)
        if feet.group(3) and float(feet.group(4)):
            inches += float(feet.group(3)) / float(feet.group(4))
        return (inches * METRES_PER_UNIT["in"], True) if inches > 0 else None
    return None


def scale_of_dimensions(ends: np.ndarray, texts: tuple[Text, ...]) -> DimensionScale | None:
    """Metres of one unit of the drawing, where at least three texts of different lengths agree
    within 1 % with the lines (n, 2, 2) they stand at the middle of, and they are most of the
    texts that have such a line.
    """
    candidates: list[tuple[float, float, bool, int]] = []
    n_with_line = 0
    middles, lengths = ends.mean(axis=1), segments.lengths(ends)
    along = segments.directions(ends) if len(ends) else np.zeros((0, 2))
    for k, text in enumerate(texts):
        value = length_of_text(text.text)
        if value is None or len(ends) == 0 or text.height <= 0:
            continue
        offset = text.xy - middles
        across = np.abs(along[:, 0] * offset[:, 1] - along[:, 1] * offset[:, 0])
        at = np.abs(np.einsum("ni,ni->n", offset, along))
        near = np.flatnonzero(
            (across < 2.0 * text.height) & (at < 0.1 * lengths) & (lengths > 1.5 * text.height)
        )
        n_with_line += len(near) > 0
        candidates += [(value[0] / lengths[i], value[0], value[1], k) for i in near]
    if not candidates:
        return None
    ratios = np.array([c[0] for c in candidates])
    agreeing = np.abs(ratios[:, None] / ratios[None] - 1) < AGREEMENT
    best = int(agreeing.sum(axis=1).argmax())
    chosen = [candidates[i] for i in np.flatnonzero(agreeing[best])]
    n_values = len({round(c[1], 4) for c in chosen})
    n_texts = len({c[3] for c in chosen})
    if n_values < MIN_AGREEING or n_texts < 0.6 * n_with_line:
        return None
    ratio = float(np.median([c[0] for c in chosen]))
    return DimensionScale(
        ratio, all(c[2] for c in chosen), texts[chosen[0][3]].text.strip(), n_texts
    )

"""How long one unit of a drawing is: from the user, the file, its dimension texts, or not at all."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from planfit.errors import FloorplanError
from planfit.floorplan.options import METRES_PER_UNIT, PlanOptions
from planfit.floorplan.units import MAX_SIZE_M, MIN_SIZE_M, choose_unit
from planfit.floorplan.vector.dimension_texts import scale_of_dimensions
from planfit.floorplan.vector.drawing import Drawing

LIKELY_SIZE_M = (3.0, 400.0)
LIKELY_THICKNESS_M = (0.07, 0.45)
"""Of most of the walls of a building; used only to choose between units, and only where one is left."""


@dataclass(frozen=True)
class UnitFound:
    """Size of a drawing's unit, and what told it."""

    metres_per_unit: float | None
    unit: str
    unit_from: str
    warnings: tuple[str, ...] = ()


def unit_of_drawing(
    drawing: Drawing, path: Path, options: PlanOptions, size: float, usual_thickness: float | None
) -> UnitFound:
    """Decide on a unit; the user's word first, then the file's, the dimension texts', a guess.

    Args:
        drawing: what the file says itself.
        path: for messages.
        options: `unit` and `metres_per_unit`.
        size: larger extent of the walls, in the drawing's unit.
        usual_thickness: of its walls, in the same; None where unknown.

    Raises:
        FloorplanError: the user's unit makes a building of an absurd size.
    """
    told = _told_by_user(options)
    if told is not None:
        if told.metres_per_unit is not None:
            extent = size * told.metres_per_unit
            if not MIN_SIZE_M <= extent <= MAX_SIZE_M:
                raise FloorplanError(
                    f"{path}: expected a building of {MIN_SIZE_M:g} to {MAX_SIZE_M:g} m, found "
                    f"{extent:.4g} m with {told.unit_from}; pass the unit of the drawing, or "
                    "`--unit unknown` to leave its scale to the alignment"
                )
        return told
    warnings: tuple[str, ...] = ()
    by_dimensions = _told_by_dimensions(drawing, size, usual_thickness)
    claimed = drawing.metres_per_unit
    if claimed is not None:
        extent = size * claimed
        if MIN_SIZE_M <= extent <= MAX_SIZE_M:
            if by_dimensions is None or _agree(claimed, by_dimensions.metres_per_unit):
                return UnitFound(claimed, drawing.unit, "the file's header")
            warnings = (
                f"the file says its unit is {drawing.unit}, but {by_dimensions.unit_from} say "
                f"{by_dimensions.metres_per_unit:.4g} m a unit: the texts were used",
            )
        else:
            warnings = (
                f"the file says its unit is {drawing.unit}, which makes a building of "
                f"{extent:.3g} m: not used",
            )
            if by_dimensions is None:
                return UnitFound(None, "unknown", "", warnings)
    if by_dimensions is not None:
        return UnitFound(
            by_dimensions.metres_per_unit, by_dimensions.unit, by_dimensions.unit_from, warnings
        )
    if drawing.unit == "paper":
        return UnitFound(None, "unknown", "", warnings)
    return _guess(size, usual_thickness)


def _told_by_user(options: PlanOptions) -> UnitFound | None:
    if options.unit == "auto" and options.metres_per_unit is None:
        return None
    told = choose_unit(options, None, "")
    return UnitFound(told.metres, told.name, told.known_from)


def _told_by_dimensions(
    drawing: Drawing, size: float, usual_thickness: float | None
) -> UnitFound | None:
    lines = drawing.lines
    found = scale_of_dimensions(lines.ends[~lines.is_curved], drawing.texts)
    if found is None:
        return None
    name = f"{found.count} dimension texts such as {found.example!r}"
    if found.has_unit:
        return UnitFound(found.metres_per_unit, "of dimension texts", name)
    fitting = [
        scale for scale in (1.0, 0.01, 0.001)
        if _is_likely(size, usual_thickness, found.metres_per_unit * scale)
    ]  # fmt: skip
    if len(fitting) != 1:
        return None
    return UnitFound(found.metres_per_unit * fitting[0], "of dimension texts", name)


def _guess(size: float, usual_thickness: float | None) -> UnitFound:
    """The one unit that makes a building with walls of likely size; unknown where several do."""
    fitting = [
        unit for unit, scale in METRES_PER_UNIT.items() if _is_likely(size, usual_thickness, scale)
    ]
    if len(fitting) == 1:
        unit = fitting[0]
        return UnitFound(
            METRES_PER_UNIT[unit],
            unit,
            "the size of the building and its walls",
            (f"the file does not say its unit; only {unit} makes a building of likely size",),
        )
    wording = f"could be {' or '.join(fitting)}" if fitting else "fits no likely building"
    return UnitFound(None, "unknown", "", (f"the file does not say its unit; it {wording}",))


def _is_likely(size: float, usual_thickness: float | None, scale: float) -> bool:
    if usual_thickness is None:
        return False
    return (
        LIKELY_SIZE_M[0] <= size * scale <= LIKELY_SIZE_M[1]
        and LIKELY_THICKNESS_M[0] <= usual_thickness * scale <= LIKELY_THICKNESS_M[1]
    )


def _agree(a: float | None, b: float | None) -> bool:
    return a is not None and b is not None and bool(np.abs(a / b - 1) < 0.02)

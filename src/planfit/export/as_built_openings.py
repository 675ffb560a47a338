"""Openings as built, for the table, the GeoJSON and the drawing of `as_built_files.py`."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from ezdxf.document import Drawing
from ezdxf.enums import TextEntityAlignment
from jaxtyping import Float

from planfit.as_built import AsBuilt, OpeningVerdict, opening_words

LAYER_COLORS = {
    OpeningVerdict.OPEN: 3,
    OpeningVerdict.CLOSED: 1,
    OpeningVerdict.NOT_SEEN: 8,
    OpeningVerdict.NEW: 30,
}
"""Of AutoCAD's index, as of walls."""


def opening_rows(as_built: AsBuilt) -> Iterator[list[Any]]:
    """Cells of the table, a row an opening."""
    for number, opening in enumerate(as_built.openings, start=1):
        yield [
            f"O{number}",
            opening.verdict.value,
            *("", ""),
            opening.element_id,
            *("", ""),
            metres(opening.drawn_width_m),
            *(metres(value) for value in opening.ends.ravel()),
            *(f"{value:.6f}" for value in opening.normal),
            *("", ""),
            max(opening.n_through_frames, opening.n_surface_frames),
            f"{opening.open_share:.2f}",
            opening_words(opening),
            opening.kind or "opening",
            f"{opening.closed_share:.2f}",
            metres(opening.width_m),
            metres(opening.width_sigma_m),
            metres(opening.shift_m) if opening.is_drawn else "",
        ]


def opening_lines(
    as_built: AsBuilt,
) -> Iterator[tuple[Float[np.ndarray, "2 2"], dict[str, Any]]]:
    """Ends, m, plan frame, and properties of the lines of GeoJSON: where each is drawn, and, of those whose
    sides were seen, where it is."""
    for number, opening in enumerate(as_built.openings, start=1):
        properties: dict[str, Any] = {
            "what": opening.kind or "opening",
            "opening": number,
            "verdict": opening.verdict.value,
            "element_id": opening.element_id or None,
            "drawn_width_m": rounded(opening.drawn_width_m) if opening.is_drawn else None,
            "width_m": rounded(opening.width_m),
            "width_sigma_m": rounded(opening.width_sigma_m),
            "shift_m": rounded(opening.shift_m) if opening.is_drawn else None,
            "open_share": round(opening.open_share, 2),
            "closed_share": round(opening.closed_share, 2),
            "closed_by": opening.word_of_closing,
            "through_frames": opening.n_through_frames,
            "surface_frames": opening.n_surface_frames,
            "words": opening_words(opening),
        }
        if opening.is_drawn:
            yield opening.ends, {**properties, "line": "as drawn"}
        if not opening.is_drawn or np.isfinite(opening.width_m):
            yield opening.built_ends, {**properties, "line": "as built"}


def draw_openings(document: Drawing, as_built: AsBuilt, text_height: float) -> None:
    """A line an opening on the layer of its verdict, `AS_BUILT_OPENING_CLOSED`: where it is, where its sides
    were seen, else where it is drawn; and the width of those."""
    space = document.modelspace()
    for verdict, color in LAYER_COLORS.items():
        document.layers.add(opening_layer(verdict), color=color)
    for opening in as_built.openings:
        layer = {"layer": opening_layer(opening.verdict)}
        first, last = as_built.in_file(opening.built_ends)
        space.add_line(tuple(first), tuple(last), dxfattribs=layer)
        if np.isfinite(opening.width_m):
            label = f"{opening.width_m:.2f} m +- {opening.width_sigma_m:.2f}"
            space.add_text(
                label, height=text_height, rotation=upright_deg(last - first), dxfattribs=layer
            ).set_placement(
                tuple((first + last) / 2),
                align=TextEntityAlignment.TOP_CENTER,
            )


def opening_layer(verdict: OpeningVerdict) -> str:
    """Name of the layer of a verdict."""
    return f"AS_BUILT_OPENING_{verdict.name}"


def upright_deg(along: Float[np.ndarray, "2"]) -> float:
    """Direction of a line, deg, so that text along it is read from below or from the right."""
    angle = float(np.rad2deg(np.arctan2(along[1], along[0])))
    return (angle + 90.0) % 180.0 - 90.0


def metres(value: float) -> str:
    """Of a cell; empty where it is not known."""
    return f"{value:.4f}" if np.isfinite(value) else ""


def rounded(value: float) -> float | None:
    """Of a property; None where it is not known."""
    return round(float(value), 4) if np.isfinite(value) else None

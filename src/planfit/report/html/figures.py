"""Pictures inside a page, each with its caption: one, and before and after beside each other."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from html import escape
from typing import Literal

from planfit.report.measures import BeforeAfter, Measures
from planfit.report.plots.drawing import PANEL_PT, Drawing, to_svg
from planfit.report.plots.overlay import WIDE_PT, is_wide
from planfit.report.plots.top_view import Crop

Side = Literal["before", "after"]
"""Of the refinement."""


def plural(count: int, one: str, many: str) -> str:
    """The word that goes with a count."""
    return one if count == 1 else many


def width_pt(crop: Crop) -> float:
    """Width of a picture of a crop: the whole page for wide ones."""
    return WIDE_PT if is_wide(crop) else PANEL_PT


def sides(both: BeforeAfter) -> tuple[tuple[Side, Measures], tuple[Side, Measures]]:
    """Before and after, each with its name."""
    return ("before", both.before), ("after", both.after)


def side_by_side(pictures: Sequence[str], crop: Crop) -> str:
    """Before and after beside each other, or one above the other where both are wide."""
    return f'<div class="{"stack" if is_wide(crop) else "pair"}">{"".join(pictures)}</div>'


def captioned(picture: Drawing, caption_html: str, alt: str, side: Side = "after") -> str:
    """A picture inside the page, its caption above it; pressed, it shows frames as they are on that side."""
    attributes = f'aria-label="{escape(alt)}"'
    if picture.clicks is not None:
        clicks = json.dumps(asdict(picture.clicks) | {"side": side})
        attributes += f' data-clicks="{escape(clicks)}"'
    style = "plot wide" if picture.width_pt > PANEL_PT else "plot"
    return (
        f"<figure><figcaption>{caption_html}</figcaption>"
        f'<div class="{style}">{to_svg(picture, attributes)}</div></figure>'
    )

"""Pictures inside a page, each with its caption: one, and before and after beside each other."""

import base64
import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from html import escape

from planfit.report.measures import BeforeAfter, Measures
from planfit.report.plots.drawing import (
    PANEL_IN,
    Picture,
    Side,
)
from planfit.report.plots.overlay import (
    WIDE_IN,
    is_wide,
)
from planfit.report.plots.top_view import Crop


def plural(count: int, one: str, many: str) -> str:
    """The word that goes with a count."""
    return one if count == 1 else many


def width_in(crop: Crop) -> float:
    """Width (inches) of a picture of a crop: the whole page for wide ones."""
    return WIDE_IN if is_wide(crop) else PANEL_IN


def of_side(side: Side, picture: Picture) -> Picture:
    """A picture in which frames are pressed where they are on that side."""
    if picture.clicks is None:
        return picture
    return replace(picture, clicks=replace(picture.clicks, side=side))


def sides(both: BeforeAfter) -> tuple[tuple[Side, Measures], tuple[Side, Measures]]:
    """Before and after, each with its name."""
    return ("before", both.before), ("after", both.after)


def side_by_side(pictures: Sequence[str], crop: Crop) -> str:
    """Before and after beside each other, or one above the other where both are wide."""
    return f'<div class="{"stack" if is_wide(crop) else "pair"}">{"".join(pictures)}</div>'


def captioned(picture: Picture, caption_html: str, alt: str) -> str:
    """A picture inside the page, its caption above it."""
    data = base64.b64encode(picture.png).decode("ascii")
    clicks = ""
    if picture.clicks is not None:
        clicks = f'data-clicks="{escape(json.dumps(asdict(picture.clicks)))}" '
    return (
        f"<figure><figcaption>{caption_html}</figcaption>"
        f'<img src="data:image/png;base64,{data}" alt="{escape(alt)}" {clicks}'
        f'width="{picture.width_px}" height="{picture.height_px}"></figure>'
    )

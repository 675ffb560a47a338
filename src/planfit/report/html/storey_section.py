"""The section of the report on storeys: where their plans lie, and the scan on each."""

from html import escape
from pathlib import PurePath

import numpy as np

from planfit.findings import frame_ranges
from planfit.geometry import se3
from planfit.pipeline.on_plan import Storey, Storeys
from planfit.report import formatting
from planfit.report.html import tables
from planfit.report.html.sections import overview
from planfit.report.plots.top_view import Crop
from planfit.report.storey_measures import StoreyMeasures
from planfit.segmentation import NO_STOREY


def storeys(found: Storeys, measured: tuple[StoreyMeasures, ...], crop: Crop) -> str:
    """A table of the storeys, and the scan on the plan of each.

    Args:
        found: of the result.
        measured: those with a plan.
        crop: what pictures show: the same of all storeys, as they stand over each other.
    """
    near = {each.number: each for each in measured}
    rows = [_row(storey, near) for storey in found.walked]
    heads = ("storey", "plan", "floor", "frames", "its plan lies", "wall points near it")
    n_stairs = int(np.sum(found.of_frames == NO_STOREY))
    html = [
        "<h2>Storeys</h2><p>Each storey is held to its own plan. Positions and heights are in the frame of "
        "the lowest of these plans, its floor at height 0; where another plan lies in it is what its own "
        f"coordinates are turned and moved by. {n_stairs} frames are on stairs: matches and the recorded "
        f"motion hold them.</p>{tables.table(heads, rows, 'wwnwwn')}"
    ]
    html += [
        overview(each.floorplan, each.both, crop, f"Storey {each.number}") for each in measured
    ]
    return "\n".join(html)


def _row(storey: Storey, near: dict[int, StoreyMeasures]) -> tuple[str, ...]:
    floor, frames = formatting.length(storey.floor_m), frame_ranges(storey.frames)
    if storey.own is None:
        return "", "none given", floor, frames, "", ""
    own, both = storey.own, near[storey.own.number].both
    yaw_deg = se3.wrapped_deg(float(se3.yaw_of(own.plan_from_own)))
    x, y, _ = own.plan_from_own[:3, 3]
    lies = "as drawn, in shared axes" if own.shares_axes else (
        f"turned by {yaw_deg:.2f}{formatting.SPACE}deg, moved by ({x:.2f}, {y:.2f}){formatting.SPACE}m"
    )  # fmt: skip
    if both.before.walls is None or both.after.walls is None:
        shares = "no wall was seen"
    else:
        shares = (
            f"{formatting.share(both.before.walls.near_share)} before, "
            f"{formatting.share(both.after.walls.near_share)} after"
        )
    name = escape(PurePath(own.floorplan.name).name)
    return str(own.number), name, floor, frames, lies, shares

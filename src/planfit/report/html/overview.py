"""Sections on where the scan lies: the whole of it from above, storey by storey, and scan by scan."""

from collections.abc import Sequence
from html import escape
from itertools import cycle
from pathlib import PurePath

import numpy as np

from planfit.findings import frame_ranges
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.pipeline.on_plan import Storey, Storeys
from planfit.pipeline.result import RefineResult
from planfit.report import formatting
from planfit.report.html import tables
from planfit.report.html.tables import captioned, side_by_side, sides, width_pt
from planfit.report.measures import BeforeAfter, KeyMetric, StoreyMeasures
from planfit.report.plots import colors
from planfit.report.plots.overlay import choose_close_ups, fit_in_words, side_picture
from planfit.report.plots.top_view import Crop, Mark
from planfit.segmentation import NO_STOREY
from planfit.units import share_reached


def three_numbers(result: RefineResult, metrics: Sequence[KeyMetric]) -> str:
    """How far off the cameras are expected to be, and the two metrics that are judged first."""
    verdict, expected_m = result.verdict, result.evidence.predicted_rms_m
    within = (
        f"expected position error (RMS); {share_reached(verdict.share_within)} of the frames are expected "
        f"within {formatting.length(verdict.tolerance_m, 'g')}"
    )
    shown = [("unknown" if np.isinf(expected_m) else formatting.length(expected_m), within)]
    for metric in metrics[:2]:
        before, after = (formatting.quantity(v, metric.unit) for v in (metric.before, metric.after))
        shown.append((after, f"{metric.name[0].lower()}{metric.name[1:]}; {before} before"))
    tiles = "".join(
        f"<div><strong>{escape(number)}</strong> {escape(words)}</div>" for number, words in shown
    )
    return f'<div class="numbers">{tiles}</div>'


def overview(
    floorplan: Floorplan | None,
    both: BeforeAfter,
    crop: Crop,
    marks: tuple[Mark, ...],
    storey: str = "",
) -> str:
    """The whole scan on the plan, or alone, before and after; or a storey of it, by name."""
    pictures = [
        captioned(
            side_picture(floorplan, both, side, crop, marks, width_pt(crop)),
            f"<strong>{name}:</strong> {escape(fit_in_words(both, side))}",
            f"{'Wall points' if both.has_plan else 'The scan'} {name}, from above",
            name,
        )
        for name, side in sides(both)
    ]
    if not both.has_plan:
        words = (
            "Seen from above: points at about the height of the camera, walls and furniture. Where the poses "
            "are right, one wall makes one line of dots, not several, and corners are sharp."
        )
    elif both.is_aligned:
        words = (
            "Seen from above. Each coloured dot is a scanned point of a wall; thin dark lines are "
            "the walls as drawn. Where the poses are right, dots lie on the lines, and one wall "
            "makes one line of dots, not several. Where the camera path runs through a drawn wall, "
            "there is an opening that the plan does not show, or the poses are wrong there."
        )
    else:
        words = "Seen from above. The scan was not aligned with the plan, so the plan is not drawn."
    head = f"<h2>{storey}</h2>" if storey else ""
    return f'{head}<div class="from-above">{side_by_side(pictures, crop)}</div><p>{words}</p>'


def close_ups(
    floorplan: Floorplan | None, both: BeforeAfter, marks: tuple[Mark, ...], of_storey: str = ""
) -> str:
    """The windows marked in the overview, of the whole or of a storey; empty where there are none."""
    if not marks or floorplan is None:
        return ""
    pictures = "\n".join(_close_up(floorplan, both, mark) for mark in marks)
    head = f"<h3>Close-ups of {of_storey}</h3>" if of_storey else "<h2>Close-ups</h2>"
    return f"{head}<p>The windows marked above, where before and after differ most.</p>{pictures}"


def _close_up(floorplan: Floorplan, both: BeforeAfter, mark: Mark) -> str:
    inside = mark.crop.contains(both.after.wall_xy)
    pictures = []
    for name, side in sides(both):
        distance = formatting.length(float(side.wall_distances_m[inside].mean()))
        pictures.append(
            captioned(
                side_picture(floorplan, both, side, mark.crop),
                f"<strong>{mark.letter}, {name}:</strong> these wall points lie {distance} from "
                "the plan on average",
                f"Close-up {mark.letter} {name}",
                name,
            )
        )
    return f'<div class="pair">{"".join(pictures)}</div>'


def storeys_section(found: Storeys, measured: tuple[StoreyMeasures, ...], crop: Crop) -> str:
    """A table of the storeys, and the scan on the plan of each, the same part of it, as they stand over each
    other."""
    near = {each.number: each for each in measured}
    rows = [_storey_row(storey, near) for storey in found.walked]
    heads = ("storey", "plan", "floor", "frames", "its plan lies", "wall points near it")
    n_stairs = int(np.sum(found.of_frames == NO_STOREY))
    html = [
        "<h2>Storeys</h2><p>Each storey is held to its own plan. Positions and heights are in the frame of "
        "the lowest of these plans, its floor at height 0; where another plan lies in it is what its own "
        f"coordinates are turned and moved by. {n_stairs} frames are on stairs: matches and the recorded "
        f"motion hold them.</p>{tables.table(heads, rows, 'wwnwwn')}"
    ]
    for each in measured:
        marks = choose_close_ups(each.both, crop)
        html.append(overview(each.floorplan, each.both, crop, marks, f"Storey {each.number}"))
        html.append(close_ups(each.floorplan, each.both, marks, f"storey {each.number}"))
    return "\n".join(html)


def _storey_row(storey: Storey, near: dict[int, StoreyMeasures]) -> tuple[str, ...]:
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


def scans_section(result: RefineResult) -> str:
    """A row for each scan, in the colour that its path is drawn in; empty of one scan alone."""
    if not result.scans:
        return ""
    predicted_m, rows = result.evidence.predicted_error_m, []
    of_scan = np.zeros(len(predicted_m), dtype=int)
    for k, own in enumerate(result.scans):
        of_scan[own.frames] = k
    pairs = of_scan[result.matches.pairs]
    for k, (own, color) in enumerate(zip(result.scans, cycle(colors.PATHS))):
        is_shared = (pairs == k).any(axis=1) & (pairs[:, 0] != pairs[:, 1])
        rows.append(
            (
                f'<span class="key" style="background:{color}"></span> {escape(own.name)}',
                f"{own.first} to {own.last}",
                escape(own.placed_by),
                formatting.count(int(is_shared.sum())),
                formatting.length(float(np.sqrt(np.mean(predicted_m[own.frames] ** 2)))),
            )
        )
    heads = ("scan", "frames", "placed by", "pairs with other scans", "expected error (RMS)")
    return (
        "<h2>Scans</h2><p>These scans were placed against each other and solved as one: all positions are in "
        "one frame. Frames are numbered one scan after the other; no recorded step is believed from one scan "
        "to the next. <code>scans/</code> holds the poses of each scan, in its own axes and on the plan.</p>"
        f"{tables.table(heads, rows, 'wnwnn')}"
    )

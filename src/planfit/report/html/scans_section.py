"""The section of the report on several scans: which frames are whose, how each was placed, how sure it is."""

from html import escape
from itertools import cycle

import numpy as np

from planfit.pipeline.result import RefineResult
from planfit.report import formatting
from planfit.report.html import tables
from planfit.report.plots.drawing import PATHS


def scans_section(result: RefineResult) -> str:
    """A row for each scan, in the colour that its path is drawn in."""
    predicted_m, rows = result.evidence.predicted_error_m, []
    of_scan = np.zeros(len(predicted_m), dtype=int)
    for k, own in enumerate(result.scans):
        of_scan[own.frames] = k
    pairs = of_scan[result.matches.pairs]
    for k, (own, color) in enumerate(zip(result.scans, cycle(PATHS))):
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

"""The registration of a run: a table, and what the record says."""

import math
from pathlib import Path
from typing import Any

from planfit.pipeline.registration import Registration

HEADER = "residual,unit,before,fit,held_out,count"
"""Columns of `registration.csv`, as docs/outputs.md has them."""


def write_registration(folder: Path, registration: Registration) -> None:
    """Write `registration.csv`.

    Raises:
        OSError: it cannot be written.
    """
    lines = [HEADER]
    for row in registration.rows:
        numbers = (row.before, row.fit, row.held_out)
        cells = ["" if v is None or not math.isfinite(v) else f"{v:.6f}" for v in numbers]
        name = row.name.replace('"', '""')
        lines.append(",".join([f'"{name}"', row.unit, *cells, str(row.count)]))
    for loop in registration.loops:
        (a, b), (c, d) = loop.first_frames, loop.last_frames
        name = f"loop of frames {a}-{b} and {c}-{d}"
        amounts = (
            ("median distance", loop.before_m, loop.after_m, loop.kept_out_m),
            ("mean distance", None, loop.mean_m, None),
            ("length of way", None, loop.way_m, None),
        )
        for what, *numbers in amounts:
            cells = ["" if v is None or not math.isfinite(v) else f"{v:.6f}" for v in numbers]
            lines.append(",".join([f'"{name}, {what}"', "m", *cells, str(loop.n_points)]))
    for each in registration.strength:
        lines.append(f'"{each.direction}, predicted sigma",{each.unit},,,{each.sigma:.6f},')
        lines += [
            f'"{each.direction}, fixed by {name}",share,,{share:.6f},,'
            for name, share in each.shares
        ]
    accuracy = {
        "accuracy at 95 %, predicted": registration.predicted_95_m,
        "accuracy at 95 %, by check points": registration.checked_95_m,
        f"accuracy at 95 %, stated {registration.loa}".strip(): registration.stated_95_m,
    }
    for name, value in accuracy.items():
        if value is not None and math.isfinite(value):
            lines.append(f'"{name}",m,,,{value:.6f},')
    (folder / "registration.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def registration_record(registration: Registration) -> dict[str, Any]:
    """For `run.json`."""

    def plain(value: float | None) -> float | None:
        return None if value is None or not math.isfinite(value) else float(value)

    return {
        "residuals": [
            {
                "name": row.name,
                "unit": row.unit,
                "before": plain(row.before),
                "fit": plain(row.fit),
                "held_out": plain(row.held_out),
                "count": row.count,
            }
            for row in registration.rows
        ],
        "strength": {
            each.direction: {
                "sigma": plain(each.sigma),
                "unit": each.unit,
                "shares": dict(each.shares),
                "weakest_frames": list(each.weakest_frames),
                "weakest_share": plain(each.weakest_share),
            }
            for each in registration.strength
        },
        "predicted_95_m": plain(registration.predicted_95_m),
        "checked_95_m": plain(registration.checked_95_m),
        "stated_95_m": plain(registration.stated_95_m),
        "usibd_loa": registration.loa or None,
        "basis": registration.basis,
    }

"""The registration of a run: a table, and what the record says."""

import math
from collections.abc import Iterable
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
        lines.append(_line(row.name, row.unit, numbers, row.count))
    for loop in registration.loops:
        (a, b), (c, d) = loop.first_frames, loop.last_frames
        name = f"loop of frames {a}-{b} and {c}-{d}"
        amounts = (
            ("median distance", loop.before_m, loop.after_m, loop.kept_out_m),
            ("mean distance", None, loop.mean_m, None),
            ("length of way", None, loop.way_m, None),
        )
        lines += [
            _line(f"{name}, {what}", "m", numbers, loop.n_points) for what, *numbers in amounts
        ]
    for link in registration.links:
        (a, b), (c, d) = link.first_frames, link.last_frames
        name = f"link of frames {a}-{b} and {c}-{d}"
        distances, overlap = (link.before_m, link.after_m, None), (None, link.overlap, None)
        lines.append(_line(f"{name}, mean distance", "m", distances, link.n_points))
        lines.append(_line(f"{name}, overlap", "share", overlap, link.n_pairs))
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


def _line(name: str, unit: str, numbers: Iterable[float | None], count: int) -> str:
    cells = ["" if v is None or not math.isfinite(v) else f"{v:.6f}" for v in numbers]
    quoted = name.replace('"', '""')
    return ",".join([f'"{quoted}"', unit, *cells, str(count)])


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

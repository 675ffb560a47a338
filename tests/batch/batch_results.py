"""Run folders as `planfit refine` leaves them, made in no time."""

import json
import os
import time
from pathlib import Path

from planfit.runtime.run_folder import RunFolder


def record_of(inputs, outcome="refined", reason="it is so", predicted_m=0.012, walls=(0.7, 0.98)):
    """What the batch reads of run.json."""
    reservation = {"words": "few frames", "advice": "take more"}
    check = {"name": "wall points within 0.1 m of the plan", "before": walls[0], "after": walls[1]}
    return {
        "inputs": inputs,
        "frames": 60,
        "checks": [check] if walls[0] is not None else [],
        "verdict": {
            "outcome": outcome,
            "reasons": [reason],
            "reservations": [reservation] if outcome.startswith("improved") else [],
            "predicted_error_rms_m": predicted_m,
        },
    }


def write_results(folder, inputs, overwrite=False, has_picture=False, **what):
    """A complete run folder."""
    with RunFolder.claimed(folder, inputs, overwrite) as run, run.writing() as staging:
        (staging / "run.json").write_text(json.dumps(record_of(inputs, **what)))
        (staging / "report.html").write_text("report")
        if has_picture:
            from PIL import Image  # not where a process has to start at once

            Image.new("RGB", (2392, 810), "white").save(staging / "overlay.png")


def until(condition, wait_s=60):
    """Wait until something is so."""
    end = time.monotonic() + wait_s
    while not condition():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.02)


def is_gone(pid):
    """Whether a process has ended; one that nobody waits for may still have its number."""
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "ZX"
    except ProcessLookupError:
        return True
    except FileNotFoundError:  # no Linux, or gone just now
        return False

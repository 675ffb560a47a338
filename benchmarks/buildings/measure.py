"""One case, run in a process of its own: what it came to, CPU seconds and peak memory."""

import hashlib
import resource
import sys
import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from faults.battery import digest_of
from faults.measure import CRASHED, REFUSED, How, KeypointsKept
from faults.scans import SHARED
from jaxtyping import Float

import planfit
from buildings.cases import Case, base_name
from buildings.changes import kept_frames
from buildings.judging import flipped, judge, moved_sigmas
from buildings.reading_cases import present
from buildings.rows import Row
from planfit.errors import PlanfitError

WITHIN_SIGMAS = 2.0
"""Of its predicted error a frame may move when a little is left out."""
_OF_POSES = ("changes.py", "judging.py", "laser_floors.py", "lounge.py", "sites.py")
_OF_ROWS = ("cases.py", "command.py", "failures.py", "table.py")


def digest_for(options: planfit.RefineOptions, seed: int, are_read: bool) -> str:
    """Changes when planfit's code, that of what is measured, the options or the seed do.

    `are_read`: of files that are only read, which drifts have no part in.
    """
    digest = hashlib.sha256(f"{digest_of(options)} {0 if are_read else seed}".encode())
    others = {path.name for path in Path(__file__).parent.glob("*.py")} - {*_OF_POSES, *_OF_ROWS}
    for name in sorted(others if are_read else (*_OF_POSES, "measure.py", "rows.py")):
        digest.update(name.encode() + (Path(__file__).parent / name).read_bytes())
    return digest.hexdigest()[:12]


def measure(case: Case, how: How) -> Row:
    """Run planfit on a case. What a user should be told is recorded as refused, other errors as crashed."""
    row = Row(
        case.number,
        case.name,
        how.digest,
        CRASHED,
        building=case.scan,
        change="" if case.building is None else case.change.name,
    )
    begin, cpu_begin = time.perf_counter(), time.process_time()
    try:
        row = _read(case, row) if case.reading is not None else _refined(case, how, row)
    except PlanfitError as error:
        said = str(error).replace(f"{SHARED}/", "")
        row = replace(row, exit_code=REFUSED, said=said)
    except Exception as error:  # whatever it is: the table goes on, and says so
        row = replace(row, said=f"{type(error).__name__}: {error}")
    # Linux counts kilobytes, macOS bytes.
    unit = 1e9 if sys.platform == "darwin" else 1e6
    return replace(
        row,
        seconds=round(time.perf_counter() - begin, 2),
        cpu_s=round(row.cpu_s or time.process_time() - cpu_begin, 2),
        peak_gb=round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit, 3),
    )


def _read(case: Case, row: Row) -> Row:
    assert case.reading is not None
    reading = case.reading.read()
    facts = [[f.what, f.right, f.found, bool(f.is_right)] for f in reading.facts]
    said = "; ".join(reading.doubts) or reading.refusal
    said = said.replace(f"{SHARED}/", "")
    return replace(
        row, exit_code=reading.exit_code, said=said, reading=reading.outcome, facts=facts
    )


def _refined(case: Case, how: How, row: Row) -> Row:
    assert case.building is not None
    inputs = case.inputs(case.building.inputs(how.cache_dir))
    runtime = KeypointsKept(workers=1, cache_dir=how.cache_dir)
    cpu_begin = time.process_time()
    result = planfit.refine(inputs.scan, inputs.floorplan, how.options, runtime)
    cpu_s = time.process_time() - cpu_begin
    places = np.column_stack([result.plan_from_cams[:, :3, 3], result.verdict.predicted_error_m])
    path = _places_path(how, case.name)
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, places)
    return judge(inputs, result, case.building.judged, replace(row, cpu_s=cpu_s))


def steadied(rows: Iterable[Row], cases: Iterable[Case], how: How) -> list[Row]:
    """Rows of which something was left out, beside those of which nothing was."""
    by_name = {row.name: row for row in rows}
    of_name = {case.name: case for case in cases}
    return [_steadied(row, of_name.get(name), by_name, how) for name, row in by_name.items()]


def _steadied(row: Row, case: Case | None, by_name: dict[str, Row], how: How) -> Row:
    if case is None or not case.change.is_steadiness or not row.decisions:
        return row
    base = by_name.get(base_name(case))
    if base is None or not base.decisions:
        return row
    row = replace(row, flipped=flipped(base.decisions, row.decisions))
    paths = [_places_path(how, name) for name in (base.name, row.name)]
    if not all(path.exists() for path in paths):
        return row
    before, now = (np.load(path) for path in paths)
    before = _present_in(before, len(now), row.change)
    moved = moved_sigmas(before, now)
    return replace(row, moved_within=float(np.mean(moved <= WITHIN_SIGMAS)))


def _present_in(places: Float[np.ndarray, "n 4"], n_left: int, change: str) -> np.ndarray:
    if n_left == len(places):
        return places
    return places[kept_frames(len(places), int(change.rpartition(" ")[2]))]


def _places_path(how: How, name: str) -> Path:
    return (
        how.cache_dir
        / "places"
        / f"{how.digest}-{hashlib.sha256(name.encode()).hexdigest()[:12]}.npy"
    )


def absent(case: Case) -> str:
    """What of a case is not on this machine, in a line; empty where all is."""
    if case.reading is not None:
        path = SHARED / case.reading.path
        return "" if present(case.reading) else f"{path} is absent (set PLANFIT_SHARED)"
    assert case.building is not None
    return case.building.absent()

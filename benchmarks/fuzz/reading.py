"""What one mutant does to the reader: the class of the outcome, and where it came from."""

import json
import math
import resource
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from fuzz.samples import Sample

MAX_BYTES = 2 * 2**30
"""More than this beyond what the process had before is no small file's due."""
MAX_LINE = 2500
GOOD = ("read", "refused", "warned")
"""Warnings of libraries beside a plan or a line are for `-v`: the command line shows none."""


@dataclass(frozen=True)
class Outcome:
    """What became of a mutant."""

    sample: str
    number: int
    kind: str
    """`read`, `refused` (one line), `warned`, `traceback`, `many lines`, `non-finite`, `memory`, `hang`,
    `crash`."""
    seconds: float
    where: str = ""
    """Of a fault: the exception, and the innermost line of planfit."""

    def as_line(self) -> str:
        """For the file of outcomes; what is good takes few bytes."""
        values = asdict(self)
        if self.kind in GOOD:
            del values["where"]
        return json.dumps(values)


def outcome_of(sample: Sample, number: int, folder: Path) -> Outcome:
    """Read a mutant as the command line would, and look at what was read."""
    from planfit.errors import PlanfitError

    begin, kind, where = time.perf_counter(), "read", ""
    before = _peak_bytes()
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            wrong = READERS[sample.kind](folder / sample.entry)
            if wrong:
                kind, where = "non-finite", wrong
        except PlanfitError as error:
            words = str(error)
            kind = (
                "refused"
                if words and "\n" not in words and len(words) <= MAX_LINE
                else "many lines"
            )
            where = "" if kind == "refused" else f"{len(words)} characters: {words[:200]!r}"
        except OSError as error:
            kind = (
                "refused" if error.errno is not None else "traceback"
            )  # the command line tells it in a line
            where = "" if kind == "refused" else _where(error)
        except BaseException as error:  # a panic of a library in Rust is no Exception
            kind, where = "traceback", _where(error)
    shown = [w for w in warned if not issubclass(w.category, DeprecationWarning | ResourceWarning)]
    if kind == "read" and shown:
        kind = "warned"
        place = f"{Path(shown[0].filename).name}:{shown[0].lineno}"
        where = f"{shown[0].category.__name__} at {place}: {str(shown[0].message)[:100]}"
    if _peak_bytes() - before > MAX_BYTES:
        kind, where = "memory", f"{(_peak_bytes() - before) / 2**30:.1f} GB"
    return Outcome(sample.name, number, kind, round(time.perf_counter() - begin, 3), where)


def _peak_bytes() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _where(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if "/planfit/" in f.filename] or frames
    place = f"{Path(own[-1].filename).name}:{own[-1].lineno}" if own else "?"
    return f"{type(error).__name__} at {place}: {str(error)[:120]}"


def _read_plan(path: Path) -> str:
    from planfit.floorplan import read_floorplan

    plan = read_floorplan(path)
    arrays = {"ends": plan.ends, "normals": plan.normals}
    if plan.openings is not None:
        arrays["openings"] = plan.openings
    return _not_finite(arrays)


def _read_scan(path: Path, poses: Path | None = None) -> str:
    from planfit.scan import ScanOptions, read_scan

    scan = read_scan(path, options=ScanOptions(poses=poses))
    lenses = np.array([[c.fx, c.fy, c.cx, c.cy, c.width, c.height] for c in scan.cameras])
    wrong = _not_finite(
        {"poses": scan.world_from_cams, "times": scan.timestamps, "cameras": lenses}
    )
    if wrong:
        return wrong
    for i in {0, len(scan) - 1}:
        depth = _frame(scan.files.depth, i)
        if depth is not None and np.isinf(depth).any():
            return f"depth of frame {i} is infinite"
        _frame(scan.files.color, i)
    return ""


def _frame(read: Callable[[int], np.ndarray | None], i: int) -> np.ndarray | None:
    """A frame that cannot be decoded takes no part, and is told."""
    from planfit.errors import ScanError

    try:
        return read(i)
    except ScanError:
        return None


def _read_laser(path: Path) -> str:
    return _read_scan(path, path.with_name("trajectory.txt"))


def _read_poses(path: Path) -> str:
    from planfit.scan.pose_files import read_poses

    return "" if len(read_poses(path).poses) else "no poses"


def _read_options(path: Path) -> str:
    from planfit.cli.parser import read_options
    from planfit.pipeline.options import RefineOptions

    weight = read_options(path, RefineOptions()).adjust.walls.weight
    return "" if math.isfinite(weight) else "weight"


def _read_edits(path: Path) -> str:
    from planfit.floorplan.edits import read_edits

    edits = read_edits(path)
    return _not_finite({"drop": edits.drop, **{f"keep {i}": k for i, k in enumerate(edits.keep)}})


def _read_points(path: Path) -> str:
    from planfit.survey.read import read_points

    points = read_points(path)  # a height may be unknown
    return _not_finite({"x, y": np.array([point.xyz[:2] for point in points])})


def _read_marks(path: Path) -> str:
    from planfit.survey.read import read_marks

    marks = read_marks(path, tuple(f"{i:04d}" for i in range(900)))
    return _not_finite({"pixels": np.array([m.uv for m in marks if m.uv is not None])})


def _read_corrections(path: Path) -> str:
    from planfit.corrections import read_corrections

    places = read_corrections(path).places
    return _not_finite({"plan": np.array([place.plan for place in places])})


def _read_g2o(path: Path) -> str:
    from planfit.lsq import read_g2o

    return _not_finite({"poses": read_g2o(path).target_from_cams})


def _read_jobs(path: Path) -> str:
    from planfit.batch.jobs import read_jobs
    from planfit.cli.batch import columns

    weights = [job.memory_gb for _, job in read_jobs(path, columns()) if job.memory_gb is not None]
    return _not_finite({"memory-gb": np.array(weights)})


def _read_run(path: Path) -> str:
    from planfit.cli.run_record import cache_of, read_record

    cache_of(path.parent)
    record = read_record(path.parent)
    times, poses = record.poses()
    return _not_finite(
        {
            "times": times,
            "poses": poses,
            "world_from_plan": record.world_from_plan,
            "plan_from_world_before": record.plan_from_world_before,
            "scale": np.array(record.scale_xy, dtype=float),
        }
    )


def _read_calibration(path: Path) -> str:
    from planfit.scan.lens_file import take_calibration

    camera = take_calibration(_blank_scan(), path).cameras[0]
    return _not_finite({"camera": np.array([camera.fx, camera.fy, camera.cx, camera.cy])})


@cache
def _blank_scan() -> Any:
    from planfit.geometry.camera import Camera
    from planfit.scan import scan_from_arrays

    depths = [np.ones((96, 128), np.float32)] * 2
    poses = np.tile(np.eye(4), (2, 1, 1))
    return scan_from_arrays(None, depths, Camera(128, 96, 100.0, 100.0, 63.5, 47.5), poses)


def _not_finite(arrays: dict[str, np.ndarray]) -> str:
    wrong = [name for name, values in arrays.items() if not np.isfinite(values).all()]
    return f"not finite: {', '.join(wrong)}" if wrong else ""


READERS: dict[str, Callable[[Path], str]] = {
    "plan": _read_plan,
    "scan": _read_scan,
    "laser": _read_laser,
    "poses": _read_poses,
    "options": _read_options,
    "edits": _read_edits,
    "points": _read_points,
    "marks": _read_marks,
    "corrections": _read_corrections,
    "g2o": _read_g2o,
    "calibration": _read_calibration,
    "jobs": _read_jobs,
    "run": _read_run,
}

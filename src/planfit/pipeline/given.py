"""What is given to `refine`, `align` and `refine_together`, refused there where it is of another type.

And what they run on without a runtime: progress where it can be seen, a cache where one is named.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from planfit.adjust import check_extra_terms
from planfit.compiled.making import compile_what_is_not_ready
from planfit.corrections import NO_CORRECTIONS, Corrections
from planfit.errors import OptionError, printable, require
from planfit.floorplan import Floorplan
from planfit.lsq import Term
from planfit.pipeline.observations import Observations
from planfit.pipeline.options import RefineOptions
from planfit.runtime import ProgressLine, Runtime
from planfit.runtime.short_repr import MAX_TEXT
from planfit.scan import Scan
from planfit.survey import Survey
from planfit.tracking import choose_keyframes

_READ = {
    "scan": "read one with planfit.read_scan",
    "floorplan": "read one with planfit.read_floorplan",
}


@dataclass(frozen=True)
class Given:
    """What one refinement starts from."""

    scan: Scan
    floorplan: Floorplan | Mapping[int, Floorplan] | None
    """One plan, a plan for each storey by its number, or none."""
    options: RefineOptions
    runtime: Runtime
    observations: Observations | None = None
    """What the scan shows, where a user knows it; else it is extracted."""
    extra_terms: tuple[Term, ...] = ()
    """Terms of a user's own in the adjustment on the plan."""
    survey: Survey | None = None
    corrections: Corrections = NO_CORRECTIONS

    def require_frames_of_terms(self) -> None:
        """Raise `OptionError` before any matching where the adjustment would refuse extra terms."""
        if not self.extra_terms:
            return
        if self.observations is None:
            scan = self.scan
            keyframe_idx = choose_keyframes(
                scan.world_from_cams, scan.timestamps, self.options.keyframes, scan.lacking
            )
        else:
            keyframe_idx = self.observations.keyframe_idx
        n_frames = len(self.scan)
        n_keyframes = n_frames if keyframe_idx is None else len(keyframe_idx)
        n_reduced = None if n_keyframes == n_frames else n_keyframes
        check_extra_terms(self.extra_terms, self.options.adjust, n_reduced)


@contextmanager
def running(runtime: Runtime | None, cache: str | Path | None, progress: bool) -> Iterator[Runtime]:
    """The runtime that a user gave, or one of what was asked for in its place.

    Args:
        cache: folder that keeps finished stages.
        progress: whether terminals and notebooks show how far it is.

    Raises:
        OptionError: there are a runtime and a cache.
        OutputError: kernels cannot be compiled.
    """
    if runtime is not None:
        require(
            cache is None,
            "cache: expected a folder or a runtime, found both; give planfit.Runtime(cache_dir=...) alone",
        )
        yield runtime
        return
    with ProgressLine() as line:
        is_shown = progress and line.is_shown
        if is_shown:
            compile_what_is_not_ready(line)
        folder = None if cache is None else Path(cache)
        yield Runtime(cache_dir=folder, on_progress=line if is_shown else None)


def require_given(scan: Any, floorplan: Any, options: Any, runtime: Any) -> None:
    """Raise `OptionError` where a path stands for a scan, a dict for options, and so on."""
    _require("scan", scan, Scan)
    for plan in floorplan.values() if isinstance(floorplan, Mapping) else (floorplan,):
        if plan is not None:
            _require("floorplan", plan, Floorplan)
    if options is not None:
        _require("options", options, RefineOptions)
    if runtime is not None:
        _require("runtime", runtime, Runtime)


def _require(name: str, value: Any, kind: type) -> None:
    if not isinstance(value, kind):
        shown = printable(repr(value))
        shown = shown if len(shown) <= MAX_TEXT else type(value).__name__
        advice = _READ.get(name, f"give one, planfit.{kind.__name__}(...)")
        raise OptionError(f"{name}: expected a {kind.__name__}, found {shown}; {advice}")

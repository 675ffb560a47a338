"""What is given to `refine`, `align` and `refine_together`, refused there where it is of another type."""

from collections.abc import Mapping
from typing import Any

from planfit.errors import OptionError, printable
from planfit.floorplan import Floorplan
from planfit.pipeline.options import RefineOptions
from planfit.runtime import Runtime
from planfit.scan import Scan

_READ = {
    "scan": "read one with planfit.read_scan",
    "floorplan": "read one with planfit.read_floorplan",
}
_MAX_SHOWN = 60


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
        shown = shown if len(shown) <= _MAX_SHOWN else type(value).__name__
        advice = _READ.get(name, f"give one, planfit.{kind.__name__}(...)")
        raise OptionError(f"{name}: expected a {kind.__name__}, found {shown}; {advice}")

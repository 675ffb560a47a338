"""planfit: fit a posed RGB-D scan of a building to its floorplan."""

from importlib import import_module
from threading import RLock
from typing import TYPE_CHECKING, Any

from planfit import errors as errors

if TYPE_CHECKING:
    from planfit.evaluation import CompareOptions as CompareOptions
    from planfit.evaluation import Comparison as Comparison
    from planfit.evaluation import EvaluateOptions as EvaluateOptions
    from planfit.evaluation import Truth as Truth
    from planfit.evaluation import compare as compare
    from planfit.evaluation import evaluate as evaluate
    from planfit.floorplan import Floorplan as Floorplan
    from planfit.floorplan import PlanOptions as PlanOptions
    from planfit.floorplan import read_floorplan as read_floorplan
    from planfit.lsq import Problem as Problem
    from planfit.lsq import Term as Term
    from planfit.matching import Matches as Matches
    from planfit.pipeline.align import AlignResult as AlignResult
    from planfit.pipeline.align import align as align
    from planfit.pipeline.observations import Observations as Observations
    from planfit.pipeline.observations import extract_observations as extract_observations
    from planfit.pipeline.options import RefineOptions as RefineOptions
    from planfit.pipeline.prepare import prepare as prepare
    from planfit.pipeline.refine import refine as refine
    from planfit.pipeline.result import RefineResult as RefineResult
    from planfit.pipeline.together import TogetherResult as TogetherResult
    from planfit.pipeline.together import refine_together as refine_together
    from planfit.runtime import Runtime as Runtime
    from planfit.scan import Scan as Scan
    from planfit.scan import ScanOptions as ScanOptions
    from planfit.scan import read_scan as read_scan
    from planfit.scan import scan_from_arrays as scan_from_arrays

__version__ = "0.1.0"

_HOMES = {
    "AlignResult": "planfit.pipeline.align",
    "CompareOptions": "planfit.evaluation",
    "Comparison": "planfit.evaluation",
    "EvaluateOptions": "planfit.evaluation",
    "Floorplan": "planfit.floorplan",
    "Matches": "planfit.matching",
    "Observations": "planfit.pipeline.observations",
    "PlanOptions": "planfit.floorplan",
    "Problem": "planfit.lsq",
    "RefineOptions": "planfit.pipeline.options",
    "RefineResult": "planfit.pipeline.result",
    "Runtime": "planfit.runtime",
    "Scan": "planfit.scan",
    "ScanOptions": "planfit.scan",
    "Term": "planfit.lsq",
    "TogetherResult": "planfit.pipeline.together",
    "Truth": "planfit.evaluation",
    "align": "planfit.pipeline.align",
    "compare": "planfit.evaluation",
    "evaluate": "planfit.evaluation",
    "extract_observations": "planfit.pipeline.observations",
    "prepare": "planfit.pipeline.prepare",
    "read_floorplan": "planfit.floorplan",
    "read_scan": "planfit.scan",
    "refine": "planfit.pipeline.refine",
    "refine_together": "planfit.pipeline.together",
    "scan_from_arrays": "planfit.scan",
}
"""Where each name comes from. It is imported when it is first asked for (PEP 562): all of planfit takes a
second or more, which `planfit --version` and tools that only look need not spend."""

__all__ = ["__version__", "errors", *sorted(_HOMES)]  # pyright: ignore[reportUnsupportedDunderAll]


_PACKAGES = (
    "adjust",
    "alignment",
    "evaluation",
    "lsq",
    "matching",
    "pipeline",
    "scan",
    "segmentation",
    "synth",
    "tracking",
)
_lock = RLock()
"""Threads that ask for several names at first would import packages that need each other at the same time."""


def __getattr__(name: str) -> Any:
    if name not in _HOMES and name not in _PACKAGES:
        raise AttributeError(f"module 'planfit' has no attribute {name!r}")
    with _lock:
        if name in _PACKAGES:
            return import_module(f"planfit.{name}")
        value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value  # found without this function from now on
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

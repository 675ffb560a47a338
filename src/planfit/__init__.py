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
    from planfit.export.poses import save_poses as save_poses
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

_NAMES = {
    "planfit.evaluation": (
        "CompareOptions",
        "Comparison",
        "EvaluateOptions",
        "Truth",
        "compare",
        "evaluate",
    ),
    "planfit.export.poses": ("save_poses",),
    "planfit.floorplan": ("Floorplan", "PlanOptions", "read_floorplan"),
    "planfit.lsq": ("Problem", "Term"),
    "planfit.matching": ("Matches",),
    "planfit.pipeline.align": ("AlignResult", "align"),
    "planfit.pipeline.observations": ("Observations", "extract_observations"),
    "planfit.pipeline.options": ("RefineOptions",),
    "planfit.pipeline.prepare": ("prepare",),
    "planfit.pipeline.refine": ("refine",),
    "planfit.pipeline.result": ("RefineResult",),
    "planfit.pipeline.together": ("TogetherResult", "refine_together"),
    "planfit.runtime": ("Runtime",),
    "planfit.scan": ("Scan", "ScanOptions", "read_scan", "scan_from_arrays"),
}
"""What each package or module gives to this one.

A name is imported when it is first asked for (PEP 562): all of planfit takes a second or more, which
`planfit --version` and tools that only look need not spend.
"""
_HOMES = {name: home for home, names in _NAMES.items() for name in names}

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

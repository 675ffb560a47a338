"""As built against as planned: a verdict on every wall of a plan, from a finished result
(docs/as-built.md)."""

from planfit.as_built.compare import compare_as_built, judge_walls
from planfit.as_built.types import AsBuilt, AsBuiltOptions, AsBuiltWall, Verdict, counted

__all__ = [
    "AsBuilt",
    "AsBuiltOptions",
    "AsBuiltWall",
    "Verdict",
    "compare_as_built",
    "counted",
    "judge_walls",
]

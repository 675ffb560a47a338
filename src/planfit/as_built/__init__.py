"""As built against as planned: a verdict on every wall and opening of a plan, from a finished result
(docs/as-built.md)."""

from planfit.as_built.compare import compare_as_built, judge_walls
from planfit.as_built.openings import (
    SURE_SIGMAS,
    AsBuiltOpening,
    ClosedBy,
    OpeningVerdict,
    counted_openings,
    opening_title,
    opening_words,
)
from planfit.as_built.record import AS_BUILT, read_as_built, write_as_built
from planfit.as_built.types import (
    AsBuilt,
    AsBuiltOptions,
    AsBuiltWall,
    Deviation,
    Verdict,
    counted,
    deviations,
    in_words,
    title,
)

__all__ = [
    "AS_BUILT",
    "SURE_SIGMAS",
    "AsBuilt",
    "AsBuiltOpening",
    "AsBuiltOptions",
    "AsBuiltWall",
    "ClosedBy",
    "Deviation",
    "OpeningVerdict",
    "Verdict",
    "compare_as_built",
    "counted",
    "counted_openings",
    "deviations",
    "in_words",
    "judge_walls",
    "opening_title",
    "opening_words",
    "read_as_built",
    "title",
    "write_as_built",
]

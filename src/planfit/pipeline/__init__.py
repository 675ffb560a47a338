"""The method from a scan and a plan to refined poses, stage by stage."""

from planfit.pipeline.options import RefineOptions as RefineOptions
from planfit.pipeline.refine import RefineResult as RefineResult
from planfit.pipeline.refine import refine as refine

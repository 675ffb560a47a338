"""Several scans of one building, refined together (docs/adr/0027-several-scans.md)."""

from planfit.pipeline.together.refine import refine_together as refine_together
from planfit.pipeline.together.result import RefinedScan as RefinedScan
from planfit.pipeline.together.result import TogetherResult as TogetherResult

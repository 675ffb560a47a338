"""planfit: fit a posed RGB-D scan of a building to its floorplan."""

__version__ = "0.1.0"

from planfit import errors as errors
from planfit.floorplan import read_floorplan as read_floorplan
from planfit.pipeline.options import RefineOptions as RefineOptions
from planfit.pipeline.refine import RefineResult as RefineResult
from planfit.pipeline.refine import refine as refine
from planfit.scan import read_scan as read_scan

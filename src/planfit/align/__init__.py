"""Where on the plan the scan is."""

from planfit.align.align import Alignment as Alignment
from planfit.align.align import AlignOptions as AlignOptions
from planfit.align.align import align as align
from planfit.align.align import sample_walls as sample_walls
from planfit.align.units import find_unit as find_unit

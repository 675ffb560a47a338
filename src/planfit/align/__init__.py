"""Where on the plan the scan is."""

from planfit.align.align import Alignment as Alignment
from planfit.align.align import AlignOptions as AlignOptions
from planfit.align.align import align as align
from planfit.align.align import sample_walls as sample_walls

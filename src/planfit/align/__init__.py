"""Where on the plan the scan is."""

from planfit.align.align import Alignment as Alignment
from planfit.align.align import align as align
from planfit.align.options import AlignOptions as AlignOptions
from planfit.align.paper import align_paper as align_paper
from planfit.align.pins import Pin as Pin
from planfit.align.pins import place_pins as place_pins
from planfit.align.refine import Fit as Fit
from planfit.align.scales import metric_plan as metric_plan
from planfit.align.units import find_unit as find_unit
from planfit.align.walls import WallSamples as WallSamples
from planfit.align.walls import sample_walls as sample_walls

"""Where on the plan the scan is."""

from planfit.align.align import Alignment as Alignment
from planfit.align.align import align as align
from planfit.align.align import find_unit as find_unit
from planfit.align.control_points import ControlPoint as ControlPoint
from planfit.align.control_points import place_control_points as place_control_points
from planfit.align.options import AlignOptions as AlignOptions
from planfit.align.paper import align_paper as align_paper
from planfit.align.refine import AlignmentHypothesis as AlignmentHypothesis
from planfit.align.refine import metric_plan as metric_plan
from planfit.align.wall_samples import WallSamples as WallSamples
from planfit.align.wall_samples import sample_walls as sample_walls

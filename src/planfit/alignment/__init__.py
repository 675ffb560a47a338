"""Where on the plan the scan is."""

from planfit.alignment.adjusted import AdjustedAlignment as AdjustedAlignment
from planfit.alignment.adjusted import judge_adjusted as judge_adjusted
from planfit.alignment.align import Alignment as Alignment
from planfit.alignment.align import align as align
from planfit.alignment.align import is_clearly_better as is_clearly_better
from planfit.alignment.control_points import ControlPoint as ControlPoint
from planfit.alignment.control_points import read_control_points as read_control_points
from planfit.alignment.evidence import PlanEvidence as PlanEvidence
from planfit.alignment.evidence import plan_evidence as plan_evidence
from planfit.alignment.options import AlignOptions as AlignOptions
from planfit.alignment.paper import align_paper as align_paper
from planfit.alignment.plan_scale import find_plan_scale as find_plan_scale
from planfit.alignment.plan_scale import find_unit as find_unit
from planfit.alignment.plan_scale import is_off as is_off
from planfit.alignment.plan_scale import may_be_rescaled as may_be_rescaled
from planfit.alignment.plan_scale import scale_words as scale_words
from planfit.alignment.plan_scale import told_of as told_of
from planfit.alignment.refine import AlignmentHypothesis as AlignmentHypothesis
from planfit.alignment.refine import metric_plan as metric_plan
from planfit.alignment.wall_samples import WallSamples as WallSamples
from planfit.alignment.wall_samples import sample_walls as sample_walls
from planfit.alignment.wall_thickness import find_half_thickness as find_half_thickness
from planfit.alignment.wall_thickness import thickness_words as thickness_words

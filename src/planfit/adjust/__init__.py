"""The bundle adjustment: association with the plan, terms, and their order."""

from planfit.adjust.association import PlanCorrespondences as PlanCorrespondences
from planfit.adjust.competition import Competition as Competition
from planfit.adjust.competition import Rival as Rival
from planfit.adjust.extra_terms import check_extra_terms as check_extra_terms
from planfit.adjust.keyframes import Keyframes as Keyframes
from planfit.adjust.keyframes import follow_keyframes as follow_keyframes
from planfit.adjust.keyframes import hold_to_keyframes as hold_to_keyframes
from planfit.adjust.keyframes import reduce_measurements as reduce_measurements
from planfit.adjust.measurements import Measurements as Measurements
from planfit.adjust.moved_walls import MovedWall as MovedWall
from planfit.adjust.moved_walls import describe_moved as describe_moved
from planfit.adjust.moved_walls import name_walls as name_walls
from planfit.adjust.options import AdjustOptions as AdjustOptions
from planfit.adjust.paper.descent import PaperWeights as PaperWeights
from planfit.adjust.paper.preset import paper_options as paper_options
from planfit.adjust.problem import AdjustmentProblem as AdjustmentProblem
from planfit.adjust.problem import build_problem as build_problem
from planfit.adjust.problem import costs as costs
from planfit.adjust.scale import refit_scale as refit_scale
from planfit.adjust.schedule import ClosedLoops as ClosedLoops
from planfit.adjust.schedule import PlanAdjustment as PlanAdjustment
from planfit.adjust.schedule import adjust_to_plan as adjust_to_plan
from planfit.adjust.schedule import close_loops as close_loops
from planfit.adjust.schedule import close_loops_untorn as close_loops_untorn
from planfit.adjust.torn_steps import TornStep as TornStep
from planfit.lsq.solver import Solution as Solution

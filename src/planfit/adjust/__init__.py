"""The bundle adjustment: terms, moments, solver, association, and their order."""

from planfit.adjust.alternate import WallsPulled as WallsPulled
from planfit.adjust.alternate import close_loops as close_loops
from planfit.adjust.alternate import pull_walls as pull_walls
from planfit.adjust.evidence import Evidence as Evidence
from planfit.adjust.keyframes import Keyframes as Keyframes
from planfit.adjust.keyframes import choose_keyframes as choose_keyframes
from planfit.adjust.keyframes import follow_keyframes as follow_keyframes
from planfit.adjust.keyframes import reduce_evidence as reduce_evidence
from planfit.adjust.options import AdjustOptions as AdjustOptions
from planfit.adjust.options import KeyframeOptions as KeyframeOptions
from planfit.adjust.paper import paper_options as paper_options
from planfit.adjust.refit_scale import refit_scale as refit_scale
from planfit.adjust.sgd import PaperWeights as PaperWeights
from planfit.adjust.solver import Solution as Solution
from planfit.adjust.ties import Ties as Ties
from planfit.adjust.ties import costs as costs

"""A sparse least-squares engine over SE(3) poses: terms, robust losses, solvers, covariances.

It knows nothing of scans or plans. `docs/api/engine.md` is its guide:

    solution = Problem([BetweenTerm(...), PosePriorTerm(...)], initial_target_from_cams).solve()
"""

from planfit.lsq.blocks import NormalBlocks as NormalBlocks
from planfit.lsq.bounded import Allowance as Allowance
from planfit.lsq.bounded import BoundedSolution as BoundedSolution
from planfit.lsq.bounded import solve_bounded as solve_bounded
from planfit.lsq.g2o import PoseGraph as PoseGraph
from planfit.lsq.g2o import read_g2o as read_g2o
from planfit.lsq.g2o import write_g2o as write_g2o
from planfit.lsq.pose_terms import BetweenTerm as BetweenTerm
from planfit.lsq.pose_terms import PosePriorTerm as PosePriorTerm
from planfit.lsq.problem import Problem as Problem
from planfit.lsq.residual_term import ResidualTerm as ResidualTerm
from planfit.lsq.robust import Loss as Loss
from planfit.lsq.robust import LossKind as LossKind
from planfit.lsq.robust import loss_value as loss_value
from planfit.lsq.solver import Cost as Cost
from planfit.lsq.solver import Solution as Solution
from planfit.lsq.solver import SolverOptions as SolverOptions
from planfit.lsq.solver import Stop as Stop
from planfit.lsq.term import Graduated as Graduated
from planfit.lsq.term import NamesPoses as NamesPoses
from planfit.lsq.term import Quadratic as Quadratic
from planfit.lsq.term import Term as Term

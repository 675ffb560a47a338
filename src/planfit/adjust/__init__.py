"""The bundle adjustment: terms, moments, solver, association, and their order."""

from planfit.adjust.alternate import AdjustOptions as AdjustOptions
from planfit.adjust.alternate import Evidence as Evidence
from planfit.adjust.alternate import WallsPulled as WallsPulled
from planfit.adjust.alternate import close_loops as close_loops
from planfit.adjust.alternate import pull_walls as pull_walls
from planfit.adjust.solver import Solution as Solution

"""A least-squares problem over poses: terms, where to begin, and ways to solve it."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import OptionError, require
from planfit.geometry.se3 import Poses
from planfit.lsq.covariance import covariances
from planfit.lsq.solver import DEFAULTS, Solution, SolverOptions, solve
from planfit.lsq.term import NamesPoses, Term, check_poses, robust_cost, widened
from planfit.runtime.short_repr import short_repr

_GNC_SCHEDULE = (8.0, 4.0, 2.0, 1.0)
"""Factors on the scales of losses, the last of them 1."""


@dataclass(frozen=True)
class Problem:
    """Minimise the sum of the terms over all poses.

    Raises:
        OptionError: there are no poses (n, 4, 4) or they are not finite, something is no term, two terms
            share a name, or a term names a pose that is not there.
    """

    terms: Sequence[Term]
    initial_target_from_cams: Poses
    """Where a solve begins."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        """Check poses and terms."""
        check_poses("problem: expected finite initial poses", self.initial_target_from_cams)
        for term in self.terms:
            self._check(term)
        names = Counter(term.name for term in self.terms)
        twice = [name for name, count in names.items() if count > 1]
        require(
            not twice, f"problem: expected a name of its own for each term, found {twice} again"
        )

    def cost(self, target_from_cams: Poses) -> float:
        """Sum of the robust costs at poses."""
        return robust_cost(self.terms, target_from_cams)

    def solve(self, options: SolverOptions = DEFAULTS) -> Solution:
        """Levenberg-Marquardt with reweighting, from the initial poses.

        Raises:
            OptionError: there are no terms, a term's cost is not finite there, or the linear solver is not
                installed.
        """
        return solve(self.terms, self.initial_target_from_cams, options)

    def solve_gnc(
        self,
        schedule: Sequence[float] = _GNC_SCHEDULE,
        options: SolverOptions = DEFAULTS,
    ) -> Solution:
        """Graduated non-convexity: solve with wide losses, which have few minima, then with narrower ones.

        Each solve begins where the last one ended (Blake and Zisserman 1987; Yang et al. 2020). Only the
        terms that are `Graduated` take part; the others stay as they are.

        Args:
            schedule: factors on the scales of losses, one solve each.
            options: when each solve ends.

        Returns:
            The last solve's solution, whose costs and iterations are its own.

        Raises:
            OptionError: the schedule is empty, or a factor is not above 0; and as `solve` does.
        """
        require(
            len(schedule) > 0 and all(factor > 0 for factor in schedule),
            f"problem: expected a GNC schedule of factors above 0, found {tuple(schedule)}",
        )
        factor, *narrower = schedule
        solution = solve(widened(self.terms, factor), self.initial_target_from_cams, options)
        for factor in narrower:
            solution = solve(widened(self.terms, factor), solution.target_from_cams, options)
        return solution

    def covariances(
        self, target_from_cams: Poses, idx: Int[np.ndarray, " k"] | Sequence[int]
    ) -> Float[np.ndarray, "k 6 6"]:
        """Covariances of the poses `idx` where a solve ended; see `planfit.lsq.covariance`."""
        return covariances(self.terms, target_from_cams, np.asarray(idx, dtype=int))

    def _check(self, term: Term) -> None:
        if not isinstance(term, Term):
            raise OptionError(
                f"problem: expected terms with a name and reweight(), found {type(term).__name__}"
            )
        n = len(self.initial_target_from_cams)
        idx = np.asarray(term.pose_idx) if isinstance(term, NamesPoses) else np.zeros(0)
        outside = idx[(idx < 0) | (idx >= n)]
        if len(outside):
            raise OptionError(
                f"term {term.name!r}: expected indices of {n} poses (0 to {n - 1}), "
                f"found {int(outside[0])}"
            )

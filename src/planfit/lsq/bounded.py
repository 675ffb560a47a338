"""Least squares with an inequality constraint, as in IBA (paper, Sec. V-B; Lhuillier 2011).

The bounded terms alone, bundle adjustment's for instance, are brought to their minimum e* first. Then the
other terms are minimised together with the barrier gamma / (e_t - e), where e is the bounded terms' cost and
e_t the bound on it: it is small while there is room and grows without limit at the bound, so the bounded
terms pay for the others by at most e_t - e*.

The bound is on errors: e_t is what the bounded terms would cost at their minimum, were all of their residuals
1.05 times as large. Lhuillier's costs are sums of squares, so his e_t is 1.05^2 e*; unsquared norms, the
paper's, grow as their residuals do, and theirs is 1.05 e*. In general a cost grows as a power of the common
size c of its residuals: c^p with p = d log e / d log c. With e the sum of rho(s) / 2 over s = residual^2,
d e / d log c is the sum of rho'(s) s, twice the cost of the frozen squares. So p is twice their cost over
the robust one: 2 for squares, 1 for norms, and less the more of the cost is that of outliers.

The barrier is judged on the robust cost itself, reweighted at every candidate, and is infinite from
the bound on. The solver takes no step that raises the cost, hence none across the bound.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planfit.errors import OptionError, require_positive
from planfit.geometry.se3 import Poses
from planfit.lsq.blocks import NormalBlocks
from planfit.lsq.problem import Problem
from planfit.lsq.solver import Cost, Solution, SolverOptions
from planfit.lsq.term import Term, robust_cost

BARRIER_SHARE = 0.01
"""Barrier over the cost of the other terms where the second round begins; sets gamma. Less comes
closer to the bound and takes more rounds: against a plan that disagrees with the scan, 0.1, 0.01 and
0.001 used an eighth, two thirds and nine tenths of the room, in about 20, 20 and 40 rounds."""


@dataclass(frozen=True)
class Allowance:
    """How much the bounded terms may pay for the others."""

    error_factor: float = 1.05
    """Residuals of the bounded terms at the bound over those at the minimum. Its square bounds a cost of
    squares, itself a cost of unsquared norms; losses between the two are bounded between."""
    slack: float = 1e-3
    """Added to the bound, in units of the cost (of squares: half of squared sigmas): where the bounded terms
    fit without any error, a bound at a multiple of nothing would leave no room at all."""

    def __post_init__(self) -> None:
        require_positive(self, "slack")
        if not self.error_factor >= 1:
            raise OptionError(
                f"Allowance.error_factor: expected at least 1, found {self.error_factor}"
            )


@dataclass(frozen=True)
class BoundedSolution:
    """Both rounds; `solution` is the second one's, whose costs name the barrier as such."""

    solution: Solution
    alone: Solution
    """The first round: the bounded terms alone."""
    bound: float
    """e_t, which their cost stays below."""
    bounded_cost: Cost
    """Their robust cost where the second round began and ended."""


@dataclass(frozen=True)
class BarrierTerm:
    """gamma / (bound - e), infinite at and beyond the bound; its own quadratic (see the module's page)."""

    bounded_terms: tuple[Term, ...]
    least: float
    """e*, the cost of the bounded terms at its minimum."""
    bound: float
    """e_t, above `least`."""
    gamma: float
    name: str = "barrier"

    def reweight(self, target_from_cams: Poses) -> tuple["BarrierTerm", float]:
        """Nothing is frozen: weights are renewed wherever the cost is asked for."""
        return self, self.cost(target_from_cams)

    def cost(self, target_from_cams: Poses) -> float:
        """The barrier at these poses."""
        room = self.bound - robust_cost(self.bounded_terms, target_from_cams)
        return self.gamma / room if room > 0 else math.inf

    def normal_blocks(self, target_from_cams: Poses) -> NormalBlocks:
        """Gradient, and a Hessian that bounds the Gauss-Newton one from above.

        With f(e) = gamma / (e_t - e), g and H of e: gradient f' g, Hessian f' H + f'' g g^T. The last is
        dense over all poses; but (g . d)^2 <= (g H^-1 g) (d H d) = 2 (e - e*) (d H d) where e is a
        parabola, so (f' + 2 (e - e*) f'') H takes its place. Near the bound this halves the rounds that
        f' H alone takes.
        """
        reweighted = [term.reweight(target_from_cams) for term in self.bounded_terms]
        cost = sum(cost for _, cost in reweighted)
        room = self.bound - cost
        slope = self.gamma / room**2
        curvature = slope * (1.0 + 4.0 * max(cost - self.least, 0.0) / room)
        parts = [quadratic.normal_blocks(target_from_cams) for quadratic, _ in reweighted]
        return NormalBlocks(
            np.concatenate([p.rows for p in parts]),
            np.concatenate([p.columns for p in parts]),
            curvature * np.concatenate([p.blocks for p in parts]),
            slope * np.sum([p.gradient for p in parts], axis=0),
        )


def growth_power(terms: Sequence[Term], target_from_cams: Poses) -> float:
    """Power with which the terms' cost at these poses grows with the common size of their residuals.

    2 for squares, 1 for unsquared norms; see the module's page. 2 where nothing costs anything.
    """
    reweighted = [term.reweight(target_from_cams) for term in terms]
    cost = sum(cost for _, cost in reweighted)
    if cost <= 0:
        return 2.0
    return 2.0 * sum(frozen.cost(target_from_cams) for frozen, _ in reweighted) / cost


def solve_bounded(
    bounded_terms: Sequence[Term],
    other_terms: Sequence[Term],
    initial_target_from_cams: Poses,
    allowance: Allowance,
    solver_options: SolverOptions,
) -> BoundedSolution:
    """Minimise `other_terms` while that of `bounded_terms` stays below a bound slightly above its minimum.

    Args:
        bounded_terms: one or more; a bundle adjustment's, and pose priors if they shall count.
        other_terms: with none of them the second round has nothing to gain.
        initial_target_from_cams: where the first round begins.
        allowance: see there.
        solver_options: when each of the two rounds ends.

    Raises:
        OptionError: as `Problem` and its `solve` do; a term is called "barrier".
    """
    terms, others = tuple(bounded_terms), tuple(other_terms)
    alone = Problem(terms, initial_target_from_cams).solve(solver_options)
    start = alone.target_from_cams
    least = robust_cost(terms, start)
    growth = allowance.error_factor ** growth_power(terms, start)
    bound = growth * least + allowance.slack
    paid = robust_cost(others, start)
    # Where the others cost nothing any gamma will do.
    gamma = BARRIER_SHARE * (bound - least) * (paid or 1.0)
    barrier = BarrierTerm(terms, least, bound, gamma)
    solution = Problem([*others, barrier], start).solve(solver_options)
    cost = Cost(least, robust_cost(terms, solution.target_from_cams))
    return BoundedSolution(solution, alone, bound, cost)

"""Levenberg-Marquardt over poses, with iterated reweighting for robust losses."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import Literal

import numpy as np
from threadpoolctl import ThreadpoolController

from planfit.errors import OptionError, require, require_choice, require_positive
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.lsq.normal_equations import BlockPattern, LinearSolver, NormalEquations
from planfit.lsq.term import Quadratic, Term
from planfit.runtime.short_repr import short_repr

log = logging.getLogger(__name__)

STEPS_PER_REWEIGHTING = 2
"""Steps taken before weights are renewed; they cost little beside the pass over the points."""
INITIAL_DAMPING = 1e-4
"""Damping of the first step, relative to the diagonal of the normal equations."""


class Stop(Enum):
    """Why a solve ended."""

    COST = "the cost no longer changes"
    LIMIT = "the iteration limit was reached; the poses may still be moving"
    STUCK = "no step lowers the cost any further"


@dataclass(frozen=True)
class SolverOptions:
    """When a solve ends."""

    max_iterations: int = 50
    """Reweighting rounds at most."""
    cost_tolerance: float = 1e-5
    """Ends when a round lowers the robust cost by less than this share of itself."""
    linear_solver: LinearSolver = "auto"
    """How a step is solved for: `direct` (sparse factorisation), `cg` (conjugate gradients), `pardiso` (MKL's
    factorisation, an extra), or `auto`: direct where loops fill the factor little, else cg."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Where points are reweighted: 3D points, floor, ceiling, walls and columns also go through on a GPU,
    by PyTorch. Steps are made and solved for on the CPU."""

    def __post_init__(self) -> None:
        require_choice(self, "linear_solver", "auto", "direct", "cg", "pardiso")
        require_choice(self, "device", "cpu", "cuda")
        require_positive(self, "max_iterations")


DEFAULTS = SolverOptions()


@dataclass(frozen=True)
class Cost:
    """Robust cost of one term at the start and at the end of a solve."""

    before: float
    after: float


@dataclass(frozen=True)
class Solution:
    """Poses that a solve ended with, and how it got there."""

    target_from_cams: Poses
    stop: Enum
    """Why it ended: a `Stop`, or that of another solver; its value is a sentence."""
    iterations: int
    """Rounds of reweighting, or steps of a descent."""
    cost_by_term: dict[str, Cost]

    __repr__ = short_repr


def solve(
    terms: Sequence[Term], initial_target_from_cams: Poses, options: SolverOptions
) -> Solution:
    """Minimise the sum of the terms over all poses: what `Problem.solve` does.

    Each round freezes the robust weights (one pass over the points), then takes damped Gauss-Newton
    steps on the frozen squares, which lie above the robust cost and touch it: a step that lowers them
    lowers it. Damping follows Nielsen (1999), so a rejected step costs one solve.

    Raises:
        OptionError: there are no terms, or a term's cost is not finite at the initial poses.
    """
    require(
        len(terms) > 0, "problem: expected at least one term to minimise, found none; add terms"
    )
    poses = initial_target_from_cams
    reweighted = [term.reweight(poses) for term in terms]
    before = [cost for _, cost in reweighted]
    _require_finite(terms, before)
    total, stop, damping = sum(before), Stop.LIMIT, INITIAL_DAMPING
    iterations = 0
    rounding = 1e-12 * total  # below, actual over predicted decrease is noise
    # OpenBLAS threads spin between the many small products and slow them down.
    with _thread_pools().limit(limits=1, user_api="blas"):
        pattern: BlockPattern | None = None
        for iterations in range(1, options.max_iterations + 1):
            quadratics = [quadratic for quadratic, _ in reweighted]
            outcomes, least = [], options.cost_tolerance * total
            cost = _cost(quadratics, poses)
            for _ in range(STEPS_PER_REWEIGHTING):
                blocks = [quadratic.normal_blocks(poses) for quadratic in quadratics]
                equations = NormalEquations(blocks, len(poses), pattern)
                pattern = equations.pattern
                earlier = cost
                poses, cost, damping, outcome = _damped_step(
                    equations, quadratics, (poses, cost), damping, rounding, options.linear_solver
                )
                outcomes.append(outcome)
                # After a step that gained next to nothing, the next one with the same weights gains less.
                if outcome is not _Outcome.MOVED or earlier - cost < least:
                    break
            if outcomes[0] is not _Outcome.MOVED:
                stop = Stop.COST if outcomes[0] is _Outcome.CONVERGED else Stop.STUCK
                break
            reweighted = [term.reweight(poses) for term in terms]
            previous, total = total, sum(cost for _, cost in reweighted)
            log.debug("round %d: cost %.6g", iterations, total)
            if previous - total < options.cost_tolerance * max(previous, 1e-12):
                stop = Stop.COST
                break
    costs = {
        term.name: Cost(first, last)
        for term, first, (_, last) in zip(terms, before, reweighted, strict=True)
    }
    return Solution(poses, stop, iterations, costs)


def _require_finite(terms: Sequence[Term], costs: Sequence[float]) -> None:
    for term, cost in zip(terms, costs, strict=True):
        if not np.isfinite(cost):
            raise OptionError(
                f"term {term.name!r}: expected a finite cost at the initial poses, found {cost}; "
                "look for NaN or infinity in its data"
            )


@cache
def _thread_pools() -> ThreadpoolController:
    """The libraries' thread pools; looking for them takes 2.5 ms, a tenth of a small solve."""
    return ThreadpoolController()


class _Outcome(Enum):
    """What became of a step."""

    MOVED = "the cost fell"
    CONVERGED = "the cost can fall by no more than rounding"
    STUCK = "no damping made the cost fall"


def _cost(quadratics: Sequence[Quadratic], poses: Poses) -> float:
    return sum(q.cost(poses) for q in quadratics)


def _damped_step(
    equations: NormalEquations,
    quadratics: Sequence[Quadratic],
    start: tuple[Poses, float],
    damping: float,
    rounding: float,
    linear_solver: LinearSolver,
    max_tries: int = 8,
) -> tuple[Poses, float, float, _Outcome]:
    """One accepted step, or the same poses where none of `max_tries` dampings lowers the cost.

    Starts from poses and their cost; returns both, the damping of the next step, and what became of this one.
    """
    (poses, cost), growth = start, 2.0
    for _ in range(max_tries):
        try:
            delta = equations.step(damping, linear_solver)
        except np.linalg.LinAlgError:
            damping, growth = damping * growth, growth * 2
            continue
        candidate = se3.retract(poses, delta)
        predicted = equations.predicted_decrease(delta)
        if predicted <= rounding:
            return poses, cost, damping, _Outcome.CONVERGED
        new_cost = _cost(quadratics, candidate)
        gain = (cost - new_cost) / predicted
        if gain > 0:
            damping *= max(1 / 3, 1 - (2 * gain - 1) ** 3)
            return candidate, new_cost, damping, _Outcome.MOVED
        damping, growth = damping * growth, growth * 2
    return poses, cost, damping, _Outcome.STUCK

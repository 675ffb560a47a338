"""Walls that all other evidence contradicts are let go of, one by one, the surest first.

`moved_walls` finds walls by their distance from where they are drawn; where few others hold the poses, these
bend to a wall that was moved and it lies as drawn. `uncertainty.wall_tests` finds it by what resists. What it
says is believed where, the wall let go of, its patches agree on an offset.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from planfit.adjust.alternation import Alternation, PlanTask, go_on, without_moved_walls
from planfit.adjust.competition import Rival, rival_by_odds
from planfit.adjust.moved_walls import MAX_OFFSET_M, MIN_OFFSET_M
from planfit.adjust.problem import AdjustmentProblem
from planfit.adjust.uncertainty.error_model import ErrorModel
from planfit.adjust.uncertainty.wall_tests import WallTest, run_wall_tests
from planfit.geometry import se3
from planfit.geometry.se3 import Poses

MIN_ODDS = 10.0
"""That a wall was moved, for each time that it was not: then it is let go of."""
MAX_WALLS = 10
"""So many are let go of at most: with more the plan is of another building, or the poses are off."""
MIN_RIVAL_ODDS = 0.05
"""A wall less likely to have been moved is no rival of the result; and no test is surer than that a wall that
was let go of was moved."""

Errors = Callable[[AdjustmentProblem], ErrorModel]
"""What the residuals of a problem tell where it is solved."""


def without_contradicted_walls(
    task: PlanTask, end: Alternation, errors: Errors
) -> tuple[Alternation, tuple[Rival, ...]]:
    """Go on from where an adjustment ended without walls that contradict the rest, and what else may be.

    Where either of two walls would explain the same (one of two that face each other was moved), none is let
    go of: both are rivals.

    Returns:
        where it ends; and as rivals, where the poses would be if a wall was moved that was not let go of, or
        one was not that was.
    """
    rivals: list[Rival] = []
    known: tuple[int, ...] = ()
    refused: set[tuple[int, ...]] = set()
    tests = _tests(task, end, errors)
    for _ in range(MAX_WALLS):
        likely = [t for t in tests if t.faces not in refused and _is_likely(t)]
        if not likely:
            break
        best, *_ = likely
        again = _without(task, end, best, known)
        tests_again = () if again is None else _tests(task, again, errors)
        if again is None or _is_one_of_two(best, tests, tests_again):
            refused.add(best.faces)
            continue
        rivals.append(rival_by_odds(end.plan_from_cams, MIN_RIVAL_ODDS))
        end, tests, known = again, tests_again, (*known, *best.faces)
    return end, (*rivals, *_rivals(end, tests))


def _is_likely(test: WallTest) -> bool:
    off_m = abs(test.offsets_m[0])
    return test.odds >= MIN_ODDS and MIN_OFFSET_M <= off_m <= MAX_OFFSET_M


def _is_one_of_two(best: WallTest, before: Sequence[WallTest], after: Sequence[WallTest]) -> bool:
    """Whether another wall was nearly as likely to have been moved, and is not once the best one was."""
    left = {test.faces: test.odds for test in after}
    # Odds of a million are no surer than of a thousand: sigmas are not known that well.
    likely = max(min(MIN_ODDS, best.odds / MIN_ODDS), 1.0)
    return any(
        test.odds >= likely and left.get(test.faces, 0.0) < 1.0
        for test in before
        if test.faces != best.faces
    )


def _tests(task: PlanTask, end: Alternation, errors: Errors) -> tuple[WallTest, ...]:
    problem = task.problem(end.plan_from_cams, end.correspondences)
    return run_wall_tests(errors(problem), task.floorplan)


def _without(
    task: PlanTask, end: Alternation, test: WallTest, known: tuple[int, ...]
) -> Alternation | None:
    """Adjusted further with a wall moved; None where its patches do not confirm that it was."""
    moved_m = end.correspondences.moved_m
    moved_m = np.full(len(task.floorplan), np.nan) if moved_m is None else moved_m.copy()
    moved_m[list(test.faces)] = test.offsets_m
    again = without_moved_walls(task, go_on(task, end, moved_m), (*known, *test.faces))
    found = again.correspondences.moved_m
    is_confirmed = found is not None and np.isfinite(found[list(test.faces)]).any()
    return again if is_confirmed else None


def _rivals(end: Alternation, tests: Sequence[WallTest]) -> list[Rival]:
    """Where the poses would be if one more wall was moved."""
    return [
        rival_by_odds(_changed(end.plan_from_cams, test.change), test.odds)
        for test in tests
        if test.odds >= MIN_RIVAL_ODDS
    ]


def _changed(plan_from_cams: Poses, change: Float[np.ndarray, "u 6"]) -> Poses:
    return se3.retract(plan_from_cams, change[: len(plan_from_cams)])

"""A refinement with corrections by hand: what they change, what they came to, and solves without some."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from planfit.corrections import Contradiction, Corrections
from planfit.errors import OptionError, require
from planfit.floorplan import Floorplan
from planfit.floorplan.edits import PlanEdits, edited, faces_at
from planfit.pipeline.by_hand import contradictions_among, contradictions_of_images, look_by_hand
from planfit.pipeline.contradicted import (
    ByHand,
    ContradictedError,
    by_hand_outcome,
    first_of_each,
    loops_against_motion,
)
from planfit.pipeline.given import Given
from planfit.pipeline.observations import Observations, corrected_observations
from planfit.pipeline.result import RefineResult
from planfit.pipeline.solve import Solved


def solve_corrected(
    solve: Callable[[Given], RefineResult], given: Given, leave_out: bool
) -> RefineResult:
    """A result with corrections; where `leave_out`, solved again without what contradicts it until nothing
    does.

    Raises:
        OptionError: a correction names a frame that is not there, or needs a plan that is not given.
        ContradictedError: with these corrections nothing can be solved, and none is to be left out.
    """
    _require_possible(given)
    corrections = given.corrections
    left_out: tuple[Contradiction, ...] = ()
    while True:  # ends, as each round leaves one out or is the last
        used = corrections.without(left_out)
        try:
            among = contradictions_among(used)
            if among:
                raise ContradictedError(corrections.name, among)
            result = solve(replace(given, corrections=used))
        except ContradictedError as error:
            if not leave_out:
                raise
            left_out += error.contradictions
            continue
        outcome = result.by_hand
        if not leave_out or outcome is None or not outcome.contradictions:
            break
        left_out += outcome.contradictions
    outcome = replace(result.by_hand or ByHand(used, (), ()), left_out=left_out)
    return replace(result, by_hand=outcome, findings=(*outcome.findings, *result.findings))


def _require_possible(given: Given) -> None:
    """Raise `OptionError` where corrections name frames or a plan that are not given."""
    corrections, floorplan = given.corrections, given.floorplan
    on_plan = [
        each
        for each in corrections
        if each.kind in ("place", "exclude_wall", "erase_wall", "draw_wall")
    ]
    if on_plan and not isinstance(floorplan, Floorplan):
        found = "none" if floorplan is None else "plans by storey"
        raise OptionError(
            f"{corrections.name}: {on_plan[0].kind} {on_plan[0].number}: expected one plan, found {found}; "
            "give frames and loops alone, and correct plans of storeys by --plan-edits"
        )
    corrections.require_frames(len(given.scan))
    strategy = given.options.adjust.wall_strategy
    require(
        not corrections.walls("exclude_wall") or strategy == "fixed",
        f"{corrections.name}: exclude_wall: expected adjust.wall-strategy fixed, found {strategy}; "
        "erase_wall leaves a wall out of all of them",
    )


def with_corrected_plan(given: Given) -> Given:
    """The same with walls of its plan corrected; plans by storey have no corrections.

    Raises:
        FloorplanError: a wall is not where it is said to be, or none is left.
    """
    if not isinstance(given.floorplan, Floorplan):
        return given
    return replace(given, floorplan=corrected_plan(given.floorplan, given.corrections))


def corrected_plan(floorplan: Floorplan, corrections: Corrections) -> Floorplan:
    """The plan with the walls that a person erased, drew and excluded.

    Raises:
        FloorplanError: a wall is not where it is said to be, or none is left.
    """
    erased, drawn, unused = (
        corrections.wall_ends(kind) for kind in ("erase_wall", "draw_wall", "exclude_wall")
    )
    if len(erased) or len(drawn):
        floorplan = edited(floorplan, PlanEdits(erased, (), drawn), corrections.name)
    if len(unused) == 0:
        return floorplan
    is_unused = np.zeros(len(floorplan), dtype=bool)
    is_unused[faces_at(floorplan, unused, corrections.name)] = True
    mark = f"{floorplan.fingerprint} without {np.flatnonzero(is_unused).tolist()}"
    plan = replace(floorplan, is_unused=is_unused, fingerprint=mark)
    plan.used()  # raises where none is left
    return plan


def observe_by_hand(seen: Observations, given: Given) -> Observations:
    """Observations as a person corrected them; those extracted with the corrections are so already.

    Raises:
        ContradictedError: images say otherwise of a correction, so that nothing can be solved with it.
    """
    if given.corrections.entries and seen.by_hand is None:
        by_hand = look_by_hand(given.scan, given.corrections, given.options, given.runtime)
        assert by_hand is not None
        seen = corrected_observations(seen, by_hand)
    if seen.by_hand is not None:
        against = contradictions_of_images(seen.by_hand)
        prevented = tuple(each for each in against if each.prevents)
        if prevented:
            raise ContradictedError(given.corrections.name, prevented)
    return seen


def judge_by_hand(
    result: RefineResult, given: Given, seen: Observations, solved: Solved
) -> RefineResult:
    """The result with what its corrections came to; the very same one where there are none."""
    if seen.by_hand is None:
        return result
    outcomes, against = by_hand_outcome(
        seen.by_hand,
        result.plan_from_cams,
        solved.on_plan.plan_from_level @ solved.prepared.level_from_world,
        solved.on_plan,
        given.options.align.control_point_tolerance_m,
    )
    recorded = result.initial_plan_from_cams[:, :3, 3]
    bent = loops_against_motion(given.corrections, result.evidence.disagreements, recorded)
    found = first_of_each((*contradictions_of_images(seen.by_hand), *against, *bent))
    return replace(result, by_hand=ByHand(given.corrections, outcomes, found))

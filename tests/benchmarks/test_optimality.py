"""The benchmark of optimality: starts are what it says they are, and a miss that goes unsaid is counted."""

from dataclasses import replace

import numpy as np
import pytest
from optimality import outcome, summary
from optimality_starts import LOUNGE_START_M, flat_starts, lounge_starts

from planfit.adjust import AdjustOptions
from planfit.evaluation import position_errors
from planfit.pipeline.verdict import Outcome


@pytest.mark.parametrize("seed", [0, 1])
def test_the_lounge_is_one_large_room_off_by_half_a_metre(seed):
    (start,) = lounge_starts(seed, 1)
    assert 350 <= len(start.true_plan_from_cams) <= 390
    assert start.floorplan.size == pytest.approx((8.0, 10.0), abs=0.1)
    off_m = position_errors(start.prepared.level_from_cams, start.true_plan_from_cams).rms_m
    low, high = LOUNGE_START_M
    assert 0.95 * low < off_m < 1.05 * high
    pairs = start.measurements.matches.pairs
    assert (np.ptp(pairs, axis=1).max() > 40) == (seed == 0)  # every other one sees places again


def test_flats_know_which_walls_were_moved():
    moved = next(s for s in flat_starts(9, 1))
    assert moved.moved_m is not None
    assert 0.1 < np.mean(moved.moved_m != 0) < 0.5


def test_misses_are_counted_and_those_called_refined_too():
    met = {"is_optimal": True, "above, share of walls": 0.0}
    missed = {"is_optimal": False, "above, share of walls": 0.1}
    rows = [met, met, {**missed, "outcome": "refined"}, {**missed, "outcome": "improved"}]
    words = summary("flats", rows)
    assert words.startswith("flats: 4 starts, 50% within 1 %")
    assert words.endswith("of the others 1 called refined")


@pytest.mark.slow
def test_the_verdict_of_a_start_may_be_either():
    (good,) = flat_starts(1, 1)  # predicted within 0.04 m, and no wall is a rival
    assert outcome(good, AdjustOptions()) is Outcome.REFINED
    elsewhere = good.on_plan.plan_from_level.copy()
    elsewhere[:2, 3] += 2.0  # further than any wall reaches for its face
    lost = replace(good, on_plan=replace(good.on_plan, plan_from_level=elsewhere))
    assert outcome(lost, AdjustOptions()) is not Outcome.REFINED

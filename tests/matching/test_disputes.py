"""Rooms that look alike: two sets of revisits, each agreeing within itself, one of them of the wrong room."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from builders import look, with_constants
from planfit.geometry import se3
from planfit.matching import disputes as disputes_module
from planfit.matching import loop_closure
from planfit.matching.disputes import find_disputes
from planfit.matching.loop_closure import cycle_consistent
from planfit.matching.types import RelativePoses
from planfit.scan.odometry import OdometryOptions, make_odometry

ASIDE = np.array([0.0, 4.0, 0.0])
"""From a room to the one that looks like it."""
UNSURE = OdometryOptions(sigma_base_m=0.02, sigma_base_deg=0.3)
N_LAP, N_WAY = 40, 60


def walk():
    """A lap in a room, a long way through elsewhere, and the same lap again: (140,) poses."""
    angle = np.arange(N_LAP) * 2 * np.pi / N_LAP
    lap = [look([1.2 * np.cos(a), 1.2 * np.sin(a), 1.5], np.rad2deg(a)) for a in angle]
    x = 8.0 * np.sin(np.linspace(0, np.pi, N_WAY))
    y = 4.0 * np.sin(np.linspace(0, 2 * np.pi, N_WAY))
    way = [look([1.2 + a, b, 1.5], 0.0) for a, b in zip(x, y, strict=True)]
    return np.stack([*lap, *way, *lap])


def revisits(poses, first_frames, explained, aside=None):
    """Second laps seen in first ones; with `aside`, as if the second lap stood there."""
    pairs = np.array([(k, N_LAP + N_WAY + k) for k in first_frames])
    seen = poses.copy()
    if aside is not None:
        seen[N_LAP:, :3, 3] += aside
    motion = se3.inverse(seen[pairs[:, 0]]) @ seen[pairs[:, 1]]
    share = np.full(len(pairs), float(explained))
    return RelativePoses(pairs, motion, np.full(len(pairs), 50), share)


def both(poses, true_share=0.2, false_share=0.6, drift_m=0.0):
    """Three true revisits, twelve of the room that looks alike; recorded poses that drifted that far."""
    true = revisits(poses, (3, 17, 31), true_share)
    false = revisits(poses, range(1, 37, 3), false_share, ASIDE)
    recorded = poses.copy()
    along = np.linspace(0, 1, N_WAY)[:, None] * ASIDE / np.linalg.norm(ASIDE) * drift_m
    recorded[N_LAP:-N_LAP, :3, 3] += along
    recorded[-N_LAP:, :3, 3] += along[-1]
    return true.then(false), recorded


def accepted(found, recorded, odometry=None, **options):
    steps = odometry or make_odometry(recorded, UNSURE)
    with with_constants(loop_closure, **options):
        return cycle_consistent(found, recorded, steps)


IS_TRUE = np.arange(15) < 3


def test_sigmas_alone_would_let_either_room_pass():
    found, recorded = both(walk())
    assert accepted(found[~IS_TRUE], recorded, max_drifts=40.0).all()
    assert accepted(found[IS_TRUE], recorded).all()


@pytest.mark.parametrize("drift_m", [0.0, 0.8])
def test_of_two_rooms_the_one_that_asks_for_less_drift_is_right(drift_m):
    # The other explains three times as much of the views, four times as often.
    assert_array_equal(accepted(*both(walk(), drift_m=drift_m)), IS_TRUE)
    found, recorded = both(walk(), drift_m=drift_m)
    order = np.random.default_rng(0).permutation(len(found))
    assert_array_equal(accepted(found[order], recorded), IS_TRUE[order])


def test_where_drift_does_not_decide_neither_is_used():
    found, recorded = both(walk(), drift_m=2.0)
    assert not accepted(found, recorded).any()
    # A decimetre beside the middle the advantage is small: half a sigma squared.
    found, recorded = both(walk(), drift_m=1.9)
    with with_constants(disputes_module, min_advantage=0.01):
        assert_array_equal(accepted(found, recorded), IS_TRUE)


def test_a_poster_is_no_rival_of_a_room():
    # Recorded poses drifted 3 m towards the poster's place; the room explains far more of what is seen.
    found, recorded = both(walk(), true_share=0.6, false_share=0.05, drift_m=3.0)
    assert_array_equal(accepted(found, recorded), IS_TRUE)
    with with_constants(disputes_module, rival_share=0.01):
        assert not accepted(found, recorded)[IS_TRUE].any()


def test_those_that_agree_with_a_loser_wait_with_it():
    # The right room is seen at the begin of the lap alone; far from there nothing contradicts the wrong one.
    found, recorded = both(walk())
    found = found[np.arange(len(found)) != 2]
    odometry = make_odometry(recorded, UNSURE)
    none = np.zeros(len(found), dtype=bool)
    disputes = find_disputes(found, np.arange(14), recorded, odometry, none)
    n_rivals = disputes.contradicts.sum(axis=1)
    assert n_rivals[:2].min() > 0
    assert (n_rivals == 0).sum() >= 1
    assert_array_equal(disputes.waits, np.arange(14) >= 2)


def test_over_a_gap_one_of_two_rooms_is_taken_never_both():
    poses = walk()
    found, recorded = both(poses)
    odometry = make_odometry(recorded, UNSURE)
    lost = np.arange(len(poses) - 1) == N_LAP + 20
    gap = replace(
        odometry,
        sigma_translation=np.where(lost, 8.0, odometry.sigma_translation),
        sigma_rotation=np.where(lost, 1.0, odometry.sigma_rotation),
    )
    is_accepted = accepted(found, recorded, gap)
    assert is_accepted.any()
    assert is_accepted[IS_TRUE].any() != is_accepted[~IS_TRUE].any()


def test_without_rivals_nothing_waits():
    poses = walk()
    found = revisits(poses, range(0, 40, 5), 0.3)
    odometry = make_odometry(poses, UNSURE)
    none = np.zeros(len(found), dtype=bool)
    disputes = find_disputes(found, np.arange(len(found)), poses, odometry, none)
    assert disputes.contradicts.nnz == 0
    assert not disputes.waits.any()
    assert disputes.first_of_rivals(np.arange(len(found))).all()


def test_the_first_of_rivals_bars_the_others():
    poses = walk()
    found, recorded = both(poses)
    odometry = make_odometry(recorded, UNSURE)
    none = np.zeros(14, dtype=bool)
    disputes = find_disputes(found, np.arange(1, 15), recorded, odometry, none)
    contradicts = disputes.contradicts.toarray()
    # Number 0 was not compared: it bars nothing and is barred by nothing.
    order = np.array([5, 0, 1, 2, 7])
    taken = disputes.first_of_rivals(order)
    assert_array_equal(taken[[0, 1, 4]], [True, True, True])
    for k, i in ((2, 1), (3, 2)):
        assert taken[k] == (not contradicts[i - 1, [5 - 1, 7 - 1]].any())

"""Loop closures that must be accepted, and look-alikes that must not, among trajectories that drift."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import look, with_constants
from planfit.geometry import se3
from planfit.matching import cycles, loop_closure
from planfit.matching.loop_closure import cycle_consistent
from planfit.matching.pose_graph import LEVER_M, LoopGraph
from planfit.matching.types import RelativePoses
from planfit.scan.odometry import OdometryOptions, make_odometry

DRIFT = OdometryOptions()
UNSURE = OdometryOptions(sigma_base_m=0.05, sigma_base_deg=0.4)


def lap(centre, n=40, radius=1.2):
    angle = np.arange(n) * 2 * np.pi / n
    return [
        look([centre[0] + radius * np.cos(a), centre[1] + radius * np.sin(a), 1.5], np.rad2deg(a))
        for a in angle
    ]


def walk(*centres, n=40):
    """Laps about centres with a straight way between; and the first frame of each lap."""
    poses, begins = [], []
    for centre in centres:
        if poses:
            last, first = poses[-1], lap(centre, n)[0]
            for share in np.linspace(0, 1, 10)[1:-1]:
                poses.append(look((1 - share) * last[:3, 3] + share * first[:3, 3], 0))
        begins.append(len(poses))
        poses += lap(centre, n)
    return np.stack(poses), begins


def drifted(poses, seed=0, rotation_deg=0.2, translation_m=0.01):
    rng = np.random.default_rng(seed)
    result = [poses[0]]
    for a, b in itertools.pairwise(poses):
        step = se3.inverse(a) @ b
        delta = rng.normal(size=6) * ([np.deg2rad(rotation_deg)] * 3 + [translation_m] * 3)
        result.append(result[-1] @ se3.retract(step[None], delta[None])[0])
    return np.stack(result)


def loops(poses, pairs, as_seen_from=None):
    """Exact motions; with `as_seen_from`, those of other poses (a look-alike's)."""
    seen = poses if as_seen_from is None else as_seen_from
    pairs = np.array(pairs)
    motion = se3.inverse(seen[pairs[:, 0]]) @ seen[pairs[:, 1]]
    return RelativePoses(pairs, motion, np.full(len(pairs), 50))


def accepted(found, recorded, drift=DRIFT, **options):
    with with_constants(loop_closure, **options):
        return cycle_consistent(found, recorded, make_odometry(recorded, drift))


@pytest.mark.parametrize("seed", range(4))
def test_true_loop_closures_of_a_scan_that_drifts_are_accepted(seed):
    poses, (a, b, c) = walk((0, 0), (12, 0), (0, 0))
    true = loops(poses, [(a + k, c + k) for k in range(40)] + [(b, b + 39)])
    assert accepted(true, drifted(poses, seed)).mean() > 0.95


def look_alikes(poses, first, second, ahead):
    """Frames of the second room taken for the same place in the first."""
    pairs = [(first + k, second + k) for k in range(0, 40, 3)]
    moved = poses.copy()
    moved[second : second + 40, :3, 3] -= ahead
    return loops(poses, pairs, moved)


def test_a_look_alike_room_within_reach_of_drift_is_refused_by_what_connects_the_two():
    # Three laps in each of two rooms 4 m apart: by the end six sigmas of drift are more than 4 m.
    poses, begins = walk((0, 0), (0, 0), (0, 0), (0, 4), (0, 4), (0, 4))
    recorded = drifted(poses, 1)
    odometry = make_odometry(recorded, UNSURE)
    _, translation = odometry.sigma_between(np.array([0]), np.array([len(poses) - 1]))
    assert 6 * translation[0] > 4.5
    false = look_alikes(poses, begins[0], begins[5], np.array([0, 4.0, 0]))
    true = loops(poses, [(begins[i] + k, begins[i + 1] + k) for i in (0, 1, 3, 4)
                         for k in range(0, 40, 2)])  # fmt: skip
    is_accepted = accepted(true.then(false), recorded, UNSURE)
    assert is_accepted[: len(true.pairs)].mean() > 0.95
    assert not is_accepted[len(true.pairs) :].any()
    # Without the true loops nothing but drift can tell, and drift could explain most of them.
    assert accepted(false, recorded, UNSURE, max_uncertain_sigmas=6.0).any()


def test_order_does_not_matter():
    poses, (a, _, c) = walk((0, 0), (12, 0), (0, 0))
    found = loops(poses, [(a + k, c + k) for k in range(40)])
    recorded = drifted(poses, 2)
    one = accepted(found, recorded)
    turned = np.arange(40)[::-1]
    assert_array_equal(accepted(found[turned], recorded), one[turned])


def test_no_loops_at_all():
    poses, _ = walk((0, 0))
    none = RelativePoses(np.zeros((0, 2), dtype=int), np.zeros((0, 4, 4)), np.zeros(0, dtype=int))
    assert accepted(none, poses).shape == (0,)


def test_slack_and_sigmas():
    poses, (a, _, c) = walk((0, 0), (6, 0), (0, 0))
    off = loops(poses, [(a, c)])
    off.a_from_b[0, 0, 3] += 0.5
    exact = OdometryOptions(1e-5, 0.0, 1e-5, 0.0)
    assert not accepted(off, poses, exact).any()
    with with_constants(cycles, translation_slack_m=0.6):
        assert accepted(off, poses, exact).all()
    turned = loops(poses, [(a, c)])
    turned.a_from_b[0, :3, :3] @= se3.exp_so3(np.array([0.1, 0, 0]))
    assert not accepted(turned, poses, exact).any()
    with with_constants(cycles, rotation_slack_deg=7.0):
        assert accepted(turned, poses, exact).all()


def test_one_of_a_cluster_speaks_for_those_that_agree_with_it_alone():
    poses, (a, _, c) = walk((0, 0), (12, 0), (0, 0))
    found = loops(poses, [(a + k, c + k) for k in range(4)])
    found.n_inliers[0] = 90
    found.a_from_b[3, 0, 3] += 6.0
    for size in (0.2, 5.0):
        with with_constants(cycles, certain_sigma_m=-0.03):  # nothing is certain
            is_accepted = accepted(found, poses, cluster_m=size)
        assert_array_equal(is_accepted, [True, True, True, False])


def explaining(found, share):
    return replace(found, explained=np.broadcast_to(share, len(found)).astype(float))


def test_a_revisit_that_its_views_contradict_is_refused():
    poses, (a, _, c) = walk((0, 0), (12, 0), (0, 0))
    found = loops(poses, [(a + k, c + k) for k in range(0, 40, 4)])
    shares = np.where(np.arange(10) == 3, 0.0, 0.3)
    assert_array_equal(accepted(explaining(found, shares), poses, UNSURE), np.arange(10) != 3)


def test_a_revisit_that_explains_little_is_held_to_the_drift_that_the_others_show():
    # The tracker is far better than its sigmas: by them alone a poster 2.5 m off could be right.
    poses, (a, b, c, d) = walk((0, 0), (12, 0), (0, 0), (0, 12))
    true = loops(poses, [(a + k, c + k) for k in range(0, 40, 2)])
    both = true.then(loops(poses, [(b + 35, d + 9)], look_from(poses, d, 2.5)))
    is_true = np.arange(21) < 20

    def is_poster_accepted(share, **options):
        found = explaining(both, np.where(is_true, 0.5, share))
        is_accepted = accepted(found, poses, UNSURE, **options)
        assert is_accepted[is_true].all()
        return is_accepted[-1]

    assert accepted(both, poses, UNSURE).all()
    assert not is_poster_accepted(0.02)
    assert is_poster_accepted(0.02, max_weak_drifts=40.0)
    assert is_poster_accepted(0.02, strong_share=0.01, max_drifts=40.0)
    assert is_poster_accepted(0.3, max_drifts=40.0)
    assert not is_poster_accepted(0.3, max_drifts=1.0)


def test_a_gap_in_the_tracking_is_no_drift_that_others_could_tell():
    poses, (a, b, c, d) = walk((0, 0), (12, 0), (0, 0), (0, 12))
    true = loops(poses, [(a + k, c + k) for k in range(0, 40, 2)])
    both = explaining(true.then(loops(poses, [(b + 35, d + 9)], look_from(poses, d, 2.5))), 0.05)
    both.explained[:20] = 0.5
    odometry = make_odometry(poses, UNSURE)
    lost = np.arange(len(poses) - 1) == d - 3
    gap = replace(odometry, sigma_translation=np.where(lost, 3.0, odometry.sigma_translation))
    assert not cycle_consistent(both, poses, odometry)[-1]
    assert cycle_consistent(both, poses, gap).all()


def look_from(poses, first, aside):
    """Poses of which those from `first` on stand aside."""
    moved = poses.copy()
    moved[first:, 0, 3] += aside
    return moved


def test_what_explains_more_is_decided_first():
    poses, (a, _, c) = walk((0, 0), (12, 0), (0, 0))
    # Both could be right by the odometry, the poster even surer (less way between its ends); not both.
    true = loops(poses, [(a, c + 39)])
    poster = loops(poses, [(a + 3, c + 36)], look_from(poses, c, 2.0))
    both = true.then(poster)
    assert_array_equal(accepted(both, poses, UNSURE), [False, True])
    assert_array_equal(accepted(explaining(both, [0.8, 0.05]), poses, UNSURE), [True, False])


def test_a_path_over_a_loop_closure_is_more_certain_than_the_long_way_round():
    poses, (a, _, c) = walk((0, 0), (12, 0), (0, 0))
    odometry = make_odometry(drifted(poses, 3), DRIFT)
    recorded = drifted(poses, 3)
    pairs = np.array([(a, c), (a + 5, c + 5), (a + 5, a + 9)])
    graph = LoopGraph(recorded, odometry, pairs)
    motion, rotation, translation = graph.most_certain_path(pairs)
    assert_allclose(motion, se3.inverse(recorded[pairs[:, 0]]) @ recorded[pairs[:, 1]], atol=1e-9)
    expected = odometry.sigma_between(*pairs.T)
    assert_allclose(rotation, expected[0])
    assert_allclose(translation, expected[1])
    true = loops(poses, [(a, c)])
    graph.add(true.pairs, true.a_from_b, 0.5, 0.03)
    motion, rotation_now, translation_now = graph.most_certain_path(pairs)
    assert rotation_now[1] < rotation[1]
    assert translation_now[1] < 0.3 * translation[1]
    assert_allclose(motion[0], true.a_from_b[0], atol=1e-9)
    over = (
        se3.inverse(recorded[a + 5]) @ recorded[a] @ true.a_from_b[0]
        @ se3.inverse(recorded[c]) @ recorded[c + 5]
    )  # fmt: skip
    assert_allclose(motion[1], over, atol=1e-9)
    assert_allclose(translation_now[2], translation[2])


def test_the_way_back_is_the_inverse():
    poses, (a, _, c) = walk((0, 0), (12, 0), (0, 0))
    pairs = np.array([(a, c), (c, a), (c + 5, a + 5)])
    graph = LoopGraph(poses, make_odometry(poses, DRIFT), pairs)
    true = loops(poses, [(a, c)])
    graph.add(true.pairs, true.a_from_b, 0.5, 0.03)
    motion, _, _ = graph.most_certain_path(pairs)
    assert_allclose(motion, se3.inverse(poses[pairs[:, 0]]) @ poses[pairs[:, 1]], atol=1e-9)


def test_a_search_within_a_sigma_finds_the_same_paths_or_none(rng):
    poses, begins = walk((0, 0), (12, 0), (0, 0), (12, 0))
    pairs = rng.choice(len(poses), (300, 2))
    pairs = np.concatenate([pairs, pairs[:1]])  # one twice
    graph = LoopGraph(drifted(poses, 3), make_odometry(poses, DRIFT), pairs)
    joins = loops(poses, [(begins[0] + k, begins[2] + k) for k in range(0, 40, 8)])
    graph.add(joins.pairs, joins.a_from_b, 0.5, 0.03)
    every = graph.most_certain_path(pairs)
    within_m = float(np.quantile(every[2], 0.4))
    motion, rotation, translation = graph.most_certain_path(pairs, within_m)
    is_found = np.isfinite(translation)
    assert 0.1 < is_found.mean() < 0.9
    for some, all_of_them in zip((motion, rotation, translation), every, strict=True):
        assert_array_equal(some[is_found], all_of_them[is_found])
    # Left out is only what is less certain: a rotation counts by its lever besides.
    assert np.hypot(every[2], LEVER_M * every[1])[~is_found].min() > within_m
    assert np.isinf(rotation[~is_found]).all()

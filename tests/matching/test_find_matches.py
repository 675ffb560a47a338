"""Matches over a small scan: true ones found, look-alikes refused, and the options."""

import gc
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import NoFiles, look, make_matches, random_transforms, room_scan, with_constants
from planfit.evaluation import match_distances
from planfit.geometry import se3
from planfit.matching import (
    MatchingOptions,
    cycles,
    find_matches,
    measure_neighbours,
    relative_motions,
    search_matches,
    tentative,
)
from planfit.matching.detect import KeypointOptions
from planfit.matching.pairs import PairOptions
from planfit.matching.verify import MIN_INLIERS, point_sigma
from planfit.runtime import Runtime
from planfit.scan.odometry import OdometryOptions, make_odometry

POSES = np.stack([look([1.0 + 0.15 * i, 2.0, 1.3], 4.0 * i, 5) for i in range(6)])


def found(scan, options=None, drift=None, runtime=None):
    odometry = make_odometry(scan.world_from_cams, drift or OdometryOptions())
    return find_matches(scan, odometry, options or MatchingOptions(), runtime or Runtime(2))


@pytest.fixture(scope="module")
def scan():
    return room_scan(POSES)


@pytest.fixture(scope="module")
def matches(scan):
    return found(scan)


def test_matched_points_coincide_at_the_true_poses(scan, matches):
    assert matches.n_matches > 200
    assert np.median(match_distances(matches, POSES)) < 0.02
    assert len(matches.sigma) == matches.n_matches == matches.start[-1]
    assert matches.n_keypoints > 300
    assert matches.n_tried == 15  # four neighbours each, and the first with the last
    assert np.all(matches.pairs[:, 0] < matches.pairs[:, 1])
    assert np.all(np.diff(matches.start) >= MIN_INLIERS)


def test_sigma_is_that_of_both_ends(matches):
    sigmas = [point_sigma(p[:, 2]) for p in (matches.points_a, matches.points_b)]
    # Of 32 bits.
    assert_allclose(matches.sigma, np.hypot(*sigmas), rtol=1e-6)


def test_threads_and_cache_do_not_change_the_result(scan, matches, tmp_path):
    for _ in range(2):
        again = found(scan, runtime=Runtime(1, tmp_path))
        assert_array_equal(again.points_a, matches.points_a)
        assert_array_equal(again.pairs, matches.pairs)


def test_a_look_alike_beyond_drift_is_refused():
    # Two frames of one view, which the tracker says were taken three metres apart.
    scan = room_scan([POSES[0], POSES[0]])
    assert found(scan).n_matches > 50
    apart = POSES[[0, 0]].copy()
    apart[1, 1, 3] += 3.0
    moved = replace(scan, world_from_cams=apart)
    assert found(moved).n_matches == 0
    assert found(moved, drift=OdometryOptions(sigma_base_m=1.0)).n_matches > 50
    turned = POSES[[0, 0]].copy()
    turned[1] = turned[1] @ se3.make_transform(se3.exp_so3(np.array([0, 0.2, 0])), np.zeros(3))
    turned = replace(scan, world_from_cams=turned)
    assert found(turned).n_matches == 0
    assert found(turned, drift=OdometryOptions(sigma_base_deg=3.0)).n_matches > 50


def test_slack_sets_how_far_a_motion_may_depart():
    scan = room_scan([POSES[0], POSES[0]])
    apart = POSES[[0, 0]].copy()
    apart[1, 1, 3] += 0.5
    scan = replace(scan, world_from_cams=apart)
    sure = OdometryOptions(0.01, 0.0, 0.1, 0.0)
    assert found(scan, drift=sure).n_matches == 0
    with with_constants(cycles, translation_slack_m=0.6):
        assert found(scan, drift=sure).n_matches > 50
    turned = POSES[[0, 0]].copy()
    turned[1] = turned[1] @ se3.make_transform(se3.exp_so3(np.array([0, 0.1, 0])), np.zeros(3))
    turned = replace(scan, world_from_cams=turned)
    assert found(turned, drift=sure).n_matches == 0
    with with_constants(cycles, rotation_slack_deg=7.0):
        assert found(turned, drift=sure).n_matches > 50


def test_no_texture_no_matches(scan):
    class Blank(NoFiles):
        def color(self, _):
            return np.full((120, 160, 3), 128, np.uint8)

        def depth(self, i):
            return scan.files.depth(i)

    nothing = found(replace(scan, files=Blank()))
    assert nothing.n_matches == 0
    assert nothing.pairs.shape == (0, 2)
    assert nothing.points_a.shape == (0, 3)
    assert_array_equal(nothing.start, [0])
    assert nothing.n_loops(4) == 0


def test_one_frame_has_no_matches():
    nothing = found(room_scan(POSES[:1]))
    assert nothing.n_matches == 0
    assert nothing.n_tried == 0


def test_orb_end_to_end(scan):
    matches = found(scan, MatchingOptions(keypoints=KeypointOptions(kind="orb")))
    assert matches.n_matches > 100
    assert np.median(match_distances(matches, POSES)) < 0.03


def test_a_rendered_room_and_its_copy_are_not_merged():
    # The same walk in a room and in its exact copy four metres on; the tracker drifts little.
    lap = [
        look([2.0 + np.cos(a), 2.0 + np.sin(a), 1.3], np.rad2deg(a)) for a in np.arange(0, 6, 1.0)
    ]
    scan = room_scan(lap + lap)
    recorded = scan.world_from_cams.copy()
    recorded[6:, 0, 3] += 4.0
    alike = found(replace(scan, world_from_cams=recorded))
    assert np.all(alike.pairs // 6 == alike.pairs[:, :1] // 6)
    assert np.any(np.diff(found(scan).pairs // 6, axis=1) == 1)


def test_pair_options_reach_the_choice_of_pairs(scan):
    options = MatchingOptions(pairs=PairOptions(neighbours=1, loops_per_frame=0))
    assert found(scan, options).n_tried == 5


def test_loops_are_pairs_beyond_the_neighbours(rng):
    poses = random_transforms(rng, 12)
    matches = make_matches(poses, [(0, 1), (0, 4), (0, 5), (2, 11)], rng.normal(size=(5, 3)))
    assert matches.n_loops(4) == 2
    assert matches.n_loops(1) == 3


def test_neighbours_are_measured_whatever_the_poses(scan):
    nowhere = replace(scan, world_from_cams=random_transforms(np.random.default_rng(0), len(scan)))
    measured, again = (
        measure_neighbours(s, MatchingOptions(), Runtime(2)).verified for s in (scan, nowhere)
    )
    assert len(measured) >= 5
    assert_array_equal(measured.relative_poses.a_from_b, again.relative_poses.a_from_b)


def test_known_pairs_are_not_tried_again(scan, matches, monkeypatch):
    options, runtime = MatchingOptions(), Runtime(2)
    odometry = make_odometry(scan.world_from_cams, OdometryOptions())
    known = measure_neighbours(scan, options, runtime)
    first, known = search_matches(scan, odometry, options, runtime, known)
    assert_array_equal(first.points_a, matches.points_a)

    def verified_again(*_):
        raise AssertionError("this pair was tried before")

    monkeypatch.setattr(relative_motions, "_verify_pair", verified_again)
    again, _ = search_matches(scan, odometry, options, runtime, known)
    assert_array_equal(again.points_a, matches.points_a)


def test_descriptors_do_not_stay_in_memory_but_for_a_few_frames(scan, monkeypatch):
    monkeypatch.setattr(tentative, "FRAMES_AT_HAND", 2)
    known = measure_neighbours(scan, MatchingOptions(), Runtime(2))
    # Images of other tests may be 128 pixels wide.
    kind = known.keypoints.keypoints[0].read().descriptors.dtype
    gc.collect()
    held = [
        each
        for owner in gc.get_objects()
        for each in gc.get_referents(owner)
        # Its type, as `isinstance` asks proxies of what is gone for theirs.
        if issubclass(type(each), np.ndarray) and each.ndim == 2 and each.shape[1] == 128
        if each.dtype == kind
    ]
    assert len(known.verified) > 0
    assert len(held) <= 2 < len(scan)
    for kept in known.keypoints.keypoints:
        assert kept.read().descriptors.shape == (len(kept), 128)

"""What is kept out: whole visits and the wall of whole stretches, each by one fold, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import look, make_matches, make_structure, make_ties, nudged, room_plan
from planfit.adjust import AdjustOptions, Measurements, build_problem
from planfit.adjust.association import Association
from planfit.pipeline.folds import (
    MIN_FRAMES,
    NOT_KEPT_OUT,
    STRETCH_M,
    choose_folds,
    cut_into_stretches,
    without_fold,
)
from planfit.scan.odometry import OdometryOptions, make_odometry

N, COUNT = 120, 5


@pytest.fixture
def walk():
    """Two laps of 30 m each."""
    angle = 2 * np.pi * np.arange(N) / (N / 2)
    return np.stack([look([5 * np.cos(a), 5 * np.sin(a), 1.5], np.rad2deg(a)) for a in angle])


@pytest.fixture
def measurements(walk, rng):
    wall = np.column_stack([rng.uniform(1, 5, 30), np.zeros(30), rng.uniform(0, 2, 30)])
    structure = make_structure(walk, patches=[(i, wall, (0.0, 1.0)) for i in range(N)])
    pairs = [(i, i + 1) for i in range(N - 1)] + [(i, i + N // 2) for i in range(N // 2)]
    matches = make_matches(walk, sorted(pairs), rng.normal(size=(4, 3)))
    return Measurements(matches, structure, make_odometry(walk, OdometryOptions()))


@pytest.fixture
def folds(measurements, walk, rng):
    return choose_folds(measurements, walk, COUNT, rng)


def test_stretches_are_equal_lengths_of_path(walk):
    stretch = cut_into_stretches(walk, COUNT)
    assert_array_equal(np.unique(np.diff(stretch)), [0, 1])
    walked = np.linalg.norm(np.diff(walk[:, :3, 3], axis=0), axis=1).sum()
    assert stretch[-1] + 1 == int(walked / STRETCH_M)
    sizes = np.bincount(stretch)
    assert sizes.max() - sizes.min() <= 1


def test_a_jump_is_no_way_walked(walk):
    jumped = walk.copy()
    jumped[60:, 0, 3] += 500.0
    assert np.abs(cut_into_stretches(jumped, COUNT) - cut_into_stretches(walk, COUNT)).max() <= 1


@pytest.mark.parametrize("n", [1, 2, 5, 11, 40])
def test_short_walks_and_none_at_all(walk, n):
    for poses in (walk[:n], np.tile(walk[0], (n, 1, 1))):
        stretch = cut_into_stretches(poses, COUNT)
        assert len(stretch) == n
        assert stretch[0] == 0
        assert stretch[-1] + 1 <= max(n // MIN_FRAMES, 1)


def test_a_visit_is_kept_out_as_a_whole(measurements, folds):
    pairs, stretch = measurements.matches.pairs, folds.stretch
    is_revisit = pairs[:, 1] - pairs[:, 0] > 1
    assert_array_equal(folds.visit[~is_revisit], NOT_KEPT_OUT)
    assert_array_equal(folds.of_pairs[~is_revisit], NOT_KEPT_OUT)
    for visit in range(folds.visit.max() + 1):
        own = folds.visit == visit
        assert len(np.unique(folds.of_pairs[own])) == 1
        assert len(np.unique(stretch[pairs[own]], axis=0)) == 1
    counts = np.bincount(
        [folds.of_pairs[folds.visit == v][0] for v in range(folds.visit.max() + 1)]
    )
    assert counts.max() - counts.min() <= 1


def test_all_wall_of_a_stretch_is_kept_out_and_its_neighbours_wall_is_not(measurements, folds):
    of_stretch = [
        np.unique(folds.of_patches[folds.stretch[measurements.structure.walls.frame_idx] == k])
        for k in range(folds.n_stretches)
    ]
    assert all(len(found) == 1 for found in of_stretch)
    fold = np.array([found[0] for found in of_stretch])
    assert set(fold) == set(range(COUNT))
    assert np.all(fold[1:] != fold[:-1])


def test_every_measurement_is_left_to_all_folds_but_one(measurements, folds):
    walls = measurements.structure.walls
    ties = make_ties(room_plan(), Association(np.arange(len(walls)) % 4, np.zeros(len(walls))), N)
    seen_patches, seen_pairs = np.zeros(len(walls), dtype=int), 0
    for fold in range(COUNT):
        reduced, correspondences = without_fold(measurements, ties, folds, fold)
        kept = folds.of_patches != fold
        seen_patches += kept
        seen_pairs += int(reduced.kept.pairs.sum())
        assert_array_equal(reduced.kept.patches, kept)
        assert_array_equal(correspondences.walls.face_idx[kept], ties.walls.face_idx[kept])
        assert_array_equal(correspondences.walls.face_idx[~kept], -1)
        assert reduced.matches is measurements.matches  # nothing is copied
        assert reduced.structure is measurements.structure
        assert reduced.odometry is measurements.odometry
        copied = reduced.without_rest()
        assert_array_equal(copied.matches.pairs, measurements.matches.pairs[folds.of_pairs != fold])
        assert_array_equal(copied.structure.walls.frame_idx, walls.frame_idx[kept])
        assert copied.structure.walls.start[-1] == len(copied.structure.walls.points_cam)
    assert_array_equal(seen_patches, COUNT - 1)
    n_visiting = int(np.sum(folds.of_pairs != NOT_KEPT_OUT))
    assert seen_pairs == COUNT * len(measurements.matches.pairs) - n_visiting


@pytest.mark.parametrize(
    "options",
    [
        AdjustOptions(),
        AdjustOptions(cost="paper"),
        AdjustOptions(geometric="rays"),
        AdjustOptions(wall_strategy="iterative"),
    ],
    ids=["default", "means", "rays", "nearest wall"],
)
def test_a_fold_without_copies_solves_to_what_one_with_copies_does(walk, rng, options):
    seen_walls = rng.uniform(size=(30, 3)) * [4, 0, 2] + [1, 0, 0]
    patches = [(i, seen_walls, (0.0, 1.0)) for i in range(N)]
    pairs = [(i, i + 1) for i in range(N - 1)] + [(i, i + N // 2) for i in range(N // 2)]
    matches = make_matches(walk, sorted(pairs), rng.normal(size=(15, 3)))
    noisy = matches.points_a + rng.normal(size=matches.points_a.shape) * 0.02
    measurements = Measurements(
        replace(matches, points_a=noisy),
        make_structure(walk, patches=patches),
        make_odometry(walk, OdometryOptions()),
    )
    walls = measurements.structure.walls
    ties = make_ties(room_plan(), Association(np.zeros(len(walls), int), np.zeros(len(walls))), N)
    folds, start = choose_folds(measurements, walk, COUNT, rng), nudged(rng, walk, 0.2, 0.02)
    marked, without = without_fold(measurements, ties, folds, 0)
    copied = marked.without_rest()
    of_copy = replace(without, walls=without.walls[marked.kept.patches])
    found = build_problem(marked, options, start, without).solve().target_from_cams
    expected = build_problem(copied, options, start, of_copy).solve().target_from_cams
    whole = build_problem(measurements, options, start, ties).solve().target_from_cams
    assert_allclose(found, expected, rtol=0, atol=1e-9)
    assert np.abs(found - whole).max() > 1e-6  # else it would not matter what is left out


def test_matches_of_a_visit_are_found_without_a_look_at_the_others(measurements, folds):
    matches = measurements.matches
    for visit, pairs in enumerate(folds.pairs_of_visits):
        expected, found = matches.of_pairs(folds.visit == visit), matches.taken(pairs)
        assert_array_equal(pairs, np.flatnonzero(folds.visit == visit))
        for name in ("pairs", "start", "points_a", "points_b", "sigma"):
            assert_array_equal(getattr(found, name), getattr(expected, name))
    assert len(folds.pairs_of_visits) == folds.visit.max() + 1
    assert matches.taken(np.zeros(0, int)).n_matches == 0


def test_some_pairs_keep_their_own_matches(measurements, rng):
    matches = measurements.matches
    sizes = rng.integers(1, 9, len(matches.pairs))
    start = np.cumsum([0, *sizes])
    points = rng.normal(size=(start[-1], 3))
    matches = replace(
        matches, start=start, points_a=points, points_b=-points, sigma=np.arange(start[-1]) + 1.0
    )
    keep = rng.random(len(sizes)) < 0.5
    some = matches.of_pairs(keep)
    expected = np.concatenate([np.arange(start[k], start[k + 1]) for k in np.flatnonzero(keep)])
    assert_array_equal(some.sigma, expected + 1.0)
    assert_array_equal(some.points_a, points[expected])
    assert_array_equal(some.points_b, -points[expected])
    assert_array_equal(some.pairs, matches.pairs[keep])
    assert_array_equal(np.diff(some.start), sizes[keep])
    assert matches.of_pairs(np.zeros(len(sizes), dtype=bool)).n_matches == 0

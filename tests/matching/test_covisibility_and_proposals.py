"""Covisibility guessed from a few points, and pairs proposed around loop closures that were accepted."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from builders import CAMERA, look, with_constants
from planfit.geometry import se3
from planfit.matching import loop_closure
from planfit.matching.covisibility import MARGIN, N_POINTS, sample_views
from planfit.matching.loop_closure import propose_loop_closures
from planfit.matching.pairs import PairOptions
from planfit.matching.types import RelativePoses


def views(rng, n, depth_m=3.0, points=100):
    lifted = [
        CAMERA.lift(
            rng.uniform([0, 0], [CAMERA.width, CAMERA.height], (points, 2)),
            np.full(points, depth_m),
        )
        for _ in range(n)
    ]
    return sample_views(lifted, (CAMERA,) * n)


def test_covisibility_against_a_plain_projection(rng):
    poses = np.stack([look([0, 0, 0], 0), look([0.3, 0.5, 0], 20, 3), look([0, 0, 0], 180)])
    samples = views(rng, 3)
    pairs = np.array([(0, 1), (0, 2), (1, 2)])
    expected = []
    for pair in pairs:
        shares = []
        for source, target in (pair, pair[::-1]):
            points = se3.transform(
                se3.inverse(poses[target]) @ poses[source], samples.points_cam[source]
            )
            uv = CAMERA.project(points)
            size = np.array([CAMERA.width, CAMERA.height])
            with np.errstate(invalid="ignore"):
                inside = ((uv > -MARGIN * size) & (uv < (1 + MARGIN) * size)).all(axis=1)
            shares.append(np.mean(inside & (points[:, 2] > 0.1)))
        expected.append(min(shares))
    assert 0.2 < expected[0] < 1.0
    assert_allclose(samples.covisibility(poses, pairs), expected)
    motion = se3.inverse(poses[pairs[:, 0]]) @ poses[pairs[:, 1]]
    assert_allclose(samples.covisibility_by_motion(pairs, motion), expected)


def test_a_view_is_all_of_itself_and_a_frame_without_points_shows_nothing(rng):
    samples = sample_views(
        [np.array([[0.0, 0.0, 2.0]]), np.zeros((0, 3)), rng.normal([0, 0, 9], 1, (500, 3))],
        (CAMERA,) * 3,
    )
    assert samples.points_cam.shape == (3, N_POINTS, 3)
    assert np.isfinite(samples.points_cam[2]).all()
    pose = np.tile(look([0, 0, 0], 0), (3, 1, 1))
    assert_array_equal(samples.covisibility(pose, np.array([(0, 0), (0, 1), (2, 2)])), [1, 0, 1])


def case(rng, off_m=4.0):
    """Two visits of a straight way; the second is recorded `off_m` aside of where it was."""
    way = [look([0.5 * i, 0, 1.5], 0) for i in range(20)]
    true = np.stack(way + way)
    recorded = true.copy()
    recorded[20:, 1, 3] += off_m
    motion = se3.inverse(true[[5]]) @ true[[25]]
    return (
        true,
        recorded,
        RelativePoses(np.array([[5, 25]]), motion, np.array([40])),
        views(rng, 40),
    )


def test_neighbours_of_a_loop_closure_are_tried_by_its_motion(rng):
    _, recorded, loop, samples = case(rng)
    none = np.zeros((0, 2), dtype=int)
    found = propose_loop_closures(loop, none, np.arange(40), recorded, samples, PairOptions())
    pairs = set(map(tuple, found.tolist()))
    assert {(4, 24), (6, 26), (3, 23), (7, 27)} <= pairs
    assert all(i < 20 <= j for i, j in pairs)
    assert found.tolist() == sorted(found.tolist())
    # What the recorded poses alone would have said: hardly covisible.
    assert samples.covisibility(recorded, np.array([(6, 26)]))[0] < 0.3


def test_pairs_tried_before_are_not_tried_again(rng):
    _, recorded, loop, samples = case(rng)
    tried = np.array([(4, 24), (5, 25)])
    found = propose_loop_closures(loop, tried, np.arange(40), recorded, samples, PairOptions())
    assert not {(4, 24), (5, 25)} & set(map(tuple, found.tolist()))
    assert len(found) > 0


def test_views_that_are_not_covisible_are_not_tried(rng):
    _, recorded, loop, samples = case(rng)
    recorded[26:28, :3, :3] = look([0, 0, 0], 180)[:3, :3]
    none = np.zeros((0, 2), dtype=int)
    found = propose_loop_closures(loop, none, np.arange(40), recorded, samples, PairOptions())
    assert not np.isin(found, [26, 27]).any()


def test_guided_per_frame(rng):
    _, recorded, loop, samples = case(rng)
    none = np.zeros((0, 2), dtype=int)
    for most in (0, 1, 3):
        with with_constants(loop_closure, guided_per_frame=most):
            found = propose_loop_closures(
                loop, none, np.arange(40), recorded, samples, PairOptions()
            )
        assert np.bincount(found.ravel(), minlength=40).max() == most


def test_neighbours_in_time_are_no_loop_closures(rng):
    _, recorded, _, samples = case(rng)
    near = RelativePoses(np.array([[5, 7]]), np.eye(4)[None], np.array([40]))
    none = np.zeros((0, 2), dtype=int)
    assert (
        len(propose_loop_closures(near, none, np.arange(40), recorded, samples, PairOptions())) == 0
    )

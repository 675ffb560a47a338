"""What matches become for other programs: edges of a pose graph, points with tracks. Truth is built here."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planfit.errors import OutputError
from planfit.export.datasets import observe
from planfit.export.write import (
    FLOOR_DEG,
    FLOOR_M,
    MATCHES,
    loop_edges,
    read_matches,
    write_matches,
)
from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.matching import Matches
from planfit.scan import scan_from_arrays

CAMERA = Camera(320, 240, 250.0, 252.0, 161.0, 118.5)
N_FRAMES = 4


def poses():
    """Four views of one corner, that turn about it."""
    turns = se3.exp_so3(np.linspace(-0.15, 0.15, N_FRAMES)[:, None] * [0.2, 1.0, 0.1])
    places = np.linspace(-0.3, 0.3, N_FRAMES)[:, None] * [1.0, 0.2, 0.0]
    return se3.make_transform(turns, places)


def world_points(n=60):
    rng = np.random.default_rng(8)
    return rng.uniform([-0.8, -0.6, 2.5], [0.8, 0.6, 3.5], (n, 3))


def matches_of(world_from_cams, points, noise_m=0.0, sigma_m=0.01):
    """Every pair of frames sees every point; what a frame saw of it is the same in all its pairs."""
    rng = np.random.default_rng(3)
    seen = [se3.transform(se3.inverse(pose), points) for pose in world_from_cams]
    seen = [one + rng.normal(0, noise_m, one.shape) if noise_m else one for one in seen]
    pairs, a, b = [], [], []
    for i in range(N_FRAMES):
        for j in range(i + 1, N_FRAMES):
            pairs += [(i, j)] * len(points)
            a.append(seen[i])
            b.append(seen[j])
    return Matches.from_arrays(np.array(pairs), np.concatenate(a), np.concatenate(b), sigma_m)


@pytest.fixture
def scan():
    images = [np.full((240, 320, 3), 40 * i, np.uint8) for i in range(N_FRAMES)]
    depths = [np.full((240, 320), 3.0, np.float32) for _ in range(N_FRAMES)]
    return scan_from_arrays(images, depths, CAMERA, poses())


def test_loops_are_the_true_motions_between_frames_that_are_no_neighbours():
    truth = poses()
    edges = loop_edges(matches_of(truth, world_points()))
    assert edges.pairs.tolist() == [[0, 2], [0, 3], [1, 3]]
    i, j = edges.pairs.T
    assert_allclose(edges.first_from_second, se3.inverse(truth[i]) @ truth[j], atol=1e-9)


def test_wrong_matches_do_not_move_an_edge():
    truth = poses()
    matches = matches_of(truth, world_points(), noise_m=0.003)
    wrong = np.arange(matches.n_matches) % 5 == 0
    spoiled = replace(matches, points_b=matches.points_b + np.where(wrong[:, None], 0.8, 0.0))
    edges = loop_edges(spoiled)
    i, j = edges.pairs.T
    off = se3.inverse(edges.first_from_second) @ se3.inverse(truth[i]) @ truth[j]
    assert np.abs(off[:, :3, 3]).max() < 0.03
    assert np.rad2deg(np.linalg.norm(se3.log_so3(off[:, :3, :3]), axis=1)).max() < 0.6


def test_the_information_is_that_of_many_repetitions():
    """Motions fitted to noise scatter as the information says, and never less than what pairs share."""
    truth, points = poses(), world_points(12)
    a_from_b = se3.inverse(truth[0]) @ truth[3]
    seen_b = se3.transform(se3.inverse(truth[3]), points)
    rng = np.random.default_rng(5)
    sigma = 0.05
    logs, expected = [], None
    for _ in range(400):
        seen_a = se3.transform(a_from_b, seen_b) + rng.normal(0, sigma, seen_b.shape)
        pairs = np.tile([0, 3], (len(points), 1))
        edges = loop_edges(Matches.from_arrays(pairs, seen_a, seen_b, sigma))
        off = se3.inverse(a_from_b) @ edges.first_from_second[0]
        logs.append([*se3.log_so3(off[:3, :3]), *off[:3, 3]])
        expected = np.linalg.inv(edges.information[0])
    found = np.cov(np.array(logs).T)
    floor = np.diag(np.repeat([np.deg2rad(FLOOR_DEG), FLOOR_M], 3) ** 2)
    # Down-weighting what is far off costs a little; 400 repetitions leave a tenth of scatter.
    ratio = np.linalg.eigvals(np.linalg.solve(expected - floor, found)).real
    assert ratio.min() > 0.6
    assert ratio.max() < 1.6


def test_too_few_matches_make_no_edge():
    assert loop_edges(matches_of(poses(), world_points(5))).pairs.shape == (0, 2)


def test_tracks_are_the_true_points(scan):
    truth, points = poses(), world_points()
    seen = observe(scan, truth, matches_of(truth, points))
    assert len(seen.points) == len(points)
    nearest = np.linalg.norm(seen.points[:, None] - points, axis=2)
    assert_allclose(nearest.min(axis=1), 0.0, atol=1e-9)
    assert sorted(nearest.argmin(axis=1)) == list(range(len(points)))
    # Each of four frames sees each point, where it projects to.
    assert np.bincount(seen.frame_idx).tolist() == [len(points)] * N_FRAMES
    assert_allclose(seen.error_px, 0.0, atol=1e-6)
    for i in range(N_FRAMES):
        mine = seen.frame_idx == i
        inside = se3.transform(se3.inverse(truth[i]), seen.points[seen.point_idx[mine]])
        assert_allclose(CAMERA.project(inside), seen.uv[mine], atol=1e-6)


def test_observations_far_from_their_point_are_left_out(scan):
    truth, points = poses(), world_points()
    matches = matches_of(truth, points)
    wrong = matches.points_b.copy()
    last_pair = slice(matches.start[-2], matches.start[-1])
    wrong[last_pair.start + 7] += [0.4, 0.0, 0.0]  # 33 px at 3 m, in one pair alone
    seen = observe(scan, truth, replace(matches, points_b=wrong))
    assert seen.error_px.max() < 4.0
    counts = np.bincount(seen.point_idx)
    assert counts.min() >= 2
    assert np.sum(counts == N_FRAMES) >= len(points) - 1


def test_a_track_that_one_image_would_see_twice_is_none(scan):
    truth, points = poses(), world_points()
    matches = matches_of(truth, points)
    points_b = matches.points_b.copy()
    first = slice(matches.start[0], matches.start[1])
    points_b[first.start] = points_b[first.start + 1]  # point 0 of frame 0 with point 1 of frame 1
    seen = observe(scan, truth, replace(matches, points_b=points_b))
    assert len(seen.points) == len(points) - 2


def test_no_matches_at_all(scan):
    none = Matches.from_arrays(np.zeros((0, 2), int), np.zeros((0, 3)), np.zeros((0, 3)), 0.01)
    seen = observe(scan, poses(), none)
    assert (len(seen.points), len(seen.uv)) == (0, 0)
    assert len(loop_edges(none).pairs) == 0


def test_matches_are_read_back(tmp_path):
    assert read_matches(tmp_path) is None
    matches = matches_of(poses(), world_points())
    write_matches(tmp_path / MATCHES, matches)
    again = read_matches(tmp_path)
    assert again is not None
    assert again.pairs.tolist() == matches.pairs.tolist()
    assert again.start.tolist() == matches.start.tolist()
    assert_allclose(again.points_b, matches.points_b, atol=1e-6)
    data = (tmp_path / MATCHES).read_bytes()
    for spoiled in (b"", data[:500], b"x" * 900):
        (tmp_path / MATCHES).write_bytes(spoiled)
        with pytest.raises(OutputError, match=r"matches\.npz: expected the matches of a run"):
            read_matches(tmp_path)

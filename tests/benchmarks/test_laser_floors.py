"""Walls of a made-up laser log are found where the test put them, and a plan leaves a niche out."""

import numpy as np
import pytest
from buildings import laser_floors
from buildings.laser_floors import LaserLog, laser_floor, walk_of, walls_of
from buildings.lounge import depth_options, rendered_in
from numpy.testing import assert_allclose, assert_array_equal

from planfit.errors import ScanError
from planfit.floorplan import Floorplan
from planfit.floorplan.nearest_faces import nearest_distance
from planfit.geometry import segments
from planfit.synth import TimeOfFlightNoise

CORNERS = np.array([(0, 0), (8, 0), (8, 5), (4.8, 5), (4.8, 5.4), (4, 5.4), (4, 5), (0, 5)], float)
ROOM = np.stack([CORNERS, np.roll(CORNERS, -1, axis=0)], axis=1)
"""8 x 5 m with a niche of 0.8 x 0.4 m; the free side on the left."""
NICHE = slice(3, 6)


def ranges_of(poses, n_beams, rng):
    """Distances to the room's walls, by the crossing of each ray with each wall, and 1 cm of noise."""
    angles = poses[:, 2:] + np.linspace(-np.pi / 2, np.pi / 2, n_beams)
    ray = np.stack([np.cos(angles), np.sin(angles)], axis=-1)[:, :, None]
    wall = ROOM[:, 1] - ROOM[:, 0]
    apart = ROOM[:, 0] - poses[:, None, None, :2]
    turned = ray[..., 0] * wall[:, 1] - ray[..., 1] * wall[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        ahead = (apart[..., 0] * wall[:, 1] - apart[..., 1] * wall[:, 0]) / turned
        along = (apart[..., 0] * ray[..., 1] - apart[..., 1] * ray[..., 0]) / turned
    is_hit = (ahead > 0) & (along >= 0) & (along <= 1)
    nearest = np.where(is_hit, ahead, np.inf).min(axis=2)
    return nearest + 0.01 * rng.normal(size=nearest.shape)


@pytest.fixture(scope="module")
def log():
    there = np.column_stack([np.arange(1.0, 7.1), np.full(7, 2.0), np.full(7, 0.0)])
    turn = np.array([(7.0, 2.0, np.pi / 2)])
    back = np.column_stack([np.arange(7.0, 0.9, -1.0), np.full(7, 3.0), np.full(7, np.pi)])
    poses = np.concatenate([there, turn, back])
    return LaserLog(poses, ranges_of(poses, 361, np.random.default_rng(1)))


@pytest.fixture(scope="module")
def walls(log):
    return walls_of(log)


def test_all_walls_are_found_where_they_are(walls):
    points, _ = segments.sample(ROOM, 0.05)
    # A corner may be left open by as much as neighbouring returns lie apart.
    inner = np.linalg.norm(points[:, None] - CORNERS, axis=2).min(axis=1) > 0.1
    assert nearest_distance(points[inner], walls.built).max() < 0.02
    assert nearest_distance(segments.sample(walls.built, 0.05)[0], ROOM).max() < 0.02


@pytest.mark.parametrize("kind", ["built", "drawn"])
def test_walls_have_the_laser_on_their_left(walls, kind):
    found = getattr(walls, kind)
    middles, normals = found.mean(axis=1), segments.left_normals(found)
    nearest = [np.argmin([nearest_distance(m[None], w[None])[0] for w in ROOM]) for m in middles]
    assert np.einsum("ni,ni->n", normals, segments.left_normals(ROOM[nearest])).min() > 0.99


def test_the_plan_has_the_straight_walls_and_leaves_the_niche_out(walls):
    outer = np.delete(ROOM, NICHE, axis=0)
    assert segments.lengths(walls.drawn).min() >= 1.0
    assert nearest_distance(segments.sample(walls.drawn, 0.05)[0], outer).max() < 0.02
    assert nearest_distance(segments.sample(outer, 0.05)[0], walls.drawn).max() < 0.1
    assert nearest_distance(np.array([[4.4, 5.0], [4.4, 5.4]]), walls.drawn).min() > 0.3
    assert nearest_distance(np.array([[4.4, 5.4]]), walls.built).max() < 0.02


def test_no_wall_stands_where_the_laser_drove(log):
    shut = np.array(log.ranges_m)
    # Two scans see a door at x = 4.5 that the laser drives through afterwards.
    beams = np.linspace(-np.pi / 2, np.pi / 2, 361)
    for k in (1, 2):
        door = (4.5 - log.poses[k, 0]) / np.maximum(np.cos(beams), 1e-9)
        is_met = np.abs(door * np.sin(beams)) < 0.4
        shut[k, is_met] = door[is_met]
    built = walls_of(LaserLog(log.poses, shut)).built
    assert nearest_distance(np.array([[4.5, 2.0]]), built)[0] > 0.25


def test_the_walk_is_the_lasers_own(log):
    walked = walk_of(log, 0.0)
    assert np.linalg.norm(np.diff(walked[:, :2], axis=0), axis=1).max() < 0.021
    away = nearest_distance(walked[:, :2], np.stack([log.poses[:-1, :2], log.poses[1:, :2]], 1))
    assert away.max() < 0.25
    assert_allclose(walked[[0, -1], 2], [0.0, np.pi], atol=0.05)


def test_depth_is_that_of_the_walls_and_the_same_each_time():
    plan = Floorplan.from_segments(ROOM, segments.left_normals(ROOM))
    pose = np.array([(0, 0, 1, 3), (-1, 0, 0, 2), (0, -1, 0, 1.5), (0, 0, 0, 1)], float)
    options = depth_options(1, TimeOfFlightNoise(max_range_m=6.0))
    first, again = (rendered_in("room", plan, plan, pose[None], options) for _ in range(2))
    depth = first.scan.files.depth(0)
    assert_allclose(np.nanmedian(depth[50:70, 70:90]), 5.0, atol=0.1)
    assert_array_equal(depth, again.scan.files.depth(0))
    assert first.scan.fingerprint == again.scan.fingerprint
    assert_allclose(first.true_positions(), [[3, 2, 1.5]])


def test_a_log_that_is_not_at_hand_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(laser_floors, "SHARED", tmp_path)
    with pytest.raises(ScanError, match=r"orebro\.npz: expected a laser log"):
        laser_floor("orebro")

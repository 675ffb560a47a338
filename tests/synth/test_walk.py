"""The walk: free of walls and furniture, through every room, closed where it should be."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.errors import OptionError
from planfit.geometry import se3
from planfit.synth import BuildingOptions, SynthOptions, WalkOptions, make_building, walk_through


def walk(seed=0, building=None, **options):
    house = make_building(building or BuildingOptions(), np.random.default_rng(seed))
    return house, walk_through(house, WalkOptions(**options), np.random.default_rng(seed + 100))


def steps(poses):
    translation = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    rotation = se3.rotation_angle(np.swapaxes(poses[:-1, :3, :3], 1, 2) @ poses[1:, :3, :3])
    return translation, np.rad2deg(rotation)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("n_rooms", [1, 2, 4, 7])
def test_keeps_clear_and_visits_every_room(seed, n_rooms):
    house, poses = walk(seed, BuildingOptions(n_rooms=n_rooms), n_frames=400)
    xy = poses[:, :2, 3]
    assert house.clearance(xy).min() >= 0.4
    assert all(room.contains(xy).any() for room in house.layout.rooms)


def test_clearance_is_an_option():
    house, poses = walk(1, clearance_m=0.2)
    assert house.clearance(poses[:, :2, 3]).min() >= 0.2


def test_loop_ends_where_it_began_with_the_same_view():
    _, poses = walk(2)
    assert_allclose(poses[-1], poses[0], atol=1e-6)


def test_open_walk_does_not_come_back():
    _, poses = walk(2, is_loop=False)
    assert np.linalg.norm(poses[-1, :3, 3] - poses[0, :3, 3]) > 1.0


@pytest.mark.parametrize("seed", range(4))
def test_neighbouring_frames_overlap_at_the_default(seed):
    _, poses = walk(seed)
    translation, rotation = steps(poses)
    assert len(poses) == 180
    assert translation.max() <= 0.33
    assert np.mean(rotation) < 11
    assert rotation.max() < 17


def test_more_frames_take_smaller_steps():
    _, few = walk(n_frames=100)
    _, many = walk(n_frames=400)
    assert steps(many)[0].max() < 0.4 * steps(few)[0].max()


def test_poses_are_rigid_and_upright():
    _, poses = walk()
    rotations = poses[:, :3, :3]
    assert_allclose(np.swapaxes(rotations, 1, 2) @ rotations, np.tile(np.eye(3), (180, 1, 1)),
                    atol=1e-12)  # fmt: skip
    assert (np.linalg.det(rotations) > 0).all()
    assert (rotations[:, 2, 1] < -0.8).all()  # the camera's y looks down


def test_height_sway_pitch_and_roll_are_options():
    _, poses = walk(height_m=1.2, sway_m=0.0, pitch_deg=-20.0, pitch_swing_deg=0.0,
                    roll_swing_deg=0.0)  # fmt: skip
    assert_allclose(poses[:, 2, 3], 1.2)
    assert_allclose(poses[:, 2, 2], np.sin(np.deg2rad(-20.0)))
    assert_allclose(poses[:, 2, 0], 0.0, atol=1e-12)
    _, swaying = walk(height_m=1.2, sway_m=0.05)
    assert 0.01 < np.std(swaying[:, 2, 3]) < 0.08


def test_looking_around_turns_the_view_off_the_way():
    def off_the_way(poses):
        ahead = np.diff(poses[:, :2, 3], axis=0)
        view = poses[:-1, :2, 2]
        cosine = np.sum(ahead * view, axis=1) / (
            np.linalg.norm(ahead, axis=1) * np.linalg.norm(view, axis=1)
        )
        return np.rad2deg(np.median(np.arccos(np.clip(cosine, -1, 1))))

    ahead = [off_the_way(walk(seed, look_around_deg=0.0)[1]) for seed in range(3)]
    around = [off_the_way(walk(seed, look_around_deg=45.0)[1]) for seed in range(3)]
    assert np.mean(around) > np.mean(ahead) + 5


def test_more_stops_make_a_longer_way():
    _, short = walk(area_per_stop_m2=20.0)
    _, long = walk(area_per_stop_m2=3.0)
    assert steps(long)[0].sum() > steps(short)[0].sum()


def test_turned_buildings_are_walked_alike():
    _, straight = walk()
    _, turned = walk(building=BuildingOptions(yaw_deg=40.0))
    assert_allclose(turned, se3.yaw_transform(np.deg2rad(40.0)) @ straight, atol=1e-12)


def test_the_same_generator_gives_the_same_walk():
    assert_array_equal(walk(3)[1], walk(3)[1])


def test_too_narrow_ways_are_refused():
    with pytest.raises(OptionError, match="clearance_m"):
        walk(clearance_m=0.8)
    with pytest.raises(OptionError, match="door_width_m"):
        SynthOptions(walk=WalkOptions(clearance_m=0.45))
    with pytest.raises(OptionError, match="n_frames"):
        WalkOptions(n_frames=1)
    with pytest.raises(OptionError, match=r"walk\.height_m"):
        SynthOptions(walk=WalkOptions(height_m=1.95))

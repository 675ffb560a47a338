"""Posters, doors and rooms that look alike: as many as asked for, in place, the same to the pixel."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.errors import OptionError
from planfit.floorplan import Floorplan
from planfit.geometry import segments
from planfit.geometry.camera import Camera
from planfit.scan import Label
from planfit.synth import BuildingOptions, SynthOptions, WalkOptions, make_building, make_scan
from planfit.synth.lookalikes import FURTHEST_M, NEAREST_M, POSTER_SIZE_M

CAMERA = Camera(80, 60, 60.0, 60.0, 39.5, 29.5)


def scan(seed=0, plan=None, **building):
    options = BuildingOptions(**building)
    return make_scan(SynthOptions(seed, building=options, walk=WalkOptions(n_frames=30)), plan)


def hall(width=24.0, depth=12.0):
    """One room, a wall across it with a door of 1 m."""
    middle, door = width / 2, (5.0, 6.0)
    corners = np.array([(0, 0), (width, 0), (width, depth), (0, depth)], dtype=float)
    ends = list(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
    for low, high in ((0.0, door[0]), (door[1], depth)):
        ends.append(np.array([(middle, low), (middle, high)]))
        ends.append(np.array([(middle + 0.2, high), (middle + 0.2, low)]))
    return Floorplan.from_segments(ends, segments.left_normals(np.array(ends)), name="hall")


def view_from(synthetic, eye, ahead):
    """What a level camera sees, up is up."""
    ahead = np.array([*ahead, 0.0]) / np.linalg.norm(ahead)
    down = np.array([0.0, 0.0, -1.0])
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([np.cross(down, ahead), down, ahead])
    pose[:3, 3] = eye
    return synthetic.renderer.render(CAMERA, pose)


def spacing(posters):
    xy = np.array([poster.place for poster in posters])
    apart = np.linalg.norm(xy[:, None] - xy, axis=-1)
    return apart[np.triu_indices(len(xy), 1)], np.sort(apart, axis=1)[:, 1]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("plan", [None, hall()])
def test_posters_hang_so_far_apart(seed, plan):
    posters = scan(seed, plan, n_rooms=8, same_posters=5).building.posters
    assert len(posters) == 5
    every, nearest = spacing(posters)
    assert every.min() >= NEAREST_M
    assert nearest.max() <= FURTHEST_M
    assert len({poster.seed for poster in posters}) == 1


def test_posters_show_the_same_picture_to_the_pixel():
    synthetic = scan(1, hall(), same_posters=4)
    seen = []
    for poster in synthetic.building.posters:
        into = np.array([-np.sin(poster.yaw), np.cos(poster.yaw)])
        view = view_from(synthetic, (*(poster.place + 0.8 * into), 1.45), -into)
        seen.append(view.color[15:45, 15:65])  # within 0.9 x 0.7 m at 0.77 m
        assert (view.labels[15:45, 15:65] == Label.OTHER).all()
    assert np.std(seen[0]) > 0.05
    for picture in seen[1:]:
        assert_allclose(picture, seen[0], atol=2e-3)


def test_posters_of_made_up_buildings_are_of_one_texture():
    synthetic = scan(n_rooms=8, same_posters=4)
    quads, posters = synthetic.renderer.quads, synthetic.building.posters
    is_poster = quads.seed == np.uint64(posters[0].seed)
    fronts = quads.take(np.flatnonzero(is_poster & np.isclose(quads.size[:, 0], POSTER_SIZE_M[0])
                                       & np.isclose(quads.size[:, 1], POSTER_SIZE_M[1])))  # fmt: skip
    assert len(fronts) == 8  # fronts and backs
    assert_array_equal(fronts.color, fronts.color[[0] * 8])
    assert set(fronts.room) == {poster.room for poster in posters}


def test_posters_change_nothing_else():
    plain, hung = scan(2, n_rooms=8), scan(2, n_rooms=8, same_posters=4)
    assert_array_equal(plain.true_plan_from_cams, hung.true_plan_from_cams)
    n = len(plain.renderer.quads)
    assert len(hung.renderer.quads) == n + 4 * 6
    assert_array_equal(hung.renderer.quads.seed[:n], plain.renderer.quads.seed)
    assert_array_equal(hung.renderer.quads.origin[:n], plain.renderer.quads.origin)


def test_too_many_posters_are_refused():
    with pytest.raises(OptionError, match="same_posters"):
        scan(n_rooms=1, same_posters=9)


def test_the_same_door_stands_at_every_doorway():
    synthetic = scan(n_rooms=6, same_doors=True)
    building, quads = synthetic.building, synthetic.renderer.quads
    leaves = [piece for piece in building.furniture if piece.seed is not None]
    assert len(leaves) == len(building.layout.doors)
    (seed,) = {leaf.seed for leaf in leaves}
    assert seed is not None
    for leaf, door in zip(leaves, building.layout.doors, strict=True):
        assert np.linalg.norm(np.array(leaf.footprint.centre) - door.rect.centre) < 1.0
        assert not leaf.footprint.bounds().overlaps(door.rect)
        assert building.layout.rooms[leaf.room].contains(np.array([leaf.footprint.centre])).all()
    sizes = np.unique(quads.size[quads.seed == np.uint64(seed)].round(9), axis=0)
    assert len(sizes) == 6  # three sides of the leaf, three of its notices
    assert building.clearance(synthetic.true_plan_from_cams[:, :2, 3]).min() >= 0.4


def test_the_same_door_stands_in_gaps_of_plans():
    synthetic = scan(0, hall(), same_doors=True)
    (leaf,) = synthetic.building.furniture
    assert_allclose(abs(leaf.footprint.centre[0] - 12.1), 0.1 + 0.02 + 0.425, atol=1e-6)
    assert_allclose(abs(leaf.footprint.centre[1] - 5.5), 0.5 + 0.04, atol=1e-6)
    centres = synthetic.true_plan_from_cams[:, :2, 3]
    assert (centres[:, 0] > 12.2).any()
    assert (centres[:, 0] < 12.0).any()
    assert leaf.footprint.distance(centres).min() >= 0.25


@pytest.mark.parametrize("seed", range(2))
def test_rooms_that_look_alike_are_seen_alike(seed):
    synthetic = scan(seed, n_rooms=6, same_rooms=True)
    layout = synthetic.building.layout
    assert layout.corridor is not None
    corridor = layout.rooms[layout.corridor].centre[1]
    seen = []
    for k, room in enumerate(layout.rooms):
        if k != layout.corridor:
            assert_allclose(room.size, layout.rooms[0].size, atol=1e-9)
            away = np.array([0.0, np.sign(room.centre[1] - corridor)])
            eye = room.centre - 0.3 * away
            seen.append(view_from(synthetic, (*eye, 1.5), away))
    for view in seen[1:]:
        assert_allclose(view.depth, seen[0].depth, atol=1e-5)
        assert_array_equal(view.labels, seen[0].labels)
        assert np.quantile(np.abs(view.color - seen[0].color), 0.99) < 1e-3


def test_equal_rooms_need_a_corridor_and_no_plan():
    with pytest.raises(OptionError, match="same_rooms"):
        BuildingOptions(n_rooms=3, same_rooms=True)
    with pytest.raises(OptionError, match="same_rooms"):
        scan(0, hall(), same_rooms=True)


def test_long_corridors_and_halls_are_options():
    rng = np.random.default_rng(0)
    options = BuildingOptions(n_rooms=31, room_size_m=(3.6, 4.4), furniture_per_room=0)
    layout = make_building(options, rng).layout
    assert layout.corridor is not None
    assert 50 < layout.rooms[layout.corridor].size[0] < 70
    options = BuildingOptions(
        is_open_plan=True, open_plan_size_m=(30.0, 20.0), furniture_per_room=0
    )
    assert_allclose(make_building(options, rng).layout.rooms[0].size, [30.0, 20.0])
    with pytest.raises(OptionError, match="open_plan_size_m"):
        BuildingOptions(open_plan_size_m=(30.0, 20.0))

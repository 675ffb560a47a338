"""The building: faces against the layout they come from, free sides, doors, furniture, options."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.errors import OptionError
from planfit.floorplan import Floorplan, nearest_faces
from planfit.geometry import segments
from planfit.scan import Label
from planfit.synth import BuildingOptions, facap_segments, make_building, make_quads
from planfit.synth.building import Part


def building(seed=0, **options):
    return make_building(BuildingOptions(**options), np.random.default_rng(seed))


def is_free(b, xy):
    """Inside a room or a door opening, and in no column."""
    spaces = [*b.layout.rooms, *(door.rect for door in b.layout.doors)]
    free = np.any([space.contains(xy) for space in spaces], axis=0)
    return free & ~np.any([c.contains(xy) for c in b.layout.columns] + [np.zeros(len(xy), bool)], 0)


@pytest.mark.parametrize("n_rooms", range(1, 13))
@pytest.mark.parametrize("has_corridor", [True, False])
def test_every_room_is_there_and_reached(n_rooms, has_corridor):
    b = building(seed=n_rooms, n_rooms=n_rooms, has_corridor=has_corridor, furniture_per_room=0)
    assert len(b.layout.rooms) == n_rooms
    reached = {0}
    for _ in range(n_rooms):
        reached |= {r for d in b.layout.doors if reached & set(d.rooms) for r in d.rooms}
    assert reached == set(range(n_rooms))
    for i, a in enumerate(b.layout.rooms):
        assert not any(a.overlaps(other) for other in b.layout.rooms[i + 1 :])


@pytest.mark.parametrize("seed", range(6))
def test_faces_divide_free_space_from_wall(seed):
    b = building(seed=seed, n_rooms=7, has_corridor=bool(seed % 2), n_columns=seed % 3)
    is_drawn = b.faces.parts != Part.LINTEL
    ends = b.faces.ends[is_drawn]
    normals = segments.left_normals(ends)
    points, face = segments.sample(ends, 0.1)
    in_front = points + 0.01 * normals[face]
    behind = points - 0.01 * normals[face]
    looks_outside = b.faces.rooms[is_drawn][face] == -1
    assert_array_equal(is_free(b, in_front), ~looks_outside)
    assert not is_free(b, behind).any()


def test_faces_close_around_every_room():
    b = building(n_rooms=5)
    for i, room in enumerate(b.layout.rooms):
        own = (b.faces.rooms == i) & ~b.faces.is_column
        total = segments.lengths(b.faces.ends[own]).sum()
        assert_allclose(total, 2 * room.size.sum(), atol=1e-9)  # lintels bridge the doors


@pytest.mark.parametrize("seed", range(8))
def test_equal_rooms_leave_no_slivers_between_their_edges(seed):
    """Edges of seed 2 are the same but for rounding: a face between them had 9e-16 m."""
    options = BuildingOptions(n_rooms=5, same_rooms=True)
    plan = make_building(options, np.random.default_rng(seed)).floorplan
    assert plan.lengths.min() > 0.05


def test_doors_are_gaps_in_the_plan():
    b = building(n_rooms=6, door_width_m=1.1)
    for door in b.layout.doors:
        across = door.rect.size[1 if door.is_across_x else 0]
        assert_allclose(across, 1.1, atol=1e-9)
        is_jamb = b.faces.parts == Part.JAMB
        distance = nearest_faces.nearest_distance(
            door.rect.centre[None], b.floorplan.ends[~is_jamb[b.faces.parts != Part.LINTEL]]
        )
        assert distance[0] >= 0.55 - 1e-9


def test_walls_are_as_thick_as_asked():
    b = building(n_rooms=6, wall_thickness_m=(0.17, 0.17))
    doors = [d.rect.size[0 if d.is_across_x else 1] for d in b.layout.doors]
    assert_allclose(doors, 0.17, atol=1e-9)
    outer = b.floorplan.ends.reshape(-1, 2).min(axis=0)
    assert_allclose(outer, [-0.3, -0.3])


def test_the_plan_reader_finds_the_same_free_sides():
    plan = building(n_rooms=6).floorplan
    read = Floorplan.from_segments(plan.ends, name="twin")
    assert read.is_oriented.mean() > 0.6  # insides of doors have no partner line
    assert_allclose(read.normals[read.is_oriented], plan.normals[read.is_oriented], atol=1e-9)


def test_facap_segments_are_plan_points_with_y_turned():
    plan = building().floorplan
    values = facap_segments(plan)
    assert values.shape == (len(plan), 4)
    assert_allclose(values.reshape(-1, 2, 2) * (1, -1), plan.ends)


def test_rooms_are_within_the_size_range():
    b = building(n_rooms=8, room_size_m=(3.0, 3.5))
    for i, room in enumerate(b.layout.rooms):
        if i != b.layout.corridor:
            assert (room.size >= 3.0).all()
            assert (room.size <= 3.5).all()


def test_corridor_is_as_wide_as_asked_and_only_from_four_rooms_on():
    b = building(n_rooms=6, corridor_width_m=2.2)
    assert b.layout.corridor is not None
    assert_allclose(b.layout.rooms[b.layout.corridor].size[1], 2.2)
    assert building(n_rooms=3).layout.corridor is None
    assert building(n_rooms=6, has_corridor=False).layout.corridor is None


def test_extra_doors_make_circles():
    assert len(building(n_rooms=9).layout.doors) > 8


def test_open_plan_is_one_room_of_the_same_area():
    b = building(n_rooms=6, is_open_plan=True, room_size_m=(4.0, 4.0))
    assert len(b.layout.rooms) == 1
    assert_allclose(b.layout.rooms[0].area, 96.0)
    assert b.layout.doors == ()


def test_columns_are_in_the_plan():
    b = building(n_rooms=6, is_open_plan=True, n_columns=2)
    assert len(b.layout.columns) == 2
    assert b.faces.is_column.sum() == 8
    assert len(b.floorplan) == 8 + 8  # four inner and four outer walls


def test_bare_rooms_hold_nothing():
    b = building(furniture_per_room=0)
    assert b.furniture == ()
    assert len(building(furniture_per_room=10).furniture) > len(building().furniture) > 5


@pytest.mark.parametrize("seed", range(4))
def test_furniture_stands_in_its_room_and_apart(seed):
    b = building(seed=seed, n_rooms=5)
    for i, piece in enumerate(b.furniture):
        bounds, room = piece.footprint.bounds(), b.layout.rooms[piece.room]
        corners = np.array([[bounds.x0, bounds.y0], [bounds.x1, bounds.y1]])
        assert room.contains(corners).all()
        for other in b.furniture[i + 1 :]:
            assert not bounds.overlaps(other.footprint.bounds())
        for door in b.layout.doors:
            assert not bounds.overlaps(door.rect.grown(0.5))


def test_clearance_is_the_distance_to_walls_and_furniture():
    b = building(n_rooms=1, furniture_per_room=0)
    room = b.layout.rooms[0]
    xy = np.array([[room.x0 + 0.3, room.centre[1]], [room.x0 - 0.1, room.centre[1]]])
    assert_allclose(b.clearance(xy), [0.3, 0.0], atol=1e-12)
    furnished = building(n_rooms=1)
    centre = np.array([furnished.furniture[0].footprint.centre])
    assert_allclose(furnished.clearance(centre), [0.0])


def test_yaw_turns_plan_and_mesh_together():
    straight, turned = building(), building(yaw_deg=30.0)
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    assert_allclose(turned.floorplan.ends, straight.floorplan.ends @ [[c, s], [-s, c]], atol=1e-12)
    quads = make_quads(turned, np.random.default_rng(0))
    walls = quads.label == Label.WALL
    sines = quads.normal[walls][:, :2] @ turned.floorplan.normals.T
    assert_allclose(sines.max(axis=1), 1.0)


def test_heights_reach_the_mesh():
    b = building(height_m=3.0, door_height_m=2.2)
    quads = make_quads(b, np.random.default_rng(0))
    assert_allclose(quads.origin[quads.label == Label.CEILING][:, 2], 3.0)
    assert_allclose(quads.origin[quads.label == Label.FLOOR][:, 2], 0.0)
    walls = quads.label == Label.WALL
    tops = (quads.origin + quads.v_axis * quads.size[:, 1:])[walls][:, 2]
    assert set(np.round(tops, 6)) == {2.2, 3.0}


def test_pictures_hang_only_where_asked():
    bare = make_quads(building(pictures_per_wall=0.0), np.random.default_rng(0))
    hung = make_quads(building(pictures_per_wall=3.0), np.random.default_rng(0))
    assert len(hung) > len(bare) + 50


def test_mesh_normals_agree_with_its_sides():
    quads = make_quads(building(), np.random.default_rng(0))
    cross = np.abs(np.einsum("ni,ni->n", np.cross(quads.u_axis, quads.v_axis), quads.normal))
    assert_allclose(cross, 1.0)


def test_the_same_generator_gives_the_same_building():
    a, b, other = building(seed=4), building(seed=4), building(seed=5)
    assert_array_equal(a.floorplan.ends, b.floorplan.ends)
    assert a.furniture == b.furniture
    assert a.layout != other.layout


@pytest.mark.parametrize(
    "options",
    [
        {"n_rooms": 0},
        {"n_rooms": 41},
        {"room_size_m": (1.5, 4.0)},
        {"room_size_m": (5.0, 4.0)},
        {"wall_thickness_m": (0.1, 0.4)},
        {"door_height_m": 2.7},
        {"corridor_width_m": 0.8},
        {"furniture_per_room": -1},
    ],
)
def test_impossible_options_are_refused(options):
    with pytest.raises(OptionError, match=next(iter(options))):
        BuildingOptions(**options)

"""Mutually nearest walls: the paper's rule, against a twin that loops over walls, planes and patches."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import faces_plan, make_world, nudged
from planfit.adjust.association import AssociationOptions, associate
from planfit.adjust.mutual_walls import (
    MAX_GAP_M,
    PLAN_TOLERANCE_M,
    WALL_TOLERANCE_M,
    group_by_plane,
    mutually_nearest,
)
from planfit.adjust.paper.preset import paper_options
from planfit.floorplan import Floorplan
from planfit.floorplan.nearest_faces import BesideRule, nearest_of_segments, share_beside

RULE = BesideRule(max_distance_m=1.0, max_angle_deg=12.0, min_overlap=0.5, oriented=False)
UP = np.array([0.0, 1.0])


def along_x(*spans):
    """Segments (first x, last x, y), as ends."""
    return np.array([[[a, y], [b, y]] for a, b, y in spans], dtype=float)


def strokes(*spans):
    ends = along_x(*spans)
    n = len(ends)
    return Floorplan("strokes", ends, np.tile(UP, (n, 1)), np.zeros(n, dtype=bool))


def faces_of(ends, plan, n_points=None, rule=RULE):
    n_points = np.full(len(ends), 100) if n_points is None else np.asarray(n_points)
    signed, face = mutually_nearest(ends, np.tile(UP, (len(ends), 1)), n_points, plan, rule)
    assert_array_equal(np.isnan(signed), face < 0)
    return face.tolist()


def test_of_a_doubled_wall_only_the_nearer_layer_is_matched():
    plan = strokes((0, 8, 0.0))
    doubled = along_x((1, 3, 0.05), (1.5, 3.5, 0.3), (2, 3, 0.32))
    assert faces_of(doubled, plan) == [0, -1, -1]
    signed, nearest = nearest_of_segments(doubled, np.tile(UP, (3, 1)), plan, RULE)
    assert nearest.tolist() == [0, 0, 0]
    assert_allclose(signed, [0.05, 0.3, 0.32])


def test_the_farther_layer_is_matched_where_the_nearer_one_does_not_stand():
    plan = strokes((0, 12, 0.0))
    walls = along_x((0, 2, 0.05), (1, 2, 0.3), (2.2, 4, 0.32), (4.2, 6, 0.31))
    assert faces_of(walls, plan) == [0, -1, 0, 0]


def test_rooms_side_by_side_do_not_exclude_each_other():
    # Three rooms along one outer wall, drifted apart by more than a wall's thickness.
    assert faces_of(along_x((0, 3, 0.1), (3.2, 6, 0.4), (6.2, 9, -0.3)), strokes((0, 9, 0))) == [
        0,
        0,
        0,
    ]


def test_a_wall_drawn_in_pieces_is_one_plane():
    plan = strokes((0, 2, 0), (3, 5, 0), (6, 8, 0), (0, 8, 0.6))
    wall = along_x((0.2, 1.8, 0.2), (1.5, 2.6, 0.22), (3.4, 4.8, 0.2), (5, 5.9, 0.21), (6, 7, 0.2))
    # The fourth stands in a door: it belongs to the wall, but to no face.
    assert faces_of(wall, plan) == [0, 0, 1, -1, 2]


def test_a_wall_goes_to_one_plane_as_a_whole():
    # A pier before the wall: two of the wall's patches are nearer to it than to the wall itself.
    plan = strokes((0, 10, 0.0), (4, 5, 0.25))
    wall = along_x((0, 3, 0.12), (3, 4, 0.12), (4, 5, 0.15), (5, 8, 0.12), (8, 10, 0.12))
    assert faces_of(wall, plan) == [0, 0, 0, 0, 0]
    alone = nearest_of_segments(wall, np.tile(UP, (5, 1)), plan, RULE)[1]
    assert alone.tolist() == [0, 0, 1, 0, 0]


def test_the_two_sides_of_a_partition_are_two_walls():
    ends = along_x((0, 3, 0.03), (0, 3, -0.03))
    normals = np.array([[0.0, 1.0], [0.0, -1.0]])
    assert len(set(group_by_plane(ends, normals, np.ones(2), 0.1, 12.0, 1.0))) == 2
    assert len(set(group_by_plane(ends, normals[[0, 0]], np.ones(2), 0.1, 12.0, 1.0))) == 1


def test_a_gap_wider_than_a_door_parts_a_wall():
    for gap_m, n_walls in ((0.9, 1), (1.1, 2)):
        ends = along_x((0, 2, 0), (2 + gap_m, 5, 0.02))
        found = group_by_plane(ends, np.tile(UP, (2, 1)), np.ones(2), 0.1, 12.0, MAX_GAP_M)
        assert len(set(found)) == n_walls


def random_walls(rng, n=60):
    """Patches near the faces of a building of two rooms and a corridor, some of them doubled or stray."""
    plan = Floorplan.from_segments(
        [
            [[0, 0], [5, 0]], [[6, 0], [9, 0]], [[0, 4], [9, 4]], [[0, 4.2], [9, 4.2]],
            [[0, 0], [0, 4]], [[5, 0], [5, 1.5]], [[5, 2.5], [5, 4]], [[9, 0], [9, 4]],
            [[0, 7], [9, 7]], [[2, 4.2], [2, 7]],
        ],
        name="two rooms",
    )  # fmt: skip
    face = rng.integers(len(plan), size=n)
    along = (plan.ends[face, 1] - plan.ends[face, 0]) / plan.lengths[face, None]
    at = rng.uniform(0, 1, (n, 2)) * plan.lengths[face, None]
    at[:, 1] = at[:, 0] + rng.uniform(0.5, 2.0, n)
    ends = plan.ends[face, 0][:, None] + at[..., None] * along[:, None]
    side = rng.choice([-1.0, 1.0], n)
    # Off by what drift does: one of a few amounts, so that patches make walls.
    off = rng.choice([-0.3, 0.02, 0.08, 0.35], n) + rng.normal(0, 0.01, n)
    ends += (off[:, None] * plan.normals[face])[:, None]
    return plan, ends, side[:, None] * plan.normals[face], rng.integers(60, 900, n)


def twin(ends, normals, n_points, plan, rule):
    """Mutually nearest by loops; walls and planes are given."""
    walls = group_by_plane(ends, normals, n_points, WALL_TOLERANCE_M, rule.max_angle_deg, MAX_GAP_M)
    planes = group_by_plane(plan.ends, plan.normals, plan.lengths, PLAN_TOLERANCE_M, 0.5, np.inf)
    beside = share_beside(ends, plan, rule.end_margin_m)
    limit = np.cos(np.deg2rad(rule.max_angle_deg))

    def faces(patch, plane):
        """(distance, face) of the faces of a plane that a patch lies beside."""
        found = []
        for f in np.flatnonzero(planes == plane):
            d = ends[patch].mean(axis=0) @ plan.normals[f] - plan.offsets[f]
            cosine = normals[patch] @ plan.normals[f]
            sees = cosine if rule.oriented and plan.is_oriented[f] else abs(cosine)
            if (
                sees > limit
                and abs(d) < rule.max_distance_m
                and beside[patch, f] >= rule.min_overlap
            ):
                found.append((abs(d), f, d))
        return sorted(found)

    def distance(wall, plane):
        members = np.flatnonzero(walls == wall)
        seen = [(n_points[k], faces(k, plane)[0][0]) for k in members if faces(k, plane)]
        weight = sum(w for w, _ in seen)
        if not seen or weight < rule.min_overlap * n_points[members].sum():
            return np.inf
        return sum(w * d for w, d in seen) / weight

    table = np.array(
        [[distance(w, p) for p in range(planes.max() + 1)] for w in range(walls.max() + 1)]
    )
    face_idx = np.full(len(ends), -1)
    for patch, wall in enumerate(walls):
        plane = int(np.argmin(table[wall]))
        own = faces(patch, plane) if np.isfinite(table[wall, plane]) else []
        if not own:
            continue
        along = plan.ends[planes == plane][0]
        along = (along[1] - along[0]) / np.linalg.norm(along[1] - along[0])
        middle = ends[patch].mean(axis=0) @ along
        rivals = []
        for other in range(len(table)):
            at = ends[walls == other].reshape(-1, 2) @ along
            if at.min() <= middle <= at.max():
                rivals.append(table[other, plane])
        if table[wall, plane] <= min(rivals):
            face_idx[patch] = own[0][1]
    return face_idx


@pytest.mark.parametrize("oriented", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_against_loops(seed, oriented):
    plan, ends, normals, n_points = random_walls(np.random.default_rng(seed))
    rule = BesideRule(0.5, 12.0, 0.5, oriented=oriented)
    signed, face_idx = mutually_nearest(ends, normals, n_points, plan, rule)
    assert_array_equal(face_idx, twin(ends, normals, n_points, plan, rule))
    kept = face_idx >= 0
    assert 10 < kept.sum() < len(ends) - 5
    off = np.sum(ends.mean(axis=1)[kept] * plan.normals[face_idx[kept]], axis=1)
    assert_allclose(signed[kept], off - plan.offsets[face_idx[kept]])


def test_no_wall_or_no_plan_is_no_match():
    assert faces_of(np.zeros((0, 2, 2)), strokes((0, 1, 0))) == []
    assert faces_of(along_x((0, 1, 0)), strokes((20, 30, 0))) == [-1]


def test_the_preset_of_the_paper_asks_for_it(rng):
    assert paper_options().association.mutual
    assert not AssociationOptions().mutual
    # Of a room's walls, seen by eight exact cameras, every patch is on its wall.
    world = make_world(rng)
    arguments = world.structure.walls, world.floorplan
    exact = associate(*arguments, world.plan_from_cams, 2.0, paper_options().association)
    assert exact.n_associated == 16
    # A camera that drift has put 0.4 m off makes second layers, which are not held to the plan.
    off = nudged(rng, world.plan_from_cams, 0.1, 0.005)
    off[5, :2, 3] += 0.4
    mutual = associate(*arguments, off, 2.0, paper_options().association)
    is_off = world.structure.walls.frame_idx == 5
    assert (mutual.face_idx[is_off] < 0).all()
    assert_array_equal(mutual.face_idx[~is_off], exact.face_idx[~is_off])


def test_faces_in_a_polygon_find_their_plane():
    plan = faces_plan([[0, 0], [6, 0], [6, 4], [0, 4]])
    ends = np.array([[[1, 0.1], [3, 0.1]], [[5.9, 1], [5.9, 3]]])
    signed, face = mutually_nearest(
        ends, np.array([[0, 1.0], [-1.0, 0]]), np.array([9, 9]), plan, RULE
    )
    assert face.tolist() == [0, 1]
    assert_allclose(signed, [0.1, 0.1])

"""Verdicts on walls, on results whose truth is made here: no refine is run."""

from dataclasses import replace

import numpy as np
import pytest

from builders import faces_plan, look, make_structure
from planfit.as_built import (
    AsBuilt,
    AsBuiltOptions,
    AsBuiltWall,
    Verdict,
    counted,
    deviations,
    in_words,
    judge_walls,
    read_as_built,
    write_as_built,
)
from planfit.as_built.lines_of_sight import (
    BEYOND_M,
    HEIGHTS_M,
    MIN_FRAMES,
    lines_of_sight,
    through_shares,
)
from planfit.as_built.wall_offsets import offset_sigma, place_walls
from planfit.errors import ScanError
from planfit.floorplan import Floorplan
from planfit.floorplan.types import PlanSource
from planfit.geometry import se3

WIDTH, DEPTH, HEIGHT = 6.0, 4.0, 2.6
SOUTH, EAST, NORTH, WEST = range(4)


def room() -> Floorplan:
    """A room from the origin, its faces looking into it: south, east, north, west."""
    return faces_plan([[0, 0], [WIDTH, 0], [WIDTH, DEPTH], [0, DEPTH]], "room")


def cameras(n: int = 12) -> np.ndarray:
    """In the middle of the room, looking all around."""
    return np.stack([look([3.0, 2.0, 1.5], yaw) for yaw in np.linspace(0, 330, n)])


def wall_points(ends, rng, count=300, top_m=HEIGHT, off_m=0.0, normal=(0.0, 0.0)):
    """Points all over a wall, m."""
    first, last = np.asarray(ends, dtype=float)
    at = rng.uniform(0.02, 0.98, (count, 1))
    xy = first + at * (last - first) + off_m * np.asarray(normal)
    return np.column_stack([xy, rng.uniform(0.1, top_m, count)])


def seen_by(walls, rng, frames=range(12), noise_m=0.0):
    """Patches: each wall (ends, normal) seen by all frames, as (frame, points, normal)."""
    return [
        (
            frame,
            wall_points(ends, rng) + noise_m * rng.normal() * np.array([*normal, 0.0]),
            np.asarray(normal, dtype=float),
        )
        for ends, normal in walls
        for frame in frames
    ]


def faces_of(plan, but=()):
    return [(plan.ends[i], plan.normals[i]) for i in range(len(plan)) if i not in but]


def judged(plan, patches, poses=None, covariances=None, options=None, structure=None):
    poses = cameras() if poses is None else poses
    options = options or AsBuiltOptions()
    structure = structure or make_structure(poses, patches=patches)
    if covariances is None:
        covariances = np.zeros((len(poses), 6, 6))
    stretch = np.zeros(len(poses), dtype=int)
    placed = place_walls(structure, plan, poses, covariances, stretch)
    sight = lines_of_sight(structure, poses, structure.floor_heights_m)
    return judge_walls(plan, placed, sight, options)


def verdict_of(as_built: AsBuilt, face: int, tolerance_m=None) -> Verdict:
    (wall,) = [wall for wall in as_built.walls if wall.face_idx == face]
    return as_built.verdict(wall, tolerance_m)


def wall_of(as_built: AsBuilt, face: int) -> AsBuiltWall:
    return next(wall for wall in as_built.walls if wall.face_idx == face)


def test_walls_as_drawn_agree(rng):
    found = judged(room(), seen_by(faces_of(room()), rng))
    assert counted(found.verdicts()) == {v: 4 if v is Verdict.AGREES else 0 for v in Verdict}
    assert max(abs(wall.offset_m) for wall in found.walls) < 1e-9


@pytest.mark.parametrize("off_m", [0.1, 0.35, -0.1, -0.35])
def test_a_moved_wall_has_its_offset_and_side(off_m, rng):
    plan = room()
    moved = plan.ends[NORTH] + off_m * plan.normals[NORTH]
    walls = [*faces_of(plan, but=[NORTH]), (moved, plan.normals[NORTH])]
    found = judged(plan, seen_by(walls, rng))
    wall = wall_of(found, NORTH)
    assert found.verdict(wall) is Verdict.MOVED
    assert wall.offset_m == pytest.approx(off_m, abs=1e-6)
    np.testing.assert_allclose(wall.built_ends, moved, atol=1e-6)
    assert ("into the room" if off_m > 0 else "into the wall") in in_words(wall, Verdict.MOVED)
    # North looks south: into the room is towards -y.
    assert f"towards {'-' if off_m > 0 else '+'}y" in in_words(wall, Verdict.MOVED)
    assert counted(found.verdicts())[Verdict.AGREES] == 3
    assert counted(found.verdicts())[Verdict.NEW] == 0


def test_the_tolerance_moves_the_border_between_agreeing_and_moved(rng):
    plan = room()
    walls = [*faces_of(plan, but=[EAST]), (plan.ends[EAST] - [0.06, 0.0], plan.normals[EAST])]
    found = judged(plan, seen_by(walls, rng))
    assert wall_of(found, EAST).offset_m == pytest.approx(0.06, abs=1e-6)
    assert verdict_of(found, EAST) is Verdict.MOVED
    assert verdict_of(found, EAST, 0.08) is Verdict.AGREES
    assert verdict_of(
        judged(plan, seen_by(walls, rng), options=AsBuiltOptions(tolerance_m=0.08)), EAST
    ) is (Verdict.AGREES)


def with_partition(plan):
    """A partition across the room that nothing but the plan knows of, both faces."""
    ends = np.array([[[3.06, 0.0], [3.06, 3.0]], [[2.94, 3.0], [2.94, 0.0]]])
    normals = np.array([[1.0, 0.0], [-1.0, 0.0]])
    return replace(
        plan,
        ends=np.concatenate([plan.ends, ends]),
        normals=np.concatenate([plan.normals, normals]),
        is_oriented=np.ones(6, dtype=bool),
    )


def looking_across(n=12):
    """From the west end of the room, so that lines of sight pass its middle."""
    return np.stack([look([0.8, y, 1.5], 0.0) for y in np.linspace(0.5, 3.5, n)])


def test_a_wall_that_cameras_look_through_is_missing(rng):
    plan, poses = with_partition(room()), looking_across()
    found = judged(plan, seen_by(faces_of(room(), but=[WEST]), rng), poses)
    assert [verdict_of(found, face) for face in (4, 5)] == [Verdict.MISSING] * 2
    assert wall_of(found, 4).through_share > 0.9
    assert verdict_of(found, WEST) is Verdict.NOT_SEEN
    assert verdict_of(found, EAST) is Verdict.AGREES
    # Both faces are one wall.
    (one,) = deviations(found)
    assert one.verdict is Verdict.MISSING
    assert {wall.face_idx for wall in one.walls} == {4, 5}


def test_glass_that_cameras_look_through_is_not_missing(rng):
    """The plan's file says of the outline of the partition that it is glass."""
    plan, poses = with_partition(room()), looking_across()
    told = PlanSource(
        file_from_plan=np.eye(3),
        element_lines=plan.ends,
        element_ids=tuple("abcdgg"),
        element_is_glass=np.arange(6) >= 4,
    )
    found = judged(replace(plan, source=told), seen_by(faces_of(room(), but=[WEST]), rng), poses)
    assert [verdict_of(found, face) for face in (4, 5)] == [Verdict.NOT_SEEN] * 2
    assert "glass" in in_words(wall_of(found, 4), Verdict.NOT_SEEN)
    assert "glass" not in in_words(wall_of(found, WEST), Verdict.NOT_SEEN)


def test_a_wall_that_nothing_was_seen_behind_is_not_missing(rng):
    """Cameras that see only the west of the room say nothing of the partition."""
    plan, poses = with_partition(room()), looking_across()
    found = judged(plan, seen_by([faces_of(room())[WEST]], rng), poses)
    assert verdict_of(found, 4) is Verdict.NOT_SEEN


@pytest.mark.parametrize(("lift_m", "is_missing"), [(0.0, True), (0.6, False)])
def test_lines_of_sight_count_at_some_heights(lift_m, is_missing, rng):
    """Between 1.0 and 1.9 m lines of sight pass; from cameras at 2.1 m, all pass where lintels are."""
    plan, poses = with_partition(room()), looking_across()
    poses[:, 2, 3] += lift_m
    patches = [
        (
            frame,
            np.column_stack([points[:, :2], np.clip(points[:, 2], 1.0, 2.0) + 2 * lift_m]),
            normal,
        )
        for frame, points, normal in seen_by(faces_of(room(), but=[WEST]), rng)
    ]
    found = judged(plan, patches, poses)
    assert (verdict_of(found, 4) is Verdict.MISSING) == is_missing


def test_few_frames_or_a_short_hole_make_no_wall_missing(rng):
    plan, poses = with_partition(room()), looking_across()
    patches = seen_by(faces_of(room(), but=[WEST]), rng)
    few = [patch for patch in patches if patch[0] < 2]
    assert verdict_of(judged(plan, few, poses), 4) is Verdict.NOT_SEEN
    # A door of 0.9 m in a partition of 3 m: what is seen lies behind the door.
    door = [(0, np.column_stack([np.full(60, 6.0), rng.uniform(0.6, 1.2, 60), np.full(60, 1.5)]))]
    behind = [(f, door[0][1], np.array([-1.0, 0.0])) for f in range(12)]
    near = np.stack([look([2.5, 0.9, 1.5], 0.0)] * 12)
    assert verdict_of(judged(plan, behind, near), 4) is Verdict.NOT_SEEN


def slow_through_share(points, eyes, ends):
    """Twin of `through_shares` for one face: a loop over frames and lines."""
    along, length = ends[1] - ends[0], np.linalg.norm(ends[1] - ends[0])
    along = along / length
    normal = np.array([-along[1], along[0]])
    n_bins = max(int((length - 0.2) / 0.1), 1)
    frames = np.zeros(n_bins, dtype=int)
    for eye, own in zip(eyes, points, strict=True):
        passed = set()
        for point in own:
            at_eye, at_end = (eye[:2] - ends[0]) @ normal, (point[:2] - ends[0]) @ normal
            if at_eye * at_end >= 0 or abs(at_end) <= BEYOND_M:
                continue
            crossing = eye + at_eye / (at_eye - at_end) * (point - eye)
            which = int(np.floor(((crossing[:2] - ends[0]) @ along - 0.1) / 0.1))
            if HEIGHTS_M[0] < crossing[2] < HEIGHTS_M[1] and 0 <= which < n_bins:
                passed.add(which)
        for which in passed:
            frames[which] += 1
    return np.mean(frames >= MIN_FRAMES)


def test_lines_of_sight_equal_their_slow_twin(rng):
    plan = with_partition(room())
    poses = np.stack(
        [look([*rng.uniform([0.5, 0.5], [5.5, 3.5]), 1.5], rng.uniform(0, 360)) for _ in range(8)]
    )
    patches = seen_by(faces_of(room()), rng, frames=range(8))
    structure = make_structure(poses, patches=[(f, p[:40], n) for f, p, n in patches])
    sight = lines_of_sight(structure, poses, np.zeros(8))
    points = [sight.points[a:b] for a, b in zip(sight.start[:-1], sight.start[1:], strict=True)]
    expected = [slow_through_share(points, sight.eyes, ends) for ends in plan.ends]
    np.testing.assert_allclose(through_shares(sight, plan, HEIGHTS_M, MIN_FRAMES), expected)


def test_a_wall_that_the_plan_lacks_is_new_with_its_place(rng):
    """Drawn: the room without its east wall."""
    whole = room()
    plan = replace(
        whole,
        ends=whole.ends[[0, 2, 3]],
        normals=whole.normals[[0, 2, 3]],
        is_oriented=whole.is_oriented[:3],
    )
    found = judged(plan, seen_by(faces_of(whole), rng))
    (new,) = [wall for wall in found.walls if wall.face_idx < 0]
    assert found.verdict(new) is Verdict.NEW
    assert new.normal @ whole.normals[EAST] == pytest.approx(1.0, abs=1e-6)
    assert new.length_m == pytest.approx(DEPTH, abs=0.3)
    assert new.ends[:, 0] == pytest.approx(WIDTH, abs=0.01)
    (one,) = deviations(found)
    assert one.walls == (new,)


def test_patches_in_line_are_one_new_wall_and_each_side_is_its_own(rng):
    """Seen in pieces with a gap of 0.3 m; the other side, from outside, by two patches only."""
    whole = room()
    plan = replace(
        whole,
        ends=whole.ends[[0, 2, 3]],
        normals=whole.normals[[0, 2, 3]],
        is_oriented=whole.is_oriented[:3],
    )
    pieces = [(0.0, 1.4), (1.7, 2.8), (2.9, 4.0)]
    inside = [(np.array([[WIDTH, a], [WIDTH, b]]), np.array([-1.0, 0.0])) for a, b in pieces]
    outside = [(np.array([[6.2, 4.0], [6.2, 2.0]]), np.array([1.0, 0.0]))]
    patches = seen_by(faces_of(plan), rng) + seen_by(inside, rng, frames=range(3))
    found = judged(plan, patches + seen_by(outside, rng, frames=range(2)))
    (new,) = [wall for wall in found.walls if wall.face_idx < 0]
    assert (new.n_patches, new.n_frames) == (9, 3)
    assert new.length_m == pytest.approx(4.0, abs=0.2)
    found = judged(plan, patches + seen_by(outside, rng, frames=range(3)))
    new = [wall for wall in found.walls if wall.face_idx < 0]
    assert [wall.length_m for wall in new] == pytest.approx([4.0, 2.0], abs=0.2)
    (one,) = deviations(found)  # both sides of one wall
    assert len(one.walls) == 2


def new_before_the_south_wall(rng, length_m, top_m, is_seen_over):
    """New walls found where something stands 0.6 m before the middle of the south wall, which is seen beside
    it; over it only as told."""
    plan, half = room(), length_m / 2
    ends = np.array([[3.0 - half, 0.6], [3.0 + half, 0.6]])
    seen = [*faces_of(plan, but=[SOUTH]), (np.array([[0.0, 0.0], [1.6, 0.0]]), plan.normals[SOUTH])]
    seen.append((np.array([[4.4, 0.0], [6.0, 0.0]]), plan.normals[SOUTH]))
    patches = seen_by(seen, rng)
    for frame in range(12):
        patches.append((frame, wall_points(ends, rng, top_m=top_m), np.array([0.0, 1.0])))
        if is_seen_over:
            behind = wall_points([[2.0, 0.0], [4.0, 0.0]], rng)
            behind[:, 2] = rng.uniform(2.3, 2.6, len(behind))
            patches.append((frame, behind, plan.normals[SOUTH]))
    return counted(judged(plan, patches).verdicts())[Verdict.NEW]


@pytest.mark.parametrize(
    ("length_m", "top_m", "is_seen_over", "n_new"),
    [
        (1.4, 2.0, False, 0),  # a cupboard
        (1.4, 2.5, False, 1),  # higher than cupboards
        (2.0, 2.0, False, 1),  # longer than cupboards, and nobody sees over it
        (2.0, 2.0, True, 0),  # a row of cupboards
    ],
)
def test_a_cupboard_is_no_new_wall(length_m, top_m, is_seen_over, n_new, rng):
    assert new_before_the_south_wall(rng, length_m, top_m, is_seen_over) == n_new


def test_a_moved_wall_with_a_door_is_no_row_of_cupboards(rng):
    """It stands behind where it is drawn, and cameras look through its door: found on a real scan."""
    plan = room()
    sides = [np.array([[0.0, -0.11], [2.4, -0.11]]), np.array([[3.6, -0.11], [6.0, -0.11]])]
    walls = [*faces_of(plan, but=[SOUTH]), *((side, plan.normals[SOUTH]) for side in sides)]
    patches = seen_by(walls, rng)
    beyond = wall_points([[2.5, -1.0], [3.5, -1.0]], rng)
    patches += [(frame, beyond, plan.normals[SOUTH]) for frame in range(12)]
    found = judged(plan, patches)
    assert wall_of(found, SOUTH).offset_m == pytest.approx(-0.11, abs=1e-6)


def test_the_edge_of_what_stands_elsewhere_is_no_wall_as_drawn(rng):
    """Single points scatter 3 cm about 0.1 m behind the wall that is drawn: some lie within 0.07 m of it."""
    plan, poses = room(), cameras()
    walls = seen_by(faces_of(plan, but=[SOUTH]), rng)
    structure = make_structure(poses, patches=walls)
    points = np.stack([wall_points(plan.ends[SOUTH], rng, count=100) for _ in poses])
    points[..., 1] += rng.normal(-0.1, 0.03, points.shape[:2])
    assert (np.abs(points[..., 1]) < 0.07).sum(axis=1).min() >= 8
    structure = replace(
        structure,
        unassigned_points_cam=se3.transform(se3.inverse(poses), points).reshape(-1, 3),
        unassigned_frame_idx=np.repeat(np.arange(12), 100),
    )
    assert verdict_of(judged(plan, walls, structure=structure), SOUTH) is Verdict.NOT_SEEN


def test_a_wall_behind_cupboards_stands_as_drawn(rng):
    """Half of what is seen near it is a row of cupboards as high as a wall; beside them it shows."""
    plan = room()
    row = np.array([[0.1, 0.5], [2.9, 0.5]])
    # The row hides the corner behind it.
    west = (np.array([[0.0, 4.0], [0.0, 0.6]]), plan.normals[WEST])
    seen = [*faces_of(plan, but=[SOUTH, WEST]), west, (row, plan.normals[SOUTH])]
    patches = seen_by(seen, rng)
    gap = (np.array([[3.0, 0.0], [5.9, 0.0]]), plan.normals[SOUTH])
    alone = judged(plan, patches)
    assert wall_of(alone, SOUTH).offset_m == pytest.approx(0.5, abs=1e-6)
    found = judged(plan, patches + seen_by([gap], rng))
    assert wall_of(found, SOUTH).offset_m == pytest.approx(0.0, abs=1e-6)
    # A gap of 2.1 m is less than the row.
    short = (np.array([[3.0, 0.0], [5.1, 0.0]]), plan.normals[SOUTH])
    patches += seen_by([short], rng)
    assert wall_of(judged(plan, patches), SOUTH).offset_m == pytest.approx(0.0, abs=1e-6)


def test_a_short_wall_is_told_by_points_that_are_on_no_patch(rng):
    """Half a metre of wall beside a door: no patch is of it."""
    whole = room()
    plan = replace(
        whole,
        ends=np.concatenate([whole.ends[:3], [[[0.0, 0.7], [0.0, 0.0]]]]),
    )
    walls = seen_by(faces_of(whole, but=[WEST]), rng)
    poses = cameras()
    structure = make_structure(poses, patches=walls)
    points, frames = [], []
    for frame in range(12):
        seen = wall_points(plan.ends[3], rng, count=40)
        points.append(se3.transform(se3.inverse(poses[frame]), seen))
        frames += [frame] * len(seen)
    structure = replace(
        structure,
        unassigned_points_cam=np.concatenate(points),
        unassigned_frame_idx=np.array(frames),
    )
    assert verdict_of(judged(plan, walls), 3) is Verdict.NOT_SEEN
    found = judged(plan, walls, structure=structure)
    assert verdict_of(found, 3) is Verdict.AGREES
    assert wall_of(found, 3).n_frames == 12


def test_sigma_has_what_the_poses_may_be_off(rng):
    """All cameras off by 3 cm along x (one sigma): east and west walls are, north and south are not."""
    covariances = np.zeros((12, 6, 6))
    covariances[:, 3, 3] = 0.03**2
    found = judged(room(), seen_by(faces_of(room()), rng), covariances=covariances)
    assert wall_of(found, EAST).sigma_m == pytest.approx(0.03, abs=0.003)
    assert wall_of(found, NORTH).sigma_m < 0.01


def test_sigma_follows_rotations_by_their_lever(rng):
    """Yaw off by 1 deg moves a wall that is seen ahead along itself, one at the side across."""
    covariances = np.zeros((1, 6, 6))
    covariances[0, 2, 2] = np.deg2rad(1.0) ** 2
    pose = look([3.0, 2.0, 1.5], 0.0)[None]
    ahead = np.array([[6.0, 1.5], [6.0, 2.5]])
    aside = np.array([[5.0, 4.0], [4.0, 4.0]])
    walls = seen_by([(ahead, [-1.0, 0.0]), (aside, [0.0, -1.0])], rng, frames=[0])
    structure = make_structure(pose, patches=walls)
    one = np.zeros(1, dtype=int)
    placed = place_walls(structure, room(), pose, covariances, one)
    sigma = placed.pose_sigma_m(placed.frame_idx, placed.ends.mean(axis=1), placed.normals)
    # 1 deg over the 1.5 m by which the wall at the side lies ahead.
    np.testing.assert_allclose(sigma, [0.0, np.deg2rad(1.0) * 1.5], atol=1e-3)


def test_poses_of_a_stretch_err_alike_and_stretches_by_themselves(rng):
    """Of 400 walks, frames of a stretch are off by one error along a wall's normal: the mean over all that
    show it is off as its sigma says, though stretches show it unevenly often."""
    pose_m, per_stretch = 0.02, (1, 2, 3)
    stretch = np.repeat([0, 1, 3], per_stretch)  # the third one does not see it
    covariances = np.zeros((len(stretch), 6, 6))
    covariances[:, 3, 3] = pose_m**2
    poses = np.stack([look([3.0, 2.0, 1.5], 0.0)] * len(stretch))
    east = (np.array([[6.0, 1.5], [6.0, 2.5]]), [-1.0, 0.0])
    structure = make_structure(poses, patches=seen_by([east], rng, frames=range(len(stretch))))
    placed = place_walls(structure, room(), poses, covariances, stretch)
    seen = (placed.frame_idx, placed.ends.mean(axis=1), placed.normals)
    sigma_m = placed.mean_pose_sigma_m(*seen)
    errors_m = pose_m * rng.normal(size=(4000, 4))[:, stretch].mean(axis=1)
    assert sigma_m == pytest.approx(np.sqrt(np.mean(errors_m**2)), rel=0.05)
    # One stretch alone gains nothing by more frames.
    own = placed.frame_idx >= 3
    alone = [each[own] for each in seen]
    assert placed.mean_pose_sigma_m(*alone) == pytest.approx(pose_m)


def test_offsets_err_as_their_sigmas_say(rng):
    """Scatter of 2 cm a frame: of 200 walls, all but few lie within 2 sigma, and sigma is no larger than it
    must be."""
    errors, sigmas = [], []
    for _ in range(200):
        offsets = 0.02 * rng.normal(size=9)
        errors.append(np.median(offsets))
        sigmas.append(offset_sigma(offsets, 0.0))
    z = np.array(errors) / np.array(sigmas)
    assert np.mean(np.abs(z) < 2) > 0.9
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.2


def test_a_verdict_near_the_tolerance_is_not_sure():
    wall = AsBuiltWall(
        0, np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([0.0, 1.0]), True, 0.06, 0.01, 3, 3, 0.0
    )
    found = AsBuilt((wall,), AsBuiltOptions(tolerance_m=0.05))
    assert not found.is_sure(wall)
    assert found.is_sure(wall, 0.03)


def test_short_faces_are_not_judged(rng):
    """A pier 0.4 m wide, 0.6 m deep."""
    plan = faces_plan([[0, 0], [0, 0.6], [0.4, 0.6], [0.4, 0]], "pier")
    lengths = [wall.length_m for wall in judged(plan, seen_by(faces_of(plan), rng)).walls]
    assert lengths == pytest.approx([0.6, 0.6])


def test_each_storey_is_judged_by_those_who_walked_it(rng):
    """Two storeys with the same room; the frames of the upper one see no south wall and a wall more."""
    one = room()
    plan = replace(
        one,
        ends=np.tile(one.ends, (2, 1, 1)),
        normals=np.tile(one.normals, (2, 1)),
        is_oriented=np.ones(8, dtype=bool),
        storeys=np.repeat([0, 1], 4),
    )
    poses = np.concatenate([cameras(6), cameras(6)])
    poses[6:, 2, 3] += 3.0
    upper = [
        *faces_of(one, but=[SOUTH]),
        (np.array([[1.0, 1.0], [4.0, 1.0]]), np.array([0.0, 1.0])),
    ]
    patches = seen_by(faces_of(one), rng, frames=range(6))
    for frame, points, normal in seen_by(upper, rng, frames=range(6, 12)):
        patches.append((frame, points + np.array([0.0, 0.0, 3.0]), normal))
    structure = replace(make_structure(poses, patches=patches), storeys=np.repeat([0, 1], 6))
    structure = replace(structure, floor_heights_m=np.repeat([0.0, 3.0], 6))
    found = judged(plan, patches, poses, structure=structure)
    assert [verdict_of(found, face) for face in range(8)] == [
        *[Verdict.AGREES] * 4,
        Verdict.NOT_SEEN,
        *[Verdict.AGREES] * 3,
    ]
    (new,) = [wall for wall in found.walls if wall.face_idx < 0]
    assert (new.n_frames, new.length_m) == (6, pytest.approx(3.0, abs=0.2))


def test_walls_have_the_names_and_the_height_of_the_plans_file(rng):
    """A model in millimetres: outlines of two elements, one of which goes round a corner."""
    plan = room()
    names = ("south and east", "south and east", "north", "elsewhere")
    lines = np.concatenate([plan.ends[[SOUTH, EAST, NORTH]], [[[0.5, 0.2], [0.5, 3.8]]]]) * 1000.0
    source = replace(
        plan.source,
        file_from_plan=np.diag([1000.0, 1000.0, 1.0]),
        element_lines=lines,
        element_ids=names,
        elevation_m=6.2,
    )
    found = judged(replace(plan, source=source), seen_by(faces_of(plan), rng))
    assert [wall.element_id for wall in found.walls] == [*names[:3], ""]
    assert found.elevation_m == 6.2
    np.testing.assert_allclose(found.in_file(found.walls[EAST].ends), lines[1])


def test_the_record_is_read_back(tmp_path, rng):
    plan = with_partition(room())
    plan = replace(plan, source=replace(plan.source, file_from_plan=np.diag([100.0, -100.0, 1.0])))
    found = judged(plan, seen_by(faces_of(room(), but=[WEST]), rng), looking_across())
    write_as_built(tmp_path / "as_built.json", found)
    again = read_as_built(tmp_path)
    assert again.verdicts() == found.verdicts()
    assert again.options == found.options
    np.testing.assert_array_equal(again.file_from_plan, found.file_from_plan)
    for one, other in zip(again.walls, found.walls, strict=True):
        np.testing.assert_array_equal(one.ends, other.ends)
        np.testing.assert_equal((one.offset_m, one.sigma_m), (other.offset_m, other.sigma_m))
        assert one.n_frames == other.n_frames


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"walls": 3}', '{"walls": [{}], "options": {}}'])
def test_a_damaged_record_is_told(text, tmp_path):
    (tmp_path / "as_built.json").write_text(text)
    with pytest.raises(ScanError, match=r"as_built\.json: expected the walls.*found a damaged"):
        read_as_built(tmp_path)


def test_a_folder_without_verdicts_is_told(tmp_path):
    with pytest.raises(ScanError, match="found nothing; give the output folder"):
        read_as_built(tmp_path)

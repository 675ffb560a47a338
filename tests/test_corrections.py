"""Corrections by hand: each kind does what it says, and mends what is wrong without it."""

from dataclasses import replace

import numpy as np
import pytest

import planfit
from builders import (
    faces_plan,
    look,
    make_matches,
    make_structure,
    make_world,
    position_rms_m,
    room_plan,
    room_scan,
)
from planfit.corrections import (
    AddedLoop,
    Corrections,
    DeletedLoop,
    ExcludedFrames,
    Place,
    WallByHand,
)
from planfit.errors import FloorplanError, OptionError
from planfit.findings import PlanKind, SurveyKind
from planfit.geometry import se3
from planfit.matching import Matches, RelativePoses
from planfit.matching.loop_closure import cycle_consistent
from planfit.pipeline.contradicted import ContradictedError
from planfit.pipeline.observations import Observations, extract_observations
from planfit.pipeline.options import RefineOptions
from planfit.runtime import Runtime
from planfit.scan.odometry import OdometryOptions, make_odometry
from planfit.scan.statistics import lift_pixel
from planfit.segmentation import Gravity
from planfit.tracking import Tracking

UPRIGHT = Gravity(np.array([0.0, 0.0, 1.0]), 1.0, "the test")
NO_MATCHES = Matches.from_arrays(
    np.zeros((0, 2), dtype=int), np.zeros((0, 3)), np.zeros((0, 3)), 0.05
)


def by_hand(*entries):
    return Corrections("hand.toml", tuple(entries))


def seen(structure, matches, poses):
    odometry = make_odometry(poses, OdometryOptions())
    return Observations(UPRIGHT, structure, matches, Tracking(poses, poses, odometry))


def floor_of(poses, rng, extent_m=3.0):
    """Floor points about each camera."""
    points = rng.uniform([-extent_m, -extent_m, 0], [extent_m, extent_m, 0], (len(poses), 30, 3))
    return [(i, poses[i, :3, 3] * (1, 1, 0) + p) for i, p in enumerate(points)]


# Places


def walk_in_a_room(n=14, last_deg=300.0):
    """Round the middle of a room of 6 x 4 m, all of it seen; not the same when turned by half."""
    angle = np.linspace(0, last_deg, n)
    return np.stack(
        [
            look([2.4 + np.cos(np.deg2rad(a)), 1.8 + 0.6 * np.sin(np.deg2rad(a)), 1.4], a + 30, 12)
            for a in angle
        ]
    )


@pytest.fixture(scope="module")
def room():
    """A walk, its scan, and what is seen of it: a rectangle, which lies on its plan in two ways."""
    true = walk_in_a_room()
    scan = room_scan(true)
    return true, scan, extract_observations(scan)


HALF_TURN = se3.make_transform(np.diag([-1.0, -1.0, 1.0]), np.array([6.0, 4.0, 0.0]))


def places_of(scan, plan_from_cams, spots):
    """Places at pixels of frames, and the points they show, plan frame."""
    points = [se3.transform(plan_from_cams[i], lift_pixel(scan, i, uv)[None])[0] for i, uv in spots]
    return [
        Place(k, (float(p[0]), float(p[1])), i, uv)
        for k, ((i, uv), p) in enumerate(zip(spots, points, strict=True), 1)
    ]


def test_places_decide_a_symmetric_room(room):
    """What was walked, and the same turned by half, fit alike: without a person one of them is got wrong."""
    true, scan, observations = room
    plan = room_plan()
    alone = planfit.refine(scan, plan, observations=observations)
    truths = (true, HALF_TURN @ true)
    assert max(position_rms_m(alone.plan_from_cams, truth) for truth in truths) > 1.0
    for truth in truths:
        places = places_of(scan, truth, [(2, (30.0, 40.0)), (6, (100.0, 60.0)), (11, (80.0, 50.0))])
        told = by_hand(*places)
        result = planfit.refine(scan, plan, observations=observations, corrections=told)
        assert position_rms_m(result.plan_from_cams, truth) < 0.08
        assert result.by_hand.sentence == "3 corrections by hand: 3 places"
        assert all(each.residual_m < 0.1 for each in result.by_hand.outcomes)
        assert result.by_hand.contradictions == ()


def test_places_are_taken_in_the_axes_of_the_scan_too(room):
    true, scan, observations = room
    spots = [(2, (30.0, 40.0)), (6, (100.0, 60.0)), (11, (80.0, 50.0))]
    truth, places = HALF_TURN @ true, []
    for (i, uv), place in zip(spots, places_of(scan, HALF_TURN @ true, spots), strict=True):
        world = se3.transform(scan.world_from_cams[i], lift_pixel(scan, i, uv)[None])[0]
        places.append(replace(place, frame=None, pixel=None, scan=tuple(map(float, world))))
    told = by_hand(*places)
    result = planfit.refine(scan, room_plan(), observations=observations, corrections=told)
    assert position_rms_m(result.plan_from_cams, truth) < 0.08


def test_places_that_disagree_are_named_and_left_out_on_request(room):
    true, scan, observations = room
    spots = [(1, (30.0, 40.0)), (4, (100.0, 60.0)), (8, (80.0, 50.0)), (11, (60.0, 40.0))]
    places = places_of(scan, true, spots)
    x, y = places[2].plan
    places[2] = replace(places[2], plan=(x - 2.5, y))
    told = by_hand(*places)
    plan = room_plan()
    with pytest.raises(
        ContradictedError, match=r"found 1 contradicted: place 3: .* m off where the other"
    ):
        planfit.refine(scan, plan, observations=observations, corrections=told)
    result = planfit.refine(
        scan, plan, observations=observations, corrections=told, without_contradicted=True
    )
    assert position_rms_m(result.plan_from_cams, true) < 0.08
    assert [each.correction.number for each in result.by_hand.left_out] == [3]
    assert result.by_hand.sentence == (
        "3 corrections by hand: 3 places; 1 contradicted and left out"
    )
    (left_out,) = (e for e in result.findings if e.kind is SurveyKind.CORRECTION_LEFT_OUT)
    assert left_out.facts["correction"].startswith("place 3")


def shifted(places, x, y):
    return [replace(p, plan=(p.plan[0] + x, p.plan[1] + y)) for p in places]


def test_places_that_agree_but_that_the_walls_contradict_are_named_and_left_out_on_request(rng):
    """Three pairs, each pressed at the same wrong corner: they move the scan rigidly, and agree."""
    corners = [[0, 0], [12, 0], [12, 4], [3, 4], [3, 3], [0, 3]]
    plan, true = faces_plan(corners), walk_in_a_room(10)
    patches = []
    for i in range(len(true)):
        for wall in range(6):
            first, last = plan.ends[wall]
            t = rng.uniform(0.0, 1.0, (60, 1))
            on_wall = np.column_stack([first * (1 - t) + last * t, rng.uniform(0.3, 2.5, 60)])
            patches.append((i, on_wall, plan.normals[wall]))
    observations = seen(make_structure(true, floor_of(true, rng, 1.0), patches), NO_MATCHES, true)
    scan = room_scan(true)
    spots = [(2, (30.0, 40.0)), (5, (100.0, 60.0)), (8, (80.0, 50.0))]
    places = places_of(scan, true, spots)
    right = planfit.refine(scan, plan, observations=observations, corrections=by_hand(*places))
    assert right.by_hand.contradictions == ()
    assert not any(each.kind is PlanKind.POINTS_AGAINST_WALLS for each in right.findings)
    # Within what corrections may be off, the walls decide, and nothing is contradicted.
    near = by_hand(*shifted(places, 0.4, 0.0))
    result = planfit.refine(scan, plan, observations=observations, corrections=near)
    assert position_rms_m(result.plan_from_cams, true) < 0.05
    assert result.by_hand.contradictions == ()
    wrong = by_hand(*shifted(places, 4.5, 0.0))
    moved = planfit.refine(scan, plan, observations=observations, corrections=wrong)
    assert position_rms_m(moved.plan_from_cams, true) > 2.0
    assert [each.correction.number for each in moved.by_hand.contradictions] == [1, 2, 3]
    reason = moved.by_hand.contradictions[0].reason
    assert reason.kind is PlanKind.PLACE_OFF_BY_WALLS
    assert reason.facts["off_m"] == pytest.approx(4.5, abs=0.06)
    assert not moved.verdict.is_refined
    assert any(each.kind is PlanKind.POINTS_AGAINST_WALLS for each in moved.findings)
    mended = planfit.refine(
        scan, plan, observations=observations, corrections=wrong, without_contradicted=True
    )
    assert position_rms_m(mended.plan_from_cams, true) < 0.05
    assert len(mended.by_hand.left_out) == 3
    # Of three that do not agree, the walls know which is wrong, though two others are there to choose from.
    one = [*places[:2], replace(places[2], plan=(places[2].plan[0] + 3.0, places[2].plan[1]))]
    with pytest.raises(
        ContradictedError, match=r"found 1 contradicted: place 3: .*m off where the walls put it"
    ):
        planfit.refine(scan, plan, observations=observations, corrections=by_hand(*one))
    flipped = [replace(p, plan=(p.plan[0], 4.0 - p.plan[1])) for p in places]
    with pytest.raises(ContradictedError, match="with left and right swapped they agree"):
        planfit.refine(scan, plan, observations=observations, corrections=by_hand(*flipped))
    large = [replace(p, plan=(2.0 * p.plan[0], 2.0 * p.plan[1])) for p in places]
    with pytest.raises(ContradictedError, match=r"with the plan 0\.5 times as large they agree"):
        planfit.refine(scan, plan, observations=observations, corrections=by_hand(*large))


# Loops


def straight_walk(n=40):
    return np.stack([look([0.3 * i, 0.0, 1.5], 90.0, 20.0) for i in range(n)])


def with_neighbours(poses, rng):
    """Matches of frames that follow each other."""
    points = rng.uniform([-1, 2, 0], [13, 4, 2.5], (200, 3))
    parts = []
    for i in range(len(poses) - 1):
        near = points[np.abs(points[:, 0] - poses[i, 0, 3]) < 2.0]
        parts.append(make_matches(poses, [(i, i + 1)], near))
    return parts


def joined(parts):
    pairs = np.concatenate([np.repeat(p.pairs, np.diff(p.start), axis=0) for p in parts])
    points = [
        np.concatenate([getattr(p, name) for p in parts]) for name in ("points_a", "points_b")
    ]
    return Matches.from_arrays(pairs, *points, 0.03)


def test_a_false_loop_bends_the_walk_until_it_is_deleted(rng):
    poses = straight_walk()
    # A corridor that looks the same a metre and a half further: the tracker alone contradicts it.
    shifted = poses.copy()
    shifted[30:, 0, 3] -= 1.5
    points = rng.uniform([-1, 2, 0], [13, 4, 2.5], (40, 3))
    false = [make_matches(shifted, [(i, i + 30)], points) for i in range(2, 9)]
    structure = make_structure(poses, floor_of(poses, rng))
    # Little but the tracker holds a step, as where nothing was matched on the way.
    observations = seen(structure, joined(false), poses)
    scan = room_scan(poses)
    bent = planfit.refine(scan, None, observations=observations)
    told = by_hand(DeletedLoop(1, (0, 10), (30, 39)))
    right = planfit.refine(scan, None, observations=observations, corrections=told)
    aligned = [
        planfit.evaluation.position_errors(r.plan_from_cams, poses).rms_m for r in (bent, right)
    ]
    assert aligned[0] > 0.2
    assert aligned[1] < 0.01
    assert len(right.matches.pairs) == 0
    assert right.by_hand.sentence == "1 correction by hand: 1 loop deleted"
    # A pair alone leaves the others.
    told = by_hand(DeletedLoop(1, (2, 2), (32, 32)))
    one = planfit.refine(scan, None, observations=observations, corrections=told)
    assert [2, 32] not in one.matches.pairs.tolist()
    assert len(one.matches.pairs) == 6


@pytest.fixture(scope="module")
def drifted_room():
    """A walk round a room recorded with a drift of half a metre, and what is seen of it but for loops."""
    rng = np.random.default_rng(3)
    true = walk_in_a_room(24, 375.0)  # the end sees what the begin saw
    scan = room_scan(true)
    bend = np.linspace(0, 1, len(true))
    recorded = (
        se3.make_transform(
            se3.exp_so3(np.stack([0 * bend, 0 * bend, 0.06 * bend], axis=1)),
            np.stack([0.5 * bend, -0.3 * bend, 0 * bend], axis=1),
        )
        @ true
    )
    scan = replace(scan, world_from_cams=recorded)
    structure = make_structure(true, floor_of(true, rng, 1.0))
    return true, scan, seen(structure, NO_MATCHES, recorded)


@pytest.fixture(scope="module")
def open_ended(drifted_room):
    """Without corrections."""
    _, scan, observations = drifted_room
    return planfit.refine(scan, None, observations=observations)


def end_error_m(result, true):
    """How far frame 22 ends from where it is, seen from frame 1."""
    got, was = (se3.inverse(p[1]) @ p[22] for p in (result.plan_from_cams, true))
    return float(np.linalg.norm(got[:3, 3] - was[:3, 3]))


def picked(scan, true, i, j, rng, count):
    """Pixels of points that frames i and j both see."""
    width, height, found = scan.cameras[i].width, scan.cameras[i].height, []
    for uv in rng.uniform([5, 5], [width - 6, height - 6], (400, 2)).round():
        point = se3.transform(se3.inverse(true[j]) @ true[i], lift_pixel(scan, i, tuple(uv))[None])
        if point[0, 2] < 0.1:
            continue
        other = scan.cameras[j].project(point)[0].round()
        if not np.all((other > 5) & (other < [width - 6, height - 6])):
            continue
        if np.linalg.norm(lift_pixel(scan, j, tuple(other)) - point[0]) < 0.05:
            found.append((tuple(map(float, uv)), tuple(map(float, other))))
        if len(found) == count:
            break
    assert len(found) == count
    return found


def test_points_picked_in_two_frames_close_a_loop(drifted_room, open_ended, rng):
    true, scan, observations = drifted_room
    assert end_error_m(open_ended, true) > 0.3
    # Their images are not asked, as of a scan without colour.
    blind = replace(scan, has_color=False)
    loops = [AddedLoop(k, (1, 22), uv) for k, uv in enumerate(picked(scan, true, 1, 22, rng, 3), 1)]
    result = planfit.refine(blind, None, observations=observations, corrections=by_hand(*loops))
    assert end_error_m(result, true) < 0.65 * end_error_m(open_ended, true)
    assert all(each.residual_m < 0.05 for each in result.by_hand.outcomes)
    assert result.by_hand.contradictions == ()


def test_a_pick_that_the_walk_contradicts_is_named_and_left_out_on_request(drifted_room, rng):
    """Nothing lets go of a loop by hand: the result ends on it, and its own residual says little."""
    true, scan, observations = drifted_room
    blind = replace(scan, has_color=False)
    right = picked(scan, true, 1, 22, rng, 1)[0]
    # A quarter round the room, where another wall is in view.
    told = by_hand(AddedLoop(1, (5, 12), (right[0], right[0])))
    result = planfit.refine(blind, None, observations=observations, corrections=told)
    (found,) = result.by_hand.contradictions
    assert found.reason.kind is SurveyKind.LOOP_BENDS_MOTION
    assert result.warnings[0].startswith("contradicted by hand or scan: add_loop 1")
    again = planfit.refine(
        blind, None, observations=observations, corrections=told, without_contradicted=True
    )
    assert len(again.by_hand.left_out) == 1
    assert position_rms_m(again.world_from_cams, true) < 0.7 * position_rms_m(
        result.world_from_cams, true
    )


def test_two_frames_that_are_said_to_see_the_same_are_matched(drifted_room, open_ended):
    true, scan, observations = drifted_room
    told = by_hand(AddedLoop(1, (1, 22)))
    result = planfit.refine(scan, None, observations=observations, corrections=told)
    assert end_error_m(result, true) < 0.5 * end_error_m(open_ended, true)
    assert result.by_hand.outcomes[0].residual_m < 0.03


def test_frames_that_are_no_keyframes_are_opened_for_a_loop(drifted_room):
    """Their matches are carried to the keyframes beside them, which stay those they were."""
    true, scan, observations = drifted_room
    keys = np.array([0, 3, 6, 9, 12, 15, 18, 21, 23])
    held = replace(observations, keyframe_idx=keys)
    open_ended = planfit.refine(scan, None, observations=held)
    told = by_hand(AddedLoop(1, (1, 22)))
    result = planfit.refine(scan, None, observations=held, corrections=told)
    assert result.solved_frame_idx.tolist() == keys.tolist()
    assert end_error_m(result, true) < 0.5 * end_error_m(open_ended, true)
    assert result.by_hand.outcomes[0].residual_m < 0.06


def test_images_that_do_not_match_are_said_so(drifted_room):
    _, scan, observations = drifted_room
    told = by_hand(AddedLoop(1, (0, 12)))
    with pytest.raises(
        ContradictedError, match="add_loop 1: frames 0 and 12 see the same: their images"
    ):
        planfit.refine(scan, None, observations=observations, corrections=told)
    result = planfit.refine(
        scan, None, observations=observations, corrections=told, without_contradicted=True
    )
    assert len(result.by_hand.left_out) == 1


def test_a_pick_that_its_images_contradict_is_named_and_used(drifted_room, rng):
    true, scan, observations = drifted_room
    (uv, _), (_, other) = picked(scan, true, 1, 22, rng, 2)
    told = by_hand(AddedLoop(1, (1, 22), (uv, other)))
    result = planfit.refine(scan, None, observations=observations, corrections=told)
    assert result.findings[0].kind is SurveyKind.CORRECTION_CONTRADICTED
    assert result.findings[0].parts[0].kind is SurveyKind.PICKED_POINTS_APART
    again = planfit.refine(
        scan, None, observations=observations, corrections=told, without_contradicted=True
    )
    assert len(again.by_hand.left_out) == 1
    assert len(again.by_hand.used) == 0


def test_loops_by_hand_that_contradict_each_other_are_named(drifted_room, rng):
    true, scan, observations = drifted_room
    blind = replace(scan, has_color=False)
    right = picked(scan, true, 1, 22, rng, 3)
    wrong = [(a, right[(k + 1) % 3][1]) for k, (a, _) in enumerate(right)]
    loops = [AddedLoop(k, (1, 22), uv) for k, uv in enumerate([*right, *wrong], 1)]
    result = planfit.refine(blind, None, observations=observations, corrections=by_hand(*loops))
    assert len(result.by_hand.contradictions) > 0
    (reason,) = result.findings[0].parts
    assert reason.kind is SurveyKind.CORRECTION_ENDS_OFF
    assert not reason.facts["is_place"]


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        (DeletedLoop(1, (0, 3), (20, 23)), "a delete_loop says the opposite"),
        (ExcludedFrames(1, ((22, 22),)), "one of the frames is excluded"),
    ],
)
def test_corrections_that_exclude_each_other_are_refused(drifted_room, entry, words):
    _, scan, observations = drifted_room
    told = by_hand(AddedLoop(1, (1, 22)), entry)
    with pytest.raises(ContradictedError, match=words):
        planfit.refine(scan, None, observations=observations, corrections=told)


def test_a_pixel_without_depth_is_refused(drifted_room):
    _, scan, observations = drifted_room
    holes = tuple((row, column) for row in range(40, 60) for column in range(40, 60))
    scan = room_scan(scan.world_from_cams, holes=holes)
    told = by_hand(AddedLoop(1, (1, 22), ((50.0, 50.0), (10.0, 10.0))))
    with pytest.raises(
        OptionError, match=r"hand\.toml: add_loop 1: frame 1: expected a pixel with depth"
    ):
        planfit.refine(scan, None, observations=observations, corrections=told)
    told = by_hand(Place(1, (1.0, 1.0), 2, (500.0, 10.0)))
    with pytest.raises(OptionError, match=r"place 1: frame 2: expected a pixel within 160 x 120"):
        planfit.refine(scan, room_plan(), observations=observations, corrections=told)


def test_other_loops_are_held_to_one_by_hand():
    """A tracker drifted by 1.7 m, within its sigmas: what agrees with it shows a look-alike."""
    true = straight_walk(60)
    recorded = true.copy()
    recorded[:, 0, 3] *= 1.1
    loose = OdometryOptions(sigma_base_m=0.05)
    odometry = make_odometry(recorded, loose)
    pairs = np.array([[1, 58], [2, 57], [3, 56]])

    def motions(poses):
        return se3.inverse(poses[pairs[:, 0]]) @ poses[pairs[:, 1]]

    seen = RelativePoses(pairs, motions(recorded), np.full(3, 40))
    assert cycle_consistent(seen, recorded, odometry).all()
    right = RelativePoses(pairs[1:2], motions(true)[1:2], np.full(1, 40))
    assert not cycle_consistent(seen, recorded, odometry, right).any()
    agreeing = replace(seen, a_from_b=motions(true))
    assert cycle_consistent(agreeing, recorded, odometry, right).all()


# Frames


def test_excluded_frames_take_no_part_and_stand_between_their_neighbours(rng):
    world = make_world(rng, n=12)
    true = world.plan_from_cams
    # One pose thrown off, and all that its frame says with it: it sees the walls a metre further.
    spoiled = true.copy()
    spoiled[5, 0, 3] += 1.0
    structure, floor = (
        world.structure,
        [(i, rng.uniform(0, 3, (9, 3)) * (1, 1, 0)) for i in range(12)],
    )
    assert structure.walls.frame_idx.tolist().count(5) == 2
    matches = make_matches(true, [(i, i + 1) for i in range(11)], rng.uniform(0, 3, (25, 3)))
    observations = seen(make_structure(true, floor), matches, spoiled)
    observations = replace(observations, structure=structure)
    scan = room_scan(true)
    scan = replace(scan, world_from_cams=spoiled)
    told = by_hand(ExcludedFrames(1, ((5, 6), (11, 11))))
    result = planfit.refine(scan, world.floorplan, observations=observations, corrections=told)
    assert not np.isin(result.matches.pairs, [5, 6, 11]).any()
    assert not np.isin(result.structure.walls.frame_idx, [5, 6, 11]).any()
    assert not np.isin(result.structure.floor.frame_idx, [5, 6, 11]).any()
    assert not np.isin([5, 6], result.solved_frame_idx).any()
    solved = result.plan_from_cams
    kept = [0, 1, 2, 3, 4, 7, 8, 9, 10]
    # The room looks the same from both ends: which of the two is taken is a matter of rounding.
    turned = se3.make_transform(np.diag([-1.0, -1.0, 1.0]), np.array([6.0, 4.0, 0.0]))
    assert min(position_rms_m(solved[kept], each[kept]) for each in (true, turned @ true)) < 0.02
    # By thirds of the way from frame 4 to frame 7, wherever they were recorded.
    step = se3.difference(solved[7], solved[4])
    for i, share in ((5, 1 / 3), (6, 2 / 3)):
        between = se3.retract(solved[4], share * step)
        np.testing.assert_allclose(solved[i], between, atol=0.02)
    # The last one goes with the one before it, as recorded.
    recorded = se3.inverse(spoiled[10]) @ spoiled[11]
    np.testing.assert_allclose(se3.inverse(solved[10]) @ solved[11], recorded, atol=0.02)


def test_excluded_frames_are_kept_out_of_matching(tmp_path):
    scan = room_scan(walk_in_a_room(12))
    runtime = Runtime(cache_dir=tmp_path)
    told = by_hand(ExcludedFrames(1, ((4, 5),)), DeletedLoop(1, (0, 1), (2, 3)))
    plain = extract_observations(scan, runtime=runtime)
    corrected = extract_observations(scan, runtime=runtime, corrections=told)
    assert np.isin(plain.matches.pairs, [4, 5]).any()
    assert not np.isin(corrected.matches.pairs, [4, 5]).any()
    assert not told.are_deleted(corrected.matches.pairs).any()
    others = [p for p in plain.matches.pairs.tolist() if not {4, 5} & set(p)]
    others = [p for p in others if not told.are_deleted(np.array([p]))[0]]
    assert others == corrected.matches.pairs.tolist()


# Walls


def l_shaped_world(rng):
    """A room of six walls, whose plan has one of them drawn 0.25 m off, so that it pulls."""
    corners = [[0, 0], [6, 0], [6, 4], [3, 4], [3, 3], [0, 3]]
    built = faces_plan(corners)
    true = walk_in_a_room(10)
    patches = []
    for i in range(len(true)):
        for wall in range(6):
            first, last = built.ends[wall]
            t = rng.uniform(0.2, 0.8, (60, 1))
            on_wall = np.column_stack([first * (1 - t) + last * t, rng.uniform(0.3, 2.5, 60)])
            patches.append((i, on_wall, built.normals[wall]))
    structure = make_structure(true, floor_of(true, rng, 1.0), patches)
    return true, built, structure


def test_a_wall_that_is_erased_drawn_or_excluded(rng):
    true, built, structure = l_shaped_world(rng)
    scan = room_scan(true)
    observations = seen(structure, NO_MATCHES, true)
    ends = tuple(tuple(map(float, end)) for end in built.ends[3])

    def refined(*entries):
        told = by_hand(*entries)
        return planfit.refine(scan, built, observations=observations, corrections=told)

    whole = planfit.refine(scan, built, observations=observations)
    assert np.isin(3, whole.adjustment.association.face_idx)
    out = refined(WallByHand("exclude_wall", 1, ends))
    # It is drawn, and holds nothing; what lies at it belongs to no other wall.
    assert len(out.floorplan) == 6
    assert not np.isin(3, out.adjustment.association.face_idx)
    assert np.sum(out.adjustment.association.face_idx < 0) >= 10
    erased = refined(WallByHand("erase_wall", 1, ends[::-1]))
    assert len(erased.floorplan) == 5
    assert not any(np.allclose(e, built.ends[3]) for e in erased.floorplan.ends)
    drawn = refined(WallByHand("draw_wall", 1, ((1.0, 3.5), (2.0, 3.5))))
    np.testing.assert_allclose(drawn.floorplan.ends[6], [[1.0, 3.5], [2.0, 3.5]])
    for result in (whole, out, erased, drawn):
        assert position_rms_m(result.plan_from_cams, true) < 0.03


def test_a_wall_drawn_wrongly_pulls_until_it_is_excluded(rng):
    true, built, structure = l_shaped_world(rng)
    moved = built.ends.copy()
    moved[3, :, 0] += 0.12  # a wall of the plan that was built elsewhere, within what is associated
    plan = replace(built, ends=moved)
    # All other walls that hold x are out of sight.
    structure = replace(
        structure,
        walls=structure.walls.of(np.tile(np.isin(np.arange(6), [0, 2, 3, 4]), len(true))),
    )
    observations = seen(structure, NO_MATCHES, true)
    options = RefineOptions().with_("align.start", "0,0,0")
    ends = tuple(tuple(map(float, end)) for end in moved[3])
    scan = room_scan(true)
    pulled = planfit.refine(scan, plan, options, observations=observations)
    told = by_hand(WallByHand("exclude_wall", 1, ends))
    assert abs(np.mean(pulled.plan_from_cams[:, 0, 3] - true[:, 0, 3])) > 0.1
    free = planfit.refine(scan, plan, options, observations=observations, corrections=told)
    assert not np.isin(3, free.adjustment.association.face_idx)


@pytest.mark.parametrize("kind", ["exclude_wall", "erase_wall"])
def test_a_wall_that_does_not_exist_is_refused(rng, kind):
    true, built, structure = l_shaped_world(rng)
    told = by_hand(WallByHand(kind, 1, ((0.5, 0.5), (2.0, 0.5))))
    with pytest.raises(FloorplanError, match=r"hand\.toml: expected a face from \[0\.5, 0\.5\]"):
        planfit.refine(
            room_scan(true), built, observations=seen(structure, NO_MATCHES, true), corrections=told
        )


def test_walls_and_places_need_one_plan(rng):
    true, _, structure = l_shaped_world(rng)
    told = by_hand(WallByHand("draw_wall", 1, ((0.0, 0.0), (2.0, 0.0))))
    with pytest.raises(OptionError, match="draw_wall 1: expected one plan, found none"):
        planfit.refine(
            room_scan(true), None, observations=seen(structure, NO_MATCHES, true), corrections=told
        )

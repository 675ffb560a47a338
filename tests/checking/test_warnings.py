"""Each finding is made by what it names, and by nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from builders import make_matches, make_structure, make_ties, make_world, room_scan
from planfit.adjust import MovedWall, PlanAdjustment, Solution, TornStep
from planfit.adjust.association import Association
from planfit.alignment import Alignment
from planfit.findings import Finding, PlanKind, ResultKind, ScanKind
from planfit.lsq.solver import Stop
from planfit.matching import SurfacePairs
from planfit.pipeline.diagnostics import MIN_NEAR_SHARE, alignment_findings, scan_findings
from planfit.pipeline.validation import Check
from planfit.segmentation import Gravity, no_level_points

LINES = Finding(PlanKind.SINGLE_LINES)
GRAVITY = Gravity(np.array([0, 0, 1.0]), 0.8, "the most common normal")


@pytest.fixture
def world(rng):
    return make_world(rng, n=24)


def found_of_scan(world, **changes):
    given = {
        "scan": room_scan(world.plan_from_cams),
        "gravity": GRAVITY,
        "structure": world.structure,
        "matches": world.matches,
        "neighbours": 4,
    }
    return scan_findings(**(given | changes))


def test_a_good_scan_gives_none(world):
    assert found_of_scan(world) == ()


def test_warnings_about_the_scan(world, rng):
    poses = world.plan_from_cams
    points = rng.normal(size=(20, 3))
    walls = replace(world.structure, floor=no_level_points(len(world.plan_from_cams)))
    cases = {
        ScanKind.FEW_FRAMES: {"scan": room_scan(poses[:5])},
        ScanKind.GRAVITY_UNSURE: {"gravity": replace(GRAVITY, confidence=0.01)},
        ScanKind.NO_FLOOR: {"structure": walls},
        ScanKind.NO_MATCHES: {"matches": make_matches(poses, [], points[:0])},
        ScanKind.NO_LOOPS: {"matches": make_matches(poses, [(0, 1), (3, 7)], points)},
    }
    for kind, change in cases.items():
        (found,) = found_of_scan(world, **change)
        assert found.kind is kind
    blind = found_of_scan(world, structure=make_structure(poses))
    assert [each.kind for each in blind] == [ScanKind.NO_FLOOR, ScanKind.NO_WALL]


def plan_adjustment(world, n_associated, converged=True):
    n = len(world.structure.walls)
    face_idx = np.where(np.arange(n) < n_associated, 0, -1)
    solution = Solution(world.plan_from_cams, Stop.COST, 3, {})
    correspondences = make_ties(
        world.floorplan, Association(face_idx, np.zeros(n)), len(world.plan_from_cams)
    )
    return PlanAdjustment(
        solution, correspondences, np.zeros(4), np.full(4, np.nan), 5, converged, 15
    )


def found_of_alignment(world, **changes):
    given = {
        "alignment": Alignment(np.eye(4), 0.9, None),
        "is_alignment_claimed": False,
        "plan_adjustment": plan_adjustment(world, len(world.structure.walls)),
        "structure": world.structure,
        "checks": (
            Check("held-out matches", 0.1, 0.05, "m", False),
            Check("wall points near the plan", 0.5, 0.9, "share", False),
        ),
        "is_place_sure": True,
        "has_rival": False,
    }
    return alignment_findings(**(given | changes))


def test_a_good_alignment_gives_none(world):
    assert found_of_alignment(world) == ()
    assert found_of_alignment(world, alignment=None, is_alignment_claimed=True) == ()
    assert found_of_alignment(world, checks=()) == ()


def test_warnings_about_the_alignment(world):
    few = Check("wall points near the plan", 0.1, MIN_NEAR_SHARE["masks"] - 0.01, "share", False)
    cases = {
        PlanKind.NOT_ALIGNED: {"alignment": None},
        PlanKind.SINGLE_LINES: {"alignment": Alignment(np.eye(4), 0.9, None, findings=(LINES,))},
        ResultKind.FEW_WALLS_NEAR_PLAN: {"checks": (few,)},
        ResultKind.ROUNDS_RAN_OUT: {
            "plan_adjustment": plan_adjustment(world, len(world.structure.walls), converged=False)
        },
    }
    for kind, change in cases.items():
        (found,) = found_of_alignment(world, **change)
        assert found.kind is kind


@pytest.mark.parametrize("has_rival", [False, True])
def test_walls_are_said_to_stand_elsewhere_where_the_scan_does_not_fit_there_as_well(
    world, has_rival
):
    good = plan_adjustment(world, len(world.structure.walls))
    moved = replace(good, moved_walls=(MovedWall(0, 0.5, 0.02, 9),))
    found = found_of_alignment(world, plan_adjustment=moved, has_rival=has_rival)
    assert [each.kind for each in found] == ([] if has_rival else [ResultKind.WALLS_MOVED])


def test_the_worst_torn_steps_are_named_and_the_others_counted(world):
    good = plan_adjustment(world, len(world.structure.walls))
    torn = tuple(TornStep((10 * k, 10 * k + 1), 0.49, 5.67, 5.2, 1.0, 250.0 - k) for k in range(5))
    named = found_of_alignment(world, plan_adjustment=replace(good, torn_steps=torn))
    assert len(named) == 4
    assert named[0].frames == ((0, 1),)
    assert (named[0].facts["recorded_m"], named[0].facts["solved_m"]) == (0.49, 5.67)
    assert named[3].kind is ResultKind.MORE_STEPS_CHANGED
    assert named[3].facts["step_count"] == 2
    (only,) = found_of_alignment(world, plan_adjustment=replace(good, torn_steps=torn[:1]))
    assert only == named[0]


def test_geometry_may_leave_more_wall_points_off_the_plan(world):
    few = Check("wall points near the plan", 0.1, 0.66, "share", False)
    by_geometry = replace(world.structure, back_end="geometry")
    assert found_of_alignment(world, checks=(few,), structure=by_geometry) == ()
    assert found_of_alignment(world, checks=(few,)) != ()


def test_a_bent_scan_is_told_of_until_the_walls_have_pulled(world):
    bent = Finding(PlanKind.SCAN_DEFORMED, {"deformation_m": 0.3, "extent_m": 20.0})
    alignment = Alignment(np.eye(4), 0.9, None, findings=(LINES, bent))
    assert found_of_alignment(world, alignment=alignment) == (LINES,)
    unsure = found_of_alignment(world, alignment=alignment, is_place_sure=False)
    assert unsure == (LINES, bent)


def test_a_scan_without_colour_is_told_how_it_was_matched(world):
    bare = replace(room_scan(world.plan_from_cams), has_color=False)
    none = world.matches.of_pairs(np.zeros(len(world.matches.pairs), dtype=bool))
    information = np.stack([np.eye(6), np.diag([1.0, 1, 1, 1, 1, 0])])
    two = SurfacePairs(
        np.array([[0, 1], [0, 9]]),
        np.tile(np.eye(4), (2, 1, 1)),
        information,
        np.ones(2),
        np.zeros((2, 6, 7)),
        np.ones(2),
    )
    (told,) = found_of_scan(world, scan=bare, matches=none, surfaces=two)
    assert told.parts[0].facts == {"pair_count": 2, "free_pair_count": 1}
    _, alone = found_of_scan(world, scan=bare, matches=none)
    assert alone.kind is ScanKind.NO_MATCHES
    assert "show the same surfaces" in alone.advice

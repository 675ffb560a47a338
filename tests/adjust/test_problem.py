"""Which terms are on: each way to adjust that an option chooses is the one that runs, and it works."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import CAMERA, make_world, nudged, position_rms_m
from planfit.adjust import (
    AdjustOptions,
    Measurements,
    adjust_to_plan,
    build_problem,
    close_loops,
    costs,
    paper_options,
)
from planfit.adjust.association import Association, AssociationOptions, associate_with_plan
from planfit.adjust.options import TermOptions
from planfit.adjust.paper.descent import DescentSchedule, DescentStop, PaperWeights
from planfit.adjust.terms import observation_models
from planfit.adjust.terms.between import OdometryTerm
from planfit.adjust.terms.observation_models import ODOMETRY, WALLS
from planfit.errors import OptionError, ScanError
from planfit.geometry import se3
from planfit.lsq.bounded import Allowance
from planfit.lsq.pose_terms import PosePriorTerm
from planfit.lsq.robust import Loss, LossKind
from planfit.lsq.solver import solve
from planfit.lsq.term import robust_cost
from planfit.runtime import map_rows


@pytest.fixture
def world(rng):
    return make_world(rng)


@pytest.fixture
def measurements(world):
    cameras = (CAMERA,) * len(world.plan_from_cams)
    return replace(world.measurements, cameras=cameras)


@pytest.fixture
def start(world, rng):
    return nudged(rng, world.plan_from_cams, 1.0, 0.05)


def name_of_geometry(solution):
    return set(solution.cost_by_term) & {"points", "reprojection", "rays"}


@pytest.mark.parametrize(
    ("geometric", "atol_m"), [("points", 0.01), ("reprojection", 0.01), ("rays", 0.03)]
)
def test_the_geometric_term_is_the_chosen_one(geometric, atol_m, world, measurements, start):
    options = AdjustOptions(geometric=geometric)
    plan_adjustment = adjust_to_plan(measurements, world.floorplan, start, options)
    assert name_of_geometry(plan_adjustment.solution) == {geometric}
    assert position_rms_m(plan_adjustment.solution.target_from_cams, world.plan_from_cams) < atol_m


@pytest.mark.parametrize("geometric", ["points", "reprojection", "rays"])
def test_loops_close_by_the_chosen_term_and_its_loss_narrows(geometric, measurements, start):
    options = AdjustOptions(geometric=geometric, gnc_schedule=(3.0,))
    closed = close_loops(measurements, start, options)
    assert name_of_geometry(closed) == {geometric}
    final = closed.target_from_cams
    with patch.dict(observation_models.ROBUST, {geometric: options.model(geometric).widened(3.0)}):
        expected = costs(measurements, final, options)[geometric]
    assert_allclose(closed.cost_by_term[geometric].after, expected, rtol=1e-9)


@pytest.mark.parametrize("strategy", ["fixed", "iterative", "nearest-point"])
def test_every_wall_strategy_brings_the_scan_onto_the_plan(strategy, world, measurements, start):
    moved = se3.yaw_transform(0.01, np.array([0.08, -0.06, 0.0])) @ start
    plan_adjustment = adjust_to_plan(
        measurements, world.floorplan, moved, AdjustOptions(wall_strategy=strategy)
    )
    assert position_rms_m(plan_adjustment.solution.target_from_cams, world.plan_from_cams) < 0.03


def test_nearest_point_holds_along_a_wall_and_the_others_do_not(world, measurements):
    # One wall with ends: only its ends, or nothing, hold the scan along it.
    first = replace(
        world.floorplan,
        ends=world.floorplan.ends[:1],
        normals=world.floorplan.normals[:1],
        is_oriented=world.floorplan.is_oriented[:1],
    )
    beyond = world.plan_from_cams.copy()
    beyond[:, 0, 3] += 3.0  # along the wall, half of it beyond its end
    found = {}
    for strategy in ("iterative", "nearest-point"):
        options = AdjustOptions(wall_strategy=strategy, wall_distances_m=(4.0,))
        squared = replace(WALLS, loss=Loss(LossKind.SQUARED))
        with patch.dict(observation_models.ROBUST, walls=squared):
            plan_adjustment = adjust_to_plan(measurements, first, beyond, options)
        found[strategy] = plan_adjustment.solution.target_from_cams[:, 0, 3].mean()
    assert found["nearest-point"] < found["iterative"] - 0.1


def test_geometry_never_pays_more_than_the_bound(world, measurements, start):
    wide = replace(world.floorplan, ends=world.floorplan.ends * 1.04)
    bound = Allowance()
    options = AdjustOptions(is_bounded=True)
    plan_adjustment = adjust_to_plan(measurements, wide, start, options)
    terms = [build_problem(measurements, options, start).geometric]
    least = robust_cost(terms, solve(terms, start, options.solver).target_from_cams)
    paid = robust_cost(terms, plan_adjustment.solution.target_from_cams)
    assert paid <= bound.error_factor**2 * least + bound.slack
    free = adjust_to_plan(measurements, wide, start, AdjustOptions())
    assert robust_cost(terms, free.solution.target_from_cams) > paid
    assert "barrier" in plan_adjustment.solution.cost_by_term


def test_terms_of_the_paper_are_means(world, measurements, start):
    options = paper_options(PaperWeights(10.0, 0.5))
    plan_adjustment = adjust_to_plan(
        measurements, world.floorplan, start, replace(options, max_alternations=1)
    )
    found = costs(measurements, start, options, plan_adjustment.correspondences)
    assert set(found) == {"points", "floor", "walls"}
    poses = start[world.structure.floor.frame_idx]
    points = world.structure.floor.points_cam
    height = np.einsum("ka,ka->k", poses[:, 2, :3], points) + poses[:, 2, 3]
    assert_allclose(found["floor"], 10.0 * np.abs(height).mean(), rtol=1e-4)


@pytest.mark.parametrize("strategy", ["iterative", "nearest-point"])
def test_the_papers_other_strategies_are_means_too(strategy, world, measurements):
    options = replace(paper_options(PaperWeights(10.0, 0.5)), wall_strategy=strategy)
    moved = world.plan_from_cams.copy()
    moved[:, 0, 3] += 0.05
    correspondences = adjust_to_plan(measurements, world.floorplan, moved, options).correspondences
    found = costs(measurements, moved, options, correspondences)["walls"]
    # Half of the wall points see a wall across x, and stand 5 cm off it; the others slide along.
    across = np.abs(world.structure.walls.normals_cam[:, None] @ np.eye(3)[None])  # any axes
    assert len(across) == len(world.structure.walls)
    assert_allclose(found, 0.5 * 0.05 * 0.5, rtol=0.1)


def test_paper_preset_has_no_prior_and_associates_from_both_sides():
    options = paper_options()
    assert options.odometry.weight == options.ceiling.weight == options.columns.weight == 0
    assert not options.association.oriented
    assert not options.loops_first
    assert options.model("walls").loss.kind is options.model("points").loss.kind is LossKind.NORM
    assert (options.floor.weight, options.walls.weight) == (10.0, 0.5)


def test_descent_runs_where_asked_for(world, measurements, start, monkeypatch):
    pytest.importorskip("torch", reason="PyTorch is not installed (pip install planfit[torch])")
    short = DescentSchedule(max_steps=400, tolerance=0.0)
    monkeypatch.setattr("planfit.adjust.problem.PAPER_SCHEDULE", short)
    options = replace(paper_options(), method="sgd", max_alternations=1)
    plan_adjustment = adjust_to_plan(measurements, world.floorplan, start, options)
    assert plan_adjustment.solution.stop is DescentStop.LIMIT
    assert plan_adjustment.solution.iterations == 400
    before, after = (
        sum(getattr(cost, when) for cost in plan_adjustment.solution.cost_by_term.values())
        for when in ("before", "after")
    )
    assert after < 0.6 * before


@pytest.mark.parametrize(
    "changes",
    [
        {"geometric": "rays"},
        {"wall_strategy": "iterative"},
        {"cost": "robust"},
        {"is_bounded": True},
        {"odometry": TermOptions()},
    ],
)
def test_descent_refuses_what_it_does_not_minimise(changes):
    with pytest.raises(OptionError, match="the paper's cost only"):
        replace(paper_options(), method="sgd", **changes)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("geometric", "lines"),
        ("wall_strategy", "nearest"),
        ("cost", "sum"),
        ("method", "adam"),
    ],
)
def test_unknown_choices_are_refused(name, value):
    with pytest.raises(OptionError, match=f"{name}: expected .* found '{value}'"):
        AdjustOptions(**{name: value})


def test_no_term_at_all_is_refused():
    nothing = TermOptions(0.0)
    with pytest.raises(OptionError, match="at least one term"):
        AdjustOptions(
            points=TermOptions(0.0),
            floor=nothing,
            ceiling=nothing,
            walls=TermOptions(0.0),
            columns=TermOptions(0.0),
            odometry=TermOptions(0.0),
            surfaces=TermOptions(0.0),
        )


def test_faces_may_be_taken_from_either_side(world, measurements):
    turned = replace(world.floorplan, normals=-world.floorplan.normals)
    for oriented, expected in ((True, 0), (False, len(world.structure.walls))):
        options = AdjustOptions(association=AssociationOptions(oriented=oriented))
        plan_adjustment = adjust_to_plan(measurements, turned, world.plan_from_cams, options)
        assert plan_adjustment.association.n_associated == expected


def test_offsets_come_with_their_sigmas(world, measurements):
    ends = world.floorplan.ends.copy()
    ends[2, :, 1] += 0.06  # drawn 6 cm off, away from the room
    drawn = replace(world.floorplan, ends=ends)
    options = AdjustOptions(wall_offset_sigma_m=0.05)
    plan_adjustment = adjust_to_plan(measurements, drawn, world.plan_from_cams, options)
    # Its normal looks into the room: the wall stands 6 cm further in than drawn; the scan gives a little.
    assert 0.02 < plan_adjustment.offsets_m[2] < 0.07
    assert np.all((plan_adjustment.offset_sigmas_m > 0) & (plan_adjustment.offset_sigmas_m < 0.05))
    without = adjust_to_plan(measurements, drawn, world.plan_from_cams, AdjustOptions())
    assert np.isnan(without.offset_sigmas_m).all()


@pytest.mark.parametrize("where", ["matches", "floor", "walls"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_points_that_are_not_finite_are_refused(where, bad, world):
    matches, structure = world.matches, world.structure
    if where == "matches":
        matches = replace(matches, points_b=np.where(np.arange(3) == 1, bad, matches.points_b))
    else:
        surface = getattr(structure, where)
        points = surface.points_cam.copy()
        points[3, 2] = bad
        structure = replace(structure, **{where: replace(surface, points_cam=points)})
    with pytest.raises(ScanError, match=r"found \d+ .* with NaN or infinity"):
        Measurements(matches, structure, world.odometry)


def associated(world, poses, max_distance_m=0.5):
    n = len(poses)
    association = AssociationOptions()
    nowhere = np.full(n, np.nan)
    return associate_with_plan(
        world.structure, world.floorplan, poses, max_distance_m, association, nowhere
    )


def held_at(poses, sigma=0.01, name="survey"):
    """A term of the user's: cameras are where they are said to be."""
    return PosePriorTerm(np.arange(len(poses)), poses, np.full(6, sigma), name)


def names(terms):
    return [term.name for term in terms]


def test_the_problem_tells_its_terms_by_role(world):
    poses = world.plan_from_cams
    loops = build_problem(world.measurements, AdjustOptions(), poses)
    assert names(loops.terms) == ["points", "floor", "odometry", "gauge"]
    assert loops.plan_terms == []
    on_plan = build_problem(world.measurements, AdjustOptions(), poses, associated(world, poses))
    assert names(on_plan.terms) == ["points", "floor", "odometry", "walls"]
    assert on_plan.gauge is on_plan.ceiling is on_plan.columns is None
    offsets = AdjustOptions(wall_offset_sigma_m=0.02)
    problem = build_problem(world.measurements, offsets, poses, associated(world, poses))
    assert names(problem.terms) == ["points", "floor", "odometry", "walls", "wall offsets"]
    assert len(problem.unknowns) == len(poses) + len(world.floorplan)
    assert set(problem.costs(poses)) == {"points", "floor", "odometry", "walls"}


@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_the_first_frame_is_held_where_no_term_holds_the_scan_to_the_plan(weight, world):
    # Columns that are associated but weigh nothing hold nothing.
    poses = world.plan_from_cams
    found = associated(world, poses)
    as_columns = replace(
        world.measurements, structure=replace(world.structure, columns=world.structure.walls)
    )
    found = replace(found, walls=Association(np.full(8, -1), np.full(8, np.nan)))
    found = replace(found, columns=associated(world, poses).walls)
    options = AdjustOptions(columns=TermOptions(weight))
    problem = build_problem(as_columns, options, poses, found)
    assert (problem.gauge is None) == (weight > 0)


def test_terms_of_the_user_are_solved_for_and_reported(world, measurements, start):
    # A survey says that the cameras stand 2 cm off in x; the walls say otherwise.
    moved = world.plan_from_cams.copy()
    moved[:, 0, 3] += 0.02
    survey = held_at(moved, sigma=1e-4)
    adjusted = adjust_to_plan(measurements, world.floorplan, start, AdjustOptions(), [survey])
    poses = adjusted.solution.target_from_cams
    assert position_rms_m(poses, moved) < 0.002
    assert "survey" in adjusted.solution.cost_by_term
    found = costs(measurements, poses, AdjustOptions(), adjusted.correspondences, [survey])
    assert found["survey"] == pytest.approx(adjusted.solution.cost_by_term["survey"].after)


def test_terms_of_the_user_may_hold_the_gauge_and_frames(world):
    poses = world.plan_from_cams
    far = replace(world.floorplan, ends=world.floorplan.ends + 100.0)
    nothing = AdjustOptions(odometry=TermOptions(0.0))
    without = adjust_to_plan(world.measurements, far, poses, nothing)
    assert "gauge" in without.solution.cost_by_term
    survey = held_at(poses)
    adjusted = adjust_to_plan(world.measurements, far, poses, nothing, [survey])
    assert "gauge" not in adjusted.solution.cost_by_term
    assert adjusted.weakly_constrained == ()
    # One that holds frames to each other alone leaves the scan as a whole free.
    steps = OdometryTerm(world.odometry, ODOMETRY, name="wheels")
    assert build_problem(world.measurements, nothing, poses, None, [steps]).gauge is not None


def test_terms_of_the_user_need_names_of_their_own_and_a_method_that_minimises_them(world):
    poses, survey = world.plan_from_cams, held_at(world.plan_from_cams)
    with pytest.raises(OptionError, match="found 'floor'"):
        build_problem(
            world.measurements, AdjustOptions(), poses, None, [held_at(poses, name="floor")]
        )
    options = replace(paper_options(), method="sgd")
    with pytest.raises(OptionError, match="use lm with extra terms"):
        build_problem(world.measurements, options, poses, None, [survey])


def test_float32_points_move_no_pose_by_a_micrometre(rng, monkeypatch):
    # As segmentation and matching keep them; in files, as of long scans, the bits are the same.
    world = make_world(rng, n=12, n_points=300)
    m, s = world.matches, world.structure
    noisy_a = m.points_a + 0.01 * rng.normal(size=m.points_a.shape)
    floor = s.floor.points_cam + 0.01 * rng.normal(size=s.floor.points_cam.shape)
    walls = s.walls.points_cam + 0.01 * rng.normal(size=s.walls.points_cam.shape)
    monkeypatch.setattr("planfit.runtime.mapped.MIN_BYTES", 0)

    def solved(keep):
        structure = replace(
            s,
            floor=replace(s.floor, points_cam=keep(floor)),
            walls=replace(s.walls, points_cam=keep(walls)),
        )
        matches = replace(m, points_a=keep(noisy_a), points_b=keep(m.points_b))
        measurements = replace(world.measurements, matches=matches, structure=structure)
        end = adjust_to_plan(measurements, world.floorplan, world.plan_from_cams, AdjustOptions())
        return end.solution.target_from_cams

    def as_float32(points):
        return points.astype(np.float32)

    def in_a_file(points):
        rows = as_float32(points)
        return map_rows([rows[:5], rows[5:]], rows.shape, rows.dtype)

    as_float64, rounded, mapped = (solved(keep) for keep in (np.asarray, as_float32, in_a_file))
    assert 0 < np.abs(rounded - as_float64).max() < 1e-6
    assert_array_equal(mapped, rounded)

"""What control points mend, and that check points only look on: `planfit.refine` where the truth is exact."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import planfit
from builders import faces_plan, look, make_matches, make_structure, make_world, room_plan
from planfit.errors import OptionError
from planfit.findings import PlanKind, SurveyKind
from planfit.geometry import se3
from planfit.survey import Survey, SurveyPoint
from surveyed import errors_m, observed, scan_at, survey_of

N = 31
LENGTH_M = 30.0


@pytest.fixture(scope="module")
def corridor():
    """A walk along a corridor whose ends are not seen, with 4 % of it lost by the tracker; no place is seen
    again and no wall runs across. Gives plan, true poses, scan, observations."""
    rng = np.random.default_rng(7)
    plan = faces_plan([[-20, 0], [LENGTH_M + 20, 0], [LENGTH_M + 20, 2.4], [-20, 2.4]], "corridor")
    x = np.linspace(0.0, LENGTH_M, N)
    truth = np.stack([look([a, 1.2 + 0.2 * np.sin(a), 1.5], 4 * np.sin(a), 12) for a in x])
    floor, patches = [], []
    for k, a in enumerate(x):
        floor.append((k, rng.uniform([a, 0.2, 0], [a + 3, 2.2, 0], (60, 3))))
        for wall, y in ((0, 0.0), (2, 2.4)):
            on = np.column_stack(
                [rng.uniform(a + 0.5, a + 3, 60), np.full(60, y), rng.uniform(0.3, 2.2, 60)]
            )
            patches.append((k, on, plan.normals[wall]))
    recorded = truth.copy()
    recorded[:, 0, 3] *= 0.96
    # Matches that see nothing along the corridor: points on one line across it tell of yaw and height alone.
    none = make_matches(truth, [], np.zeros((1, 3)))
    return plan, truth, scan_at(recorded), observed(make_structure(truth, floor, patches), none)


# One start and few folds: what control points do is the same from each, and the tests stay short.
QUICK = planfit.RefineOptions().with_("adjust.starts", ["aligned"])


def refined(world, survey=None, plan=True, options=QUICK):
    floorplan, _, scan, seen = world
    plans = floorplan if plan else None
    return planfit.refine(scan, plans, options, observations=seen, survey=survey)


@pytest.fixture(scope="module")
def by_walls(corridor):
    return refined(corridor)


@pytest.fixture(scope="module")
def by_control(corridor):
    survey = survey_of(corridor[1][:, :3, 3], range(0, N, 6), range(3, N, 6))
    return refined(corridor, survey)


def test_drift_that_no_loop_closes_is_taken_out(corridor, by_walls, by_control):
    """By walls alone the walk stays too short, and may lie anywhere along the corridor."""
    truth = corridor[1]
    assert np.ptp(errors_m(by_walls, truth)[:, 0]) > 0.03 * LENGTH_M
    assert np.abs(errors_m(by_control, truth)).max() < 0.005
    assert by_control.survey.control.rms_m < 0.02
    assert not any("ambiguous" in words for words in by_control.warnings)


def test_without_a_survey_nothing_is_left_out(by_walls, by_control):
    assert by_walls.evidence.left_out == ()
    assert len(by_control.evidence.left_out) == len(range(0, N, 6))


def test_points_seen_between_keyframes_count_as_well(corridor):
    """Frames that are not solved for show all control points: the keyframes about them carry these."""
    plan, truth, scan, seen = corridor
    keys = np.arange(0, N, 5)
    marked = [k for k in range(2, N, 5)] + [N - 2]
    sparse = replace(seen, keyframe_idx=np.union1d(keys, [N - 1]))
    survey = survey_of(truth[:, :3, 3], marked, keys)
    result = refined((plan, truth, scan, sparse), survey)
    assert result.survey.control.count == len(marked)
    assert not set(marked) & set(result.solved_frame_idx.tolist())
    # Marks are carried over two metres by a tracker that loses 4 % of these.
    assert np.abs(errors_m(result, truth)).max() < 0.1
    assert result.survey.check.rms_m < 0.04 * 2.0 + 0.005


def test_residuals_of_check_points_are_the_true_error(corridor, by_control):
    true_errors = errors_m(by_control, corridor[1])
    checks = [point for point in by_control.survey.points if point.is_check]
    assert [point.id for point in checks] == [f"K{k}" for k in range(3, N, 6)]
    for point in checks:
        assert_allclose(point.residual_m, true_errors[int(point.id[1:])], atol=1e-9)
    lengths = np.linalg.norm(true_errors[3::6], axis=1)
    told = by_control.survey.check
    assert told.rms_m == pytest.approx(np.sqrt(np.mean(lengths**2)))
    assert told.worst_m == pytest.approx(lengths.max())
    assert told.worst_id == f"K{3 + 6 * int(np.argmax(lengths))}"


def test_check_points_have_no_influence(corridor, by_walls, by_control):
    centres = corridor[1][:, :3, 3]
    without = refined(corridor, survey_of(centres, range(0, N, 6)))
    assert_array_equal(without.plan_from_cams, by_control.plan_from_cams)
    assert without.survey.check is None
    wrong = centres + np.array([3.0, 0.5, 0.2])
    only_checked = refined(corridor, survey_of(wrong, [], range(3, N, 6)))
    assert_array_equal(only_checked.plan_from_cams, by_walls.plan_from_cams)
    assert any(each.kind is SurveyKind.CHECK_POINTS_OFF for each in only_checked.findings)


def test_a_point_written_wrongly_is_named_and_does_not_bend_the_rest(corridor, by_control):
    survey = survey_of(corridor[1][:, :3, 3], range(0, N, 6), range(3, N, 6))
    wrong = list(survey.points)
    wrong[2] = replace(wrong[2], xyz=wrong[2].xyz + np.array([0.0, 5.0, 0.0]))
    result = refined(corridor, replace(survey, points=tuple(wrong)))
    assert result.survey.check.rms_m < by_control.survey.check.rms_m + 0.005
    assert any("control point 'C12'" in warning for warning in result.warnings)


def test_millions_of_metres_lose_nothing(corridor, by_control):
    """In the file's own axes, far from its origin, heights of their own datum: the same to a micrometre."""
    plan, truth, scan, seen = corridor
    moved = np.array([5_000_000.0, -2_500_000.0, 312.4])
    file_from_plan = np.eye(3)
    file_from_plan[:2, 2] = moved[:2]
    far = replace(plan, source=replace(plan.source, file_from_plan=file_from_plan))
    survey = survey_of(truth[:, :3, 3], range(0, N, 6), range(3, N, 6), axes="file", moved=moved)
    result = refined((far, truth, scan, seen), survey)
    assert result.survey.height_datum_m == pytest.approx(312.4, abs=0.01)
    assert_allclose(errors_m(result, truth)[:, :2], errors_m(by_control, truth)[:, :2], atol=1e-4)
    again = survey_of(
        truth[:, :3, 3], range(0, N, 6), range(3, N, 6), axes="file", moved=[0, 0, 312.4]
    )
    near = replace(plan, source=replace(plan.source, file_from_plan=np.eye(3)))
    by_near = refined((near, truth, scan, seen), again)
    assert_allclose(result.plan_from_cams, by_near.plan_from_cams, atol=1e-6)


def test_a_site_of_its_own_without_a_plan():
    """Points along an arc place the walk in the site's axes and take its drift out, near and far alike."""
    truth, world = arc_walk()
    turn = se3.exp_so3(np.array([0.0, 0.0, 0.7]))
    results = []
    for origin in ([2.6e6, 1.2e6, 431.0], [0.0, 0.0, 0.0]):
        centres = se3.transform(se3.make_transform(turn, np.array(origin)), truth[:, :3, 3])
        survey = survey_of(centres, range(0, N, 5), range(2, N, 5), axes="site")
        result = refined(world, survey, plan=False)
        found = result.survey
        at_site = found.site_from_plan @ np.append(result.plan_from_cams[18, :3, 3], 1.0)
        assert_allclose(at_site[:3] + found.site_origin, centres[18], atol=0.03)
        assert found.check.rms_m < 0.05
        results.append(result)
    assert_allclose(results[0].plan_from_cams, results[1].plan_from_cams, atol=1e-6)


def arc_walk():
    """A walk along an arc without a plan, 4 % of it lost by the tracker; its points stand on no line."""
    rng = np.random.default_rng(3)
    x = np.linspace(0.0, LENGTH_M, N)
    y = 8.0 * np.sin(np.pi * x / LENGTH_M)
    truth = np.stack([look([a, b, 1.5], 4 * np.sin(a), 12) for a, b in zip(x, y, strict=True)])
    recorded = truth.copy()
    recorded[:, 0, 3] *= 0.96
    floor = [
        (k, np.column_stack([rng.uniform(-2, 2, (60, 2)) + truth[k, :2, 3], np.zeros(60)]))
        for k in range(N)
    ]
    on_wall = np.column_stack([rng.uniform(0, 1, (60, 2)), rng.uniform(0.3, 2, 60)])
    structure = make_structure(truth, floor, [(0, on_wall, [0.0, 1.0])])
    none = make_matches(truth, [], np.zeros((1, 3)))
    return truth, (None, truth, scan_at(recorded), observed(structure, none))


@pytest.fixture(scope="module")
def twin_ends():
    """A room that looks the same when turned about: nothing but points tells its ends apart."""
    rng = np.random.default_rng(5)
    world = make_world(rng, n=12)
    return room_plan(), world


def in_turned_axes(world, plan, yaw_deg):
    """The scan as recorded in axes of its own, turned by a yaw."""
    own = se3.make_transform(
        se3.exp_so3(np.array([0, 0, np.deg2rad(yaw_deg)])), np.array([4.0, -3, 0])
    )
    scan = scan_at(own @ world.plan_from_cams)
    return plan, world.plan_from_cams, scan, observed(world.structure, world.matches)


@pytest.fixture(scope="module")
def placed(twin_ends):
    """The room recorded at a yaw, with control points of some frames: refined once for all tests."""
    plan, world = twin_ends

    @functools.cache
    def at(yaw_deg, *frames):
        survey = survey_of(world.plan_from_cams[:, :3, 3], frames, [2, 7])
        return refined(in_turned_axes(world, plan, yaw_deg), survey)

    return at


@pytest.mark.parametrize("method", ["three", "two"])
def test_a_room_that_fits_twice_is_placed_by_points(twin_ends, placed, method):
    frames = {"three": [0, 4, 8], "two": [1, 5]}[method]
    for yaw in (10.0, 190.0):
        result = placed(yaw, *frames)
        assert np.abs(errors_m(result, twin_ends[1].plan_from_cams)).max() < 0.01
        assert result.survey.check.worst_m < 0.01
        assert not any("place on the plan" in reason for reason in result.verdict.reasons)
        is_said = any(each.kind is SurveyKind.FEW_POINTS_SEEN for each in result.findings)
        assert is_said == (method == "two")


def test_points_of_another_datum_are_doubted_where_walls_clearly_fit_elsewhere(twin_ends, placed):
    """All shifted alike they agree with the scan, and lie on the plan: walls alone tell."""
    plan, world = twin_ends
    given = in_turned_axes(world, plan, 10.0)
    survey = survey_of(world.plan_from_cams[:, :3, 3], [0, 4, 8], [2, 7])
    shifted = [replace(point, xyz=point.xyz + np.array([0.8, 0.0, 0.0])) for point in survey.points]
    result = refined(given, replace(survey, points=tuple(shifted)))
    (found,) = (e for e in result.findings if e.kind is PlanKind.POINTS_AGAINST_WALLS)
    warning = found.sentence
    assert "C0 (" in warning
    assert any("place on the plan" in reason for reason in result.verdict.reasons)
    right = placed(10.0, 0, 4, 8)
    assert not any(each.kind is PlanKind.POINTS_AGAINST_WALLS for each in right.findings)


def test_without_points_the_walls_take_the_wrong_one_of_two_ways(twin_ends):
    plan, world = twin_ends
    scans = [in_turned_axes(world, plan, yaw) for yaw in (10.0, 190.0)]
    assert any(np.abs(errors_m(refined(given), given[1])).max() > 1.0 for given in scans)


def test_a_scan_that_sees_no_wall_is_placed_by_three_points(twin_ends):
    plan, world = twin_ends
    floor = [
        (k, np.random.default_rng(k).uniform([1, 1, 0], [5, 3, 0], (60, 3))) for k in range(12)
    ]
    given = in_turned_axes(
        replace(world, structure=make_structure(world.plan_from_cams, floor, one_patch(world))),
        plan,
        30,
    )
    survey = survey_of(world.plan_from_cams[:, :3, 3], [0, 4, 8], [2])
    result = refined(given, survey)
    assert np.abs(errors_m(result, given[1])).max() < 0.02


def one_patch(world):
    """make_structure wants some wall: one patch of a wall that the plan does not show."""
    points = np.column_stack([np.linspace(2, 3, 60), np.full(60, 2.0), np.linspace(0.3, 2, 60)])
    return [(0, points, np.array([0.0, 1.0]))]


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda p: p * 1000.0, "multiply them by 0.001"),
        (lambda p: p + np.array([100, 0, 0]), "check their axes, unit"),
        (lambda p: p * [1, -1, 1] + np.array([0, 4, 0]), "left-handed"),
        (lambda p: p + np.array([0, 0, 250.0]), "heights above the floor"),
    ],
    ids=["millimetres", "elsewhere", "left-handed", "datum"],
)
def test_points_that_cannot_be_right_are_refused(twin_ends, spoil, words):
    plan, world = twin_ends
    survey = survey_of(world.plan_from_cams[:, :3, 3], range(0, 12, 2))
    spoilt = [replace(p, xyz=np.asarray(spoil(p.xyz), dtype=float)) for p in survey.points]
    with pytest.raises(OptionError, match=words) as found:
        refined(in_turned_axes(world, plan, 10.0), replace(survey, points=tuple(spoilt)))
    assert "\n" not in str(found.value)


def test_too_few_points_or_a_line_without_a_plan(twin_ends):
    plan, world = twin_ends
    given = in_turned_axes(world, plan, 10.0)
    centres = world.plan_from_cams[:, :3, 3]
    with pytest.raises(OptionError, match="expected three control points or more"):
        refined(given, survey_of(centres, [0, 4], axes="site"), plan=False)
    in_line = np.column_stack([centres[:, 0], 0.5 * centres[:, 0], centres[:, 2]])
    with pytest.raises(OptionError, match="do not stand on one line, found C0, C2, C4, C6 on one"):
        refined(given, survey_of(in_line, [0, 2, 4, 6], axes="site"), plan=False)
    with pytest.raises(OptionError, match="without a plan points are in axes of their own"):
        refined(given, survey_of(centres, [0, 4, 8]), plan=False)
    with pytest.raises(OptionError, match="nothing tells where on it the site's axes lie"):
        refined(given, survey_of(centres, [0, 4, 8], axes="site"))


def test_the_papers_preset_takes_no_control_points(twin_ends):
    plan, world = twin_ends
    given = in_turned_axes(world, plan, 10.0)
    survey = survey_of(world.plan_from_cams[:, :3, 3], [0, 4, 8])
    options = QUICK.with_("adjust.control.weight", 0.0)
    with pytest.raises(OptionError, match=r"adjust\.control\.weight: expected a weight above 0"):
        refined(given, survey, options=options)


def test_plans_by_storey_are_refused_for_now(twin_ends):
    plan, world = twin_ends
    given = in_turned_axes(world, plan, 10.0)
    survey = survey_of(world.plan_from_cams[:, :3, 3], [0, 4, 8])
    with pytest.raises(OptionError, match="expected one plan, found plans by storey"):
        refined(({0: plan, 1: plan}, *given[1:]), survey)


def test_a_survey_knows_its_own_contradictions():
    point = SurveyPoint("A", np.zeros(3))
    with pytest.raises(OptionError, match="expected each point once, found 'A' twice"):
        Survey((point, replace(point, is_check=True)))
    with pytest.raises(OptionError, match="expected points, found none"):
        Survey(())

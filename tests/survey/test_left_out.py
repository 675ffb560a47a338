"""Control points left out one by one: the prediction from the normal equations against solves that do without
each, and who is named."""

import csv
from dataclasses import replace
from html import escape

import numpy as np
import pytest
from numpy.testing import assert_allclose

import planfit
from builders import make_world
from planfit.adjust import left_out
from planfit.adjust.terms import observation_models
from planfit.export.tables import survey_record, write_survey
from planfit.findings import SurveyKind
from planfit.lsq.robust import SQUARES
from planfit.report.html.evidence_sections import disagreement_section, survey_section
from surveyed import observed, scan_at, survey_of

QUICK = planfit.RefineOptions().with_("adjust.starts", ["aligned"])
N = 12
POINTS = range(0, N, 2)


@pytest.fixture(scope="module")
def walk():
    """Round a room, cameras that stood at six points; recorded 3 cm off. Plan, scan, observations, and the
    survey, whose points err by 4 mm."""
    rng = np.random.default_rng(3)
    world = make_world(rng, n=N)
    recorded = world.plan_from_cams.copy()
    recorded[:, :3, 3] += 0.03 * rng.normal(size=(N, 3))
    centres = world.plan_from_cams[:, :3, 3] + 0.004 * rng.normal(size=(N, 3))
    seen = observed(world.structure, world.matches)
    return world.floorplan, scan_at(recorded), seen, survey_of(centres, POINTS)


_results = {}
"""Of refinements of the walk, by what they were given: several tests look at the same one."""


def refined(walk, survey, with_plan=True):
    plan, scan, seen, _ = walk
    points = [(p.id, p.xyz.tobytes(), p.sigma_m, p.is_check) for p in survey.points]
    given = id(scan), tuple(points), survey.marks, survey.axes, with_plan
    if given not in _results:
        of_plan = plan if with_plan else None
        result = planfit.refine(scan, of_plan, QUICK, observations=seen, survey=survey)
        _results[given] = walk, result  # the walk as well: its id is for no other while it lives
    return _results[given][1]


def with_point(survey, k, **changes):
    points = list(survey.points)
    points[k] = replace(points[k], **changes)
    return replace(survey, points=tuple(points))


def by_a_solve(walk, survey, k, with_plan=True):
    """The residual of a point where a whole refinement does without it: as a check point."""
    result = refined(walk, with_point(survey, k, is_check=True), with_plan)
    return result.survey.points[k].residual_m


def moved(survey, k, by_m):
    return with_point(survey, k, xyz=survey.points[k].xyz + np.array(by_m))


@pytest.mark.parametrize("wrong_by_m", [(0.0, 0.0, 0.0), (0.06, 0.0, 0.0), (0.0, 0.2, 0.1)])
def test_each_residual_is_that_of_a_solve_without_the_point(walk, wrong_by_m):
    survey = moved(walk[3], 2, wrong_by_m)
    points = refined(walk, survey).survey.points
    for k, point in enumerate(points):
        assert_allclose(point.left_out_m, by_a_solve(walk, survey, k), atol=0.002)
        assert point.left_out_length_m > point.length_m  # the fit is always nearer


def test_right_points_contradict_nothing_and_err_as_their_sigmas_say(walk):
    result = refined(walk, walk[3])
    told = result.survey.points
    assert not any(point.is_contradicted for point in told)
    # Of three coordinates: the root of 3 on average.
    assert 0.5 < np.sqrt(np.mean([point.left_out_sigmas**2 for point in told]) / 3) < 1.5
    assert result.survey.left_out.rms_m > result.survey.control.rms_m
    assert not any("control point" in words for words in result.warnings)


@pytest.mark.parametrize("by_m", [(0.06, 0.0, 0.0), (0.0, 0.1, 0.0), (0.2, -0.2, 0.05)])
def test_one_wrong_point_is_named_alone(walk, by_m):
    result = refined(walk, moved(walk[3], 2, by_m))
    assert [p.id for p in result.survey.points if p.is_contradicted] == ["C4"]
    (words,) = [words for words in result.warnings if "control point" in words]
    assert "'C4' contradicts the other evidence" in words
    assert result.survey.points[2].left_out_length_m == pytest.approx(
        np.linalg.norm(by_m), abs=0.02
    )


def test_two_wrong_points_are_both_named(walk):
    survey = moved(moved(walk[3], 1, (0.12, 0.0, 0.0)), 4, (0.0, -0.1, 0.0))
    named = [p.id for p in refined(walk, survey).survey.points if p.is_contradicted]
    assert sorted(named) == ["C2", "C8"]


def test_points_drawn_along_are_not_named(walk, monkeypatch):
    """With a squared loss, and no plan, a wrong point draws all others to itself: residuals of the fit are
    large all over, and of single points left out those beside it are, too."""
    squared = replace(observation_models.CONTROL, loss=SQUARES)
    monkeypatch.setitem(observation_models.ROBUST, "control", squared)
    _, scan, seen, survey = walk
    survey = replace(moved(survey, 2, (0.3, 0.0, 0.0)), axes="site")
    monkeypatch.setattr(left_out, "CONTRADICTED_SIGMAS", 4.0)
    result = planfit.refine(scan, None, QUICK, observations=seen, survey=survey)
    points = result.survey.points
    assert sum(p.left_out_sigmas > left_out.CONTRADICTED_SIGMAS for p in points) > 1
    assert [p.id for p in points if p.is_contradicted] == ["C4"]


@pytest.mark.parametrize("apart", [(0, 2), (1, 4)])
def test_swapped_ids_are_named_as_such(walk, apart):
    """Metres apart: neither is used, and both are told."""
    i, j = apart
    survey, points = walk[3], walk[3].points
    survey = with_point(survey, i, xyz=points[j].xyz)
    survey = with_point(survey, j, xyz=points[i].xyz)
    result = refined(walk, survey)
    told = {p.id: p.swapped_with for p in result.survey.points if p.swapped_with}
    assert told == {points[i].id: points[j].id, points[j].id: points[i].id}
    assert sum(each.kind is SurveyKind.POINTS_SWAPPED for each in result.findings) == 1


def test_ids_swapped_within_what_drift_explains_are_named_too():
    """Forty cameras, 0.2 m apart: two points that stand so near to each other are both used."""
    rng = np.random.default_rng(3)
    world = make_world(rng, n=40)
    recorded = world.plan_from_cams.copy()
    recorded[:, :3, 3] += 0.01 * rng.normal(size=(40, 3))
    seen = observed(world.structure, world.matches)
    survey = survey_of(world.plan_from_cams[:, :3, 3], [0, 1, 8, 16, 24, 32])
    first, second = survey.points[:2]
    swapped = with_point(with_point(survey, 0, xyz=second.xyz), 1, xyz=first.xyz)
    result = refined((world.floorplan, scan_at(recorded), seen, swapped), swapped)
    assert all(point.is_used for point in result.survey.points)
    assert {p.id for p in result.survey.points if p.swapped_with} == {"C0", "C1"}
    assert sum(each.kind is SurveyKind.POINTS_SWAPPED for each in result.findings) == 1


def test_without_a_plan_points_hold_each_other(walk):
    """Nothing else holds the whole; each is told by the others."""
    survey = replace(walk[3], axes="site")
    points = refined(walk, survey, with_plan=False).survey.points
    for k in (1, 3):
        assert_allclose(points[k].left_out_m, by_a_solve(walk, survey, k, False), atol=0.004)


def test_an_unknown_height_stays_unknown(walk):
    survey = walk[3]
    survey = with_point(survey, 1, xyz=np.array([*survey.points[1].xyz[:2], np.nan]))
    point = refined(walk, survey).survey.points[1]
    assert np.isnan(point.left_out_m[2])
    assert_allclose(point.left_out_m[:2], by_a_solve(walk, survey, 1)[:2], atol=0.002)
    assert point.left_out_sigmas < left_out.CONTRADICTED_SIGMAS


def test_thinned_marks_stand_for_all():
    point_idx = np.repeat([4, 7, 9], [200, 10, 90])
    kept, stands_for = left_out._thinned(point_idx)
    assert np.bincount(point_idx[kept], minlength=10)[[4, 7, 9]].tolist() == [50, 10, 50]
    assert_allclose(np.bincount(point_idx[kept], stands_for)[[4, 7, 9]], [200, 10, 90])


def test_check_points_take_no_part_and_have_none(walk):
    survey = with_point(walk[3], 3, is_check=True)
    point = refined(walk, survey).survey.points[3]
    assert point.left_out_m is None
    assert not point.is_contradicted


def test_the_table_and_the_report_have_both_residuals(walk, tmp_path):
    result = refined(walk, with_point(moved(walk[3], 2, (0.06, 0.0, 0.0)), 5, is_check=True))
    write_survey(tmp_path / "control_points.csv", result.survey)
    with (tmp_path / "control_points.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["contradicted"] for row in rows] == ["no", "no", "yes", "no", "no", ""]
    for row, point in zip(rows, result.survey.points, strict=True):
        told = row["left_out_m"], row["left_out_dx_m"], row["left_out_sigmas"]
        if point.is_check:
            assert told == ("", "", "")
        else:
            assert float(told[0]) == pytest.approx(point.left_out_length_m, abs=1e-6)
            assert float(told[1]) == pytest.approx(point.left_out_m[0], abs=1e-6)
    page = survey_section(result.survey)
    (row,) = [row for row in page.split("<tr") if ">C4<" in row and ">control<" in row]
    assert f"{result.survey.points[2].left_out_length_m:.3f}" in row
    assert 'class="worse"' in row
    assert page.count('class="worse"') == 1
    assert "each left out" in page
    (told,) = survey_record(result.survey)["contradicted"]
    assert told.startswith("control point 'C4' contradicts the other evidence")
    against = disagreement_section((), [told])
    assert f"but:</p><ul><li>{escape(told)}</li></ul>" in against
    assert "Nothing" not in against
    held_out = {row.name: row.held_out for row in result.registration.rows}
    told = held_out["control points, each left out, RMS"]
    assert told == pytest.approx(result.survey.left_out.rms_m)

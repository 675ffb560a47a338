"""The registration: what fits and what was held out apart, and no accuracy from a fit."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from planfit.export.tables import registration_record, write_registration
from planfit.pipeline.evidence import Evidence, Stretch
from planfit.pipeline.links import Visit
from planfit.pipeline.registration import FACTOR_95, FACTOR_95_FLAT, loa_class, register
from planfit.pipeline.strength import LOOPS, DirectionStrength
from planfit.pipeline.validation import Check
from planfit.report.html.evidence_sections import registration_section
from planfit.survey import PointResidual, SurveyResiduals

WALLS = Check("wall points within 0.1 m of the plan", 0.4, 0.93, "share", False)


def evidence_of(sigma_m, n=20, visits=()):
    covariances = np.zeros((n, 6, 6))
    covariances[:, 3:, 3:] = sigma_m**2 * np.eye(3)
    stretch = Stretch((0, n - 1), sigma_m, None, 50, 0.5, 0.9, 0.0)
    return Evidence(covariances, np.zeros(n), (stretch,), tuple(visits), (), None)


def residuals_of(control, check):
    points = [
        PointResidual(
            f"{name}{k}", name == "K", np.zeros(3), np.zeros(3), np.asarray(r, float), 1, 0.01
        )
        for name, rows in (("C", control), ("K", check))
        for k, r in enumerate(rows)
    ]
    return SurveyResiduals(tuple(points), (), "plan", None)


VISIT = Visit((0, 3), (15, 19), 0.8, 0.05, 0.02, mean_m=0.03, n_points=40, way_m=12.0)
OPEN_VISIT = Visit((4, 7), (15, 19), 0.9, 0.7, 0.3, mean_m=0.4, n_points=8, way_m=9.5)
STRENGTH = DirectionStrength(
    "x", 0.012, (("walls", 0.62), (LOOPS, 0.378), ("floor", 0.002)), (4, 7), 0.25
)


def row(found, name):
    return next(row for row in found.rows if row.name.startswith(name))


@pytest.mark.parametrize(
    ("deviation_m", "name"),
    [
        (0.0005, "LOA50"), (0.001, "LOA50"), (0.004, "LOA40"), (0.005, "LOA40"), (0.0051, "LOA30"),
        (0.015, "LOA30"), (0.03, "LOA20"), (0.05, "LOA20"), (0.051, "LOA10"), (4.0, "LOA10"),
    ],
)  # fmt: skip
def test_classes_by_their_bounds(deviation_m, name):
    assert loa_class(deviation_m) == name


def test_the_factor_is_that_of_a_normal_distribution(rng):
    assert pytest.approx(np.sqrt(chi2.ppf(0.95, 3) / 3), abs=5e-4) == FACTOR_95
    assert pytest.approx(np.sqrt(chi2.ppf(0.95, 2) / 2), abs=5e-4) == FACTOR_95_FLAT
    for axes, factor in ((3, FACTOR_95), (2, FACTOR_95_FLAT)):
        lengths = np.linalg.norm(rng.normal(size=(200_000, axes)), axis=1)
        rms = np.sqrt(np.mean(lengths**2))
        assert np.mean(lengths < factor * rms) == pytest.approx(0.95, abs=0.002)


def test_fit_and_held_out_stand_apart():
    survey = residuals_of([[0.01, 0, 0], [0, 0.01, 0]], [[0.03, 0.04, 0.0], [0, 0, 0.05]])
    found = register(evidence_of(0.002, visits=[VISIT]), (WALLS,), survey)
    seen = row(found, "places seen again")
    assert (seen.before, seen.fit, seen.held_out, seen.count) == (0.8, 0.02, 0.05, 1)
    walls = row(found, "wall on the plan")
    assert (walls.before, walls.fit, walls.held_out, walls.count) == (0.5, 0.93, 0.9, 50)
    control, check = row(found, "control points, RMS"), row(found, "check points, RMS")
    assert (control.fit, control.held_out) == (pytest.approx(0.01), None)
    assert (check.fit, check.held_out) == (None, pytest.approx(0.05))
    assert row(found, "check points, height").held_out == pytest.approx(0.05 / np.sqrt(2))
    assert row(found, "check points, horizontal").held_out == pytest.approx(0.05 / np.sqrt(2))


def test_the_larger_of_prediction_and_check_points_is_stated():
    right = residuals_of([], [[0.002, 0, 0]] * 4)
    wrong = residuals_of([], [[0.3, 0, 0]] * 4)
    for survey, stated in ((right, 0.01 * FACTOR_95 * np.sqrt(3)), (wrong, 0.3 * FACTOR_95)):
        found = register(evidence_of(0.01), (WALLS,), survey)
        assert found.stated_95_m == pytest.approx(stated, rel=2e-3)
        assert found.loa == loa_class(stated)
        assert found.basis.startswith(
            "the larger of what 4 check points show (the NSSDA asks for 20"
        )


def test_no_accuracy_from_a_fit_alone():
    alone = register(evidence_of(0.001), (WALLS,), None)
    assert alone.stated_95_m is None
    assert alone.loa == ""
    assert alone.basis.startswith("not stated: nothing but the fit to the plan tells")
    seen = register(evidence_of(0.001, visits=[VISIT]), (WALLS,), None)
    assert seen.stated_95_m is not None
    assert "no check point confirms it" in seen.basis
    held = register(evidence_of(0.001), (WALLS,), residuals_of([[0.001, 0, 0]] * 5, []))
    assert held.checked_95_m is None
    assert "how well control points fit is no accuracy" in held.basis


def test_frames_without_a_place_have_no_say():
    evidence = evidence_of(0.01)
    lost = evidence.pose_covariances.copy()
    lost[:8] *= 1e8
    wide = register(replace(evidence, pose_covariances=lost), (), None).predicted_95_m
    known = replace(evidence, pose_covariances=lost, unplaced=((0, 7),))
    assert register(known, (), None).predicted_95_m < 1e-3 * wide


def test_files_and_page_say_the_same(tmp_path):
    survey = residuals_of([[0.01, 0, 0]], [[0.03, 0.04, np.nan], [0.0, 0.02, np.nan]])
    found = register(evidence_of(0.002, visits=[VISIT]), (WALLS,), survey)
    write_registration(tmp_path / "registration.csv", found)
    lines = (tmp_path / "registration.csv").read_text().splitlines()
    assert lines[0] == "residual,unit,before,fit,held_out,count"
    assert '"check points, RMS",m,,,0.038079,2' in lines
    assert lines[-1].startswith('"accuracy at 95 %, stated LOA10",m,,,0.06')
    record = registration_record(found)
    assert record["usibd_loa"] == "LOA10"
    assert record["stated_95_m"] == pytest.approx(FACTOR_95_FLAT * np.sqrt((0.05**2 + 0.02**2) / 2))
    page = registration_section(found)
    assert "What fixes" not in page  # nothing was said of it
    assert "USIBD LOA10" in page
    assert "check points, height" not in page  # no height is known


def test_error_of_each_loop_and_what_fixes_each_direction(tmp_path):
    evidence = replace(evidence_of(0.002, visits=[VISIT, OPEN_VISIT]), strength=(STRENGTH,))
    found = register(evidence, (WALLS,), None)
    assert found.loops == (OPEN_VISIT, VISIT)  # the worst first
    write_registration(tmp_path / "registration.csv", found)
    lines = (tmp_path / "registration.csv").read_text().splitlines()
    assert all(len(next(csv.reader([line]))) == 6 for line in lines)
    loops = [line for line in lines if line.startswith('"loop of')]
    assert (
        loops[0] == '"loop of frames 4-7 and 15-19, median distance",m,0.900000,0.300000,0.700000,8'
    )
    assert loops[1] == '"loop of frames 4-7 and 15-19, mean distance",m,,0.400000,,8'
    assert loops[2] == '"loop of frames 4-7 and 15-19, length of way",m,,9.500000,,8'
    assert len(loops) == 6
    assert '"x, predicted sigma",m,,,0.012000,' in lines
    assert '"x, fixed by walls",share,,0.620000,,' in lines
    strength = registration_record(found)["strength"]["x"]
    assert strength["shares"]["walls"] == 0.62
    assert strength["weakest_frames"] == [4, 7]
    page = registration_section(found).replace("\u00a0", " ")
    assert (
        "62 % walls, 38 % places seen again</td>" in page
    )  # what holds next to nothing is left out
    assert "0.012 m" in page
    assert page.index("0.400 m") < page.index("0.030 m")
    assert "12.00 m" in page

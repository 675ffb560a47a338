"""Faults of a sensor are put on images as their names say, and results are held against what was put in."""

from dataclasses import replace

import numpy as np
import pytest
from calibration import make_page
from calibration_cases import (
    CLOCKS,
    FAULTLESS,
    FAULTS,
    HELD,
    UNITS_PER_METRE,
    Calibrated,
    SensorCase,
    all_cases,
    choose,
    judge_all,
    shares,
)
from faults.inputs import Inputs
from faults.scans import RATE_HZ
from numpy.testing import assert_allclose

from builders import look, room_plan, room_scan


@pytest.fixture(scope="module")
def room():
    scan = room_scan(np.stack([look([3, 2, 1.5], 30 * i) for i in range(3)]))
    return Inputs(scan, room_plan(), scan.world_from_cams, np.eye(4))


def case_of(name, has_unit=True):
    return SensorCase("room", 0, has_unit, next(f for f in FAULTS if f.name == name))


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_what_should_be_found_undoes_each_fault(room, fault):
    case = SensorCase("room", 0, True, fault)
    undone_by = case.undone_by(room)
    spoilt = case.spoil(room)
    assert spoilt.scan.fingerprint != room.scan.fingerprint
    assert not undone_by.is_nominal
    for i, camera in enumerate(room.scan.cameras):
        assert_allclose(
            undone_by.depths(spoilt.scan.files.depth(i)), room.scan.files.depth(i), atol=1e-5
        )
        again = undone_by.camera(spoilt.scan.cameras[i])
        assert_allclose(
            [again.fx, again.fy, again.cx, again.cy], [camera.fx, camera.fy, camera.cx, camera.cy]
        )


def test_faults_are_as_large_as_their_names_say(room):
    true = room.scan.files.depth(0).astype(float)
    assert_allclose(case_of("depth x0.95").spoil(room).scan.files.depth(0), 0.95 * true, rtol=1e-5)
    assert_allclose(case_of("depth +5 cm").spoil(room).scan.files.depth(0), true + 0.05, rtol=1e-5)
    bent = case_of("depth +0.01 z^2").spoil(room).scan.files.depth(0)
    assert_allclose(bent - true, 0.01 * bent.astype(float) ** 2, atol=1e-5)
    camera, wrong = room.scan.cameras[0], case_of("focal +5%").spoil(room).scan.cameras[0]
    assert_allclose([wrong.fx, wrong.fy], [1.05 * camera.fx, 1.05 * camera.fy])
    wrong = case_of("principal point 8 px").spoil(room).scan.cameras[0]
    assert wrong.cx == pytest.approx(camera.cx + 8 * camera.width / 640)


def test_a_plan_without_unit_is_judged_in_metres(room):
    spoilt = replace(case_of("focal +5%"), fault=FAULTLESS, has_unit=False).spoil(room)
    assert not spoilt.floorplan.is_metric
    fitted = spoilt.floorplan.scaled(1 / UNITS_PER_METRE)
    assert_allclose(spoilt.scale_error(fitted), 0.0, atol=1e-12)
    at = np.array([[1.0, 2.0, 3.0]])
    assert_allclose(spoilt.in_true_plan(at, fitted), at)


def test_cases_have_names_and_numbers_of_their_own_and_are_chosen_with_their_references():
    cases = all_cases()
    assert len({c.name for c in cases}) == len({c.number for c in cases}) == len(cases)
    chosen = choose(cases, "focal +5%", ["conslam, drift 1"])
    assert [c.fault.name for c in chosen] == ["faultless", "focal +5%"]
    assert {c.scan for c in choose(cases, "", ["kitchen"])} == {"kitchen"}


def test_figures_count_what_is_near_and_found_and_sure():
    case = case_of("depth x0.95")
    faultless, held = (replace(case, fault=fault) for fault in (FAULTLESS, HELD))
    put_in = {"depth_scale": 1 / 0.95 - 1}

    def measured(of, error_m, found=None, sigma=0.001):
        found = found or {}
        sigmas = dict.fromkeys(found, sigma)
        put = put_in if of is case else {}
        return Calibrated(
            of.number,
            of.name,
            "x",
            0,
            error_m=error_m,
            put_in=put,
            found=found,
            asked=found,
            sigmas=sigmas,
        )

    plain = [measured(faultless, 0.040), measured(held, 0.0399)]
    cases = [faultless, held, case]
    good = [*plain, measured(case, 0.0549, {"depth_scale": 0.053})]
    assert [some for some, _ in shares(judge_all(cases, good)).values()] == [1, 1, 1, 1, 1]
    bad = [*plain, measured(case, 0.0551, {"depth_scale": 0.040, "principal_x": 0.01})]
    assert [some for some, _ in shares(judge_all(cases, bad)).values()] == [0, 1, 0, 1, 0]
    missed = [*plain, measured(case, 0.0400)]
    assert [some for some, _ in shares(judge_all(cases, missed)).values()] == [1, 1, 0, 1, 0]
    assert "depth_scale +0.0400" in make_page(judge_all(cases, bad))
    worse = [replace(plain[0], error_m=0.0408), plain[1]]
    assert shares(judge_all(cases, worse))[
        "faultless: error at most 1.02 times that without calibration"
    ] == (0, 1)


def test_a_late_clock_gives_each_image_a_pose_recorded_before():
    poses = np.tile(np.eye(4), (30, 1, 1))
    poses[:, 0, 3] = np.arange(30) / RATE_HZ  # a metre a second
    true = room_scan(poses)
    inputs = Inputs(true, room_plan(), poses, np.eye(4))
    fault = next(f for f in CLOCKS if f.late_s == 0.1)
    spoilt = SensorCase("room", 0, True, fault).spoil(inputs).scan
    assert_allclose(spoilt.world_from_cams[5:, 0, 3], poses[5:, 0, 3] - 0.1, atol=1e-12)
    assert spoilt.files is true.files  # nothing is wrong with the camera

"""What is said of the sensor: warnings in plain words, and the block of run.json."""

import json

import numpy as np
import pytest

from builders import CAMERA
from planfit.adjust.calibration import NOT_CALIBRATED, SHARED, Calibration
from planfit.export.record import sensor_record
from planfit.geometry.calibration import NOMINAL
from planfit.pipeline.sensor import sensor_findings, sensor_parameters


def found(implausible=(), p_sensor=None, **departures):
    """A calibration that departs by these (departure, sigma), kept unless it is implausible."""
    departs, sigmas, is_kept = np.zeros(9), np.zeros(9), np.zeros(9, dtype=bool)
    for name, (departure, sigma) in departures.items():
        i = SHARED.index(name)
        departs[i], sigmas[i], is_kept[i] = departure, sigma, not implausible
    sensor = NOMINAL.with_vector(NOMINAL.vector + np.where(is_kept, departs, 0.0)[:7])
    return Calibration(sensor, is_kept, departs, sigmas, 1.0, tuple(implausible), p_sensor)


@pytest.mark.parametrize(
    ("name", "departure", "words"),
    [
        ("depth_scale", -0.02, "depth was measured 2.0% too long: corrected by 0.9800 +- 0.0010"),
        ("depth_scale", 0.02, "depth was measured 2.0% too short: corrected by 1.0200 +- 0.0010"),
        ("depth_offset_m", 0.05, "0.050 m too short at every distance: corrected by +0.050"),
        ("depth_quadratic_per_m", -0.01, "too long by its square, 0.090 m at 3 m: corrected by -0.0100"),
        ("focal_scale", 0.02, "the focal length was given 2.0% too short: corrected by 1.0200"),
        ("focal_aspect", -0.02, "the focal length in y was given 2.0% too long"),
        ("principal_y", 0.02, "given 2.6 px off in y: moved by +2.6 +- 0.1 px"),
    ],
)  # fmt: skip
def test_what_is_kept_is_said_in_words(name, departure, words):
    (warning,) = sensor_findings(sensor_parameters(found(**{name: (departure, 0.001)}), CAMERA))
    assert words in warning.sentence


def test_two_that_are_kept_are_one_warning():
    both = found(depth_scale=(-0.02, 0.001), focal_scale=(0.03, 0.002))
    (warning,) = sensor_findings(sensor_parameters(both, CAMERA))
    assert len(warning.parts) == 2


def test_what_no_camera_can_be_is_said_to_be_uncorrected():
    odd = found(("principal_x",), 0.2, principal_x=(17 / CAMERA.fx, 0.001))
    (warning,) = sensor_findings(sensor_parameters(odd, CAMERA))
    assert warning.facts["p_sensor"] == 0.2
    assert "20% to intrinsics of another camera or image size, 80% to colour" in warning.sentence
    assert (
        "asks for a principal point in x 17 px off, more than a camera can be off"
        in warning.sentence
    )
    (warning,) = sensor_findings(
        sensor_parameters(found(("depth_scale",), depth_scale=(0.15, 0.001)), CAMERA)
    )
    assert "asks for depth 15.0% off" in warning.sentence
    assert "--depth-scale" in warning.sentence
    assert warning.facts["p_sensor"] is None
    assert "registered" not in warning.sentence


def test_of_a_sensor_without_fault_nothing_is_said():
    assert sensor_findings(sensor_parameters(NOT_CALIBRATED, CAMERA)) == ()


def test_the_record_has_each_parameter_and_the_corrected_camera():
    calibration = found(depth_scale=(-0.02, 0.001), principal_x=(0.01, 0.002))
    record = json.loads(
        json.dumps(
            sensor_record(calibration.sensor, sensor_parameters(calibration, CAMERA), CAMERA),
            allow_nan=False,
        )
    )
    scale = record["parameters"]["depth_scale"]
    assert (scale["found"], scale["sigma"]) == pytest.approx((0.98, 0.001))
    assert scale["departure"] == pytest.approx(-0.02)
    assert scale["kept"]
    point = record["parameters"]["principal_x"]
    assert point["unit"] == "px"
    assert (point["found"], point["sigma"]) == pytest.approx((1.3, 0.26))
    assert record["parameters"]["focal_aspect"]["sigma"] is None
    assert not record["parameters"]["focal_aspect"]["kept"]
    assert record["camera"]["cx"] == pytest.approx(CAMERA.cx + 1.3)
    assert NOMINAL.with_vector(np.array(list(record["correction"].values()))) == calibration.sensor


def test_what_is_not_kept_is_told_as_it_would_be_and_not_applied():
    calibration = Calibration(NOMINAL, np.zeros(9, dtype=bool), np.full(9, 0.001), np.full(9, 0.01))
    rows = sensor_parameters(calibration, CAMERA)
    assert not any(row.is_kept for row in rows)
    assert all(row.p_sensor is None for row in rows)
    assert rows[0].found == pytest.approx(1.001)
    assert (
        sensor_record(calibration.sensor, sensor_parameters(calibration, CAMERA), CAMERA)["camera"][
            "fx"
        ]
        == CAMERA.fx
    )

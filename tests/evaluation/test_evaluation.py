"""One call for all metrics: what it takes, and what it refuses."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import make_world, nudged, room_scan
from planfit.errors import OptionError
from planfit.evaluation import (
    ComparedPoses,
    EvaluateOptions,
    Truth,
    evaluate,
    layer_metrics,
    surface_metrics,
    trajectory_metrics,
)
from planfit.geometry.calibration import NOMINAL, SensorCalibration
from planfit.scan import calibrated_scan

FEW = EvaluateOptions(depth_maps=False)


@pytest.fixture
def world(rng):
    return make_world(rng)


@pytest.fixture
def result(rng, world):
    """Poses before and after as a result of `planfit.refine` has them: off, and true."""
    off = nudged(rng, world.plan_from_cams, 1.0, 0.1)
    return SimpleNamespace(
        structure=world.structure,
        floorplan=world.floorplan,
        initial_plan_from_cams=off,
        plan_from_cams=world.plan_from_cams,
        world_from_cams=world.plan_from_cams,
        sensor=NOMINAL,
    )


def test_a_result_gives_the_metrics_of_its_parts(world, result):
    scan = replace(room_scan(world.plan_from_cams), world_from_cams=result.initial_plan_from_cams)
    idx = np.arange(len(scan))
    truth = Truth(idx, world.plan_from_cams)
    evaluation = evaluate(scan, result, truth=truth, options=FEW)
    both = result.initial_plan_from_cams, result.plan_from_cams
    expected = [
        *trajectory_metrics(*both, truth, FEW.delta_m),
        *surface_metrics(world.structure, world.floorplan, *both),
        *layer_metrics(world.structure.walls, *both),
    ]
    assert list(evaluation.metrics) == [metric.name for metric in expected]
    for metric in expected:
        found = evaluation[metric.name]
        assert (found.before, found.after) == pytest.approx((metric.before, metric.after))
    assert evaluation.n_true_poses == len(scan)
    assert evaluation["ate_rms"].after == pytest.approx(0.0, abs=1e-12)
    assert evaluation["nsd"].difference < 0
    assert evaluation["off_plan"].before > evaluation["off_plan"].after == 0.0


def test_the_map_of_a_result_is_that_of_its_corrected_sensor(world, result):
    sensor = SensorCalibration(depth_scale=0.9, depth_quadratic_per_m=0.01)
    scan = room_scan(world.plan_from_cams)
    result.sensor = sensor
    found = evaluate(scan, result)
    both = (scan.world_from_cams, result.world_from_cams)
    on_plan = (result.initial_plan_from_cams, result.plan_from_cams)
    poses = ComparedPoses(world.structure, both, on_plan, world.floorplan)
    expected = evaluate(calibrated_scan(scan, sensor), poses)
    nominal = evaluate(scan, poses)["mme"].after
    assert found["mme"].after == pytest.approx(expected["mme"].after, abs=1e-4)
    assert found["mme"].after != pytest.approx(nominal, abs=1e-2)


def test_the_truth_is_compared_in_its_frame(world, result):
    scan = room_scan(world.plan_from_cams)
    in_world, in_plan = world.plan_from_cams, result.initial_plan_from_cams
    poses = ComparedPoses(
        world.structure, (in_world, in_world), (in_plan, in_plan), world.floorplan
    )
    for frame, expected in (("world", in_world), ("plan", in_plan)):
        truth = Truth(np.arange(len(scan)), expected, frame)
        found = evaluate(scan, poses, truth=truth, options=FEW)
        assert_allclose(found["ate_max"].after, 0.0, atol=1e-12)


def test_without_truth_and_plan_there_is_the_floor(world):
    scan, both = room_scan(world.plan_from_cams), (world.plan_from_cams, world.plan_from_cams)
    found = evaluate(scan, ComparedPoses(world.structure, both, both), options=FEW)
    assert {"nsd", "ate_rms", "mme"} & set(found.metrics) == set()
    assert "floor_plane_rms" in found.metrics
    assert found.n_true_poses == 0


def test_what_does_not_belong_together_is_refused(world, result):
    scan = room_scan(world.plan_from_cams)
    with pytest.raises(OptionError, match="none beside a result"):
        evaluate(scan, result, world.floorplan, options=FEW)
    with pytest.raises(OptionError, match="delta_m"):
        EvaluateOptions(delta_m=0.0)

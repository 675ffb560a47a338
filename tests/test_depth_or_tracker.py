"""A tracker is not blamed for what depth gets wrong, and depth not for what a tracker does."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import CAMERA, nudged
from faulty_sensors import make_sensor_world
from planfit import RefineOptions
from planfit.findings import Finding, PoseKind
from planfit.geometry import se3
from planfit.geometry.calibration import NOMINAL, SensorCalibration
from planfit.matching.relative_motions import VerifiedPairs
from planfit.matching.types import RelativePoses
from planfit.matching.verify import match_sigma
from planfit.pipeline.depth_or_tracker import (
    as_if_asked,
    corrected_pairs,
    errs,
    errs_clearly_less,
    sensor_by_neighbours,
)
from planfit.scan.odometry import OdometryOptions, make_odometry
from planfit.tracking import Tracking, judge_tracking, measured_motions
from planfit.tracking.conventions import ConventionFit
from planfit.tracking.numbered import mount_named
from planfit.tracking.types import TrackingBreak

OPTIONS = RefineOptions().with_("odometry.sigma_base_m", 0.002).with_("odometry.sigma_per_m", 0.005)
N = 32
BENT = SensorCalibration(depth_quadratic_per_m=-0.01)
HALL = np.array([30.0, 24.0, 6.0])


@pytest.fixture(scope="module")
def world():
    return make_sensor_world(np.random.default_rng(3), n=N, n_rays=20, size=HALL)


def pairs_of(world):
    """Its matches as verified pairs, with the motions that their points give."""
    m = world.measurements.matches
    cuts = m.start[1:-1]
    points_a, points_b = np.split(m.points_a, cuts), np.split(m.points_b, cuts)
    motions = [
        se3.fit_rigid(b, a, 1 / match_sigma(a, b) ** 2)
        for a, b in zip(points_a, points_b, strict=True)
    ]
    relative = RelativePoses(m.pairs, np.array(motions), np.diff(m.start))
    return VerifiedPairs(relative, points_a, points_b)


def judged(verified, recorded, sensor=NOMINAL):
    motions = measured_motions(corrected_pairs(verified, sensor))
    return judge_tracking(recorded, motions, "recorded", OPTIONS.odometry, OPTIONS.tracking)


def asked_for(verified, recorded):
    steps = make_odometry(recorded, OPTIONS.odometry)
    return sensor_by_neighbours(verified, recorded, steps, (CAMERA,) * N, OPTIONS).sensor


def test_depth_that_bends_motions_is_found_and_the_tracker_believed_again(world):
    verified, recorded = pairs_of(world.measured_by(BENT)), world.plan_from_cams
    as_lifted = judged(verified, recorded)
    assert errs(as_lifted)
    sensor = asked_for(verified, recorded)
    assert_allclose(sensor.depth_quadratic_per_m, BENT.depth_quadratic_per_m, rtol=0.1)
    corrected = judged(verified, recorded, sensor)
    assert errs_clearly_less(corrected, as_lifted)
    assert corrected.sigma_factors == (1.0, 1.0)


def test_a_tracker_that_errs_is_not_put_down_to_depth(world, rng):
    verified, recorded = pairs_of(world), nudged(rng, world.plan_from_cams, 1.5, 0.15)
    as_lifted = judged(verified, recorded)
    assert errs(as_lifted)
    sensor = asked_for(verified, recorded)
    assert not errs_clearly_less(judged(verified, recorded, sensor), as_lifted)


def test_corrected_pairs_have_the_motions_of_what_was_there(world):
    true, bent = pairs_of(world), pairs_of(world.measured_by(BENT))
    mended = corrected_pairs(bent, BENT).relative_poses.a_from_b
    was = np.abs(bent.relative_poses.a_from_b - true.relative_poses.a_from_b).max()
    assert_allclose(mended, true.relative_poses.a_from_b, atol=0.02 * was)
    assert corrected_pairs(bent, NOMINAL) is bent


def test_rays_and_scans_without_pairs_ask_nothing(world):
    recorded, none = world.plan_from_cams, pairs_of(world).where(np.zeros(0, dtype=bool))
    assert asked_for(none, recorded).is_nominal
    rays = RefineOptions().with_("adjust.geometric", "rays")
    steps = make_odometry(recorded, OdometryOptions())
    pairs = pairs_of(world.measured_by(BENT))
    assert sensor_by_neighbours(pairs, recorded, steps, (CAMERA,) * N, rays).sensor.is_nominal


JUMPED = Finding(PoseKind.REVISITS_CONTRADICT_MOTION, frames=((3, 4),))
JUMP = TrackingBreak("jump", 3, 4, (1.0, 2.0), (0.1, 1.0), 5, JUMPED)


@pytest.mark.parametrize(
    ("factors", "breaks", "is_less"),
    [
        ((1.0, 1.0), (), True),
        ((1.0, 1.5), (JUMP,), True),  # of 2.0, with one jump
        ((1.0, 1.9), (JUMP,), False),
        ((1.0, 1.0), (JUMP, JUMP), False),
        ((1.0, 2.0), (), True),
        ((1.0, 2.2), (), False),
    ],
)
def test_a_tracker_errs_less_by_its_noise_or_its_jumps(world, factors, breaks, is_less):
    poses = world.plan_from_cams
    steps = make_odometry(poses, OdometryOptions())
    before = Tracking(poses, poses, steps, "recorded", sigma_factors=(1.0, 2.0), breaks=(JUMP,))
    assert (
        errs_clearly_less(replace(before, sigma_factors=factors, breaks=breaks), before) is is_less
    )
    assert errs(before)
    assert not errs(replace(before, sigma_factors=(1.0, 1.0), breaks=()))


def test_depth_that_bends_motions_is_preferred_to_a_unit_that_nobody_named(world):
    """Bent motions are longer, too: 0.01 z^2 on ConSLAM looked like units of 1.12 m, 0.37 to 1.5 m off."""
    poses = world.plan_from_cams
    steps = make_odometry(poses, OdometryOptions())
    fit = ConventionFit("unit:1.12", 0.95, "recorded", 0.4, 300, 2.0)
    in_own_unit = Tracking(poses, poses, steps, fit.name, convention_fit=fit)
    assert errs(in_own_unit)
    as_well = replace(fit, name="recorded", share=0.9)
    in_metres = replace(
        in_own_unit, convention="recorded", convention_fit=as_well, sigma_factors=(1.0, 1.2)
    )
    assert errs_clearly_less(in_metres, in_own_unit)
    poorly = replace(in_metres, convention_fit=replace(as_well, share=0.6))
    assert not errs_clearly_less(poorly, in_own_unit)
    assert not errs_clearly_less(in_own_unit, in_own_unit)


@pytest.mark.parametrize("metres", [0.5, 0.8, 1.4])
def test_a_unit_is_not_put_down_to_depth(world, metres):
    recorded = world.plan_from_cams
    own = se3.make_transform(recorded[:, :3, :3], recorded[:, :3, 3] / metres)
    as_lifted = judged(pairs_of(world), own)
    assert as_lifted.metres_per_unit == pytest.approx(metres, rel=0.02)
    assert asked_for(pairs_of(world), own).is_nominal


def test_a_lens_is_preferred_to_a_camera_carried_askew(world):
    """15 px of 320 off centre looked like a camera 2 degrees askew and 0.12 m beside the body."""
    body_from_cam = se3.make_transform(
        se3.exp_so3(np.array([0.0, 0.035, 0.0])), np.array([0.12, 0.0, 0.0])
    )
    mount, cameras = mount_named(body_from_cam), world.plan_from_cams
    fit = ConventionFit(mount, 0.98, "recorded", 0.84, 300, 0.5)
    of_body = Tracking(
        cameras @ body_from_cam,
        cameras @ body_from_cam,
        make_odometry(cameras @ body_from_cam, OdometryOptions()),
        mount,
        convention_fit=fit,
    )
    assert of_body.is_mount_doubtful
    assert errs(of_body)
    assert_allclose(as_if_asked(of_body.recorded_world_from_cams, of_body), cameras, atol=1e-3)
    # Axes of the world that were turned, too, are another matter.
    turned = replace(of_body, convention=f"{mount}, z_up")
    assert_allclose(as_if_asked(of_body.recorded_world_from_cams, turned), cameras, atol=1e-3)
    steps = make_odometry(cameras, OdometryOptions())
    as_well = Tracking(
        cameras,
        cameras,
        steps,
        "recorded",
        convention_fit=replace(fit, name="recorded", share=0.95),
    )
    assert errs_clearly_less(as_well, of_body)
    poorly = replace(as_well, convention_fit=replace(fit, name="recorded", share=0.8))
    assert not errs_clearly_less(poorly, of_body)
    assert not errs_clearly_less(of_body, of_body)
    # Poses that explain little as recorded are those of a body.
    of_ros = replace(of_body, convention_fit=replace(fit, asked_share=0.1))
    assert not of_ros.is_mount_doubtful
    assert not errs(of_ros)

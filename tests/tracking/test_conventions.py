"""The usual mistakes of export, made here, are named and undone."""

from dataclasses import replace

import numpy as np
import pytest
from measured_walk import SIGMA_M, SIGMA_RAD, displaced, measure, tracked, walk
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from planfit.errors import OptionError, ScanError
from planfit.findings import PoseKind
from planfit.geometry import se3
from planfit.scan.odometry import OdometryOptions
from planfit.tracking import TrackingOptions, believe, judge_tracking, require_asked_convention
from planfit.tracking.conventions import (
    CONVENTIONS,
    ConventionFit,
    apply_convention,
    best_convention,
)
from planfit.tracking.numbered import mount_of, unit_by_motions

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
OPTICAL = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Camera axes in those of a body with x forward, y left and z up."""
MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])


def turned(degrees):
    return se3.yaw_transform(np.deg2rad(degrees))


def with_quaternion(poses, order):
    xyzw = Rotation.from_matrix(poses[:, :3, :3]).as_quat()[:, order]
    return se3.make_transform(Rotation.from_quat(xyzw).as_matrix(), poses[:, :3, 3])


def with_unit(poses, per_metre):
    return se3.make_transform(poses[:, :3, :3], poses[:, :3, 3] * per_metre)


def transposed(poses):
    return np.swapaxes(poses[:, :3, :3], 1, 2)


WXYZ, XYZW = (3, 0, 1, 2), (1, 2, 3, 0)

MISTAKES = {
    "camera_from_world": np.linalg.inv,
    "opengl": lambda p: p @ FLIP,
    "camera_from_world_opengl": lambda p: np.linalg.inv(p @ FLIP),
    # A pixel of the picture as shown is one of the sensor, a quarter turn on.
    "arkit": lambda p: p @ turned(90) @ FLIP,
    "arkit_other_way": lambda p: p @ turned(-90) @ FLIP,
    "camera_from_world_arkit": lambda p: np.linalg.inv(p @ turned(90) @ FLIP),
    "image_turned_left": lambda p: p @ turned(-90),
    "image_turned_right": lambda p: p @ turned(90),
    "image_upside_down": lambda p: p @ turned(180),
    "opengl_upside_down": lambda p: p @ turned(180) @ FLIP,
    "quaternion_wxyz": lambda p: with_quaternion(p, WXYZ),
    "quaternion_xyzw": lambda p: with_quaternion(p, XYZW),
    "camera_from_world_quaternion_wxyz": lambda p: with_quaternion(np.linalg.inv(p), WXYZ),
    "camera_from_world_quaternion_xyzw": lambda p: with_quaternion(np.linalg.inv(p), XYZW),
    "rotation_camera_from_world": lambda p: se3.make_transform(transposed(p), p[:, :3, 3]),
    "translation_camera_from_world": lambda p: se3.make_transform(
        p[:, :3, :3], np.linalg.inv(p)[:, :3, 3]
    ),
    "one_frame_late": lambda p: p[[0, *range(len(p) - 1)]],
    "two_frames_late": lambda p: p[[0, 0, *range(len(p) - 2)]],
    "one_frame_early": lambda p: p[[*range(1, len(p)), -1]],
    "two_frames_early": lambda p: p[[*range(2, len(p)), -1, -1]],
    "millimetres": lambda p: with_unit(p, 1000.0),
    "centimetres": lambda p: with_unit(p, 100.0),
    "feet": lambda p: with_unit(p, 1 / 0.3048),
    "ros_body": lambda p: p @ np.linalg.inv(OPTICAL),
    "left_handed": lambda p: MIRROR @ p @ MIRROR,
    "left_handed_camera_from_world": lambda p: np.linalg.inv(MIRROR @ p @ MIRROR),
}


@pytest.fixture(scope="module")
def walked():
    rng = np.random.default_rng(4)
    true = walk(rng, 120)
    return tracked(true, rng), measure(true, rng)


def judged(poses, motions, convention):
    tracking = judge_tracking(poses, motions, convention, OdometryOptions(), TrackingOptions())
    require_asked_convention("scan", tracking, convention)
    return tracking


def test_every_convention_has_its_mistake_here():
    assert set(MISTAKES) == set(CONVENTIONS)


@pytest.mark.parametrize("name", MISTAKES)
def test_each_mistake_is_named_and_undone(walked, name):
    poses, motions = walked
    mistaken = MISTAKES[name](poses)
    fit = best_convention(mistaken, motions, OdometryOptions())
    assert fit.name == name
    assert fit.is_clear
    assert fit.share > 0.9
    back = apply_convention(mistaken, name)
    # The world may be another one, and frames at the ends have no pose of their own: steps are the same.
    steps, expected = (se3.inverse(p[2:-3]) @ p[3:-2] for p in (back, poses))
    assert_allclose(steps, expected, atol=1e-9)


@pytest.mark.parametrize("name", ["camera_from_world", "arkit", "one_frame_late"])
def test_jumps_hide_no_convention(walked, name):
    poses, motions = walked
    rng = np.random.default_rng(0)
    for first in (30, 60, 90):
        poses = displaced(poses, first, len(poses) - 1, 5.0, 60.0, rng)
    tracking = judged(MISTAKES[name](poses), motions, "auto")
    assert tracking.convention == name
    assert len(tracking.breaks) >= 3


@pytest.mark.parametrize("factor", [1.0, 3.0, 6.0])
def test_a_bad_tracker_in_the_right_convention_raises_no_alarm(factor):
    rng = np.random.default_rng(7)
    true = walk(rng, 120)
    poses = tracked(true, rng, factor * np.deg2rad(0.15), factor * 0.02)
    assert not best_convention(poses, measure(true, rng), OdometryOptions()).is_clear


def test_a_camera_that_hardly_moves_is_not_in_another_unit():
    """Noise larger than the motion makes small units likely; along the measured motion it averages out."""
    rng = np.random.default_rng(7)
    true = with_unit(walk(rng, 200), 0.1)
    poses = tracked(true, rng, np.deg2rad(0.5), 0.08)
    assert not best_convention(poses, measure(true, rng), OdometryOptions()).is_clear


@pytest.mark.parametrize("metres", [0.02, 0.4, 0.7, 1.4, 3.0, 50.0])
def test_a_unit_of_their_own_is_measured_used_and_said(walked, metres):
    """Poses in 50 m came out 2.2 m off and were vouched for: their motion was believed, as a standstill."""
    poses, motions = walked
    for convention in ("recorded", "auto"):
        tracking = judged(with_unit(poses, 1 / metres), motions, convention)
        assert tracking.metres_per_unit == pytest.approx(metres, rel=0.03)
        steps, expected = (
            np.linalg.norm(np.diff(p[:, :3, 3], axis=0), axis=1)
            for p in (tracking.recorded_world_from_cams, poses)
        )
        assert_allclose(steps.sum(), expected.sum(), rtol=0.03)
        assert tracking.findings[0].kind is PoseKind.POSES_IN_OWN_UNIT
        found = apply_convention(with_unit(poses, 1 / metres), tracking.convention)
        assert_allclose(found, tracking.recorded_world_from_cams)


@pytest.mark.parametrize("metres", [0.6, 1 / 1.31, 1.31, 20.0])
def test_short_steps_tell_a_unit_too(metres):
    """0.05 m from frame to frame, told to 0.02 m: none of them is known to a tenth, all of them are."""
    rng = np.random.default_rng(4)
    true = with_unit(walk(rng, 120), 0.2)
    motions = measure(true, rng)
    poses = tracked(true, rng, np.deg2rad(0.05), 0.004)
    assert not best_convention(poses, motions, OdometryOptions()).is_clear
    tracking = judged(with_unit(poses, 1 / metres), motions, "recorded")
    assert tracking.metres_per_unit == pytest.approx(metres, rel=0.05)


def test_directions_that_surfaces_leave_free_tell_no_unit():
    """They were brought together from the recorded motion, and stay there along a corridor."""
    rng = np.random.default_rng(5)
    true = walk(rng, 120)
    motions, poses = measure(true, rng), with_unit(tracked(true, rng), 1 / 0.4)
    i, j = motions.pairs.T
    recorded = (se3.inverse(poses[i]) @ poses[j])[:, :3, 3]
    a_from_b, covariance = motions.a_from_b.copy(), motions.covariance.copy()
    a_from_b[:, 2, 3], covariance[:, 5, 5] = recorded[:, 2], 1.0
    told = replace(motions, a_from_b=a_from_b, covariance=covariance)
    assert unit_by_motions(poses, told) == pytest.approx(0.4, rel=0.05)


def test_a_unit_beside_another_convention_is_measured_too(walked):
    poses, motions = walked
    mistaken = with_unit(MISTAKES["opengl"](poses), 1 / 0.4)
    tracking = judged(mistaken, motions, "opengl")
    first, unit = tracking.convention.split(", ")
    assert first == "opengl"
    assert (
        float(unit.removeprefix("unit:"))
        == tracking.metres_per_unit
        == pytest.approx(0.4, rel=0.03)
    )
    assert_allclose(
        apply_convention(mistaken, tracking.convention), tracking.recorded_world_from_cams
    )


@pytest.mark.parametrize("metres", [0.94, 1.0, 1.06])
def test_what_depth_may_be_off_by_is_no_unit(walked, metres):
    poses, motions = walked
    assert judged(with_unit(poses, metres), motions, "recorded").convention == "recorded"


@pytest.mark.parametrize("seed", range(8))
def test_any_mount_of_the_camera_on_a_body_is_found(seed):
    rng = np.random.default_rng(seed)
    true = walk(rng, 120)
    motions, poses = measure(true, rng), tracked(true, rng)
    body_from_cam = se3.make_transform(
        se3.exp_so3(1.5 * rng.normal(size=3)), 0.3 * rng.normal(size=3)
    )
    bodies = poses @ se3.inverse(body_from_cam)
    tracking = judged(bodies, motions, "auto")
    found = mount_of(tracking.convention)
    departure = se3.difference(found, body_from_cam)
    assert np.rad2deg(np.linalg.norm(departure[:3])) < 1.0
    assert np.linalg.norm(departure[3:]) < 0.05
    steps, expected = (se3.inverse(p[:-1]) @ p[1:] for p in (tracking.world_from_cams, poses))
    assert_allclose(steps[:, :3, 3], expected[:, :3, 3], atol=0.02)
    assert tracking.findings[0].kind is PoseKind.MOUNT_FOUND
    assert "of a body that carries the camera" in tracking.findings[0].words
    with pytest.raises(ScanError, match="look like mount:"):
        judged(bodies, motions, "recorded")
    # Its name gives the same, and needs nothing further.
    again = judged(bodies, motions, tracking.convention)
    assert_allclose(again.recorded_world_from_cams, tracking.recorded_world_from_cams)


def test_a_level_walk_tells_no_height_of_the_camera():
    rng = np.random.default_rng(3)
    true = level_walk(rng, 120)
    body_from_cam = OPTICAL @ se3.make_transform(np.eye(3), np.array([0.1, -1.2, 0.2]))
    bodies = true @ np.linalg.inv(body_from_cam)
    found = mount_of(judged(bodies, measure(true, rng), "auto").convention)
    assert_allclose(found[:2, 3], body_from_cam[:2, 3], atol=0.05)
    assert abs(found[2, 3]) < 0.1


@pytest.mark.parametrize("seed", range(8))
def test_right_poses_are_those_of_no_body(seed):
    rng = np.random.default_rng(seed)
    true = walk(rng, 120)
    poses = tracked(true, rng, 4 * np.deg2rad(0.15), 4 * 0.02)
    assert judged(poses, measure(true, rng), "auto").convention == "recorded"


@pytest.mark.parametrize("seed", range(4))
def test_what_explains_a_part_of_the_walk_is_no_mount(seed):
    """As where a lens or depth is wrong: six parameters bend to a part of what does not fit."""
    rng = np.random.default_rng(seed)
    true = walk(rng, 120)
    arm = se3.make_transform(se3.exp_so3(np.array([0.0, -0.3, 0.0])), np.array([0.0, 0.1, 0.23]))
    seen = np.concatenate([true[:66] @ arm, true[66:]])
    with pytest.raises(ScanError, match="look like mount:"):
        judged(tracked(true, rng), measure(true @ arm, rng), "recorded")
    assert judged(tracked(true, rng), measure(seen, rng), "auto").convention == "recorded"


@pytest.mark.parametrize("seed", range(4))
def test_few_frames_that_each_err_are_those_of_no_body(seed):
    """All motions of a frame err alike, as where depth and colour disagree: a mount fits a few by chance."""
    rng = np.random.default_rng(seed)
    true = walk(rng, 12)
    motions = measure(true, rng, neighbours=3)
    apart = rng.normal(size=(12, 6)) * np.repeat([6 * SIGMA_RAD, 6 * SIGMA_M], 3)
    seen = se3.retract(true, apart)
    off = se3.inverse(seen[motions.pairs[:, 0]]) @ seen[motions.pairs[:, 1]]
    measured = se3.inverse(true[motions.pairs[:, 0]]) @ true[motions.pairs[:, 1]]
    motions = replace(motions, a_from_b=off @ se3.inverse(measured) @ motions.a_from_b)
    assert judged(tracked(true, rng), motions, "auto").convention == "recorded"


@pytest.mark.parametrize(
    "name", ["mount:", "mount:1/2/3", "mount:1/2/3/4/5/nan", "mount:a/0/0/0/0/0"]
)
def test_mounts_that_are_none_are_refused(walked, name):
    with pytest.raises(OptionError, match="of a camera on a body"):
        believe(walked[0], name, OdometryOptions())


@pytest.mark.parametrize("name", ["unit:0", "unit:-1", "unit:nan", "unit:inf", "unit:x", "unit:"])
def test_units_that_are_none_are_refused(walked, name):
    with pytest.raises(OptionError, match="the metres of a unit"):
        believe(walked[0], name, OdometryOptions())


def test_nobody_who_walked_tells_no_unit(walked):
    poses, motions = walked
    still = se3.make_transform(poses[:, :3, :3], 0 * poses[:, :3, 3])
    assert unit_by_motions(still, motions) is None
    assert unit_by_motions(poses, motions[np.arange(0)]) is None


def test_the_run_stops_and_says_what_the_poses_look_like(walked):
    poses, motions = walked
    with pytest.raises(ScanError, match=r"look like opengl .*--poses-convention opengl, or auto"):
        judged(MISTAKES["opengl"](poses), motions, "recorded")
    with pytest.raises(
        ScanError, match=r"look like recorded .*taken as feet .*--poses-convention auto"
    ):
        judged(poses, motions, "feet")


def test_a_name_or_auto_applies_it(walked):
    poses, motions = walked
    mistaken = MISTAKES["camera_from_world"](poses)
    for asked in ("camera_from_world", "auto"):
        tracking = judged(mistaken, motions, asked)
        assert_allclose(tracking.recorded_world_from_cams, poses, atol=1e-9)
        assert tracking.findings[0].facts == {"convention": "camera_from_world"}
    assert judged(poses, motions, "auto").convention == "recorded"


def test_an_unknown_name_is_refused(walked):
    with pytest.raises(OptionError, match="expected recorded, auto, camera_from_world"):
        judged(*walked, "blender")
    with pytest.raises(OptionError, match="found 'blender'"):
        believe(walked[0], "blender", OdometryOptions())


@pytest.mark.slow
def test_poses_of_another_recording_are_not_explained(walked):
    poses, motions = walked
    other = walk(np.random.default_rng(99), len(poses))
    tracking = judged(other, motions, "recorded")
    assert tracking.findings[0].kind is PoseKind.MOTIONS_UNEXPLAINED


def test_a_convention_that_explains_no_more_than_the_poses_as_recorded_is_not_clear():
    """However much likelier: what neither explains may be nearer to one of them by chance."""
    alike = ConventionFit("opengl", 0.86, "recorded", 0.86, 132, 1.0)
    assert not alike.is_clear
    assert replace(alike, asked_share=0.5).is_clear


def test_few_motions_tell_no_convention(walked):
    poses, motions = walked
    fit = best_convention(MISTAKES["opengl"](poses), motions[np.arange(10)], OdometryOptions())
    assert (fit.name, fit.is_clear) == ("recorded", False)


def level_walk(rng, n=80):
    """An upright camera, y down in the image, that walks across the floor of a world whose y is up."""
    yaw = np.cumsum(rng.normal(0.1, 0.2, n))
    axes = np.stack(
        [[[-np.cos(a), 0, np.sin(a)], [0, -1, 0], [np.sin(a), 0, np.cos(a)]] for a in yaw]
    )
    rotations = np.swapaxes(axes, 1, 2)
    positions = np.cumsum(0.3 * rotations[:, :, 2] + rng.normal(0, 0.01, (n, 3)), axis=0)
    return se3.make_transform(rotations, positions)


Y, Z = np.array([0.0, 1, 0]), np.array([0.0, 0, 1])
Z_UP_FROM_Y_UP = se3.make_transform(
    Rotation.from_euler("x", 90, degrees=True).as_matrix(), np.zeros(3)
)


def judged_with_up(poses, motions, up_world, convention="recorded"):
    options = OdometryOptions(), TrackingOptions(), up_world
    tracking = judge_tracking(poses, motions, convention, *options)
    require_asked_convention("scan", tracking, convention)
    return tracking


@pytest.mark.parametrize(
    ("name", "axes", "up_world"),
    [("z_up", Z_UP_FROM_Y_UP, Y), ("y_up", np.eye(4), Z)],
)
def test_another_axis_that_is_up_is_named_and_undone(name, axes, up_world):
    true = level_walk(np.random.default_rng(4))
    motions = measure(true, np.random.default_rng(5))
    poses = axes @ true
    with pytest.raises(ScanError, match=f"scan: these poses look like {name}: .* {name}, or auto"):
        judged_with_up(poses, motions, up_world)
    for convention in ("auto", name):
        tracking = judged_with_up(poses, motions, up_world, convention)
        assert tracking.convention == name
        up_in_images = -tracking.world_from_cams[:, :3, 1]
        assert_allclose(up_in_images @ up_world, 1.0, atol=1e-9)


@pytest.mark.parametrize("roll_deg", [0, 30, 90, 180])
def test_right_axes_are_not_doubted_however_the_camera_is_held(roll_deg):
    true = level_walk(np.random.default_rng(6)) @ turned(roll_deg)
    tracking = judged_with_up(true, measure(true, np.random.default_rng(7)), Y)
    assert tracking.convention == "recorded"
    assert np.array_equal(tracking.world_from_cams, true)


def test_what_the_poses_are_is_named_before_which_axis_is_up():
    true = level_walk(np.random.default_rng(4))
    motions = measure(true, np.random.default_rng(5))
    poses = MISTAKES["opengl"](Z_UP_FROM_Y_UP @ true)
    with pytest.raises(ScanError, match="look like opengl"):
        judged_with_up(poses, motions, Y)
    with pytest.raises(ScanError, match="look like z_up"):
        judged_with_up(poses, motions, Y, "opengl")
    assert judged_with_up(poses, motions, Y, "auto").convention == "opengl, z_up"

"""Poses in a unit of their own, and depth in a wrong one, through `planfit.refine` as a whole."""

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest

import planfit
from builders import keep_images, look, room_scan
from planfit.errors import ScanError
from planfit.evaluation import position_errors
from planfit.export.cloud import read_ply_points
from planfit.findings import PoseKind, ScanKind
from planfit.geometry import se3
from planfit.pipeline.depth_unit import DepthUnit, Sizes, unit_by_motion
from planfit.scan import ScanFiles
from planfit.scan.odometry import OdometryOptions
from planfit.synth import BuildingOptions, CameraOptions, DriftOptions, SynthOptions, WalkOptions
from planfit.synth import make_scan as synthesise
from planfit.tracking import believe
from planfit.tracking.conventions import ConventionFit

FACTOR = 1.5
"""By which something is off."""


@pytest.fixture(scope="module")
def truth():
    made = synthesise(
        SynthOptions(
            seed=5,
            building=BuildingOptions(n_rooms=3),
            walk=WalkOptions(n_frames=60),
            camera=CameraOptions(width_px=160, height_px=120),
            drift=DriftOptions(yaw_deg=0.5, translation_m=0.03),
        )
    )
    return replace(made, scan=keep_images(made.scan))


@dataclass(frozen=True)
class LongDepth:
    """Images whose depth is too long, or too short."""

    files: ScanFiles
    factor: float = FACTOR

    def color(self, i):
        return self.files.color(i)

    def depth(self, i):
        return self.factor * self.files.depth(i)

    def labels(self, i):
        return self.files.labels(i)

    def write_poses(self, directory, world_from_cams, frame_idx=None):
        self.files.write_poses(directory, world_from_cams, frame_idx)


def with_long_poses(scan):
    poses = scan.world_from_cams
    return replace(
        scan, world_from_cams=se3.make_transform(poses[:, :3, :3], FACTOR * poses[:, :3, 3])
    )


def error_m(result, truth):
    return position_errors(result.plan_from_cams, truth.true_world_from_cams).rms_m


@pytest.mark.slow
def test_poses_that_are_too_long_end_where_right_ones_do(truth):
    right = planfit.refine(truth.scan, truth.floorplan)
    found = planfit.refine(with_long_poses(truth.scan), truth.floorplan)
    assert error_m(found, truth) < error_m(right, truth) + 0.005
    assert any(each.kind is PoseKind.POSES_IN_OWN_UNIT for each in found.findings)
    assert not any(each.kind is ScanKind.SENSOR_CORRECTED for each in found.findings)


def test_depth_that_motion_and_plan_find_too_long_is_named(truth):
    scan = replace(truth.scan, files=LongDepth(truth.scan.files))
    with pytest.raises(ScanError, match=r"scan's depth: .* give --depth-scale .* 0\.6\d+ times"):
        planfit.refine(scan, truth.floorplan)


@pytest.mark.slow
def test_depth_in_millimetres_that_was_read_as_fifths_is_put_right(truth, tmp_path):
    """RealSense recorders write lists in the form of TUM with depth in mm: metric poses were shrunk."""
    scan = replace(truth.scan, files=LongDepth(truth.scan.files, 0.2), depth_read_in_m=TUM)
    right = planfit.refine(truth.scan, None)
    found = planfit.refine(scan, None)
    assert found.depth_unit == DepthUnit(5.0)
    assert any(each.kind is PoseKind.DEPTH_UNIT_TAKEN for each in found.findings)
    assert found.tracking is not None
    assert found.tracking.metres_per_unit == 1.0
    rigid = [
        position_errors(each.world_from_cams, truth.true_world_from_cams).aligned_rms_m
        for each in (found, right)
    ]
    assert rigid[0] < rigid[1] + 0.002
    # The cloud of its folder is in metres, too.
    sizes = []
    for result in (right, found):
        result.save(tmp_path / str(len(sizes)))
        record = json.loads((tmp_path / str(len(sizes)) / "run.json").read_text())
        sizes.append((record["depth_factor"], record["metrics"]))
    assert [each[0] for each in sizes] == [1.0, 5.0]
    clouds = [read_ply_points(tmp_path / str(k) / "cloud_after.ply", 10**6) for k in range(2)]
    assert np.ptp(clouds[1], axis=0) == pytest.approx(np.ptp(clouds[0], axis=0), abs=0.1)


@pytest.mark.slow
def test_arrays_of_millimetres_are_tried_as_such(truth):
    """Nothing at 2,000 m is looked at, so no motion tells: sizes say what to try, and motions confirm it."""
    scan = replace(truth.scan, files=LongDepth(truth.scan.files, 1000.0), depth_read_in_m=1.0)
    seen = planfit.extract_observations(scan)
    assert seen.depth_unit == DepthUnit(0.001)
    assert seen.tracking is not None
    assert seen.tracking.is_confirmed


def unit_found(truth, metres, depth_m, height_m, read_in_m=1e-3):
    """By a tracker whose poses are in units of so many metres, as depth of these sizes shows it."""
    scan = replace(truth.scan, depth_read_in_m=read_in_m)
    fit = ConventionFit(f"unit:{metres}", 0.9, "recorded", 0.0, 100, 5.0)
    tracking = replace(believe_all(truth), convention=fit.name, convention_fit=fit)
    return unit_by_motion(scan, tracking, Sizes(depth_m, height_m))


def believe_all(truth):
    return believe(truth.scan.world_from_cams, "recorded", OdometryOptions())


MM, TUM = 1e-3, 1 / 5000


@pytest.mark.parametrize(
    ("metres", "depth_m", "height_m", "read_in_m", "unit"),
    [
        (0.2, 0.5, 0.25, TUM, DepthUnit(5.0)),
        (0.204, 0.5, 0.25, TUM, DepthUnit(5.0)),
        # A hall: the camera's height over the floor tells what its size does not.
        (0.2, 1.3, 0.3, TUM, DepthUnit(5.0)),
        (0.2, 1.3, None, TUM, DepthUnit(rival=5.0)),
        (5.0, 12.0, 7.5, MM, DepthUnit(0.2)),
        # Rooms are as large as they should be, and would be halls of giants.
        (0.2, 8.0, 1.5, TUM, DepthUnit()),
        # No two units have that ratio; or none with the one that depth is read in.
        (0.5, 0.9, 0.7, MM, DepthUnit()),
        (0.1, 0.3, 0.2, MM, DepthUnit()),
        (0.2, 0.5, 0.25, MM, DepthUnit()),
        # Two units have it, and either size is usual.
        (0.8, 2.5, 1.3, TUM, DepthUnit(rival=1.25)),
        # The unit is stated.
        (0.2, 0.5, 0.25, None, DepthUnit()),
    ],
)
def test_ratio_and_sizes_tell_whose_unit_is_wrong(
    truth, metres, depth_m, height_m, read_in_m, unit
):
    found = unit_found(truth, metres, depth_m, height_m, read_in_m)
    assert found.factor == pytest.approx(unit.factor)
    assert found.rival == pytest.approx(unit.rival)


@pytest.mark.parametrize(
    ("room_m", "unit"),
    [
        # 1/4000 read as 1/5000 m: a flat and a tall cellar are told apart, not two rooms of usual height.
        (2.04, DepthUnit(1.25)),
        (2.5, DepthUnit(rival=1.25)),
        (2.3, DepthUnit(rival=1.25)),
        # Too low for any room in both.
        (0.9, DepthUnit(rival=1.25)),
    ],
)
def test_clear_heights_of_rooms_tell_units_that_are_near_each_other(truth, room_m, unit):
    fit = ConventionFit("unit:0.8", 0.9, "recorded", 0.0, 100, 5.0)
    tracking = replace(believe_all(truth), convention=fit.name, convention_fit=fit)
    scan = replace(truth.scan, depth_read_in_m=TUM)
    found = unit_by_motion(scan, tracking, Sizes(2.4, 1.04, room_m))
    assert (found.factor, found.rival) == pytest.approx((unit.factor, unit.rival))


@pytest.mark.parametrize("height_m", [2.4, 3.2])
@pytest.mark.parametrize("factor", [1.0, 5.0])
def test_heights_of_a_room_over_its_floor(height_m, factor):
    table = ((2.0, 1.0, 0.0), (3.0, 2.0, 0.7))
    views = np.stack([look([0.5, 2, 1.4], 40 - 10 * i) for i in range(9)])
    scan = room_scan(views, size_m=(6.0, 4.0, height_m), boxes=(table,))
    scan = replace(scan, files=LongDepth(scan.files, factor), depth_read_in_m=MM)
    found = Sizes.of(scan)
    assert found.camera_height_m == pytest.approx(factor * 1.4, rel=0.03)
    assert found.room_height_m == pytest.approx(factor * height_m, rel=0.03)
    assert Sizes.of(replace(scan, depth_read_in_m=None)) == Sizes(None, None)


@pytest.mark.slow
@pytest.mark.parametrize("is_depth_wrong", [True, False])
def test_a_plan_in_metres_tells_what_sizes_cannot(truth, is_depth_wrong):
    """Depth of 1/4000 m read as 1/5000, or poses in units of 0.8 m: both as unusual, and equal but for the
    plan."""
    if is_depth_wrong:
        scan = replace(truth.scan, files=LongDepth(truth.scan.files, 0.8))
    else:
        poses = truth.scan.world_from_cams
        long = se3.make_transform(poses[:, :3, :3], 1.25 * poses[:, :3, 3])
        scan = replace(truth.scan, world_from_cams=long)
    scan = replace(scan, depth_read_in_m=TUM)
    found = planfit.refine(scan, truth.floorplan)
    assert found.depth_unit == DepthUnit(1.25 if is_depth_wrong else 1.0)
    assert found.tracking is not None
    assert found.tracking.metres_per_unit == pytest.approx(1.0 if is_depth_wrong else 0.8, 0.02)
    right = planfit.refine(truth.scan, truth.floorplan)
    assert error_m(found, truth) < error_m(right, truth) + 0.005


def test_what_nothing_tells_is_asked_for(truth):
    scan = replace(truth.scan, files=LongDepth(truth.scan.files, 0.8), depth_read_in_m=TUM)
    with pytest.raises(ScanError, match=r"--depth-scale .* 1\.25 .* --poses-convention unit:0\.8"):
        planfit.refine(scan, replace(truth.floorplan, is_metric=False))


def test_a_unit_that_the_user_named_is_not_doubted(truth):
    fit = ConventionFit("unit:0.2", 0.9, "unit:0.2", 0.9, 100, 0.0)
    tracking = replace(believe_all(truth), convention="unit:0.2", convention_fit=fit)
    scan = replace(truth.scan, depth_read_in_m=TUM)
    assert unit_by_motion(scan, tracking, Sizes(0.5, 0.25)) == DepthUnit()

"""Poses in a unit of their own, and depth in a wrong one, through `planfit.refine` as a whole."""

from dataclasses import dataclass, replace

import pytest

import planfit
from planfit.errors import ScanError
from planfit.evaluation import position_errors
from planfit.findings import PoseKind, ScanKind
from planfit.geometry import se3
from planfit.scan import ScanFiles
from planfit.synth import BuildingOptions, CameraOptions, DriftOptions, SynthOptions, WalkOptions
from planfit.synth import make_scan as synthesise

FACTOR = 1.5
"""By which something is off."""


@pytest.fixture(scope="module")
def truth():
    return synthesise(
        SynthOptions(
            seed=5,
            building=BuildingOptions(n_rooms=3),
            walk=WalkOptions(n_frames=60),
            camera=CameraOptions(width_px=160, height_px=120),
            drift=DriftOptions(yaw_deg=0.5, translation_m=0.03),
        )
    )


@dataclass(frozen=True)
class LongDepth:
    """Images whose depth is too long."""

    files: ScanFiles

    def color(self, i):
        return self.files.color(i)

    def depth(self, i):
        return FACTOR * self.files.depth(i)

    def labels(self, i):
        return self.files.labels(i)

    def write_poses(self, directory, world_from_cams, frame_idx=None):
        raise NotImplementedError


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

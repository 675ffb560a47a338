"""Scans of many frames: keyframes alone are opened, all frames get poses, sentences speak of all frames."""

import dataclasses
from collections import Counter

import numpy as np
import pytest

import planfit
from planfit.geometry import se3
from planfit.runtime import Runtime
from planfit.scan.views import FilesView
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    DriftOptions,
    SynthOptions,
    WalkOptions,
    make_scan,
)
from planfit.tracking import KeyframeOptions

KEYS = planfit.RefineOptions(keyframes=KeyframeOptions(min_frames=0, max_rotation_deg=15.0))


@dataclasses.dataclass(frozen=True)
class Counted(FilesView):
    """Files that count how often each colour image is opened."""

    opened: Counter

    def color(self, frame_idx):
        self.opened[frame_idx] += 1
        return super().color(frame_idx)

    def depth(self, frame_idx):
        self.opened[frame_idx] += 0  # an entry, whatever the number
        return super().depth(frame_idx)


@pytest.fixture(scope="module")
def dense():
    return make_scan(
        SynthOptions(
            seed=4,
            building=BuildingOptions(n_rooms=2),
            walk=WalkOptions(n_frames=240),
            camera=CameraOptions(width_px=240, height_px=180),
            drift=DriftOptions(yaw_deg=0.08, translation_m=0.006),
        )
    )


@pytest.fixture(scope="module")
def runtime():
    return Runtime(2)


def errors_m(poses, truth):
    return np.linalg.norm(poses[:, :3, 3] - truth[:, :3, 3], axis=1)


def rms(poses, truth):
    return float(np.sqrt(np.mean(errors_m(poses, truth) ** 2)))


def counted(dense, world_from_cams=None):
    opened = Counter()
    scan = dense.scan
    poses = scan.world_from_cams if world_from_cams is None else world_from_cams
    return dataclasses.replace(
        scan, files=Counted(scan.files, opened), world_from_cams=poses
    ), opened


@pytest.mark.slow
def test_only_keyframes_are_opened_and_all_frames_get_poses(dense, runtime):
    scan, opened = counted(dense)
    result = planfit.refine(scan, dense.floorplan, KEYS, runtime)
    keys = result.solved_frame_idx
    # Nine frames over the whole scan tell how far depth reaches, and so its unit.
    of_unit = set(opened) - set(keys.tolist())
    assert set(keys.tolist()) <= set(opened)
    assert len(of_unit) <= 9
    assert {opened[frame] for frame in keys.tolist()} <= {1, 2}
    assert len(keys) < 0.6 * len(scan)
    truth = dense.true_world_from_cams
    assert rms(scan.world_from_cams, truth) > 0.04
    assert rms(result.world_from_cams, truth) < 0.02
    between = np.setdiff1d(np.arange(len(scan)), keys)
    at_keys = rms(result.world_from_cams[keys], truth[keys])
    assert rms(result.world_from_cams[between], truth[between]) < 1.2 * at_keys + 0.002
    assert result.verdict.outcome == "refined"


@pytest.fixture(scope="module")
def seen(dense, runtime):
    return planfit.extract_observations(dense.scan, KEYS, runtime)


def test_what_is_seen_is_numbered_by_the_whole_scan(dense, seen):
    keys, n = seen.keyframe_idx, len(dense.scan)
    structure = seen.structure
    assert len(structure.floor.start) == len(structure.ceiling.start) == n + 1
    assert len(structure.floor_heights_m) == n
    for numbers in (
        seen.matches.pairs,
        structure.walls.frame_idx,
        structure.floor.frame_idx,
        structure.unassigned_frame_idx,
    ):
        assert len(numbers)
        assert np.isin(numbers, keys).all()
    # Matched points coincide where the truth puts their frames.
    truth = dense.true_plan_from_cams
    i, j = np.repeat(seen.matches.pairs, np.diff(seen.matches.start), axis=0).T
    apart = np.linalg.norm(
        se3.transform_each(truth[i], seen.matches.points_a)
        - se3.transform_each(truth[j], seen.matches.points_b),
        axis=1,
    )
    assert np.median(apart) < 0.03
    floor = se3.transform_each(truth[structure.floor.frame_idx], structure.floor.points_cam)
    assert np.median(np.abs(floor[:, 2])) < 0.02
    assert seen.matches.n_loops(4, keys) < seen.matches.n_loops(4)


@pytest.mark.slow
def test_a_jump_is_found_at_its_frame_and_mended(dense, seen, runtime):
    jump = se3.yaw_transform(np.deg2rad(25.0), np.array([2.0, 1.0, 0.0]))
    poses = dense.scan.world_from_cams.copy()
    poses[150:] = jump @ poses[150:]
    scan, opened = counted(dense, poses)
    tracking = planfit.extract_observations(scan, KEYS, runtime).tracking
    (found,) = tracking.breaks
    assert (found.first_frame, found.last_frame) == (149, 150)
    assert found.finding.frames == ((149, 150),)
    about = set(range(140, 160))  # frames there are looked at besides
    assert len(about & set(opened)) > len(about & set(seen.keyframe_idx.tolist())) + 2
    assert errors_m(tracking.world_from_cams, dense.scan.world_from_cams).max() < 0.1


@pytest.mark.slow
def test_frames_whose_pose_froze_are_placed_by_their_images(dense, runtime):
    poses = dense.scan.world_from_cams.copy()
    poses[100:112] = poses[100]
    scan, opened = counted(dense, poses)
    tracking = planfit.extract_observations(scan, KEYS, runtime).tracking
    assert set(range(92, 120)) <= set(opened)
    assert [b.kind for b in tracking.breaks] == ["frozen"]
    away = errors_m(poses, dense.scan.world_from_cams)
    assert away[100:112].max() > 0.15
    assert errors_m(tracking.world_from_cams, dense.scan.world_from_cams).max() < 0.1


def test_own_matches_may_be_of_any_frames(dense, runtime):
    pairs = np.array([[3, 7]] * 6)
    points = np.random.default_rng(0).uniform(1, 3, (6, 3))
    own = planfit.Matches.from_arrays(pairs, points, points, 0.02)
    seen = planfit.extract_observations(dense.scan, KEYS, runtime, own)
    assert seen.keyframe_idx is None
    assert seen.matches is own

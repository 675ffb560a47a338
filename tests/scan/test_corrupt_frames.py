"""A frame that cannot be decoded takes no part, and the rest of the run does not mind."""

from dataclasses import replace

import numpy as np
import pytest

import planfit
from builders import position_rms_m
from planfit.errors import ScanError
from planfit.scan import corrupt_frames
from planfit.scan.views import TolerantFiles, select_frames, tolerate_corrupt_frames
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    DriftOptions,
    SynthOptions,
    WalkOptions,
    make_scan,
)

BROKEN = (5, 13)


class Spoiled:
    """Files of a scan, two frames of which cannot be decoded."""

    def __init__(self, files):
        self._files = files

    def color(self, frame_idx):
        if frame_idx in BROKEN:
            raise ScanError(f"frame-{frame_idx}.jpg: cannot be decoded")
        return self._files.color(frame_idx)

    def depth(self, frame_idx):
        if frame_idx in BROKEN:
            raise ScanError(f"depth-{frame_idx}.png: cannot be decoded")
        return self._files.depth(frame_idx)

    def labels(self, frame_idx):
        return self._files.labels(frame_idx)

    def write_poses(self, _, __, ___=None):
        raise AssertionError("not asked for")


@pytest.fixture(scope="module")
def synthetic():
    return make_scan(
        SynthOptions(
            seed=3,
            building=BuildingOptions(n_rooms=2),
            walk=WalkOptions(n_frames=24),
            camera=CameraOptions(width_px=160, height_px=120),
            drift=DriftOptions(yaw_deg=0.3, translation_m=0.02),
            has_labels=False,
        )
    )


def test_refinement_goes_on_without_the_frame(synthetic) -> None:
    scan = synthetic.scan
    files = TolerantFiles(Spoiled(scan.files), scan.cameras, max_corrupt=len(BROKEN))
    spoiled = replace(scan, files=files, fingerprint="")
    assert corrupt_frames(spoiled) == {}
    result = planfit.refine(spoiled, synthetic.floorplan)
    assert list(corrupt_frames(spoiled)) == [scan.frame_ids[i] for i in BROKEN]
    assert not set(BROKEN) & set(np.unique(result.matches.pairs))
    true = synthetic.true_world_from_cams
    # The frames without images move with their neighbours.
    assert position_rms_m(result.world_from_cams, true) < position_rms_m(scan.world_from_cams, true)
    gap = np.linalg.norm(result.world_from_cams[:, :3, 3] - true[:, :3, 3], axis=1)
    others = np.setdiff1d(np.arange(len(gap)), BROKEN)
    assert gap[list(BROKEN)].max() < 1.5 * gap[others].max()


def test_more_than_one_in_a_hundred_is_an_error(synthetic) -> None:
    scan = replace(synthetic.scan, files=Spoiled(synthetic.scan.files))
    with pytest.raises(ScanError, match=r"depth-5\.png: cannot be decoded"):
        tolerate_corrupt_frames(scan).files.depth(5)


def test_corrupt_frames_keep_their_names_where_frames_are_selected(synthetic) -> None:
    scan = synthetic.scan
    files = TolerantFiles(Spoiled(scan.files), scan.cameras, max_corrupt=len(BROKEN))
    chosen = np.array([3, BROKEN[1], 7])
    some = select_frames(replace(scan, files=files), chosen, scan.world_from_cams[chosen])
    assert np.isnan(some.files.depth(1)).all()
    assert corrupt_frames(some) == {scan.frame_ids[BROKEN[1]]: "depth-13.png: cannot be decoded"}


def test_selected_frames_keep_their_own_images(synthetic) -> None:
    scan = synthetic.scan
    chosen = select_frames(scan, np.array([3, 7]), scan.world_from_cams[[3, 7]])
    np.testing.assert_array_equal(chosen.files.depth(1), scan.files.depth(7))
    assert chosen.frame_ids == (scan.frame_ids[3], scan.frame_ids[7])
    assert chosen.timestamps.tolist() == scan.timestamps[[3, 7]].tolist()

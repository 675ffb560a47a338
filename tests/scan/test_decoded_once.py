"""Images that are decoded once in a run: the same ones, within a limit, and gone with it."""

import signal
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from builders import NoFiles, look, room_scan
from planfit.errors import ScanError
from planfit.geometry.calibration import SensorCalibration
from planfit.scan import calibrated_scan, corrupt_frames
from planfit.scan.views import decoded_once, tolerate_corrupt_frames

POSES = np.stack([look([2, 2, 1.5], yaw) for yaw in (0, 30, 60)])
N_BYTES = 4 * 6 * 4
"""Of a depth image."""


class Counted(NoFiles):
    """Images that tell their frame, and what of them was decoded; the last frame has no colour."""

    def __init__(self):
        self.decoded = []

    def color(self, i):
        self.decoded.append(("color", i))
        return None if i == 2 else np.full((4, 6, 3), i, dtype=np.uint8)[:, ::-1]

    def depth(self, i):
        self.decoded.append(("depth", i))
        depth = np.full((4, 6), i, dtype=np.float32)
        depth[0, i] = np.nan
        return depth


@pytest.fixture
def scan():
    return replace(room_scan(POSES), files=Counted())


def depths_are_right(scan):
    for i in range(len(scan)):
        depth = scan.files.depth(i)
        assert_array_equal(depth, Counted().depth(i), strict=True)
        depth[:] = 77  # the next who asks gets another one


def test_images_are_decoded_once_while_the_context_lasts(scan):
    with decoded_once([scan]) as (kept,):
        for _ in range(3):
            depths_are_right(kept)
            assert_array_equal(kept.files.color(1), Counted().color(1), strict=True)
        assert sorted(scan.files.decoded) == [("color", 1), *(("depth", i) for i in range(3))]
        assert kept.files.color(2) is None
    depths_are_right(kept)
    assert len(scan.files.decoded) == 4 + 1 + 3


def test_poses_stay_as_they_are_to_the_bit(scan):
    with decoded_once([scan]) as (kept,):
        assert kept.world_from_cams is scan.world_from_cams


def test_scans_are_kept_apart(scan):
    other = replace(scan, files=Counted())
    with decoded_once([scan, other]) as kept:
        for one in kept:
            depths_are_right(one)
    assert len(scan.files.decoded) == len(other.files.decoded) == 3


def test_threads_get_the_same_images(scan):
    with decoded_once([scan]) as (kept,), ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda k: kept.files.depth(k % 3), range(300)))
    for k, depth in enumerate(found):
        assert_array_equal(depth, Counted().depth(k % 3))


def test_no_more_is_kept_than_the_limit(scan, monkeypatch):
    monkeypatch.setattr("planfit.scan.views.MAX_KEPT_BYTES", 2 * N_BYTES)
    with decoded_once([scan]) as (kept,):
        depths_are_right(kept)
        depths_are_right(kept)
    assert scan.files.decoded == [("depth", i) for i in (0, 1, 2, 2)]


@pytest.mark.parametrize("max_bytes", [0, 1.5 * N_BYTES])
def test_a_full_disk_is_no_error(scan, max_bytes):
    resource = pytest.importorskip("resource", reason="limits of files are those of Unix")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    with decoded_once([scan]) as (kept,):
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(max_bytes), limits[1]))
        try:
            depths_are_right(kept)
            depths_are_right(kept)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
            signal.signal(signal.SIGXFSZ, handler)
    assert len(scan.files.decoded) == (5 if max_bytes else 6)


@pytest.mark.parametrize("error", [ScanError("frame"), KeyboardInterrupt()])
def test_nothing_is_left(scan, tmp_path, monkeypatch, error):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def stopped():
        with decoded_once([scan]) as (kept,):
            depths_are_right(kept)
            raise error

    with pytest.raises(type(error)):
        stopped()
    assert not list(tmp_path.iterdir())


def test_corrupt_frames_are_told_through_it(scan):
    class Broken(Counted):
        def depth(self, i):
            raise ScanError(f"frame {i}: broken")

    poses = np.repeat(POSES, 40, axis=0)
    with decoded_once([tolerate_corrupt_frames(replace(room_scan(poses), files=Broken()))]) as (
        kept,
    ):
        corrected = calibrated_scan(kept, SensorCalibration(depth_scale=0.98))
        assert np.isnan(corrected.files.depth(5)).all()
        assert list(corrupt_frames(corrected).values()) == ["frame 5: broken"]

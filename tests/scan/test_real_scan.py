"""The real scan in the FACaP layout: conventions that only real files can settle."""

import os
from pathlib import Path

import numpy as np
import pytest

from planfit.evaluation import associate_times, position_errors
from planfit.floorplan import read_floorplan
from planfit.geometry import se3
from planfit.scan import Label, read_scan, read_tum
from planfit.scan.formats.facap import PLAN_FROM_WORLD

DATA = Path(os.environ.get("PLANFIT_SHARED", Path(__file__).parents[2].parent / "shared" / "data"))

pytestmark = [
    pytest.mark.shared,
    pytest.mark.skipif(
        not (DATA / "conslam").is_dir(), reason="no real scan: set PLANFIT_SHARED to its folder"
    ),
]


@pytest.fixture(scope="module")
def scan():
    return read_scan(DATA / "conslam")


def test_it_is_read_whole(scan):
    assert len(scan) == 249
    assert scan.has_labels
    assert scan.floorplan_path is not None
    assert scan.files.color(0).shape[:2] == scan.files.depth(0).shape


def test_masks_and_axes_fit_the_depth(scan):
    # y is up with the floor near zero, and no other way to turn the masks makes the floor so flat.
    for i in (0, 60, 120, 180):
        labels, depth = scan.files.labels(i), scan.files.depth(i)
        points = scan.cameras[i].lift_image(depth).reshape(-1, 3)
        height = se3.transform(scan.world_from_cams[i], points)[:, 1].reshape(labels.shape)

        def floor(turned, height=height):
            found = height[(turned == Label.FLOOR) & np.isfinite(height)]
            return np.median(found), np.median(np.abs(found - np.median(found)))

        middle, scatter = floor(labels)
        assert abs(middle) < 0.25
        assert scatter < 0.2
        for other in (labels[::-1, ::-1], labels[:, ::-1], labels[::-1]):
            assert scatter < floor(other)[1]
        assert np.median(height[(labels == Label.WALL) & np.isfinite(height)]) > 1.0


def test_the_truth_is_in_the_plans_frame(scan):
    times, plan_from_cams = read_tum(DATA / "conslam" / "groundtruth.tum")
    mine, true = associate_times(scan.timestamps, times)
    recorded = PLAN_FROM_WORLD @ scan.world_from_cams[mine]
    errors = [position_errors(recorded, frame[true]) for frame in (
        plan_from_cams, PLAN_FROM_WORLD @ plan_from_cams)]  # fmt: skip
    assert min(e.rms_m for e in errors) == pytest.approx(1.11, abs=0.05)


def test_its_plan_is_read_in_metres_with_two_faced_walls(scan):
    plan = read_floorplan(scan.floorplan_path)
    assert 40 < max(plan.size) < 120
    assert plan.is_oriented.mean() > 0.5


def test_the_kitchen_is_read_as_published():
    kitchen = read_scan(DATA / "kitchen")
    assert kitchen.format == "7-scenes"
    assert kitchen.skipped == kitchen.warnings == ()
    numbers = np.array([int(frame_id) for frame_id in kitchen.frame_ids])
    assert np.all(np.diff(numbers) == 4)
    assert kitchen.cameras[0].fx == kitchen.cameras[0].fy == 525  # the colour camera's
    assert kitchen.files.color(0).shape == (480, 640, 3)
    # Frames that follow each other see the same surfaces where their poses say: axes and unit are right.
    near, far = kitchen.world_from_cams[0], kitchen.world_from_cams[3]
    depth = kitchen.files.depth(3)
    rows, columns = np.mgrid[20:460:20, 20:620:20]
    at = depth[rows, columns]
    uv = np.stack([columns, rows], axis=-1)[np.isfinite(at)].astype(float)
    points = kitchen.cameras[3].lift(uv, at[np.isfinite(at)])
    seen = se3.transform(se3.inverse(near) @ far, points)
    place = np.rint(kitchen.cameras[0].project(seen)).astype(int)
    inside = ((place >= 0) & (place < (640, 480))).all(axis=1)
    other = kitchen.files.depth(0)[place[inside, 1], place[inside, 0]]
    gap = np.abs(other - seen[inside, 2])
    assert np.nanmedian(gap) < 0.02

"""A scan checks itself when made."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import CAMERA, random_transforms
from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan import Scan
from planfit.scan.poses import MAX_ROTATION_DEFECT, check_pose


class NoFiles:
    """Nobody asks for images here."""

    def color(self, frame_idx):
        raise AssertionError("not asked for")

    depth = labels = write_poses = color


def made(poses, n=None, **changes):
    n = len(poses) if n is None else n
    fields = {
        "name": "made up",
        "frame_ids": tuple(str(i) for i in range(n)),
        "timestamps": np.arange(n, dtype=float),
        "cameras": (CAMERA,) * n,
        "world_from_cams": poses,
        "files": NoFiles(),
    }
    return Scan(**(fields | changes))


def test_length_is_the_number_of_frames(rng):
    assert len(made(random_transforms(rng, 5))) == 5


def test_no_frames():
    with pytest.raises(ScanError, match=r"made up.*none"):
        made(np.zeros((0, 4, 4)))


def test_poses_of_the_wrong_shape(rng):
    with pytest.raises(ScanError, match=r"made up.*\(3, 4, 4\)"):
        made(random_transforms(rng, 2), n=3)
    with pytest.raises(ScanError, match=r"\(2, 3, 4\)"):
        made(random_transforms(rng, 2)[:, :3])


@pytest.mark.parametrize("change", [{"cameras": (CAMERA,)}, {"timestamps": np.zeros(3)}])
def test_cameras_and_times_of_the_wrong_number(rng, change):
    with pytest.raises(ScanError, match="2 cameras and timestamps"):
        made(random_transforms(rng, 2), **change)


def test_rounding_is_projected_away_and_the_input_left_alone(rng):
    poses = random_transforms(rng, 3)
    rounded = np.round(poses, 3)
    copy = rounded.copy()
    scan = made(rounded)
    assert np.array_equal(rounded, copy)
    rotation = scan.world_from_cams[:, :3, :3]
    assert_allclose(
        np.swapaxes(rotation, 1, 2) @ rotation, np.tile(np.eye(3), (3, 1, 1)), atol=1e-12
    )
    assert_allclose(scan.world_from_cams, poses, atol=2e-3)


def test_the_message_names_scan_and_frame(rng):
    poses = random_transforms(rng, 3)
    poses[1, :3, :3] *= 1.1
    with pytest.raises(ScanError, match=r"made up: frame 1.*rotation"):
        made(poses)


def test_the_allowed_defect_is_where_it_says():
    for factor, is_fine in ((0.45, True), (0.55, False)):
        pose = se3.make_transform((1 + factor * MAX_ROTATION_DEFECT) * np.eye(3), np.zeros(3))
        if is_fine:
            check_pose(pose, "here")
        else:
            with pytest.raises(ScanError, match="here: expected a rotation"):
                check_pose(pose, "here")

"""Which points a map is judged by."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import CAMERA, NoFiles, random_transforms
from planfit.errors import OptionError
from planfit.evaluation import MapOptions, MapSample, sample_depth_maps
from planfit.evaluation.map_quality import thin
from planfit.geometry import se3
from planfit.runtime import Runtime
from planfit.scan import Scan


class Depths(NoFiles):
    """Depth maps from memory."""

    def __init__(self, maps):
        self.maps = maps

    def depth(self, frame_idx):
        return self.maps[frame_idx]


def scan_of(maps):
    n = len(maps)
    return Scan("memory", tuple(map(str, range(n))), np.arange(float(n)), (CAMERA,) * n,
                np.tile(np.eye(4), (n, 1, 1)), Depths(maps))  # fmt: skip


def slow_thin(points, voxel_m):
    cubes = {}
    for point in points:
        cubes.setdefault(tuple(np.floor(point / voxel_m).astype(int)), []).append(point)
    return np.array([np.mean(cubes[cube], axis=0) for cube in sorted(cubes)])


@pytest.mark.parametrize("voxel_m", [0.01, 0.1, 5.0])
def test_one_point_a_cube_their_mean(rng, voxel_m):
    points = rng.uniform(-0.5, 0.7, (400, 3))
    assert_allclose(thin(points, voxel_m), slow_thin(points, voxel_m), atol=1e-12)
    assert len(thin(np.zeros((0, 3)), voxel_m)) == 0


def flat_maps(n=4, depth_m=2.0):
    maps = np.full((n, CAMERA.height, CAMERA.width), depth_m, dtype=np.float32)
    maps[:, :20] = np.nan
    return list(maps)


def test_points_lie_where_the_depth_says_and_nothing_without_a_measurement():
    maps = flat_maps()
    maps[2][:] = np.nan
    sample = sample_depth_maps(scan_of(maps), MapOptions(voxel_m=0.05), Runtime(1))
    assert len(sample.of_frame(2)) == 0
    points = sample.of_frame(1)
    assert_allclose(points[:, 2], 2.0)
    top = (20 - CAMERA.cy) / CAMERA.fy * 2.0
    assert points[:, 1].min() == pytest.approx(top, abs=0.05)
    area = np.prod(np.ptp(points[:, :2], axis=0))
    assert len(points) == pytest.approx(area / 0.05**2, rel=0.1)


def test_each_option_does_what_it_says():
    maps = flat_maps()
    maps[0][60:] = 5.0
    scan, runtime = scan_of(maps), Runtime(1)

    def sizes(**options):
        return np.diff(sample_depth_maps(scan, MapOptions(**options), runtime).start)

    every = sizes()
    assert np.all(every > 0)
    assert_array_equal(sizes(frame_step=3) > 0, [True, False, False, True])
    assert sizes(max_depth_m=4.0)[0] < every[0]
    assert sizes(max_depth_m=1.0).sum() == 0
    assert sizes(voxel_m=0.1)[1] == pytest.approx(every[1] / 4, rel=0.15)
    # One pixel in two, each way.
    assert sizes(voxel_m=0.001)[1] == (CAMERA.height // 2 - 10) * CAMERA.width // 2
    with pytest.raises(OptionError, match=r"MapOptions.voxel_m: expected a number above 0"):
        MapOptions(voxel_m=0.0)


def test_every_frame_by_its_own_pose(rng):
    poses = random_transforms(rng, 3)
    sample = MapSample(rng.normal(size=(9, 3)).astype(np.float32), np.array([0, 4, 4, 9]))
    placed = sample.at(poses)
    assert_allclose(placed[:4], se3.transform(poses[0], sample.points_cam[:4]))
    assert_allclose(placed[4:], se3.transform(poses[2], sample.points_cam[4:]))

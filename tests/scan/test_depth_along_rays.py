"""Depth that was measured along each pixel's ray, as renderers give it, is put along the axis."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import look, room_scan
from planfit.scan import read_scan, scan_from_arrays
from planfit.scan.views import select_frames
from scan_samples import write_tum

VIEWS = np.stack([look([2 + 0.2 * i, 1.5 + 0.1 * i, 1.4], 40 * i, 10) for i in range(9)])


def ray_lengths(camera, shape) -> np.ndarray:
    v, u = np.indices(shape)
    return np.sqrt(1 + ((u - camera.cx) / camera.fx) ** 2 + ((v - camera.cy) / camera.fy) ** 2)


def given(depths, scan):
    colors = [np.full((*depths[0].shape, 3), 90, np.uint8)] * len(depths)
    return scan_from_arrays(colors, depths, scan.cameras[0], scan.world_from_cams)


@pytest.mark.parametrize("noise_m", [0.0, 0.005])
@pytest.mark.parametrize("factor", [1.0, 5.0])
def test_depth_along_rays_is_put_along_the_axis(noise_m: float, factor: float) -> None:
    scan = room_scan(VIEWS, noise_m=noise_m)
    true = [scan.files.depth(i) for i in range(len(scan))]
    rays = [factor * (d * ray_lengths(scan.cameras[0], d.shape)).astype(np.float32) for d in true]
    found = given(rays, scan)
    assert len([line for line in found.warnings if "each pixel's ray" in line]) == 1
    assert_allclose(found.files.depth(3), factor * true[3], rtol=1e-5)
    # Of a choice of frames too.
    part = select_frames(found, np.array([5, 2]), found.world_from_cams[[5, 2]])
    assert_allclose(part.files.depth(1), factor * true[2], rtol=1e-5)
    plain = given([factor * d for d in true], scan)
    assert not [line for line in plain.warnings if "each pixel's ray" in line]
    assert_allclose(plain.files.depth(3), factor * true[3], rtol=1e-6)


def test_a_scan_of_a_format_along_the_axis_stays_as_it_is(sample, tmp_path) -> None:
    write_tum(tmp_path, sample)
    scan = read_scan(tmp_path)
    assert not [line for line in scan.warnings if "ray" in line]
    assert_allclose(np.nan_to_num(scan.files.depth(1)), sample.depth_mm[1] / 1000, atol=1e-6)


def test_what_is_nowhere_flat_tells_nothing() -> None:
    rng = np.random.default_rng(2)
    scan = room_scan(VIEWS)
    rough = [rng.uniform(1, 4, scan.files.depth(i).shape).astype(np.float32) for i in range(9)]
    assert not [line for line in given(rough, scan).warnings if "ray" in line]

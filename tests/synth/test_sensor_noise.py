"""Depth noise on a flat wall with a step in it, whose true depth the test knows."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.errors import OptionError
from planfit.synth import (
    CameraOptions,
    NoDepthNoise,
    StructuredLightNoise,
    TimeOfFlightNoise,
    noisy_depth,
)
from planfit.synth.sensor_noise import noisy_color

SHAPE = (240, 320)
FACING = np.ones(SHAPE, dtype=np.float32)
CALM_LIGHT = StructuredLightNoise(disparity_step_px=0.0, drop_share=0.0)
CALM_TIME = TimeOfFlightNoise(step_m=0.0, drop_share=0.0, bias=0.0)


def wall(z):
    return np.full(SHAPE, z, dtype=np.float32)


def step(near, far):
    depth = wall(near)
    depth[:, 160:] = far
    return depth


def read(depth, noise, incidence=FACING, seed=0):
    return noisy_depth(depth, incidence, noise, np.random.default_rng(seed))


def test_no_noise_changes_nothing():
    assert_array_equal(read(step(1.0, 2.0), NoDepthNoise()), step(1.0, 2.0))


@pytest.mark.parametrize("z", [0.8, 2.0, 4.0])
@pytest.mark.parametrize("correlation_px", [0.0, 0.8, 2.0])
def test_structured_light_error_grows_with_the_square(z, correlation_px):
    error = read(wall(z), replace(CALM_LIGHT, correlation_px=correlation_px)) - z
    assert_allclose(np.std(error), 1.4e-3 * z**2, rtol=0.06)
    assert abs(np.mean(error)) < 0.2 * np.std(error)


def test_disparity_is_quantised():
    noise = replace(CALM_LIGHT, disparity_step_px=0.125)
    disparity = 580.0 * 0.075 / read(wall(3.0), noise).astype(float)
    assert_allclose(disparity / 0.125, np.rint(disparity / 0.125), atol=1e-3)


def test_baseline_and_focal_length_set_the_quantum():
    fine = replace(CALM_LIGHT, disparity_step_px=0.125, baseline_m=0.15, focal_px=1160.0)
    coarse = replace(CALM_LIGHT, disparity_step_px=0.125)
    counts = [len(np.unique(read(wall(3.0), noise))) for noise in (fine, coarse)]
    assert counts[0] > 2.5 * counts[1]


@pytest.mark.parametrize("z", [0.8, 2.0, 4.0])
def test_time_of_flight_error_is_as_stated(z):
    error = read(wall(z), CALM_TIME) - z
    assert_allclose(np.std(error), 0.004 + 0.0015 * z**2, rtol=0.06)


def test_time_of_flight_is_quantised():
    values = read(wall(2.0), replace(CALM_TIME, step_m=0.01)).astype(float)
    assert_allclose(values * 100, np.rint(values * 100), atol=1e-4)


def test_multi_path_bias_is_smooth_and_in_proportion():
    noise = replace(CALM_TIME, sigma_m=0.0, sigma_at_1m_m=0.0, bias=0.02)
    error = read(wall(3.0), noise) - 3.0
    assert 0.01 < np.std(error) < 0.15
    assert np.abs(np.diff(error, axis=1)).max() < 0.01
    assert_allclose(read(wall(1.5), noise) - 1.5, error / 2, atol=1e-5)


def test_errors_of_neighbours_are_shared_as_asked():
    def correlation(noise):
        error = read(wall(2.0), noise) - 2.0
        return np.corrcoef(error[:, :-1].ravel(), error[:, 1:].ravel())[0, 1]

    assert abs(correlation(replace(CALM_LIGHT, correlation_px=0.0))) < 0.02
    assert correlation(replace(CALM_LIGHT, correlation_px=1.5)) > 0.8


@pytest.mark.parametrize("noise", [CALM_LIGHT, CALM_TIME])
def test_edges_have_holes_and_the_rest_has_not(noise):
    noise = replace(noise, edge_px=3)
    depth = read(step(1.5, 3.0), noise)
    near_edge = np.zeros(SHAPE, dtype=bool)
    near_edge[:, 157:163] = True
    assert np.isnan(depth[near_edge]).mean() > 0.4
    assert not np.isnan(depth[~near_edge]).any()
    assert not np.isnan(read(step(1.5, 3.0), replace(noise, edge_px=0))).any()


def test_flying_pixels_are_between_near_and_far():
    depth = read(step(1.5, 3.0), replace(CALM_TIME, edge_hole_share=0.0))
    flying = (depth > 1.7) & (depth < 2.7)
    assert flying.sum() > 300
    assert np.abs(np.flatnonzero(flying.any(axis=0)) - 159.5).max() < 3
    holes = read(step(1.5, 3.0), replace(CALM_TIME, edge_hole_share=1.0))
    assert not ((holes > 1.7) & (holes < 2.7)).any()


def test_a_slanted_wall_is_no_edge():
    slanted = np.tile(1.0 / np.linspace(1.0, 0.2, 320, dtype=np.float32), (240, 1))
    assert not np.isnan(read(slanted, CALM_LIGHT)).any()


@pytest.mark.parametrize("noise", [CALM_LIGHT, CALM_TIME])
def test_grazing_surfaces_give_nothing(noise):
    incidence = FACING.copy()
    incidence[:100] = np.cos(np.deg2rad(75.0))
    depth = read(wall(2.0), replace(noise, max_incidence_deg=70.0), incidence)
    assert np.isnan(depth[:100]).all()
    assert not np.isnan(depth[100:]).any()


@pytest.mark.parametrize("noise", [CALM_LIGHT, CALM_TIME])
def test_range_is_limited(noise):
    noise = replace(noise, min_range_m=1.0, max_range_m=3.0, edge_px=0)
    depth = read(step(0.8, 2.0), noise)
    assert np.isnan(depth[:, :160]).all()
    assert not np.isnan(depth[:, 160:]).any()
    assert np.isnan(read(wall(3.5), noise)).all()


@pytest.mark.parametrize("noise", [CALM_LIGHT, CALM_TIME])
def test_share_of_dropped_pixels(noise):
    depth = read(wall(2.0), replace(noise, drop_share=0.1))
    assert_allclose(np.isnan(depth).mean(), 0.1, atol=0.01)


@pytest.mark.parametrize("noise", [StructuredLightNoise(), TimeOfFlightNoise()])
def test_nothing_hit_is_nothing_read(noise):
    depth = wall(2.0)
    depth[:50] = np.nan
    assert np.isnan(read(depth, noise)[:50]).all()


def test_colour_faults_are_as_stated():
    gray = np.full((*SHAPE, 3), 0.4, dtype=np.float32)
    calm = CameraOptions(exposure_std=0.0, noise_levels=0.0, blur_px=0.0)

    def shot(seed, **options):
        return noisy_color(gray, replace(calm, **options), np.random.default_rng(seed)).astype(
            float
        )

    assert np.ptp(shot(0)) == 0
    assert_allclose(np.std(shot(0, noise_levels=3.0)), 3.0, rtol=0.03)
    means = [shot(seed, exposure_std=0.05).mean() for seed in range(100)]
    assert_allclose(np.std(means) / np.mean(means), 0.05 / 1.6, rtol=0.25)
    edge = gray.copy()
    edge[:, 160:] = 0.9
    sharp, soft = (
        noisy_color(edge, replace(calm, blur_px=blur), np.random.default_rng(0)) for blur in (0, 2)
    )
    assert len(np.unique(soft)) > len(np.unique(sharp)) == 2


@pytest.mark.parametrize(
    ("make", "options"),
    [
        (StructuredLightNoise, {"sigma_at_1m_m": -1.0}),
        (StructuredLightNoise, {"max_range_m": 0.1}),
        (StructuredLightNoise, {"baseline_m": 0.0}),
        (TimeOfFlightNoise, {"edge_hole_share": 2.0}),
        (TimeOfFlightNoise, {"drop_share": -0.1}),
        (TimeOfFlightNoise, {"max_incidence_deg": 100.0}),
        (TimeOfFlightNoise, {"bias": -0.1}),
        (CameraOptions, {"fov_deg": 170.0}),
        (CameraOptions, {"width_px": 4}),
        (CameraOptions, {"blur_px": -1.0}),
    ],
)
def test_impossible_options_are_refused(make, options):
    with pytest.raises(OptionError, match=next(iter(options))):
        make(**options)

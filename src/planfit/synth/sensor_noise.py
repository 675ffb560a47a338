"""What sensors make of faultless images and poses: depth noise, exposure, pixel noise; odometry drift."""

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from planfit.geometry import se3
from planfit.priors import DEPTH_EDGE_SHARE
from planfit.synth.options import (
    CameraOptions,
    DepthNoise,
    DriftOptions,
    NoDepthNoise,
    StructuredLightNoise,
    TimeOfFlightNoise,
)

EDGE_SHARE = DEPTH_EDGE_SHARE.value
"""Neighbouring depths that differ by more than this share are a depth edge."""
TILT_SHARE, VERTICAL_SHARE = 0.3, 0.3
"""Error about each horizontal axis as a share of that about the vertical, and along the vertical as a share
of that along the horizontal: gravity is known to a tracker. Measured on ConSLAM at its own frame rate."""


def noisy_depth(
    depth: Float[np.ndarray, "h w"],
    incidence: Float[np.ndarray, "h w"],
    noise: DepthNoise,
    rng: np.random.Generator,
) -> Float[np.ndarray, "h w"]:
    """Depth as a sensor measures it, float32, m, NaN where it measures nothing.

    Args:
        depth: m along the optical axis, NaN where nothing is hit.
        incidence: cosine between ray and surface normal.
        noise: the sensor.
        rng: source of the noise.
    """
    match noise:
        case NoDepthNoise():
            return depth.astype(np.float32)
        case StructuredLightNoise():
            return _structured_light(depth, incidence, noise, rng)
        case TimeOfFlightNoise():
            return _time_of_flight(depth, incidence, noise, rng)


def noisy_color(
    color: Float[np.ndarray, "h w 3"], options: CameraOptions, rng: np.random.Generator
) -> UInt8[np.ndarray, "h w 3"]:
    """Linear colour to an image, RGB."""
    gain = 1.0 + options.exposure_std * float(np.clip(rng.normal(), -2.5, 2.5))
    image = np.clip(color * np.float32(gain), 0.0, 1.0) ** np.float32(1 / 1.6)
    if options.blur_px > 0:
        image = cv2.GaussianBlur(image, (0, 0), options.blur_px)
    levels = image * np.float32(255.0)
    if options.noise_levels > 0:
        grain = rng.standard_normal(levels.shape, dtype=np.float32)
        levels = levels + np.float32(options.noise_levels) * grain
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)


def _structured_light(
    depth: Float[np.ndarray, "h w"],
    incidence: Float[np.ndarray, "h w"],
    noise: StructuredLightNoise,
    rng: np.random.Generator,
) -> Float[np.ndarray, "h w"]:
    is_lost = _lost(depth, incidence, noise, rng)
    is_lost |= _near_edge(depth, noise.edge_px)
    safe = np.where(np.isfinite(depth), depth, 1.0).astype(np.float64)
    # d = f b / z, so an error of s z^2 in depth is one of s f b in disparity, whatever the depth.
    scale = noise.focal_px * noise.baseline_m
    disparity = scale / safe
    disparity += noise.sigma_at_1m_m * scale * _shared_noise(depth.shape, noise.correlation_px, rng)
    if noise.disparity_step_px > 0:
        disparity = np.rint(disparity / noise.disparity_step_px) * noise.disparity_step_px
    is_lost |= disparity <= 0
    read = scale / np.where(disparity > 0, disparity, 1.0)
    return _in_range(read, is_lost, noise)


def _time_of_flight(
    depth: Float[np.ndarray, "h w"],
    incidence: Float[np.ndarray, "h w"],
    noise: TimeOfFlightNoise,
    rng: np.random.Generator,
) -> Float[np.ndarray, "h w"]:
    is_lost = _lost(depth, incidence, noise, rng)
    is_edge = _near_edge(depth, noise.edge_px)
    safe = np.where(np.isfinite(depth), depth, 1.0).astype(np.float32)
    flying = is_edge & (rng.random(depth.shape, dtype=np.float32) >= noise.edge_hole_share)
    is_lost |= is_edge & ~flying
    mixed = safe.astype(np.float64)
    if noise.edge_px > 0:
        kernel = np.ones((2 * noise.edge_px + 1,) * 2, dtype=np.uint8)
        near, far = cv2.erode(safe, kernel), cv2.dilate(safe, kernel)
        share = rng.random(depth.shape, dtype=np.float32)
        mixed = np.where(flying, near + share * (far - near), mixed)
    sigma = noise.sigma_m + noise.sigma_at_1m_m * mixed**2
    read = mixed + sigma * _shared_noise(depth.shape, noise.correlation_px, rng)
    read *= 1.0 + noise.bias * _smooth_field(depth.shape, rng)
    if noise.step_m > 0:
        read = np.rint(read / noise.step_m) * noise.step_m
    return _in_range(read, is_lost, noise)


def _lost(
    depth: Float[np.ndarray, "h w"],
    incidence: Float[np.ndarray, "h w"],
    noise: StructuredLightNoise | TimeOfFlightNoise,
    rng: np.random.Generator,
) -> Bool[np.ndarray, "h w"]:
    """Where there is nothing, where the surface is too flat to the ray, and single pixels."""
    is_grazing = incidence < np.cos(np.deg2rad(noise.max_incidence_deg))
    is_dropped = rng.random(depth.shape, dtype=np.float32) < noise.drop_share
    return np.isnan(depth) | is_grazing | is_dropped


def _near_edge(depth: Float[np.ndarray, "h w"], edge_px: int) -> Bool[np.ndarray, "h w"]:
    if edge_px == 0:
        return np.zeros(depth.shape, dtype=bool)
    safe = np.where(np.isfinite(depth), depth, 0.0).astype(np.float32)
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    near, far = cv2.erode(safe, cross), cv2.dilate(safe, cross)
    # A flat wall seen at a grazing angle has steep depth too: there both neighbours differ by the
    # same amount, and at an edge they do not.
    bend = np.abs(near + far - 2.0 * safe)
    is_edge = (bend > EDGE_SHARE * safe).astype(np.uint8)
    kernel = np.ones((2 * edge_px - 1,) * 2, dtype=np.uint8)
    return cv2.dilate(is_edge, kernel).astype(bool)


def _shared_noise(
    shape: tuple[int, ...], correlation_px: float, rng: np.random.Generator
) -> Float[np.ndarray, "h w"]:
    """Normal noise of unit standard deviation that neighbouring pixels share."""
    white = rng.standard_normal(shape, dtype=np.float32)
    if correlation_px == 0:
        return white
    radius = int(np.ceil(4.0 * correlation_px))
    kernel = cv2.getGaussianKernel(2 * radius + 1, correlation_px, cv2.CV_32F)
    kernel /= np.sqrt(np.sum(kernel**2))
    border = cv2.BORDER_WRAP if min(shape) <= radius else cv2.BORDER_DEFAULT
    return cv2.sepFilter2D(white, -1, kernel, kernel, borderType=border)


def _smooth_field(shape: tuple[int, ...], rng: np.random.Generator) -> Float[np.ndarray, "h w"]:
    """A slow field of about unit standard deviation: four by three free values, interpolated."""
    coarse = rng.standard_normal((3, 4), dtype=np.float32)
    return cv2.resize(coarse, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC)


def _in_range(
    read: Float[np.ndarray, "h w"],
    is_lost: Bool[np.ndarray, "h w"],
    noise: StructuredLightNoise | TimeOfFlightNoise,
) -> Float[np.ndarray, "h w"]:
    is_out = (read < noise.min_range_m) | (read > noise.max_range_m)
    return np.where(is_lost | is_out, np.nan, read).astype(np.float32)


def drift_poses(
    world_from_cams: Float[np.ndarray, "n 4 4"],
    options: DriftOptions,
    rng: np.random.Generator,
    up_world: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "n 4 4"]:
    """Poses as odometry would give them: the first is kept, errors accumulate from there.

    Each motion from a frame to the next is preceded by a small error at the earlier frame: a rotation
    about the vertical and the horizontal axes through the camera, and a translation. The axes are those
    of the true pose, and turn with what has drifted before.

    Args:
        world_from_cams: true poses.
        options: standard deviations of the error of each motion.
        rng: source of the errors.
        up_world: unit direction against gravity.
    """
    n = len(world_from_cams)
    axes = se3.rotation_between(np.array([0.0, 0.0, 1.0]), np.asarray(up_world, dtype=float))
    sigma_rotation = np.deg2rad(options.yaw_deg) * np.array([TILT_SHARE, TILT_SHARE, 1.0])
    sigma_translation = options.translation_m * np.array([1.0, 1.0, VERTICAL_SHARE])
    rotation = rng.normal(size=(n - 1, 3)) * sigma_rotation
    translation = rng.normal(size=(n - 1, 3)) * sigma_translation
    if options.jumps_per_100_frames > 0:
        jumps = rng.random(n - 1) < options.jumps_per_100_frames / 100
        rotation[jumps, 2] += rng.normal(size=jumps.sum()) * np.deg2rad(options.jump_yaw_deg)
        translation[jumps, :2] += rng.normal(size=(jumps.sum(), 2)) * options.jump_m
    rotations, translations = se3.exp_so3(rotation @ axes.T), translation @ axes.T
    centres = world_from_cams[:-1, :3, 3]
    about_camera = centres - (rotations @ centres[..., None])[..., 0]
    errors = se3.make_transform(rotations, about_camera + translations)
    result = np.zeros_like(world_from_cams)
    drifted_from_true = np.eye(4)
    result[0] = world_from_cams[0]
    for i in range(1, n):
        drifted_from_true = drifted_from_true @ errors[i - 1]
        result[i] = drifted_from_true @ world_from_cams[i]
    result[:, :3, :3] = se3.project_to_so3(result[:, :3, :3])
    result[0] = world_from_cams[0]
    return result

"""Hashed noise in two dimensions, as numba kernels: the raw stuff of all textures.

All of it is a pure function of place and seed, so a surface looks the same from everywhere.
"""

import math

import numpy as np

from planfit.compiled import kernel

_A = np.uint64(0x9E3779B97F4A7C15)
_B = np.uint64(0xC2B2AE3D27D4EB4F)
_C = np.uint64(0xD6E8FEB86659FD93)
_SHIFT = np.uint64(32)
_TO_UNIT = 1.0 / 2.0**64


@kernel
def hashed(i: int, j: int, seed: np.uint64) -> float:
    """A number in [0, 1) for each integer cell and seed."""
    h = seed ^ (np.uint64(i) * _A) ^ (np.uint64(j) * _B)
    h = (h ^ (h >> _SHIFT)) * _C
    h = (h ^ (h >> _SHIFT)) * _C
    h = h ^ (h >> _SHIFT)
    return h * _TO_UNIT


@kernel
def value_noise(u: float, v: float, seed: np.uint64) -> float:
    """Smooth noise in [-1, 1] with one feature per unit."""
    i, j = math.floor(u), math.floor(v)
    fu, fv = u - i, v - j
    su, sv = fu * fu * (3.0 - 2.0 * fu), fv * fv * (3.0 - 2.0 * fv)
    a, b = hashed(i, j, seed), hashed(i + 1, j, seed)
    c, d = hashed(i, j + 1, seed), hashed(i + 1, j + 1, seed)
    top, bottom = a + su * (b - a), c + su * (d - c)
    return 2.0 * (top + sv * (bottom - top)) - 1.0


@kernel
def octaves(
    u: float, v: float, seed: np.uint64, frequency: float, count: int, gain: float, footprint: float
) -> float:
    """Sum of noise at doubling frequencies (1/m), as far as a pixel of `footprint` m shows it."""
    total, amplitude = 0.0, 1.0
    for k in range(count):
        # Features finer than two pixels would alias: they fade out between 2 and 4 pixels.
        seen = min(1.0, max(0.0, 2.0 - 4.0 * frequency * footprint))
        if seen <= 0.0:
            break
        total += seen * amplitude * value_noise(u * frequency, v * frequency, seed + np.uint64(k))
        amplitude *= gain
        frequency *= 2.0
    return total


@kernel
def inside(distance: float, softness: float) -> float:
    """1 well inside a shape (distance < 0), 0 well outside, soft over `softness`."""
    return min(1.0, max(0.0, 0.5 - distance / softness))


@kernel
def spots(
    u: float, v: float, seed: np.uint64, cell: float, share: float, footprint: float
) -> float:
    """Signed marks, -1 to 1: a round one of random size and strength in a `share` of cells."""
    i, j = math.floor(u / cell), math.floor(v / cell)
    if hashed(i, j, seed) >= share:
        return 0.0
    radius = cell * (0.06 + 0.2 * hashed(i, j, seed + np.uint64(1)))
    cu = cell * (i + 0.3 + 0.4 * hashed(i, j, seed + np.uint64(2)))
    cv = cell * (j + 0.3 + 0.4 * hashed(i, j, seed + np.uint64(3)))
    stretch = 0.6 + 0.8 * hashed(i, j, seed + np.uint64(4))
    distance = math.hypot((u - cu) * stretch, v - cv) - radius
    strength = 2.0 * hashed(i, j, seed + np.uint64(5)) - 1.0
    strength = math.copysign(0.4 + 0.6 * abs(strength), strength)
    # A mark smaller than a pixel shows by its share of the pixel.
    strength *= min(1.0, radius / footprint)
    return strength * inside(distance, max(1.5 * footprint, 0.15 * radius))

"""Turns about the vertical at which the wall directions of scan and plan agree."""

import numpy as np

from planfit.align.wall_samples import WallSamples
from planfit.floorplan import Floorplan

MIN_AGREEMENT = 0.35
"""Turns that agree less than this share of the best are not tried: most buildings have four that do, and
the others only take time."""


def candidate_turns(walls: WallSamples, floorplan: Floorplan, max_turns: int) -> np.ndarray:
    """Turns (t,) rad, plan from level, at which wall directions agree, best first.

    Circular correlation of the two length-weighted histograms of normals, one-degree bins; fewer than
    `max_turns` where the others agree far less. A face whose free side is unknown counts half for
    either side.
    """
    of_scan = _direction_histogram(walls.normals, np.ones(len(walls.normals)))
    weight = floorplan.lengths * np.where(floorplan.is_oriented, 1.0, 0.5)
    of_plan = _direction_histogram(floorplan.normals, weight)
    of_plan += _direction_histogram(
        -floorplan.normals, np.where(floorplan.is_oriented, 0.0, weight)
    )
    agreement = np.fft.irfft(np.fft.rfft(of_plan) * np.conj(np.fft.rfft(of_scan)), 360)
    turns: list[int] = []
    for degree in np.argsort(-agreement):
        if all(min((degree - t) % 360, (t - degree) % 360) >= 8 for t in turns):
            turns.append(int(degree))
        if len(turns) == max_turns or agreement[degree] < MIN_AGREEMENT * agreement.max():
            break
    return np.deg2rad(turns)


def _direction_histogram(normals: np.ndarray, weight: np.ndarray) -> np.ndarray:
    degree = np.rad2deg(np.arctan2(normals[:, 1], normals[:, 0])) % 360
    counts = np.bincount(np.round(degree).astype(int) % 360, weight, minlength=360)
    kernel = np.exp(-0.5 * (np.arange(-180, 180) / 2.0) ** 2)
    return np.fft.irfft(np.fft.rfft(counts) * np.fft.rfft(np.fft.ifftshift(kernel)), 360)

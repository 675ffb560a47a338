"""View grids of box rooms, each painted from its own seed, whose depth and greys are known exactly."""

import numpy as np

from builders import CAMERA
from planfit.matching.view_grids import COLUMNS, ROWS, ViewGrids

CELLS = CAMERA.scaled(COLUMNS, ROWS)
ROOM = (np.array([0.0, 0.0, 0.0]), np.array([5.0, 4.0, 2.6]))
POSTER = np.array([5.0, 2.0, 1.5])
"""In the middle of the wall at x = 5."""


def grids_of(*views):
    """Grids of views (plan_from_cam, low, high, seed) into box rooms, each painted from its own seed."""
    depth, grey = zip(*(_view(*view) for view in views), strict=True)
    camera = np.array([CELLS.fx, CELLS.fy, CELLS.cx, CELLS.cy])
    return ViewGrids(
        np.array(depth, np.float32), np.array(grey, np.uint8), np.tile(camera, (len(views), 1))
    )


def _view(plan_from_cam, low, high, seed):
    uv = np.stack(np.meshgrid(np.arange(COLUMNS), np.arange(ROWS)), axis=-1).reshape(-1, 2)
    rays = CELLS.rays(uv.astype(float)) @ plan_from_cam[:3, :3].T
    centre = plan_from_cam[:3, 3]
    with np.errstate(divide="ignore"):
        to_sides = np.where(rays > 0, (high - centre) / rays, (low - centre) / rays)
    depth = to_sides.min(axis=1)  # of the six sides of the room the nearest along the ray
    hit = centre + depth[:, None] * rays
    waves = np.random.default_rng(seed).normal(size=(30, 3)) * 5.0
    grey = 127 + 8 * np.sum(np.sin(hit @ waves.T), axis=1)
    return depth.reshape(ROWS, COLUMNS), np.clip(grey, 0, 255).reshape(ROWS, COLUMNS)

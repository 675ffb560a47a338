"""Axes of cameras and worlds as formats have them, into ours (docs/conventions.md)."""

import numpy as np

OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
"""Camera axes: OpenGL, Blender and ARKit have x right, y up, z backward; ours are x right, y down, z
forward."""

UP_Y = np.array([0.0, 1.0, 0.0])
UP_Z = np.array([0.0, 0.0, 1.0])


def from_opengl(world_from_gl_cams: np.ndarray) -> np.ndarray:
    """Poses (..., 4, 4) of cameras with OpenGL axes, as poses of cameras with ours; also the way back."""
    # Signs instead of a product: infinity times 0 is no number.
    return world_from_gl_cams * np.diag(OPENGL_FROM_OPENCV)

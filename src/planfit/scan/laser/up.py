"""Which axis of a cloud is up: z, as LAS and E57 have it, unless the scanner's path says that another is."""

import numpy as np
from jaxtyping import Float

from planfit.geometry import se3

AXES = {"x": 0, "y": 1, "z": 2}
LEVEL_M = 0.6
"""Standard deviation of the heights of a walk over one floor, at most."""
LEVEL_SHARE = 0.2
"""The same as a share of how far the walk goes across: walks of several storeys go up and down, too."""


def find_up(
    centres: Float[np.ndarray, "k 3"], wanted: str
) -> tuple[Float[np.ndarray, "3 3"], list[str]]:
    """The rotation that turns up to +z, and what to tell of it.

    A path of metres along z, which stays level along x or y, is that of a cloud in the axes of a program that
    has its y up (graphics, ARKit). Of the two directions along an axis the positive one is taken.

    Args:
        centres: where the scanner was, m.
        wanted: `x`, `y` or `z`, with `-` for down; `auto` finds it.
    """
    notes = []
    if wanted == "auto":
        spread = centres.std(axis=0)
        wanted = "z"
        others = [a for a in "yx" if spread[AXES[a]] <= min(LEVEL_M, LEVEL_SHARE * spread[2])]
        if spread[2] > max(LEVEL_M, LEVEL_SHARE * spread.max()) and others:
            wanted = others[0]
            notes = [
                f"the cloud's {wanted} axis is taken as up, as the scanner's path is level along it and goes "
                f"{np.ptp(centres[:, 2]):.1f} m along z; say otherwise with --cloud-up"
            ]
    up = np.zeros(3)
    up[AXES[wanted[-1]]] = -1.0 if wanted.startswith("-") else 1.0
    return se3.rotation_between(up, np.array([0.0, 0.0, 1.0])), notes

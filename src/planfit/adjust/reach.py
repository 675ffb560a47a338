"""How far wall may reach for its face: as far as the pose that saw it may be off, and no further.

A narrow loss does not feel a wall that lies decimetres off; a wide one is pulled by every wall that was
moved. What odometry and matches leave open tells which a patch needs: at the end of a walk without a loop it
reaches far, in the middle of a scan that closes on itself it stays narrow.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from planfit.adjust.association import wall_patches_in_plan
from planfit.lsq.covariance import covariances
from planfit.lsq.pose_terms import PosePriorTerm
from planfit.lsq.term import Term
from planfit.segmentation import WallPatches

MAX_FRAMES = 40
"""Covariances of so many frames are solved for; between them they are interpolated."""


WHOLE_SIGMA_M = 0.1
"""Sigma of the alignment of the whole scan, each axis."""
WHOLE_SIGMA_DEG = 1.0
"""Sigma of its yaw."""
MAX_REACH_M = 0.6
"""No loss is made wider than this, and no face is taken that lies twice as far."""


def patch_sigmas(
    patches: WallPatches,
    scan_terms: Sequence[Term],
    plan_from_cams: Float[np.ndarray, "n 4 4"],
) -> Float[np.ndarray, " k"]:
    """Standard deviation (m) of each wall patch's place along its normal, before walls take part.

    From what the scan says of itself, and a prior that holds the whole as well as an alignment does: weak
    for each pose, so that stretches are as free of each other as odometry and matches leave them.

    Args:
        patches: of wall.
        scan_terms: matches, floor and odometry.
        plan_from_cams: poses with loops closed, aligned.
    """
    n = len(plan_from_cams)
    # n priors of sigma s sqrt(n) hold the whole to s.
    rotation, translation = np.deg2rad(WHOLE_SIGMA_DEG), WHOLE_SIGMA_M
    each = np.array([rotation] * 3 + [translation] * 3) * np.sqrt(n)
    prior = PosePriorTerm(np.arange(n), plan_from_cams, each, name="alignment")
    frames = np.unique(np.linspace(0, n - 1, min(n, MAX_FRAMES)).round().astype(int))
    known = covariances([*scan_terms, prior], plan_from_cams, frames)
    # Of yaw, x and y: a patch's place is the camera's, swung by the lever to the patch.
    known = known[:, 2:5, 2:5]
    flat = known.reshape(len(frames), 9)
    at = np.stack([np.interp(patches.frame_idx, frames, flat[:, k]) for k in range(9)], axis=1)
    normals, ends = wall_patches_in_plan(patches, plan_from_cams)
    lever = ends.mean(axis=1) - plan_from_cams[patches.frame_idx, :2, 3]
    by_yaw = -lever[:, 1] * normals[:, 0] + lever[:, 0] * normals[:, 1]
    jacobian = np.column_stack([by_yaw, normals])
    variance = np.einsum("ki,kij,kj->k", jacobian, at.reshape(-1, 3, 3), jacobian)
    return np.sqrt(np.maximum(variance, 0.0))

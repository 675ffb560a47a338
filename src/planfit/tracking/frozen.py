"""Stretches where the tracker was lost and its pose stood still while the camera moved on."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.geometry import se3
from planfit.tracking.breaks import isotropic
from planfit.tracking.motions import MeasuredMotions, squared_sigmas
from planfit.tracking.options import TrackingOptions
from planfit.tracking.types import TrackingBreak, size_of

SAME = 1e-9
"""Poses of a camera that is only held still differ by more."""
MIN_FRAMES = 3
"""Two equal poses in a row are one pose for two images, as some formats have it."""
MAX_SHARE = 0.5
"""A scan with more frozen frames has no recorded poses to speak of, and stays as it is."""


@dataclass(frozen=True)
class Thawed:
    """Poses with frozen stretches filled by measured motions."""

    poses: Float[np.ndarray, "n 4 4"]
    sigmas: dict[int, tuple[float, float]]
    """Of the steps that were replaced: rotation (rad) and translation (m), each axis."""
    breaks: tuple[TrackingBreak, ...]


def thaw(
    recorded: Float[np.ndarray, "n 4 4"], motions: MeasuredMotions, options: TrackingOptions
) -> Thawed:
    """Put measured motions in the place of frozen steps that they contradict.

    The frames after the stretch keep their place: a tracker that finds itself again mostly knows where it is,
    and if it does not, that is a jump. A step that was not measured stays as it is, as unsure as usual steps
    are long.
    """
    direct = {int(a): k for k, (a, b) in enumerate(motions.pairs.tolist()) if b == a + 1}
    steps = se3.inverse(recorded[:-1]) @ recorded[1:]
    is_same = np.abs(np.diff(recorded, axis=0)).max(axis=(1, 2)) < SAME
    if is_same.mean() > MAX_SHARE if len(is_same) else True:
        return Thawed(recorded, {}, ())
    lengths = [np.linalg.norm(steps[:, :3, 3], axis=1), se3.rotation_angle(steps[:, :3, :3])]
    usual_m, usual_rad = (max(float(np.quantile(s[~is_same], 0.9)), 1e-3) for s in lengths)
    poses, sigmas, breaks = recorded.copy(), {}, []
    for first, last in _runs(is_same):
        known = [direct[s] for s in range(first, last) if s in direct]
        if last - first + 1 < MIN_FRAMES or not _moves(motions[np.array(known, int)], options):
            continue
        for step in range(first, last):
            k = direct.get(step)
            move = np.eye(4) if k is None else motions.a_from_b[k]
            poses[step + 1] = poses[step] @ move
            sigmas[step] = (usual_rad, usual_m) if k is None else isotropic(motions.covariance[k])
        moved = size_of(se3.inverse(poses[first]) @ poses[last])
        reason = (
            f"the recorded pose stands still from frame {first} to {last}, where the images move by "
            f"{moved[0]:.1f} m and {moved[1]:.0f} degrees: corrected"
        )
        breaks.append(TrackingBreak("frozen", first, last, (0.0, 0.0), moved, len(known), reason))
    return Thawed(poses, sigmas, tuple(breaks)) if breaks else Thawed(recorded, {}, ())


def _runs(is_same: np.ndarray) -> list[tuple[int, int]]:
    """First and last frame of each run of equal poses; step i leads from frame i to i + 1."""
    edges = np.diff(np.concatenate([[0], is_same.astype(int), [0]]))
    return list(
        zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist(), strict=True)
    )


def _moves(motions: MeasuredMotions, options: TrackingOptions) -> bool:
    """Whether measured motions say that the camera did not stand still."""
    still = np.tile(np.eye(4), (len(motions), 1, 1))
    squared = squared_sigmas(se3.difference(motions.a_from_b, still), motions.covariance)
    return bool((squared > options.max_sigmas**2).any())

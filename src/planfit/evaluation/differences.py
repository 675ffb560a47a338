"""Where two sets of poses of one scan differ: frame by frame, and in which stretches most."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from planfit.geometry import se3
from planfit.runtime import short_repr

MIN_STRETCH_M = 0.02
"""Poses that differ by less than this are called the same."""


@dataclass(frozen=True)
class PoseDifferences:
    """How far the frames of B are from those of A."""

    distance_m: Float[np.ndarray, " n"]
    """Between the two positions of each camera."""
    angle_deg: Float[np.ndarray, " n"]
    """Between its two orientations."""
    is_aligned: bool
    """Whether B was first moved onto A, by the rigid motion that brings positions closest."""
    whole: tuple[float, float]
    """That motion, made or not: distance (m) of the middle of the path, and angle (deg)."""
    aligned_rms_m: float
    """Distances after it, root mean square."""

    __repr__ = short_repr

    @property
    def rms_m(self) -> float:
        """Root mean square."""
        return float(np.sqrt(np.mean(self.distance_m**2)))


@dataclass(frozen=True)
class Stretch:
    """Frames that follow each other and differ much."""

    first: int
    last: int
    """Frame indices, both included."""
    max_distance_m: float
    max_angle_deg: float

    def contains(self, frame_idx: np.ndarray) -> Bool[np.ndarray, "..."]:
        """Whether frames lie within."""
        return (frame_idx >= self.first) & (frame_idx <= self.last)


def pose_differences(
    a_from_cams: Float[np.ndarray, "n 4 4"],
    b_from_cams: Float[np.ndarray, "n 4 4"],
    is_aligned: bool = False,
) -> PoseDifferences:
    """Compare poses A and B, both in one frame; B moved onto A as a whole where `is_aligned`."""
    positions_a, positions_b = a_from_cams[:, :3, 3], b_from_cams[:, :3, 3]
    a_from_b = np.eye(4)
    if len(positions_a) >= 3:  # fewer do not fix a rotation
        a_from_b = se3.fit_rigid(positions_b, positions_a)
    aligned = a_from_b @ b_from_cams
    compared = aligned if is_aligned else b_from_cams
    turned = np.swapaxes(a_from_cams[:, :3, :3], 1, 2) @ compared[:, :3, :3]
    middle = positions_b.mean(axis=0)
    moved_m = np.linalg.norm(se3.transform(a_from_b, middle[None])[0] - middle)
    return PoseDifferences(
        distance_m=np.linalg.norm(compared[:, :3, 3] - positions_a, axis=1),
        angle_deg=np.rad2deg(se3.rotation_angle(turned)),
        is_aligned=is_aligned,
        whole=(float(moved_m), float(np.rad2deg(se3.rotation_angle(a_from_b[:3, :3])))),
        aligned_rms_m=float(
            np.sqrt(np.mean(np.sum((aligned[:, :3, 3] - positions_a) ** 2, axis=1)))
        ),
    )


def largest_stretches(differences: PoseDifferences, max_count: int = 3) -> tuple[Stretch, ...]:
    """Stretches around the frames that differ most, the largest first.

    Each goes as far as half of its peak. What lies beside it, down to a quarter of the peak, belongs to it
    and is no stretch of its own; nor is anything below a quarter of the largest.
    """
    distance_m = differences.distance_m
    least_m = max(MIN_STRETCH_M, 0.25 * float(distance_m.max(initial=0.0)))
    is_free = np.ones(len(distance_m), dtype=bool)
    stretches: list[Stretch] = []
    while len(stretches) < max_count:
        peak = int(np.argmax(np.where(is_free, distance_m, -1.0)))
        if not is_free[peak] or distance_m[peak] < least_m:
            break
        first, last = _around(distance_m >= 0.5 * distance_m[peak], peak)
        flank = _around(distance_m >= 0.25 * distance_m[peak], peak)
        inside = slice(first, last + 1)
        if is_free[inside].all():
            stretches.append(
                Stretch(
                    first,
                    last,
                    float(distance_m[inside].max()),
                    float(differences.angle_deg[inside].max()),
                )
            )
        is_free[flank[0] : flank[1] + 1] = False
    return tuple(stretches)


def _around(is_high: Bool[np.ndarray, " n"], at: int) -> tuple[int, int]:
    """First and last index of the run of true values that `at` lies in."""
    below = np.flatnonzero(~is_high)
    k = int(np.searchsorted(below, at))
    first = int(below[k - 1]) + 1 if k > 0 else 0
    last = int(below[k]) - 1 if k < len(below) else len(is_high) - 1
    return first, last

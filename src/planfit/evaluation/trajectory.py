"""Poses against others: trajectory errors against true ones, absolute (ATE) and relative (RPE), and where
two sets of poses of one scan differ."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.errors import ScanError, require
from planfit.findings.finding import FEW_NAMED
from planfit.geometry import se3
from planfit.runtime import short_repr
from planfit.scan.poses import pair_times


@dataclass(frozen=True)
class PositionErrors:
    """Absolute trajectory error (ATE): distances between estimated and true camera positions."""

    rms_m: float
    """In the frame given, without any alignment to the truth."""
    mean_m: float
    max_m: float
    mean_offset_m: tuple[float, float, float]
    """Mean of estimated minus true position, by axis: a whole scan misplaced shows up here."""
    aligned_rms_m: float
    """After the rigid motion that brings the positions closest (Umeyama, without scale)."""
    rotation_mean_deg: float
    """Mean angle between estimated and true orientation, without alignment."""


@dataclass(frozen=True)
class RelativeErrors:
    """Relative pose error (RPE) over a path length: error of the motion from a frame to a later one."""

    delta_m: float | None
    """Path length between the two frames; None: each frame and the next."""
    n_pairs: int
    translation_rms_m: float
    rotation_rms_deg: float


def position_errors(
    target_from_cams: Float[np.ndarray, "n 4 4"], true_from_cams: Float[np.ndarray, "n 4 4"]
) -> PositionErrors:
    """Compare poses with true ones in the same frame."""
    positions, truth = target_from_cams[:, :3, 3], true_from_cams[:, :3, 3]
    offset = positions - truth
    distance = np.linalg.norm(offset, axis=1)
    aligned = distance
    if len(positions) >= 3:  # fewer do not fix a rotation
        moved = se3.transform(se3.fit_rigid(positions, truth), positions)
        aligned = np.linalg.norm(moved - truth, axis=1)
    angle_rad = se3.rotation_angle(
        np.swapaxes(true_from_cams[:, :3, :3], 1, 2) @ target_from_cams[:, :3, :3]
    )
    x, y, z = (float(v) for v in offset.mean(axis=0))
    return PositionErrors(
        rms_m=_rms(distance),
        mean_m=float(distance.mean()),
        max_m=float(distance.max()),
        mean_offset_m=(x, y, z),
        aligned_rms_m=_rms(aligned),
        rotation_mean_deg=float(np.rad2deg(angle_rad).mean()),
    )


def relative_errors(
    target_from_cams: Float[np.ndarray, "n 4 4"],
    true_from_cams: Float[np.ndarray, "n 4 4"],
    delta_m: float | None = None,
) -> RelativeErrors | None:
    """Error of motions over `delta_m` of true path, or to the next frame; None where there are none.

    Needs no alignment: relative motion does not depend on the frame.
    """
    steps = np.linalg.norm(np.diff(true_from_cams[:, :3, 3], axis=0), axis=1)
    walked = np.concatenate([[0.0], np.cumsum(steps)])
    if delta_m is None:
        last = np.arange(1, len(walked) + 1)
    else:
        require(delta_m > 0, f"delta_m: expected a length above 0, found {delta_m}")
        # The first frame past the length; none past the end of the path gives len(walked).
        last = np.searchsorted(walked, walked + delta_m)
    first = np.flatnonzero(last < len(walked))
    if len(first) == 0:
        return None
    last = last[first]
    estimated = se3.inverse(target_from_cams[first]) @ target_from_cams[last]
    true = se3.inverse(true_from_cams[first]) @ true_from_cams[last]
    error = se3.inverse(true) @ estimated
    return RelativeErrors(
        delta_m=delta_m,
        n_pairs=len(first),
        translation_rms_m=_rms(np.linalg.norm(error[:, :3, 3], axis=1)),
        rotation_rms_deg=_rms(np.rad2deg(se3.rotation_angle(error[:, :3, :3]))),
    )


def associate_times(
    times: Float[np.ndarray, " n"],
    true_times: Float[np.ndarray, " t"],
    max_difference_s: float = 0.02,
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Indices of poses and of true poses that belong together by time, as `planfit.scan.poses` pairs
    them: each at most once, nearest first.

    Raises:
        ScanError: none do.
    """
    mine, true = pair_times(times, true_times, max_difference_s)
    if len(mine) == 0:
        raise ScanError(
            f"truth: expected times or frame numbers between {times.min():g} and {times.max():g}, "
            f"found {true_times.min():g} to {true_times.max():g}; is it the truth of this scan?"
        )
    return mine, true


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


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


def largest_stretches(differences: PoseDifferences) -> tuple[Stretch, ...]:
    """A few stretches around the frames that differ most, the largest first.

    Each goes as far as half of its peak. What lies beside it, down to a quarter of the peak, belongs to it
    and is no stretch of its own; nor is anything below a quarter of the largest.
    """
    distance_m = differences.distance_m
    least_m = max(MIN_STRETCH_M, 0.25 * float(distance_m.max(initial=0.0)))
    is_free = np.ones(len(distance_m), dtype=bool)
    stretches: list[Stretch] = []
    while len(stretches) < FEW_NAMED:
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

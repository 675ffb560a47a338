"""Trajectory errors against true poses: absolute (ATE) and relative (RPE), with and without alignment."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import ScanError, require
from planfit.geometry import se3
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

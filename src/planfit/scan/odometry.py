"""How far the recorded motion between two frames may be off: the spread that all stages share."""

from dataclasses import dataclass

import numpy as np

from planfit.errors import require_positive
from planfit.geometry import se3


@dataclass(frozen=True)
class OdometryOptions:
    """Spread of the tracker's motion between two frames that follow each other.

    The defaults hold for phone and LiDAR-inertial trackers, which drift by one to three per cent.
    """

    sigma_base_m: float = 0.01
    """Spread of a step's shift, each axis, however short the step."""
    sigma_per_m: float = 0.02
    """Growth of that spread with the length of the step."""
    sigma_base_deg: float = 0.10
    """Spread of a step's turn, each axis, however small the turn."""
    sigma_per_deg: float = 0.01
    """Growth of that spread with the turn."""

    def __post_init__(self) -> None:
        require_positive(self, "sigma_base_m", "sigma_base_deg")


@dataclass(frozen=True)
class Odometry:
    """Recorded steps, and how sure they are."""

    cam_from_next: np.ndarray  # (n - 1, 4, 4), frame i from frame i + 1
    sigma_rotation: np.ndarray  # (n - 1,) rad, each axis
    sigma_translation: np.ndarray  # (n - 1,) m, each axis

    def sigma_between(self, first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Spread of turn (k,) rad and shift (k,) m, each axis, from frames `first` to `last` (k,).

        Steps err independently, so variances add up; a turn early on swings all that follows, which
        the distance walked times the spread of the turn bounds.
        """
        turn_sq = np.concatenate([[0.0], np.cumsum(self.sigma_rotation**2)])
        shift_sq = np.concatenate([[0.0], np.cumsum(self.sigma_translation**2)])
        walked = self.walked_m
        low, high = np.minimum(first, last), np.maximum(first, last)
        turn = np.sqrt(turn_sq[high] - turn_sq[low])
        shift = np.sqrt(
            shift_sq[high] - shift_sq[low] + (turn * (walked[high] - walked[low])) ** 2 / 3
        )
        return turn, shift

    @property
    def walked_m(self) -> np.ndarray:
        """(n,) m, path length from the first frame."""
        steps = np.linalg.norm(self.cam_from_next[:, :3, 3], axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])


def make_odometry(world_from_cams: np.ndarray, options: OdometryOptions) -> Odometry:
    """Steps of a recorded trajectory (n, 4, 4)."""
    steps = se3.inverse(world_from_cams[:-1]) @ world_from_cams[1:]
    turn = se3.rotation_angle(steps[:, :3, :3])
    length = np.linalg.norm(steps[:, :3, 3], axis=1)
    return Odometry(
        cam_from_next=steps,
        sigma_rotation=np.deg2rad(options.sigma_base_deg) + options.sigma_per_deg * turn,
        sigma_translation=options.sigma_base_m + options.sigma_per_m * length,
    )

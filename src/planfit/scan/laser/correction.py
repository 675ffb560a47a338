"""What refined poses of instants do to a trajectory and to a cloud: a motion of every time."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.geometry import se3
from planfit.scan.laser.kernels import move_by_time
from planfit.scan.laser.trajectory import Trajectory


@dataclass(frozen=True)
class Correction:
    """Motions of the world at some times, and between them; before the first and after the last, theirs.

    Between two, the rotation goes at constant speed, and the place of the scanner straight from where one
    carries it to where the other does: a point moves with the scanner that saw it.
    """

    times: Float[np.ndarray, " k"]
    """s, of the trajectory's clock, increasing."""
    refined_from_recorded: Float[np.ndarray, "k 4 4"]
    """Both near the origin: less the trajectory's `metres_away`."""
    trajectory: Trajectory
    target_metres_away: Float[np.ndarray, "3"]
    """To be added to refined places for those of the target's axes."""

    def move(
        self,
        xyz: Float[np.ndarray, "n 3"],
        cloud_times: Float[np.ndarray, " n"],
        clock_offset_s: float,
    ) -> Float[np.ndarray, "n 3"]:
        """Points (m, axes of the cloud) seen at times (s) of a clock that `clock_offset_s` lacks."""
        with np.errstate(invalid="ignore", over="ignore"):  # a point may have no time
            times = cloud_times + clock_offset_s
        before, share = self._between(times)
        rotations = np.ascontiguousarray(self.refined_from_recorded[:, :3, :3])
        centres, to_centres = self._centres(times, before, share)
        return move_by_time(
            xyz - self.trajectory.metres_away, centres, to_centres + self.target_metres_away,
            before, share, rotations, self._turns(),
        )  # fmt: skip

    def poses(self) -> Float[np.ndarray, "n 4 4"]:
        """Of the trajectory, refined; less `target_metres_away`."""
        times = self.trajectory.times
        before, share = self._between(times)
        turn = se3.exp_so3(share[:, None] * self._turns()[before])
        rotation = self.refined_from_recorded[before, :3, :3] @ turn
        recorded = self.trajectory.world_from_scanner[:, :3, :3]
        return se3.make_transform(rotation @ recorded, self._centres(times, before, share)[1])

    def _between(
        self, times: Float[np.ndarray, " n"]
    ) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """The correction before each time, and how far on the way to the next it is, 0 to 1."""
        last = len(self.times) - 1
        if last == 0:
            return np.zeros(len(times), dtype=np.int64), np.zeros(len(times))
        known = np.where(np.isfinite(times), times, self.times[0])
        before = np.clip(np.searchsorted(self.times, known, side="right") - 1, 0, last - 1)
        gap = self.times[before + 1] - self.times[before]
        return before, np.clip((known - self.times[before]) / gap, 0.0, 1.0)

    def _turns(self) -> Float[np.ndarray, "k 3"]:
        """Rotation (rad) from each correction to the next, before it is applied."""
        rotations = self.refined_from_recorded[:, :3, :3]
        after = np.append(rotations[1:], rotations[-1:], axis=0)
        return se3.log_so3(np.swapaxes(rotations, -1, -2) @ after)

    def _centres(
        self,
        times: Float[np.ndarray, " n"],
        before: Int[np.ndarray, " n"],
        share: Float[np.ndarray, " n"],
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Where the scanner was recorded, and where it was."""
        recorded = self.trajectory.world_from_scanner[:, :3, 3]
        known = np.where(np.isfinite(times), times, self.times[0])
        at = [np.interp(known, self.trajectory.times, recorded[:, axis]) for axis in range(3)]
        centres = np.stack(at, axis=1)
        after = np.minimum(before + 1, len(self.times) - 1)
        carried = [
            np.einsum("nij,nj->ni", self.refined_from_recorded[k, :3, :3], centres)
            + self.refined_from_recorded[k, :3, 3]
            for k in (before, after)
        ]
        return centres, carried[0] + share[:, None] * (carried[1] - carried[0])

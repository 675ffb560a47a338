"""Anchor: some poses stay near where they are given. Holds the gauge where nothing else does."""

from dataclasses import dataclass

import numpy as np

from planfit.geometry import se3
from planfit.lsq.linear.normal_equations import NormalBlocks, sum_by_pose


@dataclass(frozen=True)
class PosePriorTerm:
    """Sum of squares of a pose's departure from its anchor, in spreads [rad, m], target axes."""

    pose_idx: np.ndarray  # (k,)
    target_from_priors: np.ndarray  # (k, 4, 4)
    sigma: np.ndarray  # (6,) rad and m; infinity leaves a direction free
    name: str = "pose prior"

    def reweight(self, target_from_cams: np.ndarray) -> tuple["PosePriorTerm", float]:
        """Not robust: the term is its own quadratic."""
        return self, self.cost(target_from_cams)

    def cost(self, target_from_cams: np.ndarray) -> float:
        """Half the weighted sum of squares."""
        departure = se3.difference(target_from_cams[self.pose_idx], self.target_from_priors)
        return 0.5 * float(np.sum((departure / self.sigma) ** 2))

    def normal_blocks(self, target_from_cams: np.ndarray) -> NormalBlocks:
        """Gauss-Newton blocks; the derivative of log is taken as one, exact at the anchor."""
        departure = se3.difference(target_from_cams[self.pose_idx], self.target_from_priors)
        information = 1.0 / self.sigma**2
        # A sum, not an assignment: one pose may have several anchors.
        gradient = sum_by_pose(self.pose_idx, departure * information, len(target_from_cams))
        blocks = np.tile(np.diag(information), (len(self.pose_idx), 1, 1))
        return NormalBlocks(self.pose_idx, self.pose_idx, blocks, gradient)

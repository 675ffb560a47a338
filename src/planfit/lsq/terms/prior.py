"""Pose prior: some poses stay near where they are given. Holds the gauge where nothing else does."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import require
from planfit.geometry import se3
from planfit.lsq.blocks import NormalBlocks, blocks_of_rows
from planfit.lsq.checks import check_pose_idx, check_poses


@dataclass(frozen=True)
class PosePriorTerm:
    """Half the sum of squares of a pose's departure from its prior in sigmas, target axes.

    Raises:
        OptionError: indices that are no array of integers (k,) or below 0, priors of another number, sigmas
            that are not six numbers above 0.
    """

    pose_idx: Int[np.ndarray, " k"]
    """Poses that have a prior; one pose may have several."""
    target_from_priors: Float[np.ndarray, "k 4 4"]
    sigma: Float[np.ndarray, " 6"]
    """Standard deviations, rad and m; infinity leaves a direction free. To hold a gauge 0.01 will do: steps
    are damped by at least 1e-9 of the largest information of all, so far smaller ones slow all poses down."""
    name: str = "pose prior"

    def __post_init__(self) -> None:
        """Check indices, priors and sigmas."""
        check_pose_idx(self.name, self.pose_idx, ("k",))
        what = f"term {self.name!r}: expected finite target_from_priors"
        check_poses(what, self.target_from_priors, len(self.pose_idx))
        require(
            np.shape(self.sigma) == (6,),
            f"term {self.name!r}: expected six sigmas, of rotation (rad) and translation (m), found an array "
            f"of shape {np.shape(self.sigma)}; np.full(6, sigma) takes one for all",
        )
        require(
            bool(np.all(self.sigma > 0)),
            f"term {self.name!r}: expected sigmas above 0, found {self.sigma}; infinity frees a direction",
        )

    def reweight(
        self, target_from_cams: Float[np.ndarray, "n 4 4"]
    ) -> tuple["PosePriorTerm", float]:
        """Not robust: the term is its own quadratic."""
        return self, self.cost(target_from_cams)

    def cost(self, target_from_cams: Float[np.ndarray, "n 4 4"]) -> float:
        """Half the weighted sum of squares."""
        departure = se3.difference(target_from_cams[self.pose_idx], self.target_from_priors)
        return 0.5 * float(np.sum((departure / self.sigma) ** 2))

    def normal_blocks(self, target_from_cams: Float[np.ndarray, "n 4 4"]) -> NormalBlocks:
        """Gauss-Newton blocks; the derivative of log is taken as one, exact at the prior."""
        departure = se3.difference(target_from_cams[self.pose_idx], self.target_from_priors)
        information = 1.0 / self.sigma**2
        hessians = np.tile(np.diag(information), (len(self.pose_idx), 1, 1))
        gradients = departure * information
        return blocks_of_rows(self.pose_idx[:, None], hessians, gradients, len(target_from_cams))

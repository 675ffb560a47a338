"""Terms that hold poses to each other: matched points, recorded steps, pairs matched by geometry.

Points are the paper's (Eq. L_geom): matched keypoints, lifted by depth, coincide. Their sigma is the same
in all directions, though depth is rougher than the location in the image. A sigma of 1 px across the ray,
with the matches' own along it, was tried: aligned error 0.012 m instead of 0.018 on a synthetic phone scan,
but 0.047 instead of 0.022 on 7-Scenes' kitchen and 0.085 instead of 0.074 on ConSLAM, as real calibrations
and clocks err by pixels.

Without recorded steps, a frame that has no match and sees no wall floats, and a bundle of wrong matches
deforms the path where nothing else holds it. Of pairs matched by geometry, the information is of a rank
below 6 where surfaces leave directions free: along these they hold nothing (docs/adr/0018-matches-by-
geometry.md).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.adjust.terms.groups import PairGroups
from planfit.adjust.terms.observation_models import SURFACES, ObservationModel
from planfit.geometry.calibration import PARAMETERS
from planfit.geometry.se3 import Poses
from planfit.lsq.moments import PairMoments
from planfit.lsq.pose_terms import BetweenTerm
from planfit.lsq.residual_term import WeightedResiduals
from planfit.lsq.torch_moments import GroupedPoints
from planfit.matching import Matches, SurfacePairs
from planfit.scan.odometry import Odometry


@dataclass(frozen=True)
class PointTerm:
    """Sum over matches of rho(|T_i p - T_j p'| / sigma)."""

    matches: Matches
    model: ObservationModel
    name: str = "points"
    device: str = "cpu"
    """Where the matches are reweighted; "cuda" asks for PyTorch."""
    is_kept: Bool[np.ndarray, " p"] | None = None
    """Pairs that take part; None: all. The others are not looked at."""

    @cached_property
    def _on_device(self) -> GroupedPoints:
        m = self.matches
        return GroupedPoints(self.device, m.start, m.points_a, m.points_b, m.sigma)

    def with_wider_loss(self, factor: float) -> "PointTerm":
        """The same term with the scale of its loss times `factor`, for graduated non-convexity."""
        return replace(self, model=self.model.widened(factor))

    @property
    def groups(self) -> PairGroups:
        """The matches of each pair."""
        m = self.matches
        information = self.model.weight * self.model.weight_per_point(np.diff(m.start))
        if self.is_kept is not None:
            information = np.where(self.is_kept, information, 0.0)
        ends = (m.points_a, m.points_b, m.sigma)
        return PairGroups(*ends, m.start, m.pairs, information, self.model.loss)

    def reweight(self, target_from_cams: Poses) -> tuple[PairMoments, float]:
        """One pass over the matches; see `planfit.lsq.moments`."""
        moments, cost = self.groups.moments(
            target_from_cams, None if self.device == "cpu" else self._on_device
        )
        if self.is_kept is not None:
            moments = moments[self.is_kept]  # frames that nothing else ties are then not tied
        return moments, cost


@dataclass(frozen=True)
class OdometryTerm:
    """Sum over steps of rho(|departure of the step from the recorded one| in sigmas).

    Other unknowns may stand behind the cameras.
    """

    odometry: Odometry
    model: ObservationModel
    name: str = "odometry"
    frame_idx: Int[np.ndarray, " n"] | None = None
    """Of the poses given, those between which the recorded steps are; None: the first n."""

    def reweight(self, target_from_cams: Poses) -> tuple[WeightedResiduals, float]:
        """Weights of the steps at these poses."""
        return self.between.reweight(target_from_cams)

    @cached_property
    def between(self) -> BetweenTerm:
        """The steps as relative poses that were measured."""
        recorded = self.odometry
        frames = np.arange(len(recorded.cam_from_next) + 1)
        if self.frame_idx is not None:
            frames = self.frame_idx
        sigma = np.stack([recorded.sigma_rotation, recorded.sigma_translation], axis=1)
        return BetweenTerm(
            pairs=np.stack([frames[:-1], frames[1:]], axis=1),
            first_from_second=recorded.cam_from_next,
            sigma=np.repeat(sigma, 3, axis=1),
            loss=self.model.loss,
            weight=self.model.weight,
            name=self.name,
        )


@dataclass(frozen=True)
class SurfaceTerm:
    """Sum over pairs of rho(|departure of the relative pose from the measured one| in sigmas)."""

    measured: SurfacePairs
    model: ObservationModel = SURFACES
    name: str = "surfaces"

    @property
    def pairs(self) -> Int[np.ndarray, "k 2"]:
        """First and second pose of each measurement."""
        return self.measured.pairs

    def reweight(self, target_from_cams: Poses) -> tuple[WeightedResiduals, float]:
        """Weights of the pairs at these poses."""
        return self.between.reweight(target_from_cams)

    @cached_property
    def between(self) -> BetweenTerm:
        """The pairs as relative poses that were measured, with their information."""
        return BetweenTerm(
            pairs=self.measured.pairs,
            first_from_second=self.measured.a_from_b,
            information=of_departures(self.measured),
            loss=self.model.loss,
            weight=self.model.weight,
            name=self.name,
        )

    def by_sensor(self, target_from_cams: Poses) -> Float[np.ndarray, "k 6 7"]:
        """Derivatives of the departures by the sensor's parameters (`geometry.calibration.PARAMETERS`).

        A departure is R_m^T (w, v) from the measured motion, which follows the sensor; and the sigma of its
        translation grows with the points, else shrinking them would always pay.
        """
        measured, residuals = self.measured, self.between.rows.residuals(target_from_cams)
        to_second = np.swapaxes(measured.a_from_b[:, :3, :3], 1, 2)
        moved = np.concatenate(
            [to_second @ measured.by_sensor[:, :3], to_second @ measured.by_sensor[:, 3:]], axis=1
        )
        # Of the logarithm of the stretch along rays: depth's scale and quadratic.
        grown = np.zeros((len(measured), len(PARAMETERS)))
        grown[:, PARAMETERS.index("depth_scale")] = 1.0
        grown[:, PARAMETERS.index("depth_quadratic_per_m")] = 2.0 * measured.distance_m
        moved[:, 3:] += residuals[:, 3:, None] * grown[:, None, :]
        return -moved


def of_departures(pairs: SurfacePairs) -> Float[np.ndarray, "p 6 6"]:
    """Information of what `BetweenTerm` calls a departure, from that of the tangent.

    The tangent (w, v) has the axes of the first frame, a departure R^T w, R^T v those of the second.
    """
    axes = np.zeros((len(pairs), 6, 6))
    axes[:, :3, :3] = axes[:, 3:, 3:] = pairs.a_from_b[:, :3, :3]
    turned = np.swapaxes(axes, 1, 2) @ pairs.information @ axes
    return 0.5 * (turned + np.swapaxes(turned, 1, 2))

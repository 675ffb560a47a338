"""Pairs of frames whose surfaces agree, with what these say of the motion between them."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from planfit.findings import Finding, ScanKind
from planfit.geometry import se3
from planfit.geometry.calibration import NOMINAL, PARAMETERS, SensorCalibration
from planfit.geometry.se3 import Poses
from planfit.matching.types import PairRows, count_loops
from planfit.runtime import short_repr

NULL_SHARE = 1e-9
"""Eigenvalues of an information matrix below this share of its largest are directions left free."""


_MIN_STRETCH = 0.1
"""Of depth by a correction, at least: no correction that is believed comes near."""


@dataclass(frozen=True)
class SurfacePairs(PairRows):
    """Motions between frames from the surfaces that both see, sorted by pair."""

    pairs: Int[np.ndarray, "p 2"]
    """Frame indices, first < second."""
    a_from_b: Float[np.ndarray, "p 4 4"]
    """m, camera frame of the second of the pair to that of the first; arbitrary in directions left free."""
    information: Float[np.ndarray, "p 6 6"]
    """Inverse covariance of the tangent (rotation, translation; rad, m), axes of the first frame; of a rank
    below 6 where the surfaces leave directions free."""
    explained: Float[np.ndarray, " p"]
    """Share of both views whose surfaces agree."""
    by_sensor: Float[np.ndarray, "p 6 7"]
    """How the motion follows the sensor's parameters (`geometry.calibration.PARAMETERS`), as tangents; 0 in
    directions left free."""
    distance_m: Float[np.ndarray, " p"]
    """Of the surfaces from the cameras, root mean square."""

    __repr__ = short_repr

    @staticmethod
    def none() -> "SurfacePairs":
        """No pairs at all."""
        return SurfacePairs(
            np.zeros((0, 2), int),
            np.zeros((0, 4, 4)),
            np.zeros((0, 6, 6)),
            np.zeros(0),
            np.zeros((0, 6, len(PARAMETERS))),
            np.zeros(0),
        )

    @property
    def n_free(self) -> Int[np.ndarray, " p"]:
        """Directions, of six, that each pair leaves free."""
        if len(self) == 0:
            return np.zeros(0, dtype=int)
        # Radians and metres compare by the spread of the surfaces, metres: eigenvalues tell a rank of either.
        values = np.linalg.eigvalsh(self.information)
        return np.sum(values < NULL_SHARE * values[:, -1:], axis=1)

    def held_off_m(self, target_from_cams: Poses) -> Float[np.ndarray, " p"]:
        """How far (m) poses put the cameras of each pair from its motion, in directions that it holds."""
        if len(self) == 0:
            return np.zeros(0)
        a, b = self.pairs.T
        motion = se3.inverse(target_from_cams[a]) @ target_from_cams[b]
        values, vectors = np.linalg.eigh(self.information)
        is_held = values > NULL_SHARE * values[:, -1:]
        along = np.einsum("pij,pi->pj", vectors, se3.difference(motion, self.a_from_b)) * is_held
        return np.linalg.norm(np.einsum("pij,pj->pi", vectors, along)[:, 3:], axis=1)

    @property
    def finding(self) -> Finding:
        """How many there are, and how many leave directions free."""
        n_free = int((self.n_free > 0).sum())
        facts = {"pair_count": len(self), "free_pair_count": n_free}
        return Finding(ScanKind.MATCHED_BY_GEOMETRY, facts)

    def n_loops(self, neighbours: int, keyframe_idx: Int[np.ndarray, " k"] | None = None) -> int:
        """Pairs that are further apart in time than `neighbours` frames, or keyframes."""
        return count_loops(self.pairs, neighbours, keyframe_idx)

    def corrected(self, sensor: SensorCalibration) -> "SurfacePairs":
        """As a calibrated sensor would have measured them; sigmas of translations grow with the points.

        To the first order: exact for the scale of depth, whose corrections may be the largest.
        """
        if sensor.is_nominal or len(self) == 0:
            return self
        off = sensor.vector - NOMINAL.vector
        moved = se3.retract(self.a_from_b, self.by_sensor @ off)
        # Depth errs along rays: its error grows as the derivative of what is corrected by what was measured.
        grown = sensor.depth_scale + 2 * sensor.depth_quadratic_per_m * self.distance_m
        grown = np.maximum(grown, _MIN_STRETCH)
        shrink = np.ones((len(self), 6))
        shrink[:, 3:] = 1.0 / grown[:, None]
        information = shrink[:, :, None] * self.information * shrink[:, None, :]
        return replace(self, a_from_b=moved, information=information)

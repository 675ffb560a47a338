"""Poses of a noisy tracker, fused with measured motions: a pose graph of neighbouring frames."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from planfit.geometry import se3
from planfit.lsq.pose_terms import BetweenTerm, PosePriorTerm
from planfit.lsq.problem import Problem
from planfit.lsq.robust import Loss, LossKind
from planfit.scan.odometry import Odometry
from planfit.tracking.motions import MeasuredMotions

LOSS = Loss(LossKind.CAUCHY, 4.0)
"""Of a departure's six numbers in sigmas; false motions count little."""


def fuse(
    world_from_cams: Float[np.ndarray, "n 4 4"], odometry: Odometry, motions: MeasuredMotions
) -> Float[np.ndarray, "n 4 4"]:
    """Poses that recorded steps and measured motions agree on best; the first stays.

    Neighbouring motions close no loops: what is gained is smaller drift, by which loops are then found.
    """
    steps = np.arange(len(world_from_cams) - 1)
    sigma = np.repeat(
        np.column_stack([odometry.sigma_rotation, odometry.sigma_translation]), 3, axis=1
    )
    terms = [
        BetweenTerm(
            np.column_stack([steps, steps + 1]),
            odometry.cam_from_next,
            sigma,
            loss=LOSS,
            name="recorded",
        ),
        measured_term(motions),
        PosePriorTerm(np.array([0]), world_from_cams[:1], np.full(6, 0.01)),
    ]
    return Problem(terms, world_from_cams).solve().target_from_cams


def measured_term(motions: MeasuredMotions) -> BetweenTerm:
    """Measured motions as a term over poses; false ones count little."""
    # The residual of a relative pose is in the axes of the second frame: R^T times that in the first's.
    rotation = np.zeros_like(motions.covariance)
    rotation[:, :3, :3] = rotation[:, 3:, 3:] = motions.a_from_b[:, :3, :3]
    information = np.swapaxes(rotation, 1, 2) @ np.linalg.inv(motions.covariance) @ rotation
    information = (information + np.swapaxes(information, 1, 2)) / 2
    return BetweenTerm(
        motions.pairs, motions.a_from_b, information=information, loss=LOSS, name="measured"
    )


def with_steps_of(odometry: Odometry, world_from_cams: Float[np.ndarray, "n 4 4"]) -> Odometry:
    """The same sigmas of other steps. They stay as wide as the tracker's: matches count once, later on."""
    steps = se3.inverse(world_from_cams[:-1]) @ world_from_cams[1:]
    return replace(odometry, cam_from_next=steps)

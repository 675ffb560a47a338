"""One Gauss-Newton step of the shared parameters, poses eliminated (Schur complement)."""

from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.calibration.blocks import ODOMETRY, shared_blocks
from planfit.adjust.problem import AdjustmentProblem
from planfit.adjust.terms.between import OdometryTerm
from planfit.adjust.terms.wall_offsets import OffsetWallTerm, offset_prior, with_offsets
from planfit.adjust.terms.walls import WallTerm
from planfit.geometry.calibration import NOMINAL
from planfit.lsq.covariance import factorised
from planfit.lsq.normal_equations import NormalEquations
from planfit.priors import WALL_AS_BUILT_SIGMA_M
from planfit.tracking import KeyframeOptions

MIN_BASELINE_M = KeyframeOptions.max_step_m
"""What is usual between keyframes of a walk."""
_LOOSE = 10.0
"""Standard deviations of shorter translations, times: what they alone hold remains held."""


@dataclass(frozen=True)
class SharedStep:
    """Where the cost of a problem asks shared parameters to go, poses moving with them."""

    change: Float[np.ndarray, " s"]
    """Of the shared parameters."""
    covariance: Float[np.ndarray, "s s"]
    """Of the shared parameters, poses free, priors included."""
    pose_by_shared: Float[np.ndarray, "n 6 s"]
    """How poses follow the shared parameters, tangents as in `planfit.geometry.se3`."""


def shared_step(
    problem: AdjustmentProblem,
    unknowns: Float[np.ndarray, "u 4 4"],
    departures: Float[np.ndarray, " s"],
    sigmas: Float[np.ndarray, " s"],
) -> SharedStep:
    """Step of the shared parameters with poses free, from poses that minimise the problem.

    With H over poses and parameters, [[H_xx, H_xs], [H_sx, H_ss]], the parameters' own equations are
    (H_ss - H_sx H_xx^-1 H_xs) ds = -(g_s - H_sx H_xx^-1 g_x).

    Args:
        problem: built from points that are corrected by the parameters as they stand.
        departures: of the parameters as they stand from their nominal values.
        sigmas: prior standard deviations about the nominal values; 0 holds a parameter.
    """
    sensor = NOMINAL.with_vector(NOMINAL.vector + departures[:ODOMETRY])
    n_given = len(unknowns)
    problem, unknowns = _with_free_faces(with_long_steps(problem, unknowns), unknowns)
    shared = shared_blocks(problem, unknowns, sensor)
    quadratics = [term.reweight(unknowns)[0] for term in problem.terms]
    equations = NormalEquations([q.normal_blocks(unknowns) for q in quadratics], len(unknowns))
    factors = factorised(equations)
    free = np.flatnonzero(sigmas > 0)
    across = shared.by_pose.reshape(6 * len(unknowns), -1)[:, free]
    gradient_x = equations.gradient.ravel()
    solved = factors.solve(np.column_stack([across, gradient_x]))
    prior = 1.0 / sigmas[free] ** 2
    reduced = shared.by_self[np.ix_(free, free)] + np.diag(prior) - across.T @ solved[:, :-1]
    right = shared.gradient[free] + prior * departures[free] - across.T @ solved[:, -1]
    covariance = np.zeros((len(sigmas), len(sigmas)))
    covariance[np.ix_(free, free)] = inverse = np.linalg.inv(0.5 * (reduced + reduced.T))
    change = np.zeros(len(sigmas))
    change[free] = -inverse @ right
    pose_by_shared = np.zeros((len(unknowns), 6, len(sigmas)))
    pose_by_shared[:, :, free] = -solved[:, :-1].reshape(len(unknowns), 6, -1)
    return SharedStep(change, covariance, pose_by_shared[:n_given])


def _with_free_faces(
    problem: AdjustmentProblem, unknowns: Float[np.ndarray, "u 4 4"]
) -> tuple[AdjustmentProblem, Float[np.ndarray, "v 4 4"]]:
    """The problem with each face of the plan free within how walls are built, and the unknowns with them.

    All patches of one wall err alike where it was built or drawn off its line, however many frames saw it:
    what a wall says of the sensor is one observation, and not hundreds.
    """
    walls = problem.walls
    if not isinstance(walls, WallTerm):
        return problem, unknowns
    n, plan = len(unknowns), walls.floorplan
    free = OffsetWallTerm(walls.patches, plan, walls.association, walls.model, n)
    prior = offset_prior(n, plan, WALL_AS_BUILT_SIGMA_M.value)
    freed = replace(problem, offset_walls=free, offset_prior=prior)
    return freed, with_offsets(unknowns, plan)


def with_long_steps(
    problem: AdjustmentProblem, target_from_cams: Float[np.ndarray, "u 4 4"]
) -> AdjustmentProblem:
    """The problem with recorded translations between frames that are far enough apart to tell a scale.

    The scale of depth against recorded motion is a regression where both err. As sigmas of steps are larger
    than a good tracker's errors, solved motion is in effect the regressor, and its noise makes depth look too
    long by noise^2 / step^2 (attenuation: Fuller, Measurement Error Models, 1987): steps of 16 mm solved to
    3 mm asked for 4 to 8 %, at 2.3 to 4 standard deviations. Over k steps noise grows with sqrt(k) and motion
    with k, while all of them together tell the scale as well as before.
    """
    short = problem.odometry
    if short is None:
        return problem
    recorded = short.odometry
    poses = target_from_cams[: len(recorded.cam_from_next) + 1]
    frame_idx = _far_apart(poses[:, :3, 3])
    if len(frame_idx) == len(poses):
        return problem
    walked = np.stack(list(accumulate(recorded.cam_from_next, np.matmul, initial=np.eye(4))))
    loose = replace(recorded, sigma_translation=_LOOSE * recorded.sigma_translation)
    # Rotations are told by the steps already.
    long = replace(
        recorded.between(frame_idx, walked[frame_idx]),
        sigma_rotation=np.full(len(frame_idx) - 1, np.inf),
    )
    of_long = OdometryTerm(long, short.model, "odometry, long steps", frame_idx)
    return replace(
        problem, odometry=replace(short, odometry=loose), extra=(*problem.extra, of_long)
    )


def _far_apart(positions: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " k"]:
    """The first position, each one that is far enough from the one before it here, and the last."""
    chosen = [0]
    for k in range(1, len(positions) - 1):
        if np.linalg.norm(positions[k] - positions[chosen[-1]]) >= MIN_BASELINE_M:
            chosen.append(k)
    return np.array([*chosen, len(positions) - 1])

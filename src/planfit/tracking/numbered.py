"""Conventions whose numbers motions show: a unit of poses' own, and a body that carries the camera.

Units are those of structure from motion and of trackers with one camera. The body moves by A where the
camera moves by B, and A X = X B with X = body_from_cam (hand-eye calibration, Tsai and Lenz 1989). X is
found by least squares over all motions at once, each by its covariance, as Strobl and Hirzinger (2006)
weigh turn and arm, with the tails of `motions.py` for motions that are false.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.lsq.pose_terms import PosePriorTerm
from planfit.lsq.problem import Problem
from planfit.lsq.residual_term import ResidualTerm
from planfit.lsq.robust import Loss, LossKind
from planfit.lsq.solver import SolverOptions
from planfit.priors import MOUNT_ARM_SIGMA_M
from planfit.scan.odometry import Odometry
from planfit.tracking.motions import FREEDOM, MeasuredMotions, expected_covariance

MOUNT = "mount:"
"""Of the convention's name, before roll, pitch and yaw (degrees) of the camera's axes in those of the body,
and x, y and z (m) of the camera there, with slashes between."""
MOTIONS_OF_STARTS = 200
"""That tell which start leads furthest down."""

OPTICAL_AXES = se3.make_transform(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.zeros(3))
"""body_from_cam of a camera that looks ahead from a body with x forward, y left and z up (ROS, REP 103)."""
_STARTS = (np.eye(4), OPTICAL_AXES, np.diag([1.0, -1.0, -1.0, 1.0]))
"""Beside those that the motions show: axes as ours, of ROS, of OpenGL."""


def mount_named(body_from_cam: Float[np.ndarray, "4 4"]) -> str:
    """Name of the convention, to a thousandth of a degree and a tenth of a millimetre."""
    turn_deg = Rotation.from_matrix(body_from_cam[:3, :3]).as_euler("xyz", degrees=True)
    numbers = [f"{v:.3f}" for v in turn_deg] + [f"{v:.4f}" for v in body_from_cam[:3, 3]]
    return MOUNT + "/".join(numbers)


def mount_of(name: str) -> Float[np.ndarray, "4 4"] | None:
    """body_from_cam that a convention names; None where it names none."""
    turn_deg, arm_m = mount_numbers(name)
    if not turn_deg:
        return None
    turn = Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix()
    return se3.make_transform(turn, np.array(arm_m))


def mount_numbers(name: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Roll, pitch and yaw (degrees), x, y and z (m) of a convention's name; empty where it names none."""
    if not name.startswith(MOUNT):
        return (), ()
    try:
        numbers = tuple(float(part) for part in name[len(MOUNT) :].split("/"))
    except ValueError:
        return (), ()
    is_mount = len(numbers) == 6 and np.isfinite(numbers).all()
    return (numbers[:3], numbers[3:]) if is_mount else ((), ())


def mount_by_motions(
    world_from_bodies: Poses, motions: MeasuredMotions, odometry: Odometry
) -> Float[np.ndarray, "4 4"]:
    """body_from_cam under which the measured motions of the camera are likeliest.

    Arms along an axis about which all turns are made cannot be told, nor do they matter: they are 0.

    Args:
        odometry: steps of the body, for how sure they are.
    """
    covariance = expected_covariance(motions, odometry)
    whitener = np.linalg.inv(np.linalg.cholesky(covariance))
    starts = [*_STARTS, *_turns_shown(world_from_bodies, motions, whitener)]
    some = np.unique(np.linspace(0, len(motions) - 1, MOTIONS_OF_STARTS).astype(int))
    near = [_fitted(each, world_from_bodies, motions[some], whitener[some]) for each in starts]
    start, _ = min(near, key=lambda each: each[1])
    return _fitted(start, world_from_bodies, motions, whitener)[0]


def _turns_shown(
    poses: Poses, motions: MeasuredMotions, whitener: Float[np.ndarray, "p 6 6"]
) -> list[Float[np.ndarray, "4 4"]]:
    """Turns that bring axes of rotations, and with them directions of steps, of the camera to the body's."""
    i, j = motions.pairs.T
    of_body, of_cam = se3.inverse(poses[i]) @ poses[j], motions.a_from_b
    surety = np.diagonal(whitener, axis1=1, axis2=2)
    rotations = [se3.log_so3(each[:, :3, :3]) * surety[:, :1] for each in (of_body, of_cam)]
    steps = [each[:, :3, 3] * surety[:, 3:4] for each in (of_body, of_cam)]
    found = []
    for body, cam in (
        rotations,
        [np.concatenate(each) for each in zip(rotations, steps, strict=True)],
    ):
        # Longest ones count no more than others: false motions are among them.
        length = np.linalg.norm(body, axis=1) * np.linalg.norm(cam, axis=1)
        product = (body / np.sqrt(length + 1e-12)[:, None]).T @ (
            cam / np.sqrt(length + 1e-12)[:, None]
        )
        found.append(se3.make_transform(se3.project_to_so3(product), np.zeros(3)))
    return found


def _fitted(
    start: Float[np.ndarray, "4 4"],
    poses: Poses,
    motions: MeasuredMotions,
    whitener: Float[np.ndarray, "p 6 6"],
) -> tuple[Float[np.ndarray, "4 4"], float]:
    """body_from_cam from a start on, and its cost, a negative log likelihood."""
    i, j = motions.pairs.T
    of_body = se3.inverse(poses[i]) @ poses[j]

    def residual(mounts: Float[np.ndarray, "p 1 4 4"]) -> Float[np.ndarray, "p 6"]:
        of_cam = se3.inverse(mounts[:, 0]) @ of_body @ mounts[:, 0]
        return np.einsum("pij,pj->pi", whitener, se3.difference(motions.a_from_b, of_cam))

    # The t-distribution's tails are Cauchy's loss.
    tails, weight = Loss(LossKind.CAUCHY, float(np.sqrt(FREEDOM))), (FREEDOM + 6.0) / FREEDOM
    of_motions = ResidualTerm(np.zeros((len(i), 1), int), residual, loss=tails, weight=weight)
    of_arm = PosePriorTerm(
        np.array([0]), np.eye(4)[None], np.repeat([np.inf, MOUNT_ARM_SIGMA_M.value], 3)
    )
    solution = Problem([of_motions, of_arm], start[None]).solve(SolverOptions(cost_tolerance=1e-9))
    cost = sum(each.after for each in solution.cost_by_term.values())
    return solution.target_from_cams[0], cost


UNIT = "unit:"
"""Of the convention's name, before the metres that a unit is."""
MIN_DEPARTURE = 1.1
"""Factor from which on poses are in another unit. What is less may as well be depth that is a little off:
which of the two, calibration decides."""


def unit_named(metres: float) -> str:
    """Name of the convention: translations are in units of so many metres."""
    return f"{UNIT}{metres:.5g}"


def metres_named(name: str) -> float | None:
    """Metres of the unit that a convention names; None where it names none, or nothing above 0."""
    if not name.startswith(UNIT):
        return None
    try:
        metres = float(name[len(UNIT) :])
    except ValueError:
        return None
    return metres if 0 < metres < np.inf else None


def unit_of(convention: str) -> float:
    """Metres of the unit of their own that poses in this convention have; 1 where they have none."""
    named = [metres_named(part) for part in convention.split(", ")]
    return next((metres for metres in named if metres is not None), 1.0)


def in_metres(poses: Poses, metres: float) -> Poses:
    """Poses whose translations are in units of so many metres."""
    return se3.make_transform(poses[:, :3, :3], poses[:, :3, 3] * metres)


def unit_by_motions(poses: Poses, motions: MeasuredMotions) -> float | None:
    """Metres of the unit in which recorded steps are as long as those measured; None where that is a metre.

    Recorded steps are smooth where a tracker is good, so what was measured is taken as a share of them.
    Where they are noisier than what was measured, that share is too low, and the inverse share the right one:
    both have to say so. Directions that measured motions leave free weigh nothing: surfaces are brought
    together from the recorded motion, and stay there in these.
    """
    low, high = (
        _share(poses, motions, of_recorded=True),
        1 / max(share_of_measured(poses, motions), 1e-12),
    )
    is_metre = min(low, high) < MIN_DEPARTURE and max(low, high) > 1 / MIN_DEPARTURE
    return None if low <= 0 or is_metre else low


def share_of_measured(poses: Poses, motions: MeasuredMotions) -> float:
    """Of the length of measured steps, how long recorded ones are along these.

    Noise makes steps longer but not along the measured direction.
    """
    return _share(poses, motions, of_recorded=False)


def _share(poses: Poses, motions: MeasuredMotions, of_recorded: bool) -> float:
    """Of one kind of steps along the other by the length of these: the median, each by how surely it is told;
    0 of none."""
    i, j = motions.pairs.T
    recorded = (se3.inverse(poses[i]) @ poses[j])[:, :3, 3]
    measured = motions.a_from_b[:, :3, 3]
    of = recorded if of_recorded else measured
    surety = np.linalg.inv(motions.covariance[:, 3:, 3:])
    squared = np.einsum("pi,pij,pj->p", of, surety, of)
    along = np.einsum("pi,pij,pj->p", recorded, surety, measured)
    moved = np.flatnonzero(squared > 0)
    if len(moved) == 0:
        return 0.0
    shares = along[moved] / squared[moved]
    order = np.argsort(shares)
    weight = np.cumsum(squared[moved][order])
    return float(shares[order][np.searchsorted(weight, weight[-1] / 2)])

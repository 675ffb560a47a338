"""Steps and stretches of a recorded trajectory that measured motions contradict, and what takes their place.

A hypothesis says that some frames stand elsewhere, rigidly: all after a step (the tracker jumped there), or a
few in a row (outliers). The motions with one end among those frames say where instead, each for itself; in
directions that all of them leave free, the walk goes on as it did before. A hypothesis holds if several of
them agree on one displacement which explains them better than none does. A false motion stands alone, and
contradicts those that span the same steps.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.priors import STEP_AT_VIDEO_RATE_M, TRACKER_TILT_SIGMA_DEG
from planfit.scan.odometry import (
    LONG,
    MOST_UNUSUAL,
    Odometry,
    times_usual,
    unusualness,
    usual_step,
)
from planfit.tracking.motions import (
    MAX_SIGMAS,
    MIN_MATCHES_ALONE,
    MeasuredMotions,
    departures,
    expected_covariance,
    squared_sigmas,
)

TRUNCATION = 8.0
"""Departures beyond so many sigmas count no more: a false motion is false, however far off."""
MAX_STRETCH = 3
"""Frames in a row that are taken for outliers; more are two breaks."""
MAX_CONTRADICTED = 0.4
"""Where a larger share of the motions contradicts the poses, what is broken is no single step."""
MIN_JUMP_M = STEP_AT_VIDEO_RATE_M.value
"""A tracker has jumped where it went astray by at least this; robust losses take care of less."""
MIN_JUMP_DEG = 8.0
"""Or where it turned astray by at least this."""


@dataclass(frozen=True)
class Displacement:
    """Frames that stand elsewhere than recorded, by what was measured."""

    first: int
    last: int
    """Inclusive; the last frame of the scan where all that follows was displaced."""
    world_from_recorded: Float[np.ndarray, "4 4"]
    covariance: Float[np.ndarray, "6 6"]
    """Of its rotation (rad), and of where it puts the displaced frames about the step (m), world axes."""
    n_motions: int
    """Measured motions that say so."""
    gain: float
    """By how much less they depart, squared sigmas."""

    @property
    def sigmas(self) -> tuple[float, float]:
        """Of rotation (rad) and translation (m), each axis."""
        return isotropic(self.covariance)


@dataclass(frozen=True)
class Votes:
    """What each motion with one end among the displaced frames says of the displacement."""

    displaced: Float[np.ndarray, "k 4 4"]
    """Displacement that would make the motion as measured."""
    covariance: Float[np.ndarray, "k 6 6"]
    """Of its rotation, and of where it puts `pivot`, world axes."""
    pivot: Float[np.ndarray, "3"]
    n_inliers: Int[np.ndarray, " k"]
    ends: Int[np.ndarray, "k 2"]
    """The frame at the end that stays, and the one among the displaced."""

    def apart(self, displaced: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "k 6"]:
        """Tangents from a displacement to the votes: rotation, and way of the pivot."""
        return _apart(self.displaced, displaced, self.pivot)

    def cost(
        self, displaced: Float[np.ndarray, "4 4"], own: Float[np.ndarray, "6 6"] | float = 0.0
    ) -> Float[np.ndarray, " k"]:
        """Squared sigmas at a displacement, truncated; `own` is its covariance."""
        squared = squared_sigmas(self.apart(displaced), self.covariance + own)
        return np.minimum(squared, TRUNCATION**2)


def find_displacement(
    world_from_cams: Poses,
    odometry: Odometry,
    motions: MeasuredMotions,
    up_world: Float[np.ndarray, "3"] | None = None,
) -> Displacement | None:
    """The displacement that measured motions are most in favour of; None where none is sure.

    Args:
        world_from_cams: poses as recorded, or after earlier displacements.
        odometry: with sigmas that fit this tracker.
        up_world: unit vector against gravity, where the tracker knows it.
    """
    if len(motions) == 0:
        return None
    covariance = expected_covariance(motions, odometry)
    squared = squared_sigmas(departures(motions, world_from_cams), covariance)
    contradicts = squared > MAX_SIGMAS**2
    best: Displacement | None = None
    best_rank = 0.0
    if np.mean(contradicts) > MAX_CONTRADICTED:
        return None
    usual = usual_step(se3.inverse(world_from_cams[:-1]) @ world_from_cams[1:])
    for first, last in _hypotheses(motions.pairs[contradicts], len(world_from_cams)):
        inside = np.zeros(len(world_from_cams), dtype=bool)
        inside[first : last + 1] = True
        # Only motions with exactly one end among the frames see that they were displaced.
        of = inside[motions.pairs[:, 0]] != inside[motions.pairs[:, 1]]
        # No displacement can gain more than making all contradictions vanish.
        bound = np.minimum(squared[of], TRUNCATION**2)[contradicts[of]].sum()
        if best is not None and bound + MOST_UNUSUAL**2 <= best_rank:
            continue
        votes = votes_on(world_from_cams, motions[of], covariance[of], inside)
        found = _agreed(votes, (first, last), contradicts[of])
        if found is None:
            continue
        is_tail = last == len(world_from_cams) - 1
        if is_tail:
            found = _as_upright(found, votes.pivot, up_world)
            found = _as_walked(found, votes.pivot, world_from_cams, usual)
        if is_tail and _is_blind(world_from_cams, votes, found, contradicts[of], usual):
            continue
        rank = found.gain
        if is_tail:
            recorded, corrected = unusualness(_steps_at(world_from_cams, found), usual)
            rank += float(recorded - corrected)
        if best is not None and rank <= best_rank:
            continue
        if is_tail or _is_seen_from_both_sides(votes, found, contradicts[of]):
            best, best_rank = found, rank
    return best


def _steps_at(world_from_cams: Poses, jump: Displacement) -> Float[np.ndarray, "2 4 4"]:
    """The step onto the displaced frames, as recorded and corrected."""
    before, after = world_from_cams[jump.first - 1], world_from_cams[jump.first]
    return se3.inverse(before) @ np.stack([after, jump.world_from_recorded @ after])


def _is_blind(
    world_from_cams: Poses,
    votes: Votes,
    jump: Displacement,
    contradicts: Bool[np.ndarray, " k"],
    usual: tuple[float, float],
) -> bool:
    """Whether a jump that makes no long step usual rests on surfaces that may have slid together.

    A tracker that jumps makes a usual step long. Surfaces repeat, in corridors above all, and neighbouring
    pairs slide by the same way: two of them turned steps of 0.8 m, like all about it, into 1.7 m, and six a
    long one of 0.9 m, a jump, into 1.6 m. What looks alike from a frame does so beside each of its
    neighbours: two of one frame made 0.43 m of a step of 0.30.
    """
    recorded, corrected = times_usual(_steps_at(world_from_cams, jump), usual) / LONG
    supports = (votes.cost(jump.world_from_recorded) < MAX_SIGMAS**2) & contradicts
    is_sure = (votes.n_inliers[supports] >= MIN_MATCHES_ALONE).any()
    if is_sure or corrected <= 1.0 < recorded:
        return False
    ends = votes.ends[supports]
    shares_no_frame = (ends[:, None] != ends).all(axis=2)
    return bool(corrected > max(recorded, 1.0) or not shares_no_frame.any())


def _hypotheses(pairs: np.ndarray, n: int) -> list[tuple[int, int]]:
    """Runs of frames (first, last) whose displacement would explain one of the contradictions (c, 2)."""
    found = set()
    for a, b in pairs.tolist():
        found |= {(step + 1, n - 1) for step in range(a, b)}
        for size in range(1, MAX_STRETCH + 1):
            for inside in (a, b):
                starts = range(max(inside - size + 1, 1), min(inside, n - 1 - size) + 1)
                found |= {(s, s + size - 1) for s in starts if not s <= a < b < s + size}
    return sorted(found)


def votes_on(
    world_from_cams: Poses,
    motions: MeasuredMotions,
    covariance: Float[np.ndarray, "k 6 6"],
    inside: Bool[np.ndarray, " n"],
) -> Votes:
    """What motions with exactly one end among the frames `inside` say of the displacement of these."""
    a, b = motions.pairs.T
    is_second = inside[b]
    # Seen from the end that stays: out_from_in, with its covariance in the axes of `out`.
    out, within = np.where(is_second, a, b), np.where(is_second, b, a)
    flip = is_second[:, None, None]
    out_from_in = np.where(flip, motions.a_from_b, se3.inverse(motions.a_from_b))
    covariance = np.where(flip, covariance, _of_inverse(motions.a_from_b, covariance))
    displaced = world_from_cams[out] @ out_from_in @ se3.inverse(world_from_cams[within])
    # A tangent (w, v) of out_from_in turns the displaced frames by A w (A the rotation of `out`), and moves
    # the pivot c by A v + (A w) x r, with r the way from the displaced camera to the displaced c.
    pivot = world_from_cams[within, :3, 3].mean(axis=0)
    axes = world_from_cams[out, :3, :3]
    arm = (displaced[:, :3, :3] @ (pivot - world_from_cams[within, :3, 3])[:, :, None])[..., 0]
    jacobian = np.zeros((len(out), 6, 6))
    jacobian[:, :3, :3] = jacobian[:, 3:, 3:] = axes
    jacobian[:, 3:, :3] = -se3.skew(arm) @ axes
    moved = jacobian @ covariance @ np.swapaxes(jacobian, 1, 2)
    return Votes(displaced, moved, pivot, motions.n_inliers, np.column_stack([out, within]))


def _of_inverse(a_from_b: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Covariances (k, 6, 6) of inverse motions, in the axes of b.

    The inverse of (exp(w) R, t + v) turns by -R^T w, and its translation changes by R^T (w x t - v).
    """
    rotation_t = np.swapaxes(a_from_b[:, :3, :3], 1, 2)
    jacobian = np.zeros_like(covariance)
    jacobian[:, :3, :3] = jacobian[:, 3:, 3:] = -rotation_t
    jacobian[:, 3:, :3] = -rotation_t @ se3.skew(a_from_b[:, :3, 3])
    return jacobian @ covariance @ np.swapaxes(jacobian, 1, 2)


def consensus(
    votes: Votes, generators: Int[np.ndarray, " g"], max_sigmas: float
) -> tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "6 6"]] | None:
    """The displacement that most votes agree on, one of `generators` among them, and its covariance."""
    costs = [votes.cost(votes.displaced[k], votes.covariance[k]).sum() for k in generators]
    if not costs:
        return None
    best = generators[int(np.argmin(costs))]
    displaced, covariance = votes.displaced[best], votes.covariance[best]
    for _ in range(3):  # mean of those that agree, by their information
        agrees = votes.cost(displaced, covariance) < max_sigmas**2
        if not agrees.any():
            return None
        information = np.linalg.inv(votes.covariance[agrees])
        covariance = np.linalg.inv(information.sum(axis=0))
        off = (information @ votes.apart(displaced)[agrees][:, :, None]).sum(axis=0)
        displaced = _moved(displaced, (covariance @ off)[:, 0], votes.pivot)
    return displaced, covariance


def _agreed(votes: Votes, run: tuple[int, int], contradicts: np.ndarray) -> Displacement | None:
    """The displacement of a run of frames that most votes agree on; None where too few do."""
    found = consensus(votes, np.flatnonzero(contradicts), MAX_SIGMAS)
    if found is None:
        return None
    displaced, covariance = found
    at = votes.cost(displaced)
    gain = float((votes.cost(np.eye(4)) - at).sum())
    supports = (at < MAX_SIGMAS**2) & contradicts
    if gain < MAX_SIGMAS**2 or not _is_confirmed(votes.n_inliers[supports]):
        return None
    if not is_large(displaced, votes.pivot):
        return None
    return Displacement(*run, displaced, covariance, int(supports.sum()), gain)


def _as_walked(
    jump: Displacement,
    pivot: Float[np.ndarray, "3"],
    world_from_cams: Poses,
    usual: tuple[float, float],
) -> Displacement:
    """The displacement where motions leave a direction free as if the walk went on by the step before, half a
    usual step either way, as of steps left open.

    Surfaces of a corridor tell nothing along it: five of them put a walk 0.75 m from where it was.
    """
    before = world_from_cams[jump.first - 1]
    ahead = np.eye(4)
    if jump.first > 1:
        ahead = se3.inverse(world_from_cams[jump.first - 2]) @ before
    walked = before @ ahead @ se3.inverse(world_from_cams[jump.first])
    length, angle = usual
    prior = np.diag(np.repeat([(angle / 2) ** -2, (length / 2) ** -2], 3))
    way = _apart(walked[None], jump.world_from_recorded, pivot)[0]
    return _with_prior(jump, pivot, prior, way)


def _as_upright(
    jump: Displacement, pivot: Float[np.ndarray, "3"], up_world: Float[np.ndarray, "3"] | None
) -> Displacement:
    """The displacement as of a tracker that knows gravity, which jumps level and turns about the vertical;
    as it is where motions contradict that, and the tracker began anew.

    Surfaces along a corridor hardly tell which way it is level: four pairs of frames, 5 degrees unsure, had
    a walk climb by 1.4 m with 12.
    """
    if up_world is None:
        return jump
    level = np.eye(3) - np.outer(up_world, up_world)
    tilt = level @ se3.log_so3(jump.world_from_recorded[None, :3, :3])[0]
    variance = np.deg2rad(TRACKER_TILT_SIGMA_DEG.value) ** 2
    total = level @ jump.covariance[:3, :3] @ level + variance * np.eye(3)
    if tilt @ np.linalg.solve(total, tilt) > MAX_SIGMAS**2:
        return jump
    prior = np.zeros((6, 6))
    prior[:3, :3] = level / variance
    return _with_prior(jump, pivot, prior, np.concatenate([-tilt, np.zeros(3)]))


def _with_prior(
    jump: Displacement,
    pivot: Float[np.ndarray, "3"],
    information: Float[np.ndarray, "6 6"],
    way: Float[np.ndarray, "6"],
) -> Displacement:
    """The displacement as its motions and a prior have it, whose mean is a tangent `way` from it."""
    both = np.linalg.inv(np.linalg.inv(jump.covariance) + information)
    displaced = _moved(jump.world_from_recorded, both @ information @ way, pivot)
    return replace(jump, world_from_recorded=displaced, covariance=both)


def isotropic(covariance: Float[np.ndarray, "6 6"]) -> tuple[float, float]:
    """Sigmas of rotation (rad) and translation (m), each axis."""
    rotation, translation = covariance[:3, :3], covariance[3:, 3:]
    return float(np.sqrt(np.trace(rotation) / 3)), float(np.sqrt(np.trace(translation) / 3))


def _is_confirmed(n_inliers: np.ndarray) -> bool:
    """Whether two motions agree, or one of many matches says so."""
    return len(n_inliers) >= 2 or bool((n_inliers >= MIN_MATCHES_ALONE).any())


def is_large(displaced: Float[np.ndarray, "4 4"], pivot: Float[np.ndarray, "3"]) -> bool:
    """Whether a displacement is more than what robust losses take care of."""
    way = float(np.linalg.norm(displaced[:3, :3] @ pivot + displaced[:3, 3] - pivot))
    angle = float(np.rad2deg(se3.rotation_angle(displaced[:3, :3])))
    return is_far(way, angle)


def is_far(way_m: float, angle_deg: float) -> bool:
    """Whether a tracker that went astray by so much has jumped."""
    return bool(are_far(np.array([way_m]), np.array([angle_deg]))[0])


def are_far(
    way_m: Float[np.ndarray, " s"], angle_deg: Float[np.ndarray, " s"]
) -> Bool[np.ndarray, " s"]:
    """The same of many."""
    return (way_m >= MIN_JUMP_M) | (angle_deg >= MIN_JUMP_DEG)


def _is_seen_from_both_sides(votes: Votes, found: Displacement, contradicts: np.ndarray) -> bool:
    """Whether frames before and after a stretch both say that it stands elsewhere.

    Where only one side does, the tracker may as well have jumped and stayed: the simpler hypothesis.
    """
    supports = votes.cost(found.world_from_recorded) < MAX_SIGMAS**2
    sides = votes.ends[supports & contradicts, 0] < found.first
    return bool(sides.any() and not sides.all())


def _apart(
    others: Float[np.ndarray, "k 4 4"],
    displaced: Float[np.ndarray, "4 4"],
    pivot: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "k 6"]:
    """Tangents from a displacement to others: rotation, and way of the pivot."""
    turned = others[:, :3, :3] @ displaced[:3, :3].T
    there = displaced[:3, :3] @ pivot + displaced[:3, 3]
    way = se3.transform(others, pivot[None])[:, 0] - there
    return np.concatenate([se3.log_so3(turned), way], axis=1)


def _moved(displaced: np.ndarray, tangent: np.ndarray, pivot: np.ndarray) -> np.ndarray:
    """A displacement (4, 4) that turns more by tangent[:3] and puts `pivot` further by tangent[3:]."""
    at = displaced[:3, :3] @ pivot + displaced[:3, 3] + tangent[3:]
    rotation = se3.exp_so3(tangent[:3]) @ displaced[:3, :3]
    return se3.make_transform(rotation, at - rotation @ pivot)

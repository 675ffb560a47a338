"""Which motions by surfaces others confirm: surfaces are alike from door to door, and in every corner."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from planfit.geometry import se3
from planfit.geometry.calibration import PARAMETERS
from planfit.geometry.se3 import Poses
from planfit.matching.cycles import MAX_SIGMAS, told_by
from planfit.matching.surfaces.types import NULL_SHARE, SurfacePairs
from planfit.matching.types import RelativePoses
from planfit.matching.visits import LINK_M
from planfit.priors import SURE_SIGMAS
from planfit.scan.odometry import Odometry

_SLACK_M = 0.15
"""Departure, rotations by their lever, up to which two revisits of one visit agree, besides their sigmas."""
_ALIAS_SHARE = 0.15
"""Of a quarter turn: motions off the recorded ones by so nearly one, two or three of them are an alias."""
AGREE_SIGMAS = SURE_SIGMAS.value
"""Up to which two motions agree, by their own sigmas and the slack."""


def squared_sigmas(
    found: SurfacePairs,
    predicted: Float[np.ndarray, "p 4 4"],
    sigmas: tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]],
) -> Float[np.ndarray, " p"]:
    """Squared norms of departures from predicted motions, in what each pair observes.

    With information W = L L^T, L (6, rank): L^T d is of unit covariance, besides L^T C L of the predicted.
    """
    off = se3.difference(predicted, found.a_from_b)
    result = np.zeros(len(found))
    for k, information in enumerate(found.information):
        values, vectors = np.linalg.eigh(information)
        is_held = values > NULL_SHARE * values[-1]
        factor = vectors[:, is_held] * np.sqrt(values[is_held])
        variances = np.repeat([sigmas[0][k] ** 2, sigmas[1][k] ** 2], 3)
        total = factor.T @ (variances[:, None] * factor) + np.eye(factor.shape[1])
        scaled = factor.T @ off[k]
        result[k] = scaled @ np.linalg.solve(total, scaled)
    return result


def is_witnessed(
    found: SurfacePairs, matched: RelativePoses, world_from_cams: Poses, odometry: Odometry
) -> Bool[np.ndarray, " p"]:
    """Neighbours that agree with the recorded motion, or with two others by way of a third frame.

    Who contradicts the recorded motion says that the tracker jumped: not off by quarter turns, as corners of
    a room are alike, and not where other motions over the same steps, which would show the jump, show none.

    Args:
        found: neighbours by their surfaces.
        matched: by keypoints.
    """
    i, j = found.pairs.T
    recorded = se3.inverse(world_from_cams[i]) @ world_from_cams[j]
    most = MAX_SIGMAS**2
    is_recorded = squared_sigmas(found, recorded, odometry.sigma_between(i, j)) < most
    off = np.swapaxes(recorded[:, :3, :3], 1, 2) @ found.a_from_b[:, :3, :3]
    quarters = np.rad2deg(se3.rotation_angle(off)) / 90.0
    is_alias = (np.rint(quarters) > 0) & (np.abs(quarters - np.rint(quarters)) < _ALIAS_SHARE)
    others = found[is_recorded].joined(_as_surfaces(matched))
    in_doubt = np.flatnonzero(~is_recorded & ~is_alias)
    closes = _close_triangles(found, matched, in_doubt)
    is_right = is_recorded.copy()
    for k in in_doubt[closes]:
        is_right[k] = not _is_ruled_out(found, int(k), others, world_from_cams)
    return is_right


def _as_surfaces(matched: RelativePoses) -> SurfacePairs:
    """Motions by keypoints as if by surfaces that leave nothing free, as sure as the slack."""
    n = len(matched)
    information = np.diag(np.repeat([(_SLACK_M / 3.0) ** -2, _SLACK_M**-2], 3))
    return SurfacePairs(
        matched.pairs,
        matched.a_from_b,
        np.tile(information, (n, 1, 1)),
        np.ones(n),
        np.zeros((n, 6, len(PARAMETERS))),
        np.ones(n),
    )


def _close_triangles(
    found: SurfacePairs, matched: RelativePoses, idx: Int[np.ndarray, " q"]
) -> Bool[np.ndarray, " q"]:
    """Whether two other motions, by way of a third frame, say the same as each of some pairs."""
    motions = {
        (int(a), int(b)): motion
        for known in (matched, found)
        for (a, b), motion in zip(known.pairs, known.a_from_b, strict=True)
    }
    motions |= {(b, a): se3.inverse(m) for (a, b), m in motions.items()}
    near: dict[int, list[int]] = {}
    for a, b in motions:
        near.setdefault(a, []).append(b)
    closes = np.zeros(len(idx), dtype=bool)
    for q, k in enumerate(idx):
        a, b = (int(v) for v in found.pairs[k])
        ways = [motions[a, c] @ motions[c, b] for c in near[a] if (c, b) in motions]
        if ways:
            same = found[np.full(len(ways), k)]
            closes[q] = (
                squared_sigmas(same, np.stack(ways), _slack(len(ways))) < AGREE_SIGMAS**2
            ).any()
    return closes


def _is_ruled_out(
    found: SurfacePairs, k: int, others: SurfacePairs, world_from_cams: Poses
) -> bool:
    """Whether others say of every step of pair k that the tracker did not jump there as pair k says.

    They are motions by surfaces that agree with the recorded one, and all by keypoints: one that shows the
    same jump agrees with pair k. If the tracker jumped in a step that both pairs span, then as far as pair k
    says: the other's motion follows, and where it differs from what was measured, in what that observes, the
    step is ruled out.
    """
    a, b = (int(v) for v in found.pairs[k])
    spans = others[(others.pairs[:, 0] < b) & (others.pairs[:, 1] > a)]
    if len(spans) == 0:
        return False
    c, d = spans.pairs.T
    to_first = se3.inverse(world_from_cams[c]) @ world_from_cams[a]
    to_last = se3.inverse(world_from_cams[b]) @ world_from_cams[d]
    with_jump = to_first @ found.a_from_b[k] @ to_last
    speaks = squared_sigmas(spans, with_jump, _slack(len(spans))) > AGREE_SIGMAS**2
    steps = np.arange(a, b)
    return bool(((c[speaks, None] <= steps) & (steps < d[speaks, None])).any(axis=0).all())


def _slack(n: int) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    return np.full(n, _SLACK_M / 3.0), np.full(n, _SLACK_M)


def is_supported(loops: SurfacePairs, poses: Poses, odometry: Odometry) -> Bool[np.ndarray, " p"]:
    """Revisits that another one of the same visit agrees with: a false one seldom finds its like."""
    if len(loops) == 0:
        return np.zeros(0, dtype=bool)
    walked = odometry.walked_m[loops.pairs]
    links = cKDTree(walked).query_pairs(LINK_M, p=np.inf, output_type="ndarray")
    as_poses = RelativePoses(loops.pairs, loops.a_from_b, np.zeros(len(loops), int))
    supported = np.zeros(len(loops), dtype=bool)
    for one, other in (links.T, links.T[::-1]):
        predicted, (rotation, translation) = told_by(
            as_poses[other], loops.pairs[one], poses, odometry
        )
        sigmas = np.hypot(rotation, _SLACK_M / 3.0), np.hypot(translation, _SLACK_M)
        agrees = squared_sigmas(loops[one], predicted, sigmas) < AGREE_SIGMAS**2
        supported[one[agrees]] = True
    return supported

"""What fixes a scan in each direction: the information that each kind of evidence has on it.

The walk is cut into stretches. Each is taken as one rigid body, all else held where it is; what resists when
it is moved along x, y or z, or turned about the vertical, is what fixes it: walls and floors it sees, places
seen again from another stretch, and the frames just before and after it. So each figure is of one stretch
against the rest, and a mean over stretches; what the whole is fixed by together is the predicted error.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.problem import AdjustmentProblem
from planfit.adjust.rigid_motion import rigid_information, rigid_tangents
from planfit.lsq import Term
from planfit.lsq.blocks import NormalBlocks
from planfit.runtime import short_repr

DIRECTIONS = {"x": 3, "y": 4, "z": 5, "heading": 2}
"""Entry of a tangent (rotation, translation) in the axes of the plan, z up."""
LOOPS, NEIGHBOURS = "places seen again", "frames before and after"
"""What frames of another stretch hold: one that does not follow, and one that does."""
_NAMES = {"odometry": "recorded motion"}
"""Of terms whose own names say too little."""


@dataclass(frozen=True)
class DirectionStrength:
    """What fixes one direction."""

    direction: str
    """x, y, z or heading: along the axes of the plan, and about the vertical."""
    sigma: float
    """Predicted standard deviation of the frames, root mean square; m, of the heading degrees."""
    shares: tuple[tuple[str, float], ...]
    """Kinds of evidence, and their shares of the information, the largest first: means over stretches."""
    weakest_frames: tuple[int, int]
    """First and last frame, as numbered in the scan, of the stretch with the least information."""
    weakest_share: float
    """Its information, as a share of the median stretch's."""

    __repr__ = short_repr

    @property
    def unit(self) -> str:
        """Of `sigma`."""
        return "deg" if self.direction == "heading" else "m"


def directions_held(
    problem: AdjustmentProblem,
    target_from_cams: Float[np.ndarray, "k 4 4"],
    stretch: Int[np.ndarray, " k"],
    covariances: Float[np.ndarray, "k 6 6"],
    frame_idx: Int[np.ndarray, " k"],
) -> tuple[DirectionStrength, ...]:
    """What fixes each direction, by the terms at the poses where their solve ended.

    Args:
        covariances: predicted, as `Evidence.pose_covariances`.
    """
    unknowns = problem.unknowns.copy()
    unknowns[: len(target_from_cams)] = target_from_cams
    relative = [t for t in (problem.geometric, problem.by_hand, problem.surfaces) if t is not None]
    links = [_blocks(term, unknowns) for term in relative]
    others = [
        (_NAMES.get(term.name, term.name), _blocks(term, unknowns))
        for term in problem.terms_but_geometric
        if term is not problem.gauge and not any(term is each for each in relative)
    ]
    names = [LOOPS, NEIGHBOURS, *dict.fromkeys(name for name, _ in others)]
    n_stretches = int(stretch.max()) + 1
    found = np.zeros((n_stretches, len(names), 6))
    for k in range(n_stretches):
        own = np.flatnonzero(stretch == k)
        for part in links:
            found[k, :2] += _across(part, unknowns, stretch, k)
        for name, part in others:
            information = np.diagonal(rigid_information([part], unknowns, own))
            found[k, names.index(name)] += np.maximum(information, 0.0)
    sigmas = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    frames = [frame_idx[stretch == k] for k in range(n_stretches)]
    return tuple(
        _direction(name, found[:, :, axis], names, frames, sigmas[:, axis])
        for name, axis in DIRECTIONS.items()
    )


def _direction(
    direction: str,
    information: Float[np.ndarray, "s t"],
    names: Sequence[str],
    frames: Sequence[Int[np.ndarray, " ..."]],
    sigmas: Float[np.ndarray, " k"],
) -> DirectionStrength:
    total = information.sum(axis=1)
    held = total > 0
    shares = np.zeros(len(names))
    if held.any():
        shares = (information[held] / total[held, None]).mean(axis=0)
    order = [int(k) for k in np.argsort(-shares, kind="stable") if shares[k] > 0]
    weakest = int(np.argmin(total))
    own, median = frames[weakest], float(np.median(total))
    sigma = float(np.sqrt(np.mean(sigmas**2)))
    return DirectionStrength(
        direction,
        float(np.rad2deg(sigma)) if direction == "heading" else sigma,
        tuple((names[k], float(shares[k])) for k in order),
        (int(own[0]), int(own[-1])),
        float(total[weakest] / median) if median > 0 else 0.0,
    )


def _blocks(term: Term, unknowns: Float[np.ndarray, "u 4 4"]) -> NormalBlocks:
    return term.reweight(unknowns)[0].normal_blocks(unknowns)


def _across(
    part: NormalBlocks,
    unknowns: Float[np.ndarray, "u 4 4"],
    stretch: Int[np.ndarray, " k"],
    number: int,
) -> Float[np.ndarray, "2 6"]:
    """Information of pairs of frames on a stretch moved as one: pairs with a stretch that does not follow
    it or go before it, and with one that does.

    A pair's cost does not change when both frames move as one. So what resists when one of them alone moves
    is, but for its sign, the block between both.
    """
    is_link = part.rows != part.columns
    rows, columns, blocks = part.rows[is_link], part.columns[is_link], part.blocks[is_link]
    a, b = stretch[rows], stretch[columns]
    is_across = (a != b) & ((a == number) | (b == number))
    rows, columns, blocks = rows[is_across], columns[is_across], blocks[is_across]
    own = np.flatnonzero(stretch == number)
    positions = unknowns[: len(stretch), :3, 3]
    rigid = rigid_tangents(positions, positions[own].mean(axis=0))
    resisted = -np.einsum("pik,pij,pjk->pk", rigid[rows], blocks, rigid[columns])
    is_loop = np.abs(a - b)[is_across] > 1
    both = np.stack([resisted[is_loop].sum(axis=0), resisted[~is_loop].sum(axis=0)])
    return np.maximum(both, 0.0)

"""How two scans stand to each other, by vote of the frames that show the same place.

Both stand upright with the floor at 0, so a verified pair of frames votes for a yaw and a place on the floor;
one that would tilt a scan, or lift it, is wrong. What moved between two visits, and rooms that look alike,
vote for other places: the scans are linked where one place is far ahead of the next.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from planfit.geometry import se3
from planfit.matching import RelativePoses
from planfit.matching.pairs import VISIT_FRAMES
from planfit.tracking.types import MIN_WITNESSES

MAX_TILT_DEG, MAX_LIFT_M = 8.0, 0.5
"""A scan that is levelled, floor at 0, does not stand tilted or higher by more: its own drift is less."""
AGREE_M, AGREE_DEG = 1.0, 8.0
"""Votes that put a camera this near to each other are for one place: either scan has drifted."""
RUN_FRAMES = VISIT_FRAMES
"""Votes of frames of the same two runs of so many keyframes count as one: they share their errors."""
MIN_RUNS = 2
MIN_ADVANTAGE = 2.0
"""The weight of a place over that of the next best. Right and wrong verified pairs of two visits to a
synthetic flat: 81 to 1."""


@dataclass(frozen=True)
class Link:
    """How two scans stand to each other."""

    first: int
    second: int
    first_from_second: Float[np.ndarray, "4 4"]
    """Between their level frames."""
    n_votes: int
    """Pairs of frames that say so."""
    weight: float
    """How much they explain, the best of each two runs of frames."""


def link_by_votes(
    first: int,
    second: int,
    level_from_cams: tuple[Float[np.ndarray, "a 4 4"], Float[np.ndarray, "b 4 4"]],
    found: RelativePoses,
    has_floors: bool,
) -> Link | None:
    """The place that most of what two scans both show is in favour of; None where none is far ahead.

    Args:
        level_from_cams: poses of the keyframes of each, loops closed.
        found: verified pairs: frame of the first scan, frame of the second, and how much each explains.
        has_floors: whether both saw their floor, so that heights can be compared.
    """
    i, j = found.pairs.T
    seen_from_first = level_from_cams[0][i] @ found.a_from_b
    placed = seen_from_first @ se3.inverse(level_from_cams[1][j])
    weight = np.ones(len(found)) if found.explained is None else found.explained
    cosine = np.clip(placed[:, 2, 2], -1.0, 1.0)
    lift_m = seen_from_first[:, 2, 3] - level_from_cams[1][j][:, 2, 3]
    is_possible = (weight > 0) & (cosine > np.cos(np.deg2rad(MAX_TILT_DEG)))
    if has_floors:
        is_possible &= np.abs(lift_m) < MAX_LIFT_M
    if is_possible.sum() < MIN_WITNESSES:
        return None
    keep = np.flatnonzero(is_possible)
    runs = np.unique(found.pairs[keep] // RUN_FRAMES, axis=0, return_inverse=True)[1].ravel()
    votes = _Votes(
        yaws=np.arctan2(placed[keep, 1, 0], placed[keep, 0, 0]),
        here=seen_from_first[keep, :3, 3],
        there=level_from_cams[1][j][keep, :3, 3],
        weight=weight[keep],
        runs=runs,
    )
    return votes.link(first, second, has_floors)


@dataclass(frozen=True)
class _Votes:
    yaws: Float[np.ndarray, " v"]
    """Of the second scan in the first one's level frame."""
    here: Float[np.ndarray, "v 3"]
    """Where the camera of the second scan stands in the first one's level frame."""
    there: Float[np.ndarray, "v 3"]
    """The same in its own."""
    weight: Float[np.ndarray, " v"]
    runs: np.ndarray
    """Number of the two runs of frames of each."""

    def link(self, first: int, second: int, has_floors: bool) -> Link | None:
        """The best place, where it is far ahead of the next."""
        every = np.arange(len(self.yaws))
        agreeing = [self._agrees(self._place(float(self.yaws[k]), np.array([k]))) for k in every]
        weights = np.array([self._weight(agrees) for agrees in agreeing])
        best = int(np.argmax(weights))
        agrees = agreeing[best]
        place = np.eye(4)
        for _ in range(3):
            yaw = _mean_angle(self.yaws[agrees], self.weight[agrees])
            place = self._place(yaw, np.flatnonzero(agrees))
            agrees = self._agrees(place)
            if not agrees.any():
                return None
        others = [
            self._weight(own & ~agrees)
            for own, k in zip(agreeing, every, strict=True)
            if not agrees[k]
        ]
        weight = self._weight(agrees)
        n_runs = len(np.unique(self.runs[agrees]))
        is_clear = weight > MIN_ADVANTAGE * max(others, default=0.0)
        if agrees.sum() < MIN_WITNESSES or n_runs < MIN_RUNS or not is_clear:
            return None
        if has_floors:
            place = place.copy()
            place[2, 3] = 0.0
        return Link(first, second, place, int(agrees.sum()), weight)

    def _place(self, yaw: float, of: np.ndarray) -> Float[np.ndarray, "4 4"]:
        """The transform of a yaw that brings these cameras together, their medians."""
        turn = se3.yaw_transform(yaw, np.zeros(3))
        way = np.median(self.here[of] - self.there[of] @ turn[:3, :3].T, axis=0)
        return se3.yaw_transform(yaw, way)

    def _agrees(self, place: Float[np.ndarray, "4 4"]) -> Bool[np.ndarray, " v"]:
        off_m = np.linalg.norm(se3.transform(place, self.there) - self.here, axis=1)
        yaw = np.arctan2(place[1, 0], place[0, 0])
        turned = np.abs((self.yaws - yaw + np.pi) % (2 * np.pi) - np.pi)
        return (off_m < AGREE_M) & (turned < np.deg2rad(AGREE_DEG))

    def _weight(self, of: Bool[np.ndarray, " v"]) -> float:
        """What these explain: of each two runs of frames the best."""
        best = np.zeros(int(self.runs.max(initial=0)) + 1)
        np.maximum.at(best, self.runs[of], self.weight[of])
        return float(best.sum())


def _mean_angle(angles: Float[np.ndarray, " v"], weight: Float[np.ndarray, " v"]) -> float:
    return float(np.arctan2(np.sum(weight * np.sin(angles)), np.sum(weight * np.cos(angles))))

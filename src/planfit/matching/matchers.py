"""Which keypoints of two frames may show the same point: mutual nearest neighbours, or a learned matcher."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from planfit.errors import require_choice, require_share
from planfit.matching.keypoints import Keypoints

Matcher = Callable[[Keypoints, Keypoints, tuple[int, int], tuple[int, int]], np.ndarray]
"""Tentative matches (m, 2) of two frames' keypoints, given width and height of both images in px."""


@dataclass(frozen=True)
class MatcherOptions:
    """How keypoints of two frames are matched."""

    kind: Literal["nearest", "lightglue", "superglue"] = "nearest"
    """Mutual nearest neighbours by descriptor; or a learned matcher for superpoint keypoints
    (`planfit[learned]`)."""
    max_ratio: float = 0.85
    """Best over second-best descriptor distance; a match above it is ambiguous (Lowe 2004). Of
    `nearest` only."""
    weights: str = ""
    """Hub name or folder of a learned matcher's weights; empty takes ETH-CVG/lightglue_superpoint or
    magic-leap-community/superglue_indoor."""
    device: str = "cpu"
    """Where a learned matcher runs: `cpu`, `cuda`, `cuda:1` and so on; `auto` takes a GPU where there
    is one."""

    def __post_init__(self) -> None:
        require_choice(self, "kind", "nearest", "lightglue", "superglue")
        require_share(self, "max_ratio")


WEIGHTS = {
    "lightglue": "ETH-CVG/lightglue_superpoint",
    "superglue": "magic-leap-community/superglue_indoor",
}


def make_matcher(options: MatcherOptions) -> Matcher:
    """The matcher that the options ask for.

    Raises:
        OptionError: its library or weights cannot be had.
    """
    if options.kind != "nearest":
        from planfit.matching.learned import glue  # torch is loaded only where it is asked for

        return glue(options.kind, options.weights or WEIGHTS[options.kind], options.device)

    def match(a: Keypoints, b: Keypoints, _: object, __: object) -> np.ndarray:
        return match_descriptors(a.descriptors, b.descriptors, options.max_ratio)

    return match


def match_descriptors(a: np.ndarray, b: np.ndarray, max_ratio: float) -> np.ndarray:
    """Mutual nearest neighbours (m, 2) among descriptors (k, d) and (l, d) that pass the ratio test."""
    if len(a) < 2 or len(b) < 2:
        return np.zeros((0, 2), dtype=int)
    a, b = a.astype(np.float32), b.astype(np.float32)
    distance_sq = np.sum(a**2, axis=1)[:, None] + np.sum(b**2, axis=1) - 2.0 * (a @ b.T)
    nearest = np.argmin(distance_sq, axis=1)
    rows = np.arange(len(a))
    best = distance_sq[rows, nearest]
    mutual = np.argmin(distance_sq, axis=0)[nearest] == rows
    distance_sq[rows, nearest] = np.inf
    clear = best < max_ratio**2 * distance_sq.min(axis=1)
    idx = np.flatnonzero(mutual & clear)
    return np.stack([idx, nearest[idx]], axis=1)

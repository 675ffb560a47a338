"""Which keypoints of two frames may show the same point: mutual nearest neighbours, or a learned matcher."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Int, Shaped

from planfit.errors import require_choice
from planfit.matching.pair_kernels import mutual_nearest
from planfit.matching.types import Keypoints, Matcher

MAX_RATIO = 0.85
"""Best over second-best descriptor distance; a match of nearest neighbours above it is ambiguous (Lowe
2004)."""


@dataclass(frozen=True)
class MatcherOptions:
    """How keypoints of two frames are matched."""

    kind: Literal["nearest", "lightglue", "superglue"] = "nearest"
    """Mutual nearest neighbours by descriptor; or a learned matcher for superpoint keypoints
    (`planfit[learned]`)."""
    weights: str = ""
    """Hub name or folder of a learned matcher's weights; empty takes ETH-CVG/lightglue_superpoint or
    magic-leap-community/superglue_indoor."""

    def __post_init__(self) -> None:
        require_choice(self, "kind", "nearest", "lightglue", "superglue")


_WEIGHTS = {
    "lightglue": "ETH-CVG/lightglue_superpoint",
    "superglue": "magic-leap-community/superglue_indoor",
}


def make_matcher(options: MatcherOptions, device: str = "cpu") -> Matcher:
    """The matcher that the options ask for; a learned one runs on the device.

    Raises:
        OptionError: its library or weights cannot be had.
    """
    if options.kind != "nearest":
        from planfit.matching.learned import glue  # torch is loaded only where it is asked for

        return glue(options.kind, options.weights or _WEIGHTS[options.kind], device)

    def match(a: Keypoints, b: Keypoints, _: object, __: object) -> Int[np.ndarray, "m 2"]:
        return match_descriptors(a.descriptors, b.descriptors)

    return match


def match_descriptors(
    a: Shaped[np.ndarray, "k d"], b: Shaped[np.ndarray, "l d"]
) -> Int[np.ndarray, "m 2"]:
    """Mutual nearest neighbours among descriptors that pass the ratio test (Lowe 2004)."""
    if len(a) < 2 or len(b) < 2:
        return np.zeros((0, 2), dtype=int)
    a, b = a.astype(np.float32), b.astype(np.float32)
    # |a - b|^2 = |a|^2 + |b|^2 - 2 ab: one product of matrices does nearly all the work.
    norms_a, norms_b = np.einsum("ij,ij->i", a, a), np.einsum("ij,ij->i", b, b)
    nearest = mutual_nearest(a @ b.T, norms_a, norms_b, MAX_RATIO**2)
    idx = np.flatnonzero(nearest >= 0)
    return np.stack([idx, nearest[idx]], axis=1)

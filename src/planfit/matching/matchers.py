"""Which keypoints of two frames may show the same point: mutual nearest neighbours, or a learned matcher."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numba
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
    norms_a, norms_b = np.einsum("ij,ij->i", a, a), np.einsum("ij,ij->i", b, b)
    nearest = _mutual_nearest(a @ b.T, norms_a, norms_b, max_ratio**2)
    idx = np.flatnonzero(nearest >= 0)
    return np.stack([idx, nearest[idx]], axis=1)


@numba.njit(cache=True, nogil=True)
def _mutual_nearest(
    product: np.ndarray, norms_a: np.ndarray, norms_b: np.ndarray, max_ratio_sq: float
) -> np.ndarray:
    """For each row of scalar products (k, l) its match, or -1, in one pass over them.

    Squared distances of descriptors of small integers are exact in float32, in whatever order summed.
    """
    k, n_columns = product.shape
    nearest = np.full(k, -1, np.int64)
    is_clear = np.zeros(k, np.bool_)
    best_of_column = np.full(n_columns, np.float32(np.inf))
    row_of_column = np.full(n_columns, -1, np.int64)
    for i in range(k):
        best = second = np.float32(np.inf)
        for j in range(n_columns):
            distance_sq = norms_a[i] + norms_b[j] - np.float32(2.0) * product[i, j]
            if distance_sq < second:
                if distance_sq < best:
                    best, second, nearest[i] = distance_sq, best, j
                else:
                    second = distance_sq
            if distance_sq < best_of_column[j]:
                best_of_column[j], row_of_column[j] = distance_sq, i
        is_clear[i] = best < np.float32(max_ratio_sq) * second
    for i in range(k):
        if not is_clear[i] or row_of_column[nearest[i]] != i:
            nearest[i] = -1
    return nearest

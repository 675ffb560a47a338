"""Scanned wall, seen from above, as the alignment takes it."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from planfit.geometry import segments
from planfit.runtime import short_repr


@dataclass(frozen=True)
class WallSamples:
    """Scanned wall, seen from above, level frame."""

    xy: Float[np.ndarray, "m 2"]
    """Metres, evenly along the wall patches, in the order they were seen."""
    normals: Float[np.ndarray, "m 2"]
    """Unit, towards where each was seen from."""
    seen_from: Float[np.ndarray, "m 2"] | None = None
    """Metres, the camera; None where it is not known."""
    weights: Float[np.ndarray, " m"] | None = None
    """How much each counts; None: all alike."""

    __repr__ = short_repr

    @property
    def worth(self) -> Float[np.ndarray, " m"]:
        """How much each counts."""
        return np.ones(len(self.xy)) if self.weights is None else self.weights

    @property
    def middle(self) -> Float[np.ndarray, " 2"]:
        """Weighted mean, metres."""
        return self.worth @ self.xy / self.worth.sum()

    @property
    def extent_m(self) -> float:
        """Diagonal of the box around the samples; the outermost hundredth each side is left out."""
        low, high = np.percentile(self.xy, [1, 99], axis=0)
        return float(np.linalg.norm(high - low))

    def mirrored(self) -> "WallSamples":
        """Left and right swapped: x becomes -x."""
        flip = np.array([-1.0, 1.0])
        eyes = None if self.seen_from is None else self.seen_from * flip
        return replace(self, xy=self.xy * flip, normals=self.normals * flip, seen_from=eyes)

    def picked(self, idx: Int[np.ndarray, " k"]) -> "WallSamples":
        """Some of the samples."""
        eyes = None if self.seen_from is None else self.seen_from[idx]
        own = None if self.weights is None else self.weights[idx]
        return WallSamples(self.xy[idx], self.normals[idx], eyes, own)


def sample_walls(
    normals: Float[np.ndarray, "k 2"],
    ends: Float[np.ndarray, "k 2 2"],
    spacing_m: float = 0.1,
    seen_from: Float[np.ndarray, "k 2"] | None = None,
) -> WallSamples:
    """Points about every `spacing_m` along wall patches, level frame.

    Args:
        normals: unit, towards where each patch was seen from.
        ends: metres, of each patch.
        spacing_m: between points.
        seen_from: metres, where the camera stood that saw each patch.
    """
    xy, patch = segments.sample(ends, spacing_m)
    return WallSamples(xy, normals[patch], None if seen_from is None else seen_from[patch])


def thin(walls: WallSamples, max_samples: int = 2500) -> WallSamples:
    """At most about `max_samples`, evenly over the wall, each with how much it counts.

    Walls that a slow camera saw fifty times would outvote those that it passed once: samples are
    gathered in cells by location and direction, and a cell counts the square root of its samples. The order
    in time stays.
    """
    cell_m = 0.05
    direction = np.round(np.arctan2(walls.normals[:, 1], walls.normals[:, 0]) / (np.pi / 8))
    direction = direction.astype(int) % 16
    while True:
        keys = np.column_stack([np.floor(walls.xy / cell_m).astype(int), direction])
        _, first, counts = np.unique(keys, axis=0, return_index=True, return_counts=True)
        if len(first) <= max_samples:
            # np.unique sorts by cell; the index of each cell's first sample gives the order in time back.
            in_time = np.argsort(first)
            return replace(walls.picked(first[in_time]), weights=np.sqrt(counts[in_time]))
        cell_m *= max(1.1, len(first) / max_samples)

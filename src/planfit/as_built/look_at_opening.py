"""What a scan shows of one opening: where it is looked through, where wall or a door is seen in it, and where
its two sides stand."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.as_built.lines_of_sight import BIN_M, END_M, LinesOfSight, crossings
from planfit.as_built.types import AsBuiltOptions
from planfit.as_built.wall_offsets import PlacedWalls
from planfit.floorplan.gaps import Gap

REACH_M = 0.3
"""The sides of an opening are looked for so far from where it is drawn."""
INSIDE_M = 0.1
"""Wall that is seen so far inside of what is looked through may be its side; what is further inside stands in
the opening."""
EDGE_SIGMA_M = 0.035
"""Of where the side of an opening is seen, poses aside: depth errs at edges. Measured on even seeds of
benchmarks/openings.py, 208 sides: wall is seen to begin 0.02 m inside of where it does, RMS 0.038 m; what is
looked through ends 0.14 m inside, spread 0.07 m, as depth at edges is not believed, and tells no more."""


@dataclass(frozen=True)
class OpeningSeen:
    """Evidence on one opening; b parts of its width."""

    is_open: Bool[np.ndarray, " b"]
    """Whether enough frames look through each part."""
    is_closed: Bool[np.ndarray, " b"]
    """Whether enough see wall or a door in it, and too few look through."""
    n_through_frames: int
    n_surface_frames: int
    edges_m: tuple[float, float]
    """Where its sides stand, along the wall from its first end; NaN where a side was not seen."""
    edge_sigmas_m: tuple[float, float]


@dataclass(frozen=True)
class _Along:
    """Places along the wall, m from the first end of the opening, and the frame that shows each."""

    at: Float[np.ndarray, " p"]
    frame: Int[np.ndarray, " p"]

    def frames_per_part(self, n_bins: int) -> Int[np.ndarray, " b"]:
        """How many frames show each part of the opening."""
        bins = np.floor((self.at - END_M) / BIN_M).astype(int)
        inside = (bins >= 0) & (bins < n_bins)
        pairs = np.unique(np.stack([bins[inside], self.frame[inside]]), axis=1)
        return np.bincount(pairs[0], minlength=n_bins)

    def n_frames(self, width_m: float) -> int:
        """How many frames show any of the opening."""
        inside = (self.at > END_M) & (self.at < width_m - END_M)
        return len(np.unique(self.frame[inside]))

    def furthest(self, n_frames: int) -> tuple[float, Int[np.ndarray, " f"]] | None:
        """The greatest place that so many frames reach, and which do; None where too few show any."""
        frames, of_frame = np.unique(self.frame, return_inverse=True)
        if len(frames) < n_frames:
            return None
        reach = np.full(len(frames), -np.inf)
        np.maximum.at(reach, of_frame, self.at)
        furthest = np.argsort(-reach)[:n_frames]
        return float(reach[furthest[-1]]), frames[furthest]


def look_at(
    gap: Gap, placed: PlacedWalls, sight: LinesOfSight, options: AsBuiltOptions
) -> OpeningSeen:
    """What is seen of an opening where its wall stands.

    Args:
        gap: the opening, plan frame.
        placed: points of wall.
        sight: what is looked through.
        options: see there.
    """
    along = (gap.ends[1] - gap.ends[0]) / gap.width_m
    wide = gap.ends + REACH_M * np.array([-along, along])
    at, frame = crossings(sight, wide, gap.storey, options)
    through = _Along(at - REACH_M, frame)
    surface = _surface(gap, along, wide, placed, sight, options)
    n_bins = max(int(round((gap.width_m - 2 * END_M) / BIN_M, 6)), 1)
    is_open = through.frames_per_part(n_bins) >= options.min_frames
    is_closed = (surface.frames_per_part(n_bins) >= options.min_frames) & ~is_open
    sides = [
        _side(at_second, gap, along, through, surface, placed, options.min_frames)
        for at_second in (False, True)
    ]
    return OpeningSeen(
        is_open,
        is_closed,
        through.n_frames(gap.width_m),
        surface.n_frames(gap.width_m),
        (sides[0][0], sides[1][0]),
        (sides[0][1], sides[1][1]),
    )


def _surface(
    gap: Gap,
    along: Float[np.ndarray, "2"],
    wide: Float[np.ndarray, "2 2"],
    placed: PlacedWalls,
    sight: LinesOfSight,
    options: AsBuiltOptions,
) -> _Along:
    """Points of wall and of doors in the wall that an opening is in, beside it too."""
    reach_m = gap.thickness_m / 2 + options.openings.depth_m
    near = placed.points_near(wide, reach_m, gap.storey)
    relative, frame = placed.points[near, :2] - gap.ends[0], placed.point_frame_idx[near]
    above_m = placed.points[near, 2] - sight.floors_m[frame]
    low, high = options.heights_m
    kept = (np.abs(relative @ gap.normal) <= reach_m) & (above_m > low) & (above_m < high)
    return _Along((relative @ along)[kept], frame[kept])


def _side(
    at_second: bool,
    gap: Gap,
    along: Float[np.ndarray, "2"],
    through: _Along,
    surface: _Along,
    placed: PlacedWalls,
    n_frames: int,
) -> tuple[float, float]:
    """Where one side stands, and its sigma; NaN where it was not seen.

    It stands where wall begins, from the middle outwards, beyond what is looked through.
    """
    none = (np.nan, np.nan)
    sign, half_m = (1.0 if at_second else -1.0), gap.width_m / 2
    out_through, out_wall = sign * (through.at - half_m), sign * (surface.at - half_m)
    passed = _Along(out_through, through.frame).furthest(n_frames)
    if passed is None or passed[0] <= 0:
        return none
    is_beyond = out_wall > max(0.0, passed[0] - INSIDE_M)
    begins = _Along(-out_wall[is_beyond], surface.frame[is_beyond]).furthest(n_frames)
    if begins is None:
        return none
    edge, frames = half_m - sign * begins[0], begins[1]
    places = np.broadcast_to(gap.ends[0] + edge * along, (len(frames), 2))
    pose_m = placed.mean_pose_sigma_m(frames, places, np.broadcast_to(along, (len(frames), 2)))
    return edge, float(np.hypot(pose_m, EDGE_SIGMA_M))

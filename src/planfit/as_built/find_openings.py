"""Openings one by one, those that the plan draws and those of walls that it draws without: where each is
looked through, where wall or a door is seen in it, where its two sides stand, and how far what is seen in it
stands back from the wall."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from planfit.as_built.lines_of_sight import (
    BIN_M,
    DEPTH_M,
    END_M,
    HEIGHTS_M,
    MIN_FRAMES,
    LinesOfSight,
    crossings,
    frames_through,
)
from planfit.as_built.openings import AsBuiltOpening
from planfit.as_built.types import AsBuilt, AsBuiltWall
from planfit.as_built.wall_offsets import PlacedWalls, offset_sigma
from planfit.floorplan import Floorplan
from planfit.floorplan.elements import opening_element
from planfit.floorplan.gaps import (
    ASKEW_M,
    MAX_WALL_M,
    PARALLEL,
    Gap,
    find_gaps,
    gap_between,
    sides_of_gaps,
)
from planfit.geometry import segments
from planfit.pipeline.on_plan import frame_runs
from planfit.priors import DOOR_PASSED_LEAST_M

REACH_M = 0.3
"""The sides of an opening are looked for so far from where it is drawn."""
INSIDE_M = END_M
"""Wall that is seen so far inside of what is looked through may be its side; what is further inside stands in
the opening."""
EDGE_SIGMA_M = 0.035
"""Of where the side of an opening is seen whose reveal is not, poses aside: depth at edges is not believed:
its wall is seen to begin 0.04 m further out than it does (8 sides of even seeds of benchmarks/openings.py),
and what is looked through ends 0.14 m inside, spread 0.07 m, and tells no more."""
BEHIND_FACE_M = 0.04
"""What is seen within a wall, so far behind both its faces, is no face that is off or noisy: of the sides of
an opening it is their reveal."""
REVEAL_SIGMA_M = 0.01
"""Of where a reveal is seen, poses aside. It is a plane across the wall, so its middle tells where it stands;
the point that is furthest inside is its noise, 0.03 m inside (24 sides of even seeds, RMS 0.034 m; by the
middle 0.011 m, and 0.003 m at true poses)."""
JAMB_M, BESIDE_BETWEEN_M = 0.15, (0.1, 0.6)
"""What stands in an opening is looked at so far within its sides, and the wall so far beside them: casings
and smeared depth lie between."""
MIN_POINTS = 6
"""Of a frame, in the opening and beside it."""
STANDS_OUT_M = 0.06
"""What stands no further than this before either side of the wall, m, is in the opening."""


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

    def middles(self) -> tuple[Float[np.ndarray, " f"], Int[np.ndarray, " f"]]:
        """The median of each frame that shows enough, and the frame."""
        frames, counts = np.unique(self.frame, return_counts=True)
        frames = frames[counts >= MIN_POINTS]
        return np.array([np.median(self.at[self.frame == i]) for i in frames]), frames

    def furthest(self, n_frames: int) -> tuple[float, Int[np.ndarray, " f"]] | None:
        """The greatest place that so many frames reach, and which do; None where too few show any."""
        frames, of_frame = np.unique(self.frame, return_inverse=True)
        if len(frames) < n_frames:
            return None
        reach = np.full(len(frames), -np.inf)
        np.maximum.at(reach, of_frame, self.at)
        furthest = np.argsort(-reach)[:n_frames]
        return float(reach[furthest[-1]]), frames[furthest]


def look_at(gap: Gap, placed: PlacedWalls, sight: LinesOfSight) -> AsBuiltOpening:
    """What is seen of an opening where its wall stands, as if it were drawn there."""
    along = (gap.ends[1] - gap.ends[0]) / gap.width_m
    wide = gap.ends + REACH_M * np.array([-along, along])
    at, frame = crossings(sight, wide, gap.storey)
    through = _Along(at - REACH_M, frame)
    half_m = gap.thickness_m / 2
    surface = _surface(half_m + STANDS_OUT_M, gap, along, wide, placed, sight)
    reveals = _surface(half_m - BEHIND_FACE_M, gap, along, wide, placed, sight)
    n_bins = max(int(round((gap.width_m - 2 * END_M) / BIN_M, 6)), 1)
    is_open = through.frames_per_part(n_bins) >= MIN_FRAMES
    is_closed = (surface.frames_per_part(n_bins) >= MIN_FRAMES) & ~is_open
    sides = [
        _side(at_second, gap, along, through, surface, reveals, placed)
        for at_second in (False, True)
    ]
    backs = [_set_back(sign, gap, along, placed, sight) for sign in (1.0, -1.0)]
    return AsBuiltOpening(
        is_drawn=True,
        ends=gap.ends,
        normal=gap.normal,
        thickness_m=gap.thickness_m,
        open_share=float(np.mean(is_open)),
        closed_share=float(np.mean(is_closed)),
        n_through_frames=through.n_frames(gap.width_m),
        n_surface_frames=surface.n_frames(gap.width_m),
        edges_m=(sides[0][0], sides[1][0]),
        edge_sigmas_m=(sides[0][1], sides[1][1]),
        set_back_m=(backs[0][0], backs[1][0]),
        set_back_sigmas_m=(backs[0][1], backs[1][1]),
    )


def _set_back(
    sign: float, gap: Gap, along: Float[np.ndarray, "2"], placed: PlacedWalls, sight: LinesOfSight
) -> tuple[float, float]:
    """How far what is seen in an opening from one side stands behind the wall beside it, and its sigma; NaN
    where too few frames show both.

    Each frame is compared with itself, so what its pose is off does not count.
    """
    wide = gap.ends + BESIDE_BETWEEN_M[1] * np.array([-along, along])
    half_m = gap.thickness_m / 2
    near = placed.points_near(wide, half_m + STANDS_OUT_M, gap.storey)
    relative, frame = placed.points[near, :2] - gap.ends[0], placed.point_frame_idx[near]
    eyes = placed.plan_from_cams[frame, :2, 3] - gap.ends[0]
    at, out_m = relative @ along, sign * (relative @ gap.normal)
    above_m = placed.points[near, 2] - sight.floors_m[frame]
    low, high = HEIGHTS_M
    kept = (above_m > low) & (above_m < high) & (sign * (eyes @ gap.normal) > half_m + STANDS_OUT_M)
    outside_m = np.maximum(-at, at - gap.width_m)
    is_wall = kept & (outside_m > BESIDE_BETWEEN_M[0]) & (outside_m < BESIDE_BETWEEN_M[1])
    is_wall &= np.abs(out_m - half_m) <= STANDS_OUT_M
    is_in = kept & (outside_m < -JAMB_M) & (np.abs(out_m) <= half_m + STANDS_OUT_M)
    backs = [
        float(np.median(out_m[is_wall & (frame == i)]) - np.median(out_m[is_in & (frame == i)]))
        for i in np.unique(frame[is_in])
        if min(np.sum(is_wall & (frame == i)), np.sum(is_in & (frame == i))) >= MIN_POINTS
    ]
    if len(backs) < MIN_FRAMES:
        return np.nan, np.nan
    return float(np.median(backs)), offset_sigma(np.array(backs), 0.0)


def _surface(
    reach_m: float,
    gap: Gap,
    along: Float[np.ndarray, "2"],
    wide: Float[np.ndarray, "2 2"],
    placed: PlacedWalls,
    sight: LinesOfSight,
) -> _Along:
    """Points of wall and of doors near the middle of the wall that an opening is in, beside it too."""
    near = placed.points_near(wide, reach_m, gap.storey)
    relative, frame = placed.points[near, :2] - gap.ends[0], placed.point_frame_idx[near]
    above_m = placed.points[near, 2] - sight.floors_m[frame]
    low, high = HEIGHTS_M
    kept = (np.abs(relative @ gap.normal) <= reach_m) & (above_m > low) & (above_m < high)
    return _Along((relative @ along)[kept], frame[kept])


def _side(
    at_second: bool,
    gap: Gap,
    along: Float[np.ndarray, "2"],
    through: _Along,
    surface: _Along,
    reveals: _Along,
    placed: PlacedWalls,
) -> tuple[float, float]:
    """Where one side stands, and its sigma; NaN where it was not seen.

    It stands where wall begins, from the middle outwards, beyond what is looked through; and where enough
    frames see its reveal there, in the middle of that.
    """
    none = (np.nan, np.nan)
    sign, half_m = (1.0 if at_second else -1.0), gap.width_m / 2
    out_through, out_wall = sign * (through.at - half_m), sign * (surface.at - half_m)
    passed = _Along(out_through, through.frame).furthest(MIN_FRAMES)
    if passed is None or passed[0] <= 0:
        return none
    is_beyond = out_wall > max(0.0, passed[0] - INSIDE_M)
    begins = _Along(-out_wall[is_beyond], surface.frame[is_beyond]).furthest(MIN_FRAMES)
    if begins is None:
        return none
    out_m, frames, sigma_m = -begins[0], begins[1], EDGE_SIGMA_M
    out_reveals = sign * (reveals.at - half_m)
    is_here = np.abs(out_reveals - out_m) < INSIDE_M
    middles_m, seeing = _Along(out_reveals[is_here], reveals.frame[is_here]).middles()
    if len(seeing) >= MIN_FRAMES:
        out_m, frames, sigma_m = float(np.median(middles_m)), seeing, REVEAL_SIGMA_M
    edge = half_m + sign * out_m
    places = np.broadcast_to(gap.ends[0] + edge * along, (len(frames), 2))
    pose_m = placed.mean_pose_sigma_m(frames, places, np.broadcast_to(along, (len(frames), 2)))
    return edge, float(np.hypot(pose_m, sigma_m))


BESIDE_M = DOOR_PASSED_LEAST_M.value
"""Walls that end so near to an opening, in its line, are the wall that it is in."""
MIN_NEW_M = DOOR_PASSED_LEAST_M.value
"""Width, m, that cameras look through of an opening that the plan lacks: that of the narrowest doors."""


def find_openings(
    as_built: AsBuilt, floorplan: Floorplan, placed: PlacedWalls, sight: LinesOfSight
) -> tuple[AsBuiltOpening, ...]:
    """Openings of the plan in its order, then those of walls that are drawn without."""
    drawn = find_gaps(floorplan, as_built.options.opening_widths_m)
    found = [_seen(gap, True, as_built, floorplan, placed, sight) for gap in drawn]
    for gap in _undrawn(as_built, floorplan, sight):
        if not any(_is_one_place(gap, other) for other in drawn):
            found.append(_seen(gap, False, as_built, floorplan, placed, sight))
    return tuple(found)


def _undrawn(as_built: AsBuilt, floorplan: Floorplan, sight: LinesOfSight) -> list[Gap]:
    """Parts of walls that stand, which cameras look through though no opening is drawn.

    Not of walls that are further off than cupboards are deep: a row of these may have been taken for one, and
    beside it the wall itself is seen.
    """
    walls = [
        wall
        for wall in as_built.walls
        if wall.face_idx >= 0
        and wall.is_standing
        and not wall.is_glass
        and abs(wall.offset_m) <= DEPTH_M[0]
    ]
    if not walls:
        return []
    faces = np.array([wall.face_idx for wall in walls])
    built = np.stack([wall.built_ends for wall in walls])
    normals = np.stack([wall.normal for wall in walls])
    is_turned = np.einsum("ni,ni->n", segments.left_normals(built), normals) < 0
    ends = np.where(is_turned[:, None, None], built[:, ::-1], built)
    storeys = None if floorplan.storeys is None else floorplan.storeys[faces]
    standing = Floorplan(
        "walls as built",
        ends,
        segments.left_normals(ends),
        np.ones(len(ends), dtype=bool),
        storeys=storeys,
    )
    counts = frames_through(sight, standing, HEIGHTS_M)
    sides, of_wall = [], []
    for k, n_frames in enumerate(counts):
        for low, high in frame_runs(n_frames >= MIN_FRAMES):
            at = END_M + BIN_M * np.array([low, high + 1.0])
            if at[1] - at[0] >= MIN_NEW_M - 1e-9:
                along = segments.directions(ends[k][None])[0]
                sides.append(ends[k, 0] + at[:, None] * along)
                of_wall.append(k)
    stacked = np.array(sides).reshape(-1, 2, 2)
    is_oriented = np.array([walls[k].is_oriented for k in of_wall], dtype=bool)
    # What is looked through of one face is cut off by what stands before the other: widths differ.
    differ = np.ones(len(sides), dtype=bool)
    gaps = []
    for own in sides_of_gaps(stacked, is_oriented, differ):
        storey = None if storeys is None else int(storeys[of_wall[own[0]]])
        gap, of_one = gap_between(stacked[own], storey), len(own) == 1
        gaps.append(_with_back(gap, floorplan) if of_one and is_oriented[own[0]] else gap)
    return gaps


def _with_back(gap: Gap, floorplan: Floorplan) -> Gap:
    """A gap that one face of a wall shows, to whose free side its normal points, in the middle of the wall
    whose other face is drawn behind; as it is where none is."""
    own = (
        np.arange(len(floorplan)) if floorplan.storeys is None else floorplan.storeys == gap.storey
    )
    ends, normals = floorplan.ends[own], floorplan.normals[own]
    behind_m = -(ends.mean(axis=1) - gap.ends.mean(axis=0)) @ gap.normal
    along = (gap.ends[1] - gap.ends[0]) / gap.width_m
    at = np.sort((ends - gap.ends.mean(axis=0)) @ along, axis=1)
    is_back = (normals @ gap.normal < -PARALLEL) & (at[:, 0] < 0) & (at[:, 1] > 0)
    is_back &= (behind_m > 0) & (behind_m < MAX_WALL_M)
    if not is_back.any():
        return gap
    thickness_m = float(behind_m[is_back].min())
    middle = gap.ends - thickness_m / 2 * gap.normal
    return replace(gap, ends=middle, thickness_m=thickness_m)


def _is_one_place(gap: Gap, other: Gap) -> bool:
    """Whether two gaps of one wall share some width."""
    along = (gap.ends[1] - gap.ends[0]) / gap.width_m
    across = (other.ends.mean(axis=0) - gap.ends[0]) @ gap.normal
    at = np.sort((other.ends - gap.ends[0]) @ along)
    shared = min(at[1], gap.width_m) - max(at[0], 0.0)
    return gap.storey == other.storey and abs(across) < MAX_WALL_M and shared > 0


def _seen(
    gap: Gap,
    is_drawn: bool,
    as_built: AsBuilt,
    floorplan: Floorplan,
    placed: PlacedWalls,
    sight: LinesOfSight,
) -> AsBuiltOpening:
    """What the scan says of one opening."""
    beside = [wall for wall in as_built.walls if _is_beside(wall, gap, floorplan)]
    # One that is not drawn was looked for where its wall stands.
    stands = replace(gap, ends=gap.ends + _offset_m(beside, gap) * gap.normal) if is_drawn else gap
    seen = look_at(stands, placed, sight)
    kind, element_id = opening_element(floorplan, gap) if is_drawn else ("", "")
    of_wall = next((wall.element_id for wall in beside if wall.element_id), "")
    named = element_id or of_wall
    return replace(seen, is_drawn=is_drawn, ends=gap.ends, kind=kind, element_id=named)


def _is_beside(wall: AsBuiltWall, gap: Gap, floorplan: Floorplan) -> bool:
    """Whether a face of the plan is of the wall that a gap is in."""
    if wall.face_idx < 0 or abs(wall.normal @ gap.normal) < PARALLEL:
        return False
    if floorplan.storeys is not None and floorplan.storeys[wall.face_idx] != gap.storey:
        return False
    if abs((wall.ends.mean(axis=0) - gap.ends[0]) @ gap.normal) > gap.thickness_m / 2 + ASKEW_M:
        return False
    at = np.sort((wall.ends - gap.ends[0]) @ (gap.ends[1] - gap.ends[0]) / gap.width_m)
    return bool(at[0] < gap.width_m + BESIDE_M and at[1] > -BESIDE_M)


def _offset_m(beside: Sequence[AsBuiltWall], gap: Gap) -> float:
    """How far the wall of a gap stands off where it is drawn, along the gap's normal."""
    off_m = [wall.offset_m * float(wall.normal @ gap.normal) for wall in beside if wall.is_standing]
    return float(np.median(off_m)) if off_m else 0.0

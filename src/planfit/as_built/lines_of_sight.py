"""What lines of sight tell of walls: those that are not there, as cameras look through the place where they
are drawn; and which pieces of upright surface are wall, where none is drawn, not the backs and sides of
cupboards.

What is seen higher than cupboards are is wall. What is not may be wall that cameras looked down at: if it is
longer than the side of a cupboard, or, where a wall is drawn as far behind as cupboards are deep, than its
front, and no line of sight passes over it, as some do over most cupboards and none over a wall.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.floorplan import Floorplan
from planfit.geometry import se3, segments
from planfit.priors import CUPBOARD_HEIGHT_M, DOOR_CLEAR_HEIGHTS_M, STOREY_HEIGHT_M
from planfit.segmentation import Structure

BIN_M = 0.1
"""Faces are looked at in parts of this length."""
END_M = BIN_M
"""This much of a face is left out at either end: poses and the drawing are off by centimetres."""
MAX_POINTS = 800
"""Of a frame, evenly taken: so many lines of sight pass every decimetre of what it sees."""
MIN_FRAMES = 3
"""Frames that must look through a place of a wall or opening, or show what stands there: one or two err
together."""
BEYOND_M = 0.25
"""A line of sight passes a face where it ends this far behind it, m."""
HEIGHTS_M = DOOR_CLEAR_HEIGHTS_M.both
"""Heights over the floor, m, between which lines of sight and points count: above are lintels, below are
thresholds."""


@dataclass(frozen=True)
class LinesOfSight:
    """From n cameras to points of floor, ceiling and walls; m points."""

    points: Float[np.ndarray, "m 3"]
    """Where they end, plan frame, m, frame by frame."""
    start: Int[np.ndarray, " n_plus_1"]
    """Points of frame i are start[i]:start[i + 1]."""
    eyes: Float[np.ndarray, "n 3"]
    """Cameras, plan frame, m."""
    floors_m: Float[np.ndarray, " n"]
    """Height of the floor that each camera stands over; NaN where there is none, on stairs."""
    storeys: Int[np.ndarray, " n"] | None = None
    """That each stands on, where the plan has storeys."""

    @cached_property
    def frame_idx(self) -> Int[np.ndarray, " m"]:
        """Of each point."""
        return np.repeat(np.arange(len(self.eyes)), np.diff(self.start))

    @cached_property
    def boxes(self) -> Float[np.ndarray, "2 n 2"]:
        """Lower and upper corners around all lines of sight of each camera, seen from above."""
        low, high = self.eyes[:, :2].copy(), self.eyes[:, :2].copy()
        np.minimum.at(low, self.frame_idx, self.points[:, :2])
        np.maximum.at(high, self.frame_idx, self.points[:, :2])
        return np.stack([low, high])


def lines_of_sight(
    structure: Structure,
    plan_from_cams: Float[np.ndarray, "n 4 4"],
    floors_m: Float[np.ndarray, " n"],
) -> LinesOfSight:
    """What each camera sees, which stands over a floor of this height (plan frame, m): nothing is between."""
    points = np.concatenate(
        [
            structure.floor.points_cam,
            structure.ceiling.points_cam,
            structure.walls.points_cam,
            structure.unassigned_points_cam,
        ]
    )
    frame = np.concatenate(
        [
            structure.floor.frame_idx,
            structure.ceiling.frame_idx,
            structure.walls.point_frame_idx,
            structure.unassigned_frame_idx,
        ]
    )
    order = np.argsort(frame, kind="stable")
    parts = []
    for i, of_frame in enumerate(
        np.split(order, np.cumsum(np.bincount(frame, minlength=len(plan_from_cams)))[:-1])
    ):
        some = of_frame
        if len(of_frame) > MAX_POINTS:
            some = of_frame[np.linspace(0, len(of_frame) - 1, MAX_POINTS).astype(int)]
        parts.append(se3.transform(plan_from_cams[i], points[some]))
    return LinesOfSight(
        np.concatenate([np.zeros((0, 3)), *parts]),
        np.cumsum([0, *(len(part) for part in parts)]),
        plan_from_cams[:, :3, 3],
        floors_m,
        structure.storeys,
    )


def through_shares(
    sight: LinesOfSight, floorplan: Floorplan, heights_m: tuple[float, float], min_frames: int
) -> Float[np.ndarray, " f"]:
    """Share of the length of each face that `min_frames` look through, either way, between two heights."""
    counts = frames_through(sight, floorplan, heights_m)
    return np.array([np.mean(n_frames >= min_frames) for n_frames in counts])


def frames_through(
    sight: LinesOfSight, floorplan: Floorplan, heights_m: tuple[float, float]
) -> list[Int[np.ndarray, " b"]]:
    """How many frames look through each part of each face, either way, between two heights; parts are `BIN_M`
    long, the first begins `END_M` from the first end."""
    n_bins = np.maximum((floorplan.lengths - 2 * END_M) / BIN_M, 1.0).astype(int)
    first_bin = np.cumsum([0, *n_bins])
    n_frames = np.zeros(first_bin[-1], dtype=int)
    for i, eye in enumerate(sight.eyes):
        points = sight.points[sight.start[i] : sight.start[i + 1]]
        if len(points) == 0 or not np.isfinite(sight.floors_m[i]):
            continue
        faces = _within(floorplan, points, eye)
        if sight.storeys is not None and floorplan.storeys is not None:
            faces = faces[floorplan.storeys[faces] == sight.storeys[i]]
        passed = _passed(
            points, eye, float(sight.floors_m[i]), floorplan, faces, n_bins[faces], heights_m
        )
        for face, bins in zip(faces, passed, strict=True):
            n_frames[first_bin[face] + bins] += 1
    return np.split(n_frames, first_bin[1:-1])


def crossings(
    sight: LinesOfSight, ends: Float[np.ndarray, "2 2"], storey: int | None
) -> tuple[Float[np.ndarray, " c"], Int[np.ndarray, " c"]]:
    """Where lines of sight pass a segment, m from its first end, and the frame of each."""
    along = segments.directions(ends[None])[0]
    normal, length = segments.left_normals(ends[None])[0], float(np.linalg.norm(ends[1] - ends[0]))
    low, high = sight.boxes
    is_near = np.isfinite(sight.floors_m)
    is_near &= np.all((low <= ends.max(axis=0)) & (high >= ends.min(axis=0)), axis=1)
    if storey is not None and sight.storeys is not None:
        is_near &= sight.storeys == storey
    near = np.flatnonzero(is_near[sight.frame_idx])
    eyes, points, frame = (
        sight.eyes[sight.frame_idx[near]],
        sight.points[near],
        sight.frame_idx[near],
    )
    at_end = (points[:, :2] - ends[0]) @ normal
    at_eye = (eyes[:, :2] - ends[0]) @ normal
    crosses = np.flatnonzero((at_end * at_eye < 0) & (np.abs(at_end) > BEYOND_M))
    eyes, points, frame = eyes[crosses], points[crosses], frame[crosses]
    share = at_eye[crosses] / (at_eye[crosses] - at_end[crosses])
    where = eyes + share[:, None] * (points - eyes)
    height = where[:, 2] - sight.floors_m[frame]
    at = (where[:, :2] - ends[0]) @ along
    lowest, highest = HEIGHTS_M
    kept = (height > lowest) & (height < highest) & (at > 0) & (at < length)
    return at[kept], frame[kept]


def _within(
    floorplan: Floorplan, points: Float[np.ndarray, "p 3"], eye: Float[np.ndarray, "3"]
) -> Int[np.ndarray, " k"]:
    """Faces that meet the box of some lines of sight."""
    low = np.minimum(points[:, :2].min(axis=0), eye[:2])
    high = np.maximum(points[:, :2].max(axis=0), eye[:2])
    ends = floorplan.ends
    return np.flatnonzero(np.all((ends.max(axis=1) >= low) & (ends.min(axis=1) <= high), axis=1))


def _passed(
    points: Float[np.ndarray, "p 3"],
    eye: Float[np.ndarray, "3"],
    floor_m: float,
    floorplan: Floorplan,
    faces: Int[np.ndarray, " k"],
    n_bins: Int[np.ndarray, " k"],
    heights_m: tuple[float, float],
) -> list[Int[np.ndarray, " b"]]:
    """Parts of each face that lines of sight of one frame pass."""
    normals, offsets = floorplan.normals[faces], floorplan.offsets[faces]
    at_eye = normals @ eye[:2] - offsets
    at_end = points[:, :2] @ normals.T - offsets  # (p, k) m
    crosses = (at_end * at_eye < 0) & (np.abs(at_end) > BEYOND_M)
    share = np.where(crosses, at_eye / np.where(crosses, at_eye - at_end, 1.0), 0.0)
    height = eye[2] + share * (points[:, 2:] - eye[2]) - floor_m
    low, high = heights_m
    crosses &= (height > low) & (height < high)
    along, first = segments.directions(floorplan.ends[faces]), floorplan.ends[faces, 0]
    at = np.einsum("ki,ki->k", along, eye[:2] - first)
    at = at + share * ((points[:, :2] - eye[:2]) @ along.T)
    bins = np.floor((at - END_M) / BIN_M).astype(int)
    crosses &= (bins >= 0) & (bins < n_bins)
    return [np.unique(bins[crosses[:, k], k]) for k in range(len(faces))]


TOP_QUANTILE = 0.99
"""Of the heights of points, that is the top of a piece: single points fly."""
MAX_OVER_SHARE = 0.1
"""Share of the length of a wall that a line of sight may pass all the same, as poses err. On even seeds of
benchmarks/as_built.py none passes any wall, and 0.14 or more of the cupboards that are seen over at all."""
DEPTH_M = (0.3, 0.8)
"""Of cupboards, from their front to the wall behind."""
MIN_TOP_M = CUPBOARD_HEIGHT_M.value
"""Height over the floor, m, that wall where none is drawn is seen up to, if it is no longer than cupboards
are."""
MAX_CUPBOARD_M = (0.9, 1.6)
"""Length, m, of what may be the side of a cupboard; of what may be its front, a wall being drawn behind."""
CEILING_M = STOREY_HEIGHT_M.high
"""Lines of sight count up to here."""


@dataclass(frozen=True)
class Piece:
    """Upright surface where no wall is drawn."""

    ends: Float[np.ndarray, "2 2"]
    """Plan frame, m."""
    normal: Float[np.ndarray, "2"]
    """Unit, towards the side that it was seen from."""
    patch_idx: Int[np.ndarray, " p"]
    top_m: float
    """Over the floor."""
    has_wall_behind: bool
    """Whether a wall is drawn as far behind it as cupboards are deep."""
    storey: int | None = None
    """Where the plan has storeys."""


def top_of(above_floor_m: Float[np.ndarray, " m"]) -> float:
    """Height of the top of a piece, of its points' heights over the floor; 0 where none is known."""
    known = above_floor_m[np.isfinite(above_floor_m)]
    return float(np.quantile(known, TOP_QUANTILE)) if len(known) else 0.0


def are_walls(pieces: Sequence[Piece], sight: LinesOfSight) -> Bool[np.ndarray, " s"]:
    """Whether each piece is wall."""
    if not pieces:
        return np.zeros(0, dtype=bool)
    storeys = None
    if pieces[0].storey is not None:
        storeys = np.array([piece.storey for piece in pieces])
    ends = np.stack([piece.ends for piece in pieces])
    drawn = Floorplan(
        "pieces of wall",
        ends,
        np.stack([piece.normal for piece in pieces]),
        np.ones(len(pieces), dtype=bool),
        storeys=storeys,
    )
    is_over = through_shares(sight, drawn, (HEIGHTS_M[0], CEILING_M), 1) > MAX_OVER_SHARE
    is_high = np.array([piece.top_m >= MIN_TOP_M for piece in pieces])
    side_m, front_m = MAX_CUPBOARD_M
    most_m = np.where([piece.has_wall_behind for piece in pieces], front_m, side_m)
    return is_high | (~is_over & (segments.lengths(ends) > most_m))

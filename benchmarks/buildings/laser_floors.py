"""Semi-real scans of six real floors: a laser's walls and the laser's own walk, rendered as depth.

Real are the shapes of the floors, what stands in them at the height of the laser, and the walk. Made up are
the heights, the camera and its noise. The plan is drawn of the long straight walls alone, so that it is of
the building and not of all that is rendered.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from faults.inputs import Inputs
from faults.scans import SHARED
from jaxtyping import Bool, Float, Int
from scipy.ndimage import gaussian_filter1d

from buildings.lounge import depth_options, rendered_in
from planfit.errors import ScanError
from planfit.floorplan import Floorplan
from planfit.geometry import segments
from planfit.synth import (
    TimeOfFlightNoise,
    WalkOptions,
)
from planfit.synth.walk import evenly_moving, look_ahead

LASER_FLOORS: tuple[str, ...] = (
    "acapulco",
    "belgioioso",
    "edmonton",
    "freiburg-101",
    "orebro",
    "seattle",
)
MAX_RANGE_M = 15.0
"""Farther returns lie 0.26 m apart at 1 deg a beam and show no wall; no return is 51 m and more."""


@dataclass(frozen=True)
class LaserLog:
    """Scans of a 2D laser from corrected poses; beams turn to the left, from the right to the left side."""

    poses: Float[np.ndarray, "n 3"]
    """x, y (m) and heading (rad) in the map."""
    ranges_m: Float[np.ndarray, "n b"]
    fov_rad: float = np.pi

    def returns(self) -> Float[np.ndarray, "n b 2"]:
        """Where beams end in the map, m; NaN where none came back."""
        beams = np.linspace(-0.5, 0.5, self.ranges_m.shape[1]) * self.fov_rad
        angle = self.poses[:, 2:] + beams
        ranges = np.where(self.ranges_m < MAX_RANGE_M, self.ranges_m, np.nan).astype(float)
        ray = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return self.poses[:, None, :2] + ranges[..., None] * ray


def read_log(name: str) -> LaserLog:
    """A log by the name of its floor.

    Raises:
        ScanError: it is not at hand.
    """
    path = SHARED / "buildings" / "carmen2d" / f"{name}.npz"
    if not path.is_file():
        raise ScanError(f"{path}: expected a laser log of {name}, found no file; see its README")
    with np.load(path) as arrays:
        return LaserLog(arrays["pose"], arrays["ranges"])


@dataclass(frozen=True)
class MergeOptions:
    """How pieces of wall become walls."""

    off_m: float
    """Both ends of a piece lie so near to the line of its wall."""
    seen: int
    """So many pieces cover each place of a wall."""
    gap_m: float
    """Shorter gaps are closed."""
    shortest_m: float


BUILT = MergeOptions(off_m=0.06, seen=2, gap_m=0.15, shortest_m=0.25)
"""82 (edmonton) to 100 % (seattle) of pieces from 1 m lie within 6 cm of their wall; what one scan alone
shows may be a person."""
DRAWN = MergeOptions(off_m=0.10, seen=1, gap_m=0.5, shortest_m=1.0)
"""Of built walls: a draughtsman leaves piers of 10 cm out, and no door is narrower than 0.5 m."""
JUMP_M, JUMP_BEAMS, MAX_JUMP_M = 0.3, 3.0, 0.6
"""Neighbouring returns of one surface: 0.3 m and three beams apart at most, and never a door's width."""
BEND_M, PIECE_M, PIECE_POINTS = 0.04, 0.2, 4
"""Returns scatter 1 to 3 cm about a wall (medians by log); pieces shorter than this have no direction."""
SLANT = np.cos(np.deg2rad(15.0))
"""Directions of the shortest pieces scatter that much; longer ones are held by `off_m` at both ends."""
REACH_M, BIN_M, REPEAT_M = 1.0, 0.05, 0.10
"""Along a line: what is one wall in spite of a doorway, and the grid it is counted on. A wall this near
before another one that looks the same way is that one, seen from poses a little off."""
DRIVEN_M = 0.3
"""Half a robot's width: where it drove there is no wall, but a door that was shut or opened later."""
CORNER_M, UPRIGHT_M = 0.3, 0.04
"""Draughtsmen join walls that end so near a corner, and draw at right angles what is so little off."""

MOTION_M, N_FRAMES = 68.0, 130
"""Of the walk, and frames on it: 0.52 m or 24 deg apart, and less where both come together."""
WALK = WalkOptions(
    n_frames=N_FRAMES,
    sway_m=0.02,
    pitch_deg=-9.0,
    pitch_swing_deg=3.0,
    look_around_deg=12.0,
    roll_swing_deg=1.0,
)
NOISE = TimeOfFlightNoise(max_range_m=6.0)
"""A metre farther than phones: two of the floors are exhibition halls, with little to see within 5 m."""
STEP_M, ROTATION_PER_M = 0.02, np.deg2rad(45.0)
"""As in `planfit.synth.walk`: spacing of poses that frames are picked from, and what counts as a metre."""
SMOOTH_M = 0.25
"""The laser's poses are 1 m apart: corners of its walk are rounded so far."""
BEGINS_M = {
    "acapulco": 120.0,
    "belgioioso": 0.0,
    "edmonton": 160.0,
    "freiburg-101": 0.0,
    "orebro": 0.0,
    "seattle": 30.0,
}
"""Of each walk along the log's, chosen on the maps alone: where it turns, and goes round something."""


def wall_pieces(log: LaserLog) -> Float[np.ndarray, "k 2 2"]:
    """Straight runs of neighbouring returns of single scans, m, the laser on the left."""
    pieces = []
    beam_rad = log.fov_rad / (log.ranges_m.shape[1] - 1)
    for returns, ranges in zip(log.returns(), log.ranges_m, strict=True):
        jump = np.minimum(JUMP_M + JUMP_BEAMS * beam_rad * ranges[1:], MAX_JUMP_M)
        goes_on = np.linalg.norm(np.diff(returns, axis=0), axis=1) < jump  # false where NaN
        for run in np.split(returns, np.flatnonzero(~goes_on) + 1):
            pieces += _straight(run)
    return np.array(pieces).reshape(-1, 2, 2)


def _straight(run: Float[np.ndarray, "n 2"]) -> list[Float[np.ndarray, "2 2"]]:
    """A run split where it bends most, until nothing is off its chord."""
    if len(run) < PIECE_POINTS:
        return []
    chord = run[-1] - run[0]
    length = float(np.linalg.norm(chord))
    off = np.linalg.norm(run - run[0], axis=1)
    if length > 1e-6:
        off = np.abs((run - run[0]) @ np.array([-chord[1], chord[0]])) / length
    bend = int(np.argmax(off))
    if off[bend] > BEND_M:
        return _straight(run[: bend + 1]) + _straight(run[bend:])
    if length < PIECE_M:
        return []
    middle, along = _line(run, np.ones(len(run)))
    along *= np.sign(along @ chord)
    return [middle + np.outer((run[[0, -1]] - middle) @ along, along)]


def _line(
    points: Float[np.ndarray, "n 2"], weights: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """A point and a direction of the line nearest to points."""
    middle = np.average(points, axis=0, weights=weights)
    spread = ((points - middle) * weights[:, None]).T @ (points - middle)
    return middle, np.linalg.eigh(spread)[1][:, 1]


def merged(pieces: Float[np.ndarray, "k 2 2"], options: MergeOptions) -> Float[np.ndarray, "n 2 2"]:
    """Walls that pieces are parts of, m, the side they were seen from on the left; longest pieces first."""
    order = np.argsort(-segments.lengths(pieces), kind="stable")
    pieces = pieces[order]
    along = segments.directions(pieces)
    is_free = np.ones(len(pieces), dtype=bool)
    walls = np.zeros((0, 2, 2))
    for seed in range(len(pieces)):
        if not is_free[seed]:
            continue
        own, line = _of_one_line(pieces, along, is_free, seed, options.off_m)
        is_free[own] = False
        middle, direction = line
        for low, high in _spans((pieces[own] - middle) @ direction, options):
            wall = middle + np.outer([low, high], direction)
            walls = np.concatenate([walls, _not_yet(wall, walls, options)])
    return walls


def _of_one_line(
    pieces: Float[np.ndarray, "k 2 2"],
    along: Float[np.ndarray, "k 2"],
    is_free: Bool[np.ndarray, " k"],
    seed: int,
    off_m: float,
) -> tuple[Int[np.ndarray, " m"], tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]]:
    """Which pieces are of one wall with a seed, and the point and direction of their line."""
    middle, direction = pieces[seed].mean(axis=0), along[seed]
    own = np.array([seed])
    for _ in range(3):  # the line of one piece is rough: others on it make it better
        near = np.flatnonzero(is_free & (along @ direction > SLANT))
        off = np.abs((pieces[near] - middle) @ np.array([-direction[1], direction[0]]))
        near = near[off.max(axis=1) < off_m]
        near = np.union1d(near, seed)
        own = near[_reached((pieces[near] - middle) @ direction, int(np.searchsorted(near, seed)))]
        weights = np.repeat(segments.lengths(pieces[own]), 2)
        middle, turned = _line(pieces[own].reshape(-1, 2), weights)
        direction = turned * np.sign(turned @ direction)
    return own, (middle, direction)


def _reached(at: Float[np.ndarray, "m 2"], seed: int) -> Bool[np.ndarray, " m"]:
    """Which spans of a line hang together with one of them."""
    order = np.argsort(at[:, 0], kind="stable")
    far = np.maximum.accumulate(at[order, 1])
    group = np.zeros(len(at), dtype=int)
    group[order[1:]] = np.cumsum(at[order[1:], 0] > far[:-1] + REACH_M)
    return group == group[seed]


def _spans(at: Float[np.ndarray, "m 2"], options: MergeOptions) -> list[tuple[float, float]]:
    """What of a line is covered often enough, gaps closed, from the first end to the second."""
    low = at.min()
    first = np.rint((at[:, 0] - low) / BIN_M).astype(int)
    last = np.rint((at[:, 1] - low) / BIN_M).astype(int)
    change = np.zeros(last.max() + 2, dtype=int)
    np.add.at(change, first, 1)
    np.add.at(change, last, -1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.cumsum(change) >= options.seen, [0]])))
    if len(edges) == 0:
        return []
    begins, ends = low + BIN_M * edges[::2], low + BIN_M * edges[1::2]
    is_gap = begins[1:] - ends[:-1] > options.gap_m
    begins, ends = begins[np.r_[True, is_gap]], ends[np.r_[is_gap, True]]
    return [(b, e) for b, e in zip(begins, ends, strict=True) if e - b >= options.shortest_m]


def _not_yet(
    wall: Float[np.ndarray, "2 2"], walls: Float[np.ndarray, "n 2 2"], options: MergeOptions
) -> Float[np.ndarray, "m 2 2"]:
    """Parts of a wall that are not there already: one seen twice from poses a little off is drawn once."""
    length = float(np.linalg.norm(wall[1] - wall[0]))
    direction = (wall[1] - wall[0]) / length
    same = walls[segments.directions(walls) @ direction > SLANT] if len(walls) else walls
    off = (same - wall[0]) @ np.array([-direction[1], direction[0]])
    same = same[np.abs(off).max(axis=1) < 2 * REPEAT_M] if len(same) else same
    if len(same) == 0:
        return wall[None]
    t = (np.arange(int(length / BIN_M)) + 0.5) * BIN_M
    middle = wall[0] + t[:, None] * direction
    is_new = np.ones(len(t), dtype=bool)
    for other in same:
        along = (middle - other[0]) @ (other[1] - other[0]) / np.sum((other[1] - other[0]) ** 2)
        foot = other[0] + np.clip(along, 0.0, 1.0)[:, None] * (other[1] - other[0])
        is_new &= np.linalg.norm(middle - foot, axis=1) > REPEAT_M
    edges = np.flatnonzero(np.diff(np.concatenate([[0], is_new, [0]]))) * BIN_M
    kept = [(a, b) for a, b in edges.reshape(-1, 2) if b - a >= options.shortest_m]
    return np.array([wall[0] + np.outer(k, direction) for k in kept]).reshape(-1, 2, 2)


@dataclass(frozen=True)
class FloorWalls:
    """Walls of a floor in the laser's map, m, the side they were seen from on the left."""

    built: Float[np.ndarray, "n 2 2"]
    """All that stands at the height of the laser, from 0.25 m: piers, cupboards, niches."""
    drawn: Float[np.ndarray, "m 2 2"]
    """Straight walls from 1 m, as a plan has them."""


def walls_of(log: LaserLog) -> FloorWalls:
    """What is built, and what is drawn of it."""
    way = shapely.LineString(log.poses[:, :2]).buffer(DRIVEN_M)
    built = _outside(merged(wall_pieces(log), BUILT), way, BUILT.shortest_m)
    drawn = _outside(merged(built, DRAWN), way, DRAWN.shortest_m)
    return FloorWalls(built, _joined(_at_right_angles(drawn)).round(2))


def _outside(
    walls: Float[np.ndarray, "n 2 2"], area: shapely.Geometry, shortest_m: float
) -> Float[np.ndarray, "m 2 2"]:
    """What of the walls lies outside an area, in their own direction."""
    parts = []
    for wall in walls:
        for part in shapely.get_parts(shapely.difference(shapely.LineString(wall), area)):
            if part.length >= shortest_m:
                ends = shapely.get_coordinates(part)[[0, -1]]
                parts.append(ends[np.argsort((ends - wall[0]) @ (wall[1] - wall[0]))])
    return np.array(parts).reshape(-1, 2, 2)


def _at_right_angles(walls: Float[np.ndarray, "n 2 2"]) -> Float[np.ndarray, "n 2 2"]:
    """Walls turned about their middles to the directions of most, where that moves them little."""
    along, length = segments.directions(walls), segments.lengths(walls)
    angle = np.arctan2(along[:, 1], along[:, 0])
    quarter = np.pi / 2
    candidates = np.arange(0.0, 90.0, 0.25) * np.pi / 180
    off = (angle[:, None] - candidates + quarter / 2) % quarter - quarter / 2
    main = candidates[np.argmax((length[:, None] * (np.abs(off) < np.deg2rad(1.0))).sum(axis=0))]
    turn = -((angle - main + quarter / 2) % quarter - quarter / 2)
    turn = np.where(np.abs(np.sin(turn)) * length / 2 < UPRIGHT_M, turn, 0.0)
    direction = np.column_stack([np.cos(angle + turn), np.sin(angle + turn)])
    half = 0.5 * length[:, None] * direction
    middle = walls.mean(axis=1)
    return np.stack([middle - half, middle + half], axis=1)


def _joined(walls: Float[np.ndarray, "n 2 2"]) -> Float[np.ndarray, "n 2 2"]:
    """Walls lengthened or cut to the corners that they nearly meet in."""
    along = segments.directions(walls)
    result = walls.copy()
    for i in range(len(walls)):
        cross = along[i, 0] * along[:, 1] - along[i, 1] * along[:, 0]
        steep = np.flatnonzero(np.abs(cross) > 0.5)  # walls at 30 deg and more
        for k in (0, 1):
            apart = walls[steep, 0] - walls[i, k]
            ahead = (apart[:, 0] * along[steep, 1] - apart[:, 1] * along[steep, 0]) / cross[steep]
            corner = walls[i, k] + ahead[:, None] * along[i]
            gap = np.linalg.norm(walls[steep] - corner[:, None], axis=2).min(axis=1)
            is_met = (np.abs(ahead) < CORNER_M) & (gap < CORNER_M)
            if is_met.any():
                result[i, k] = corner[is_met][np.argmin(np.abs(ahead[is_met]))]
    return result


def walk_of(log: LaserLog, begin_m: float) -> Float[np.ndarray, "n 3"]:
    """x, y and heading of the laser's own walk from `begin_m` on, 2 cm or 0.9 deg apart, rounded."""
    heading = np.unwrap(log.poses[:, 2])
    knots = np.column_stack([log.poses[:, :2], heading])
    steps = np.linalg.norm(np.diff(knots[:, :2], axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(np.hypot(steps, np.diff(heading) / ROTATION_PER_M))])
    first = at[np.searchsorted(np.cumsum(steps), begin_m)] if begin_m > 0 else 0.0
    wanted = np.arange(first, min(first + MOTION_M, at[-1]), STEP_M)
    dense = np.column_stack([np.interp(wanted, at, column) for column in knots.T])
    return gaussian_filter1d(dense, SMOOTH_M / STEP_M, axis=0, mode="nearest")


def laser_floor(name: str) -> Inputs:
    """Depth rendered along a laser's walk through a real floor, with its true poses as recorded ones.

    Raises:
        ScanError: the log is not at hand.
    """
    log = read_log(name)
    walls = walls_of(log)
    walked = walk_of(log, BEGINS_M[name])
    options = depth_options(LASER_FLOORS.index(name) + 1, NOISE)
    rng = np.random.default_rng(options.seed)
    level = np.zeros(len(walked))
    poses = look_ahead(walked[:, :2], level, walked[:, 2], WALK, rng)
    plan_from_cams = poses[evenly_moving(poses, N_FRAMES)]
    way = shapely.LineString(walked[:, :2])
    near = shapely.distance(shapely.linestrings(walls.built), way) < NOISE.max_range_m + 1.0
    # The rounded walk cuts corners that the laser itself went round.
    built = _outside(walls.built[near], way.buffer(DRIVEN_M), BUILT.shortest_m)
    world = Floorplan.from_segments(built, segments.left_normals(built), name=f"{name} as built")
    plan = Floorplan.from_segments(
        walls.drawn, segments.left_normals(walls.drawn), name=f"{name}, drawn from its laser map"
    )
    return rendered_in(f"{name}, rendered", world, plan, plan_from_cams, options)

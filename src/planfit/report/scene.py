"""What the 3D view shows, as arrays: points by frame, poses before and after, walls, pictures.

In a page it is text: points in 16 bits a coordinate, levels of detail, compressed. A tile is the points of a
frame in the axes of its camera, with an origin and a scale of its own. That serves three ends at once: a tile
is as small as what a depth camera sees, so that 16 bits are fine enough; the same points serve before and
after, a pose apart; and a point's frame costs nothing. A level is an even thinning of all tiles. Points
follow each other as the pixels they come from, so differences from point to point, in planes of bytes,
compress well.
"""

import base64
import json
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8, UInt16

from planfit.runtime import in_threads

FAR_M = 0.51
"""Distances to the plan end here: what is further is near no wall."""
_LEAST_STEP_M = 0.001
"""Of coordinates: points move by half of it at most, less than any depth camera knows, and what is finer is
noise, which does not compress: 9.3 bytes a point became 7.4 on a real site, with six bits of colour."""
_DISTANCE_STEP_M = FAR_M / 255
"""Of the distances to the plan: 2 mm."""
_FIRST_POINTS, _LEVEL_POINTS = 40_000, 150_000
"""Of the first level, which even a processor without a GPU draws at once, and of the others: one is unpacked
within a tenth of a second, during which the page stands still."""
_STEPS = np.iinfo(np.uint16).max
"""Coordinates are kept in 16 bits."""
REACH_M = _LEAST_STEP_M * _STEPS
"""Points further from their camera along any axis (66 m) are left out: a tile with them would round by 1
mm."""
_COLOR_BITS = np.uint8(0xFC)
"""Six bits a channel, which no eye tells from eight in a cloud of dots."""


@dataclass(frozen=True)
class ScenePoints:
    """m points of a scan in the axes of the n cameras that saw them."""

    points_cam: Float[np.ndarray, "m 3"]
    """m"""
    colors: UInt8[np.ndarray, "m 3"]
    """RGB"""
    start: Int[np.ndarray, " starts"]
    """(n + 1,): points of frame i are start[i]:start[i + 1]."""
    plan_distances_m: Float[np.ndarray, "2 m"] | None
    """Before and after, to the nearest face from above, `FAR_M` at most; None without a plan that
    the scan is aligned with."""

    @property
    def frame_idx(self) -> Int[np.ndarray, " m"]:
        """Frame of each point."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))


@dataclass(frozen=True)
class SceneFrame:
    """What is told of a frame that is pressed."""

    name: str
    """As its format calls it."""
    time: str
    """In words; empty where the format has no times."""
    moved: str
    """By the refinement, in words."""
    predicted: str
    """Its predicted error, in words."""
    tangents: tuple[float, float]
    """Of half the angles of view, across and down."""
    floor_m: float
    """Height of the floor that it stands on, plan frame, m."""
    is_after_gap: bool
    """Whether the recording stopped before it, so that no path leads to it."""


@dataclass(frozen=True)
class SceneWall:
    """A face of the plan, or a wall that it lacks, as an upright rectangle."""

    face_idx: int
    """Below 0: less the number of a wall that the plan lacks."""
    ends: Float[np.ndarray, "2 2"]
    """Plan frame, m."""
    normal: Float[np.ndarray, "2"]
    """Unit vector, towards the room where that is known."""
    heights: tuple[float, float]
    """Of its lower and upper edge, m."""
    status: str
    """agrees, moved, missing, new (the plan lacks it), unseen."""
    title: str
    """In words."""
    rows: tuple[tuple[str, str], ...]
    """What was measured of it: names and words."""


@dataclass(frozen=True)
class Scene:
    """What the 3D view shows, in the plan frame."""

    origin: Float[np.ndarray, "3"]
    """Plan frame, m: single precision is kept for what is relative to it, so that site coordinates of
    millions of metres lose nothing."""
    bounds: Float[np.ndarray, "2 3"]
    """Lower and upper corner of what is to be seen first, m; stray points lie outside."""
    cut_m: float
    """Height above which nothing is shown at first: ceilings would hide the rooms."""
    before: Float[np.ndarray, "n 4 4"]
    """plan_from_cams"""
    after: Float[np.ndarray, "n 4 4"]
    """plan_from_cams"""
    points: ScenePoints
    frames: tuple[SceneFrame, ...]
    keyframe_idx: Int[np.ndarray, " k"]
    """Frames that are drawn as little cameras."""
    walls: tuple[SceneWall, ...]
    pictures: Mapping[int, bytes]
    """JPEGs of some frames, by frame."""


def scene_json(scene: Scene, n_levels: int) -> str:
    """Everything but the points, for a `script` element that holds JSON."""
    origin = scene.origin
    tiles = np.stack(tile_frames(scene.points), axis=1)
    values = {
        "nLevels": n_levels,
        "origin": origin.tolist(),
        "bounds": np.round(scene.bounds - origin, 3).tolist(),
        "cut": round(float(scene.cut_m - origin[2]), 3),
        "heights": [round(float(z - origin[2]), 3) for z in _shown_heights(scene)],
        "before": _floats(_relative(scene.before, origin)),
        "after": _floats(_relative(scene.after, origin)),
        "tiles": _floats(tiles),
        "hasDistances": scene.points.plan_distances_m is not None,
        "keyframes": scene.keyframe_idx.tolist(),
        # By columns: names of fields in every row took 3 MB of a page of 25,000 frames.
        "frames": {
            "id": [frame.name for frame in scene.frames],
            "time": _column(frame.time for frame in scene.frames),
            "moved": _column(frame.moved for frame in scene.frames),
            "predicted": _column(frame.predicted for frame in scene.frames),
            "floor": _column(round(f.floor_m - float(origin[2]), 3) for f in scene.frames),
            "tangents": _column([round(t, 4) for t in frame.tangents] for frame in scene.frames),
            "isAfterGap": _column(int(frame.is_after_gap) for frame in scene.frames),
        },
        "walls": [
            {
                "face": wall.face_idx,
                "ends": np.round(wall.ends - origin[:2], 4).ravel().tolist(),
                "normal": np.round(wall.normal, 6).tolist(),
                "heights": [round(float(z - origin[2]), 3) for z in wall.heights],
                "status": wall.status,
                "title": wall.title,
                "rows": wall.rows,
            }
            for wall in scene.walls
        ],
        "pictures": {
            str(i): base64.b64encode(jpeg).decode("ascii") for i, jpeg in scene.pictures.items()
        },
    }
    text = json.dumps(values, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")  # no name of a file can end the script element


def _column(values: Iterable[Any]) -> list[Any]:
    """One value where all are the same."""
    column = list(values)
    return column[:1] if all(value == column[0] for value in column) else column


def encode_levels(points: ScenePoints) -> list[str]:
    """Base64 of the levels of detail, each of its own points."""
    quantised = quantise(points)
    kept = np.all(np.abs(points.points_cam) <= REACH_M, axis=1)
    n_kept = max(int(kept.sum()), 1)
    first = min(_FIRST_POINTS / n_kept, 1.0)
    n_others = -(-max(n_kept - _FIRST_POINTS, 0) // _LEVEL_POINTS)
    ends = np.linspace(first, 1.0, n_others + 1)
    # Steps of the golden ratio: every level is even along the rows of pixels, and none is a grid of its own.
    turn = np.arange(len(kept)) * ((np.sqrt(5.0) - 1.0) / 2.0) % 1.0
    level = np.minimum(np.searchsorted(ends, turn, side="right"), n_others)
    colors = points.colors & _COLOR_BITS

    def encode(k: int) -> str:
        return _encode_level(points, quantised, colors, kept & (level == k))

    return in_threads(encode, range(n_others + 1))


def tile_frames(points: ScenePoints) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Origin of each frame's points (m) and metres of a step, single precision: cam = origin + step * q."""
    n_frames = len(points.start) - 1
    low = np.zeros((n_frames, 3), dtype=np.float32)
    steps = np.full((n_frames, 3), _LEAST_STEP_M, dtype=np.float32)
    for i in range(n_frames):
        tile = points.points_cam[points.start[i] : points.start[i + 1]]
        tile = tile[np.all(np.abs(tile) <= REACH_M, axis=1)]
        if len(tile):
            low[i] = tile.min(axis=0)
            steps[i] = np.maximum((tile.max(axis=0) - low[i]) / _STEPS, _LEAST_STEP_M)
    return low, steps


def quantise(points: ScenePoints) -> UInt16[np.ndarray, "m 3"]:
    """Steps from the origin of each point's tile, rounded; points beyond `REACH_M` mean nothing."""
    low, steps = tile_frames(points)
    quantised = np.zeros((len(points.points_cam), 3), dtype=np.uint16)
    for i, (first, last) in enumerate(zip(points.start[:-1], points.start[1:], strict=True)):
        found = np.rint((points.points_cam[first:last].astype(float) - low[i]) / steps[i])
        quantised[first:last] = np.clip(found, 0, _STEPS)
    return quantised


def _encode_level(
    points: ScenePoints,
    quantised: UInt16[np.ndarray, "m 3"],
    colors: UInt8[np.ndarray, "m 3"],
    mask: Bool[np.ndarray, " m"],
) -> str:
    frame_idx = points.frame_idx[mask]
    counts = np.bincount(frame_idx, minlength=len(points.start) - 1).astype("<u4")
    planes: list[np.ndarray] = []
    for axis in range(3):
        # Differences wrap around as the sums of the page do.
        change = np.diff(quantised[mask, axis], prepend=np.uint16(0))
        planes += [change & 0xFF, change >> 8]
    planes += [np.diff(colors[mask, k], prepend=np.uint8(0)) for k in range(3)]
    if points.plan_distances_m is not None:
        for distances in points.plan_distances_m[:, mask]:
            planes.append(np.minimum(np.rint(distances / _DISTANCE_STEP_M), 255))
    body = b"".join(plane.astype(np.uint8).tobytes() for plane in planes)
    return base64.b64encode(zlib.compress(counts.tobytes() + body, 6)).decode("ascii")


def _shown_heights(scene: Scene) -> tuple[float, float]:
    """Heights (m) that the colours of heights run between."""
    low, high = float(scene.bounds[0, 2]), float(scene.bounds[1, 2])
    return low, max(high, low + 0.1)


def _relative(
    plan_from_cams: Float[np.ndarray, "n 4 4"], origin: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "n 3 4"]:
    poses = plan_from_cams[:, :3].copy()
    poses[:, :, 3] -= origin
    return poses


def _floats(values: Float[np.ndarray, "..."] | Int[np.ndarray, "..."]) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")

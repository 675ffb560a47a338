"""From a mask of wall to straight-sided regions, and from these to faces that lie where the ink says."""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import shapely
from jaxtyping import Float, Int, Shaped, UInt8
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.vector.line_work import WallFaces
from planfit.geometry import segments

_CORNER_PX = 1.6
"""Corners nearer than this to the line between their neighbours are noise of the outline."""
_MOST_CONTOURS = 5_000
"""A mask of more is noise or texture, of which tracing and weighing take minutes. Of seven pictures of real
plans none has more than 383 regions."""
_MAX_ROWS = np.iinfo(np.int16).max - 1
"""That OpenCV maps at once: it wants fewer than a 16-bit number counts."""
_SNAP_PX = 1.0
"""An edge is set along a row or column where its ends need to move by no more than this."""


def trace_regions(mask: UInt8[np.ndarray, "h w"], grow_px: float) -> list[BaseGeometry]:
    """Polygons around the connected parts of a mask, in pixels (u, v), holes included; none of a mask of more
    parts than any plan has.

    `mask`: 1 where there is wall; `grow_px`: their edges are moved out by this (in, where negative).
    """
    # What is a pixel wide has no inside in OpenCV's contours.
    ahead = max(int(grow_px - 0.5), 0)
    if ahead:
        mask = cv2.dilate(mask, np.ones((2 * ahead + 1, 2 * ahead + 1), np.uint8))
    # Contours run through the middle of the outermost pixels, half a pixel inside the edge.
    reach = 0.5 + grow_px - ahead
    contours, hierarchy = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if hierarchy is None or sum(len(contour) >= 4 for contour in contours) > _MOST_CONTOURS:
        return []
    holes: dict[int, list[np.ndarray]] = {}
    for contour, (_, _, _, parent) in zip(contours, hierarchy[0], strict=True):
        if parent >= 0:
            holes.setdefault(int(parent), []).append(contour)
    result = []
    for i, (contour, (_, _, _, parent)) in enumerate(zip(contours, hierarchy[0], strict=True)):
        if parent >= 0 or len(contour) < 4:
            continue
        # Shell and holes apart: the faces of a thin wall may cross before they are moved out.
        solid = _area(contour, reach)
        inner = [_area(hole, -reach) for hole in holes.get(i, []) if len(hole) >= 8]
        if inner:
            solid = shapely.difference(solid, shapely.union_all(inner))
        result += [part for part in shapely.get_parts(solid) if part.geom_type == "Polygon"]
    return result


def straight_lengths(
    regions: Shaped[np.ndarray, " n"] | Sequence[shapely.Polygon],
    least_px: float | Float[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """Of each of some polygons the length of its edges that are at least so long."""
    rings, region = shapely.get_rings(np.array(regions, dtype=object), return_index=True)
    points, ring = shapely.get_coordinates(rings, return_index=True)
    own = region[ring[1:]]
    length = np.hypot(*np.diff(points, axis=0).T)
    # Two points in sequence are an edge where they are of one ring.
    is_long = (ring[1:] == ring[:-1]) & (length >= np.broadcast_to(least_px, len(regions))[own])
    return np.bincount(own[is_long], length[is_long], len(regions)).astype(float)  # of none: int


def _area(contour: Int[np.ndarray, "n 1 2"], reach: float) -> BaseGeometry:
    """Inside of a contour, its edge moved out by `reach`."""
    ring = straighten(contour[:, 0].astype(float))
    if len(ring) < 3:
        return shapely.buffer(shapely.LineString(ring), reach, cap_style="square") if len(
            ring) == 2 and reach > 0 else shapely.Polygon()  # fmt: skip
    polygon = shapely.make_valid(shapely.Polygon(ring))
    return shapely.buffer(polygon, reach, join_style="mitre", mitre_limit=3.0)


def straighten(ring: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "k 2"]:
    """Corners of a closed outline of pixels: lines fitted to its straight parts, met."""
    corner_idx = _corners(ring)
    k = len(corner_idx)
    if k < 3:
        return ring[corner_idx]
    lines = []
    for a, b in zip(corner_idx, np.roll(corner_idx, -1), strict=True):
        part = ring[a : b + 1] if b > a else np.concatenate([ring[a:], ring[: b + 1]])
        lines.append(_fit_line(part))
    result = []
    for i in range(k):
        corner = ring[corner_idx[i]]
        met = _meet(lines[i - 1], lines[i])
        result.append(met if met is not None and np.hypot(*(met - corner)) < 4.0 else corner)
    return np.array(result)


def _corners(ring: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, " k"]:
    """Indices of the corners of an outline, in order."""
    corners = cv2.approxPolyDP(ring.astype(np.int32)[:, None], _CORNER_PX, True)[:, 0]
    # approxPolyDP keeps points of the outline, in its order, from an arbitrary one on.
    # A key for each pixel, u above v (pictures are below 2**20 px), tells where in the outline a corner is.
    keys = ring[:, 0].astype(np.int64) * (1 << 20) + ring[:, 1].astype(np.int64)
    order = np.argsort(keys, kind="stable")
    wanted = corners[:, 0].astype(np.int64) * (1 << 20) + corners[:, 1].astype(np.int64)
    first, past = (np.searchsorted(keys[order], wanted, side) for side in ("left", "right"))
    # The outline passes twice through what is one pixel thick, there and back: of such a corner the visit
    # is meant that comes next after the corner before.
    result = order[first]
    once = np.flatnonzero(past - first == 1)
    start = int(once[0]) if len(once) else 0
    for k in range(start + 1, start + len(corners)):
        i, before = k % len(corners), result[(k - 1) % len(corners)]
        if past[i] - first[i] > 1:
            visits = order[first[i] : past[i]]
            result[i] = visits[np.argmin((visits - before - 1) % len(ring))]
    return np.sort(result)


def _fit_line(
    points: Float[np.ndarray, "m 2"],
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """A point and a unit direction: the median line of the points, along an axis where they allow."""
    ends = points[-1] - points[0]
    trim = len(points) // 8
    kept = points[trim : len(points) - trim] if len(points) > 8 else points
    axis = int(np.abs(ends[1]) > np.abs(ends[0]))
    if np.abs(ends[1 - axis]) <= _SNAP_PX or len(points) < 5:
        direction = np.array([1.0, 0.0]) if axis == 0 else np.array([0.0, 1.0])
        if np.abs(ends[1 - axis]) <= _SNAP_PX:
            return _median(kept), direction
    middle = kept.sum(axis=0) / len(kept)
    _, _, axes = np.linalg.svd(kept - middle, full_matrices=False)
    return middle, axes[0] * (1.0 if axes[0] @ ends >= 0 else -1.0)


def _median(points: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "2"]:
    """Of each coordinate; NumPy's own takes ten times as long for a few points, and edges are many."""
    ordered, half = np.sort(points, axis=0), len(points) // 2
    return ordered[half] if len(points) % 2 else (ordered[half - 1] + ordered[half]) / 2


def _meet(
    one: tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]],
    other: tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]],
) -> Float[np.ndarray, "2"] | None:
    """Where two lines meet; None where they run nearly alike."""
    cross = one[1][0] * other[1][1] - one[1][1] * other[1][0]
    if abs(cross) < 0.15:
        return None
    gap = other[0] - one[0]
    t = (gap[0] * other[1][1] - gap[1] * other[1][0]) / cross
    return one[0] + t * one[1]


def settle_faces(
    faces: WallFaces,
    darkness: Float[np.ndarray, "h w"],
    level: float,
    is_stroke: bool,
    reach_px: float,
) -> WallFaces:
    """Faces moved along their normals to where the ink is, by the median over each.

    Args:
        faces: in pixels of `darkness`.
        darkness: 0 for paper, 1 for black.
        level: darkness half way between wall and paper; for strokes, that of the paper beside them.
        is_stroke: a face lies in the middle of a stroke, not at the edge of a tone.
        reach_px: moves are at most this.
    """
    offsets = np.arange(-reach_px - 1.0, reach_px + 1.01, 0.25)
    points, face = segments.sample(faces.ends, 2.0)
    normals = faces.normals[face]
    profile = profiles(darkness, points, normals, offsets, cv2.INTER_LINEAR)
    if is_stroke:
        weight = np.maximum(profile - level * 0.5, 0.0)
        total = weight.sum(axis=1)
        move = (weight * offsets).sum(axis=1) / np.maximum(total, 1e-6)
        is_known = np.asarray(total > 0.25)
    else:
        falls = (profile[:, :-1] >= level) & (profile[:, 1:] < level)
        nearest = np.argmin(np.where(falls, np.abs(offsets[:-1] + 0.125), np.inf), axis=1)
        row = np.arange(len(profile))
        high, low = profile[row, nearest], profile[row, nearest + 1]
        share = (high - level) / np.maximum(high - low, 1e-6)
        move = offsets[nearest] + 0.25 * np.clip(share, 0.0, 1.0)
        is_known = np.asarray(falls.any(axis=1))
    moves = np.zeros(len(faces.ends))
    # First and one past the last point of each face.
    bounds = np.searchsorted(face, np.arange(len(faces.ends) + 1))
    for i, (first, last) in enumerate(itertools.pairwise(bounds)):
        known = move[first:last][is_known[first:last]]
        if 2 * len(known) >= last - first:
            moves[i] = np.clip(np.median(known), -reach_px, reach_px)
    return replace(
        faces,
        ends=faces.ends + moves[:, None, None] * faces.normals[:, None],
        thickness=np.maximum(faces.thickness + moves, 0.5),
    )


def profiles(
    picture: Shaped[np.ndarray, "h w"],
    points: Float[np.ndarray, "m 2"],
    directions: Float[np.ndarray, "m 2"],
    offsets: Float[np.ndarray, " k"],
    interpolation: int,
) -> Shaped[np.ndarray, "m k"]:
    """What a picture has at offsets (px) from points along a direction of each; 0 beyond its rim.

    `interpolation`: of OpenCV.
    """
    at = (points[:, None] + offsets[None, :, None] * directions[:, None]).astype(np.float32)
    result = np.zeros(at.shape[:2], picture.dtype)
    for first in range(0, len(at), _MAX_ROWS):
        part = at[first : first + _MAX_ROWS]
        result[first : first + _MAX_ROWS] = cv2.remap(
            picture, part[..., 0], part[..., 1], interpolation, borderValue=0
        )
    return result

"""Which face of a plan is nearest, seen from above: every search there is, and the rules each goes by.

| search                | of what    | seen from side | direction | beside      | distance   | faces tried |
|-----------------------|------------|----------------|-----------|-------------|------------|-------------|
| `nearest_distance`    | points     | any            | any       | ends count  | to segment | all         |
| `facing_distances`    | points     | that of an eye | any       | ends count  | to segment | all         |
| `nearest_beside`      | points     | of a normal    | an angle  | end margin  | across     | all         |
| `nearest_of_segments` | segments   | of a normal    | an angle  | by a share  | across     | all         |
| `distances_of_segments` | segments | of a normal    | an angle  | by a share  | across     | all         |
| `FaceGrid.nearest`    | of patches | of a normal    | any       | ends count  | to segment | of a cell   |

A face whose free side is unknown (`Floorplan.is_oriented`) is seen from either side, and so is any face where
sides are not asked for. Distances to a segment are those to its nearest point; distances across a face are
along its normal, signed, and do not see its ends.

The loops are compiled and stand in `planfit.floorplan.nearest_kernels`.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.errors import OptionError
from planfit.floorplan import nearest_kernels
from planfit.floorplan.types import Floorplan
from planfit.geometry import segments

END_MARGIN_M = 0.3
"""What is scanned may reach beyond the end of its face by this much and still count as beside it."""

MAX_CELLS_PER_SIDE = 400
"""Bounds the grid: 160,000 cells of half the reach, or of a four-hundredth of the plan if that is more."""


def nearest_distance(
    xy: Float[np.ndarray, "m 2"], ends: Float[np.ndarray, "n 2 2"]
) -> Float[np.ndarray, " m"]:
    """Distance (m) from each point to the nearest segment, ends included; infinite without segments."""
    return nearest_kernels.nearest_distance(
        np.ascontiguousarray(xy, dtype=float), np.ascontiguousarray(ends)
    )


def facing_distances(
    xy: Float[np.ndarray, "m 2"],
    eyes_xy: Float[np.ndarray, "m 2"],
    floorplan: Floorplan,
    storeys: Int[np.ndarray, " m"] | None = None,
) -> Float[np.ndarray, "m 2"]:
    """Distances (m) of points: to the nearest segment, and to the nearest that looks at the point's eye.

    A segment looks at an eye that stands on its free side. The second is infinite where none does. Where the
    plan has storeys, only faces of a point's own one count; both are infinite where it has no face.

    Raises:
        OptionError: the plan has storeys and the points have none.
    """
    if floorplan.storeys is not None:
        of_points = _known_storeys(storeys)
        distances = np.full((len(xy), 2), np.inf)
        for storey in np.unique(floorplan.storeys):
            own = of_points == storey
            distances[own] = facing_distances(xy[own], eyes_xy[own], floorplan.of_storey(storey))
        return distances
    return nearest_kernels.facing_distances(
        np.ascontiguousarray(xy, dtype=float),
        np.ascontiguousarray(eyes_xy, dtype=float),
        np.ascontiguousarray(floorplan.ends, dtype=float),
        np.ascontiguousarray(floorplan.normals, dtype=float),
        np.asarray(floorplan.offsets, dtype=float),
        np.asarray(floorplan.is_oriented, dtype=bool),
    )


def nearest_beside(
    xy: Float[np.ndarray, "m 2"],
    normals: Float[np.ndarray, "m 2"],
    ends: Float[np.ndarray, "n 2 2"],
    face_normals: Float[np.ndarray, "n 2"],
    is_oriented: Bool[np.ndarray, " n"],
    max_distance_m: float,
    max_angle_deg: float = 25.0,
    end_margin_m: float = END_MARGIN_M,
) -> tuple[Float[np.ndarray, " m"], Int[np.ndarray, " m"]]:
    """Signed distance (m) to the nearest face beside each point that looks its way, and the face, or -1.

    Args:
        xy: points of wall, in the faces' axes, metres.
        normals: unit, towards where each point was seen from.
        ends: of the faces, metres.
        face_normals: unit.
        is_oriented: faces that are seen from one side only.
        max_distance_m: faces further away are none; across the face.
        max_angle_deg: largest angle between the normals.
        end_margin_m: how far beyond the end of its face a point may lie.
    """
    return nearest_kernels.nearest_beside(
        np.ascontiguousarray(xy),
        np.ascontiguousarray(normals),
        np.ascontiguousarray(ends),
        np.ascontiguousarray(face_normals),
        is_oriented,
        max_distance_m,
        np.cos(np.deg2rad(max_angle_deg)),
        end_margin_m,
    )


@dataclass(frozen=True)
class BesideRule:
    """When a segment of wall lies beside a face that looks its way."""

    max_distance_m: float
    """Faces further away from the middle of the segment, across the face, are none."""
    max_angle_deg: float
    """Largest angle between a segment and its face."""
    min_overlap: float
    """Share of the segment that must lie beside the face."""
    end_margin_m: float = END_MARGIN_M
    """How far the segment may reach beyond the end of the face."""
    oriented: bool = True
    """Whether a face whose free side is known must look to the side the segment was seen from."""
    storeys: Int[np.ndarray, " k"] | None = None
    """Of each segment; only faces of the same one count. Needed where the plan has storeys."""

    def of(self, part: slice) -> "BesideRule":
        """The rule for some of the segments."""
        return self if self.storeys is None else replace(self, storeys=self.storeys[part])


def nearest_of_segments(
    ends: Float[np.ndarray, "k 2 2"],
    normals: Float[np.ndarray, "k 2"],
    floorplan: Floorplan,
    rule: BesideRule,
) -> tuple[Float[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Signed distance (m) from the nearest face to the middle of each segment of wall, and the face.

    NaN and -1 where no face looks its way and lies beside it.

    Args:
        ends: of the segments, plan frame, metres.
        normals: unit, towards where each segment was seen from.
        floorplan: the faces.
        rule: which faces count.

    Raises:
        OptionError: the plan has storeys and the segments have none.
    """
    k = len(ends)
    face_idx, signed = np.full(k, -1), np.full(k, np.nan)
    for begin in range(0, k, 2048):  # bounds the (segments x faces) tables
        part = slice(begin, min(begin + 2048, k))
        distance = distances_of_segments(ends[part], normals[part], floorplan, rule.of(part))
        score = np.where(np.isnan(distance), np.inf, np.abs(distance))
        rows = np.arange(score.shape[0])
        nearest = np.argmin(score, axis=1)
        found = np.isfinite(score[rows, nearest])
        face_idx[part] = np.where(found, nearest, -1)
        signed[part] = np.where(found, distance[rows, nearest], np.nan)
    return signed, face_idx


def distances_of_segments(
    ends: Float[np.ndarray, "k 2 2"],
    normals: Float[np.ndarray, "k 2"],
    floorplan: Floorplan,
    rule: BesideRule,
) -> Float[np.ndarray, "k n"]:
    """Signed distance (m) from each face to the middle of each segment; NaN where the rule does not hold.

    Raises:
        OptionError: the plan has storeys and the segments have none.
    """
    one_sided = floorplan.is_oriented & rule.oriented
    cosine = normals @ floorplan.normals.T
    looks_alike = np.where(one_sided, cosine, np.abs(cosine)) > np.cos(
        np.deg2rad(rule.max_angle_deg)
    )
    distance = ends.mean(axis=1) @ floorplan.normals.T - floorplan.offsets
    beside = share_beside(ends, floorplan, rule.end_margin_m) >= rule.min_overlap
    ok = looks_alike & (np.abs(distance) < rule.max_distance_m) & beside
    if floorplan.storeys is not None:
        ok &= _known_storeys(rule.storeys)[:, None] == floorplan.storeys
    return np.where(ok, distance, np.nan)


def _known_storeys(storeys: Int[np.ndarray, " k"] | None) -> Int[np.ndarray, " k"]:
    if storeys is None:
        raise OptionError(
            "storeys: expected the storey of each piece of wall, as the plan has several, found none; "
            "place the scan on its storeys first (planfit.pipeline.storeys)"
        )
    return storeys


def share_beside(
    ends: Float[np.ndarray, "k 2 2"], floorplan: Floorplan, margin_m: float
) -> Float[np.ndarray, "k n"]:
    """Share of each segment that lies beside each face, the face's ends widened by a margin (m)."""
    along = segments.directions(floorplan.ends)
    # Both ends of each segment on the axis of each face, 0 at the face's first end, its length at the second.
    at = (
        np.einsum("kei,ni->kne", ends, along)
        - np.einsum("ni,ni->n", floorplan.ends[:, 0], along)[:, None]
    )
    low, high = at.min(axis=2), at.max(axis=2)
    shared = np.minimum(high, floorplan.lengths + margin_m) - np.maximum(low, -margin_m)
    return shared / np.maximum(high - low, 1e-9)


@dataclass(frozen=True)
class FaceGrid:
    """A grid over the plan that knows which faces are near: nearest faces without trying them all.

    Made by `make_face_grid`.
    """

    floorplan: Floorplan
    is_oriented: Bool[np.ndarray, " n"]
    """Faces that are seen from one side only."""
    reach_m: float
    """Nothing further away is found."""
    origin: Float[np.ndarray, " 2"]
    """Metres, corner of the first cell."""
    cell_m: float
    shape: tuple[int, int]
    """Cells in x and in y."""
    start: Int[np.ndarray, " cells_and_one"]
    """Faces of cell c, counted row by row, are `faces[start[c]:start[c + 1]]`."""
    faces: Int[np.ndarray, " listed"]

    def nearest(
        self,
        points_cam: Float[np.ndarray, "m 3"],
        start: Int[np.ndarray, " k_and_one"],
        plan_from_cams: Float[np.ndarray, "k 4 4"],
        patch_normals: Float[np.ndarray, "k 2"],
    ) -> tuple[Int[np.ndarray, " m"], Float[np.ndarray, "m 2"], Float[np.ndarray, "m 2"]]:
        """Face of each point or -1, the face's nearest point (m), and the gap (m) from it to the point.

        Args:
            points_cam: metres; patch k is points start[k]:start[k + 1].
            start: where each patch begins.
            plan_from_cams: pose of each patch's camera.
            patch_normals: plan frame, towards the side that each patch was seen from.
        """
        m = len(points_cam)
        face_idx, feet, gaps = np.full(m, -1), np.zeros((m, 2)), np.zeros((m, 2))
        ends, normals = self.floorplan.ends, self.floorplan.normals
        faces = (
            np.ascontiguousarray(ends, dtype=float),
            np.ascontiguousarray(normals, dtype=float),
            self.is_oriented,
        )
        grid = (self.origin, self.cell_m, self.shape, self.start, self.faces, self.reach_m)
        patches = (points_cam, start, plan_from_cams, patch_normals)
        nearest_kernels.nearest_in_grid(*patches, *faces, *grid, face_idx, feet, gaps)
        return face_idx, feet, gaps


def make_face_grid(floorplan: Floorplan, reach_m: float, oriented: bool) -> FaceGrid:
    """Sort a plan's faces into cells for nearest faces up to `reach_m` away.

    `reach_m`: nothing further away is found; `oriented`: whether faces whose free side is known are found
    from that side only.
    """
    ends = np.ascontiguousarray(floorplan.ends, dtype=float)
    low = ends.min(axis=(0, 1)) - reach_m
    extent = ends.max(axis=(0, 1)) + reach_m - low
    cell_m = max(reach_m / 2, float(extent.max()) / MAX_CELLS_PER_SIDE)
    nx, ny = (int(n) + 1 for n in extent // cell_m)
    start, faces = nearest_kernels.list_faces(ends, low, cell_m, (nx, ny), reach_m)
    is_oriented = floorplan.is_oriented & oriented
    return FaceGrid(floorplan, is_oriented, reach_m, low, cell_m, (nx, ny), start, faces)

"""How far each face of a plan stands off where it is drawn, by what the scan shows of wall, and how sure
that is.

What one frame shows of a face errs by depth, which differs from frame to frame and shows in the scatter, and
by the pose of its camera, which does not: neighbouring poses err alike. So scatter is divided by the number
of frames; what the poses of one stretch of the walk may be off is one error, not divided, and that of another
stretch is another. Measured on even seeds of benchmarks/as_built.py, where the mean over all frames that show
a wall would err as much as one of them (ratio of squares 1) if their poses erred alike: 0.70 for walls that
one stretch shows, 0.59 for two, 0.39 for three.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.association import (
    AssociationOptions,
    PatchesOnPlan,
    associate,
    wall_patches_in_plan,
)
from planfit.adjust.moved_walls import MIN_SHARE, nearest_unexplained
from planfit.as_built.lines_of_sight import (
    DEPTH_M,
    END_M,
    MIN_FRAMES,
    LinesOfSight,
    Piece,
    are_walls,
    top_of,
)
from planfit.floorplan import Floorplan
from planfit.geometry import se3, segments
from planfit.priors import WALL_AS_DRAWN_M, WALL_LENGTH_LEAST_M, WALL_SPREAD_M
from planfit.segmentation import Structure

SCATTER_M, SCATTER_FRAMES = 0.02, 2.0
"""Of single patches about their wall, before any is seen, and how many this counts like."""
MIN_POINTS = 8
"""Of a frame, that tell where a face stands."""
NEAR_FACTOR = 3.0
"""Points up to this many times the distance of those as drawn are looked at beside them."""
AS_DRAWN_M = WALL_AS_DRAWN_M.value
"""Wall patches this near to a face as drawn, m, are of that face; what is further is looked at once these are
known."""
WITHIN_M = WALL_SPREAD_M.value
"""Patches agree on an offset within this, m."""
MIN_MOVED_PATCHES = 2
"""Patches that must agree on an offset beyond `AS_DRAWN_M`: one alone may be a cupboard."""
MIN_MOVED_SHARE = MIN_SHARE
"""Share of the length of patches, of those as drawn and those that agree, that must agree on such an offset:
of a wall behind cupboards, some is seen between them."""
MIN_LENGTH_M = WALL_LENGTH_LEAST_M.value
"""Shorter faces, m, are ends of walls and jambs of doors, and are not judged."""
MIN_PART_M = 0.2
"""Length of a face, m, that each frame must show of one that hardly any patch is of."""
FLOOR_SIGMA_M = 0.004
"""Minimum sigma of an offset, m: what depth errs by alike for all who see a wall."""


@dataclass(frozen=True)
class PlacedWalls:
    """Wall of a scan in the plan frame: k patches with m points, u points on none; n cameras."""

    normals: Float[np.ndarray, "k 2"]
    """Of patches, towards who sees them."""
    ends: Float[np.ndarray, "k 2 2"]
    """m"""
    frame_idx: Int[np.ndarray, " k"]
    start: Int[np.ndarray, " k_plus_1"]
    """Points of patch j are points[start[j]:start[j + 1]]."""
    face_idx: Int[np.ndarray, " k"]
    """That each patch may be of; -1 where there is none."""
    offset_m: Float[np.ndarray, " k"]
    """From that face as drawn, along its normal; NaN where there is none."""
    points: Float[np.ndarray, "m_plus_u 3"]
    """m; of patches, then those on none."""
    point_frame_idx: Int[np.ndarray, " m_plus_u"]
    plan_from_cams: Float[np.ndarray, "n 4 4"]
    pose_covariances: Float[np.ndarray, "n 6 6"]
    """[rad^2, rad m, m^2], tangents (rotation, translation), plan axes."""
    stretch: Int[np.ndarray, " n"]
    """Of the walk, that each camera is of."""
    storeys: Int[np.ndarray, " n"] | None
    """That each camera stands on, where the plan has storeys."""

    @cached_property
    def lengths(self) -> Float[np.ndarray, " k"]:
        """Of patches, m."""
        return segments.lengths(self.ends)

    @cached_property
    def storeys_of_patches(self) -> Int[np.ndarray, " k"]:
        """That the camera of each patch stands on; 0 for all where the plan has one."""
        if self.storeys is None:
            return np.zeros(len(self.frame_idx), dtype=int)
        return self.storeys[self.frame_idx]

    def points_of(self, patch_idx: Int[np.ndarray, " p"]) -> Int[np.ndarray, " q"]:
        """Points of some patches, patch by patch."""
        sizes = np.diff(self.start)[patch_idx]
        before = np.cumsum(sizes) - sizes
        return np.repeat(self.start[patch_idx] - before, sizes) + np.arange(int(sizes.sum()))

    @cached_property
    def by_x(self) -> Int[np.ndarray, " m_plus_u"]:
        """Points from left to right, so that those near a face are found without looking at all."""
        return np.argsort(self.points[:, 0], kind="stable")

    def points_near(
        self, ends: Float[np.ndarray, "2 2"], reach_m: float, storey: int | None
    ) -> Int[np.ndarray, " p"]:
        """Points in the box around a segment, seen from above, grown by a reach; of frames on a storey, where
        the plan has storeys."""
        low, high = ends.min(axis=0) - reach_m, ends.max(axis=0) + reach_m
        first, last = np.searchsorted(self.points[:, 0], [low[0], high[0]], sorter=self.by_x)
        near = np.sort(self.by_x[first:last])
        near = near[(self.points[near, 1] >= low[1]) & (self.points[near, 1] <= high[1])]
        if storey is not None and self.storeys is not None:
            near = near[self.storeys[self.point_frame_idx[near]] == storey]
        return near

    def pose_sigma_m(
        self,
        frame_idx: Int[np.ndarray, " p"],
        xy: Float[np.ndarray, "p 2"],
        normals: Float[np.ndarray, "p 2"],
    ) -> Float[np.ndarray, " p"]:
        """How far places that frames see may be off along normals, as their poses may be, one sigma."""
        lever = xy - self.plan_from_cams[frame_idx, :2, 3]
        # A camera that turns by w and moves by v carries a point at lever r by v + w x r: along the normal n,
        # w (r x n) + v n.
        by = np.zeros((len(xy), 6))
        by[:, 2] = lever[:, 0] * normals[:, 1] - lever[:, 1] * normals[:, 0]
        by[:, 3:5] = normals
        variance = np.einsum("pi,pij,pj->p", by, self.pose_covariances[frame_idx], by)
        return np.sqrt(np.maximum(variance, 0.0))

    def mean_pose_sigma_m(
        self,
        frame_idx: Int[np.ndarray, " p"],
        xy: Float[np.ndarray, "p 2"],
        normals: Float[np.ndarray, "p 2"],
    ) -> float:
        """The same of the mean of these places: poses of a stretch err alike, stretches by themselves."""
        sigma_m = self.pose_sigma_m(frame_idx, xy, normals)
        by_stretch = np.bincount(self.stretch[frame_idx], sigma_m) / len(sigma_m)
        return float(np.linalg.norm(by_stretch))


@dataclass(frozen=True)
class FaceOffset:
    """Where a face stands."""

    offset_m: float
    sigma_m: float
    patch_idx: Int[np.ndarray, " p"]
    """Patches that agree on it; none where single points tell it."""
    frame_idx: Int[np.ndarray, " f"]
    """Frames that show it."""


def place_walls(
    structure: Structure,
    floorplan: Floorplan,
    plan_from_cams: Float[np.ndarray, "n 4 4"],
    pose_covariances: Float[np.ndarray, "n 6 6"],
    stretch: Int[np.ndarray, " n"],
) -> PlacedWalls:
    """Wall in the plan frame, and the face of each patch: the nearest as drawn, else, of those within reach,
    that which it lies beside.

    Args:
        structure: wall patches and single points, camera frames.
        floorplan: as drawn.
        plan_from_cams: refined poses.
        pose_covariances: of these [rad^2, rad m, m^2], tangents (rotation, translation), plan axes.
        stretch: of the walk, that each pose is of.
    """
    patches, storeys, association = structure.walls, structure.storeys, AssociationOptions()
    drawn = associate(patches, floorplan, plan_from_cams, AS_DRAWN_M, association, storeys)
    has_face = drawn.face_idx >= 0
    seen = PatchesOnPlan(patches, floorplan, plan_from_cams, association, storeys)
    elsewhere, off_m = nearest_unexplained(seen, ~has_face)
    normals, ends = wall_patches_in_plan(patches, plan_from_cams)
    of_points = np.concatenate([patches.point_frame_idx, structure.unassigned_frame_idx])
    points_cam = np.concatenate([patches.points_cam, structure.unassigned_points_cam])
    return PlacedWalls(
        normals,
        ends,
        patches.frame_idx,
        patches.start,
        np.where(has_face, drawn.face_idx, elsewhere),
        np.where(has_face, drawn.distance_m, off_m),
        se3.transform_each(plan_from_cams[of_points], points_cam.astype(float)),
        of_points,
        plan_from_cams,
        pose_covariances,
        stretch,
        storeys,
    )


def find_offsets(
    placed: PlacedWalls, floorplan: Floorplan, sight: LinesOfSight
) -> dict[int, FaceOffset]:
    """Where the faces stand that enough patches agree on, or, where there are few, enough frames as drawn."""
    found = {}
    for face in np.unique(placed.face_idx[placed.face_idx >= 0]):
        own = np.flatnonzero(placed.face_idx == face)
        agree = own[_most_agreed(placed.offset_m[own], placed.lengths[own])]
        offset_m = placed.offset_m[agree]
        offset, frames = float(np.median(offset_m)), placed.frame_idx[agree]
        if abs(offset) > AS_DRAWN_M and len(agree) < MIN_MOVED_PATCHES:
            continue
        normals = np.broadcast_to(floorplan.normals[face], (len(agree), 2))
        pose_m = placed.mean_pose_sigma_m(frames, placed.ends[agree].mean(axis=1), normals)
        sigma = offset_sigma(offset_m, pose_m)
        found[int(face)] = FaceOffset(offset, sigma, agree, np.unique(frames))
    # What stands nearer to where a wall is drawn, or behind that, is no cupboard before it.
    moved = [face for face, one in found.items() if _is_before(one.offset_m, face, floorplan)]
    pieces = [_piece(placed, floorplan, face, found[face], sight) for face in moved]
    for face, is_wall in zip(moved, are_walls(pieces, sight), strict=True):
        if not is_wall:
            del found[face]
    for face in np.flatnonzero(floorplan.lengths >= MIN_LENGTH_M):
        known = found.get(int(face))
        if known is None or len(known.frame_idx) < MIN_FRAMES:
            by_points = _by_points(placed, floorplan, int(face))
            if by_points is not None:
                patch_idx = by_points.patch_idx if known is None else known.patch_idx
                found[int(face)] = replace(by_points, patch_idx=patch_idx)
    return found


def _is_before(offset_m: float, face: int, floorplan: Floorplan) -> bool:
    """Whether a face stands as far before where it is drawn as cupboards are deep; on either side where its
    free side is unknown."""
    before_m = offset_m if floorplan.is_oriented[face] else abs(offset_m)
    return before_m > DEPTH_M[0]


def _piece(
    placed: PlacedWalls, floorplan: Floorplan, face: int, found: FaceOffset, sight: LinesOfSight
) -> Piece:
    """What is seen of a face where it stands, before where it is drawn."""
    normal, first = floorplan.normals[face], floorplan.ends[face, 0]
    along = segments.directions(floorplan.ends[face][None])[0]
    # Patches may reach beyond the face, over a door to the next wall.
    at = np.clip((placed.ends[found.patch_idx] - first) @ along, 0.0, floorplan.lengths[face])
    stands = first + found.offset_m * normal
    which = placed.points_of(found.patch_idx)
    above_m = placed.points[which, 2] - sight.floors_m[placed.point_frame_idx[which]]
    return Piece(
        stands + np.array([at.min(), at.max()])[:, None] * along,
        normal,
        found.patch_idx,
        top_of(above_m),
        True,
        None if floorplan.storeys is None else int(floorplan.storeys[face]),
    )


def _by_points(placed: PlacedWalls, floorplan: Floorplan, face: int) -> FaceOffset | None:
    """Where a face stands, as drawn, that hardly any patch is of, by points of wall near it, frame by frame.

    Few points are seen of a short wall, and a long patch in line reaches over it.
    """
    near, at, off_m = _near_face(placed, floorplan, face, NEAR_FACTOR * AS_DRAWN_M)
    is_drawn = np.abs(off_m) <= AS_DRAWN_M
    frames, offsets, places = [], [], []
    for frame in np.unique(placed.point_frame_idx[near]):
        of_frame = placed.point_frame_idx[near] == frame
        own = of_frame & is_drawn
        # Else what lies at the border of "as drawn" is the edge of something that stands elsewhere.
        if own.sum() < max(MIN_POINTS, 0.5 * of_frame.sum()):
            continue
        if np.subtract(*np.quantile(at[own], [0.95, 0.05])) >= MIN_PART_M:
            frames.append(int(frame))
            offsets.append(float(np.median(off_m[own])))
            places.append(placed.points[near[own], :2].mean(axis=0))
    if len(frames) < MIN_FRAMES:
        return None
    frame_idx, offset_m = np.array(frames), np.array(offsets)
    normals = np.broadcast_to(floorplan.normals[face], (len(frames), 2))
    pose_m = placed.mean_pose_sigma_m(frame_idx, np.array(places), normals)
    sigma = offset_sigma(offset_m, pose_m)
    none = np.zeros(0, dtype=int)
    return FaceOffset(float(np.median(offset_m)), sigma, none, frame_idx)


def _near_face(
    placed: PlacedWalls, floorplan: Floorplan, face: int, reach_m: float
) -> tuple[Int[np.ndarray, " p"], Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
    """Points near a face as drawn that cameras see from its free side, where along it they lie, and how far
    off, m."""
    ends, normal = floorplan.ends[face], floorplan.normals[face]
    storey = None if floorplan.storeys is None else int(floorplan.storeys[face])
    near = placed.points_near(ends, reach_m, storey)
    from_first = placed.points[near, :2] - ends[0]
    at, off_m = from_first @ segments.directions(ends[None])[0], from_first @ normal
    length = float(floorplan.lengths[face])
    ok = (at > END_M) & (at < length - END_M) & (np.abs(off_m) <= reach_m)
    if floorplan.is_oriented[face]:
        eyes = placed.plan_from_cams[placed.point_frame_idx[near], :2, 3]
        ok &= (eyes - ends[0]) @ normal > 0
    return near[ok], at[ok], off_m[ok]


def _most_agreed(
    offset_m: Float[np.ndarray, " p"], length_m: Float[np.ndarray, " p"]
) -> Int[np.ndarray, " a"]:
    """Of some patches, those about the offset that the greatest length of them agrees on; those as drawn, if
    that is not by far more than theirs."""
    near = np.abs(offset_m[:, None] - offset_m) <= WITHIN_M
    most = int(np.argmax(near @ length_m))
    agree, drawn = near[most], np.abs(offset_m) <= AS_DRAWN_M
    if abs(float(np.median(offset_m[agree]))) > AS_DRAWN_M and drawn.any():
        share = length_m[agree].sum() / length_m[agree | drawn].sum()
        agree = agree if share >= MIN_MOVED_SHARE else drawn
    return np.flatnonzero(agree)


def offset_sigma(offset_m: Float[np.ndarray, " p"], pose_sigma_m: float) -> float:
    """Standard deviation of the median of some offsets, given that of what the poses add to it."""
    squares = np.sum((offset_m - offset_m.mean()) ** 2) + SCATTER_FRAMES * SCATTER_M**2
    scatter = squares / (len(offset_m) + SCATTER_FRAMES - 1.0)
    # A median varies by pi / 2 times what a mean does.
    of_scatter = np.pi / 2 * scatter / len(offset_m)
    return float(np.sqrt(of_scatter + pose_sigma_m**2 + FLOOR_SIGMA_M**2))

"""As built against as planned: what a finished result says of every wall of its plan, and of walls that the
plan lacks: wall patches of no face, in line and near each other."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from planfit.as_built.find_openings import find_openings
from planfit.as_built.lines_of_sight import (
    BIN_M,
    DEPTH_M,
    HEIGHTS_M,
    MIN_FRAMES,
    LinesOfSight,
    Piece,
    are_walls,
    lines_of_sight,
    through_shares,
    top_of,
)
from planfit.as_built.types import AsBuilt, AsBuiltOptions, AsBuiltWall
from planfit.as_built.wall_offsets import (
    MIN_LENGTH_M,
    FaceOffset,
    PlacedWalls,
    find_offsets,
    offset_sigma,
    place_walls,
)
from planfit.errors import OptionError
from planfit.floorplan import Floorplan
from planfit.floorplan.elements import are_glass, element_ids
from planfit.floorplan.faces import connected_groups
from planfit.pipeline.result import RefineResult
from planfit.priors import DOOR_PASSED_LEAST_M, SURFACE_TILT_MOST_DEG
from planfit.segmentation import NO_STOREY


def compare_as_built(result: RefineResult, options: AsBuiltOptions | None = None) -> AsBuilt:
    """A verdict on every wall of the plan, and the walls that it lacks.

    Args:
        result: of `planfit.refine` with a plan that the scan was aligned with.
        options: tolerances.

    Raises:
        OptionError: there was no plan, or the scan was not aligned with it.
    """
    if result.floorplan is None or result.alignment is None:
        found = "none" if result.floorplan is None else "one that the scan was not aligned with"
        raise OptionError(
            f"as built: expected a result on a plan, found {found}; refine the scan with its plan first"
        )
    structure = result.structure
    placed = place_walls(
        structure,
        result.floorplan,
        result.plan_from_cams,
        result.evidence.pose_covariances,
        _stretches(result),
    )
    sight = lines_of_sight(structure, result.plan_from_cams, _floors_m(result))
    return judge_walls(result.floorplan, placed, sight, options or AsBuiltOptions())


def judge_walls(
    floorplan: Floorplan, placed: PlacedWalls, sight: LinesOfSight, options: AsBuiltOptions
) -> AsBuilt:
    """The same of a plan, wall patches and lines of sight."""
    offsets = find_offsets(placed, floorplan, sight)
    through = through_shares(sight, floorplan, HEIGHTS_M, MIN_FRAMES)
    judged = np.flatnonzero(floorplan.lengths >= MIN_LENGTH_M)
    ids, is_glass = element_ids(floorplan), are_glass(floorplan)
    of_plan = [
        _of_plan(floorplan, int(f), offsets, float(through[f]), ids[f], bool(is_glass[f]))
        for f in judged
    ]
    found = find_new_walls(placed, ~_is_explained(placed, offsets), floorplan, sight)
    new = [_new(wall, placed) for wall in found]
    source = floorplan.source
    file_from_plan = None if source.is_picture else source.file_from_plan
    walls = (*of_plan, *new)
    as_built = AsBuilt(walls, options, floorplan.name, file_from_plan, source.elevation_m)
    return replace(as_built, openings=find_openings(as_built, floorplan, placed, sight))


def _is_explained(placed: PlacedWalls, offsets: Mapping[int, FaceOffset]) -> Bool[np.ndarray, " k"]:
    """Whether a patch lies on a face of the plan, as drawn or where it was moved to."""
    explained = np.zeros(len(placed.face_idx), dtype=bool)
    for found in offsets.values():
        explained[found.patch_idx] = True
    return explained


def _of_plan(
    floorplan: Floorplan,
    face: int,
    offsets: Mapping[int, FaceOffset],
    through_share: float,
    element_id: str,
    is_glass: bool,
) -> AsBuiltWall:
    found = offsets.get(face)
    return AsBuiltWall(
        face_idx=face,
        ends=floorplan.ends[face],
        normal=floorplan.normals[face],
        is_oriented=bool(floorplan.is_oriented[face]),
        offset_m=np.nan if found is None else found.offset_m,
        sigma_m=np.nan if found is None else found.sigma_m,
        n_patches=0 if found is None else len(found.patch_idx),
        n_frames=0 if found is None else len(found.frame_idx),
        through_share=through_share,
        element_id=element_id,
        is_glass=is_glass,
    )


def _new(wall: Piece, placed: PlacedWalls) -> AsBuiltWall:
    middles, frames = placed.ends[wall.patch_idx].mean(axis=1), placed.frame_idx[wall.patch_idx]
    normals = np.broadcast_to(wall.normal, middles.shape)
    pose_m = placed.mean_pose_sigma_m(frames, middles, normals)
    return AsBuiltWall(
        face_idx=-1,
        ends=wall.ends,
        normal=wall.normal,
        is_oriented=True,
        offset_m=0.0,
        sigma_m=offset_sigma(middles @ wall.normal, pose_m),
        n_patches=len(wall.patch_idx),
        n_frames=len(np.unique(frames)),
        through_share=0.0,
    )


def _stretches(result: RefineResult) -> Int[np.ndarray, " n"]:
    """Stretch of the walk that each frame is of; frames between two are of the earlier one."""
    first = np.sort([stretch.frames[0] for stretch in result.evidence.stretches])
    frames = np.arange(len(result.plan_from_cams))
    return np.maximum(np.searchsorted(first, frames, side="right") - 1, 0)


def _floors_m(result: RefineResult) -> Float[np.ndarray, " n"]:
    """Height of the floor that each frame stands over, plan frame, m; NaN on stairs."""
    if result.storeys is None or result.structure.storeys is None:
        return result.structure.floor_heights_m
    of_frames = result.structure.storeys
    heights = np.array([storey.floor_m for storey in result.storeys.walked])
    return np.where(of_frames == NO_STOREY, np.nan, heights[of_frames])


SAME_WALL_M = 0.15
"""Patches whose lines are this far apart at most belong to one wall."""
MAX_GAP_M = DOOR_PASSED_LEAST_M.value
"""Between parts of one wall: narrower than any door."""
PARALLEL = np.cos(np.deg2rad(SURFACE_TILT_MOST_DEG.value))
"""Cosine between normals of patches, and of faces, that are in line with a new wall."""
MIN_POINTS = 3
"""Points that show a part of a line, `BIN_M` long."""
MIN_PATCHES, MIN_NEW_LENGTH_M = 3, 0.6
"""Wall patches that a new wall consists of, and its length, m, at least."""


def find_new_walls(
    placed: PlacedWalls, is_open: Bool[np.ndarray, " k"], floorplan: Floorplan, sight: LinesOfSight
) -> list[Piece]:
    """Walls that patches of no face make up, the longest first."""
    of_patches = placed.storeys_of_patches
    above_m = placed.points[:, 2] - sight.floors_m[placed.point_frame_idx]
    pieces = []
    for storey in np.unique(of_patches[is_open]):
        idx = np.flatnonzero(is_open & (of_patches == storey))
        plan = floorplan if floorplan.storeys is None else floorplan.of_storey(int(storey))
        found = []
        for group in _in_line(placed.normals[idx], placed.ends[idx], placed.lengths[idx]):
            if len(group) >= MIN_PATCHES:
                found += _pieces_of(placed, idx[group], plan, above_m)
        if floorplan.storeys is not None:
            found = [replace(piece, storey=int(storey)) for piece in found]
        pieces += found
    walls = [p for p, ok in zip(pieces, are_walls(pieces, sight), strict=True) if ok]
    return sorted(walls, key=lambda w: (-np.linalg.norm(w.ends[1] - w.ends[0]), *w.ends[0]))


def _pieces_of(
    placed: PlacedWalls,
    patch_idx: Int[np.ndarray, " g"],
    floorplan: Floorplan,
    above_m: Float[np.ndarray, " m"],
) -> list[Piece]:
    """Parts of a line of patches that points show, where no face is drawn in line."""
    length = placed.lengths[patch_idx]
    total = (length[:, None] * placed.normals[patch_idx]).sum(axis=0)
    normal = total / np.linalg.norm(total)  # long patches tell a direction best
    # From right to left of who sees it: the free side is on the left of the way.
    along = np.array([normal[1], -normal[0]])
    across = float(np.median(placed.ends[patch_idx].mean(axis=1) @ normal))
    which = placed.points_of(patch_idx)
    of_patch = np.repeat(patch_idx, np.diff(placed.start)[patch_idx])
    at, above_m = placed.points[which, :2] @ along, above_m[which]
    first = at.min()
    bins = ((at - first) / BIN_M).astype(int)
    is_low = above_m < HEIGHTS_M[1]  # what is above may be the lintel of a door
    shown = np.bincount(bins[is_low], minlength=bins.max() + 1) >= MIN_POINTS
    shown &= ~_is_drawn(first + BIN_M * (np.arange(len(shown)) + 0.5), normal, across, floorplan)
    pieces = []
    for low, high in _runs(shown):
        own = (bins >= low) & (bins <= high)
        patches = np.unique(of_patch[own])
        is_long = (high - low + 1) * BIN_M >= MIN_NEW_LENGTH_M
        if is_long and len(patches) >= MIN_PATCHES:
            stands = first + BIN_M * np.array([low, high + 1])
            ends = across * normal + stands[:, None] * along
            behind = _has_wall_behind(ends, normal, floorplan)
            pieces.append(Piece(ends, normal, patches, top_of(above_m[own]), behind))
    return pieces


def _is_drawn(
    at: Float[np.ndarray, " b"], normal: Float[np.ndarray, "2"], across: float, floorplan: Floorplan
) -> Bool[np.ndarray, " b"]:
    """Whether a face is drawn at places along a line that looks the same way."""
    along = np.array([normal[1], -normal[0]])
    off_m = np.abs(floorplan.ends.mean(axis=1) @ normal - across)
    drawn = np.zeros(len(at), dtype=bool)
    for ends in floorplan.ends[_look_alike(normal, floorplan) & (off_m < SAME_WALL_M)] @ along:
        drawn |= (at > ends.min() - BIN_M) & (at < ends.max() + BIN_M)
    return drawn


def _has_wall_behind(
    ends: Float[np.ndarray, "2 2"], normal: Float[np.ndarray, "2"], floorplan: Floorplan
) -> bool:
    """Whether a face that looks the same way is drawn behind the middle of a piece: a cupboard's."""
    behind_m = (ends.mean(axis=0) - floorplan.ends.mean(axis=1)) @ normal
    near = _look_alike(normal, floorplan) & (behind_m > DEPTH_M[0]) & (behind_m < DEPTH_M[1])
    along = np.array([normal[1], -normal[0]])
    at = floorplan.ends[near] @ along - ends.mean(axis=0) @ along
    return bool(
        np.any((at.min(axis=1, initial=np.inf) < 0) & (at.max(axis=1, initial=-np.inf) > 0))
    )


def _look_alike(normal: Float[np.ndarray, "2"], floorplan: Floorplan) -> Bool[np.ndarray, " n"]:
    """Faces that are seen from the side that a normal points to."""
    cosine = floorplan.normals @ normal
    return np.where(floorplan.is_oriented, cosine, np.abs(cosine)) > PARALLEL


def _runs(shown: Bool[np.ndarray, " b"]) -> list[tuple[int, int]]:
    """First and last of runs of parts that are shown, over gaps that a door or a picture may make."""
    idx = np.flatnonzero(shown)
    if len(idx) == 0:
        return []
    breaks = np.flatnonzero(np.diff(idx) * BIN_M > MAX_GAP_M)
    return list(
        zip(idx[np.r_[0, breaks + 1]].tolist(), idx[np.r_[breaks, -1]].tolist(), strict=True)
    )


def _in_line(
    normals: Float[np.ndarray, "k 2"],
    ends: Float[np.ndarray, "k 2 2"],
    length: Float[np.ndarray, " k"],
) -> list[Int[np.ndarray, " g"]]:
    """Groups of patches that are in line, look to one side, and are near."""
    middle = ends.mean(axis=1)
    near = cKDTree(middle).query_pairs(float(length.max()) + MAX_GAP_M, output_type="ndarray")
    i, j = near.T
    between = middle[j] - middle[i]
    along = np.column_stack([-normals[:, 1], normals[:, 0]])
    joined = (
        (np.sum(normals[i] * normals[j], axis=1) > PARALLEL)
        & (np.abs(np.sum(between * normals[i], axis=1)) < SAME_WALL_M)
        & (np.abs(np.sum(between * normals[j], axis=1)) < SAME_WALL_M)
        & (np.abs(np.sum(between * along[i], axis=1)) < (length[i] + length[j]) / 2 + MAX_GAP_M)
    )
    group = connected_groups(i[joined], j[joined], len(ends))
    return [np.flatnonzero(group == k) for k in range(group.max() + 1)]

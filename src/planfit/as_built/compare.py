"""As built against as planned: what a finished result says of every wall of its plan."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.as_built.find_openings import find_openings
from planfit.as_built.lines_of_sight import (
    HEIGHTS_M,
    MIN_FRAMES,
    LinesOfSight,
    Piece,
    lines_of_sight,
    through_shares,
)
from planfit.as_built.new_walls import find_new_walls
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
from planfit.pipeline.result import RefineResult
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
    """The same of a plan, wall patches and lines of sight.

    Args:
        floorplan: as drawn, m.
        placed: from `place_walls`.
        sight: from `lines_of_sight`.
        options: tolerances.
    """
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

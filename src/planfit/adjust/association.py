"""Correspondences of scan and plan: the face of each wall patch and column, the height of each ceiling."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.adjust.mutual_walls import mutually_nearest
from planfit.floorplan import Floorplan
from planfit.floorplan.nearest_faces import END_MARGIN_M, BesideRule, nearest_of_segments
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.priors import PATCH_TURN_MOST_DEG
from planfit.runtime import short_repr
from planfit.segmentation import Structure, WallPatches

MAX_ANGLE_DEG = PATCH_TURN_MOST_DEG.value
"""Largest angle between a patch and its face."""
MIN_OVERLAP = 0.5
"""Share of a patch that must lie beside its face."""


@dataclass(frozen=True)
class AssociationOptions:
    """When a wall patch may belong to a face."""

    oriented: bool = True
    """Match a patch only to faces that look to the side it was seen from, where the plan knows that side.
    The paper does not ask."""
    mutual: bool = False
    """Match whole walls of the scan to planes of the plan, and only where each is nearest to the other, as in
    the paper; see `planfit.adjust.mutual_walls`. Else each patch goes to the face nearest to it."""


@dataclass(frozen=True)
class PatchesOnPlan:
    """Wall patches at poses on a plan, and which faces they may belong to."""

    patches: WallPatches
    floorplan: Floorplan
    plan_from_cams: Poses
    options: AssociationOptions
    storeys: Int[np.ndarray, " n"] | None = None
    """That each frame stands on, where the plan has storeys."""

    def rule(
        self, max_distance_m: float, which: slice | Int[np.ndarray, " q"] = slice(None)
    ) -> BesideRule:
        """When each patch, or each of some, lies beside a face, within a distance (m)."""
        own = None if self.storeys is None else self.storeys[self.patches.frame_idx[which]]
        oriented = self.options.oriented
        return BesideRule(max_distance_m, MAX_ANGLE_DEG, MIN_OVERLAP, END_MARGIN_M, oriented, own)


@dataclass(frozen=True)
class Association:
    """The face of each patch."""

    face_idx: Int[np.ndarray, " k"]
    """-1 where there is none."""
    distance_m: Float[np.ndarray, " k"]
    """Signed, along the face's normal; NaN where there is no face."""

    __repr__ = short_repr

    def __getitem__(self, which: Bool[np.ndarray, " k"]) -> "Association":
        """Those of some patches."""
        return Association(self.face_idx[which], self.distance_m[which])

    def only(self, which: Bool[np.ndarray, " k"]) -> "Association":
        """That of some patches; the others have no face."""
        return Association(
            np.where(which, self.face_idx, -1), np.where(which, self.distance_m, np.nan)
        )

    @property
    def n_associated(self) -> int:
        """Patches that have a face."""
        return int(np.sum(self.face_idx >= 0))


@dataclass(frozen=True)
class PlanCorrespondences:
    """What the poses are held to outside the scan."""

    floorplan: Floorplan
    walls: Association
    columns: Association
    ceiling_heights_m: Float[np.ndarray, " n"]
    """Height of the ceiling that each frame sees; NaN: none."""
    max_distance_m: float
    """Beyond this, wall does not belong to a face."""
    widths: Float[np.ndarray, " k"] | None = None
    """Factor on the scale of each wall patch's loss; None: as it stands."""
    moved_m: Float[np.ndarray, " f"] | None = None
    """How far faces that were found to stand elsewhere stand off where they are drawn, along their normals;
    NaN for faces as drawn. None: all are as drawn."""

    __repr__ = short_repr

    @property
    def is_moved(self) -> Bool[np.ndarray, " k"]:
        """Whether a wall patch lies on a face that stands elsewhere than drawn."""
        face_idx = self.walls.face_idx
        if self.moved_m is None:
            return np.zeros(len(face_idx), dtype=bool)
        return (face_idx >= 0) & np.isfinite(self.moved_m[face_idx])

    @property
    def moved_faces(self) -> Int[np.ndarray, " m"]:
        """Faces that stand elsewhere than drawn and are seen."""
        return np.unique(self.walls.face_idx[self.is_moved])

    @property
    def walls_as_drawn(self) -> Association:
        """Patches on faces that stand as drawn; the others have none."""
        return self.walls.only(~self.is_moved)

    def is_same(self, other: "PlanCorrespondences") -> bool:
        """Whether both hold every patch to the same face."""
        return all(
            np.array_equal(mine.face_idx, theirs.face_idx)
            for mine, theirs in ((self.walls, other.walls), (self.columns, other.columns))
        )


def associate_with_plan(
    structure: Structure,
    floorplan: Floorplan,
    plan_from_cams: Poses,
    max_distance_m: float,
    options: AssociationOptions,
    ceiling_heights_m: Float[np.ndarray, " n"],
    moved_m: Float[np.ndarray, " f"] | None = None,
) -> PlanCorrespondences:
    """Faces of walls and columns within a distance (m); the heights of ceilings are given.

    Faces with a finite `moved_m` are looked for where they stand; distances are from where they are drawn.
    """
    built, off = floorplan, np.zeros(len(floorplan))
    if moved_m is not None:
        off = np.nan_to_num(moved_m)
        built = displaced(floorplan, off)
    walls, columns = (
        associate(patches, built, plan_from_cams, max_distance_m, options, structure.storeys)
        for patches in (structure.walls, structure.columns)
    )
    walls = Association(walls.face_idx, walls.distance_m + off[walls.face_idx])
    return PlanCorrespondences(
        floorplan, walls, columns, ceiling_heights_m, max_distance_m, moved_m=moved_m
    )


def displaced(floorplan: Floorplan, offsets_m: Float[np.ndarray, " f"]) -> Floorplan:
    """The plan with each face put off along its normal."""
    return replace(
        floorplan, ends=floorplan.ends + (offsets_m[:, None] * floorplan.normals)[:, None]
    )


def associate(
    patches: WallPatches,
    floorplan: Floorplan,
    plan_from_cams: Poses,
    max_distance_m: float,
    options: AssociationOptions,
    storeys: Int[np.ndarray, " n"] | None = None,
) -> Association:
    """The face of each patch that looks the same way and lies beside it, within a distance (m).

    The nearest, or, where the options ask for it, that of the plane mutually nearest to the patch's wall. A
    face that looks into a room is matched only by wall seen from inside that room: normals must agree in
    sign. Faces whose free side is unknown are matched from either side. Where the plan has
    storeys, only faces of the storey that the patch's frame stands on (`storeys`) are matched.

    Raises:
        OptionError: the plan has storeys and `storeys` is None.
    """
    normals, ends = wall_patches_in_plan(patches, plan_from_cams)
    seen = PatchesOnPlan(patches, floorplan, plan_from_cams, options, storeys)
    rule = seen.rule(max_distance_m)
    if options.mutual:
        n_points = np.diff(patches.start)
        distance_m, face_idx = mutually_nearest(ends, normals, n_points, floorplan, rule)
    else:
        distance_m, face_idx = nearest_of_segments(ends, normals, floorplan, rule)
    found = Association(face_idx, distance_m)
    if floorplan.is_unused is None:
        return found
    # What lies at a face that is not used belongs to no other one either.
    return found.only((face_idx < 0) | ~floorplan.is_unused[face_idx])


def wall_patches_in_plan(
    patches: WallPatches, plan_from_cams: Poses
) -> tuple[Float[np.ndarray, "k 2"], Float[np.ndarray, "k 2 2"]]:
    """Unit normals and ends (m) of upright patches, plan frame, seen from above."""
    poses = plan_from_cams[patches.frame_idx]
    normals = np.einsum("kab,kb->ka", poses[:, :2, :3], patches.normals_cam)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    ends = se3.transform(poses, patches.ends_cam)[..., :2]
    return normals, ends

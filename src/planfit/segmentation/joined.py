"""What was found in several scans, as found in all of their frames one after the other."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from planfit.runtime import concatenated
from planfit.segmentation.types import LevelPoints, Structure, WallPatches


def join_structures(structures: Sequence[Structure], floor_height_m: float) -> Structure:
    """The structure of the frames of several scans, each of which stands on one storey.

    Args:
        structures: of the scans, one or more, in their order.
        floor_height_m: of the joined world, turned level.
    """
    offsets = np.cumsum([0, *(len(s.floor.start) - 1 for s in structures)])[:-1]
    # Of labels from several back ends, what is expected of the less exact ones holds for all.
    back_ends = [s.back_end for s in structures]
    return Structure(
        floor=_joined_levels([s.floor for s in structures]),
        floor_heights_m=np.concatenate([s.floor_heights_m for s in structures]),
        walls=_joined_patches([s.walls for s in structures], offsets),
        unassigned_points_cam=concatenated([s.unassigned_points_cam for s in structures]),
        unassigned_frame_idx=np.concatenate(
            [s.unassigned_frame_idx + k for s, k in zip(structures, offsets, strict=True)]
        ),
        ceiling=_joined_levels([s.ceiling for s in structures]),
        columns=_joined_patches([s.columns for s in structures], offsets),
        back_end=next((name for name in back_ends if name != "masks"), "masks"),
        floor_height_m=floor_height_m,
        floor_pieces=tuple(sorted({piece for s in structures for piece in s.floor_pieces})),
        drifted_floors_m=tuple(sorted({h for s in structures for h in s.drifted_floors_m})),
    )


def _joined_levels(levels: Sequence[LevelPoints]) -> LevelPoints:
    sizes = np.concatenate([np.diff(level.start) for level in levels])
    points = concatenated([level.points_cam for level in levels])
    return LevelPoints(points, np.cumsum([0, *sizes]))


def _joined_patches(patches: Sequence[WallPatches], offsets: Int[np.ndarray, " s"]) -> WallPatches:
    sizes = np.concatenate([np.diff(each.start) for each in patches])
    frames = [each.frame_idx + k for each, k in zip(patches, offsets, strict=True)]
    return WallPatches(
        points_cam=concatenated([each.points_cam for each in patches]),
        start=np.cumsum([0, *sizes]),
        frame_idx=np.concatenate(frames),
        normals_cam=np.concatenate([each.normals_cam for each in patches]),
        ends_cam=np.concatenate([each.ends_cam for each in patches]),
    )

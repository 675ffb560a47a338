"""What segmentation finds in a scan: points of level surfaces, and flat upright patches."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.runtime import short_repr

NO_STOREY = -1
"""Storey of frames between two, on stairs."""


@dataclass(frozen=True)
class LevelPoints:
    """Points on level surfaces (floor, ceiling), in camera frames, sorted by frame."""

    points_cam: Float[np.ndarray, "m 3"]
    """m; of long scans in a file, and read-only (`planfit.runtime.mapped`), as all points here are."""
    start: Int[np.ndarray, " n_plus_1"]
    """Points of frame i are start[i]:start[i + 1]."""

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.points_cam)

    @property
    def frame_idx(self) -> Int[np.ndarray, " m"]:
        """Frame of each point."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    def of_frames(self, frames: Bool[np.ndarray, " n"]) -> "LevelPoints":
        """The points of some frames alone."""
        sizes = np.diff(self.start)
        keep = np.repeat(frames, sizes)
        return LevelPoints(self.points_cam[keep], np.cumsum([0, *np.where(frames, sizes, 0)]))

    def numbered(self, frame_idx: Int[np.ndarray, " k"], n_frames: int) -> "LevelPoints":
        """The same of a scan of `n_frames`, whose frames `frame_idx` these are: the others have no points."""
        sizes = np.zeros(n_frames, dtype=int)
        sizes[frame_idx] = np.diff(self.start)
        return replace(self, start=np.cumsum([0, *sizes]))


@dataclass(frozen=True)
class WallPatches:
    """Flat upright patches (of walls, of columns), in camera frames, sorted by frame."""

    points_cam: Float[np.ndarray, "m 3"]
    """m."""
    start: Int[np.ndarray, " k_plus_1"]
    """Points of patch j are start[j]:start[j + 1]."""
    frame_idx: Int[np.ndarray, " k"]
    """Frame of each patch."""
    normals_cam: Float[np.ndarray, "k 3"]
    """Unit, level, towards the camera."""
    ends_cam: Float[np.ndarray, "k 2 3"]
    """m, both ends of the patch at its mean height."""

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.frame_idx)

    @property
    def point_frame_idx(self) -> Int[np.ndarray, " m"]:
        """Frame of each point."""
        return np.repeat(self.frame_idx, np.diff(self.start))

    def numbered(self, frame_idx: Int[np.ndarray, " f"]) -> "WallPatches":
        """The same of a scan whose frames `frame_idx` these are."""
        return replace(self, frame_idx=frame_idx[self.frame_idx])

    def of(self, keep: Bool[np.ndarray, " k"]) -> "WallPatches":
        """Some of the patches."""
        sizes = np.diff(self.start)
        return WallPatches(
            self.points_cam[np.repeat(keep, sizes)],
            np.cumsum([0, *sizes[keep]]),
            self.frame_idx[keep],
            self.normals_cam[keep],
            self.ends_cam[keep],
        )


def no_wall_patches() -> WallPatches:
    """Patches of something that was not seen."""
    nowhere = np.zeros((0, 3))
    none = np.zeros(0, dtype=int)
    return WallPatches(nowhere, np.zeros(1, dtype=int), none, nowhere, np.zeros((0, 2, 3)))


def no_level_points(n_frames: int) -> LevelPoints:
    """Points of a level surface that was not seen."""
    return LevelPoints(np.zeros((0, 3)), np.zeros(n_frames + 1, dtype=int))


@dataclass(frozen=True)
class Structure:
    """Floor, walls, ceiling and columns as seen from each frame."""

    floor: LevelPoints
    """The paper's P_F."""
    floor_heights_m: Float[np.ndarray, " n"]
    """Height of the storey that a frame stands on, above the main one's floor; 0 for all where there is one
    storey. NaN between storeys, on stairs: such floor points belong to no plane."""
    walls: WallPatches
    """With the unassigned points, the paper's P_W."""
    unassigned_points_cam: Float[np.ndarray, "u 3"]
    """m, wall points that lie on no flat patch."""
    unassigned_frame_idx: Int[np.ndarray, " u"]
    """Frame of each."""
    ceiling: LevelPoints
    columns: WallPatches
    back_end: str
    """Which back end labelled the pixels: masks, geometry or learned."""
    floor_height_m: float
    """The floor's height in the world turned level, as recorded. Where none was seen: supposed to lie as far
    below the cameras as floors mostly do, or NaN where poses were recorded in the plan's axes."""
    storeys: Int[np.ndarray, " n"] | None = None
    """Storey that each frame stands on, as faces of joined plans are numbered; `NO_STOREY` on stairs. None:
    one plan for all frames."""
    drifted_floors_m: tuple[float, ...] = ()
    """Heights above the main floor at which poses as recorded saw that same floor, having drifted."""
    floor_pieces: tuple[tuple[float, float], ...] = ()
    """Pieces of a floor that is not one level plane, the main one first: height (m) above that where they are
    walked, and slope as a share. Floor points are as if all were level at its height."""

    __repr__ = short_repr

    @property
    def has_floor(self) -> bool:
        """Whether any floor was seen."""
        return len(self.floor) > 0

    @property
    def has_walls(self) -> bool:
        """Whether any flat patch of wall was seen."""
        return len(self.walls) > 0

    def with_walls_of(self, frames: Bool[np.ndarray, " n"]) -> "Structure":
        """The same with the walls and columns of some frames alone."""
        keep = frames[self.unassigned_frame_idx]
        return replace(
            self,
            walls=self.walls.of(frames[self.walls.frame_idx]),
            unassigned_points_cam=self.unassigned_points_cam[keep],
            unassigned_frame_idx=self.unassigned_frame_idx[keep],
            columns=self.columns.of(frames[self.columns.frame_idx]),
        )

    def of_frames(self, frames: Bool[np.ndarray, " n"]) -> "Structure":
        """The same as seen by some frames alone."""
        return replace(
            self.with_walls_of(frames),
            floor=self.floor.of_frames(frames),
            ceiling=self.ceiling.of_frames(frames),
        )

    def numbered(self, frame_idx: Int[np.ndarray, " k"], n_frames: int) -> "Structure":
        """The same of a scan of `n_frames`, whose frames `frame_idx` these are: the others show nothing.

        They stand on the storey of the last of these before them.
        """
        before = np.searchsorted(frame_idx, np.arange(n_frames), side="right") - 1
        before = before.clip(0)
        return replace(
            self,
            floor=self.floor.numbered(frame_idx, n_frames),
            floor_heights_m=self.floor_heights_m[before],
            walls=self.walls.numbered(frame_idx),
            unassigned_frame_idx=frame_idx.astype(np.int32)[self.unassigned_frame_idx],
            ceiling=self.ceiling.numbered(frame_idx, n_frames),
            columns=self.columns.numbered(frame_idx),
            storeys=None if self.storeys is None else self.storeys[before],
        )

    @property
    def n_wall_points(self) -> int:
        """Wall points, on flat patches and unassigned."""
        return len(self.walls.points_cam) + len(self.unassigned_points_cam)


def no_structure(n_frames: int) -> Structure:
    """A scan in which nothing was looked for, or nothing seen."""
    none = no_level_points(n_frames)
    return Structure(
        floor=none,
        floor_heights_m=np.zeros(n_frames),
        walls=no_wall_patches(),
        unassigned_points_cam=np.zeros((0, 3)),
        unassigned_frame_idx=np.zeros(0, dtype=int),
        ceiling=none,
        columns=no_wall_patches(),
        back_end="none",
        floor_height_m=float("nan"),
    )

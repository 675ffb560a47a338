"""Files of a scan seen through something: damage that is stood, and a choice of frames."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from planfit.errors import ScanError
from planfit.geometry.camera import Camera
from planfit.scan.corrupt_frames import CorruptFrames
from planfit.scan.types import Scan, ScanFiles


def with_tolerance(scan: Scan) -> Scan:
    """The scan, a hundredth of whose frames may turn out to be damaged when they are read."""
    damage = CorruptFrames(len(scan))
    return replace(scan, files=TolerantFiles(scan.files, scan.cameras, damage), damage=damage)


def select_frames(scan: Scan, frame_idx: np.ndarray, world_from_cams: np.ndarray) -> Scan:
    """Some frames (k,) of a scan, in this order, with poses (k, 4, 4) of their own."""
    return replace(
        scan,
        frame_ids=tuple(scan.frame_ids[i] for i in frame_idx),
        timestamps=scan.timestamps[frame_idx],
        cameras=tuple(scan.cameras[i] for i in frame_idx),
        world_from_cams=world_from_cams,
        files=ChosenFiles(scan.files, frame_idx),
    )


@dataclass(frozen=True)
class ChosenFiles:
    """Some frames of a scan's files."""

    files: ScanFiles
    chosen: np.ndarray  # (k,) int

    def color(self, frame_idx: int) -> np.ndarray:
        """Colour image (h, w, 3) uint8, RGB."""
        return self.files.color(int(self.chosen[frame_idx]))

    def depth(self, frame_idx: int) -> np.ndarray:
        """Depth (h, w) float32 m, NaN where there is no reading."""
        return self.files.depth(int(self.chosen[frame_idx]))

    def labels(self, frame_idx: int) -> np.ndarray:
        """Labels (h, w) uint8."""
        return self.files.labels(int(self.chosen[frame_idx]))

    def write_poses(
        self, directory: Path, world_from_cams: np.ndarray, frame_idx: np.ndarray | None = None
    ) -> None:
        """As the format has it."""
        frames = self.chosen if frame_idx is None else self.chosen[frame_idx]
        self.files.write_poses(directory, world_from_cams, frames)


@dataclass(frozen=True)
class TolerantFiles:
    """Images of which a few may be damaged: such a frame is black, without depth and without labels.

    It then has no keypoints and no points, takes no part, and its pose moves with its neighbours.
    """

    files: ScanFiles
    cameras: tuple[Camera, ...]
    damage: CorruptFrames

    def color(self, frame_idx: int) -> np.ndarray:
        """Colour image (h, w, 3) uint8, RGB."""
        try:
            return self.files.color(frame_idx)
        except ScanError as error:
            self.damage.add(frame_idx, error)
        return np.zeros((*self._shape(frame_idx), 3), dtype=np.uint8)

    def depth(self, frame_idx: int) -> np.ndarray:
        """Depth (h, w) float32 m, NaN where there is no reading."""
        try:
            return self.files.depth(frame_idx)
        except ScanError as error:
            self.damage.add(frame_idx, error)
        return np.full(self._shape(frame_idx), np.nan, dtype=np.float32)

    def labels(self, frame_idx: int) -> np.ndarray:
        """Labels (h, w) uint8."""
        try:
            return self.files.labels(frame_idx)
        except ScanError as error:
            self.damage.add(frame_idx, error)
        return np.zeros(self._shape(frame_idx), dtype=np.uint8)

    def write_poses(
        self, directory: Path, world_from_cams: np.ndarray, frame_idx: np.ndarray | None = None
    ) -> None:
        """As the format has it."""
        self.files.write_poses(directory, world_from_cams, frame_idx)

    def _shape(self, frame_idx: int) -> tuple[int, int]:
        return self.cameras[frame_idx].height, self.cameras[frame_idx].width

"""How a scan is read."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from planfit.errors import OptionError, require, require_choice, require_positive
from planfit.runtime import Changeable, require_kinds


@dataclass(frozen=True)
class ScanOptions(Changeable):
    """Choices of the readers; most formats need none."""

    format: str = "auto"
    """Name of the format (docs/formats.md); `auto` tells it by what lies in the folder."""
    use_masks: bool = True
    """Whether floor and wall masks that lie beside the images are used."""
    poses: Path | None = None
    """Poses of another tracker (TUM, KITTI, EuRoC or Open3D log), of the colour camera, that take the place
    of the scan's own; `planfit evaluate` judges them against the scan's own."""
    calibration: Path | None = None
    """Calibration of the depth camera, as `planfit calibrate` wrote it from another scan of the same device;
    what a run finds comes on top."""
    depth_scale: float | None = None
    """Metres of one unit of the stored depth; overrules what the format says."""
    max_time_gap_s: float = 0.02
    """Colour, depth and poses with times of their own belong together up to this difference."""
    min_confidence: int = 1
    """Depth of less confidence is left out, where the format has confidence: 0 low, 1 medium, 2 high."""
    image_size_px: int | None = None
    """Longer side of the images worked on; by default colour is shrunk to VGA or to the size of the depth,
    whichever is larger."""
    color_topic: str = ""
    """Topic of the colour images in a bag; by default the one whose name and type fit best."""
    depth_topic: str = ""
    """Topic of the depth images in a bag; by default the one registered to colour, if there is one."""
    info_topic: str = ""
    """Topic of the colour camera's intrinsics in a bag."""
    pose_topic: str = ""
    """Topic of the poses in a bag; by default tf, else poses or odometry."""
    instant_s: float = 0.5
    """A laser scan is cut into frames of this length."""
    cloud_up: Literal["auto", "x", "y", "z", "-x", "-y", "-z"] = "auto"
    """Axis of a laser scan's cloud that is up; `auto`: z, unless the path is level along another."""
    cloud_time_offset_s: float | None = None
    """Seconds to add to the times of a laser scan's cloud for those of its trajectory; by default the one
    usual relation that fits (same clock, GPS week, GPS seconds, Unix time)."""

    def __post_init__(self) -> None:
        require_kinds(self)
        require_positive(self, "max_time_gap_s", "instant_s")
        require_choice(self, "cloud_up", "auto", "x", "y", "z", "-x", "-y", "-z")
        for name in ("depth_scale", "image_size_px"):
            if getattr(self, name) is not None:
                require_positive(self, name)
        require(
            self.min_confidence in (0, 1, 2),
            f"ScanOptions.min_confidence: expected 0, 1 or 2, found {self.min_confidence}",
        )
        if self.image_size_px is not None and self.image_size_px < 32:
            raise OptionError(
                f"ScanOptions.image_size_px: expected 32 or more, found {self.image_size_px}"
            )

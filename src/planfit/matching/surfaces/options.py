"""When frames are matched by their surfaces, and when such a match is believed."""

from dataclasses import dataclass
from typing import Literal

from planfit.errors import require_choice, require_positive


@dataclass(frozen=True)
class SurfaceOptions:
    """When frames are matched by the surfaces that their depth shows, and when that is believed."""

    use: Literal["without_colour", "few", "always", "never"] = "few"
    """`few`: frames with few matched keypoints, as at white walls, and those of steps that no pair spans;
    `without_colour`: the same, of scans without colour alone; `always`: all frames; `never`: none."""
    max_depth_m: float = 8.0
    """Surfaces further away are left out."""

    def __post_init__(self) -> None:
        require_choice(self, "use", "without_colour", "few", "always", "never")
        require_positive(self, "max_depth_m")

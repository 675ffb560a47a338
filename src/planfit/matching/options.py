"""Everything that can be chosen about matching."""

from dataclasses import dataclass, field
from typing import Literal

from planfit.errors import require, require_choice, require_positive
from planfit.matching.detect import KeypointOptions
from planfit.matching.matchers import MatcherOptions
from planfit.matching.pairs import PairOptions


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


@dataclass(frozen=True)
class MatchingOptions:
    """How matches between frames are found and verified."""

    keypoints: KeypointOptions = field(default_factory=KeypointOptions)
    """Which keypoints are kept."""
    matcher: MatcherOptions = field(default_factory=MatcherOptions)
    """How keypoints of two frames are matched."""
    pairs: PairOptions = field(default_factory=PairOptions)
    """Which frames are tried with which."""
    surfaces: SurfaceOptions = field(default_factory=SurfaceOptions)
    """Matches by geometry, for frames with few matched keypoints."""
    colmap: str = ""
    """Path of a COLMAP database, or of the folder of a sparse model, whose matches take the place of our
    own keypoints and pairs. They are verified all the same."""
    device: str = "cpu"
    """Where learned keypoints and matchers run: `cpu`, `cuda`, `cuda:1` and so on; `auto` takes a GPU where
    there is one."""

    def __post_init__(self) -> None:
        require(
            self.matcher.kind == "nearest" or self.keypoints.kind == "superpoint",
            f"MatchingOptions.matcher.kind: {self.matcher.kind} matches superpoint keypoints only, "
            f"found keypoints.kind {self.keypoints.kind}; set it to superpoint",
        )

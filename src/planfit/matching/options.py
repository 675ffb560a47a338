"""Everything that can be chosen about matching."""

from dataclasses import dataclass, field

from planfit.errors import require
from planfit.matching.detect import KeypointOptions
from planfit.matching.matchers import MatcherOptions
from planfit.matching.pairs import PairOptions
from planfit.matching.surfaces.options import SurfaceOptions


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

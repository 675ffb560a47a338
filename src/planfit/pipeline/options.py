"""Everything that can be chosen about a run."""

from collections.abc import Callable
from dataclasses import dataclass, field

from planfit.adjust import AdjustOptions, paper_options
from planfit.adjust.calibration import CalibrationOptions
from planfit.alignment import AlignOptions
from planfit.errors import OptionError, require_positive
from planfit.matching import MatchingOptions, SurfaceOptions
from planfit.runtime import Changeable, require_kinds
from planfit.scan.odometry import OdometryOptions
from planfit.segmentation import SegmentationOptions
from planfit.tracking import KeyframeOptions, TrackingOptions

_PAPER_MIN_FRAMES = 30_000
"""The paper solves for all frames; above so many that takes more memory than a laptop has."""


@dataclass(frozen=True)
class RefineOptions(Changeable):
    """Everything that can be chosen about a run."""

    poses_convention: str = "recorded"
    """What the recorded poses mean: `recorded`, as they are; `auto`, what explains the motions between
    neighbouring images; or the name of a convention (`planfit help tracking`)."""
    keyframes: KeyframeOptions = field(default_factory=KeyframeOptions)
    """Which frames are looked at and solved for; the others follow."""
    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    """When the recorded motion is not believed."""
    odometry: OdometryOptions = field(default_factory=OdometryOptions)
    """How far the recorded motion may be off."""
    segmentation: SegmentationOptions = field(default_factory=SegmentationOptions)
    """Gravity, floor and walls in the scan."""
    matching: MatchingOptions = field(default_factory=MatchingOptions)
    """Keypoint matches between frames."""
    align: AlignOptions = field(default_factory=AlignOptions)
    """The scan's alignment with the plan."""
    adjust: AdjustOptions = field(default_factory=AdjustOptions)
    """The bundle adjustment."""
    calibration: CalibrationOptions = field(default_factory=CalibrationOptions)
    """What the sensor may be off, and when that is believed."""
    tolerance_m: float = 0.15
    """Position error that is good enough. A result is refined where 95 % of the frames are expected to be
    within it."""
    seed: int = 0
    """Seed of what is kept out of the solves that judge."""

    def __post_init__(self) -> None:
        require_kinds(self)
        require_positive(self, "tolerance_m")


def _paper_preset() -> RefineOptions:
    """The paper's alignment and adjustment: its cost, its order, its weights; recorded poses are believed.

    Solved by Levenberg-Marquardt, which reaches lower costs of the same function in a small share of
    the time; `adjust.method = "sgd"` takes the paper's gradient descent.
    """
    return RefineOptions(
        keyframes=KeyframeOptions(min_frames=_PAPER_MIN_FRAMES),
        tracking=TrackingOptions(is_judged=False),
        # The paper matches keypoints alone.
        matching=MatchingOptions(surfaces=SurfaceOptions(use="never")),
        align=AlignOptions(method="paper"),
        adjust=paper_options(),
    )


PRESETS: dict[str, Callable[[], RefineOptions]] = {
    "default": RefineOptions,
    "paper": _paper_preset,
}


def preset(name: str) -> RefineOptions:
    """Options of a preset.

    Raises:
        OptionError: there is none of this name.
    """
    if name not in PRESETS:
        raise OptionError(f"preset: expected {' or '.join(PRESETS)}, found {name!r}")
    return PRESETS[name]()

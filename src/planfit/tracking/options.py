"""Everything that can be chosen about judging the recorded poses."""

from dataclasses import dataclass

from planfit.errors import require_positive


@dataclass(frozen=True)
class TrackingOptions:
    """When recorded motion is not believed, and what takes its place."""

    is_judged: bool = True
    """Whether the recorded motion is compared with motions that neighbouring images and their depth give."""
    mend: bool = True
    """Whether steps that are contradicted are corrected; otherwise they stay as recorded."""
    clock_is_sought: bool = True
    """Whether a constant time between images and poses is sought, and poses are read at the images' times."""
    clock_max_s: float = 0.2
    """Largest time between an image and its pose that is sought, s; at least two and a half intervals
    between frames."""

    def __post_init__(self) -> None:
        require_positive(self, "clock_max_s")

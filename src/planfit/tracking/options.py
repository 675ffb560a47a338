"""Everything that can be chosen about judging the recorded poses."""

from dataclasses import dataclass

from planfit.errors import require_positive


@dataclass(frozen=True)
class TrackingOptions:
    """When recorded motion is not believed, and what takes its place."""

    is_judged: bool = True
    """Whether the recorded motion is compared with motions that neighbouring images and their depth give."""
    adapt_sigmas: bool = True
    """Whether the sigmas of all steps grow where the tracker errs more than `odometry` says."""
    fuse_above: float = 2.0
    """Factor of its sigmas from which a tracker's poses are fused with the measured motions first."""
    mend: bool = True
    """Whether steps that are contradicted are corrected; otherwise they stay as recorded."""
    max_sigmas: float = 6.0
    """Measured motions that depart by more (norm of six numbers) contradict the recorded ones."""
    min_jump_m: float = 0.5
    """A tracker has jumped where it went astray by at least this; robust losses take care of less."""
    min_jump_deg: float = 8.0
    """Or where it turned astray by at least this."""
    min_matches_alone: int = 50
    """A measured motion that no other one confirms needs as many matches to correct a step."""

    clock_is_sought: bool = True
    """Whether a constant time between images and poses is sought, and poses are read at the images' times."""
    clock_max_s: float = 0.2
    """Largest time between an image and its pose that is sought, s; at least `clock_max_frames`."""
    clock_max_frames: float = 2.5
    """The same in intervals between frames, for scans with few frames a second or without times."""
    clock_min_sigmas: float = 3.0
    """A time between images and poses is believed from so many standard deviations on."""

    def __post_init__(self) -> None:
        require_positive(
            self, "fuse_above", "max_sigmas", "min_jump_m", "min_jump_deg", "min_matches_alone"
        )
        require_positive(self, "clock_max_s", "clock_max_frames", "clock_min_sigmas")

"""Everything that can be chosen about the bundle adjustment."""

from dataclasses import dataclass, field

from planfit.adjust.association import AssociationOptions
from planfit.adjust.solver import SolverOptions
from planfit.adjust.terms.floor import FloorOptions
from planfit.adjust.terms.points import PointOptions
from planfit.adjust.terms.trajectory import TrajectoryOptions
from planfit.adjust.terms.walls import WallOptions
from planfit.errors import OptionError, require_positive


@dataclass(frozen=True)
class KeyframeOptions:
    """Which frames are solved for; see `planfit.adjust.keyframes`."""

    min_frames: int = 30_000
    """Scans of fewer frames are solved with all frames as unknowns."""
    max_step_m: float = 0.3
    """A frame this far along the path from the last keyframe is the next one."""
    max_turn_deg: float = 10.0
    """So is a frame that has turned by this much, added up along the path."""

    def __post_init__(self) -> None:
        require_positive(self, "max_step_m", "max_turn_deg")


@dataclass(frozen=True)
class AdjustOptions:
    """Terms, solver and schedule of the bundle adjustment."""

    points: PointOptions = field(default_factory=PointOptions)
    """3D point error."""
    floor: FloorOptions = field(default_factory=FloorOptions)
    """Floor term."""
    walls: WallOptions = field(default_factory=WallOptions)
    """Walls term."""
    trajectory: TrajectoryOptions = field(default_factory=TrajectoryOptions)
    """Trajectory prior."""
    association: AssociationOptions = field(default_factory=AssociationOptions)
    """Which face a piece of wall may belong to."""
    keyframes: KeyframeOptions = field(default_factory=KeyframeOptions)
    """Which frames are solved for."""
    solver: SolverOptions = field(default_factory=SolverOptions)
    """When a solve ends."""
    graduation: tuple[float, ...] = (4.0, 2.0, 1.0)
    """Factors on the scale of the matches' loss while loops close, one after the other: wide at first,
    so that matches which are far apart only because of drift still pull, then as it stands."""
    wall_distances_m: tuple[float, ...] = (1.2, 0.8, 0.6, 0.45, 0.35)
    """Association distances, one after the other."""
    max_alternations: int = 5
    """Rounds of association and solve at one distance; ends earlier when no association changes."""

    def __post_init__(self) -> None:
        require_positive(self, "max_alternations")
        if not self.graduation or min(self.graduation) <= 0:
            raise OptionError(f"graduation: expected factors above 0, found {self.graduation}")
        if not self.wall_distances_m or min(self.wall_distances_m) <= 0:
            raise OptionError(
                f"wall_distances_m: expected positive distances, found {self.wall_distances_m}"
            )

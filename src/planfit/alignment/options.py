"""Everything that can be chosen about aligning a scan with its plan."""

from dataclasses import dataclass
from typing import Literal

from planfit.alignment.control_points import parse_control_point, parse_start
from planfit.errors import OptionError, require_choice, require_positive, require_share

RecordedAxes = Literal["auto", "plan", "own"]
"""Whose axes the recorded poses are in."""


@dataclass(frozen=True)
class AlignOptions:
    """How the plan is searched for the scan."""

    method: Literal["search", "paper"] = "search"
    """`search` tries every alignment; `paper` matches extents and centres, which needs a scan of the whole
    plan and nothing else."""
    candidate: int = 1
    """Which of the alignments found is taken, 1 the best; for those who know better than the score."""
    metres_per_unit: float = 0.0
    """Length of one unit of a plan without unit, where it is known; 0: it is searched."""
    scale_tolerance: float = 0.0
    """Share by which `metres_per_unit` may be off; 0 takes it as exact."""
    metric_scale_tolerance: float = 0.0
    """Share by which a plan in metres may be off: another scale within it is taken where the walls and all
    measurements surely ask for one. 0 takes the plan as drawn, and where it fits clearly better at another
    scale, says so and ends with exit code 1."""
    two_scales: bool = False
    """Look for a scale along each axis of the plan: drawings that were stretched."""
    control_points: tuple[str, ...] = ()
    """Known pairs "x,y,z=X,Y": a point of the scan in its own axes (m) and the same point on the plan, in the
    coordinates at the rim of `planfit plan PLAN -o plan.png`: pixels of a picture (v down), else the plan
    frame, in metres where its unit is known. "x,y,z=file:X,Y": in the file's own coordinates."""
    control_point_tolerance_m: float = 1.0
    """How far off a control point may end."""
    start: str = ""
    """Rough alignment "x,y,yaw": plan point (m) of the level frame's origin, and yaw (deg); the search
    keeps to 5 m and 20 degrees of it."""
    recorded_axes: RecordedAxes = "auto"
    """Whose axes the recorded poses are in: `plan`, those of the plan; `own`, others; `auto`, the plan's
    where the scan's format says so and the plan is the one in the scan's folder."""

    def __post_init__(self) -> None:
        if self.method not in ("search", "paper"):
            raise OptionError(f"align.method: expected search or paper, found {self.method!r}")
        require_choice(self, "recorded_axes", "auto", "plan", "own")
        require_positive(self, "candidate", "control_point_tolerance_m")
        require_share(self, "scale_tolerance", "metric_scale_tolerance")
        for text in self.control_points:
            parse_control_point(text)
        if self.start:
            parse_start(self.start)

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
    cell_m: float = 0.2
    """Finest cell of the coarse search; it grows with the size of scan and plan."""
    reach_m: float = 0.4
    """A wall this far from its face still scores 0.6 in the coarse search; covers leftover drift. At
    least one and a half cells."""
    max_yaws: int = 8
    """Most yaws that are tried, best agreement of wall directions first."""
    max_candidates: int = 48
    """Hypotheses of the coarse search that are refined."""
    distinct_translation_m: float = 1.0
    """Alignments nearer than this, with yaws within `distinct_yaw_deg`, are one."""
    distinct_yaw_deg: float = 5.0
    """See `distinct_translation_m`."""
    distinct_scale: float = 0.03
    """Alignments whose scales differ by more than this share are two."""
    min_score: float = 0.5
    """Below this share of seen wall that the plan explains, an alignment is not accepted as sure."""
    min_margin: float = 0.05
    """The best alignment must beat the next by this share of wall, else the answer is ambiguous."""
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
    keeps to `prior_translation_m` and `prior_yaw_deg` of it."""
    recorded_axes: RecordedAxes = "auto"
    """Whose axes the recorded poses are in: `plan`, those of the plan; `own`, others; `auto`, the plan's
    where the scan's format says so and the plan is the one in the scan's folder."""
    prior_translation_m: float = 5.0
    """Where the recorded poses are in the plan's axes, an alignment within this of them is
    preferred as long as it explains 0.8 of what the best one does."""
    prior_yaw_deg: float = 20.0
    """See `prior_translation_m`. Without it, a building that fits when turned about its middle would count
    as being where the format says."""

    def __post_init__(self) -> None:
        if self.method not in ("search", "paper"):
            raise OptionError(f"align.method: expected search or paper, found {self.method!r}")
        require_choice(self, "recorded_axes", "auto", "plan", "own")
        require_positive(self, "cell_m", "reach_m", "max_yaws", "max_candidates", "candidate")
        require_positive(self, "control_point_tolerance_m")
        require_share(self, "scale_tolerance", "metric_scale_tolerance")
        for text in self.control_points:
            parse_control_point(text)
        if self.start:
            parse_start(self.start)

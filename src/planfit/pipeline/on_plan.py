"""Where a prepared scan stands on its plan, or on the plans of its storeys."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.alignment import Alignment
from planfit.findings import Fact, Finding, PlanKind
from planfit.floorplan import Floorplan


@dataclass(frozen=True)
class ScanOnPlan:
    """Where a prepared scan stands on its plan; or without one, in the level frame."""

    floorplan: Floorplan | None
    """In metres, at the scale that was found where it had no unit, or was off; None where the scan stands
    alone. Where each storey has a plan, all of them joined."""
    plan_from_level: Float[np.ndarray, "4 4"]
    """The identity where there is no plan, or the scan shows no wall and its format claims nothing."""
    alignment: Alignment | None
    """None where no wall was seen. Where each storey has a plan, that of the lowest one."""
    claimed_plan_from_level: Float[np.ndarray, "4 4"] | None
    """What the scan's format claims, if it does."""
    storeys: "Storeys | None" = None
    """Where plans were given by storey."""
    survey: "SurveyOnPlan | None" = None
    """Where surveyed points are, if some were given."""
    against_points: "PointsAgainstWalls | None" = None
    """Where points said to be known hold the scan to a place that its walls contradict."""

    @property
    def is_placed(self) -> bool:
        """Whether something says where on its plan the scan is: walls or control points."""
        is_surveyed = self.survey is not None and self.survey.is_placed
        return self.floorplan is None or self.alignment is not None or is_surveyed

    @property
    def recorded_plan_from_level(self) -> Float[np.ndarray, "4 4"]:
        """For the poses as recorded: what the format claims where nothing contradicts it.

        A plan that was drawn at another scale does: its own axes are nowhere in metres.
        """
        found = self.alignment
        is_as_recorded = found is None or (found.is_as_recorded and found.scale_xy == (1.0, 1.0))
        if self.claimed_plan_from_level is not None and is_as_recorded:
            return self.claimed_plan_from_level
        return self.plan_from_level


STANDS_ALONE = ScanOnPlan(None, np.eye(4), None, None)
"""Where there is no plan: what is called the plan frame elsewhere is then the level frame."""


@dataclass(frozen=True)
class PointsAgainstWalls:
    """Known points whose scan, by its walls, clearly stands elsewhere."""

    off_m: Float[np.ndarray, " p"]
    """How far from where it is said to be each point lies by the walls alone."""
    apart_m: float
    """Between where points and walls put the middle of the scan."""
    apart_deg: float
    score_of_walls: float
    """Share of seen wall that the plan explains where the walls put the scan."""
    score_of_points: float
    """The same where the points put it."""

    @property
    def facts(self) -> dict[str, Fact]:
        """Of findings about it."""
        return {
            "apart_m": self.apart_m,
            "apart_deg": self.apart_deg,
            "wall_share_without": self.score_of_walls,
            "wall_share_with": self.score_of_points,
        }

    def finding(self, names: Sequence[str], most_m: float) -> Finding:
        """For a user, with the points of these names that are off by more than `most_m` by the walls."""
        off = np.flatnonzero(self.off_m > most_m)
        points = {
            "points": tuple(names[k] for k in off.tolist()),
            "offs_m": tuple(self.off_m[off].tolist()),
        }
        return Finding(PlanKind.POINTS_AGAINST_WALLS, {**points, **self.facts})


@dataclass(frozen=True)
class SurveyOnPlan:
    """Surveyed points in the frame of the poses; p points."""

    targets: Float[np.ndarray, "p 3"]
    """m, plan frame; z is NaN where the height is not known."""
    is_placed: bool
    """Whether control points alone say where the scan is."""
    height_datum_m: float | None
    """Height of the floor in heights of the survey; None where heights count from the floor."""
    site_from_plan: Float[np.ndarray, "4 4"] | None
    """To the survey's axes less `site_origin`, where there is no plan."""
    site_origin: Float[np.ndarray, "3"]
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class StoreyOnPlan:
    """A storey's own plan, and where it lies."""

    number: int
    """That the plan was given by."""
    floorplan: Floorplan
    """In metres and its own axes, at the scale that was found."""
    alignment: Alignment
    """Of the walls seen on this storey with this plan."""
    plan_from_own: Float[np.ndarray, "4 4"]
    """From its own axes, floor at 0, to the plan frame: that of the lowest storey with a plan."""
    shares_axes: bool
    """Whether it is drawn in the axes of the plan frame, and lies there as drawn."""


@dataclass(frozen=True)
class Storey:
    """A storey that was walked."""

    floor_m: float
    """Height of its floor in the plan frame."""
    frames: tuple[tuple[int, int], ...]
    """Runs of frames that stand on it, first and last as numbered in the scan."""
    own: StoreyOnPlan | None
    """None where no plan was given for it."""

    @property
    def name(self) -> str:
        """For messages and captions."""
        if self.own is None:
            return f"the storey without a plan, floor at {self.floor_m:.2f} m"
        return f"storey {self.own.number} ({self.own.floorplan.name})"


@dataclass(frozen=True)
class Storeys:
    """The storeys of a walk, from the lowest; n frames."""

    walked: tuple[Storey, ...]
    of_frames: Int[np.ndarray, " n"]
    """Index among them of the storey that each frame stands on; `NO_STOREY` on stairs."""
    not_walked: tuple[int, ...] = ()
    """Numbers of plans of storeys that no frame stands on; they were not used."""

    @property
    def without_plan(self) -> tuple[Storey, ...]:
        """Those that have none."""
        return tuple(storey for storey in self.walked if storey.own is None)

    @property
    def with_plan(self) -> dict[int, StoreyOnPlan]:
        """Plans by the index of their storey."""
        return {k: storey.own for k, storey in enumerate(self.walked) if storey.own is not None}


def frame_runs(holds: Bool[np.ndarray, " n"]) -> tuple[tuple[int, int], ...]:
    """First and last of each run of frames for which something holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], holds.astype(int), [0]])))
    return tuple((int(a), int(b) - 1) for a, b in edges.reshape(-1, 2))

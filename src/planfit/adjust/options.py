"""Everything that can be chosen about the bundle adjustment."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from planfit.adjust.association import AssociationOptions
from planfit.adjust.terms.observation_models import PAPER, ROBUST, ObservationModel, TermName
from planfit.errors import OptionError, require, require_choice, require_positive
from planfit.lsq.solver import SolverOptions
from planfit.lsq.term import Term

START_NAMES = ("aligned", "vote", "reach", "wide")
"""Of `AdjustOptions.starts`."""


@dataclass(frozen=True)
class TermOptions:
    """How much a term counts beside the others."""

    weight: float = 1.0
    """Factor on the term; 0 switches it off."""


@dataclass(frozen=True)
class AdjustOptions:
    """Terms, solver and schedule of the bundle adjustment."""

    geometric: Literal["points", "reprojection", "rays"] = "points"
    """What matches are held to: 3D point error, reprojection error, or least distance of viewing rays."""
    points: TermOptions = field(default_factory=TermOptions)
    """3D point error."""
    reprojection: TermOptions = field(default_factory=TermOptions)
    """Reprojection error."""
    rays: TermOptions = field(default_factory=TermOptions)
    """Least distance of viewing rays."""
    floor: TermOptions = field(default_factory=TermOptions)
    """Floor term."""
    ceiling: TermOptions = field(default_factory=TermOptions)
    """Ceiling term, where masks name the ceiling."""
    walls: TermOptions = field(default_factory=TermOptions)
    """Walls term."""
    wall_strategy: Literal["fixed", "iterative", "nearest-point"] = "fixed"
    """What wall points are held to: the plane of a face chosen for the whole patch (fixed nearest wall),
    that of the face nearest to each point at each round (iterative nearest wall), or its nearest point."""
    columns: TermOptions = field(default_factory=TermOptions)
    """The same for the sides of columns, where masks name columns."""
    odometry: TermOptions = field(default_factory=TermOptions)
    """Odometry term."""
    surfaces: TermOptions = field(default_factory=TermOptions)
    """Surfaces term: pairs of frames that were matched by geometry."""
    control: TermOptions = field(default_factory=TermOptions)
    """Control term: points whose coordinates were surveyed."""
    cost: Literal["robust", "paper"] = "robust"
    """What a term adds up: `robust`, effective observations in sigmas under losses that let go of wrong ones;
    `paper`, as the paper has it, the mean of the unsquared distances of its points, in metres."""
    is_bounded: bool = False
    """Bundle adjustment with an inequality constraint (IBA): geometry may pay for the other terms only up
    to a bound, where its errors are 5 % larger than without them."""
    association: AssociationOptions = field(default_factory=AssociationOptions)
    """Which face a wall patch may belong to."""
    method: Literal["lm", "sgd"] = "lm"
    """`lm`: Levenberg-Marquardt; `sgd`: the paper's gradient descent (PyTorch), for the paper's cost only."""
    solver: SolverOptions = field(default_factory=SolverOptions)
    """When a solve ends, and where it runs."""
    loops_first: bool = True
    """Close loops by matches before the scan is aligned and walls act."""
    gnc_schedule: tuple[float, ...] = (4.0, 2.0, 1.0)
    """Factors on the scale of the matches' loss while loops close, one after the other: wide at first,
    so that matches which are far apart only because of drift still act, then as it stands."""
    wall_distances_m: tuple[float, ...] = (1.2, 0.8, 0.6, 0.45, 0.35)
    """Association distances, one after the other. Where several starts compete, none looks further than the
    largest, and each ends at the last."""
    starts: tuple[Literal["aligned", "vote", "reach", "wide"], ...] = (
        "aligned",
        "vote",
        "reach",
        "wide",
    )
    """Starts that compete by the full cost, tried in this order until two agree or one is clearly good: poses
    as aligned, losses as they stand; stretches of the walk vote for their shift; each wall patch reaches for
    its face as far as its pose may be off; all patches reach far. Other strategies for walls than fixed
    nearest walls, bounded solves and the paper's take poses as aligned."""
    wall_offset_sigma_m: float = 0.0
    """Sigma of faces about where they are drawn, one unknown offset a face; 0: faces are as drawn. Worth
    it where the whole plan is a few centimetres off: with 3 cm, a sigma of 2 cm brings the error from
    0.022 to 0.017 m; but from 0.007 to 0.008 m on a right plan, and where some walls are decimetres off
    it lets them act (0.013 to 0.08 m), so it is off by default."""
    finds_moved_walls: bool = True
    """Let go of walls that stand decimetres from where they are drawn. Else walls stand as drawn, whatever is
    seen."""
    max_alternations: int = 5
    """Rounds of association and solve at one distance; ends earlier when no association changes."""

    def __post_init__(self) -> None:
        require_positive(self, "max_alternations")
        require_choice(self, "geometric", "points", "reprojection", "rays")
        require_choice(self, "wall_strategy", "fixed", "iterative", "nearest-point")
        require_choice(self, "cost", "robust", "paper")
        require_choice(self, "method", "lm", "sgd")
        if not self.gnc_schedule or min(self.gnc_schedule) <= 0:
            raise OptionError(f"gnc_schedule: expected factors above 0, found {self.gnc_schedule}")
        for start in self.starts:
            if start not in START_NAMES:
                raise OptionError(
                    f"starts: expected names among {', '.join(START_NAMES)}, found {start!r}"
                )
        require(len(self.starts) > 0, "starts: expected at least one start, found none")
        if not self.wall_distances_m or min(self.wall_distances_m) <= 0:
            raise OptionError(
                f"wall_distances_m: expected positive distances, found {self.wall_distances_m}"
            )
        require(
            any(weight > 0 for weight in self._weights()),
            "adjust: expected at least one term with a weight above 0, found none",
        )
        if self.solver.device != "cpu":
            require(
                self.geometric == "points"
                and self.wall_strategy == "fixed"
                and self.wall_offset_sigma_m == 0
                and self.method == "lm",
                "adjust.solver.device: on a GPU run 3D points and fixed nearest walls as drawn, by lm; "
                "use cpu for other terms",
            )
        if self.method == "sgd":
            is_papers = (
                (self.geometric, self.wall_strategy, self.cost) == ("points", "fixed", "paper")
                and not self.is_bounded
                and self.odometry.weight == self.ceiling.weight == self.columns.weight == 0
                and self.surfaces.weight == self.control.weight == 0
            )
            require(
                is_papers,
                "adjust.method: gradient descent minimises the paper's cost only (3D points, floor, "
                "fixed nearest walls); use --preset paper, or lm",
            )

    @property
    def has_several_starts(self) -> bool:
        """Whether starts compete: their cost must be the one that is solved for, and its losses level off."""
        return (
            (self.method, self.wall_strategy, self.cost) == ("lm", "fixed", "robust")
            and not self.is_bounded
            and self.walls.weight > 0
        )

    def model(self, term: TermName) -> ObservationModel:
        """What the observations of a term are like under the chosen cost, with the user's weight."""
        models = PAPER if self.cost == "paper" else ROBUST
        chosen: TermOptions = getattr(self, term)
        return replace(models[term], weight=chosen.weight)

    def _weights(self) -> tuple[float, ...]:
        geometric = getattr(self, self.geometric).weight
        others = (self.floor, self.ceiling, self.walls, self.columns, self.odometry, self.surfaces)
        return geometric, *(options.weight for options in others)


def check_extra_terms(
    extra: Sequence[Term], options: AdjustOptions, n_keyframes: int | None
) -> None:
    """Raise unless an adjustment can take terms of the user's own; None keyframes: all frames are unknowns.

    Raises:
        OptionError: the method minimises another cost, or only keyframes are unknowns.
    """
    if extra and options.method == "sgd":
        raise OptionError(
            "adjust.method: gradient descent minimises the paper's cost only; use lm with extra terms"
        )
    if extra and n_keyframes is not None:
        raise OptionError(
            "extra_terms: expected all frames as unknowns, as such terms may name any frame, found "
            f"{n_keyframes} keyframes; raise keyframes.min_frames above the scan's frames"
        )

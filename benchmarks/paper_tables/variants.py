"""What is compared: each row of the paper's three tables, with the paper's cost and with planfit's own."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

from planfit.adjust import AdjustOptions, PaperWeights, paper_options
from planfit.alignment import AlignOptions
from planfit.pipeline.options import RefineOptions

Preset = Literal["paper", "default"]
Change = Callable[[AdjustOptions], AdjustOptions]


@dataclass(frozen=True)
class Variant:
    """One way to refine a scan."""

    preset: Preset
    name: str
    change: Change | None
    """What it alters in the preset's adjustment; None leaves the scan as it was aligned, unadjusted."""
    paper_alignment: bool = False
    """Whether the scan is aligned as the paper does. Else all variants search, so that they differ in their
    adjustment alone."""
    has_true_poses: bool = False
    """Nothing is refined: the map is that of the true poses, so it shows what the sensor's noise leaves."""

    @property
    def is_descent(self) -> bool:
        """Whether it is solved as the paper does, by tens of thousands of steps."""
        return self.change is not None and self.options(0.5).adjust.method == "sgd"

    @property
    def key(self) -> str:
        """Name in files: `preset/name`."""
        return f"{self.preset}/{self.name}"

    def options(self, lambda_walls: float) -> RefineOptions:
        """Options of a run; `lambda_walls` is the paper's weight for scans of this kind."""
        adjust = AdjustOptions()
        if self.preset == "paper":
            adjust = paper_options(PaperWeights(lambda_walls=lambda_walls))
        if self.change is not None:
            adjust = self.change(adjust)
        align = AlignOptions(method="paper" if self.paper_alignment else "search")
        return RefineOptions(align=align, adjust=adjust)


def _without(*terms: str) -> Change:
    """Without these terms, and without what the paper does not have: ceiling and columns."""

    def change(adjust: AdjustOptions) -> AdjustOptions:
        off = {name: replace(getattr(adjust, name), weight=0.0) for name in terms}
        if "floor" in terms:
            off["ceiling"] = replace(adjust.ceiling, weight=0.0)
        if "walls" in terms:
            off["columns"] = replace(adjust.columns, weight=0.0)
        return replace(adjust, **off)

    return change


def _then(*changes: Change) -> Change:
    def change(adjust: AdjustOptions) -> AdjustOptions:
        for one in changes:
            adjust = one(adjust)
        return adjust

    return change


def _nearest_point(adjust: AdjustOptions) -> AdjustOptions:
    return replace(adjust, wall_strategy="nearest-point")


def _iterative(adjust: AdjustOptions) -> AdjustOptions:
    return replace(adjust, wall_strategy="iterative")


def _faces_turned(adjust: AdjustOptions) -> AdjustOptions:
    """Faces told apart by the side they look to where the preset does not, and the other way round."""
    oriented = not adjust.association.oriented
    return replace(adjust, association=replace(adjust.association, oriented=oriented))


def _reprojection(adjust: AdjustOptions) -> AdjustOptions:
    return replace(adjust, geometric="reprojection")


def _rays(adjust: AdjustOptions) -> AdjustOptions:
    return replace(adjust, geometric="rays")


def _bounded(adjust: AdjustOptions) -> AdjustOptions:
    return replace(adjust, is_bounded=True)


def _descent(adjust: AdjustOptions) -> AdjustOptions:
    """The paper's own solver, its whole schedule, at each alternation of association and solve."""
    return replace(adjust, method="sgd")


def _as_it_is(adjust: AdjustOptions) -> AdjustOptions:
    return adjust


_CHANGES: dict[str, Change] = {
    "geometric": _without("floor", "walls"),
    "geometric + floor": _without("walls"),
    "geometric + walls": _without("floor"),
    "all": _as_it_is,
    "nearest point": _then(_without("floor"), _nearest_point),
    "iterative nearest wall": _then(_without("floor"), _iterative),
    "fixed nearest wall, faces": _then(_without("floor"), _faces_turned),
    "reprojection": _reprojection,
    "ray distance": _rays,
    "bounded, 3D points": _bounded,
    "bounded, reprojection": _then(_reprojection, _bounded),
}

UNADJUSTED = Variant("default", "none", None)
PAPER_TO_THE_LETTER = Variant("paper", "all, paper's alignment", _as_it_is, paper_alignment=True)
PAPER_DESCENT = Variant("paper", "all, gradient descent", _descent)
TRUE_POSES = Variant("default", "true poses", None, has_true_poses=True)
VARIANTS: tuple[Variant, ...] = (
    TRUE_POSES,
    UNADJUSTED,
    *(Variant("paper", name, change) for name, change in _CHANGES.items()),
    PAPER_TO_THE_LETTER,
    *(Variant("default", name, change) for name, change in _CHANGES.items()),
)


DESCENT_VARIANTS: tuple[Variant, ...] = (
    *(v for v in VARIANTS if v in (TRUE_POSES, UNADJUSTED) or v.name == "all"),
    PAPER_DESCENT,
)
"""What is measured of the paper's own descent, and beside it."""


def setup_digest(*parts: object) -> str:
    """Changes when what any variant does changes, or any of the other `parts`."""
    options = [
        (v.key, v.has_true_poses, v.change and v.options(0.5)) for v in (*VARIANTS, PAPER_DESCENT)
    ]
    return hashlib.sha256(repr((options, *parts)).encode()).hexdigest()[:16]

"""Named sets of options: what works best, and the paper to the letter."""

from collections.abc import Callable

from planfit.adjust import paper_options
from planfit.alignment import AlignOptions
from planfit.errors import OptionError
from planfit.matching import MatchingOptions, SurfaceOptions
from planfit.pipeline.options import RefineOptions
from planfit.tracking import KeyframeOptions, TrackingOptions

PAPER_MIN_FRAMES = 30_000
"""The paper solves for all frames; above so many that takes more memory than a laptop has."""


def paper_preset() -> RefineOptions:
    """The paper's alignment and adjustment: its cost, its order, its weights; recorded poses are believed.

    Solved by Levenberg-Marquardt, which reaches lower costs of the same function in a small share of
    the time; `adjust.method = "sgd"` takes the paper's gradient descent.
    """
    return RefineOptions(
        keyframes=KeyframeOptions(min_frames=PAPER_MIN_FRAMES),
        tracking=TrackingOptions(is_judged=False),
        # The paper matches keypoints alone.
        matching=MatchingOptions(surfaces=SurfaceOptions(use="never")),
        align=AlignOptions(method="paper"),
        adjust=paper_options(),
    )


PRESETS: dict[str, Callable[[], RefineOptions]] = {
    "default": RefineOptions,
    "paper": paper_preset,
}


def preset(name: str) -> RefineOptions:
    """Options of a preset.

    Raises:
        OptionError: there is none of this name.
    """
    if name not in PRESETS:
        raise OptionError(f"preset: expected {' or '.join(PRESETS)}, found {name!r}")
    return PRESETS[name]()

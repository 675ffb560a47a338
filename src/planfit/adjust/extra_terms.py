"""What terms of the user's own ask of a run, told before anything is computed."""

from collections.abc import Sequence

from planfit.adjust.options import AdjustOptions
from planfit.errors import OptionError
from planfit.lsq.term import Term


def check_extra_terms(
    extra: Sequence[Term], options: AdjustOptions, n_keyframes: int | None
) -> None:
    """Raise unless an adjustment can take these terms.

    Args:
        extra: the user's.
        options: of the adjustment.
        n_keyframes: unknowns of it; None where all frames are.

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

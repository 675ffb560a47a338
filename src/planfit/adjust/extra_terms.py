"""What terms of the user's own ask of a run, told before anything is computed."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from planfit.adjust.options import AdjustOptions
from planfit.errors import OptionError
from planfit.lsq.problem import Problem
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


def require_extra_terms_to_work(
    extra: Sequence[Term],
    names: Sequence[str],
    target_from_cams: Float[np.ndarray, "n 4 4"],
    options: AdjustOptions,
    is_reduced: bool,
) -> None:
    """Raise unless a problem can have these terms.

    Args:
        extra: the user's.
        names: of all terms, these among them.
        target_from_cams: the unknowns that such terms may name; face offsets behind them are not for these.
        options: of the adjustment.
        is_reduced: whether only keyframes are unknowns.

    Raises:
        OptionError: as `check_extra_terms`; or an index that is not there, or a name that another term has.
    """
    check_extra_terms(extra, options, len(target_from_cams) if is_reduced else None)
    Problem(extra, target_from_cams)  # checks what every problem of the engine must be
    for term in extra:
        if list(names).count(term.name) > 1:
            raise OptionError(
                f"extra_terms: expected a name that no other term has, found {term.name!r}"
            )

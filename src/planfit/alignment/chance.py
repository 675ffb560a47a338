"""What chance gives: how far the best of many places that do not fit leads the next."""

from collections.abc import Sequence

import numpy as np

GAP_PRIOR, USUAL_GAP = 2, 0.03
"""Mean gap (share of wall) between the best of places that do not fit, and how many gaps that is worth."""


def chance_of_gap(scores: Sequence[float]) -> float:
    """Probability that the first of some scores leads the others by as much as it does by chance alone.

    Other places on the plan show what chance gives this scan on this plan: the best of many like them lead
    each other by gaps that are exponential, the k-th by a k-th of the mean (Renyi's representation of order
    statistics, for any distribution with an exponential tail). Only the first gap is of the place taken; the
    mean is estimated from the others, with a prior of `GAP_PRIOR` others of `USUAL_GAP`.

    Args:
        scores: of the place taken, then of the others, best first.
    """
    if len(scores) < 2:
        return 0.0
    gap = scores[0] - scores[1]
    others = np.array(scores[1:])
    spacings = np.arange(2, len(others) + 1) * (others[:-1] - others[1:])
    n = len(spacings) + GAP_PRIOR
    total = float(spacings.sum()) + GAP_PRIOR * USUAL_GAP
    # A gap over a mean of n gaps that is itself estimated: the tail of an F distribution (2, 2 n).
    return float((1.0 + max(gap, 0.0) / total) ** -n)

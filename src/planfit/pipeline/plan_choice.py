"""Which plan belongs to which storey that was walked: what fits best in the order of the numbers."""

from collections.abc import Mapping, Sequence
from itertools import combinations, permutations

import numpy as np
from jaxtyping import Float

from planfit.alignment import AlignOptions, WallSamples
from planfit.alignment import align as search_alignment
from planfit.alignment.plan_scale import CLEAR_GAIN
from planfit.errors import FloorplanError
from planfit.floorplan import Floorplan

MIN_FIT = 0.4
"""Share of a storey's wall that any plan of the same building may explain: what stands over each other. A
storey is better left without a plan than given one that explains less."""
AS_NUMBERED = 0.02
"""What a plan gains where its number is that of the storey counted from the lowest one walked: storeys that
are alike fit alike."""
SWAPPED_BY = CLEAR_GAIN
"""By so much more of the wall (mean over storeys) plans fit in another order where they were swapped."""
MAX_PAIRS = 6
"""Of storeys with plans in any order that are tried: orders grow as the factorial."""


def choose_plans(
    walls: Sequence[WallSamples], plans: Mapping[int, Floorplan], options: AlignOptions
) -> dict[int, int]:
    """Number of the plan of each storey that has one, by the storey's index from the lowest.

    Args:
        walls: of each storey that was walked, from the lowest, level frame; one of them at least shows some.
        plans: by number.
        options: of the alignment.

    Raises:
        FloorplanError: plans fit clearly better in another order than that of their numbers.
    """
    numbers = sorted(plans)
    seen = np.array([k for k, each in enumerate(walls) if len(each.xy) > 1])
    fits = np.array(
        [[search_alignment(walls[k], plans[i], options).score for i in numbers] for k in seen]
    )
    as_numbered = seen[:, None] == np.array(numbers) - numbers[0]
    worth = fits - MIN_FIT + AS_NUMBERED * as_numbered
    chosen = _best(worth, in_order=True)
    best = _best(worth, in_order=False)
    gain = (_worth(worth, best) - _worth(worth, chosen)) / max(len(best), 1)
    if gain > SWAPPED_BY:
        raise FloorplanError(_swapped_words(fits, numbers, best, plans))
    return {int(seen[k]): numbers[plan] for k, plan in chosen}


Pairs = tuple[tuple[int, int], ...]
"""Storeys and plans, by index."""


def _best(worth: Float[np.ndarray, "k p"], in_order: bool) -> Pairs:
    """The pairs that are worth most; with none worth anything, as many as there can be."""
    n_storeys, n_plans = worth.shape
    found: list[Pairs] = []
    most = min(n_storeys, n_plans)
    for size in range(1, most + 1):
        for storeys in combinations(range(n_storeys), size):
            some = combinations(range(n_plans), size)
            if not in_order and size <= MAX_PAIRS:
                some = permutations(range(n_plans), size)
            found += [tuple(zip(storeys, plans, strict=True)) for plans in some]
    best = max(found, key=lambda pairs: _worth(worth, pairs))
    if _worth(worth, best) > 0:
        return best
    return max((each for each in found if len(each) == most), key=lambda p: _worth(worth, p))


def _worth(worth: Float[np.ndarray, "k p"], pairs: Pairs) -> float:
    return float(sum(worth[pair] for pair in pairs))


def _swapped_words(
    fits: Float[np.ndarray, "k p"],
    numbers: Sequence[int],
    best: Pairs,
    plans: Mapping[int, Floorplan],
) -> str:
    """What was found, and which numbers to give."""
    upwards = sorted(best)
    in_order = sorted(plan for _, plan in best)
    found = ", ".join(
        f"{plans[numbers[plan]].name} explains {fits[k, plan]:.0%} of the wall of storey {k + 1} from below "
        f"({plans[numbers[expected]].name} {fits[k, expected]:.0%})"
        for (k, plan), expected in zip(upwards, in_order, strict=True)
    )
    again = " ".join(
        f"--plan {numbers[expected]}={plans[numbers[plan]].name}"
        for (_, plan), expected in zip(upwards, in_order, strict=True)
    )
    return (
        f"plans by storey: expected the lower storey's plan to have the lower number, found that {found}; "
        f"give {again}"
    )

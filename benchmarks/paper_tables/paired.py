"""Two versions or two options on the same seeds: what differs case by case, not in the mean of each alone."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from planfit.errors import require

Values = Mapping[str, Mapping[str, float]]
"""Of each case (scan and seed), each metric by name; lower is better."""


@dataclass(frozen=True)
class Paired:
    """A metric of B against A over the cases that both have."""

    name: str
    n: int
    mean_a: float
    mean_b: float
    mean_difference: float
    """Mean of B minus A: below 0, B is better."""
    sigma: float
    """Standard deviation of the differences (n - 1); NaN of fewer than two."""
    wins: int
    """Cases in which B is better than A by more than rounding."""
    losses: int
    """Cases in which B is worse."""

    @property
    def standard_error(self) -> float:
        """Standard error of the mean difference; a mean beyond twice of it is hardly chance."""
        return self.sigma / np.sqrt(self.n)


def compare_paired(a: Values, b: Values) -> list[Paired]:
    """Every metric that both have, case by case; in the order of A.

    Cases and metrics of one alone, and values that are not finite, are left out.

    Raises:
        OptionError: no case is in both.
    """
    cases = [case for case in a if case in b]
    require(
        bool(cases),
        f"cases: expected some in both, found {', '.join(a) or 'none'} and {', '.join(b) or 'none'}; "
        "run both on the same scans and seeds",
    )
    names = list(dict.fromkeys(name for case in cases for name in a[case] if name in b[case]))
    rows = []
    for name in names:
        both = [
            (a[case][name], b[case][name]) for case in cases if name in a[case] and name in b[case]
        ]
        pairs = np.array([pair for pair in both if np.isfinite(pair).all()], dtype=float)
        if len(pairs) == 0:
            continue
        difference = pairs[:, 1] - pairs[:, 0]
        rounding = 1e-9 * np.abs(pairs).max(axis=1)
        mean_a, mean_b = pairs.mean(axis=0)
        rows.append(
            Paired(
                name=name,
                n=len(pairs),
                mean_a=float(mean_a),
                mean_b=float(mean_b),
                mean_difference=float(difference.mean()),
                sigma=float(np.std(difference, ddof=1)) if len(pairs) > 1 else np.nan,
                wins=int(np.sum(difference < -rounding)),
                losses=int(np.sum(difference > rounding)),
            )
        )
    return rows

"""Distance between matched points: how well frames that saw the same point agree on where it is."""

import numpy as np
from jaxtyping import Float

from planfit.geometry import se3
from planfit.matching import Matches


def match_distances(
    matches: Matches, target_from_cams: Float[np.ndarray, "n 4 4"]
) -> Float[np.ndarray, " m"]:
    """Distance (m) between the two points of each match."""
    # `start` bounds the matches of each pair: its differences tell how often a pair is repeated.
    sizes = np.diff(matches.start)
    first, second = (np.repeat(matches.pairs[:, side], sizes) for side in (0, 1))
    apart = se3.transform_indexed(target_from_cams, first, matches.points_a)
    apart -= se3.transform_indexed(target_from_cams, second, matches.points_b)
    return np.linalg.norm(apart, axis=1)


def median_match_distance(matches: Matches, target_from_cams: Float[np.ndarray, "n 4 4"]) -> float:
    """Median distance (m) between matched points; NaN where there are no matches."""
    if matches.n_matches == 0:
        return np.nan
    return float(np.median(match_distances(matches, target_from_cams)))

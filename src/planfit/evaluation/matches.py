"""Distance between matched points: how well frames that saw the same point agree on where it is."""

import numpy as np
from jaxtyping import Float

from planfit.geometry import se3
from planfit.matching import Matches
from planfit.runtime import let_go


def match_distances(
    matches: Matches, target_from_cams: Float[np.ndarray, "n 4 4"]
) -> Float[np.ndarray, " m"]:
    """Distance (m) between the two points of each match."""
    found = np.zeros(matches.n_matches)
    for part, pair in se3.points_in_parts(matches.start):
        first, second = matches.pairs[pair].T
        points_a, points_b = matches.points_a[part], matches.points_b[part]
        a = se3.transform_each(target_from_cams[first], points_a)
        b = se3.transform_each(target_from_cams[second], points_b)
        found[part] = np.linalg.norm(a - b, axis=1)
        let_go(points_a)
        let_go(points_b)
    return found


def median_match_distance(matches: Matches, target_from_cams: Float[np.ndarray, "n 4 4"]) -> float:
    """Median distance (m) between matched points; NaN where there are no matches."""
    if matches.n_matches == 0:
        return np.nan
    return float(np.median(match_distances(matches, target_from_cams)))

"""Each wall of the plan tested by all other evidence: does it stand where it is drawn?

Where few walls hold the poses, poses bend to a wall that was moved: no distance from the plan shows it, and
what resists is spread over all matches and steps. So each wall is given an offset of its own, and the
solution that the normal equations then have is compared with what is known of it by the sigmas that the
residuals tell (data snooping: Baarda, A Testing Procedure for Use in Geodetic Networks, 1968; externally
studentized: what a wall itself does to the spread of walls does not excuse it).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.moved_walls import MOVED_SIGMA_M, is_one_wall
from planfit.adjust.uncertainty.bundles import Bundles
from planfit.adjust.uncertainty.error_model import DRAWN_SIGMA_M, ErrorModel
from planfit.adjust.uncertainty.spreads import Clusters, shared_variance
from planfit.floorplan import Floorplan
from planfit.priors import WALL_MOVED_SHARE

PRIOR_ODDS = WALL_MOVED_SHARE.value / (1.0 - WALL_MOVED_SHARE.value)
"""That a wall was moved."""
LEAST_HELD = 1e-6
"""Share of a wall's own weight that must be left once poses have followed it, or nothing else sees where it
is: of walls that alone hold a direction 1e-9 are left, which is rounding, of others 1e-3 and more."""


@dataclass(frozen=True)
class WallTest:
    """A wall of the plan, and where all other evidence says that it stands."""

    faces: tuple[int, ...]
    """Its faces that were seen, by index."""
    offsets_m: tuple[float, ...]
    """Of each face along its normal from where it is drawn."""
    sigma_m: float
    """Standard deviation of the offset, the spread of walls about where they are drawn in it."""
    odds: float
    """That it was moved, for each time that it was not."""
    change: Float[np.ndarray, "u 6"]
    """Of the poses if it was moved, tangents (rotation, translation), target axes."""


@dataclass(frozen=True)
class _WallEquations:
    """The walls' part of the normal equations, by face."""

    bundles: Bundles
    clusters: Clusters
    solved: Float[np.ndarray, "u c"]
    """H^-1 times the pulls of the faces."""
    left: Float[np.ndarray, "c c"]
    """Residuals of faces (means) that errors of faces leave once poses have followed them."""
    factor: float
    shared_m: float


def run_wall_tests(model: ErrorModel, floorplan: Floorplan) -> tuple[WallTest, ...]:
    """Test each wall that holds the poses, the surest to be moved first.

    Args:
        model: of the errors of all terms, where an adjustment ended.
    """
    bundles = model.bundles.get("walls")
    if bundles is None or model.free.shape[1] > 0:
        return ()
    clusters = Clusters.of(bundles)
    solved = model.factors.solve(clusters.pull.toarray())
    left = np.eye(len(clusters.weights)) - (clusters.pull.T @ solved) / clusters.weights[:, None]
    spread = model.spreads["walls"]
    walls = _WallEquations(bundles, clusters, solved, left, spread.factor, spread.shared_m)
    tests = [_test(walls, sides, model) for sides in _sides_of_walls(bundles.labels, floorplan)]
    return tuple(sorted((t for t in tests if t is not None), key=lambda test: -test.odds))


def _sides_of_walls(
    faces: Int[np.ndarray, " c"], floorplan: Floorplan
) -> list[Float[np.ndarray, " c"]]:
    """Of each wall, how each face moves along its own normal if the wall moves by one: 1, -1, or 0."""
    sides, is_open = [], np.ones(len(faces), dtype=bool)
    for i in range(len(faces)):
        if not is_open[i]:
            continue
        mine = np.zeros(len(faces))
        for j in range(i, len(faces)):
            if is_open[j] and (i == j or is_one_wall(int(faces[i]), int(faces[j]), floorplan)):
                along = floorplan.normals[faces[i]] @ floorplan.normals[faces[j]]
                mine[j], is_open[j] = np.sign(along), False
        sides.append(mine)
    return sides


def _test(
    walls: _WallEquations, sides: Float[np.ndarray, " c"], model: ErrorModel
) -> WallTest | None:
    """One wall; None where nothing else says where it is."""
    bundles, clusters = walls.bundles, walls.clusters
    own = np.flatnonzero(sides)
    # The wall's offset o among the unknowns: poses follow by q o, and o = R / held.
    q = walls.solved @ sides
    by_offset = walls.left @ sides
    held = float(sides @ (clusters.weights * by_offset))
    if held <= LEAST_HELD * clusters.weights[own].sum():
        return None
    residuals = clusters.residuals[:, 0]
    offset = float(sides @ (clusters.weights * residuals)) / held
    free = walls.left - np.outer(by_offset, (sides * clusters.weights) @ walls.left) / held
    others = np.flatnonzero(sides == 0)
    shared_m = _spread_of(walls, free, residuals - by_offset * offset, others)
    # The offset's variance: of its own bundles, less what poses follow them, and of all that holds poses.
    is_own = np.isin(bundles.cluster, own)
    weights, followed = bundles.weights[is_own], (bundles.jacobian @ q)[is_own]
    kept = sides[bundles.cluster[is_own]] - followed
    pulls = clusters.pull.T @ q
    by_shared = model.shared.T @ q
    variance = walls.factor * float(weights @ kept**2 - weights @ followed**2)
    variance += float(q @ (model.noise @ q) + by_shared @ by_shared)
    variance -= walls.shared_m**2 * float(pulls @ pulls)
    variance += shared_m**2 * float(pulls[others] @ pulls[others])
    of_faces = np.bincount(bundles.cluster[is_own], weights * kept, len(sides))
    variance = max(variance, 0.0) + shared_m**2 * float(of_faces @ of_faces)
    sigma = float(np.sqrt(variance)) / held
    wide = float(np.hypot(sigma, MOVED_SIGMA_M))
    log_odds = np.log(PRIOR_ODDS * sigma / wide) + 0.5 * offset**2 * (sigma**-2 - wide**-2)
    # Were it moved, by how much: what is seen and what is usual, together.
    offset *= (MOVED_SIGMA_M / wide) ** 2
    return WallTest(
        tuple(int(face) for face in bundles.labels[own]),
        tuple(float(offset * side) for side in sides[own]),
        sigma,
        float(np.exp(np.clip(log_odds, -50.0, 50.0))),
        (offset * q).reshape(-1, 6),
    )


def _spread_of(
    walls: _WallEquations,
    left: Float[np.ndarray, "c c"],
    residuals: Float[np.ndarray, " c"],
    some: Int[np.ndarray, " k"],
) -> float:
    """Standard deviation (m) of faces about where they are drawn, by some of them."""
    weights = walls.clusters.weights[some]
    between = float(weights @ residuals[some] ** 2)
    n_left = float(np.trace(left[np.ix_(some, some)]))
    of_unit = float(weights @ np.sum(left[some] ** 2, axis=1))
    variance = shared_variance(between, n_left, of_unit, walls.factor, DRAWN_SIGMA_M)
    return float(np.sqrt(variance))

"""A pair of frames brought together by its surfaces: the motion, and what is observed of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Bool, Float

from planfit.geometry import se3
from planfit.matching.surfaces.grids import SurfaceGrids
from planfit.matching.surfaces.registration_kernels import (
    MIN_CELLS,
    bring_together,
    compare_surfaces,
    observed,
    sums_at,
)

SIGMA_BASE_M, SIGMA_PER_M = 0.015, 0.005
"""Standard deviation of a surface about its plane at no distance, m, and its growth with depth."""
MIN_OBSERVED = 0.02
"""A direction of motion is observed where the squared cosines of the surfaces' normals to it are this large
on average; in others, such as along a corridor, a pair says nothing."""
_LEAST_FACTOR = 0.05
"""On the variance of a surface: what all of an image shares does not show in distances."""
FLOOR_M = 0.003
"""No motion is surer than this, each axis, rotations by their lever: exposure takes its time, and depth errs
alike all over an image."""
BIAS = 0.13
"""Of the root mean square distance from surfaces, by how much all of them are off together, times the cosine
to a direction of motion: it bends the motion by as much over the mean squared cosine, be there ever so many
cells. Where little of what is seen holds a direction, normals that err hold it at the motion that was
recorded."""
PAIRS_ALIKE = 3.0
"""On variances: each view is in six pairs with its neighbours, which share what it errs by."""
AGREE_M, AGREE_PER_M = 0.03, 0.015
"""Distance of a cell from the other view's surface up to which they agree, and its growth with depth."""
RIVAL_M, RIVAL_DEG = 0.3, 4.0
"""Motions that differ by more are two."""
START_STEP_M, START_STEP_DEG = 0.5, 6.0
"""A pair is brought together from every start about this far from the next: half of what the first gate
allows."""
_COARSE = 2
"""Every so many rows and columns of cells say where a start leads."""
MAX_STEPS = 2
"""So many starts to each side, at most."""
SAME_AGREES, CHANCE_AGREES = 0.95, 0.6
"""Share of cells that agree where two views see one surface, and where they were brought together on surfaces
that are alike: rooms are made of the same planes."""
VIEW_OBSERVATIONS = 20.0
"""Independent ones in a whole view: cells of one surface agree together."""


@dataclass(frozen=True)
class Registered:
    """Two frames as their surfaces bring them together."""

    a_from_b: Float[np.ndarray, "4 4"]
    explained: float
    """Share of the views whose surfaces agree, of the view that agrees less."""
    contradicted: float
    """Share of what both could see at which one looks past a surface of the other."""
    agreement: float
    """Share of what lies where the other view shows anything that agrees with it, of the view that agrees
    less: unlike `explained`, it is no smaller where the camera moved far."""

    @property
    def log_odds(self) -> float:
        """Of the two seeing one surface, against surfaces that lie so by chance, whatever they share.

        It grows with what both see, each seeing worth `VIEW_OBSERVATIONS`, and falls where that differs.
        """
        seen = self.explained / max(self.agreement, 1e-9)
        agree = self.agreement * np.log(SAME_AGREES / CHANCE_AGREES)
        differ = (1.0 - self.agreement) * np.log((1.0 - SAME_AGREES) / (1.0 - CHANCE_AGREES))
        return float(VIEW_OBSERVATIONS * seen * (agree + differ))


@dataclass(frozen=True)
class Observed:
    """What surfaces say of a motion, about their middle: directions that compare, all in metres."""

    from_tangent: Float[np.ndarray, "6 6"]
    """Tangent (rotation, translation) to directions."""
    variances: Float[np.ndarray, " 6"]
    """m^2, of each direction; infinite where it is free."""
    by_sensor: Float[np.ndarray, "6 7"]
    """How the tangent follows the sensor's parameters; 0 in free directions."""
    distance_m: float
    """Of the surfaces from the camera, root mean square."""

    @property
    def information(self) -> Float[np.ndarray, "6 6"]:
        """Inverse covariance of the tangent; of a rank below 6 where directions are free."""
        return self.from_tangent.T @ (self.from_tangent / self.variances[:, None])

    def squared_sigmas(
        self, tangent: Float[np.ndarray, " 6"], covariance: Float[np.ndarray, "6 6"]
    ) -> float:
        """Squared Mahalanobis norm of a departure, itself of a covariance, in what is observed."""
        is_held: Bool[np.ndarray, " 6"] = np.isfinite(self.variances)
        rows = self.from_tangent[is_held]
        total = rows @ covariance @ rows.T + np.diag(self.variances[is_held])
        off = rows @ tangent
        return float(off @ np.linalg.solve(total, off))


def register(
    grids: SurfaceGrids,
    i: int,
    j: int,
    starts: Float[np.ndarray, "s 4 4"],
    rank: Callable[[Registered], float] = lambda one: one.log_odds,
) -> list[Registered]:
    """Motions that different starts lead to, the one of the highest rank first; none where nothing agrees.

    Only the first is brought together to the last: of the others it counts how well they explain the views.
    """
    a, b = _view(grids, i), _view(grids, j)
    sigma = np.array([SIGMA_BASE_M, SIGMA_PER_M])
    ends: list[Float[np.ndarray, "4 4"]] = []
    for start in starts:
        motion, n_cells = bring_together(
            a, b, np.ascontiguousarray(start, dtype=float), sigma, MIN_OBSERVED, _COARSE
        )
        if n_cells >= MIN_CELLS / _COARSE**2 and not _is_known(motion, ends):
            ends.append(motion)
    found = sorted((_judged(a, b, motion) for motion in ends), key=rank, reverse=True)
    if found:
        motion, n_cells = bring_together(a, b, found[0].a_from_b, sigma, MIN_OBSERVED, 1)
        found[0] = _judged(a, b, motion)
        if n_cells < MIN_CELLS:
            return []
    return found


def observe(grids: SurfaceGrids, i: int, j: int, a_from_b: Float[np.ndarray, "4 4"]) -> Observed:
    """What the surfaces of two frames say of the motion that brings them together."""
    sigma = np.array([SIGMA_BASE_M, SIGMA_PER_M])
    a, b = _view(grids, i), _view(grids, j)
    hessian, sums, across = sums_at(a, b, np.ascontiguousarray(a_from_b), sigma)
    values, vectors, scaling = observed(hessian, sums, a_from_b)
    # What the distances are, against what these sigmas say of them: depth cameras differ tenfold.
    factor = max(sums[6] / max(sums[0], 1.0), _LEAST_FACTOR)
    worth = min(1.0, VIEW_OBSERVATIONS / max(sums[0], 1.0)) / factor
    bias_m = BIAS * np.sqrt(sums[6] / max(sums[1], 1e-12))
    is_held = values > MIN_OBSERVED * sums[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        one = 1.0 / (worth * values) + FLOOR_M**2 + (bias_m * sums[1] / values) ** 2
        variances = np.where(is_held, PAIRS_ALIKE * one, np.inf)
    # The least squares H d + C s = 0 of a sensor's change s, along observed directions.
    held = scaling @ vectors[:, is_held]
    by_sensor = -held @ ((held.T @ across) / values[is_held, None])
    return Observed(
        vectors.T @ np.linalg.inv(scaling),
        variances,
        by_sensor,
        float(np.sqrt(sums[5] / max(sums[1], 1e-12))),
    )


def starts_about(
    a_from_b: Float[np.ndarray, "4 4"],
    up_a: Float[np.ndarray, "3"],
    sigma_rotation: float,
    sigma_translation: float,
) -> Float[np.ndarray, "s 4 4"]:
    """Motions about a predicted one, level shifts and turns about the vertical within two sigmas of it.

    Args:
        a_from_b: predicted.
        up_a: unit vector against gravity, camera frame of the first.
        sigma_rotation: rad, each axis.
        sigma_translation: m, each axis.
    """
    level = np.linalg.svd(up_a[None])[2][1:]  # two unit vectors across
    steps_m = _offsets(2.0 * sigma_translation, START_STEP_M)
    turns = _offsets(2.0 * np.rad2deg(sigma_rotation), START_STEP_DEG)
    found = []
    for turn, x, y in product(turns, steps_m, steps_m):
        start = a_from_b.copy()
        start[:3, :3] = se3.exp_so3(np.deg2rad(turn) * up_a) @ start[:3, :3]
        start[:3, 3] += x * level[0] + y * level[1]
        found.append(start)
    # The predicted one first: of motions that agree, the one it leads to is kept.
    order = sorted(range(len(found)), key=lambda k: float(np.abs(found[k] - a_from_b).sum()))
    return np.stack([found[k] for k in order])


def _offsets(reach: float, step: float) -> list[float]:
    n = min(int(np.ceil(reach / step - 0.5)), MAX_STEPS)
    return [k * step for k in range(-n, n + 1)]


def _view(grids: SurfaceGrids, i: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    k = grids.number[i]
    return grids.depth_m[k], grids.normals[k], grids.cameras[k]


def _judged(a: tuple, b: tuple, motion: np.ndarray) -> Registered:
    back = np.ascontiguousarray(se3.inverse(motion))
    both = np.array(
        [
            compare_surfaces(a, b, motion, AGREE_M, AGREE_PER_M),
            compare_surfaces(b, a, back, AGREE_M, AGREE_PER_M),
        ]
    )
    agreeing, past, size, seen = both.T
    explained = float((agreeing / np.maximum(size, 1.0)).min())
    return Registered(
        motion,
        explained,
        float(past.sum() / max((agreeing + past).sum(), 1.0)),
        float((agreeing / np.maximum(seen, 1.0)).min()),
    )


def _is_known(motion: Float[np.ndarray, "4 4"], others: Sequence[Float[np.ndarray, "4 4"]]) -> bool:
    """Whether a motion is one of some others: hundreds of starts lead to a few."""
    if not others:
        return False
    stacked = np.stack(others)
    apart = stacked[:, :3, 3] - motion[:3, 3]
    # The trace of A^T B is the sum of products; of an angle it is 1 + 2 cos.
    cosine = (np.einsum("kij,ij->k", stacked[:, :3, :3], motion[:3, :3]) - 1.0) / 2.0
    is_near = np.einsum("ki,ki->k", apart, apart) < RIVAL_M**2
    return bool((is_near & (cosine > np.cos(np.deg2rad(RIVAL_DEG)))).any())

"""Stretches of a walk find their place on the plan by vote: the shift that most wall agrees on, not the mean.

A wall that was moved, or a cupboard taken for wall, votes for a place of its own and is outvoted; in a mean
it would pull. Stretches that follow each other vote together: their shifts differ by no more than what the
recorded motion and the matches leave open.
"""

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.association import PatchesOnPlan, wall_patches_in_plan
from planfit.floorplan.nearest_faces import distances_of_segments
from planfit.geometry.se3 import Poses
from planfit.priors import WALL_SPREAD_M

STAY = 0.01
"""Observations that speak against a shift by the largest that is tried, along each axis: where walls tell
nothing, as along a corridor or off the plan, a stretch stays where it was aligned."""


MAX_SHIFT_M = 0.8
"""Largest shift that is tried, each axis."""
STEP_M = WALL_SPREAD_M.value
"""Shifts are tried this far apart."""
SIGMA_M = WALL_SPREAD_M.value
"""A patch votes for the shifts that bring it to a face, within this."""
PATCHES_PER_STRETCH = 16
"""Wall patches of one stretch, about."""
MAX_OBSERVATIONS_PER_FACE = 8.0
"""Votes of a stretch for one face, at most, in effective observations: many patches see a wall that was
moved, and all of them err alike. Of 4, 8 and 16, and none, 8 ends at the lowest costs (ConSLAM, drifts
1, 3 and 5, 30 % of walls moved)."""
BEND_SIGMA_M = 0.1
"""Sigma of the change of shift from one stretch to the next, each axis."""


def vote(seen: PatchesOnPlan, observations: Float[np.ndarray, " k"], max_shift_m: float) -> Poses:
    """Poses with each stretch shifted to where most of its wall finds faces, smoothly in between.

    Args:
        seen: patches of wall, in the order of frames, aligned with the plan as a whole.
        max_shift_m: largest shift that is tried, each axis.
    """
    patches, plan_from_cams = seen.patches, seen.plan_from_cams
    n_stretches = max(1, len(patches) // PATCHES_PER_STRETCH)
    stretch = np.arange(len(patches)) * n_stretches // max(len(patches), 1)
    grid = np.arange(-max_shift_m, max_shift_m + 1e-9, STEP_M)
    patch, face, distance_m = beside_faces(seen, 1.5 * max_shift_m)
    stay = STAY * (grid / max_shift_m) ** 2
    votes = np.tile(-np.add.outer(stay, stay), (n_stretches, 1, 1))
    for k in range(n_stretches):
        mine = stretch[patch] == k
        worth, normals = observations[patch[mine]], seen.floorplan.normals
        votes[k] += _votes(face[mine], normals, distance_m[mine], worth, grid)
    shifts = grid[_smoothest(votes)]
    middle = np.array([patches.frame_idx[stretch == k].mean() for k in range(n_stretches)])
    frames = np.arange(len(plan_from_cams))
    moved = plan_from_cams.copy()
    for axis in range(2):
        moved[:, axis, 3] += np.interp(frames, middle, shifts[:, axis])
    return moved


def beside_faces(
    seen: PatchesOnPlan, reach_m: float
) -> tuple[Int[np.ndarray, " c"], Int[np.ndarray, " c"], Float[np.ndarray, " c"]]:
    """Pairs of a patch and a face that it may belong to, no further across than `reach_m`, and the signed
    distance (m) across the face."""
    normals, ends = wall_patches_in_plan(seen.patches, seen.plan_from_cams)
    rule = seen.rule(reach_m)
    rows, columns, distances = [], [], []
    for begin in range(0, len(ends), 2048):  # bounds the (patches x faces) tables
        part = slice(begin, min(begin + 2048, len(ends)))
        distance = distances_of_segments(ends[part], normals[part], seen.floorplan, rule.of(part))
        row, column = np.nonzero(np.isfinite(distance))
        rows.append(row + begin)
        columns.append(column)
        distances.append(distance[row, column])
    if not rows:
        return np.zeros(0, dtype=int), np.zeros(0, dtype=int), np.zeros(0)
    return np.concatenate(rows), np.concatenate(columns), np.concatenate(distances)


def _votes(
    face: Int[np.ndarray, " c"],
    face_normals: Float[np.ndarray, "f 2"],
    distance_m: Float[np.ndarray, " c"],
    observations: Float[np.ndarray, " c"],
    grid: Float[np.ndarray, " g"],
) -> Float[np.ndarray, "g g"]:
    """Observations that agree with each shift (x, y), of each face up to a limit."""
    total = np.zeros((len(grid), len(grid)))
    for each in np.unique(face):
        mine = face == each
        along_x, along_y = face_normals[each]
        after = distance_m[mine, None, None] + (
            along_x * grid[None, :, None] + along_y * grid[None, None, :]
        )
        votes = np.einsum("c,cgh->gh", observations[mine], np.exp(-0.5 * (after / SIGMA_M) ** 2))
        total += np.minimum(votes, MAX_OBSERVATIONS_PER_FACE)
    return total


def _smoothest(votes: Float[np.ndarray, "s g g"]) -> Int[np.ndarray, "s 2"]:
    """The sequence of shifts with most votes less the cost of its changes (Viterbi's recursion)."""
    n_stretches, g, _ = votes.shape
    change = np.subtract.outer(np.arange(g), np.arange(g)) * STEP_M
    penalty = 0.5 * (change / BEND_SIGMA_M) ** 2  # of one axis; both add up
    score = votes[0]
    back: list[tuple[np.ndarray, np.ndarray]] = []
    for k in range(1, n_stretches):
        # Best predecessor along x for each (x, y'), then along y for each (x, y).
        along_x = score[None, :, :] - penalty[:, :, None]  # (x, x', y')
        from_x = np.argmax(along_x, axis=1)
        best = np.take_along_axis(along_x, from_x[:, None, :], axis=1)[:, 0]
        along_y = best[:, None, :] - penalty[None, :, :]  # (x, y, y')
        from_y = np.argmax(along_y, axis=2)
        score = np.take_along_axis(along_y, from_y[:, :, None], axis=2)[:, :, 0] + votes[k]
        back.append((from_x, from_y))
    x, y = np.unravel_index(int(np.argmax(score)), score.shape)
    path = [(int(x), int(y))]
    for from_x, from_y in reversed(back):
        x, y = path[-1]
        previous_y = int(from_y[x, y])
        path.append((int(from_x[x, previous_y]), previous_y))
    return np.array(path[::-1])

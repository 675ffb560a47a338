"""Walls that a plan draws as lines or thin strokes in their middle, given the two faces that they have."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.floorplan.types import Floorplan
from planfit.geometry import segments

CROSSES = np.sin(np.deg2rad(20.0))
"""Sine of the angle from which on two lines meet at a corner, and do not go on into each other."""
MIN_LEFT = 0.3
"""Share of a line's length that must be left of a face between the corners."""
CORNERS_AT_ONCE = 512
"""Ends of lines that are compared with all lines at a time: memory stays small on large plans."""


def are_strokes(floorplan: Floorplan, thinnest: float) -> Bool[np.ndarray, " n"]:
    """Faces of walls that are drawn thinner than walls are: strokes for walls, not walls to scale.

    `floorplan`: as drawn; `thinnest`: what walls are at least thick, in the plan's unit.
    """
    if floorplan.thickness is None:
        return np.zeros(len(floorplan), dtype=bool)
    return floorplan.is_oriented & (np.nan_to_num(floorplan.thickness, nan=np.inf) < thinnest)


def with_thickness(floorplan: Floorplan, half: float, thinnest: float = 0.0) -> Floorplan:
    """The plan with faces `half` before the middles of walls that are drawn as lines or strokes.

    Each line of unknown side becomes two faces, which end in the corners of the walls where lines meet; both
    faces of a stroke move apart. Other faces stay as they are.

    Args:
        floorplan: as drawn; lines are faces that are not oriented.
        half: half the thickness of the walls that lines and strokes are of, in the plan's unit.
        thinnest: walls that are drawn thinner are strokes.
    """
    stroke = are_strokes(floorplan, thinnest)
    if stroke.any():
        assert floorplan.thickness is not None
        drawn = np.where(stroke, 0.5 * floorplan.thickness, 0.0)
        floorplan = with_offsets(replace(floorplan, before_line=drawn), half - drawn)
    line = ~floorplan.is_oriented
    n_lines = int(line.sum())
    if n_lines == 0:
        return floorplan
    ends, normals = floorplan.ends[line], floorplan.normals[line]
    directions = segments.directions(ends)
    sides = np.stack([normals, -normals], axis=1)  # (line, side, xy)
    moves = _to_corners(ends, normals, half)
    # Between two thick walls little may be left of a short one; a plan of such alone is at another scale.
    lengths = segments.lengths(ends)
    left = lengths[:, None] + moves[:, :, 1] - moves[:, :, 0]
    kept = (left > MIN_LEFT * lengths[:, None]).ravel()
    if not kept.any():
        moves, kept = np.zeros_like(moves), np.ones_like(kept)
    faces = ends[:, None] + half * sides[:, :, None] + moves[..., None] * directions[:, None, None]
    both = np.repeat(np.flatnonzero(line), 2)[kept]
    source = np.concatenate([np.flatnonzero(~line), both])  # the face of the plan that each is of
    of_others = np.zeros(len(line) - n_lines)
    if floorplan.before_line is not None:
        of_others = floorplan.before_line[~line]
    before = np.concatenate([of_others, np.full(len(both), half)])
    thickness = np.full(len(floorplan), np.nan)
    if floorplan.thickness is not None:
        thickness = floorplan.thickness.copy()
    thickness[line] = 2.0 * half
    return floorplan.take(
        source,
        ends=np.concatenate([floorplan.ends[~line], faces.reshape(-1, 2, 2)[kept]]),
        normals=np.concatenate([floorplan.normals[~line], sides.reshape(-1, 2)[kept]]),
        is_oriented=np.ones(len(source), dtype=bool),
        fingerprint=f"{floorplan.fingerprint} with walls {2 * half:.6g} thick",
        thickness=thickness[source],
        before_line=before,
        drawn=floorplan.drawn_ends[source],
    )


def with_offsets(floorplan: Floorplan, offset: Float[np.ndarray, " n"]) -> Floorplan:
    """The plan with faces of lines and strokes moved along their normals: walls thicker or thinner.

    Args:
        floorplan: as `with_thickness` gives it.
        offset: of each face, in the plan's unit; of faces as drawn it does not count.
    """
    assert floorplan.before_line is not None
    moved = np.where(floorplan.before_line > 0, offset, 0.0)
    thickness = floorplan.thickness
    return replace(
        floorplan,
        ends=floorplan.ends + (moved[:, None] * floorplan.normals)[:, None],
        thickness=None if thickness is None else thickness + 2.0 * moved,
        before_line=floorplan.before_line + moved,
        drawn=floorplan.drawn_ends,
        fingerprint=f"{floorplan.fingerprint} wall by wall",
    )


def _to_corners(
    ends: Float[np.ndarray, "l 2 2"], normals: Float[np.ndarray, "l 2"], half: float
) -> Float[np.ndarray, "l 2 2"]:
    """How far along its line each end of each face moves: (line, side, end), m along the direction.

    Inside of a right corner a face ends `half` before the line it meets, outside as much beyond.
    """
    directions = segments.directions(ends)
    moves = np.zeros((len(ends), 2, 2))
    at = ends.reshape(-1, 2)  # end k of line i is 2 i + k
    for first in range(0, len(at), CORNERS_AT_ONCE):
        rows = np.arange(first, min(first + CORNERS_AT_ONCE, len(at)))
        of_line, which = rows // 2, rows % 2
        meets, other = _other_line(at[rows], of_line, ends, directions, half)
        sign_of_end = np.where(which == 1, 1.0, -1.0)
        outward = sign_of_end[:, None] * directions[of_line]
        # The other line's normal on the side that this line comes from.
        facing = segments.left_normals(ends)[other]
        facing *= -np.sign(np.einsum("ni,ni->n", facing, outward))[:, None]
        sine = np.maximum(-np.einsum("ni,ni->n", facing, outward), CROSSES)
        gap = np.einsum("ni,ni->n", facing, at[rows] - ends[other, 0])
        for side, across in enumerate((normals[of_line], -normals[of_line])):
            # How far the other line reaches to this side of the end.
            reach = np.einsum("nki,ni->nk", ends[other] - at[rows][:, None], across).max(axis=1)
            # Where this face is `half` before the other line, or as far behind it.
            lean = np.einsum("ni,ni->n", facing, across)
            inside = -(half * (1.0 - lean) - gap) / sine
            outside = (half * (1.0 + lean) + gap) / sine
            move = sign_of_end * np.where(reach > half, inside, outside)
            moves[of_line[meets], side, which[meets]] = move[meets]
    return moves


def _other_line(
    at: Float[np.ndarray, "k 2"],
    of_line: Int[np.ndarray, " k"],
    ends: Float[np.ndarray, "l 2 2"],
    directions: Float[np.ndarray, "l 2"],
    within: float,
) -> tuple[Bool[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Whether an end lies on another line that crosses its own, and the nearest such line."""
    from_first = at[:, None] - ends[None, :, 0]
    along = np.einsum("kli,li->kl", from_first, directions)
    beyond = along - np.clip(along, 0.0, segments.lengths(ends))
    normals = segments.left_normals(ends)
    distance = np.hypot(beyond, np.einsum("kli,li->kl", from_first, normals))
    distance[np.abs(directions[of_line] @ normals.T) < CROSSES] = np.inf
    other = np.argmin(distance, axis=1)
    return distance[np.arange(len(at)), other] <= within, other

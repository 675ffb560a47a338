"""Faults of plans: walls missing, moved and added, a wing rebuilt, another scale, another building."""

from dataclasses import replace

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from faults.inputs import Fault, Inputs, MovedWall
from planfit.floorplan import Floorplan
from planfit.geometry import segments
from planfit.synth import BuildingOptions, make_building

SHARES = (0.15, 0.3, 0.5)
SCALES = (0.01, 0.03, 0.10)
MAX_THICKNESS_M = 0.6
MIN_WALL_M = 0.8
"""Shorter faces are jambs and ends of walls: they go with the wall that they belong to."""


def walls_of(plan: Floorplan) -> Int[np.ndarray, " n"]:
    """Which wall each face belongs to: its other side, and the short faces at its ends, go along."""
    ends, lengths = plan.ends, plan.lengths
    along = segments.directions(ends)
    is_long = lengths > MIN_WALL_M
    a, b = np.nonzero(np.triu(np.abs(along @ along.T) > 0.99, k=1))
    gap = np.abs(np.einsum("ki,ki->k", plan.normals[a], ends[b].mean(axis=1) - ends[a, 0]))
    overlap = _overlap(ends[a], along[a], ends[b]) / np.minimum(lengths[a], lengths[b])
    is_back = np.einsum("ki,ki->k", plan.normals[a], plan.normals[b]) < 0
    is_pair = is_back & (gap > 0.01) & (gap < MAX_THICKNESS_M) & (overlap > 0.5)
    is_pair &= is_long[a] & is_long[b]
    # A short face belongs to the first long one across which it lies and whose end it touches.
    touching, short = [], np.flatnonzero(~is_long)
    for i in short:
        near = np.linalg.norm(ends[i][:, None, None] - ends[is_long][None], axis=-1).min(
            axis=(0, 2)
        )
        if len(near) and near.min() < 0.02:
            touching.append((i, np.flatnonzero(is_long)[int(np.argmin(near))]))
    rows = np.concatenate([a[is_pair], [i for i, _ in touching]]).astype(int)
    columns = np.concatenate([b[is_pair], [j for _, j in touching]]).astype(int)
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(plan), len(plan)))
    return connected_components(graph, directed=False)[1]


def _overlap(
    ends_a: Float[np.ndarray, "k 2 2"],
    along_a: Float[np.ndarray, "k 2"],
    ends_b: Float[np.ndarray, "k 2 2"],
) -> Float[np.ndarray, " k"]:
    """Length, m, over which each face b lies beside its face a."""
    at_a, at_b = (
        np.sort(np.einsum("kei,ki->ke", ends, along_a), axis=1) for ends in (ends_a, ends_b)
    )
    return np.maximum(0, np.minimum(at_a[:, 1], at_b[:, 1]) - np.maximum(at_a[:, 0], at_b[:, 0]))


def some_walls(
    plan: Floorplan, share: float, rng: np.random.Generator
) -> list[Int[np.ndarray, " k"]]:
    """Faces of walls at random, until they are this share of the plan's length."""
    wall_of = walls_of(plan)
    chosen, length = [], 0.0
    for wall in rng.permutation(wall_of.max() + 1):
        faces = np.flatnonzero(wall_of == wall)
        if length >= share * plan.lengths.sum():
            break
        if plan.lengths[faces].max() > MIN_WALL_M:
            chosen.append(faces)
            length += plan.lengths[faces].sum()
    return chosen


def missing(inputs: Inputs, size: int, rng: np.random.Generator) -> Inputs:
    """A share of the walls is not drawn."""
    plan = inputs.floorplan
    keep = np.ones(len(plan), dtype=bool)
    keep[np.concatenate(some_walls(plan, SHARES[size], rng))] = False
    return inputs.with_faces(plan.ends[keep], plan.normals[keep], plan.is_oriented[keep])


def moved(inputs: Inputs, size: int, rng: np.random.Generator) -> Inputs:
    """A share of the walls is drawn 10 to 50 cm off, across."""
    plan = inputs.floorplan
    ends, moved_walls = plan.ends.copy(), []
    for faces in some_walls(plan, SHARES[size], rng):
        longest = faces[np.argmax(plan.lengths[faces])]
        offset = rng.choice([-1, 1]) * rng.uniform(0.1, 0.5) * plan.normals[longest]
        ends[faces] += offset
        moved_walls.append(MovedWall(faces, -offset))
    spoilt = inputs.with_faces(ends, plan.normals, plan.is_oriented)
    return replace(spoilt, moved_walls=tuple(moved_walls))


def added(inputs: Inputs, size: int, rng: np.random.Generator) -> Inputs:
    """Partitions that were never built, a share of the plan's length more, square to other walls."""
    plan = inputs.floorplan
    long = np.flatnonzero(plan.lengths > 1.5)
    new_ends = []
    length = 0.0
    while length < SHARES[size] * plan.lengths.sum():
        i = rng.choice(long)
        along, normal = segments.directions(plan.ends[i][None])[0], plan.normals[i]
        foot = plan.ends[i, 0] + rng.uniform(0.2, 0.8) * plan.lengths[i] * along + 0.2 * normal
        tip = foot + rng.uniform(0.8, 2.5) * normal
        across = 0.06 * along
        sides = [[tip + across, foot + across], [foot - across, tip - across]]
        # The left of each face is its free side.
        turned = normal[0] * along[1] - normal[1] * along[0] < 0
        new_ends += [side if turned else side[::-1] for side in sides]
        length += 2 * float(np.linalg.norm(tip - foot))
    ends = np.array(new_ends)
    return inputs.with_faces(
        np.concatenate([plan.ends, ends]),
        np.concatenate([plan.normals, segments.left_normals(ends)]),
        np.concatenate([plan.is_oriented, np.ones(len(ends), dtype=bool)]),
    )


def rebuilt(inputs: Inputs, size: int, rng: np.random.Generator) -> Inputs:
    """At one end of the building the walls stand mirrored within it: other rooms in the same shell."""
    plan = inputs.floorplan
    middle = plan.ends.mean(axis=1)
    axis = int(np.argmax(plan.size))
    at = middle[:, axis] * rng.choice([-1, 1])
    wing = at > np.quantile(np.repeat(at, 1 + (10 * plan.lengths).astype(int)), 1 - SHARES[size])
    ends, normals = plan.ends.copy(), plan.normals.copy()
    low, high = (f(ends[wing, :, axis]) for f in (np.min, np.max))
    ends[wing, :, axis] = low + high - ends[wing, :, axis]
    normals[wing, axis] *= -1
    return inputs.with_faces(ends, normals, plan.is_oriented)


def scaled(inputs: Inputs, factor: float) -> Inputs:
    """Drawn too large or too small."""
    plan = inputs.floorplan
    spoilt = inputs.with_faces(factor * plan.ends, plan.normals, plan.is_oriented)
    return replace(spoilt, given_from_true=factor * inputs.given_from_true)


def too_large(inputs: Inputs, size: int, _rng: np.random.Generator) -> Inputs:
    return scaled(inputs, 1 + SCALES[size])


def too_small(inputs: Inputs, size: int, _rng: np.random.Generator) -> Inputs:
    return scaled(inputs, 1 - SCALES[size])


def mirrored(inputs: Inputs, _size: int, _rng: np.random.Generator) -> Inputs:
    """Left and right swapped, and nothing says so."""
    plan, swap = inputs.floorplan, np.array([-1.0, 1.0])
    spoilt = inputs.with_faces(plan.ends * swap, plan.normals * swap, plan.is_oriented)
    return replace(spoilt, given_from_true=np.diag(swap) @ inputs.given_from_true)


def outer_faces(plan: Floorplan) -> Bool[np.ndarray, " n"]:
    """Faces within a wall's thickness of the outline of all walls, doors and windows closed."""
    reach = 0.7
    shell = shapely.union_all([shapely.LineString(ends).buffer(reach) for ends in plan.ends])
    outline = shapely.union_all(shapely.get_exterior_ring(shapely.get_parts(shell)))
    middle = shapely.points(plan.ends.mean(axis=1))
    return np.asarray(shapely.distance(outline, middle) < reach + MAX_THICKNESS_M)


def outline_only(inputs: Inputs, _size: int, _rng: np.random.Generator) -> Inputs:
    """No inner walls."""
    plan = inputs.floorplan
    keep = outer_faces(plan)
    return inputs.with_faces(plan.ends[keep], plan.normals[keep], plan.is_oriented[keep])


def centre_lines(inputs: Inputs, _size: int, _rng: np.random.Generator) -> Inputs:
    """Each wall with two faces is one line in its middle; which side of it is free is not known."""
    plan, wall_of = inputs.floorplan, walls_of(inputs.floorplan)
    ends = []
    for wall in range(wall_of.max() + 1):
        faces = np.flatnonzero((wall_of == wall) & (plan.lengths > MIN_WALL_M))
        if len(faces) == 0:
            continue
        longest = faces[np.argmax(plan.lengths[faces])]
        normal = plan.normals[longest]
        offsets = (plan.ends[faces].mean(axis=1) - plan.ends[longest, 0]) @ normal
        is_back = plan.normals[faces] @ normal < 0
        back = np.median(offsets[is_back]) if is_back.any() else 0.0
        ends.append(plan.ends[longest] + back / 2 * normal)
    lines = np.array(ends)
    unknown = np.zeros(len(lines), dtype=bool)
    return inputs.with_faces(lines, segments.left_normals(lines), unknown)


def other_building(inputs: Inputs, _size: int, rng: np.random.Generator) -> Inputs:
    """The plan of a building somewhere else, as large as what was scanned, put about the same place."""
    xy = inputs.true_positions()[:, :2]
    area_m2 = float(np.prod(np.ptp(xy, axis=0) + 5.0))
    rooms = int(np.clip(area_m2 / 18, 2, 12))
    side_m = float(np.clip(np.sqrt(area_m2 / rooms), 4.0, 14.0))
    options = BuildingOptions(n_rooms=rooms, room_size_m=(0.8 * side_m, 1.2 * side_m))
    other = make_building(options, rng).floorplan
    middle = 0.5 * (other.ends.min(axis=(0, 1)) + other.ends.max(axis=(0, 1)))
    scanned = (0.5 * (xy.min(axis=0) + xy.max(axis=0))) @ inputs.given_from_true.T
    spoilt = inputs.with_faces(other.ends + scanned - middle, other.normals, other.is_oriented)
    return replace(spoilt, has_place=False)


def other_storey(inputs: Inputs, _size: int, _rng: np.random.Generator) -> Inputs:
    """The same shell with other inner walls: those of this storey, mirrored along its longest outer wall.

    Not turned by half: a shell that is nearly symmetric would show the same storey, in another place.
    """
    plan = inputs.floorplan
    outer = outer_faces(plan)
    ends, normals = plan.ends.copy(), plan.normals.copy()
    if not outer.all():
        middle = 0.5 * (ends.min(axis=(0, 1)) + ends.max(axis=(0, 1)))
        longest = np.flatnonzero(outer)[np.argmax(segments.lengths(ends[outer]))]
        along = np.array([-normals[longest, 1], normals[longest, 0]])
        mirror = np.eye(2) - 2.0 * np.outer(along, along)
        # Other ends first: the wall stays on the same side of its faces.
        ends[~outer] = (ends[~outer][:, ::-1] - middle) @ mirror + middle
        normals[~outer] = normals[~outer] @ mirror
    return inputs.with_faces(ends, normals, plan.is_oriented)


def no_plan(inputs: Inputs, _size: int, _rng: np.random.Generator) -> Inputs:
    """The scan has to agree with itself alone."""
    return replace(inputs, has_plan=False)


_SHARE_WORDS = tuple(f"{share:.0%}" for share in SHARES)
_SCALE_WORDS = tuple(f"{scale:.0%}" for scale in SCALES)

PLANS = (
    Fault("walls missing", "plan", _SHARE_WORDS, missing),
    Fault("walls moved", "plan", _SHARE_WORDS, moved),
    Fault("walls added", "plan", _SHARE_WORDS, added),
    Fault("wing rebuilt", "plan", _SHARE_WORDS, rebuilt),
    Fault("plan too large", "plan", _SCALE_WORDS, too_large),
    Fault("plan too small", "plan", _SCALE_WORDS, too_small),
    Fault("plan mirrored", "plan", ("",), mirrored),
    Fault("outline only", "plan", ("",), outline_only),
    Fault("centre lines", "plan", ("",), centre_lines),
    Fault("other building", "plan", ("first", "second", "third"), other_building),
    Fault("other storey", "plan", ("",), other_storey),
)

NO_PLAN = Fault("no plan", "plan", ("",), no_plan)
"""No fault; for scans that planfit refines without a plan."""

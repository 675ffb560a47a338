"""Scans of buildings whose plan is wrong about doors, and what is true of every door and gap of the plan.

A building is made up and scanned; of its doors, a share is not drawn (broken through since), and as many gaps
are drawn in walls that have none (closed up since). Doors may be shut: a leaf flush with one face of its
wall, through which the walk goes on. What of each the cameras saw is told from depth at the true poses, not
by planfit.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from as_built_cases import Views, made_scan, seen_m, through_m, true_views
from faults.inputs import Inputs
from faults.plans import MAX_THICKNESS_M, walls_of
from faults.scans import keep_images
from jaxtyping import Float

from planfit.floorplan import Floorplan
from planfit.geometry import segments
from planfit.scan import Scan
from planfit.synth import Building, SyntheticScan
from planfit.synth.furniture import Footprint, Piece
from planfit.synth.lookalikes import LEAF_THICKNESS_M
from planfit.synth.mesh import make_lights, make_quads
from planfit.synth.quads import WOOD_COLORS, Box, Material, Rect
from planfit.synth.render import Renderer
from planfit.synth.scan import SynthFiles

UNDRAWN_SHARE = 0.3
"""Of the doors."""
GAP_M, FROM_ENDS_M = (0.7, 1.2), 0.35
"""Widths of gaps that are drawn in walls without one, and how far from the ends of these."""
SEEN_SHARE = 0.5
"""Of a door's width that must have been seen, or looked through, for it to count."""
EDGE_M = 0.1
"""Of its width, at either end, is not looked at."""


@dataclass(frozen=True)
class TrueOpening:
    """A door as built, or a gap as drawn; plan frame, m."""

    ends: Float[np.ndarray, "2 2"]
    """Along the middle of its wall."""
    thickness_m: float
    is_drawn: bool
    is_open: bool
    """As built."""
    is_door: bool
    """Rather than a gap of the plan alone."""
    is_seen: bool
    """By depth at the true poses: looked through, or, of one that is closed, wall seen in it."""


@dataclass(frozen=True)
class OpeningCase:
    """A scan, a plan that is wrong about doors, and the truth."""

    scan: Scan
    plan: Floorplan
    openings: tuple[TrueOpening, ...]
    true_plan_from_cams: Float[np.ndarray, "n 4 4"]


def make_opening_case(
    seed: int,
    folder: Path,
    is_spoilt: bool = True,
    is_shut: bool = False,
    n_rooms: int = 4,
    n_frames: int = 100,
) -> OpeningCase:
    """A furnished building, walked through once, by one of two sensors; images are kept in `folder`. Where
    `is_shut`, every second door is."""
    made = made_scan(seed, n_rooms, n_frames)
    doors, plan, scan = list(made.building.layout.doors), made.floorplan, made.scan
    shut = list(range(0, len(doors), 2)) if is_shut else []
    if shut:
        scan = _shut(made, shut)
    scan = replace(keep_images(scan, folder / "images"), has_labels=False)
    rng = np.random.default_rng([seed, 23])
    undrawn, gaps = [], []
    if is_spoilt:
        n = max(1, round(UNDRAWN_SHARE * len(doors)))
        undrawn = [int(i) for i in rng.permutation(len(doors))[:n]]
        for i in undrawn:
            plan = _closed_in_plan(plan, doors[i].rect)
        for _ in range(n):
            plan, gap = _opened_in_plan(plan, [d.rect for d in doors] + gaps, rng)
            gaps += [gap] if gap is not None else []
    views = true_views(scan, made.true_plan_from_cams)
    openings = [
        _true(door.rect, door.is_across_x, i not in undrawn, i not in shut, True, views)
        for i, door in enumerate(doors)
    ]
    openings += [_true(gap, gap.size[1] > gap.size[0], True, False, False, views) for gap in gaps]
    given = Inputs(scan, made.floorplan, made.true_plan_from_cams, np.eye(4)).with_faces(
        plan.ends, plan.normals, plan.is_oriented
    )
    return OpeningCase(scan, given.floorplan, tuple(openings), made.true_plan_from_cams)


def _shut(made: SyntheticScan[Building], shut: list[int]) -> Scan:
    """The scan of the same building and walk with some of its doors shut."""
    building = made.building
    leaves = []
    for i in shut:
        rect, axis = building.layout.doors[i].rect, 0 if building.layout.doors[i].is_across_x else 1
        low = np.array([rect.x0, rect.y0, 0.01])
        high = np.array([rect.x1, rect.y1, building.options.door_height_m])
        # Flush with one face of the wall or the other.
        if i % 4 < 2:
            high[axis] = low[axis] + LEAF_THICKNESS_M
        else:
            low[axis] = high[axis] - LEAF_THICKNESS_M
        middle, half = (low + high) / 2, (high - low) / 2
        box = Box(
            (-half[0], -half[1], low[2]), (half[0], half[1], high[2]),
            Material.WOOD, WOOD_COLORS[1], Material.CABINET,
        )  # fmt: skip
        footprint = Footprint((float(middle[0]), float(middle[1])), (half[0], half[1]), 0.0)
        leaves.append(Piece(footprint, (box,), building.layout.doors[i].rooms[0], 7919 + i))
    with_leaves = replace(building, furniture=(*building.furniture, *leaves))
    quads = make_quads(with_leaves, np.random.default_rng([made.options.seed, 29]))
    renderer = Renderer(quads, make_lights(building))
    camera = made.scan.cameras[0]
    files = SynthFiles(renderer, camera, made.true_plan_from_cams, made.options)
    return replace(made.scan, files=files, fingerprint=f"{made.scan.fingerprint}-shut")


def _true(
    rect: Rect, is_upright: bool, is_drawn: bool, is_open: bool, is_door: bool, views: Views
) -> TrueOpening:
    (x, y), size = rect.centre, rect.size
    ends = np.array([[x, rect.y0], [x, rect.y1]] if is_upright else [[rect.x0, y], [rect.x1, y]])
    along = segments.directions(ends[None])[0]
    inner = ends + EDGE_M * np.array([along, -along])
    normal, thickness = segments.left_normals(ends[None])[0], float(size.min())
    if is_open:
        seen = through_m(views, inner, normal)
    else:
        sides = [inner + side * thickness / 2 * normal for side in (1, -1)]
        seen = max(seen_m(views, sides[0], normal), seen_m(views, sides[1], -normal))
    is_seen = seen >= SEEN_SHARE * float(np.linalg.norm(inner[1] - inner[0])) - 1e-9
    return TrueOpening(ends, thickness, is_drawn, is_open, is_door, is_seen)


def _closed_in_plan(plan: Floorplan, door: Rect) -> Floorplan:
    """The plan with wall drawn where a door is: its sides gone, the faces beside it joined."""
    corners = np.array(
        [[door.x0, door.y0], [door.x1, door.y0], [door.x1, door.y1], [door.x0, door.y1]]
    )
    at_corner = np.linalg.norm(plan.ends[:, :, None] - corners, axis=-1) < 1e-6  # (f, 2, 4)
    is_side = at_corner.any(axis=2).all(axis=1)
    ends, gone = plan.ends.copy(), is_side.copy()
    touching = np.flatnonzero(at_corner.any(axis=(1, 2)) & ~is_side)
    for i in touching:
        for j in touching:
            if i < j and not gone[j] and plan.normals[i] @ plan.normals[j] > 0.99:
                across = (ends[j] - ends[i, 0]) @ plan.normals[i]
                if np.abs(across).max() < 1e-6:
                    along = segments.directions(ends[i][None])[0]
                    both = np.concatenate([ends[i], ends[j]])
                    at = both @ along
                    ends[i] = both[[np.argmin(at), np.argmax(at)]]
                    gone[j] = True
    return _of(plan, ends[~gone], plan.normals[~gone])


def _opened_in_plan(
    plan: Floorplan, known: list[Rect], rng: np.random.Generator
) -> tuple[Floorplan, Rect | None]:
    """The plan with a gap drawn where a wall is, and the gap; the same plan where no wall has room for it."""
    wall_of = walls_of(plan)
    for wall in rng.permutation(wall_of.max() + 1):
        own = np.flatnonzero((wall_of == wall) & (plan.lengths > 1.0))
        for i in own:
            for j in own:
                back = (plan.ends[j, 0] - plan.ends[i, 0]) @ plan.normals[i]
                is_back = plan.normals[i] @ plan.normals[j] < -0.99 and -MAX_THICKNESS_M < back < 0
                if i == j or not is_back:
                    continue
                along = segments.directions(plan.ends[i][None])[0]
                at_i, at_j = np.sort(plan.ends[i] @ along), np.sort(plan.ends[j] @ along)
                low, high = max(at_i[0], at_j[0]), min(at_i[1], at_j[1])
                width = rng.uniform(*GAP_M)
                if high - low < width + 2 * FROM_ENDS_M:
                    continue
                first = rng.uniform(low + FROM_ENDS_M, high - FROM_ENDS_M - width)
                foot = plan.ends[i, 0] + (first - plan.ends[i, 0] @ along) * along
                hole = np.array([foot, foot + width * along + back * plan.normals[i]])
                rect = Rect(*hole.min(axis=0), *hole.max(axis=0))
                if any(rect.grown(0.3).overlaps(other) for other in known):
                    continue
                return _with_gap(plan, (int(i), int(j)), along, (first, first + width)), rect
    return plan, None


def _with_gap(
    plan: Floorplan,
    faces: tuple[int, int],
    along: Float[np.ndarray, "2"],
    gap: tuple[float, float],
) -> Floorplan:
    kept = ~np.isin(np.arange(len(plan)), faces)
    ends, normals, sides = list(plan.ends[kept]), list(plan.normals[kept]), []
    for face in faces:
        at = plan.ends[face] @ along
        first, last = plan.ends[face][np.argsort(at)]
        edges = [first + (value - first @ along) * along for value in gap]
        ends += [np.array([first, edges[0]]), np.array([edges[1], last])]
        normals += [plan.normals[face]] * 2
        sides.append(edges)
    for k, sign in ((0, 1.0), (1, -1.0)):
        ends.append(np.array([sides[0][k], sides[1][k]]))
        normals.append(sign * along)
    return _of(plan, np.array(ends), np.array(normals))


def _of(
    plan: Floorplan, ends: Float[np.ndarray, "n 2 2"], normals: Float[np.ndarray, "n 2"]
) -> Floorplan:
    return replace(plan, ends=ends, normals=normals, is_oriented=np.ones(len(ends), dtype=bool))

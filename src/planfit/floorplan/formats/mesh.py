"""A plan from a scan that is true: a mesh or a point cloud, projected to the horizontal plane, and straight
faces among its points."""

from pathlib import Path

import numpy as np
import scipy.spatial
import trimesh
from jaxtyping import Bool, Float

from planfit.errors import FloorplanError, told_as
from planfit.floorplan.formats import fingerprint_of
from planfit.floorplan.options import PlanOptions, choose_unit
from planfit.floorplan.types import Floorplan, PlanSource
from planfit.floorplan.vector.line_work import MAX_LINES
from planfit.priors import PATCH_TURN_MOST_DEG, SURFACE_TILT_MOST_DEG, WALL_LENGTH_LEAST_M

N_SAMPLES = 400_000
HALF_BAND_M = 0.35
"""Walls are taken from this far below and above the height of the cut: over tables, under lintels."""
MAX_RISE = np.sin(np.deg2rad(SURFACE_TILT_MOST_DEG.value))
"""Of a wall's normal, out of the horizontal."""
LEAST_UP = np.cos(np.deg2rad(SURFACE_TILT_MOST_DEG.value))
"""Of a floor's."""
DASH_M = 0.02
"""Length of the dash that shows a point of the surface in pictures."""
_NEIGHBOURS = 16
HALF_WIDTH_M = 0.03
"""Points of a line are as near to it, and votes for its offset are counted in steps of this."""
MAX_ANGLE_DEG = PATCH_TURN_MOST_DEG.value
"""Between the normals of a line and of its points."""
MAX_GAP_M = 0.30
"""A line is cut where its points leave more than this."""
MIN_LENGTH_M = WALL_LENGTH_LEAST_M.value
MIN_SHARE = 2e-4
"""Of all points, on the weakest line."""


def read_mesh(path: Path, options: PlanOptions) -> Floorplan:
    """Wall faces of a mesh or point cloud (PLY, OBJ, GLB, STL, OFF), about the height of the cut.

    The vertical axis is the one along which most of the surface lies in a thin layer: the floor. GLB
    has y up by its standard. Up is assumed to be the positive end of the axis; the source says so.

    Raises:
        FloorplanError: it cannot be read, holds no surface, or no upright one at the cut.
    """
    points, normals, is_oriented = _surface(path)
    unit = choose_unit(options.unit, options.metres_per_unit, "m", "assumed")
    points = points * unit.scale
    is_glb = path.suffix.lower() in (".glb", ".gltf")
    axis = 1 if is_glb else _vertical_axis(points, normals)
    horizontal = {0: (1, 2), 1: (0, 2), 2: (0, 1)}[axis]
    # Seen from above, not mirrored: for y up, (x, -z).
    flip = np.array([1.0, -1.0]) if axis == 1 else np.ones(2)
    height = points[:, axis]
    floor = _floor(height, np.abs(normals[:, axis]))
    near = np.abs(height - floor - options.cut_height_m) < HALF_BAND_M
    near &= np.abs(normals[:, axis]) < MAX_RISE
    xy, across = points[near][:, horizontal] * flip, normals[near][:, horizontal] * flip
    ends, across_lines, n_left = wall_lines(xy, across, is_oriented)
    if len(ends) == 0:
        raise FloorplanError(
            f"{path}: expected upright surfaces {options.cut_height_m:g} m above the floor, found "
            f"none with {'xyz'[axis]} up; choose another height of the cut, or turn the model"
        )
    found = "found from the floor's surface, positive end up"
    up = "the standard of the format" if is_glb else found
    rows = np.zeros((3, 3))
    rows[:2, :2] = np.diag(flip / unit.scale)
    rows[2, 2] = 1.0
    return Floorplan(
        str(path), ends, across_lines, np.full(len(ends), is_oriented),
        fingerprint_of(path), is_metric=unit.metres is not None,
        source=PlanSource(
            kind="mesh or point cloud",
            unit=unit.name,
            unit_from=unit.known_from,
            warnings=(f"up is {'xyz'[axis]} ({up}); the floor is at {floor:.2f} m",),
            dropped=(f"{n_left} of {len(xy)} points on no straight wall",),
            file_from_plan=rows,
            drawn_lines=_dashes(xy, across) / unit.scale * flip,
        ),
    )  # fmt: skip


def _dashes(
    xy: Float[np.ndarray, "n 2"], across: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "k 2 2"]:
    """Short dashes along the surface at points, m, a part of them where there are many."""
    step = -(-len(xy) // MAX_LINES)
    xy, across = xy[::step], across[::step]
    along = np.stack([-across[:, 1], across[:, 0]], axis=1)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([xy - 0.5 * DASH_M * along, xy + 0.5 * DASH_M * along], axis=1)


def _surface(path: Path) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], bool]:
    """Points, unit normals, and whether those tell the free side."""
    if path.stat().st_size == 0:
        raise FloorplanError(f"{path}: expected a mesh or a point cloud, found an empty file")
    with told_as(FloorplanError, path, "a mesh or a point cloud"):
        scene = trimesh.load(path, process=False)
        loaded = scene.to_geometry() if isinstance(scene, trimesh.Scene) else scene
        sampled = _sampled(loaded)
    if sampled is not None:
        # Open surfaces are scans, seen from the free side; of solids the outside is free.
        return *sampled, True
    vertices = np.asarray(getattr(loaded, "vertices", np.zeros((0, 3))), dtype=float)
    vertices = vertices[np.isfinite(vertices).all(axis=1)]
    if len(vertices) < 100:
        raise FloorplanError(
            f"{path}: expected a mesh or a point cloud, found {len(vertices)} points"
        )
    if len(vertices) > N_SAMPLES:
        chosen = np.random.default_rng(0).choice(len(vertices), N_SAMPLES, replace=False)
        vertices = vertices[np.sort(chosen)]
    return vertices, _normals(vertices), False


def _sampled(loaded: object) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]] | None:
    """Points spread evenly over the triangles of a mesh, and their normals; None where none has a size."""
    if not isinstance(loaded, trimesh.Trimesh):
        return None
    with np.errstate(invalid="ignore", over="ignore"):
        area = loaded.area_faces
    loaded.update_faces(np.isfinite(area) & (area > 0))
    if not len(loaded.faces):
        return None
    points, face = trimesh.sample.sample_surface(loaded, N_SAMPLES, seed=0)[:2]
    return np.asarray(points), np.asarray(loaded.face_normals)[face]


def _normals(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Unit normals of the planes through each point's neighbours; the sign says nothing."""
    _, idx = scipy.spatial.cKDTree(points).query(points, k=min(_NEIGHBOURS, len(points)))
    offset = points[idx] - points[idx].mean(axis=1, keepdims=True)
    _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", offset, offset))
    return vectors[:, :, 0]


def _vertical_axis(points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> int:
    """Axis with the most surface across it at one height."""
    share = [_histogram(points[:, k], np.abs(normals[:, k]))[0].max() for k in range(3)]
    # Floors are wider than walls are long and high; where they are not, z before y before x.
    return int(np.argmax(np.array(share) * (0.98, 0.99, 1.0)))


def _floor(height: Float[np.ndarray, " n"], level: Float[np.ndarray, " n"]) -> float:
    """Lowest height with much level surface; the ceiling, where scanned, has as much."""
    counts, start, step = _histogram(height, level)
    at = start + (int(np.argmax(counts > 0.5 * counts.max())) + 0.5) * step
    return float(np.median(height[(np.abs(height - at) < 2 * step) & (level > LEAST_UP)]))


def _histogram(
    height: Float[np.ndarray, " n"], level: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " b"], float, float]:
    step, start = 0.05, float(height.min())
    index = np.minimum(((height - start) / step).astype(int), 20_000)
    return np.bincount(index[level > LEAST_UP], minlength=1).astype(float), start, step


def wall_lines(
    xy: Float[np.ndarray, "n 2"], normals: Float[np.ndarray, "n 2"], is_oriented: bool
) -> tuple[Float[np.ndarray, "k 2 2"], Float[np.ndarray, "k 2"], int]:
    """Lines through points, m, with normals, the strongest first, each cut at gaps; their normals, the free
    side on the left where `normals` tell it; and the number of points on none.

    A line is the peak of the points' own votes for its direction and offset, refined by the middle of
    the points within its width. Where `is_oriented`, the two faces of a thin wall are apart by
    the sign of their normals.
    """
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    period = 360.0 if is_oriented else 180.0
    free = np.arange(len(xy))
    ends, chosen = [], []
    min_votes = max(20.0, MIN_SHARE * len(xy))
    for _ in range(2000):
        if len(free) < min_votes:
            break
        normal, offset, votes = _strongest(xy[free], normals[free], period)
        if votes < min_votes:
            break
        normal, offset = _refined(xy[free], normals[free], normal, offset, is_oriented)
        on = _on_line(xy[free], normals[free], normal, offset, is_oriented)
        if not on.any():
            break
        along = np.array([normal[1], -normal[0]])  # the free side is on its left
        at = np.sort(xy[free[on]] @ along)
        for low, high in _runs(at):
            if high - low >= MIN_LENGTH_M:
                ends.append(offset * normal + np.outer([low, high], along))
                chosen.append(normal)
        free = free[~on]
    return np.array(ends).reshape(-1, 2, 2), np.array(chosen).reshape(-1, 2), len(free)


def _strongest(
    xy: Float[np.ndarray, "n 2"], normals: Float[np.ndarray, "n 2"], period: float
) -> tuple[Float[np.ndarray, "2"], float, float]:
    angle = np.rad2deg(np.arctan2(normals[:, 1], normals[:, 0])) % period
    n = int(period)
    counts = np.bincount(angle.astype(int), minlength=n)[:n]
    # Directions are few; the best one, to a degree, by its best line, among the five with most points.
    smooth = counts + np.roll(counts, 1) + np.roll(counts, -1)
    best = (np.array([1.0, 0.0]), 0.0, 0.0)
    for step in np.argsort(-smooth)[:5]:
        direction = np.deg2rad(step + 0.5)
        normal = np.array([np.cos(direction), np.sin(direction)])
        away = np.abs((angle - (step + 0.5) + period / 2) % period - period / 2)
        offset = (xy @ normal)[away < MAX_ANGLE_DEG]
        if len(offset) == 0:
            continue
        low = offset.min()
        votes = np.bincount(((offset - low) / HALF_WIDTH_M).astype(int))
        if votes.max() > best[2]:
            best = (normal, float(low + (votes.argmax() + 0.5) * HALF_WIDTH_M), float(votes.max()))
    return best


def _refined(
    xy: Float[np.ndarray, "n 2"],
    normals: Float[np.ndarray, "n 2"],
    normal: Float[np.ndarray, "2"],
    offset: float,
    is_oriented: bool,
) -> tuple[Float[np.ndarray, "2"], float]:
    for _ in range(5):
        on = _on_line(xy, normals, normal, offset, is_oriented)
        if on.sum() < 3:
            break
        middle = xy[on].mean(axis=0)
        _, vectors = np.linalg.eigh(np.cov((xy[on] - middle).T))
        across = vectors[:, 0] * (1.0 if vectors[:, 0] @ normal > 0 else -1.0)
        if across @ normal < np.cos(np.deg2rad(MAX_ANGLE_DEG)):
            break
        normal, offset = across, float(middle @ across)
    return normal, offset


def _on_line(
    xy: Float[np.ndarray, "n 2"],
    normals: Float[np.ndarray, "n 2"],
    normal: Float[np.ndarray, "2"],
    offset: float,
    is_oriented: bool,
) -> Bool[np.ndarray, " n"]:
    facing = normals @ normal
    facing = facing if is_oriented else np.abs(facing)
    is_near = np.abs(xy @ normal - offset) < HALF_WIDTH_M
    return is_near & (facing > np.cos(np.deg2rad(MAX_ANGLE_DEG)))


def _runs(at: Float[np.ndarray, " n"]) -> list[tuple[float, float]]:
    """Intervals of sorted coordinates without a gap of more than `MAX_GAP_M`."""
    runs = np.split(at, np.flatnonzero(np.diff(at) > MAX_GAP_M) + 1)
    return [(float(run[0]), float(run[-1])) for run in runs]

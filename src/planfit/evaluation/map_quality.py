"""Map quality without a truth, by points of each depth map, one a voxel, the same for all poses compared:
mean map entropy (MME), mean plane variance (MPV), and the mutually orthogonal metric (MOM): how thick the map
is on three planes that each depth map itself shows."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float, Int
from scipy.cluster.hierarchy import fcluster, linkage

from planfit.errors import require_positive
from planfit.evaluation.neighbour_kernels import smallest_eigenvalues
from planfit.evaluation.neighbourhoods import as_matrices, covariances, each_block, make_grid
from planfit.geometry import se3
from planfit.priors import DEPTH_REACH_M
from planfit.runtime import Arrays, Runtime, cache_key
from planfit.scan import Scan

DEPTH_RADIUS_M = 0.2
"""Neighbourhood for depth cameras, as in the published library; 1.0 for LiDAR."""
MIN_NEIGHBOURS = 6
"""Neighbours, the point included, from which on a point counts: more than five."""
_FLAT = 1e-14
"""A determinant below this times the cube of the trace is zero but for rounding: a depth off by 1 mm in 0.2 m
leaves 1e-8."""


@dataclass(frozen=True)
class MapQuality:
    """Sharpness of a map; lower is better. Depends on the sampling and the radius: compare only like with
    like."""

    mme: float
    """Mean over points of 0.5 ln det(2 pi e C), C the covariance of the neighbourhood (m^2); NaN where no
    point has enough neighbours around it."""
    mpv_m2: float
    """Mean over points of the smallest eigenvalue of C; NaN likewise."""
    plane_variance_m2: Float[np.ndarray, " m"]
    """Smallest eigenvalue at each point, NaN where it has fewer than two neighbours."""
    n_neighbours: Int[np.ndarray, " m"]
    """Within the radius, the point included."""


def map_quality(
    points: Float[np.ndarray, "m 3"], radius_m: float = DEPTH_RADIUS_M, workers: int = 1
) -> MapQuality:
    """MME and MPV of points (m), and the plane variance at every point.

    Raises:
        OptionError: the radius is not above 0, or a few points are far away from all others.
    """
    variance = np.full(len(points), np.nan, dtype=np.float32)
    n_neighbours = np.zeros(len(points), dtype=np.int32)
    sums = np.zeros(4)
    for idx, counts, smallest, block_sums in each_block(
        make_grid(points, radius_m), _block, workers
    ):
        n_neighbours[idx] = counts
        variance[idx] = smallest
        sums += block_sums
    entropy_sum, n_entropy, variance_sum, n_variance = (float(v) for v in sums)
    constant = 1.5 * np.log(2 * np.pi * np.e)  # det(2 pi e C) = (2 pi e)^3 det C
    return MapQuality(
        mme=entropy_sum / n_entropy + constant if n_entropy else np.nan,
        mpv_m2=variance_sum / n_variance if n_variance else np.nan,
        plane_variance_m2=variance,
        n_neighbours=n_neighbours,
    )


def _block(
    idx: np.ndarray, counts: np.ndarray, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Index, neighbours and plane variance of the points of a block; sum and number of both means."""
    smallest = np.zeros(len(idx))
    smallest_eigenvalues(covariance, smallest)
    enough = counts >= MIN_NEIGHBOURS
    determinant, trace = _determinants(covariance[enough])
    is_solid = determinant > _FLAT * trace**3
    sums = np.array(
        [
            np.sum(0.5 * np.log(determinant[is_solid])),
            is_solid.sum(),
            smallest[enough].sum(),
            enough.sum(),
        ]
    )
    return idx, counts, np.where(counts >= 2, smallest, np.nan), sums


def _determinants(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Determinants and traces (m,) of symmetric matrices by their six entries (m, 6)."""
    a, b, c, d, e, f = covariance.T  # xx xy xz yy yz zz; expanded along the first row
    return a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d), a + d + f


STRIDE_PX = 2
"""One pixel in this many, each way, is read."""


@dataclass(frozen=True)
class MapOptions:
    """What the map is made of. MME, MPV and MOM depend on all of it: compare only what was made alike."""

    voxel_m: float = 0.05
    """Each depth map is thinned to one point a cube of this size, their mean, in its camera's frame: before
    any poses are applied, so that all poses are judged by the same points."""
    radius_m: float = DEPTH_RADIUS_M
    """Neighbourhood; 0.2 for depth cameras, 1.0 for LiDAR."""
    max_depth_m: float = DEPTH_REACH_M.value
    """Depth measurements beyond are dropped."""
    frame_step: int = 1
    """One frame in this many is read."""

    def __post_init__(self) -> None:
        require_positive(self, "voxel_m", "radius_m", "max_depth_m", "frame_step")


@dataclass(frozen=True)
class MapSample:
    """Points in camera frames; frame i has points start[i]:start[i + 1], many or none."""

    points_cam: Float[np.ndarray, "m 3"]
    """m; single precision."""
    start: Int[np.ndarray, " starts"]

    def of_frame(self, i: int) -> Float[np.ndarray, "k 3"]:
        """Points (m) of frame i, camera frame."""
        return self.points_cam[self.start[i] : self.start[i + 1]]

    def at(self, target_from_cams: Float[np.ndarray, "n 4 4"]) -> Float[np.ndarray, "m 3"]:
        """All points (m) in the target frame."""
        frame_idx = np.repeat(np.arange(len(target_from_cams)), np.diff(self.start))
        return se3.transform_indexed(target_from_cams, frame_idx, self.points_cam)


def sample_depth_maps(scan: Scan, options: MapOptions, runtime: Runtime) -> MapSample:
    """Read and thin the depth maps of a scan.

    Raises:
        ScanError: a depth image cannot be used.
    """
    read = range(0, len(scan), options.frame_step)
    how = (options.voxel_m, options.max_depth_m, STRIDE_PX)
    key = cache_key(scan.fingerprint, "map sample", *how, options.frame_step)
    compute = partial(_sample, scan, options)
    items = runtime.map("depth maps", key, len(read), lambda k: compute(read[k]))
    sizes = np.zeros(len(scan), dtype=int)
    sizes[read] = [len(item["points"]) for item in items]
    points = np.concatenate([item["points"] for item in items])
    return MapSample(points, np.concatenate([[0], np.cumsum(sizes)]))


def thin(points: Float[np.ndarray, "m 3"], voxel_m: float) -> Float[np.ndarray, "v 3"]:
    """Mean of the points (m) in each cube of the grid through the origin; ordered by cube."""
    if len(points) == 0:
        return points
    cube = np.floor(points / voxel_m).astype(np.int64)
    cube -= cube.min(axis=0)
    _, ny, nz = (int(v) + 1 for v in cube.max(axis=0))
    # One integer a cube; sorted by it, the points of a cube follow each other and reduceat adds them.
    key = (cube[:, 0] * ny + cube[:, 1]) * nz + cube[:, 2]
    order = np.argsort(key, kind="stable")
    _, start, sizes = np.unique(key[order], return_index=True, return_counts=True)
    return np.add.reduceat(points[order], start, axis=0) / sizes[:, None]


def _sample(scan: Scan, options: MapOptions, i: int) -> Arrays:
    step = STRIDE_PX
    depth = scan.files.depth(i)[::step, ::step]
    with np.errstate(invalid="ignore"):
        rows, columns = np.nonzero(depth < options.max_depth_m)
    uv = np.stack([columns, rows], axis=1) * float(step)
    points = scan.cameras[i].lift(uv, depth[rows, columns])
    return {"points": thin(points, options.voxel_m).astype(np.float32)}


_PLANAR = 100.0
"""A point is planar where its smallest eigenvalue is below the middle one by this factor."""
_MAX_DIFFERENCE = 0.1
"""Normals of one cluster differ by at most this (complete linkage); the cosine of orthogonal ones is
smaller."""
_PLANE_NEIGHBOURS = 4
_CLUSTER_POINTS = 6
_MAX_CLUSTERED = 1500
"""Planar points of a depth map that are clustered, evenly thinned: clustering takes their square in
memory."""


@dataclass(frozen=True)
class OrthogonalSets:
    """Points on three mutually orthogonal planes of a depth map, as indices into a `MapSample`."""

    frame_idx: int
    sets: tuple[Int[np.ndarray, " a"], Int[np.ndarray, " b"], Int[np.ndarray, " c"]]


def find_orthogonal_sets(
    sample: MapSample, radius_m: float, max_frames: int
) -> tuple[OrthogonalSets, ...]:
    """Orthogonal planes of some depth maps, evenly spread; poses play no part.

    Depth maps that show no three orthogonal planes are left out.
    """
    filled = np.flatnonzero(np.diff(sample.start))
    chosen = filled[np.linspace(0, len(filled) - 1, min(max_frames, len(filled))).astype(int)]
    found = []
    for i in chosen.tolist():
        triple = orthogonal_triple(sample.of_frame(i).astype(float), radius_m)
        if triple is not None:
            first, second, third = (idx + sample.start[i] for idx in triple)
            found.append(OrthogonalSets(i, (first, second, third)))
    return tuple(found)


def orthogonal_triple(
    points_cam: Float[np.ndarray, "m 3"], radius_m: float
) -> tuple[Int[np.ndarray, " a"], Int[np.ndarray, " b"], Int[np.ndarray, " c"]] | None:
    """Indices of points (m), camera frame, in the three orthogonal clusters with the most points."""
    idx, normals = planar_normals(points_cam, radius_m)
    step = max(1, -(-len(idx) // _MAX_CLUSTERED))
    idx, normals = idx[::step], normals[::step]
    if len(idx) < 3 * _CLUSTER_POINTS:
        return None
    labels = fcluster(linkage(normals, "complete"), _MAX_DIFFERENCE, criterion="distance")
    sizes = np.bincount(labels)
    kept = np.flatnonzero(sizes >= _CLUSTER_POINTS)
    means = (
        np.stack([normals[labels == k].mean(axis=0) for k in kept]) if len(kept) else normals[:0]
    )
    means /= np.linalg.norm(means, axis=1, keepdims=True)
    best = _largest_triple(np.abs(means @ means.T) < _MAX_DIFFERENCE, sizes[kept])
    if best is None:
        return None
    first, second, third = (idx[labels == kept[k]] for k in best)
    return first, second, third


def planar_normals(
    points_cam: Float[np.ndarray, "m 3"], radius_m: float
) -> tuple[Int[np.ndarray, " p"], Float[np.ndarray, "p 3"]]:
    """Index of the planar points among points (m), and their unit normals towards the camera."""
    counts = np.zeros(len(points_cam), dtype=int)
    covariance = np.zeros((len(points_cam), 6))
    for idx, n, found in covariances(make_grid(points_cam, radius_m)):
        counts[idx], covariance[idx] = n, found
    values, vectors = np.linalg.eigh(as_matrices(covariance))
    is_planar = (counts >= _PLANE_NEIGHBOURS) & (_PLANAR * values[:, 0] < values[:, 1])
    idx = np.flatnonzero(is_planar)
    normals = vectors[idx, :, 0]
    faces_away = np.einsum("ni,ni->n", normals, points_cam[idx]) > 0
    return idx, np.where(faces_away[:, None], -normals, normals)


def mom_m2(sets: tuple[OrthogonalSets, ...], quality: MapQuality) -> float:
    """MOM: mean over depth maps of the sum over three planes of the median plane variance in the map.

    Args:
        sets: of depth maps of the sample.
        quality: of the map made of the whole sample, its points in their order.

    Returns:
        m^2; NaN where no depth map shows three orthogonal planes.
    """
    sums = []
    for of_frame in sets:
        medians = []
        for idx in of_frame.sets:
            idx = idx[quality.n_neighbours[idx] >= _PLANE_NEIGHBOURS]
            if len(idx):
                medians.append(float(np.median(quality.plane_variance_m2[idx])))
        if len(medians) == 3:
            sums.append(sum(medians))
    return float(np.mean(sums)) if sums else np.nan


def _largest_triple(is_orthogonal: np.ndarray, sizes: np.ndarray) -> tuple[int, int, int] | None:
    """Three clusters, each orthogonal to the others, with the most points; the first of equals."""
    best, most = None, 0
    # k < j < i, so that each triple is looked at once.
    for i in range(len(sizes)):
        for j in np.flatnonzero(is_orthogonal[i, : i + 1]):
            common = np.flatnonzero(is_orthogonal[i, :j] & is_orthogonal[j, :j])
            if len(common) == 0:
                continue
            k = common[np.argmax(sizes[common])]
            total = int(sizes[i] + sizes[j] + sizes[k])
            if total > most:
                best, most = (int(k), int(j), i), total
    return best

"""Frames matched by their surfaces: neighbours and revisits of frames with few matched keypoints."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from planfit.geometry import se3
from planfit.geometry.calibration import PARAMETERS
from planfit.matching.cycles import by_way_of
from planfit.matching.options import MatchingOptions
from planfit.matching.pairs import choose_pairs
from planfit.matching.surfaces.grids import SurfaceGrids, find_surface_grids
from planfit.matching.surfaces.options import SurfaceOptions
from planfit.matching.surfaces.register import Registered, observe, register, starts_about
from planfit.matching.surfaces.types import NULL_SHARE, SurfacePairs
from planfit.matching.types import RelativePoses
from planfit.runtime import Arrays, Runtime, cache_key
from planfit.scan import Scan
from planfit.scan.odometry import Odometry

MAX_USUAL = 0.15
"""Depth that contradicts itself by more than this between neighbours tells nothing of revisits."""
LINK_M = 1.5
"""Revisits whose ends are both within this much of way are of one visit."""
SLACK_M = 0.15
"""Departure, rotations by their lever, up to which two revisits of one visit agree, besides their sigmas."""

ALIAS_SHARE = 0.15
"""Of a quarter turn: motions off the recorded ones by so nearly one, two or three of them are an alias."""


@dataclass(frozen=True)
class SurfaceMotions:
    """Motions between neighbouring frames by their surfaces, and what is needed to look for revisits."""

    is_poor: Bool[np.ndarray, " n"]
    """Frames with few matched keypoints."""
    grids: SurfaceGrids
    """Of these."""
    neighbours: SurfacePairs
    max_contradicted: float
    """As the neighbours show it for this sensor."""


def poor_frames(
    n: int, matched: RelativePoses, options: MatchingOptions, has_color: bool = True
) -> Bool[np.ndarray, " n"]:
    """Frames whose keypoints match those of no neighbour well; all or none where the options say so.

    Args:
        n: frames.
        matched: verified by keypoints.
        options: `surfaces` says which frames.
        has_color: whether the scan has colour.
    """
    use = options.surfaces.use
    if use == "without_colour":
        use = "never" if has_color else "few"
    if use != "few":
        return np.full(n, use == "always")
    pairs = matched.pairs
    is_near = pairs[:, 1] - pairs[:, 0] <= options.pairs.neighbours
    most = np.zeros(n, dtype=int)
    for side in (0, 1):
        np.maximum.at(most, pairs[is_near, side], matched.n_inliers[is_near])
    return most < options.surfaces.few_matches


def measure_surface_neighbours(
    scan: Scan,
    matched: RelativePoses,
    odometry: Odometry,
    options: MatchingOptions,
    runtime: Runtime,
) -> SurfaceMotions:
    """Match frames with few matched keypoints with those that follow them, by their surfaces.

    The motion is sought from none at all, and from the recorded one: what explains more counts, so that
    recorded poses of another convention have little say. A motion that they contradict needs two others that
    close a triangle with it, and may not be off by quarter turns: one corner of a room is like the next.

    Args:
        scan: its depth is read.
        matched: what keypoints verified.
        odometry: of the recorded poses, and how far they may be off.
        options: `surfaces` and `pairs`.
        runtime: threads, cache and progress.

    Raises:
        ScanError: a depth image cannot be read.
    """
    n, surfaces = len(scan), options.surfaces
    is_poor = poor_frames(n, matched, options, scan.has_color)
    # A poor frame's neighbours are looked at too: they are its way to the others.
    near = is_poor.copy()
    for k in range(1, surfaces.neighbours + 1):
        near[k:] |= is_poor[:-k]
        near[:-k] |= is_poor[k:]
    grids = find_surface_grids(scan, np.flatnonzero(near), surfaces.max_depth_m, runtime)
    pairs = (
        np.array(
            [
                (i, i + k)
                for i in range(n)
                for k in range(1, surfaces.neighbours + 1)
                if i + k < n and (is_poor[i] or is_poor[i + k])
            ]
        )
        .reshape(-1, 2)
        .astype(int)
    )
    recorded = se3.inverse(scan.world_from_cams[pairs[:, 0]]) @ scan.world_from_cams[pairs[:, 1]]

    def one(k: int) -> Arrays:
        i, j = (int(v) for v in pairs[k])
        starts = np.stack([np.eye(4), recorded[k]])
        found = register(grids, i, j, starts, surfaces)
        return _as_arrays(grids, (i, j), found, surfaces)

    key = cache_key(
        scan.fingerprint, "neighbours by surfaces", surfaces, pairs.tobytes(), recorded.tobytes()
    )
    items = runtime.map("surface neighbours", key, len(pairs), one, chunk_size=64)
    found, contradicted, _ = _gathered(pairs, items)
    is_alike = found.explained >= surfaces.min_overlap
    usual = float(np.median(contradicted[is_alike])) if is_alike.any() else 0.0
    most = min(max(surfaces.max_contradicted, surfaces.usual_factor * usual), MAX_USUAL)
    found = found[is_alike & (contradicted <= most)]
    return SurfaceMotions(
        is_poor, grids, found[_is_witnessed(found, scan, odometry, options)], most
    )


def find_surface_pairs(
    scan: Scan,
    odometry: Odometry,
    up_world: Float[np.ndarray, "3"],
    known: SurfaceMotions,
    options: MatchingOptions,
    runtime: Runtime,
) -> SurfacePairs:
    """The neighbours that are known, and revisits, verified.

    Args:
        scan: its poses say which frames may have seen the same.
        odometry: how far they may be off.
        up_world: unit vector against gravity.
        known: see `measure_surface_neighbours`.
        options: `surfaces`, `pairs` and `cycle_consistency`.
        runtime: threads, cache and progress.
    """
    if not known.is_poor.any():  # or all revisits would be chosen, to be left out
        return known.neighbours
    surfaces, poses = options.surfaces, scan.world_from_cams
    chosen = replace(options.pairs, loops_per_frame=surfaces.loops_per_frame)
    pairs = choose_pairs(poses, odometry, chosen)
    i, j = pairs.T
    is_loop = (j - i > options.pairs.neighbours) & known.is_poor[i] & known.is_poor[j]
    pairs = pairs[is_loop]
    neighbours = _possible(known.neighbours, scan, odometry, options)
    if len(pairs) == 0:
        return neighbours
    compute = partial(_loop, known.grids, poses, pairs, odometry, up_world, surfaces)
    key = cache_key(
        scan.fingerprint, "revisits by surfaces", surfaces, pairs.tobytes(), poses.tobytes(),
        up_world, odometry.sigma_rotation.tobytes(), odometry.sigma_translation.tobytes(),
    )  # fmt: skip
    items = runtime.map("surface revisits", key, len(pairs), compute, chunk_size=16)
    found, contradicted, rivals = _gathered(pairs, items)
    believed = (
        (found.explained >= surfaces.min_overlap)
        & (contradicted <= known.max_contradicted)
        & (rivals <= surfaces.max_rival)
    )
    loops = _possible(found[believed], scan, odometry, options)
    return neighbours.joined(loops[_supported(loops, poses, odometry)])


def _loop(
    grids: SurfaceGrids,
    poses: np.ndarray,
    pairs: np.ndarray,
    odometry: Odometry,
    up_world: np.ndarray,
    options: SurfaceOptions,
    k: int,
) -> Arrays:
    """A revisit, sought from all that the drift allows."""
    i, j = (int(v) for v in pairs[k])
    predicted = se3.inverse(poses[i]) @ poses[j]
    rotation, translation = odometry.sigma_between(pairs[k : k + 1, 0], pairs[k : k + 1, 1])
    up = poses[i, :3, :3].T @ up_world
    starts = starts_about(predicted, up, float(rotation[0]), float(translation[0]))
    return _as_arrays(grids, (i, j), register(grids, i, j, starts, options), options)


def _as_arrays(
    grids: SurfaceGrids, pair: tuple[int, int], found: list[Registered], options: SurfaceOptions
) -> Arrays:
    """What is kept of a pair: the best motion, its information, and how near the next one comes."""
    if not found:
        return {"a_from_b": np.zeros((0, 4, 4))}
    best = found[0]
    seen = observe(grids, *pair, best.a_from_b, options)
    rival = found[1].explained / max(best.explained, 1e-9) if len(found) > 1 else 0.0
    return {
        "a_from_b": best.a_from_b[None],
        "information": seen.information,
        "by_sensor": seen.by_sensor,
        "judged": np.array([best.explained, best.contradicted, rival, seen.distance_m]),
    }


def _gathered(
    pairs: np.ndarray, items: list[Arrays]
) -> tuple[SurfacePairs, Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
    """Pairs that were brought together, what contradicts each, and how near its rival comes."""
    some = [k for k, item in enumerate(items) if len(item["a_from_b"])]
    judged = np.array([items[k]["judged"] for k in some]).reshape(-1, 4)
    found = SurfacePairs(
        pairs[some],
        np.array([items[k]["a_from_b"][0] for k in some]).reshape(-1, 4, 4),
        np.array([items[k]["information"] for k in some]).reshape(-1, 6, 6),
        judged[:, 0],
        np.array([items[k]["by_sensor"] for k in some]).reshape(-1, 6, len(PARAMETERS)),
        judged[:, 3],
    )
    return found, judged[:, 1], judged[:, 2]


def _possible(
    found: SurfacePairs, scan: Scan, odometry: Odometry, options: MatchingOptions
) -> SurfacePairs:
    """Those that drift can explain, in what they observe."""
    i, j = found.pairs.T
    predicted = se3.inverse(scan.world_from_cams[i]) @ scan.world_from_cams[j]
    sigmas = odometry.sigma_between(i, j)
    most = options.cycle_consistency.max_sigmas**2
    return found[_squared_sigmas(found, predicted, sigmas) < most]


def _squared_sigmas(
    found: SurfacePairs,
    predicted: Float[np.ndarray, "p 4 4"],
    sigmas: tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]],
) -> Float[np.ndarray, " p"]:
    """Squared norms of departures from predicted motions, in what each pair observes.

    With information W = L L^T, L (6, rank): L^T d is of unit covariance, besides L^T C L of the predicted.
    """
    off = se3.difference(predicted, found.a_from_b)
    result = np.zeros(len(found))
    for k, information in enumerate(found.information):
        values, vectors = np.linalg.eigh(information)
        is_held = values > NULL_SHARE * values[-1]
        factor = vectors[:, is_held] * np.sqrt(values[is_held])
        variances = np.repeat([sigmas[0][k] ** 2, sigmas[1][k] ** 2], 3)
        total = factor.T @ (variances[:, None] * factor) + np.eye(factor.shape[1])
        scaled = factor.T @ off[k]
        result[k] = scaled @ np.linalg.solve(total, scaled)
    return result


def _is_witnessed(
    found: SurfacePairs, scan: Scan, odometry: Odometry, options: MatchingOptions
) -> Bool[np.ndarray, " p"]:
    """Neighbours that agree with the recorded motion, or with two others by way of a third frame."""
    i, j = found.pairs.T
    recorded = se3.inverse(scan.world_from_cams[i]) @ scan.world_from_cams[j]
    most = options.cycle_consistency.max_sigmas**2
    is_recorded = _squared_sigmas(found, recorded, odometry.sigma_between(i, j)) < most
    motions = {(int(a), int(b)): found.a_from_b[k] for k, (a, b) in enumerate(found.pairs)}
    motions |= {(b, a): se3.inverse(m) for (a, b), m in motions.items()}
    near: dict[int, list[int]] = {}
    for a, b in motions:
        near.setdefault(a, []).append(b)
    sigmas = (np.array([SLACK_M / 3.0]), np.array([SLACK_M]))
    off = np.swapaxes(recorded[:, :3, :3], 1, 2) @ found.a_from_b[:, :3, :3]
    quarters = np.rad2deg(se3.rotation_angle(off)) / 90.0
    is_alias = (np.rint(quarters) > 0) & (np.abs(quarters - np.rint(quarters)) < ALIAS_SHARE)
    for k in np.flatnonzero(~is_recorded & ~is_alias):
        a, b = (int(v) for v in found.pairs[k])
        for c in near[a]:
            if (c, b) in motions and not is_recorded[k]:
                by_c = (motions[a, c] @ motions[c, b])[None]
                is_recorded[k] = _squared_sigmas(found[np.array([k])], by_c, sigmas)[0] < 9.0
    return is_recorded


def _supported(
    loops: SurfacePairs, poses: Float[np.ndarray, "n 4 4"], odometry: Odometry
) -> Bool[np.ndarray, " p"]:
    """Revisits that another one of the same visit agrees with: a false one seldom finds its like."""
    if len(loops) == 0:
        return np.zeros(0, dtype=bool)
    walked = odometry.walked_m[loops.pairs]
    links = cKDTree(walked).query_pairs(LINK_M, p=np.inf, output_type="ndarray")
    as_poses = RelativePoses(loops.pairs, loops.a_from_b, np.zeros(len(loops), int))
    is_supported = np.zeros(len(loops), dtype=bool)
    for one, other in (links.T, links.T[::-1]):
        predicted = by_way_of(as_poses[other], loops.pairs[one], poses)
        first = odometry.sigma_between(loops.pairs[one, 0], loops.pairs[other, 0])
        second = odometry.sigma_between(loops.pairs[other, 1], loops.pairs[one, 1])
        sigmas = (
            np.hypot(np.hypot(first[0], second[0]), SLACK_M / 3.0),
            np.hypot(np.hypot(first[1], second[1]), SLACK_M),
        )
        agrees = _squared_sigmas(loops[one], predicted, sigmas) < 9.0
        is_supported[one[agrees]] = True
    return is_supported

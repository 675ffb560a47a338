"""Frames matched by their surfaces: neighbours and revisits of frames with few matched keypoints."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Bool, Float

from planfit.geometry import se3
from planfit.geometry.calibration import PARAMETERS
from planfit.geometry.se3 import Poses
from planfit.matching.cycles import MAX_SIGMAS, spanned_steps
from planfit.matching.options import MatchingOptions
from planfit.matching.pairs import choose_pairs
from planfit.matching.surfaces.grids import SurfaceGrids, find_surface_grids
from planfit.matching.surfaces.register import Registered, observe, register, starts_about
from planfit.matching.surfaces.types import SurfacePairs
from planfit.matching.surfaces.witnesses import is_supported, is_witnessed, squared_sigmas
from planfit.matching.types import RelativePoses
from planfit.priors import CLEAR_ODDS
from planfit.runtime import Arrays, Runtime, cache_key
from planfit.scan import Scan
from planfit.scan.odometry import Odometry

FEW_MATCHES = 25
"""A frame has few matched keypoints where those that match its neighbours' are fewer."""
NEIGHBOURS = 3
"""Each such frame is matched with this many that follow it."""
MIN_OVERLAP = 0.2
"""Share of both views whose surfaces must agree."""
MAX_CONTRADICTED = 0.04
"""Share of what both frames could see at which one looks past a surface of the other, up to which a pair is
believed where depth is exact."""
USUAL_FACTOR = 2.0
"""The same as a multiple of what is usual between neighbours, where depth is not exact."""
PLAIN = 0.95
"""Where this share of what both see agrees from the recorded motion on, no other one is tried."""
MAX_USUAL = 0.15
"""Depth that contradicts itself by more than this between neighbours tells nothing of revisits."""


@dataclass(frozen=True)
class SurfaceMotions:
    """Motions between neighbouring frames by their surfaces, and what is needed to look for revisits."""

    is_poor: Bool[np.ndarray, " n"]
    """Frames with few matched keypoints, at least to one side."""
    grids: SurfaceGrids
    """Of these."""
    neighbours: SurfacePairs
    max_contradicted: float
    """As the neighbours show it for this sensor."""


def poor_frames(
    n: int, matched: RelativePoses, options: MatchingOptions, has_color: bool = True
) -> Bool[np.ndarray, " n"]:
    """Frames whose keypoints match those of no neighbour well, or of none before or after them.

    All or none where the options say so.

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
    is_good = matched.n_inliers >= FEW_MATCHES
    most = np.zeros(n, dtype=int)
    for side in (0, 1):
        np.maximum.at(most, pairs[is_near, side], matched.n_inliers[is_near])
    is_poor = most < FEW_MATCHES
    # Both frames of a step that no good pair spans: each may match what is on its own side.
    is_open = ~spanned_steps(pairs[is_near & is_good], n - 1)
    is_poor[:-1] |= is_open
    is_poor[1:] |= is_open
    return is_poor


def measure_surface_neighbours(
    scan: Scan,
    matched: RelativePoses,
    odometry: Odometry,
    options: MatchingOptions,
    runtime: Runtime,
) -> SurfaceMotions:
    """Match frames with few matched keypoints with those that follow them, by their surfaces.

    The motion is sought from none at all, from the recorded one, and from those before and after it: what
    agrees best where both see counts, so that jumps, or poses of another convention, have little say. A
    motion that they contradict needs two others that close a triangle with it, and may not be off by quarter
    turns: one corner of a room is like the next.

    Args:
        matched: what keypoints verified.
        odometry: of the recorded poses, and how far they may be off.
        options: `surfaces` and `pairs`.

    Raises:
        ScanError: a depth image cannot be read.
    """
    n, surfaces = len(scan), options.surfaces
    is_poor = poor_frames(n, matched, options, scan.has_color)
    # A poor frame's neighbours are looked at too: they are its way to the others.
    near = is_poor.copy()
    for k in range(1, NEIGHBOURS + 1):
        near[k:] |= is_poor[:-k]
        near[:-k] |= is_poor[k:]
    grids = find_surface_grids(scan, np.flatnonzero(near), surfaces.max_depth_m, runtime)
    pairs = (
        np.array(
            [
                (i, i + k)
                for i in range(n)
                for k in range(1, NEIGHBOURS + 1)
                if i + k < n and (is_poor[i] or is_poor[i + k])
            ]
        )
        .reshape(-1, 2)
        .astype(int)
    )

    def by_agreement(one: Registered) -> float:
        # Not what is explained: a camera that walked on shares less with its own view than one that stood.
        return one.agreement

    def one(k: int) -> Arrays:
        i, j = (int(v) for v in pairs[k])
        starts = _neighbour_starts(scan.world_from_cams, i, j)
        found = register(grids, i, j, starts[:1], by_agreement)
        if not found or by_agreement(found[0]) < PLAIN:
            found = register(grids, i, j, starts, by_agreement)
        return _as_arrays(grids, (i, j), found, by_agreement)

    key = cache_key(
        scan.fingerprint,
        "neighbours by surfaces",
        surfaces,
        pairs.tobytes(),
        scan.world_from_cams.tobytes(),
    )
    items = runtime.map("surface neighbours", key, len(pairs), one, chunk_size=64)
    found, contradicted, _ = _gathered(pairs, items)
    is_alike = found.explained >= MIN_OVERLAP
    usual = float(np.median(contradicted[is_alike])) if is_alike.any() else 0.0
    most = min(max(MAX_CONTRADICTED, USUAL_FACTOR * usual), MAX_USUAL)
    found = found[is_alike & (contradicted <= most)]
    return SurfaceMotions(
        is_poor,
        grids,
        found[is_witnessed(found, matched, scan.world_from_cams, odometry)],
        most,
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
        up_world: unit vector against gravity.
        known: see `measure_surface_neighbours`.
    """
    if not known.is_poor.any():  # or all revisits would be chosen, to be left out
        return known.neighbours
    poses = scan.world_from_cams
    pairs = choose_pairs(poses, odometry, options.pairs)
    i, j = pairs.T
    is_loop = (j - i > options.pairs.neighbours) & known.is_poor[i] & known.is_poor[j]
    pairs = pairs[is_loop]
    neighbours = _possible(known.neighbours, scan, odometry)
    if len(pairs) == 0:
        return neighbours
    compute = partial(_loop, known.grids, poses, pairs, odometry, up_world)
    key = cache_key(
        scan.fingerprint, "revisits by surfaces and drift", options.surfaces, pairs.tobytes(),
        poses.tobytes(), up_world, odometry.sigma_rotation.tobytes(), odometry.sigma_translation.tobytes(),
    )  # fmt: skip
    items = runtime.map("surface revisits", key, len(pairs), compute, chunk_size=16)
    found, contradicted, leads = _gathered(pairs, items)
    believed = (
        (found.explained >= MIN_OVERLAP)
        & (contradicted <= known.max_contradicted)
        & (leads >= np.log(CLEAR_ODDS.value))
    )
    loops = _possible(found[believed], scan, odometry)
    return neighbours.joined(loops[is_supported(loops, poses, odometry)])


def _neighbour_starts(world_from_cams: Poses, i: int, j: int) -> Float[np.ndarray, "s 4 4"]:
    """The recorded motion, none, and as far as the camera went before the first and after the second.

    Over a jump of the tracker the camera itself goes on as before: of eight such steps, 0.3 to 0.9 m long,
    no motion led to one that was right, these to seven.
    """
    n, apart = len(world_from_cams), j - i
    ways = [(i, j), (i - apart, i), (j, j + apart)]
    moved = [
        se3.inverse(world_from_cams[a]) @ world_from_cams[b] for a, b in ways if a >= 0 and b < n
    ]
    return np.stack([moved[0], np.eye(4), *moved[1:]])


def _loop(
    grids: SurfaceGrids,
    poses: np.ndarray,
    pairs: np.ndarray,
    odometry: Odometry,
    up_world: np.ndarray,
    k: int,
) -> Arrays:
    """A revisit, sought from all that the drift allows.

    Rooms hold the same surfaces again, half a metre on, and more of both views may lie on those than on
    what both truly see. So motions are ranked by their odds: by how well what both see agrees, and by how far
    the recorded walk would have to be off. Ranked by what they explain, 35 of 125 that were believed in a
    lounge and on a floor of corridors (lounge, freiburg-101) were 0.15 m and more off, now none of 104.
    """
    i, j = (int(v) for v in pairs[k])
    predicted = se3.inverse(poses[i]) @ poses[j]
    rotation, translation = (
        float(sigma[0])
        for sigma in odometry.sigma_between(pairs[k : k + 1, 0], pairs[k : k + 1, 1])
    )
    up = poses[i, :3, :3].T @ up_world

    def log_odds(one: Registered) -> float:
        off = se3.difference(predicted[None], one.a_from_b[None])[0]
        squared = off[:3] @ off[:3] / rotation**2 + off[3:] @ off[3:] / translation**2
        return one.log_odds - 0.5 * float(squared)

    starts = starts_about(predicted, up, rotation, translation)
    return _as_arrays(grids, (i, j), register(grids, i, j, starts, log_odds), log_odds)


def _as_arrays(
    grids: SurfaceGrids,
    pair: tuple[int, int],
    found: list[Registered],
    rank: Callable[[Registered], float],
) -> Arrays:
    """What is kept of a pair: the best motion, its information, and by how much it leads the next one."""
    if not found:
        return {"a_from_b": np.zeros((0, 4, 4))}
    best = found[0]
    seen = observe(grids, *pair, best.a_from_b)
    lead = rank(best) - rank(found[1]) if len(found) > 1 else np.inf
    return {
        "a_from_b": best.a_from_b[None],
        "information": seen.information,
        "by_sensor": seen.by_sensor,
        "judged": np.array([best.explained, best.contradicted, lead, seen.distance_m]),
    }


def _gathered(
    pairs: np.ndarray, items: list[Arrays]
) -> tuple[SurfacePairs, Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
    """Pairs that were brought together, what contradicts each, and by how much it leads its rival."""
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


def _possible(found: SurfacePairs, scan: Scan, odometry: Odometry) -> SurfacePairs:
    """Those that drift can explain, in what they observe."""
    i, j = found.pairs.T
    predicted = se3.inverse(scan.world_from_cams[i]) @ scan.world_from_cams[j]
    sigmas = odometry.sigma_between(i, j)
    most = MAX_SIGMAS**2
    return found[squared_sigmas(found, predicted, sigmas) < most]

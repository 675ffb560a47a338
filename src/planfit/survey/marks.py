"""Marks of surveyed points: AprilTags and ArUco markers found by OpenCV's detectors, and all marks lifted
into the axes of their cameras, by depth, by the size of a tag, or as the camera itself."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from planfit.errors import OptionError, ScanError, did_you_mean
from planfit.geometry.camera import Camera
from planfit.runtime import Runtime, cache_key
from planfit.scan import Scan
from planfit.scan.statistics import lift_pixel
from planfit.survey.read import LiftedMarks, Mark, Survey

FAMILIES = {
    **{
        f"apriltag-{name}": getattr(cv2.aruco, f"DICT_APRILTAG_{name.upper()}")
        for name in ("16h5", "25h9", "36h10", "36h11")
    },
    "aruco-original": cv2.aruco.DICT_ARUCO_ORIGINAL,
    **{
        f"aruco-{bits}x{bits}-{count}": getattr(cv2.aruco, f"DICT_{bits}X{bits}_{count}")
        for bits in (4, 5, 6, 7)
        for count in (50, 100, 250, 1000)
    },
}
"""Names of families of tags."""
MIN_SIDE_PX = 8.0
"""Tags seen smaller are not read: their ids are guesses."""
CORNER_PX = 0.5
"""Standard deviation of the length of a tag's side in the image, from which its distance follows."""


@dataclass(frozen=True)
class SeenTag:
    """A tag in a frame."""

    frame_idx: int
    id: str
    middle_cam: Float[np.ndarray, "3"]
    """m, axes of the camera."""
    sigma_m: float
    """Standard deviation of its distance where its size tells that; 0 where depth does, which has its own."""


def find_tags(
    scan: Scan, family: str, size_m: float | None, frames: Int[np.ndarray, " k"], runtime: Runtime
) -> list[SeenTag]:
    """Each tag seen.

    The plane of the depth inside a tag gives the distance of its middle; without depth, its size does.
    A tag with neither is left out.

    Raises:
        OptionError: there is no such family, or the scan has no images.
    """
    if family not in FAMILIES:
        raise OptionError(
            f"--tags: expected a family, {', '.join(list(FAMILIES)[:5])} or others of these kinds, found "
            f"{family!r}; {did_you_mean(family, FAMILIES)}"
        )
    if not scan.has_color:
        raise OptionError(
            f"{scan.name}: expected colour images to look for tags in, found depth alone; give --marks"
        )

    def seen(k: int) -> dict[str, np.ndarray]:
        frame = int(frames[k])
        color = scan.files.color(frame)
        if color is None:
            return {"ids": np.zeros(0, int), "points": np.zeros((0, 4))}
        ids, corners = detect(color, family)
        depth = scan.files.depth(frame) if len(ids) else np.zeros((1, 1), np.float32)
        points = [_middle(each, depth, scan.cameras[frame], size_m) for each in corners]
        kept = [i for i, point in enumerate(points) if point is not None]
        found = np.array([points[i] for i in kept], dtype=float).reshape(-1, 4)
        return {"ids": ids[kept], "points": found}

    key = cache_key(scan.fingerprint, "tags", family, size_m, frames.tolist())
    each = runtime.map("tags", key, len(frames), seen)
    return [
        SeenTag(int(frames[k]), str(int(name)), point[:3], float(point[3]))
        for k, found in enumerate(each)
        for name, point in zip(found["ids"], found["points"], strict=True)
    ]


def detect(
    color: UInt8[np.ndarray, "h w 3"], family: str
) -> tuple[Int[np.ndarray, " t"], Float[np.ndarray, "t 4 2"]]:
    """Ids and corners (u, v) of tags in an image, RGB; one id twice is no tag that can be told."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = cv2.aruco.getPredefinedDictionary(FAMILIES[family])
    detector = cv2.aruco.ArucoDetector(dictionary, parameters)
    corners, ids, _ = detector.detectMarkers(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY))
    if ids is None or len(ids) == 0:
        return np.zeros(0, int), np.zeros((0, 4, 2))
    found = np.array(corners, dtype=float).reshape(-1, 4, 2)
    names = np.asarray(ids, dtype=int).ravel()
    sides = np.linalg.norm(found - np.roll(found, 1, axis=1), axis=2).min(axis=1)
    is_single = np.array([np.sum(names == name) == 1 for name in names])
    keep = is_single & (sides >= MIN_SIDE_PX)
    return names[keep], found[keep]


def _middle(
    corners: Float[np.ndarray, "4 2"], depth_m: np.ndarray, camera: Camera, size_m: float | None
) -> Float[np.ndarray, "4"] | None:
    """Middle (m) and the sigma of its distance (m) beside that of depth; None where nothing tells it."""
    ray = camera.rays(_crossing(corners)[None])[0]
    depth = _plane_depth(corners, depth_m, camera, ray)
    if depth is not None:
        return np.append(ray * depth, 0.0)
    if size_m is None:
        return None
    half = 0.5 * size_m
    square = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
    is_solved, _, translation = cv2.solvePnP(
        square, corners, camera.matrix, np.zeros(4), flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    if not is_solved:
        return None
    middle = np.asarray(translation, dtype=float).reshape(3)
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
    return np.append(middle, middle[2] * CORNER_PX / sides.max())


def _crossing(corners: Float[np.ndarray, "4 2"]) -> Float[np.ndarray, "2"]:
    """Where the diagonals cross: the image of the middle, however slanted the tag is."""
    a, b, c, d = (np.array([*corner, 1.0]) for corner in corners)
    at = np.cross(np.cross(a, c), np.cross(b, d))
    return at[:2] / at[2]


def _plane_depth(
    corners: Float[np.ndarray, "4 2"], depth_m: np.ndarray, camera: Camera, ray: np.ndarray
) -> float | None:
    """Depth (m) along a ray of the plane through the points inside a tag; inverse depth is linear in uv."""
    mask = np.zeros(depth_m.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.round(corners).astype(np.int32), 1)
    rows, columns = np.nonzero((mask > 0) & np.isfinite(depth_m) & (depth_m > 0))
    if len(rows) < 6:
        return None
    inverse = 1.0 / depth_m[rows, columns].astype(float)
    rays = camera.rays(np.column_stack([columns, rows]).astype(float))
    near = np.abs(inverse - np.median(inverse)) < 0.1 * np.median(inverse)
    if near.sum() < 6:
        return None
    plane = np.linalg.lstsq(rays[near], inverse[near], rcond=None)[0]
    # A second pass without what sticks out, as edges of the tag's board do.
    off = np.abs(rays @ plane - inverse)
    near &= off < 3.0 * max(float(np.median(off[near])), 1e-4)
    if near.sum() >= 6:
        plane = np.linalg.lstsq(rays[near], inverse[near], rcond=None)[0]
    at = float(plane @ ray)
    return 1.0 / at if at > 0 else None


SigmaOfDepth = Callable[[Float[np.ndarray, " m"]], Float[np.ndarray, " m"]]


def find_marks(
    scan: Scan,
    survey: Survey,
    frames: Int[np.ndarray, " k"],
    sigma_of_depth: SigmaOfDepth,
    runtime: Runtime | None = None,
) -> LiftedMarks:
    """All marks of a survey, and tags seen in `frames`, lifted by the nominal sensor.

    Args:
        scan: whose images and depth are read, where a mark says so whether or not in `frames`.
        survey: points and marks.
        frames: in which tags are looked for.
        sigma_of_depth: standard deviation (m) of points at depths (m).
        runtime: threads and cache.

    Raises:
        OptionError: a mark lies outside of its image, or where no depth was measured.
    """
    index = {point.id: k for k, point in enumerate(survey.points)}
    rows = [_lifted(scan, mark) for mark in survey.marks]
    besides = [0.0] * len(rows)
    frame_idx = [mark.frame_idx for mark in survey.marks]
    point_idx = [index[mark.point_id] for mark in survey.marks]
    if survey.tags:
        tags = find_tags(scan, survey.tags, survey.tag_size_m, frames, runtime or Runtime())
        for tag in tags:
            if tag.id in index:
                rows.append(tag.middle_cam)
                besides.append(tag.sigma_m)
                frame_idx.append(tag.frame_idx)
                point_idx.append(index[tag.id])
    points = np.array(rows, dtype=float).reshape(-1, 3)
    is_camera = (points == 0).all(axis=1)
    sigma = np.where(is_camera, 0.0, np.hypot(sigma_of_depth(points[:, 2]), besides))
    return LiftedMarks(points, sigma, np.array(frame_idx, int), np.array(point_idx, int))


def _lifted(scan: Scan, mark: Mark) -> Float[np.ndarray, "3"]:
    if mark.uv is None:
        return np.zeros(3)
    try:
        return lift_pixel(scan, mark.frame_idx, mark.uv)
    except ScanError as error:
        raise OptionError(f"{scan.name}: mark of {mark.point_id!r}: {error}") from error

"""Occupancy maps of ROS (map_server, nav2): a `.yaml` beside a picture of cells.

Faces are where free cells end at occupied ones: what a robot saw, from the side that it saw. Unknown cells
end no free space and begin no wall.
"""

import itertools
import math
import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float
from PIL import Image

from planfit.errors import FloorplanError
from planfit.floorplan.formats import fingerprint_of
from planfit.floorplan.options import PlanOptions, choose_unit
from planfit.floorplan.raster import check_size
from planfit.floorplan.raster.picture import MIN_SIDE_PX
from planfit.floorplan.types import Floorplan, PlanSource
from planfit.geometry import segments
from planfit.runtime import path_inside

STRAY_CELLS = 1.5
"""Faces stray from the cells by so many: a robot's wall is rough by one."""
REACH_CELLS = 2.5
"""A face stands on occupied cells within so many."""
MIN_FACE_M, MIN_FACE_CELLS = 0.25, 5.0
UNKNOWN_GREY = 205
"""What map_saver of ROS writes, of 255, where it knows nothing."""
GROW_CELLS = 3
"""Free space is taken to go on so far into unknown cells: beams that graze a wall leave those before it."""
MIN_ROOM_M2 = 1.0
"""Smaller patches of free cells are rays that went out of a window."""
_KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode")
_MODES = ("trinary", "scale", "raw")


@dataclass(frozen=True)
class MapDescription:
    """What the `.yaml` says; see map_server's documentation."""

    image: Path
    resolution_m: float
    """Side of a cell."""
    origin: tuple[float, float, float]
    """Pose of the lower left corner of the picture: m, m, rad counter-clockwise."""
    negate: bool
    """Whether white is occupied."""
    occupied_above: float
    """Occupied from this probability on."""
    free_below: float
    mode: str
    """`trinary` and `scale`: grey tells the probability; `raw`: values are percent, 255 is unknown."""


@dataclass(frozen=True)
class Cells:
    """A map as read; what is neither is unknown."""

    is_occupied: Bool[np.ndarray, "h w"]
    is_free: Bool[np.ndarray, "h w"]


def read_ros_map(path: Path, options: PlanOptions) -> Floorplan:
    """Wall faces of an occupancy map, m, in the axes of the map.

    Raises:
        FloorplanError: the file is no description of a map, its picture is missing or damaged, or nothing in
            it is wall.
    """
    description = read_description(path)
    cells = read_cells(path, description)
    px_ends, px_normals = faces_of_cells(cells, description.resolution_m)
    if len(px_ends) == 0:
        raise FloorplanError(
            f"{path}: expected walls of {MIN_FACE_M:g} m and more between occupied and free cells, found "
            f"none in {int(cells.is_occupied.sum())} occupied and {int(cells.is_free.sum())} free cells of "
            f"{description.resolution_m:g} m; check negate and the thresholds, and the resolution"
        )
    unit = choose_unit(options.unit, options.metres_per_unit, "m", "the map's resolution")
    # --scale and --unit speak of a unit of the file, which here is the metre.
    metres = unit.scale
    map_from_pixel = np.diag([metres, metres, 1.0]) @ _map_from_pixel(description, cells)
    unknown = f"{1.0 - float((cells.is_occupied | cells.is_free).mean()):.0%}"
    ends = segments.moved(px_ends, map_from_pixel)
    normals = px_normals @ map_from_pixel[:2, :2].T
    return Floorplan(
        str(path),
        ends,
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
        np.ones(len(ends), dtype=bool),
        fingerprint_of(path, description.image),
        is_metric=unit.metres is not None,
        source=PlanSource(
            kind=f"ROS map, {description.mode}, cells of {description.resolution_m:g} m",
            unit=unit.name,
            unit_from=unit.known_from,
            dropped=() if unknown == "0%" else (f"{unknown} of the cells are unknown",),
            warnings=(
                "a map shows what stood there when it was made, furniture too, at the height of the sensor",
            ),
            file_from_plan=np.linalg.inv(map_from_pixel),
        ),
    )


def read_description(path: Path) -> MapDescription:
    """The `.yaml` of a map.

    Raises:
        FloorplanError: an entry is missing or of another kind.
    """
    values = _entries(path)

    def require(is_met: bool, expected: str, found: str) -> None:
        if not is_met:
            raise FloorplanError(f"{path}: expected {expected}, found {found}; mend it")

    def number(text: object, name: str) -> float:
        try:
            value = float(str(text))
        except ValueError:
            value = math.nan
        require(math.isfinite(value), f"a number as {name}", repr(text))
        return value

    for name in ("image", "resolution", "origin"):
        if name not in values:
            raise FloorplanError(
                f"{path}: expected the description of a ROS map ({', '.join(_KEYS)}), found no {name}; give "
                "the yaml of a map, or a plan"
            )
    origin = values["origin"] if isinstance(values["origin"], list) else []
    require(len(origin) in (2, 3), "origin as [x, y, yaw]", repr(values["origin"]))
    resolution = number(values["resolution"], "resolution")
    limits = "a resolution of 0.0001 to 10 m a cell"
    require(1e-4 < resolution < 10, limits, f"{resolution:g}")
    mode = str(values.get("mode", "trinary")).lower()
    require(mode in _MODES, f"a mode of {', '.join(_MODES)}", repr(mode))
    x, y, yaw = [number(value, "origin") for value in [*origin, "0"][:3]]
    negate = str(values.get("negate", "0")).lower()
    require(negate in ("0", "1", "true", "false"), "negate as 0 or 1", repr(negate))
    return MapDescription(
        _picture_of(path, str(values["image"])),
        resolution,
        (x, y, yaw),
        negate in ("1", "true"),
        number(values.get("occupied_thresh", "0.65"), "occupied_thresh"),
        number(values.get("free_thresh", "0.196"), "free_thresh"),
        mode,
    )


def _entries(path: Path) -> dict[str, str | list[str]]:
    """Entries of a flat YAML file: texts, and lists in brackets or as lines with a dash. No more is in the
    descriptions of maps."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise FloorplanError(
            f"{path}: expected the description of a ROS map, found no text; give the yaml of a map"
        ) from error
    if len(text) > 100_000:
        raise FloorplanError(
            f"{path}: expected the description of a ROS map, found {len(text)} letters; give "
            "the yaml of a map"
        )
    result: dict[str, str | list[str]] = {}
    key = ""
    for raw in text.splitlines():
        line = re.sub(r"(^|\s)#.*", "", raw).rstrip()
        item = re.fullmatch(r"\s*-\s+(.*)", line)
        entry = re.fullmatch(r"([A-Za-z_]\w*)\s*:\s*(.*)", line)
        if item and key:
            listed = result[key]
            result[key] = [*(listed if isinstance(listed, list) else []), _bare(item[1])]
        elif entry:
            key, value = entry[1], entry[2]
            inside = re.fullmatch(r"\[(.*)\]", value)
            result[key] = [_bare(v) for v in inside[1].split(",")] if inside else _bare(value)
    return result


def _bare(text: str) -> str:
    return text.strip().strip("'\"")


def _picture_of(path: Path, name: str) -> Path:
    """The picture beside the description or in a folder there; of a name that leads elsewhere, as absolute
    paths of the machine that made the map do, its last part."""
    for candidate in (path_inside(path.parent, name), path.parent / re.split(r"[/\\]", name)[-1]):
        try:
            if name and candidate and candidate.is_file():
                return candidate
        except (OSError, ValueError):
            continue
    raise FloorplanError(
        f"{path}: expected the map's picture {name!r} beside it, found none; copy it there"
    )


def read_cells(path: Path, description: MapDescription) -> Cells:
    """Which cells are occupied, and which free.

    Raises:
        FloorplanError: the picture is none, too large or too small.
    """
    try:
        with Image.open(description.image) as file:
            if min(file.size) >= MIN_SIDE_PX:  # a map may be small, its cells are large
                check_size(str(description.image), file.width, file.height)
            alpha = np.asarray(file.convert("RGBA"))[..., 3] if "A" in file.getbands() else None
            grey = np.asarray(file.convert("RGB"), dtype=float).mean(axis=2)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise FloorplanError(
            f"{path}: expected a picture of cells in {description.image.name}, found a damaged or "
            "other file; save the map again"
        ) from error
    if description.mode == "raw":
        # ROS: percent; all above are unknown.
        is_known, occupied = grey <= 100, grey / 100
    else:
        # Writers of maps mark unknown cells so, and it is a probability of 0.196: below many a free_thresh.
        is_known = grey != UNKNOWN_GREY
        occupied = grey / 255 if description.negate else (255 - grey) / 255
    if description.mode == "scale" and alpha is not None:
        is_known &= alpha == 255
    # Thresholds of 1 and 0 (speed maps) leave nothing beyond them: the very ends count.
    is_occupied = is_known & (occupied > min(description.occupied_above, 0.999))
    is_free = is_known & (occupied < max(description.free_below, 0.01)) & ~is_occupied
    return Cells(is_occupied, is_free)


def _map_from_pixel(description: MapDescription, cells: Cells) -> Float[np.ndarray, "3 3"]:
    """Integer pixels are centres of cells; the origin is the corner of the lower left one."""
    x, y, yaw = description.origin
    side, height = description.resolution_m, cells.is_free.shape[0]
    c, s = math.cos(yaw), math.sin(yaw)
    corner_from_pixel = np.array(
        [[side, 0, 0.5 * side], [0, -side, (height - 0.5) * side], [0, 0, 1]]
    )
    return np.array([[c, -s, x], [s, c, y], [0, 0, 1]]) @ corner_from_pixel


def faces_of_cells(
    cells: Cells, resolution_m: float
) -> tuple[Float[np.ndarray, "n 2 2"], Float[np.ndarray, "n 2"]]:
    """Straight faces along the border of free cells to occupied ones, and normals into the free ones.

    `resolution_m`: side of a cell.

    Returns pixels (u, v) of the picture; integer pixels are centres of cells.
    """
    free = _rooms(cells, resolution_m)
    near = np.asarray(cv2.dilate(cells.is_occupied.astype(np.uint8), _disc(REACH_CELLS))) > 0
    contours, _ = cv2.findContours(free.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    least = max(MIN_FACE_M / resolution_m, MIN_FACE_CELLS)
    ends, normals = [], []
    for contour in contours:
        points = np.asarray(contour)[:, 0, :].astype(int)
        for run in _runs(near[points[:, 1], points[:, 0]]):
            for start, stop in _straight(points[run]):
                fitted = _fitted(points[run][start : stop + 1].astype(float))
                if fitted is None or np.linalg.norm(fitted[1] - fitted[0]) < least:
                    continue
                normal = _into_free(free, fitted)
                # From the middle of the last free cell to its border.
                ends.append(fitted - 0.5 * normal)
                normals.append(normal)
    return np.array(ends).reshape(-1, 2, 2), np.array(normals).reshape(-1, 2)


def _rooms(cells: Cells, resolution_m: float) -> Bool[np.ndarray, "h w"]:
    """Free cells without specks and rays, and unknown ones beside them as far as the next wall."""
    free = cv2.medianBlur(cells.is_free.astype(np.uint8), 3)
    free = cv2.morphologyEx(free, cv2.MORPH_OPEN, _disc(1.0))
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(free, connectivity=4)
    large = np.asarray(statistics)[:, cv2.CC_STAT_AREA] * resolution_m**2 >= MIN_ROOM_M2
    large[0] = False
    rooms = np.zeros(free.shape, dtype=bool)
    if count > 1:
        rooms = large[np.asarray(labels, dtype=np.int64)]
    for _ in range(GROW_CELLS):
        grown = np.asarray(cv2.dilate(rooms.astype(np.uint8), _disc(1.0))) > 0
        rooms = grown & ~cells.is_occupied
    return rooms


def _disc(radius: float) -> np.ndarray:
    reach = int(radius)
    v, u = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    return (u**2 + v**2 <= radius**2).astype(np.uint8)


def _runs(is_near: Bool[np.ndarray, " n"]) -> list[np.ndarray]:
    """Indices of each stretch of a closed contour that stands on occupied cells, in order."""
    n = len(is_near)
    if is_near.all():
        return [np.append(np.arange(n), 0)]
    first = int(np.flatnonzero(~is_near)[0])
    order = (np.arange(n) + first) % n
    edges = np.flatnonzero(np.diff(is_near[order].astype(int), prepend=0, append=0))
    return [order[a:b] for a, b in edges.reshape(-1, 2)]


def _straight(points: np.ndarray) -> list[tuple[int, int]]:
    """Where a stretch is straight, first and last index of its points (Douglas and Peucker 1973)."""
    if len(points) < 2:
        return []
    corners, stack = {0, len(points) - 1}, [(0, len(points) - 1)]
    values = points.astype(float)
    while stack:
        a, b = stack.pop()
        if b - a < 2:
            continue
        chord = values[b] - values[a]
        offset = values[a + 1 : b] - values[a]
        length = float(np.hypot(*chord))
        if length == 0:
            apart = np.hypot(offset[:, 0], offset[:, 1])
        else:
            apart = np.abs(offset[:, 0] * chord[1] - offset[:, 1] * chord[0]) / length
        k = int(apart.argmax())
        if apart[k] > STRAY_CELLS:
            middle = a + 1 + k
            corners.add(middle)
            stack += [(a, middle), (middle, b)]
    return list(itertools.pairwise(sorted(corners)))


def _fitted(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "2 2"] | None:
    """The line of least squares through points, from the first to the last of them."""
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle, full_matrices=False)
    along = axes[0]
    at = (points[[0, -1]] - middle) @ along
    return None if at[0] == at[1] else middle + at[:, None] * along


def _into_free(
    free: Bool[np.ndarray, "h w"], ends: Float[np.ndarray, "2 2"]
) -> Float[np.ndarray, "2"]:
    """Normal to the side on which more of three points two cells away are free."""
    left = segments.left_normals(ends[None])[0]
    shares = np.array([0.25, 0.5, 0.75])[:, None]
    along = (1 - shares) * ends[0] + shares * ends[1]
    counts = []
    for side in (left, -left):
        u, v = np.round(along + 2.0 * side).astype(int).T
        inside = (u >= 0) & (v >= 0) & (u < free.shape[1]) & (v < free.shape[0])
        counts.append(int(free[v[inside], u[inside]].sum()))
    return left if counts[0] >= counts[1] else -left

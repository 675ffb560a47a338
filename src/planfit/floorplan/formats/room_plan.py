"""Rooms captured by Apple's RoomPlan, exported as JSON (CapturedRoom, CapturedStructure) or as USDZ.

Surfaces stand upright: `transform` is 4x4, column by column, m, y up, at the middle of a surface whose own x
runs along it; `dimensions` are its width and height. Walls have no thickness: they are what was seen of them.

USDZ holds these surfaces as boxes of a scene: a group of Category "Wall" holds a cube WallN, and DoorN,
WindowN and OpeningN for what is in it; one of Category "Floor" holds meshes (found in files of two apps). It
is read with Pixar's OpenUSD, binary and text alike.
"""

import importlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from jaxtyping import Bool, Float
from shapely.geometry.base import BaseGeometry

from planfit.errors import FloorplanError
from planfit.floorplan.edits import MAX_ENTRIES
from planfit.floorplan.formats import fingerprint_of
from planfit.floorplan.options import PlanOptions, choose_unit
from planfit.floorplan.types import Floorplan, PlanSource
from planfit.floorplan.vector.regions import MAX_COORDINATE, MIN_FACE_M, SelfCrossings
from planfit.geometry import segments
from planfit.priors import DOOR_WIDTH_MOST_M

INSIDE_M = 0.15
"""The floor reaches to the walls within so much: a wall looks to the side on which it lies."""
NEAR_M = 0.3
"""An opening that names no wall belongs to one within so much."""
_KINDS = ("doors", "windows", "openings")
_KINDS_OF_PRIMS = {"wall": "walls", "door": "doors", "window": "windows", "opening": "openings"}
"""Lists of RoomPlan's JSON, by the names of prims."""
_CURVED_M = 0.5
"""A wall that bends leaves its plane by more than this."""


@dataclass(frozen=True)
class Surface:
    """A wall or an opening, seen from above: x-y are the world's x and -z."""

    ends: Float[np.ndarray, "2 2"]
    low_m: float
    """Height of its lower edge."""
    high_m: float
    storey: int
    identifier: str
    parent: str
    """Identifier of the wall that it is in; empty where it names none."""
    is_curved: bool
    kind: str
    """That its list is named for: "walls", "doors"."""


def is_room_plan(content: object) -> bool:
    """Whether JSON is of RoomPlan: it holds walls, or rooms with walls, and no faces of planfit's. Walls of
    other programs have no `transform`."""
    if not isinstance(content, dict) or "faces" in content or content.get("type"):
        return False
    rooms = content.get("rooms")
    owners = [content, *(rooms if isinstance(rooms, list) else [])]
    lists = [each.get("walls") for each in owners if isinstance(each, dict)]
    lists = [walls for walls in lists if isinstance(walls, list)]
    found = [wall for walls in lists for wall in walls]
    return bool(lists) and (
        not found or any("transform" in w for w in found if isinstance(w, dict))
    )


def plan_of_rooms(content: dict[str, Any], path: Path, options: PlanOptions) -> Floorplan:
    """Wall faces at `options.cut_height_m` above the floor, m, with doors, windows and openings as gaps.

    Raises:
        FloorplanError: a surface is damaged, there is no such storey, or there are no walls.
    """
    walls = _surfaces(path, content, "walls")
    if not walls:
        raise FloorplanError(
            f"{path}: expected walls captured by RoomPlan, found none; export the whole room"
        )
    storeys = sorted({wall.storey for wall in walls})
    storey = _choose(path, options.storey, storeys)
    walls = [wall for wall in walls if wall.storey == storey]
    holes = [hole for kind in _KINDS for hole in _surfaces(path, content, kind)]
    holes = [hole for hole in holes if hole.storey == storey]
    fronts = [hole for hole in holes if _is_front(hole)]
    holes = [hole for hole in holes if not _is_front(hole)]
    height = float(np.median([wall.low_m for wall in walls])) + options.cut_height_m
    walls = [wall for wall in walls if wall.low_m <= height <= wall.high_m] or walls
    ends, openings, names = _cut(
        walls, [hole for hole in holes if hole.low_m < height < hole.high_m]
    )
    if len(ends) == 0:
        raise FloorplanError(
            f"{path}: expected walls beside doors and windows, found openings alone"
        )
    normals, is_oriented = _sides(ends, _floor(path, content, storey))
    unit = choose_unit(options.unit, options.metres_per_unit, "m", "the format")
    metres = unit.scale
    curved = sum(wall.is_curved for wall in walls)
    warnings = [f"{curved} curved walls were read as straight"] if curved else []
    if fronts:
        width_m = sum(segments.lengths(front.ends[None])[0] for front in fronts)
        warnings.append(
            f"{len(fronts)} doors wider than {DOOR_WIDTH_MOST_M.value:g} m, {width_m:.3g} m together, are "
            "fronts of glass or movable partitions: kept as wall"
        )
    return Floorplan(
        str(path),
        ends * metres,
        normals,
        is_oriented,
        fingerprint_of(path),
        openings=openings * metres if len(openings) else None,
        is_metric=unit.metres is not None,
        source=PlanSource(
            kind=f"rooms captured by RoomPlan ({path.suffix.lower()})",
            unit=unit.name,
            unit_from=unit.known_from,
            storey=str(storey) if len(storeys) > 1 else "",
            storeys=tuple(str(each) for each in storeys) if len(storeys) > 1 else (),
            warnings=tuple(warnings),
            file_from_plan=np.diag([1 / metres, -1 / metres, 1.0]),
            opening_lines=openings * (1.0, -1.0),
            opening_names=names,
            opening_ids=("",) * len(names),
        ),
    )


def _is_front(hole: Surface) -> bool:
    """Whether what is called a door is wider than any."""
    width_m = float(segments.lengths(hole.ends[None])[0])
    return hole.kind == "doors" and width_m > DOOR_WIDTH_MOST_M.value


def _surfaces(path: Path, content: dict[str, Any], kind: str) -> list[Surface]:
    """Of a room, or of all rooms of a structure where it lists none itself.

    Raises:
        FloorplanError: one has no transform and dimensions of numbers.
    """
    found = []
    for number, item in enumerate(_listed(path, content, kind)):
        try:
            found.append(_surface(item, kind))
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise FloorplanError(
                f"{path}: expected a transform of 16 numbers and dimensions in each of the {kind}, found "
                f"number {number + 1} damaged ({type(error).__name__}); export it again"
            ) from error
    return [surface for surface in found if segments.lengths(surface.ends[None])[0] > MIN_FACE_M]


def _listed(path: Path, content: dict[str, Any], kind: str) -> list[Any]:
    """Entries of a room, or of all rooms of a structure where it lists none itself.

    Raises:
        FloorplanError: there is something else than a list.
    """
    rooms = content.get("rooms")
    rooms = [room for room in rooms if isinstance(room, dict)] if isinstance(rooms, list) else []
    lists = [content.get(kind) or []]
    if not lists[0]:
        lists = [room.get(kind) or [] for room in rooms]
    if not all(isinstance(each, list) for each in lists):
        raise FloorplanError(
            f"{path}: expected a list of {kind}, found another value; export it again"
        )
    found = [item for each in lists for item in each]
    if len(found) > MAX_ENTRIES:
        raise FloorplanError(
            f"{path}: expected at most {MAX_ENTRIES} {kind}, found {len(found)}; export one room"
        )
    return found


def _surface(item: dict[str, Any], kind: str) -> Surface:
    matrix = np.array(item["transform"], dtype=float).reshape(4, 4).T
    width, height = (float(value) for value in item["dimensions"][:2])
    corners = np.array([[-width / 2, 0, 0, 1], [width / 2, 0, 0, 1]]) @ matrix.T
    if not (
        np.isfinite(corners).all()
        and np.isfinite(height)
        and np.abs(corners).max() < MAX_COORDINATE
    ):
        raise ValueError("no finite numbers")
    middle = float(matrix[1, 3])
    return Surface(
        corners[:, [0, 2]] * (1.0, -1.0),
        middle - height / 2,
        middle + height / 2,
        int(item.get("story") or 0),
        str(item.get("identifier") or ""),
        str(item.get("parentIdentifier") or ""),
        item.get("curve") is not None,
        kind,
    )


def _choose(path: Path, asked: str, storeys: list[int]) -> int:
    if not asked:
        return storeys[0]
    if asked not in [str(storey) for storey in storeys]:
        listed = ", ".join(str(storey) for storey in storeys)
        raise FloorplanError(
            f"{path}: expected a storey of {listed}, found {asked!r}; choose one of these"
        )
    return int(asked)


def _cut(
    walls: list[Surface], holes: list[Surface]
) -> tuple[Float[np.ndarray, "n 2 2"], Float[np.ndarray, "k 2 2"], tuple[str, ...]]:
    """Parts of walls beside their openings, the openings along the walls, and what each of these is."""
    parts, openings, names = [], [], []
    taken = [_wall_of(hole, walls) for hole in holes]
    for number, wall in enumerate(walls):
        length = float(np.linalg.norm(wall.ends[1] - wall.ends[0]))
        along = (wall.ends[1] - wall.ends[0]) / length
        gaps = []
        for hole, owner in zip(holes, taken, strict=True):
            if owner == number:
                low, high = np.clip(np.sort((hole.ends - wall.ends[0]) @ along), 0.0, length)
                if high - low > MIN_FACE_M:
                    gaps.append((float(low), float(high)))
                    openings.append(wall.ends[0] + np.outer([low, high], along))
                    names.append(hole.kind.removesuffix("s"))
        at = 0.0
        for low, high in [*sorted(gaps), (length, length)]:
            if low - at > MIN_FACE_M:
                parts.append(wall.ends[0] + np.outer([at, low], along))
            at = max(at, high)
    parts, openings = (np.array(lines).reshape(-1, 2, 2) for lines in (parts, openings))
    return parts, openings, tuple(names)


def _wall_of(hole: Surface, walls: list[Surface]) -> int | None:
    """The wall that an opening names, else the nearest that it lies along."""
    for number, wall in enumerate(walls):
        if hole.parent and wall.identifier == hole.parent:
            return number
    middle = shapely.Point(hole.ends.mean(axis=0))
    distances = [middle.distance(shapely.LineString(wall.ends)) for wall in walls]
    nearest = int(np.argmin(distances)) if distances else 0
    return nearest if distances and distances[nearest] < NEAR_M else None


def _floor(path: Path, content: dict[str, Any], storey: int) -> BaseGeometry:
    """Area of the floors of a storey; empty where none has an outline."""
    areas, crossings = [], SelfCrossings()
    for number, item in enumerate(_listed(path, content, "floors")):
        try:
            if int(item.get("story") or 0) != storey:
                continue
            matrix = np.array(item["transform"], dtype=float).reshape(4, 4).T
            corners = np.array(item.get("polygonCorners") or [], dtype=float).reshape(-1, 3)
            world = corners @ matrix[:3, :3].T + matrix[:3, 3]
            if len(corners) >= 3 and np.isfinite(world).all():
                areas.append(crossings.valid(shapely.Polygon(world[:, [0, 2]] * (1.0, -1.0))))
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise FloorplanError(
                f"{path}: expected a transform and corners in each of the floors, found number {number + 1} "
                f"damaged ({type(error).__name__}); export it again"
            ) from error
    return shapely.union_all(areas)


def _sides(
    ends: Float[np.ndarray, "n 2 2"], floor: BaseGeometry
) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, " n"]]:
    """Normals, and whether the floor lies on one side alone: a wall between two rooms is seen from both."""
    left = segments.left_normals(ends)
    if floor.is_empty:
        return left, np.zeros(len(ends), dtype=bool)
    middle = ends.mean(axis=1)
    on_left, on_right = (
        shapely.contains(floor, shapely.points(middle + sign * INSIDE_M * left)) for sign in (1, -1)
    )
    return np.where((on_right & ~on_left)[:, None], -left, left), on_left ^ on_right


def read_usdz(path: Path, options: PlanOptions) -> Floorplan:
    """Wall faces of rooms captured by RoomPlan, m, as of its JSON.

    Raises:
        FloorplanError: usd-core is missing, or the scene holds no walls of RoomPlan.
    """
    usd, geom = _packages(path)
    stage = usd.Stage.Open(str(path))
    content: dict[str, Any] = {kind: [] for kind in (*_KINDS_OF_PRIMS.values(), "floors")}
    cache = geom.XformCache()
    metres = float(geom.GetStageMetersPerUnit(stage))
    n_prims = 0
    for prim in stage.Traverse():
        n_prims += 1
        group = prim.GetParent().GetCustomDataByKey("Category")
        kind = _KINDS_OF_PRIMS.get(re.sub(r"\d+$", "", prim.GetName()).lower())
        corners = _corners(prim, geom)
        if group not in ("Wall", "Floor") or corners is None:
            continue
        world_from_prim = np.array(cache.GetLocalToWorldTransform(prim)).T
        world_from_prim[:3] *= metres
        if group == "Floor":
            content["floors"] += _floor_of_prim(prim, geom, world_from_prim)
        elif kind is not None:
            owner = str(prim.GetParent().GetCustomDataByKey("UUID") or "")
            content[kind].append(_surface_of_prim(corners, world_from_prim, kind, owner))
    if geom.GetStageUpAxis(stage) != "Y" or not content["walls"]:
        raise FloorplanError(
            f"{path}: expected rooms captured by RoomPlan (walls in groups of Category Wall, y up), found "
            f"{len(content['walls'])} such walls in {n_prims} prims, {geom.GetStageUpAxis(stage)} up; export "
            "another model as GLB or OBJ"
        )
    return plan_of_rooms(content, path, options)


def _packages(path: Path) -> tuple[Any, Any]:
    """OpenUSD, which not everyone installs."""
    try:
        return importlib.import_module("pxr.Usd"), importlib.import_module("pxr.UsdGeom")
    except ImportError as error:
        raise FloorplanError(
            f"{path}: expected the package usd-core to read USDZ, found it missing; pip install "
            "'planfit[usd]', or give the JSON that RoomPlan writes beside it (its CapturedRoom)"
        ) from error


def _corners(prim: Any, geom: Any) -> Float[np.ndarray, "n 3"] | None:
    """Corners of a cube or a mesh in its own axes; None of all else."""
    if prim.IsA(geom.Cube):
        half = float(geom.Cube(prim).GetSizeAttr().Get()) / 2
        return np.array([[-half] * 3, [half] * 3])
    if prim.IsA(geom.Mesh):
        points = np.array(geom.Mesh(prim).GetPointsAttr().Get() or [], dtype=float).reshape(-1, 3)
        return points if len(points) else None
    return None


def _surface_of_prim(
    corners: Float[np.ndarray, "n 3"],
    world_from_prim: Float[np.ndarray, "4 4"],
    kind: str,
    owner: str,
) -> dict[str, Any]:
    """An entry as in RoomPlan's JSON: its own x along the surface, y up, without scale."""
    scale = np.linalg.norm(world_from_prim[:3, :3], axis=0)
    size = np.ptp(corners, axis=0) * scale
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    matrix = np.eye(4)
    matrix[:3, :3] = world_from_prim[:3, :3] / scale
    matrix[:3, 3] = world_from_prim[:3, :3] @ middle + world_from_prim[:3, 3]
    is_wall = kind == "walls"
    return {
        "transform": matrix.T.ravel().tolist(),
        "dimensions": size.tolist(),
        "identifier": owner if is_wall else "",
        "parentIdentifier": "" if is_wall else owner,
        "curve": {} if is_wall and size[2] > _CURVED_M else None,
    }


def _floor_of_prim(
    prim: Any, geom: Any, world_from_prim: Float[np.ndarray, "4 4"]
) -> list[dict[str, Any]]:
    """The faces of a floor's mesh, each with its outline in the world."""
    mesh = geom.Mesh(prim)
    points = np.array(mesh.GetPointsAttr().Get(), dtype=float).reshape(-1, 3)
    world = points @ world_from_prim[:3, :3].T + world_from_prim[:3, 3]
    ends = np.cumsum(np.array(mesh.GetFaceVertexCountsAttr().Get(), dtype=int))
    index = np.array(mesh.GetFaceVertexIndicesAttr().Get(), dtype=int)
    return [
        {"transform": np.eye(4).ravel().tolist(), "polygonCorners": world[face].tolist()}
        for face in np.split(index, ends[:-1])
    ]

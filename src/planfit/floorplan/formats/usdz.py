"""USDZ of Apple's RoomPlan: the surfaces that its JSON holds, as boxes of a scene.

A group of Category "Wall" holds a cube WallN, and DoorN, WindowN and OpeningN for what is in it; one of
Category "Floor" holds meshes (found in files of two apps). Read with Pixar's OpenUSD, binary and text alike.
"""

import importlib
import re
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from planfit.errors import FloorplanError
from planfit.floorplan.formats.room_plan import plan_of_rooms
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.types import Floorplan

_KINDS = {"wall": "walls", "door": "doors", "window": "windows", "opening": "openings"}
"""Lists of RoomPlan's JSON, by the names of prims."""
_CURVED_M = 0.5
"""A wall that bends leaves its plane by more than this."""


def read_usdz(path: Path, options: PlanOptions) -> Floorplan:
    """Wall faces of rooms captured by RoomPlan, m, as of its JSON.

    Raises:
        FloorplanError: usd-core is missing, or the scene holds no walls of RoomPlan.
    """
    usd, geom = _packages(path)
    stage = usd.Stage.Open(str(path))
    content: dict[str, Any] = {kind: [] for kind in (*_KINDS.values(), "floors")}
    cache = geom.XformCache()
    metres = float(geom.GetStageMetersPerUnit(stage))
    n_prims = 0
    for prim in stage.Traverse():
        n_prims += 1
        group = prim.GetParent().GetCustomDataByKey("Category")
        kind = _KINDS.get(re.sub(r"\d+$", "", prim.GetName()).lower())
        corners = _corners(prim, geom)
        if group not in ("Wall", "Floor") or corners is None:
            continue
        world_from_prim = np.array(cache.GetLocalToWorldTransform(prim)).T
        world_from_prim[:3] *= metres
        if group == "Floor":
            content["floors"] += _floor(prim, geom, world_from_prim)
        elif kind is not None:
            owner = str(prim.GetParent().GetCustomDataByKey("UUID") or "")
            content[kind].append(_surface(corners, world_from_prim, kind, owner))
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


def _surface(
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


def _floor(prim: Any, geom: Any, world_from_prim: Float[np.ndarray, "4 4"]) -> list[dict[str, Any]]:
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

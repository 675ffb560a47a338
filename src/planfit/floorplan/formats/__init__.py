"""Readers of plans, one module a format, found by the suffix of the file."""

import hashlib
from importlib import import_module
from pathlib import Path
from typing import Protocol

from planfit.errors import FloorplanError
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.types import Floorplan


class PlanReader(Protocol):
    """What each module of this package offers."""

    def __call__(self, path: Path, options: PlanOptions) -> Floorplan:
        """Wall faces of the plan at `path`, which exists.

        Raises:
            FloorplanError: the file is of another kind, damaged, or without walls.
        """
        ...


PICTURE_SUFFIXES = (
    ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".pgm", ".pbm", ".ppm", ".bmp",
)  # fmt: skip

READERS = {
    ".npy": "own_formats:read_npy",
    ".json": "own_formats:read_json",
    **dict.fromkeys((".yaml", ".yml"), "ros_map:read_ros_map"),
    **dict.fromkeys(PICTURE_SUFFIXES, "picture:read_picture"),
    **dict.fromkeys((".svg", ".svgz"), "svg:read_svg"),
    ".dxf": "dxf:read_dxf",
    ".pdf": "pdf:read_pdf",
    **dict.fromkeys((".ifc", ".ifczip"), "ifc:read_ifc"),
    ".usdz": "room_plan:read_usdz",
    **dict.fromkeys((".geojson", ".zip"), "geojson:read_geojson"),
    **dict.fromkeys((".ply", ".obj", ".glb", ".gltf", ".stl", ".off"), "mesh:read_mesh"),
}
"""Module and function of this package that read each kind of file, by suffix. They are imported when
they are asked for: together they bring half a dozen libraries."""
PAPER_SUFFIXES = {".pdf", ".svg", ".svgz", *PICTURE_SUFFIXES}
"""Files that have a size on paper."""
_CONVERT = {
    ".dwg": "a DWG drawing; save it as DXF in your CAD program (DXFOUT, SAVEAS), or convert it with the ODA "
    "File Converter or with LibreDWG's dwg2dxf",
    ".rvt": "a Revit model; export it as IFC or as DXF",
    ".skp": "a SketchUp model; export it as DXF, OBJ or IFC",
    **dict.fromkeys(
        (".dgn", ".dwf", ".dwfx", ".3dm", ".vsdx", ".vsd", ".fcstd", ".pln", ".blend", ".fbx"),
        "a drawing or model of a program of its own; export it as DXF, PDF or IFC",
    ),
    **dict.fromkeys(
        (".heic", ".heif", ".webp", ".gif", ".avif", ".psd", ".xcf"), "a picture; save it as PNG"
    ),
    **dict.fromkeys(
        (".las", ".laz", ".e57", ".rcp", ".rcs", ".pts", ".ptx", ".pcd", ".xyz"),
        "a cloud of points; give the plan that a scan is to be fitted to (a cloud can be the scan: "
        "'planfit refine CLOUD --poses TRAJECTORY --plan FILE')",
    ),
}
"""What nothing here reads, and how to make it another."""
FOLDER_READER = "geojson:read_geojson"
"""A folder is IMDF."""


def find_reader(path: Path) -> PlanReader:
    """The reader of a file or folder, by its suffix.

    Raises:
        FloorplanError: nothing reads files of this suffix; the message lists those that are read.
    """
    hint = _CONVERT.get(path.suffix.lower())
    if hint is not None and not path.is_dir():
        raise FloorplanError(f"{path}: expected a plan that planfit reads, found {hint}")
    name = FOLDER_READER if path.is_dir() else READERS.get(path.suffix.lower())
    if name is None:
        raise FloorplanError(
            f"{path}: expected a plan as {', '.join(READERS)}, found "
            f"{path.suffix or 'no suffix'}; save it as one of these ('planfit help formats')"
        )
    module, function = name.split(":")
    return getattr(import_module(f"planfit.floorplan.formats.{module}"), function)


def plans_in(folder: Path) -> list[str]:
    """Names of the files in a folder that have a suffix of plans. Those that say more of themselves come
    first: the description of a map before its picture, drawings before pictures."""
    order = {suffix: i for i, suffix in enumerate(READERS) if suffix not in PICTURE_SUFFIXES}
    names = [
        p.name for p in sorted(folder.iterdir()) if p.suffix.lower() in READERS and p.is_file()
    ]
    return sorted(names, key=lambda name: order.get(Path(name).suffix.lower(), len(READERS)))


def fingerprint_of(*paths: Path) -> str:
    """Sixteen hex digits that change when the content of one of the files does."""
    digest = hashlib.sha256()
    for path in paths:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]

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


READERS = {
    ".npy": "own_formats:read_npy",
    ".json": "own_formats:read_json",
    **dict.fromkeys((".png", ".jpg", ".jpeg", ".tif", ".tiff"), "picture:read_picture"),
    **dict.fromkeys((".svg", ".svgz"), "svg:read_svg"),
    ".dxf": "dxf:read_dxf",
    ".pdf": "pdf:read_pdf",
    ".ifc": "ifc:read_ifc",
    **dict.fromkeys((".geojson", ".zip"), "geojson:read_geojson"),
    **dict.fromkeys((".ply", ".obj", ".glb", ".gltf", ".stl", ".off"), "mesh:read_mesh"),
}
"""Module and function of this package that read each kind of file, by suffix. They are imported when
they are asked for: together they bring half a dozen libraries."""
FOLDER_READER = "geojson:read_geojson"
"""A folder is IMDF."""


def find_reader(path: Path) -> PlanReader:
    """The reader of a file or folder, by its suffix.

    Raises:
        FloorplanError: nothing reads files of this suffix; the message lists those that are read.
    """
    name = FOLDER_READER if path.is_dir() else READERS.get(path.suffix.lower())
    if name is None:
        raise FloorplanError(
            f"{path}: expected a plan as {', '.join(READERS)}, found "
            f"{path.suffix or 'no suffix'}; save it as one of these (docs/formats.md)"
        )
    module, function = name.split(":")
    return getattr(import_module(f"planfit.floorplan.formats.{module}"), function)


def fingerprint_of(*paths: Path) -> str:
    """Sixteen hex digits that change when the content of one of the files does."""
    digest = hashlib.sha256()
    for path in paths:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]

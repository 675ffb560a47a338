"""`read_floorplan`: from a path to wall faces, whatever the format."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from planfit.errors import FloorplanError
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.types import Floorplan
from planfit.floorplan.units import MAX_SIZE_M, MIN_SIZE_M

READERS = {
    ".npy": "formats.own_formats:read_npy",
    ".json": "formats.own_formats:read_json",
    **dict.fromkeys((".png", ".jpg", ".jpeg", ".tif", ".tiff"), "raster:read_raster"),
    **dict.fromkeys((".svg", ".svgz"), "formats.svg:read_svg"),
    ".dxf": "formats.dxf:read_dxf",
    ".pdf": "formats.pdf:read_pdf",
    ".ifc": "formats.ifc:read_ifc",
    **dict.fromkeys((".geojson", ".zip"), "formats.geojson:read_geojson"),
    **dict.fromkeys((".ply", ".obj", ".glb", ".gltf", ".stl", ".off"), "model:read_model"),
}
"""Module and function of this package that read each kind of file, by suffix. They are imported when
they are asked for: together they bring half a dozen libraries."""
FOLDER_READER = "formats.geojson:read_geojson"
"""A folder is IMDF."""


def read_floorplan(path: str | Path, options: PlanOptions | None = None) -> Floorplan:
    """Read a plan; the suffix tells the format (docs/formats.md). In metres where its unit is known.

    Raises:
        FloorplanError: the file is missing, of another kind, without walls, or of absurd size.
    """
    path, options = Path(path), options or PlanOptions()
    if not path.exists():
        raise FloorplanError(f"{path}: expected a floorplan, found nothing; check the path")
    floorplan = _reader(path)(path, options)
    extent = max(floorplan.size)
    if floorplan.is_metric and not MIN_SIZE_M <= extent <= MAX_SIZE_M:
        raise FloorplanError(
            f"{path}: expected a building in metres ({MIN_SIZE_M:g} to {MAX_SIZE_M:g} m across), "
            f"found {floorplan.size[0]:.4g} x {floorplan.size[1]:.4g}; "
            "convert it from its own unit to metres, or give --unit or --scale"
        )
    return floorplan.mirrored() if options.mirror else floorplan


def _reader(path: Path) -> Callable[[Path, PlanOptions], Floorplan]:
    name = FOLDER_READER if path.is_dir() else READERS.get(path.suffix.lower())
    if name is None:
        raise FloorplanError(
            f"{path}: expected a plan as {', '.join(READERS)}, found "
            f"{path.suffix or 'no suffix'}; save it as one of these (docs/formats.md)"
        )
    module, function = name.split(":")
    return getattr(import_module(f"planfit.floorplan.{module}"), function)

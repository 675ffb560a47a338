"""Readers of vector drawings and models, by suffix; a folder (no suffix) is IMDF."""

from collections.abc import Callable
from pathlib import Path

from planfit.floorplan.dxf import read_dxf
from planfit.floorplan.geojson import read_geojson
from planfit.floorplan.ifc import read_ifc
from planfit.floorplan.model import read_model
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.pdf import read_pdf
from planfit.floorplan.svg import read_svg
from planfit.floorplan.types import Floorplan

VECTOR_READERS: dict[str, Callable[[Path, PlanOptions], Floorplan]] = {
    ".dxf": read_dxf,
    ".ifc": read_ifc,
    ".pdf": read_pdf,
    ".geojson": read_geojson,
    ".zip": read_geojson,
    "": read_geojson,
    **dict.fromkeys((".ply", ".obj", ".glb", ".gltf", ".stl", ".off"), read_model),
    ".svg": read_svg,
    ".svgz": read_svg,
}

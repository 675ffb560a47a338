"""Readers of vector drawings and models, by suffix."""

from collections.abc import Callable
from pathlib import Path

from planfit.floorplan.dxf import read_dxf
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.pdf import read_pdf
from planfit.floorplan.svg import read_svg
from planfit.floorplan.types import Floorplan

VECTOR_READERS: dict[str, Callable[[Path, PlanOptions], Floorplan]] = {
    ".dxf": read_dxf,
    ".pdf": read_pdf,
    ".svg": read_svg,
    ".svgz": read_svg,
}

"""Readers of plans, one module a format, found by the suffix of the file: from a path to wall faces."""

import hashlib
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Protocol

import numpy as np

from planfit.errors import FloorplanError, told_as
from planfit.floorplan.edits import PlanEdits, edited, read_edits
from planfit.floorplan.faces import LineWorkTooDense
from planfit.floorplan.options import (
    MAX_SIZE_M,
    METRES_PER_UNIT,
    MIN_SIZE_M,
    PlanOptions,
    units_that_fit,
)
from planfit.floorplan.types import Floorplan
from planfit.runtime import require_content, unpacked


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
        "a drawing or model of a program of its own; export it as DXF, SVG, PDF or IFC",
    ),
    **dict.fromkeys(
        (".sh3d", ".fml", ".drawio"),
        "a plan of a program of its own; export it as SVG, DXF or PDF",
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
MAX_UNPACKED_BYTES = 200_000_000
"""Of a compressed file, once it is unpacked."""
MAX_DEPTH = 12
"""How deep forms, gradients, rules and elements may be within one another: in a damaged file they go round in
circles."""
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


def _map_hint(path: Path) -> str:
    """What to say of a picture that a ROS map's description lies beside, which has its scale."""
    if path.suffix.lower() not in PICTURE_SUFFIXES:
        return ""
    beside = [path.with_suffix(end) for end in (".yaml", ".yml")]
    names = [p.name for p in beside if p.is_file()]
    if not names:
        return ""
    return (
        f"{names[0]} beside it may describe it as a ROS map: give that file, which tells the scale"
    )


def read_floorplan(path: str | Path, options: PlanOptions | None = None) -> Floorplan:
    """Read a plan; the suffix tells the format (docs/formats.md). In metres where its unit is known.

    Raises:
        FloorplanError: the file is missing, of another kind, without walls, or of absurd size.
    """
    if path == "":
        raise FloorplanError(
            "plan: expected the path of a floorplan, found an empty one; is a variable not set?"
        )
    path, options = Path(path), options or PlanOptions()
    require_content(path, FloorplanError, "a floorplan")
    if not path.exists():
        try:
            with unpacked(path) as copy:
                floorplan = replace(read_floorplan(copy, options), name=str(path))
        except OSError as error:
            raise FloorplanError(
                f"{path}: expected a floorplan, found nothing; check the path"
            ) from error
        return floorplan
    reader = find_reader(path)
    if options.paper_scale is not None and path.suffix.lower() not in PAPER_SUFFIXES:
        raise FloorplanError(
            f"{path}: expected a file with a size on paper (PDF, SVG, a picture with dpi) for the scale "
            f"1:{options.paper_scale:g}, found {path.suffix}; give --unit, or --scale METRES of one unit"
        )
    edits = PlanEdits() if options.edits is None else read_edits(options.edits)
    regions = (*options.keep_regions, *(tuple((x, y) for x, y in c.tolist()) for c in edits.keep))
    if regions:
        options = replace(options, keep_regions=regions)
    hint = _map_hint(path)
    with told_as(FloorplanError, path, f"a plan as {path.suffix or 'IMDF'}"):
        try:
            floorplan = reader(path, options)
        except LineWorkTooDense as error:
            raise FloorplanError(f"{path}: {error}") from error
        except FloorplanError as error:
            raise FloorplanError(f"{error}{f'; {hint}' if hint else ''}") from error
    if hint:
        source = replace(floorplan.source, warnings=(hint, *floorplan.source.warnings))
        floorplan = replace(floorplan, source=source)
    extent = max(floorplan.size)
    if floorplan.is_metric and not MIN_SIZE_M <= extent <= MAX_SIZE_M:
        as_written = extent / METRES_PER_UNIT.get(options.unit, 1.0)
        mend = "check --scale" if options.metres_per_unit else units_that_fit(as_written)
        raise FloorplanError(
            f"{path}: expected a building in metres ({MIN_SIZE_M:g} to {MAX_SIZE_M:g} m across), "
            f"found {floorplan.size[0]:.4g} x {floorplan.size[1]:.4g}; {mend}"
        )
    floorplan = floorplan.mirrored() if options.mirror else floorplan
    if options.edits is None and not regions:
        return floorplan
    edits = replace(edits, keep=tuple(np.array(corners) for corners in regions))
    return edited(floorplan, edits, str(options.edits or "--keep-region"))

"""`read_floorplan`: from a path to wall faces, whatever the format."""

from collections.abc import Callable
from pathlib import Path

from planfit.errors import FloorplanError
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.own_formats import read_json, read_npy
from planfit.floorplan.types import Floorplan

MIN_SIZE_M, MAX_SIZE_M = 1.5, 2000.0
"""A building is larger than a cupboard and smaller than a town: outside, the unit is not metres."""


def read_floorplan(path: str | Path, options: PlanOptions | None = None) -> Floorplan:
    """Read a plan of any kind that `READERS` knows: to metres where its unit is known.

    Raises:
        FloorplanError: the file is missing, of another kind, without walls, or of absurd size.
    """
    path, options = Path(path), options or PlanOptions()
    if not path.exists():
        raise FloorplanError(f"{path}: expected a floorplan, found nothing; check the path")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise FloorplanError(
            f"{path}: expected a plan as {' or '.join(READERS)}, "
            f"found {path.suffix or 'no suffix'}; save it as one of these (docs/formats.md)"
        )
    floorplan = reader(path, options)
    extent = max(floorplan.size)
    if floorplan.is_metric and not MIN_SIZE_M <= extent <= MAX_SIZE_M:
        raise FloorplanError(
            f"{path}: expected a building in metres ({MIN_SIZE_M:g} to {MAX_SIZE_M:g} m across), "
            f"found {floorplan.size[0]:.4g} x {floorplan.size[1]:.4g}; "
            "convert it from its own unit to metres, or give --unit or --scale"
        )
    return floorplan


def _read_picture(path: Path, options: PlanOptions) -> Floorplan:
    from planfit.floorplan.raster import read_raster  # OpenCV and SciPy: only where they are needed

    return read_raster(path, options)


READERS: dict[str, Callable[[Path, PlanOptions], Floorplan]] = {
    ".npy": read_npy,
    ".json": read_json,
    ".png": _read_picture,
    ".jpg": _read_picture,
    ".jpeg": _read_picture,
    ".tif": _read_picture,
    ".tiff": _read_picture,
}
"""Reader of each kind of file, by suffix."""

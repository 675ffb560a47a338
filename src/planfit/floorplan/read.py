"""`read_floorplan`: from a path to wall faces, whatever the format."""

from dataclasses import replace
from pathlib import Path

from planfit.errors import FloorplanError, told_as
from planfit.floorplan.edits import edited, read_edits
from planfit.floorplan.formats import PAPER_SUFFIXES, PICTURE_SUFFIXES, find_reader
from planfit.floorplan.near_lines import LineWorkTooDense
from planfit.floorplan.options import (
    MAX_SIZE_M,
    METRES_PER_UNIT,
    MIN_SIZE_M,
    PlanOptions,
    units_that_fit,
)
from planfit.floorplan.types import Floorplan
from planfit.runtime import require_content, unpacked


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
    if options.edits is None:
        return floorplan
    return edited(floorplan, read_edits(options.edits), str(options.edits))

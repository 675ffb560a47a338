"""`read_scan`: from a path to a scan, whatever its format."""

from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from planfit.errors import OptionError, ScanError
from planfit.scan.depth_unit import check_depth_unit
from planfit.scan.options import ScanOptions
from planfit.scan.pose_files import take_poses
from planfit.scan.source import Source, open_source
from planfit.scan.types import Scan
from planfit.scan.views import with_tolerance

READERS = {
    "facap": "facap",
    "stray": "stray",
    "record3d": "record3d",
    "scanner-app": "scanner_app",
    "polycam": "polycam",
    "tum": "tum",
    "7-scenes": "seven_scenes",
    "scannet": "scannet",
    "replica": "replica",
    "redwood": "redwood",
    "nerfstudio": "nerfstudio",
    "colmap": "colmap",
    "bag": "bag",
}
"""Module of this package that reads each format, in the order in which they are tried. Each has `LOOKS_FOR`,
`recognise(source)` and `read(source, options)`, and `PARTS` where several files (or folders, with a slash)
make the format. They are imported when they are asked for, and import the libraries of their own (video,
bags) only when they read."""


def read_scan(path: str | Path, use_masks: bool = True, options: ScanOptions | None = None) -> Scan:
    """Read a posed RGB-D scan; the format is recognised by what lies in the folder (docs/formats.md).

    Args:
        path: folder of the scan, zip archive of one, or bag.
        use_masks: whether floor and wall masks that lie beside the images are used.
        options: how to read it.

    Raises:
        ScanError: the scan is missing, of an unknown layout, or its files cannot be used.
        OptionError: there is no format of the name that `options` ask for.
    """
    path, options = Path(path), options or ScanOptions()
    options = replace(options, use_masks=use_masks and options.use_masks)
    _check_path(path)
    module, source = _reader(path, options.format)
    scan = module.read(source, options)
    if options.poses is not None:
        scan = take_poses(scan, options.poses, options.max_time_gap_s)
    scan = with_tolerance(scan)
    return replace(scan, warnings=(*scan.warnings, *check_depth_unit(scan)))


def _check_path(path: Path) -> None:
    try:
        path.stat()
    except FileNotFoundError:
        raise ScanError(
            f"{path}: expected the folder of a scan, found nothing; check the path"
        ) from None
    except OSError as error:  # links that lead in a circle, rights
        raise ScanError(
            f"{path}: expected the folder of a scan, cannot be opened ({error.strerror})"
        ) from error


def _reader(path: Path, name: str) -> tuple[ModuleType, Any]:
    if name not in ("auto", *READERS):
        raise OptionError(f"format: expected auto, {', '.join(READERS)}, found {name!r}")
    bag = import_module("planfit.scan.formats.bag")
    if name == "bag" or (name == "auto" and bag.is_bag(path)):
        return bag, bag.BagSource(path)
    source = open_source(path)
    names = [name] if name != "auto" else [n for n in READERS if n != "bag"]
    modules = [import_module(f"planfit.scan.formats.{READERS[n]}") for n in names]
    for module in modules:
        if module.recognise(source):
            return module, source
    if name != "auto":
        raise ScanError(
            f"{path}: expected a scan of the format {name}: {modules[0].LOOKS_FOR}; found none"
            f"{_nearest(source, names, modules)}"
        )
    below = [n for n in source.folders() if n.startswith(("seq-", "room", "office", "scene"))][:3]
    hint = f" Is it one of the folders inside: {', '.join(below)}?" if below else ""
    looked = "; ".join(
        f"{n}: {m.LOOKS_FOR}" for n, m in zip([*names, "bag"], [*modules, bag], strict=True)
    )
    raise ScanError(
        f"{path}: expected a scan, found none{_nearest(source, names, modules)}; looked for {looked}; "
        f"see docs/formats.md.{hint}"
    )


def _nearest(source: Source, names: list[str], modules: list[ModuleType]) -> str:
    """The format most of whose parts are there, and which are not; nothing where none is near."""
    found = []
    for name, module in zip(names, modules, strict=True):
        parts = getattr(module, "PARTS", ())
        missing = [part for part in parts if not _has(source, part)]
        if missing and 2 * len(missing) <= len(parts):
            found.append((len(missing), -len(parts), name, missing))
    if not found:
        return ""
    n_missing, _, name, missing = min(found)
    verb = "is" if n_missing == 1 else "are"
    return f" (nearest is {name}, but {', '.join(missing)} {verb} missing)"


def _has(source: Source, part: str) -> bool:
    if part.endswith("/"):
        return part[:-1] in source.folders() or bool(source.names(part[:-1]))
    return source.exists(part)

"""The formats of scans: each is an entry, a `FolderLayout` or a `WholeFile`, and decodes no pixel."""

from importlib import import_module

from planfit.scan.layout import FolderLayout, WholeFile

READERS = {
    "facap": "facap.FACAP",
    "stray": "stray.STRAY",
    "record3d": "record3d.RECORD3D",
    "scanner-app": "camera_json.SCANNER_APP",
    "polycam": "camera_json.POLYCAM",
    "openloris": "tum.OPENLORIS",
    "tum": "tum.TUM",
    "bundlefusion": "seven_scenes.BUNDLEFUSION",
    "7-scenes": "seven_scenes.SEVEN_SCENES",
    "scannet": "scannet.SCANNET",
    "arkit-scenes": "arkit_scenes.ARKIT_SCENES",
    "scannetpp": "scannet.SCANNETPP",
    "replica": "pose_lists.REPLICA",
    "redwood": "pose_lists.REDWOOD",
    "nerfstudio": "nerfstudio.NERFSTUDIO",
    "colmap": "colmap.COLMAP",
    "rtabmap-export": "rtabmap_export.RTABMAP_EXPORT",
    "any-folder": "any_folder.ANY_FOLDER",
    "rtabmap": "rtabmap.RTABMAP",
    "sens": "sens.SENS",
    "las": "las.LAS",
    "e57": "e57.E57",
    "bag": "bag.BAG",
}
"""Module of this package and entry in it by the format's name, in the order in which folders are tried. They
are imported when they are asked for, and import the libraries of their own (video, bags) only when they read.
"""

LAST = "any-folder"
"""Reads what no other format takes, and no copy of one that lacks files."""
OWN_FILES = ("las", "e57", "bag", "rtabmap", "sens")
"""Formats that are one file, which a library of their own opens, in the order in which they are tried."""


def layouts() -> dict[str, FolderLayout]:
    """Formats of folders and archives, by name, in the order in which they are tried."""
    found = {name: format_of(name) for name in READERS if name not in OWN_FILES}
    return {name: one for name, one in found.items() if isinstance(one, FolderLayout)}


def whole_files() -> dict[str, WholeFile]:
    """Formats of one file, by name, in the order in which they are tried."""
    found = {name: format_of(name) for name in OWN_FILES}
    return {name: one for name, one in found.items() if isinstance(one, WholeFile)}


def format_of(name: str) -> FolderLayout | WholeFile:
    """The format of a name of `READERS`."""
    module, _, entry = READERS[name].partition(".")
    return getattr(import_module(f"planfit.scan.formats.{module}"), entry)
